//! Lights with an extent: directions that are drawn, their density, and what a ray finds that goes there.

use super::bins::test_uniform;
use super::kernel::{Fault, Kernel, words};
use super::random::Random;
use super::statistics::chi_square;
use super::verdict::Verdict;
use crate::support::{grey, params, scene, square, work};
use candela::compile::{PunctualKind, PunctualLight};
use candela::render::Work;
use candela::render::cpu::extended_light::Shape;
use glam::{DAffine3, DVec3, Vec3};
use std::f64::consts::{PI, TAU};

/// Draws of each light.
const DRAWS: usize = 1 << 17;
/// Cells a side of a light.
const SIDE: usize = 16;

/// What is drawn: a direction of unit length, the distance of the light, the density.
type Draw = (DVec3, f64, f64);

/// An implementation.
trait Lights {
    fn sample(&self, eye: DVec3, light: usize, u: &[[f64; 3]]) -> Vec<Draw>;
    /// Distance and density that rays find; distance negative: they miss.
    fn meet(&self, eye: DVec3, light: usize, directions: &[DVec3]) -> Vec<(f64, f64)>;
    /// Relative, of densities and distances.
    fn rounding(&self) -> f64;
    /// Solid angle of a rectangle below which it is sampled by area.
    fn wide(&self) -> f64;
}

struct Shader {
    work: Work,
    sample: Kernel,
    met: Kernel,
}

impl Shader {
    fn new(work: &Work, fault: Option<(Fault, f64)>) -> Self {
        let kernel = |entry| Kernel::new(work, entry, fault);
        Self { work: work.clone(), sample: kernel("light_sample"), met: kernel("light_met") }
    }

    fn probability(&self, light: usize) -> f64 {
        f64::from(self.work.lighting.picks[light].probability)
    }
}

impl Lights for Shader {
    fn sample(&self, eye: DVec3, light: usize, u: &[[f64; 3]]) -> Vec<Draw> {
        let points: Vec<_> = u
            .iter()
            .map(|u| {
                let [x, y, ..] = words([u[0], u[1], 0.0, 0.0]);
                [x, y, light as u32, 0]
            })
            .collect();
        let eyes = vec![words([eye.x, eye.y, eye.z, 0.0]); u.len()];
        let drawn = self.sample.run(&[&points, &eyes]);
        let directions: Vec<_> = drawn.iter().map(|[x, y, z, _]| DVec3::new(*x, *y, *z)).collect();
        let met = self.meet(eye, light, &directions);
        let draws = directions.into_iter().zip(&drawn).zip(met);
        draws.map(|((way, [.., pdf]), (distance, _))| (way, distance, pdf / self.probability(light))).collect()
    }

    fn meet(&self, eye: DVec3, light: usize, directions: &[DVec3]) -> Vec<(f64, f64)> {
        let indices = vec![[light as u32, 0, 0, 0]; directions.len()];
        let eyes = vec![words([eye.x, eye.y, eye.z, 0.0]); directions.len()];
        let ways: Vec<_> = directions.iter().map(|d| words([d.x, d.y, d.z, 0.0])).collect();
        let met = self.met.run(&[&indices, &eyes, &ways]);
        met.into_iter().map(|[t, pdf, ..]| (t, pdf / self.probability(light))).collect()
    }

    fn rounding(&self) -> f64 {
        2e-4
    }

    fn wide(&self) -> f64 {
        0.02
    }
}

struct F64(Vec<Shape>);

impl Lights for F64 {
    fn sample(&self, eye: DVec3, light: usize, u: &[[f64; 3]]) -> Vec<Draw> {
        let found = u.iter().filter_map(|u| self.0[light].sample(eye, [u[0], u[1]]));
        found.map(|found| (found.direction, found.distance, found.pdf)).collect()
    }

    fn meet(&self, eye: DVec3, light: usize, directions: &[DVec3]) -> Vec<(f64, f64)> {
        let shape = &self.0[light];
        let met = directions.iter().map(|direction| (shape.meet(eye, *direction), *direction));
        met.map(|(t, direction)| t.map_or((-1.0, 0.0), |t| (t, shape.pdf(eye, direction, t)))).collect()
    }

    fn rounding(&self) -> f64 {
        1e-6
    }

    fn wide(&self) -> f64 {
        1e-4
    }
}

