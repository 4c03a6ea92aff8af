//! The lobes by themselves: cosine-weighted directions and reflections by visible normals.

use super::bins::{test_density, test_uniform};
use super::bsdf_formulas::{HEMISPHERE, coordinates, direction, reflected_density, viewer};
use super::kernel::{Fault, Kernel, nothing, words};
use super::quadrature::{LEAST, Rectangle, integrate};
use super::random::Random;
use super::verdict::{Verdict, smallest_found};
use candela::render::cpu::material::{Bsdf, Layers, Model};
use candela::render::cpu::sampling::cosine_hemisphere;
use glam::DVec3;
use std::f64::consts::{PI, TAU};

/// Draws of each case.
const DRAWS: usize = 1 << 18;
/// Perceptual roughness.
pub const ROUGHNESS: [f64; 5] = [0.05, 0.1, 0.3, 0.6, 1.0];
/// Of the viewer, from the normal.
pub const DEGREES: [f64; 5] = [0.0, 30.0, 60.0, 80.0, 89.0];

/// An implementation: directions and their densities from points of the unit square; none below the horizon.
trait Lobes {
    /// For the verdict.
    fn engine(&self) -> &'static str;
    fn cosine(&self, u: &[[f64; 3]]) -> Vec<(DVec3, f64)>;
    fn visible_normal(&self, roughness: f64, wo: DVec3, u: &[[f64; 3]]) -> Vec<Option<(DVec3, f64)>>;
}

struct Shader {
    cosine: Kernel,
    visible_normal: Kernel,
}

impl Shader {
    fn new(fault: Option<(Fault, f64)>) -> Self {
        let kernel = |entry| Kernel::new(&nothing(), entry, fault);
        Self { cosine: kernel("cosine"), visible_normal: kernel("visible_normal") }
    }
}

impl Lobes for Shader {
    fn engine(&self) -> &'static str {
        "shader"
    }

    fn cosine(&self, u: &[[f64; 3]]) -> Vec<(DVec3, f64)> {
        let points: Vec<_> = u.iter().map(|u| words([u[0], u[1], 0.0, 0.0])).collect();
        self.cosine.run(&[&points]).into_iter().map(pair).collect()
    }

    fn visible_normal(&self, roughness: f64, wo: DVec3, u: &[[f64; 3]]) -> Vec<Option<(DVec3, f64)>> {
        let points: Vec<_> = u.iter().map(|u| words([u[0], u[1], roughness, 0.0])).collect();
        let viewers = vec![words([wo.x, wo.y, wo.z, 0.0]); u.len()];
        self.visible_normal.run(&[&points, &viewers]).into_iter().map(|r| (r[2] > 0.0).then(|| pair(r))).collect()
    }
}

struct F64;

impl Lobes for F64 {
    fn engine(&self) -> &'static str {
        "f64"
    }

    fn cosine(&self, u: &[[f64; 3]]) -> Vec<(DVec3, f64)> {
        u.iter().map(|u| cosine_hemisphere([u[0], u[1]])).map(|w| (w, w.z / PI)).collect()
    }

    /// A white metal without energy compensation has this lobe alone.
    fn visible_normal(&self, roughness: f64, wo: DVec3, u: &[[f64; 3]]) -> Vec<Option<(DVec3, f64)>> {
        let layers = Layers { color: DVec3::ONE, metallic: 1.0, roughness };
        let bsdf = Bsdf::new(layers, Model { specular: true, multiple_scattering: false }, wo);
        let sample = |u: &[f64; 3]| bsdf.sample(0.0, [u[0], u[1]]).and_then(|s| Some((s.wi, s.pdf?)));
        u.iter().map(sample).collect()
    }
}

fn pair([x, y, z, density]: [f64; 4]) -> (DVec3, f64) {
    (DVec3::new(x, y, z), density)
}

fn judge(lobes: &dyn Lobes, roughnesses: &[f64], degrees: &[f64]) -> Verdict {
    let mut verdict = Verdict::new("lobes", lobes.engine());
    cosine(lobes, &mut verdict);
    for &roughness in roughnesses {
        for &angle in degrees {
            visible_normal(lobes, roughness, angle, &mut verdict);
        }
    }
    verdict
}

/// Cosine-weighted directions have squared cosine and azimuth uniform.
fn cosine(lobes: &dyn Lobes, verdict: &mut Verdict) {
    let draws = lobes.cosine(&Random(1).points(DRAWS));
    let unit = |w: &DVec3| [1.0 - w.x * w.x - w.y * w.y, w.y.atan2(w.x).rem_euclid(TAU) / TAU];
    let points: Vec<_> = draws.iter().map(|(w, _)| unit(w)).collect();
    verdict.probability("cosine".into(), test_uniform(&points, 32));
    let off = draws.iter().map(|(w, density)| (density * PI - w.z).abs().max((w.length() - 1.0).abs()));
    verdict.deviation("cosine, density".into(), off, 1e-6);
}

