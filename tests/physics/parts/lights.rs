//! Light sources: which one is picked, where on a triangle, and its density over solid angle.

use super::bins::test_uniform;
use super::kernel::{Fault, Kernel, words};
use super::random::{Random, lattice};
use super::statistics::chi_square;
use super::verdict::{Verdict, smallest_found};
use crate::support::{grey, params, scene, square, work, work_without_tree};
use candela::compile::NONE;
use candela::render::Work;
use candela::render::cpu::bvh::Hit;
use candela::render::cpu::light::{LightSampler, from_emitter};
use candela::render::cpu::light_tree::Receiver;
use candela::render::cpu::motion::Moment;
use candela::render::cpu::surface::Surface;
use candela::scene::{Material, Node, Scene};
use glam::{DAffine3, DQuat, DVec3, Vec3};
use std::f64::consts::PI;

/// Lights picked.
const DRAWS: usize = 1 << 20;
/// Draws of each triangle from each point.
const POINTS: usize = 1 << 15;

/// An implementation.
trait Lights {
    /// Index of the pick, and its probability.
    fn pick(&self, u: &[[f64; 3]]) -> Vec<(usize, f64)>;
    /// Way from a point to one of a light, its density, and radiance over density.
    fn sample(&self, from: DVec3, pick: usize, u: &[[f64; 3]]) -> Vec<(DVec3, f64, f64)>;
}

struct Shader {
    pick: Kernel,
    sample: Kernel,
    weight: Kernel,
}

impl Shader {
    fn new(work: &Work, fault: Option<(Fault, f64)>) -> Self {
        let kernel = |entry| Kernel::new(work, entry, fault);
        Self { pick: kernel("light_pick"), sample: kernel("light_sample"), weight: kernel("light_weight") }
    }
}

impl Lights for Shader {
    fn pick(&self, u: &[[f64; 3]]) -> Vec<(usize, f64)> {
        let points: Vec<_> = u.iter().map(|u| words([u[0], u[1], 0.0, 0.0])).collect();
        let nowhere = vec![words([0.0; 4]); u.len()];
        self.pick
            .run(&[&points, &nowhere, &nowhere])
            .into_iter()
            .map(|[index, probability, ..]| (index as usize, probability))
            .collect()
    }

    fn sample(&self, from: DVec3, pick: usize, u: &[[f64; 3]]) -> Vec<(DVec3, f64, f64)> {
        let points: Vec<_> = u
            .iter()
            .map(|u| {
                let [x, y, ..] = words([u[0], u[1], 0.0, 0.0]);
                [x, y, pick as u32, 0]
            })
            .collect();
        let origins = vec![words([from.x, from.y, from.z, 0.0]); u.len()];
        let ways = self.sample.run(&[&points, &origins]);
        let weights = self.weight.run(&[&points, &origins]);
        ways.into_iter().zip(weights).map(|([x, y, z, pdf], [weight, ..])| (DVec3::new(x, y, z), pdf, weight)).collect()
    }
}

fn lamp(radiance: f32) -> Material {
    Material { emissive: Vec3::splat(radiance), ..Material::default() }
}

/// Over a floor a lamp alone, and another drawn twice, once stretched and once mirrored.
fn lamps() -> Scene {
    let at = |x: f64, scale: DVec3| {
        let turn = DQuat::from_euler(glam::EulerRot::XYZ, 2.9, 0.3 * x, 0.4);
        DAffine3::from_scale_rotation_translation(scale, turn, DVec3::new(x, 2.0, 0.5))
    };
    let below = DAffine3::from_translation(DVec3::new(0.0, -1.0, 0.0));
    let mut scene = scene(vec![
        (square(30.0), grey(0.5, 1.0, 0.0), below),
        (square(0.8), lamp(3.0), at(-2.0, DVec3::ONE)),
        (square(0.5), lamp(40.0), at(0.3, DVec3::new(1.0, 2.0, 3.0))),
    ]);
    let mirrored = at(2.5, DVec3::new(-0.5, 1.0, 0.7));
    scene.scenes[0].nodes.push(scene.nodes.len());
    scene.nodes.push(Node { mesh: Some(2), local: mirrored, ..Node::default() });
    scene
}