/// Large and small, near and far, straight and askew, seen from the origin.
const LIGHTS: &str = r#"{"lights": [
    {"type": "directional", "direction": [0.3, -1, 0.2], "angular_diameter_degrees": 0.53},
    {"type": "directional", "direction": [-0.6, -0.2, 0.5], "angular_diameter_degrees": 120},
    {"type": "sphere", "position": [1, 2, -1], "radius": 0.4},
    {"type": "sphere", "position": [0, 1, 0.3], "radius": 0.99},
    {"type": "sphere", "position": [300, 100, -50], "radius": 0.5},
    {"type": "disk", "position": [0.4, 1.2, -0.3], "direction": [0.1, -1, 0.3], "radius": 0.8},
    {"type": "rect", "position": [0.2, 0.4, -0.1], "direction": [0, -1, 0], "width": 3, "height": 1.5, "up": [1, 0, 1]},
    {"type": "rect", "position": [1, 2, -1.5], "direction": [-0.2, -1, 0.6], "width": 0.6, "height": 1.1},
    {"type": "rect", "position": [2, 1, 0], "direction": [-0.2, -1, 0], "width": 2, "height": 0.02, "up": [0, 0, 1]},
    {"type": "rect", "position": [60, 80, 10], "direction": [-0.6, -0.8, 0.3], "width": 2, "height": 3}
]}"#;

/// The lights over a floor whose middle is the origin.
fn lit() -> Work {
    let work = work(&scene(vec![(square(4.0), grey(0.5, 1.0, 0.0), DAffine3::IDENTITY)]), &params(LIGHTS));
    assert_eq!((work.lighting.extended, work.scene.origin), (10, DVec3::ZERO));
    work
}

fn vector(v: [f32; 3]) -> DVec3 {
    Vec3::from_array(v).as_dvec3()
}

/// Solid angle of a triangle (Van Oosterom and Strackee 1983).
fn solid_angle([a, b, c]: [DVec3; 3]) -> f64 {
    let (la, lb, lc) = (a.length(), b.length(), c.length());
    2.0 * a.dot(b.cross(c)).abs().atan2(la * lb * lc + a.dot(b) * lc + a.dot(c) * lb + b.dot(c) * la)
}

/// Half sides of a rectangle.
fn sides(light: &PunctualLight) -> [DVec3; 2] {
    let (axis, direction) = (vector(light.axis), vector(light.direction));
    [axis * f64::from(light.inner), axis.cross(direction) * f64::from(light.outer)]
}

/// Solid angles of a rectangle's cells, row by row.
fn cells(light: &PunctualLight, eye: DVec3) -> Vec<f64> {
    let ([x, y], center) = (sides(light), vector(light.position) - eye);
    let corner = |i: usize, j: usize| {
        let part = |k: usize| 2.0 * k as f64 / SIDE as f64 - 1.0;
        center + x * part(i) + y * part(j)
    };
    let cell = |i, j| {
        let [a, b, c, d] = [corner(i, j), corner(i + 1, j), corner(i + 1, j + 1), corner(i, j + 1)];
        solid_angle([a, b, c]) + solid_angle([a, c, d])
    };
    (0..SIDE * SIDE).map(|k| cell(k % SIDE, k / SIDE)).collect()
}

/// Place in a cone on the unit square, to which what is uniform in solid angle is mapped uniformly.
fn in_cone(direction: DVec3, axis: DVec3, versine: f64) -> [f64; 2] {
    let (x, y) = axis.any_orthonormal_pair();
    let depth = 0.5 * (direction - axis).length_squared() / versine;
    [depth.clamp(0.0, 1.0), 0.5 + direction.dot(y).atan2(direction.dot(x)) / TAU]
}

