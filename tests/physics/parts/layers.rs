//! Lobes of materials with extensions: what is drawn against the density that is stated, both engines' values against one
//! another, reciprocity where it holds, and that nothing returns more than it gets.

use super::bins::test_density;
use super::kernel::{Fault, Kernel, words};
use super::quadrature::{Rectangle, integrate};
use super::random::{Random, lattice};
use super::verdict::Verdict;
use crate::support::{grey, params, scene, square, work};
use candela::render::Work;
use candela::render::cpu::bvh::Hit;
use candela::render::cpu::layers::{Crossing, Layered, Media, Reflection, frame};
use candela::render::cpu::material::Model;
use candela::render::cpu::motion::Moment;
use candela::render::cpu::surface::Surface;
use candela::scene::{Extended, Material, Volume};
use glam::{DAffine3, DVec3, Vec3, Vec4};
use std::cell::RefCell;
use std::collections::HashMap;
use std::f64::consts::TAU;
use std::sync::Arc;

/// Draws of each chi-square test.
const DRAWS: usize = 1 << 17;
/// Directions of each comparison of values.
const PAIRS: usize = 1 << 12;
/// Points of each furnace.
const FURNACE: usize = 1 << 15;
/// Of the viewer, from the normal.
const DEGREES: [f64; 3] = [10.0, 50.0, 80.0];

/// A material under test.
struct Case {
    name: &'static str,
    material: Material,
    /// Index beyond over that before; 0: walls are thin.
    eta: f64,
    /// f(wo, wi) = f(wi, wo).
    reciprocal: bool,
}

fn case(name: &'static str, roughness: f32, metallic: f32, eta: f64, reciprocal: bool, extended: &Extended) -> Case {
    let base = grey(0.8, roughness, metallic);
    let volume = (eta > 0.0).then_some(Volume { attenuation_color: Vec3::ONE, attenuation_distance: f32::INFINITY });
    let extended = Some(Arc::new(Extended { volume, ..extended.clone() }));
    Case { name, material: Material { base_color: Vec4::new(0.8, 0.6, 0.4, 1.0), extended, ..base }, eta, reciprocal }
}

/// Layers that keep for those below what they do not send towards the viewer are not reciprocal (docs/gltf.md), nor is energy
/// compensation of rough glass.
fn cases() -> [Case; 9] {
    let base = Extended::default;
    let tinted = Vec3::new(1.5, 0.8, 0.3);
    [
        case("specular", 0.4, 0.3, 0.0, true, &Extended { ior: 1.8, specular: 0.7, specular_color: tinted, ..base() }),
        case("rough glass", 0.4, 0.0, 1.5, false, &Extended { transmission: 1.0, ..base() }),
        case("rough glass from within", 0.4, 0.0, 1.0 / 1.5, false, &Extended { transmission: 1.0, ..base() }),
        case("rough wall", 0.4, 0.2, 0.0, false, &Extended { transmission: 0.6, ..base() }),
        case("coat", 0.6, 0.5, 0.0, false, &Extended { clearcoat: 0.8, clearcoat_roughness: 0.3, ..base() }),
        case(
            "sheen",
            0.6,
            0.0,
            0.0,
            false,
            &Extended { sheen_color: tinted.min(Vec3::ONE), sheen_roughness: 0.4, ..base() },
        ),
        case("grain", 0.3, 0.5, 0.0, true, &Extended { anisotropy: 0.7, ..base() }),
        case("film", 0.3, 0.4, 0.0, false, &Extended { iridescence: 0.9, ..base() }),
        case("passing diffusely", 0.4, 0.1, 0.0, true, &Extended { diffuse_transmission: 0.5, ..base() }),
    ]
}

fn single(case: &Case) -> Work {
    let mut work = work(&scene(vec![(square(1.0), case.material.clone(), DAffine3::IDENTITY)]), &params("{}"));
    // Kernels that are specialised alike are made once.
    work.features.mirror = true;
    work
}