struct F64(Work, LightSampler);

impl F64 {
    fn new(work: Work) -> Self {
        let lights = LightSampler::new(&work);
        Self(work, lights)
    }
}

impl Lights for F64 {
    fn pick(&self, u: &[[f64; 3]]) -> Vec<(usize, f64)> {
        let anywhere = Receiver { position: DVec3::ZERO, normal: DVec3::Y };
        let picks = u.iter().map(|u| self.1.pick(&anywhere, u[0]).expect("lights"));
        picks.map(|pick| (pick.index, pick.probability)).collect()
    }

    fn sample(&self, from: DVec3, pick: usize, u: &[[f64; 3]]) -> Vec<(DVec3, f64, f64)> {
        let scene = &self.0.scene;
        let (instance, triangle) = floor(&self.0);
        let [b, c] = weights(corners_of(&self.0, instance, triangle), from);
        let hit = Hit { t: 1.0, u: b, v: c, triangle: triangle as u32, instance: instance as u32 };
        let surface = Surface::new(scene, &hit, DVec3::NEG_Y, Moment::OPEN);
        let entry = &self.0.lighting.picks[pick];
        let probability = self.1.of_light(pick);
        u.iter()
            .map(|u| {
                let light = from_emitter(scene, entry, probability, &surface.place(), [u[0], u[1]]);
                (light.direction, light.pdf.unwrap_or(0.0), light.weight.x)
            })
            .collect()
    }
}

/// Many lamps, a few of them a million times as strong as the weakest, under five punctual lights.
fn many() -> (Work, Vec<f64>) {
    let mut random = Random(21);
    let mut parts = Vec::new();
    let mut fluxes = Vec::new();
    for i in 0..200 {
        let (half, radiance) = (0.01 + 0.05 * random.unit(), 10f64.powf(6.0 * random.unit() - 3.0));
        let place = DVec3::new(f64::from(i % 20), 0.0, f64::from(i / 20)) * 0.3;
        parts.push((square(half as f32), lamp(radiance as f32), DAffine3::from_translation(place)));
        // Each square has two triangles, each with the flux of one side.
        fluxes.extend([PI * radiance * 2.0 * half * half; 2]);
    }
    (work_without_tree(&scene(parts), &params("{}")), fluxes)
}

/// Picks come as often as their probability says, and that follows their flux: nine tenths by flux, the rest evenly.
fn picks(lights: &dyn Lights, work: &Work, fluxes: &[f64], verdict: &mut Verdict) {
    let count = work.lighting.picks.len();
    assert_eq!(count, fluxes.len());
    let total: f64 = fluxes.iter().sum();
    let mut expected: Vec<f64> = fluxes.iter().map(|flux| 0.9 * flux / total + 0.1 / count as f64).collect();
    // Lights of equal flux are told apart by nothing; their order in the table is the tree's.
    let by_table: Vec<f64> = work.lighting.picks.iter().map(|pick| f64::from(pick.probability)).collect();
    let mut observed = vec![0.0; count];
    let mut off = Vec::new();
    for (index, probability) in lights.pick(&Random(33).points(DRAWS)) {
        observed[index] += 1.0;
        off.push((probability / by_table[index] - 1.0).abs());
    }
    let probabilities: Vec<f64> = by_table.iter().map(|p| p * DRAWS as f64).collect();
    verdict.probability(format!("{count} lights picked"), chi_square(&observed, &probabilities));
    verdict.deviation("probability of a pick".into(), off, 1e-6);
    let mut sorted = by_table.clone();
    sorted.sort_by(f64::total_cmp);
    expected.sort_by(f64::total_cmp);
    let off = sorted.iter().zip(&expected).map(|(got, expected)| (got / expected - 1.0).abs());
    verdict.deviation("probabilities by flux".into(), off, 1e-4);
}