fn visible_normal(lobes: &dyn Lobes, roughness: f64, angle: f64, verdict: &mut Verdict) {
    let case = format!("visible normals, roughness {roughness}, {angle} degrees");
    let wo = viewer(angle);
    let reflected = reflected_density(roughness, wo);
    let density = |depth: f64, azimuth: f64| reflected(direction(depth, azimuth));
    let draws = lobes.visible_normal(roughness, wo, &Random(angle.to_bits() ^ roughness.to_bits()).points(DRAWS));
    let points: Vec<_> = draws.iter().map(|draw| draw.and_then(|(w, _)| coordinates(w))).collect();
    let p = test_density(&points, HEMISPHERE, |leaf| integrate(&density, *leaf, 1e-4, LEAST));
    verdict.probability(case.clone(), p);
    let off = draws.iter().flatten().map(|(w, got)| (got / reflected(w.normalize()) - 1.0).abs());
    // A direction in f32 is off by 1e-7; the density of a lobe of width alpha changes by 4 / alpha of that.
    verdict.deviation(format!("{case}, density"), off, 1e-5 + 2e-6 / (roughness * roughness));
}

/// The formula that the densities are compared with integrates to 1 over the sphere: what is missing above the horizon
/// is reflected below it.
#[test]
fn formula_integrates_to_one() {
    let mut verdict = Verdict::new("density of visible normals", "formula");
    for roughness in ROUGHNESS {
        for angle in DEGREES {
            let wo = viewer(angle);
            let reflected = reflected_density(roughness, wo);
            let density = |depth: f64, azimuth: f64| reflected(direction(depth, azimuth));
            // At the reflection of the viewer in the horizon the density drops to 0.
            let below = Rectangle { low: [1.0, 0.0], high: [1.0 + wo.z, TAU] };
            let halves = [HEMISPHERE, below];
            let [above, below] =
                halves.map(|half| pieces(half).map(|r| integrate(&density, r, 1e-5, LEAST)).sum::<f64>());
            let case = format!("roughness {roughness}, {angle} degrees ({below:.5} below the horizon)");
            verdict.deviation(case, [(above + below - 1.0).abs()], 1e-5);
        }
    }
    verdict.assert();
}

/// A grid fine enough that no lobe falls between its nodes.
fn pieces(of: Rectangle) -> impl Iterator<Item = Rectangle> {
    const SIDE: u32 = 16;
    let at = move |k: usize, i: u32| of.low[k] + (of.high[k] - of.low[k]) * (f64::from(i) / f64::from(SIDE)).powi(2);
    // Finer towards the axis, where lobes are narrowest; the azimuth evenly.
    let turn = move |j: u32| of.low[1] + (of.high[1] - of.low[1]) * f64::from(j) / f64::from(SIDE);
    (0..SIDE * SIDE).map(move |k| {
        let (i, j) = (k % SIDE, k / SIDE);
        Rectangle { low: [at(0, i), turn(j)], high: [at(0, i + 1), turn(j + 1)] }
    })
}

/// What is broken to see whether the tests find it.
const FAULTS: [(&str, Fault, f64); 4] = [
    (
        "width of sampled normals",
        Fault {
            right: "return normalize(vec3f(alpha * h.xy, max(h.z, 0.0)));",
            wrong: |e| format!("return normalize(vec3f(alpha * {} * h.xy, max(h.z, 0.0)));", 1.0 + e),
        },
        0.05,
    ),
    (
        "density of visible normals",
        Fault {
            right: "return distribution(alpha, h) * 0.5 /",
            wrong: |e| format!("return distribution(alpha, h) * {} /", 0.5 * (1.0 + e)),
        },
        0.01,
    ),
    (
        "tilt of cosine-weighted directions (radians)",
        Fault {
            right: "return vec3f(d, sqrt(max(1.0 - dot(d, d), 0.0)));",
            wrong: |e| format!("return normalize(vec3f(d.x + {e}, d.y, sqrt(max(1.0 - dot(d, d), 0.0))));"),
        },
        0.02,
    ),
    (
        "azimuth of visible normals",
        Fault { right: "let phi = 2.0 * PI * u.x;", wrong: |e| format!("let phi = {} * PI * u.x;", 2.0 * (1.0 - e)) },
        0.01,
    ),
];

#[test]
fn of_the_shader() {
    judge(&Shader::new(None), &ROUGHNESS, &DEGREES).assert();
}

#[test]
fn of_the_f64_engine() {
    judge(&F64, &ROUGHNESS, &DEGREES).assert();
}

#[test]
fn faults_are_found() {
    for (name, fault, size) in FAULTS {
        let failures = judge(&Shader::new(Some((fault, size))), &[0.3], &[60.0]).failures();
        assert!(!failures.is_empty(), "{name}: a fault of {size} was not found");
    }
}

#[test]
#[ignore = "prints the power of the tests"]
fn power() {
    for (name, fault, _) in FAULTS {
        let found = |size| !judge(&Shader::new(Some((fault, size))), &[0.3], &[60.0]).failures().is_empty();
        eprintln!("| lobes | {name} | {:?} |", smallest_found(found));
    }
}