/// An implementation, asked from one viewer at a time.
trait Lobes {
    fn engine(&self) -> &'static str;
    /// Direction and density for (u, choice); none: the sample is not valid.
    fn sample(&self, case: &Case, wo: DVec3, u: &[[f64; 3]]) -> Vec<Option<(DVec3, f64)>>;
    /// Weight of the same samples, 0 if not valid.
    fn weights(&self, case: &Case, wo: DVec3, u: &[[f64; 3]]) -> Vec<DVec3>;
    /// f cos and density for pairs of directions.
    fn values(&self, case: &Case, pairs: &[[DVec3; 2]]) -> Vec<(DVec3, f64)>;
}

struct Shader {
    fault: Option<(Fault, f64)>,
    /// By case and entry.
    kernels: RefCell<HashMap<(&'static str, &'static str), Kernel>>,
}

impl Shader {
    fn new(fault: Option<(Fault, f64)>) -> Self {
        Self { fault, kernels: RefCell::default() }
    }

    fn run(&self, entry: &'static str, case: &Case, viewers: &[[u32; 4]], others: &[[u32; 4]]) -> Vec<[f64; 4]> {
        let mut kernels = self.kernels.borrow_mut();
        let make = || Kernel::new(&single(case), entry, self.fault);
        kernels.entry((case.name, entry)).or_insert_with(make).run(&[viewers, others])
    }

    fn seen_from(&self, entry: &'static str, case: &Case, wo: DVec3, u: &[[f64; 3]]) -> Vec<[f64; 4]> {
        let choices: Vec<_> = u.iter().map(|u| words([u[0], u[1], u[2], 0.0])).collect();
        self.run(entry, case, &vec![words([wo.x, wo.y, wo.z, case.eta]); u.len()], &choices)
    }
}

impl Lobes for Shader {
    fn engine(&self) -> &'static str {
        "shader"
    }

    fn sample(&self, case: &Case, wo: DVec3, u: &[[f64; 3]]) -> Vec<Option<(DVec3, f64)>> {
        let results = self.seen_from("layers_sample", case, wo, u);
        results.into_iter().map(|[x, y, z, pdf]| (pdf > 0.0).then_some((DVec3::new(x, y, z), pdf))).collect()
    }

    fn weights(&self, case: &Case, wo: DVec3, u: &[[f64; 3]]) -> Vec<DVec3> {
        let results = self.seen_from("layers_weight", case, wo, u);
        results.into_iter().map(|[r, g, b, _]| DVec3::new(r, g, b)).collect()
    }

    fn values(&self, case: &Case, pairs: &[[DVec3; 2]]) -> Vec<(DVec3, f64)> {
        let viewers: Vec<_> = pairs.iter().map(|[wo, _]| words([wo.x, wo.y, wo.z, case.eta])).collect();
        let others: Vec<_> = pairs.iter().map(|[_, wi]| words([wi.x, wi.y, wi.z, 0.0])).collect();
        let results = self.run("layers_value", case, &viewers, &others);
        results.into_iter().map(|[r, g, b, pdf]| (DVec3::new(r, g, b), pdf)).collect()
    }
}

struct F64;

impl F64 {
    fn with<T>(case: &Case, ask: impl FnOnce(&dyn Fn(DVec3) -> Reflection) -> T) -> T {
        let work = single(case);
        let hit = Hit { t: 1.0, u: 0.3, v: 0.3, triangle: 0, instance: 0 };
        let surface = Surface::new(&work.scene, &hit, DVec3::NEG_Y, Moment::OPEN);
        let extended = surface.material.extended(&work.scene).expect("a material with extensions");
        let frame = frame(&surface, Some(extended));
        let crossing = (case.eta > 0.0).then(|| Crossing { eta: case.eta, beyond: Media::default() });
        let model = Model { specular: true, multiple_scattering: true };
        ask(&|wo| {
            let layered = Layered::new(&surface, extended, model, &frame, wo, crossing.as_ref(), None);
            Reflection::Layered(Box::new(layered))
        })
    }
}