/// P-value of draws, and the density of each. Rectangles below the solid angle `wide` are sampled by area.
fn judge(light: &PunctualLight, eye: DVec3, draws: &[Draw], wide: f64) -> (f64, Vec<f64>) {
    let uniform = |places: Vec<[f64; 2]>| test_uniform(&places, SIDE);
    let cone = |axis: DVec3, versine: f64| {
        let places = draws.iter().map(|(direction, ..)| in_cone(*direction, axis, versine)).collect();
        (uniform(places), vec![(TAU * versine).recip(); draws.len()])
    };
    let (center, normal, inner) = (vector(light.position) - eye, vector(light.direction), f64::from(light.inner));
    let by_area = |area: f64| -> Vec<f64> {
        let density = |(direction, distance, _): &Draw| distance * distance / (area * -direction.dot(normal));
        draws.iter().map(density).collect()
    };
    match light.kind() {
        kind if kind == PunctualKind::Sun as u32 => cone(-normal, inner),
        kind if kind == PunctualKind::Sphere as u32 => {
            cone(center.normalize(), 1.0 - (1.0 - inner * inner / center.length_squared()).sqrt())
        }
        kind if kind == PunctualKind::Disk as u32 => {
            let (x, y) = normal.any_orthonormal_pair();
            let place = |(direction, distance, _): &Draw| {
                let aside = *direction * *distance - center;
                [aside.length_squared() / (inner * inner), 0.5 + aside.dot(y).atan2(aside.dot(x)) / TAU]
            };
            (uniform(draws.iter().map(place).collect()), by_area(PI * inner * inner))
        }
        _ => {
            let [x, y] = sides(light);
            let mut observed = vec![0.0; SIDE * SIDE];
            for (direction, distance, _) in draws {
                let aside = *direction * *distance - center;
                let cell = |side: DVec3| {
                    let part = 0.5 + 0.5 * aside.dot(side) / side.length_squared();
                    ((part * SIDE as f64) as usize).min(SIDE - 1)
                };
                observed[cell(y) * SIDE + cell(x)] += 1.0;
            }
            let cells = cells(light, eye);
            let total: f64 = cells.iter().sum();
            if total < wide {
                let even = draws.len() as f64 / cells.len() as f64;
                return (chi_square(&observed, &vec![even; cells.len()]), by_area(4.0 * x.length() * y.length()));
            }
            let expected: Vec<f64> = cells.iter().map(|cell| cell / total * draws.len() as f64).collect();
            (chi_square(&observed, &expected), vec![total.recip(); draws.len()])
        }
    }
}

fn all(lights: &dyn Lights, work: &Work, engine: &'static str) -> Verdict {
    let mut verdict = Verdict::new("lights with an extent", engine);
    let eye = DVec3::ZERO;
    for (index, light) in work.lighting.lights.iter().enumerate() {
        let draws = lights.sample(eye, index, &Random(index as u64 + 70).points(DRAWS));
        // At the very edge a ray may miss what a sample has found, for their rounding differs.
        let found: Vec<Draw> = draws.iter().copied().filter(|(_, distance, _)| *distance > 0.0).collect();
        let lost = 1.0 - found.len() as f64 / DRAWS as f64;
        verdict.deviation(format!("light {index}, draws that miss it"), [lost], 1e-3);
        let (p, densities) = judge(light, eye, &found, lights.wide());
        verdict.probability(format!("light {index}"), p);
        let off = found.iter().zip(&densities).map(|((.., pdf), density)| (pdf / density - 1.0).abs());
        verdict.deviation(format!("light {index}, density"), off, lights.rounding());
        let directions: Vec<_> = found.iter().map(|(direction, ..)| *direction).collect();
        let met = lights.meet(eye, index, &directions);
        let off = found.iter().zip(met).map(|((_, distance, pdf), (t, met))| {
            let way = if distance.is_finite() { (t / distance - 1.0).abs() } else { 0.0 };
            way.max((met / pdf - 1.0).abs())
        });
        verdict.deviation(format!("light {index}, what a ray meets"), off, lights.rounding());
    }
    verdict
}

const FAULTS: [(&str, Fault, f64); 4] = [
    (
        "cone",
        Fault { right: "let depth = versine * u.x;", wrong: |e| format!("let depth = {} * versine * u.x;", 1.0 - e) },
        0.05,
    ),
    (
        "density of a cone",
        Fault {
            right: "1.0 / (2.0 * PI * versine), versine > 0.0",
            wrong: |e| format!("{} / (2.0 * PI * versine), versine > 0.0", 1.0 + e),
        },
        1e-3,
    ),
    (
        "place across a rectangle",
        Fault {
            right: "let au = u.x * solid_angle + k;",
            wrong: |e| format!("let au = {} * u.x * solid_angle + k;", 1.0 - e),
        },
        0.05,
    ),
    (
        "place along a rectangle",
        Fault {
            right: "let d = sqrt(x * x + z * z);",
            wrong: |e| format!("let d = {} * sqrt(x * x + z * z);", 1.0 + e),
        },
        0.1,
    ),
];

#[test]
fn of_the_shader() {
    let work = lit();
    all(&Shader::new(&work, None), &work, "shader").assert();
}

#[test]
fn of_the_f64_engine() {
    let work = lit();
    all(&F64(work.lighting.lights.iter().map(Shape::new).collect()), &work, "f64").assert();
}

#[test]
fn faults_are_found() {
    let work = lit();
    for (name, fault, size) in FAULTS {
        let verdict = all(&Shader::new(&work, Some((fault, size))), &work, "shader");
        assert!(!verdict.failures().is_empty(), "{name}: a fault of {size} was not found");
    }
}
