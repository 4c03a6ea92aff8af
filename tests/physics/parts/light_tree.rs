//! The tree of emitters: which of hundreds is drawn for a point, and with which probability.

use super::kernel::{Fault, Kernel, words};
use super::random::Random;
use super::statistics::chi_square;
use super::verdict::Verdict;
use crate::support::{grey, params, scene, square, work};
use candela::render::Work;
use candela::render::cpu::light::LightSampler;
use candela::render::cpu::light_tree::Receiver;
use candela::scene::{Material, Node};
use glam::{DAffine3, DQuat, DVec3, Vec3};

/// Lights picked for each receiver.
const DRAWS: usize = 1 << 18;

/// An implementation.
trait Tree {
    /// Index of the emitter and its probability; probability 0: none.
    fn pick(&self, receiver: &Receiver, u: &[[f64; 3]]) -> Vec<(usize, f64)>;
    /// Probability of each emitter.
    fn probabilities(&self, receiver: &Receiver) -> Vec<f64>;
    /// Of the sum of probabilities.
    fn rounding(&self) -> f64;
}

struct Shader {
    pick: Kernel,
    probability: Kernel,
    emitters: usize,
}

impl Shader {
    fn new(work: &Work, fault: Option<(Fault, f64)>) -> Self {
        let kernel = |entry| Kernel::new(work, entry, fault);
        Self { pick: kernel("light_pick"), probability: kernel("emitter_pick"), emitters: work.lighting.picks.len() }
    }
}

fn place(receiver: &Receiver, count: usize) -> [Vec<[u32; 4]>; 2] {
    [receiver.position, receiver.normal].map(|v| vec![words([v.x, v.y, v.z, 0.0]); count])
}

impl Tree for Shader {
    fn pick(&self, receiver: &Receiver, u: &[[f64; 3]]) -> Vec<(usize, f64)> {
        let points: Vec<_> = u.iter().map(|u| words([u[0], u[1], 0.0, 0.0])).collect();
        let [positions, normals] = place(receiver, u.len());
        let picks = self.pick.run(&[&points, &positions, &normals]);
        picks.into_iter().map(|[index, probability, ..]| (index as usize, probability)).collect()
    }

    fn probabilities(&self, receiver: &Receiver) -> Vec<f64> {
        let indices: Vec<_> = (0..self.emitters as u32).map(|index| [index, 0, 0, 0]).collect();
        let [positions, normals] = place(receiver, self.emitters);
        self.probability.run(&[&indices, &positions, &normals]).into_iter().map(|[p, ..]| p).collect()
    }

    fn rounding(&self) -> f64 {
        1e-5
    }
}

struct F64(LightSampler, usize);

impl Tree for F64 {
    fn pick(&self, receiver: &Receiver, u: &[[f64; 3]]) -> Vec<(usize, f64)> {
        let picks = u.iter().map(|u| self.0.pick(receiver, u[0]));
        picks.map(|pick| pick.map_or((0, 0.0), |pick| (pick.index, pick.probability))).collect()
    }

    fn probabilities(&self, receiver: &Receiver) -> Vec<f64> {
        (0..self.1).map(|emitter| self.0.of_emitter(emitter, receiver)).collect()
    }

    fn rounding(&self) -> f64 {
        1e-12
    }
}

/// Lamps of many sizes and strengths that look everywhere, some to both sides, two drawn twice; and what they light.
pub fn lamps() -> Work {
    let mut random = Random(5);
    let mut parts = Vec::new();
    for i in 0..150 {
        let place = DVec3::new(random.unit() * 8.0 - 4.0, random.unit() * 2.0 + 1.0, random.unit() * 8.0 - 4.0);
        let turn = DQuat::from_euler(glam::EulerRot::XYZ, 6.0 * random.unit(), 6.0 * random.unit(), 0.0);
        let (half, radiance) = (0.02 + 0.2 * random.unit(), 10f64.powf(3.0 * random.unit()));
        let material =
            Material { emissive: Vec3::splat(radiance as f32), double_sided: i % 4 == 0, ..grey(0.2, 1.0, 0.0) };
        parts.push((square(half as f32), material, DAffine3::from_rotation_translation(turn, place)));
    }
    parts.push((square(6.0), grey(0.5, 1.0, 0.0), DAffine3::IDENTITY));
    let mut scene = scene(parts);
    for mesh in [3, 4] {
        let local = DAffine3::from_scale_rotation_translation(
            DVec3::new(-1.0, 2.0, 0.5),
            DQuat::from_rotation_z(2.5),
            DVec3::new(f64::from(mesh), 2.0, -4.5),
        );
        scene.scenes[0].nodes.push(scene.nodes.len());
        scene.nodes.push(Node { mesh: Some(mesh as usize), local, ..Node::default() });
    }
    let work = work(&scene, &params("{}"));
    assert!(work.features.light_tree && work.scene.two_level && work.lighting.picks.len() == 304);
    work
}