impl Lobes for F64 {
    fn engine(&self) -> &'static str {
        "f64"
    }

    fn sample(&self, case: &Case, wo: DVec3, u: &[[f64; 3]]) -> Vec<Option<(DVec3, f64)>> {
        Self::with(case, |seen| {
            let lobes = seen(wo);
            u.iter().map(|u| lobes.sample(u[2], [u[0], u[1]]).and_then(|s| Some((s.wi, s.pdf?)))).collect()
        })
    }

    fn weights(&self, case: &Case, wo: DVec3, u: &[[f64; 3]]) -> Vec<DVec3> {
        Self::with(case, |seen| {
            let lobes = seen(wo);
            u.iter().map(|u| lobes.sample(u[2], [u[0], u[1]]).map_or(DVec3::ZERO, |s| s.weight)).collect()
        })
    }

    fn values(&self, case: &Case, pairs: &[[DVec3; 2]]) -> Vec<(DVec3, f64)> {
        Self::with(case, |seen| pairs.iter().map(|[wo, wi]| seen(*wo).evaluate(*wi)).collect())
    }
}

/// Cosine from the normal, and azimuth.
fn coordinates(w: DVec3) -> [f64; 2] {
    [w.z.clamp(-1.0, 1.0), w.y.atan2(w.x).rem_euclid(TAU)]
}

fn direction(z: f64, azimuth: f64) -> DVec3 {
    let r = (1.0 - z * z).max(0.0).sqrt();
    DVec3::new(r * azimuth.cos(), r * azimuth.sin(), z)
}

fn viewer(degrees: f64) -> DVec3 {
    // Not in the plane of a grain, and rounded as the shader gets it.
    direction(degrees.to_radians().cos(), 0.4).as_vec3().as_dvec3()
}

const SPHERE: Rectangle = Rectangle { low: [-1.0, 0.0], high: [1.0, TAU] };

fn judge(lobes: &dyn Lobes, cases: &[Case], degrees: &[f64]) -> Verdict {
    let mut verdict = Verdict::new("layers", lobes.engine());
    for case in cases {
        for &angle in degrees {
            samples(lobes, case, angle, &mut verdict);
            furnace(lobes, case, angle, &mut verdict);
        }
        values(lobes, case, &mut verdict);
    }
    verdict
}

/// Chi-square of what is drawn against the f64 engine's density.
fn samples(lobes: &dyn Lobes, case: &Case, angle: f64, verdict: &mut Verdict) {
    let wo = viewer(angle);
    let draws = lobes.sample(case, wo, &Random(angle.to_bits() ^ case.name.len() as u64).points(DRAWS));
    let points: Vec<_> = draws.iter().map(|draw| draw.map(|(w, _)| coordinates(w))).collect();
    let p = F64::with(case, |seen| {
        let lobes = seen(wo);
        let density = |z: f64, azimuth: f64| lobes.evaluate(direction(z, azimuth)).1;
        test_density(&points, SPHERE, |leaf| {
            // The density jumps at the horizon; other edges of it are short beside a leaf, and not worth to be followed.
            let split = 0.0f64.clamp(leaf.low[0], leaf.high[0]);
            let below = Rectangle { high: [split, leaf.high[1]], ..*leaf };
            let above = Rectangle { low: [split, leaf.low[1]], ..*leaf };
            let halves = [below, above].into_iter().filter(|half| half.high[0] > half.low[0]);
            halves.flat_map(cells).map(|cell| integrate(&density, cell, f64::INFINITY, 0.0)).sum()
        })
    });
    verdict.probability(format!("{}, {angle} degrees", case.name), p);
}

fn cells(of: Rectangle) -> impl Iterator<Item = Rectangle> {
    const SIDE: u32 = 3;
    let at = move |k: usize, i: u32| of.low[k] + (of.high[k] - of.low[k]) * f64::from(i) / f64::from(SIDE);
    (0..SIDE * SIDE).map(move |k| {
        let (i, j) = (k % SIDE, k / SIDE);
        Rectangle { low: [at(0, i), at(1, j)], high: [at(0, i + 1), at(1, j + 1)] }
    })
}