/// A triangle's points are uniform, and densities over solid angle follow.
fn triangles(lights: &dyn Lights, work: &Work, verdict: &mut Verdict) {
    let (instance, triangle) = floor(work);
    let [a, b, c] = corners_of(work, instance, triangle);
    // Of the floor's corners: near the lamps, beside them, far away.
    let froms = [[0.02, 0.49, 0.49], [0.05, 0.46, 0.49], [0.2, 0.1, 0.7]];
    for pick in 0..work.lighting.picks.len() {
        for [x, y, z] in froms {
            let from = (a * x + b * y + c * z).as_vec3().as_dvec3();
            let case = format!("triangle {pick} from {from:.1}");
            let corners = corners(work, pick);
            let draws = lights.sample(from, pick, &Random(pick as u64 + 1).points(POINTS));
            let points: Vec<_> = draws.iter().map(|(way, ..)| unit_square(corners, from + *way)).collect();
            verdict.probability(case.clone(), test_uniform(&points, 16));
            densities(work, pick, &draws, &case, verdict);
            solid_angle(lights, work, pick, from, &case, verdict);
        }
    }
}

/// World positions of a triangle's vertices, relative to the scene's origin.
fn corners(work: &Work, pick: usize) -> [DVec3; 3] {
    let pick = &work.lighting.picks[pick];
    corners_of(work, pick.index as usize, pick.triangle as usize)
}

/// Instance and index of a triangle that does not shine; it is drawn once, so its instance is the world.
fn floor(work: &Work) -> (usize, usize) {
    let identity = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]];
    let world = work.scene.instances.iter().position(|instance| instance.to_world == identity);
    let dark = work.scene.triangles.iter().position(|triangle| triangle.light == NONE);
    (world.expect("what is drawn once"), dark.expect("a floor"))
}

fn corners_of(work: &Work, instance: usize, triangle: usize) -> [DVec3; 3] {
    let instance = &work.scene.instances[instance];
    let triangle = &work.scene.triangles[triangle];
    [triangle.v0, triangle.v1, triangle.v2].map(|v| {
        let v = Vec3::from_array(v).as_dvec3();
        let row = |k: usize| {
            let [x, y, z, w] = instance.to_world[k].map(f64::from);
            x * v.x + y * v.y + z * v.z + w
        };
        DVec3::new(row(0), row(1), row(2))
    })
}

/// Weights of the second and the third corner at a point.
fn weights([a, b, c]: [DVec3; 3], point: DVec3) -> [f64; 2] {
    let normal = (b - a).cross(c - a);
    let part = |p: DVec3, q: DVec3| (p - a).cross(q - a).dot(normal) / normal.length_squared();
    [part(point, c), part(b, point)]
}

/// A point of a triangle on the unit square, to which uniform points are mapped uniformly: the square of the distance
/// from the first vertex, and the angle, in barycentrics.
fn unit_square(corners: [DVec3; 3], point: DVec3) -> [f64; 2] {
    let [u, v] = weights(corners, point);
    let sum = (u + v).clamp(0.0, 1.0);
    [sum * sum, (v / sum.max(1e-12)).clamp(0.0, 1.0)]
}

fn densities(work: &Work, pick: usize, draws: &[(DVec3, f64, f64)], case: &str, verdict: &mut Verdict) {
    let [a, b, c] = corners(work, pick);
    let normal = (b - a).cross(c - a);
    let entry = &work.lighting.picks[pick];
    let mirrored = work.scene.instances[entry.index as usize].flags & 1 == 1;
    let radiance = f64::from(work.scene.materials[material(work, pick)].emissive[0]);
    let (mut off, mut light) = (Vec::new(), Vec::new());
    for (way, pdf, weight) in draws {
        let cosine = -way.normalize().dot(normal.normalize()) * if mirrored { -1.0 } else { 1.0 };
        let expected = f64::from(entry.probability) * way.length_squared() / (0.5 * normal.length() * cosine.abs());
        off.push((pdf / expected - 1.0).abs());
        let shown = if cosine > 0.0 { radiance } else { 0.0 };
        light.push((weight * pdf - shown).abs() / radiance);
    }
    verdict.deviation(format!("{case}, density"), off, 1e-4);
    verdict.deviation(format!("{case}, radiance"), light, 1e-5);
}