/// On the floor, among the lamps, far away, and with its back to most of them.
fn receivers(work: &Work) -> [Receiver; 4] {
    let at = |position: [f64; 3], normal: [f64; 3]| Receiver {
        // In f32, so that both implementations get the same.
        position: (DVec3::from(position) - work.scene.origin).as_vec3().as_dvec3(),
        normal: DVec3::from(normal).normalize().as_vec3().as_dvec3(),
    };
    [
        at([0.3, 0.0, -0.2], [0.0, 1.0, 0.0]),
        at([1.0, 2.0, 1.5], [1.0, 0.3, -0.4]),
        at([40.0, 5.0, 30.0], [-1.0, 0.1, -0.5]),
        at([-1.5, 0.5, -1.5], [-1.0, 0.2, -1.0]),
    ]
}

/// Whether the front of an emitter can be seen from the receiver's front.
fn can_light(work: &Work, emitter: usize, receiver: &Receiver) -> bool {
    let emitter = &work.scene.emitters[emitter];
    let (instance, triangle) =
        (&work.scene.instances[emitter.instance as usize], &work.scene.triangles[emitter.triangle as usize]);
    let [a, b, c] = [triangle.v0, triangle.v1, triangle.v2].map(|v| {
        let v = Vec3::from_array(v).as_dvec3().extend(1.0);
        DVec3::from(instance.to_world.map(|row| glam::DVec4::from(row.map(f64::from)).dot(v)))
    });
    let mirror = if instance.flags & 1 == 1 { -1.0 } else { 1.0 };
    let front = (b - a).cross(c - a) * mirror;
    let facing = front.dot(receiver.position - a) > 1e-6 || emitter.double_sided;
    facing && [a, b, c].iter().any(|corner| (*corner - receiver.position).dot(receiver.normal) > 1e-6)
}

fn all(tree: &dyn Tree, work: &Work, engine: &'static str) -> Verdict {
    let mut verdict = Verdict::new("light tree", engine);
    for (place, receiver) in receivers(work).iter().enumerate() {
        let probabilities = tree.probabilities(receiver);
        let sum: f64 = probabilities.iter().sum();
        verdict.deviation(format!("sum at {place}, beyond 1"), [(sum - 1.0).max(0.0)], tree.rounding());
        let missed = (0..probabilities.len()).filter(|&i| probabilities[i] == 0.0 && can_light(work, i, receiver));
        verdict.deviation(format!("lamps that {place} sees and the tree does not"), [missed.count() as f64], 0.0);
        // A last one for those that find nothing: both children of a node may be dark though their common box is not.
        let mut observed = vec![0.0; probabilities.len() + 1];
        let mut off = Vec::new();
        for (index, probability) in tree.pick(receiver, &Random(place as u64 + 40).points(DRAWS)) {
            if probability == 0.0 {
                observed[probabilities.len()] += 1.0;
                continue;
            }
            observed[index] += 1.0;
            off.push((probability / probabilities[index] - 1.0).abs());
        }
        verdict.deviation(format!("probability of picks at {place}"), off, tree.rounding());
        let all = probabilities.iter().copied().chain([(1.0 - sum).max(0.0)]);
        let expected: Vec<f64> = all.map(|p| p * DRAWS as f64).collect();
        verdict.probability(format!("picks at {place}"), chi_square(&observed, &expected));
    }
    verdict
}

const FAULTS: [(&str, Fault, f64); 3] = [
    (
        "choice of the child",
        Fault { right: "if x < share {", wrong: |e| format!("if x < {} * share {{", 1.0 - e) },
        0.05,
    ),
    (
        "probability of a pick",
        Fault { right: "probability *= share;", wrong: |e| format!("probability *= {} * share;", 1.0 + e) },
        1e-3,
    ),
    (
        "cone of the box",
        Fault {
            right: "vec2f(sqrt(1.0 - sine_squared), sqrt(sine_squared))",
            wrong: |e| format!("vec2f(1.0, {e:e} * sine_squared)"),
        },
        1e-6,
    ),
];

#[test]
fn of_the_shader() {
    let work = lamps();
    all(&Shader::new(&work, None), &work, "shader").assert();
}

#[test]
fn of_the_f64_engine() {
    let work = lamps();
    all(&F64(LightSampler::new(&work), work.lighting.picks.len()), &work, "f64").assert();
}

#[test]
fn faults_are_found() {
    let work = lamps();
    for (name, fault, size) in FAULTS {
        let verdict = all(&Shader::new(&work, Some((fault, size))), &work, "shader");
        assert!(!verdict.failures().is_empty(), "{name}: a fault of {size} was not found");
    }
}