/// No colour returns more than it gets.
fn furnace(lobes: &dyn Lobes, case: &Case, angle: f64, verdict: &mut Verdict) {
    let weights = lobes.weights(case, viewer(angle), &lattice(FURNACE));
    let mean = weights.iter().sum::<DVec3>() / FURNACE as f64;
    verdict.deviation(format!("{}, {angle} degrees: returns {mean:.3}", case.name), [mean.max_element()], 1.005);
}

/// Values and densities against those of the f64 engine, for random pairs of directions; both ways where that holds.
fn values(lobes: &dyn Lobes, case: &Case, verdict: &mut Verdict) {
    let mut random = Random(5);
    let mut any = |low: f64| direction(low + (0.995 - low) * random.unit(), TAU * random.unit()).as_vec3().as_dvec3();
    let pairs: Vec<[DVec3; 2]> = (0..PAIRS).map(|_| [any(0.05), any(-0.995)]).collect();
    let expected = F64.values(case, &pairs);
    let got = lobes.values(case, &pairs);
    let off = |a: f64, b: f64| (a - b).abs() / (b.abs() + 0.02);
    let off_value =
        got.iter().zip(&expected).map(|(a, b)| (a.0 - b.0).abs().max_element() / (b.0.max_element() + 0.02));
    verdict.deviation(format!("{}, value", case.name), off_value, 2e-3);
    let off_density = got.iter().zip(&expected).map(|(a, b)| off(a.1, b.1));
    verdict.deviation(format!("{}, density", case.name), off_density, 2e-3);
    if case.reciprocal {
        // From below, the surface is seen in a frame that is turned over: by its symmetry the way back is that of the mirror image.
        let above: Vec<_> = pairs.iter().map(|[wo, wi]| [*wo, wi.with_z(wi.z.abs().max(0.05)).normalize()]).collect();
        let swapped: Vec<_> = above.iter().map(|[wo, wi]| [*wi, *wo]).collect();
        let (there, back) = (lobes.values(case, &above), lobes.values(case, &swapped));
        let sides = above.iter().zip(there.iter().zip(&back));
        let off = sides.map(|([wo, wi], (there, back))| (there.0 / wi.z - back.0 / wo.z).abs().max_element());
        verdict.deviation(format!("{}, reciprocity", case.name), off, 5e-3);
    }
}

/// What is broken to see whether the tests find it.
const FAULTS: [(&str, usize, Fault, f64); 3] = [
    (
        "density of refraction",
        1,
        Fault {
            right: "let density = visible * glass.eta * glass.eta * -cos_i",
            wrong: |e| format!("let density = visible * glass.eta * glass.eta * {} * -cos_i", 1.0 + e),
        },
        0.02,
    ),
    (
        "probability of sheen",
        5,
        Fault { right: "pdf += SHEEN_PDF * ", wrong: |e| format!("pdf += {} * SHEEN_PDF * ", 1.0 + e) },
        0.02,
    ),
    (
        "width of normals sampled along the grain",
        6,
        Fault {
            right: "return normalize(vec3f(alpha * normal.xy, max(normal.z, 0.0)));",
            wrong: |e| format!("return normalize(vec3f(alpha * {} * normal.xy, max(normal.z, 0.0)));", 1.0 + e),
        },
        0.2,
    ),
];

#[test]
fn of_the_shader() {
    judge(&Shader::new(None), &cases(), &DEGREES).assert();
}

#[test]
fn of_the_f64_engine() {
    judge(&F64, &cases(), &DEGREES).assert();
}

#[test]
fn faults_are_found() {
    for (name, case, fault, size) in FAULTS {
        let failures = judge(&Shader::new(Some((fault, size))), &cases()[case..=case], &[50.0]).failures();
        assert!(!failures.is_empty(), "{name}: a fault of {size} was not found");
        eprintln!("{name}: {}", failures[0]);
    }
}