fn material(work: &Work, pick: usize) -> usize {
    (work.scene.triangles[work.lighting.picks[pick].triangle as usize].material & 0x7fff_ffff) as usize
}

/// The inverse of the density averages to the solid angle (Van Oosterom and Strackee 1983).
fn solid_angle(lights: &dyn Lights, work: &Work, pick: usize, from: DVec3, case: &str, verdict: &mut Verdict) {
    let [a, b, c] = corners(work, pick).map(|corner| corner - from);
    let (la, lb, lc) = (a.length(), b.length(), c.length());
    let triple = a.dot(b.cross(c)).abs();
    let exact = 2.0 * triple.atan2(la * lb * lc + a.dot(b) * lc + a.dot(c) * lb + b.dot(c) * la);
    let u = lattice(POINTS);
    let inverse: f64 = lights.sample(from, pick, &u).iter().map(|(_, pdf, _)| 1.0 / pdf).sum();
    let got = inverse / POINTS as f64 * f64::from(work.lighting.picks[pick].probability);
    verdict.deviation(format!("{case}, solid angle"), [(got / exact - 1.0).abs()], 1e-3);
}

fn all<L: Lights>(engine: &'static str, lights: impl Fn(&Work) -> L) -> Verdict {
    let mut verdict = Verdict::new("lights", engine);
    let (work_of_many, fluxes) = many();
    picks(&lights(&work_of_many), &work_of_many, &fluxes, &mut verdict);
    let few = work(&lamps(), &params("{}"));
    assert!(few.scene.two_level, "a lamp is drawn twice");
    triangles(&lights(&few), &few, &mut verdict);
    verdict
}

/// The shader's, with a fault in it.
fn broken(fault: Option<(Fault, f64)>) -> Verdict {
    all("shader", |work| Shader::new(work, fault))
}

/// What is broken to see whether the tests find it.
const FAULTS: [(&str, Fault, f64); 4] = [
    (
        "place on a triangle",
        Fault { right: "let x = 0.5 * u.x;", wrong: |e| format!("let x = {} * u.x;", 0.5 * (1.0 - e)) },
        0.05,
    ),
    (
        "density over solid angle",
        Fault {
            right: "return select(0.0, probability * distance_squared /",
            wrong: |e| format!("return select(0.0, {} * probability * distance_squared /", 1.0 + e),
        },
        0.01,
    ),
    (
        "kept entries of the alias table",
        Fault { right: "u.y >= picks[i].keep)", wrong: |e| format!("u.y >= {} * picks[i].keep)", 1.0 - e) },
        0.1,
    ),
    (
        "first entry of the alias table",
        Fault {
            right: "let i = min(u32(u.x * f32(frame.pick_count)),",
            wrong: |e| format!("let i = min(u32({:e} * u.x * f32(frame.pick_count)),", 1.0 - e),
        },
        0.01,
    ),
];

#[test]
fn of_the_shader() {
    broken(None).assert();
}

#[test]
fn of_the_f64_engine() {
    all("f64", |work| F64::new(work.clone())).assert();
}

#[test]
fn faults_are_found() {
    for (name, fault, size) in FAULTS {
        assert!(!broken(Some((fault, size))).failures().is_empty(), "{name}: a fault of {size} was not found");
    }
}

#[test]
#[ignore = "prints the power of the tests"]
fn power() {
    for (name, fault, _) in FAULTS {
        let found = |size| !broken(Some((fault, size))).failures().is_empty();
        eprintln!("| lights | {name} | {:?} |", smallest_found(found));
    }
}
