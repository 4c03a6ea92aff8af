//! The whole material: the mix of lobes as it is sampled, its density, its value, reciprocity and the white furnace.

use super::bins::test_density;
use super::bsdf_formulas::{
    HEMISPHERE, Material, albedo, coordinates, direction, lambert_below, tabulated_albedo, tabulated_mean, viewer,
};
use super::kernel::{Fault, Kernel, nothing, words};
use super::lobes::{DEGREES, ROUGHNESS};
use super::quadrature::{LEAST, integrate};
use super::random::{Random, lattice};
use super::verdict::{Verdict, smallest_found};
use candela::render::cpu::material as f64_material;
use glam::DVec3;

/// Draws of each chi-square test.
const DRAWS: usize = 1 << 18;
/// Points of each furnace, and of those of smooth surfaces seen at grazing angles, where the lobe of energy compensation is
/// rarely sampled and then weighs much.
const FURNACE: [usize; 2] = [1 << 16, 1 << 20];
/// Directions of each comparison of values.
const PAIRS: usize = 1 << 14;
/// Base colour of all cases but the furnaces, which are white.
const COLOR: f64 = 0.7;
/// Perceptual roughness of the furnaces; the first is a mirror.
const FURNACE_ROUGHNESS: [f64; 9] = [0.0, 0.05, 0.1, 0.2, 0.3, 0.45, 0.6, 0.8, 1.0];
const METALLIC: [f64; 3] = [0.0, 0.5, 1.0];

/// An implementation, asked from one viewer at a time.
trait Bsdf {
    /// For the verdict.
    fn engine(&self) -> &'static str;
    /// Direction and density for (u, choice); none: the sample is not valid.
    fn sample(&self, material: &Material, wo: DVec3, u: &[[f64; 3]]) -> Vec<Option<(DVec3, f64)>>;
    /// Weight of the same samples, 0 if not valid.
    fn weights(&self, material: &Material, wo: DVec3, u: &[[f64; 3]]) -> Vec<f64>;
    /// f cos and density for pairs of directions.
    fn values(&self, material: &Material, pairs: &[[DVec3; 2]]) -> Vec<[f64; 2]>;
}

/// Kernels with energy compensation and without.
struct Shader {
    sample: [Kernel; 2],
    weight: [Kernel; 2],
    value: [Kernel; 2],
}

impl Shader {
    fn new(fault: Option<(Fault, f64)>) -> Self {
        let pair = |entry: &str| {
            [false, true].map(|multiple_scattering| {
                let mut work = nothing();
                work.settings.multiple_scattering = multiple_scattering;
                work.features.specular = true;
                work.features.mirror = true;
                Kernel::new(&work, entry, fault)
            })
        };
        Self { sample: pair("bsdf_sample"), weight: pair("bsdf_weight"), value: pair("bsdf_value") }
    }

    fn from_one_viewer(kernels: &[Kernel; 2], m: &Material, wo: DVec3, u: &[[f64; 3]]) -> Vec<[f64; 4]> {
        let viewers = vec![words([wo.x, wo.y, wo.z, m.metallic]); u.len()];
        let surfaces = vec![words([m.color, m.color, m.color, m.roughness]); u.len()];
        let choices: Vec<_> = u.iter().map(|u| words([u[0], u[1], u[2], 0.0])).collect();
        kernels[usize::from(m.multiple_scattering)].run(&[&viewers, &surfaces, &choices])
    }
}

impl Bsdf for Shader {
    fn engine(&self) -> &'static str {
        "shader"
    }

    fn sample(&self, m: &Material, wo: DVec3, u: &[[f64; 3]]) -> Vec<Option<(DVec3, f64)>> {
        let results = Self::from_one_viewer(&self.sample, m, wo, u);
        results.into_iter().map(|[x, y, z, pdf]| (pdf > 0.0).then_some((DVec3::new(x, y, z), pdf))).collect()
    }

    fn weights(&self, m: &Material, wo: DVec3, u: &[[f64; 3]]) -> Vec<f64> {
        Self::from_one_viewer(&self.weight, m, wo, u).into_iter().map(|[weight, ..]| weight).collect()
    }

    fn values(&self, m: &Material, pairs: &[[DVec3; 2]]) -> Vec<[f64; 2]> {
        let viewers: Vec<_> = pairs.iter().map(|[wo, _]| words([wo.x, wo.y, wo.z, m.metallic])).collect();
        let surfaces = vec![words([m.color, m.color, m.color, m.roughness]); pairs.len()];
        let lights: Vec<_> = pairs.iter().map(|[_, wi]| words([wi.x, wi.y, wi.z, 0.0])).collect();
        let results = self.value[usize::from(m.multiple_scattering)].run(&[&viewers, &surfaces, &lights]);
        results.into_iter().map(|[value, _, _, pdf]| [value, pdf]).collect()
    }
}

struct F64;

impl F64 {
    fn bsdf(m: &Material, wo: DVec3) -> f64_material::Bsdf {
        let layers =
            f64_material::Layers { color: DVec3::splat(m.color), metallic: m.metallic, roughness: m.roughness };
        let model = f64_material::Model { specular: true, multiple_scattering: m.multiple_scattering };
        f64_material::Bsdf::new(layers, model, wo)
    }
}

impl Bsdf for F64 {
    fn engine(&self) -> &'static str {
        "f64"
    }

    fn sample(&self, m: &Material, wo: DVec3, u: &[[f64; 3]]) -> Vec<Option<(DVec3, f64)>> {
        let bsdf = Self::bsdf(m, wo);
        u.iter().map(|u| bsdf.sample(u[2], [u[0], u[1]]).and_then(|s| Some((s.wi, s.pdf?)))).collect()
    }

    fn weights(&self, m: &Material, wo: DVec3, u: &[[f64; 3]]) -> Vec<f64> {
        let bsdf = Self::bsdf(m, wo);
        u.iter().map(|u| bsdf.sample(u[2], [u[0], u[1]]).map_or(0.0, |s| s.weight.x)).collect()
    }

    fn values(&self, m: &Material, pairs: &[[DVec3; 2]]) -> Vec<[f64; 2]> {
        let value = |[wo, wi]: &[DVec3; 2]| {
            let (value, pdf) = Self::bsdf(m, *wo).evaluate(*wi);
            [value.x, pdf]
        };
        pairs.iter().map(value).collect()
    }
}

fn judge(bsdf: &dyn Bsdf, roughnesses: &[f64], degrees: &[f64]) -> Verdict {
    let mut verdict = Verdict::new("whole BSDF", bsdf.engine());
    for metallic in METALLIC {
        for &roughness in roughnesses {
            for multiple_scattering in [true, false] {
                let material = Material { color: COLOR, metallic, roughness, multiple_scattering };
                values(bsdf, &material, &mut verdict);
                reciprocity(bsdf, &material, &mut verdict);
            }
            for &angle in degrees {
                let material = Material { color: COLOR, metallic, roughness, multiple_scattering: true };
                samples(bsdf, &material, angle, &mut verdict);
            }
        }
    }
    verdict
}

fn name(m: &Material) -> String {
    let compensated = if m.multiple_scattering { "" } else { ", single scattering" };
    format!("roughness {}, metallic {}{compensated}", m.roughness, m.metallic)
}

/// Chi-square of the samples; their densities, one by one and their integral.
fn samples(bsdf: &dyn Bsdf, m: &Material, angle: f64, verdict: &mut Verdict) {
    let case = format!("{}, {angle} degrees", name(m));
    let wo = viewer(angle);
    let of_direction = m.density(wo);
    let density = |depth: f64, azimuth: f64| of_direction(direction(depth, azimuth));
    let seed = angle.to_bits() ^ m.roughness.to_bits().rotate_left(7) ^ m.metallic.to_bits().rotate_left(23);
    let draws = bsdf.sample(m, wo, &Random(seed).points(DRAWS));
    let points: Vec<_> = draws.iter().map(|draw| draw.and_then(|(w, _)| coordinates(w))).collect();
    let p = test_density(&points, HEMISPHERE, |leaf| integrate(&density, *leaf, 1e-4, LEAST));
    verdict.probability(case.clone(), p);
    let off = draws.iter().flatten().map(|(w, got)| difference(*got, of_direction(w.normalize())));
    verdict.deviation(format!("{case}, density"), off, tolerance(m.roughness));
}

/// Relative, but for values so small that no light depends on them: what f32 keeps of them is what it keeps of 1.
fn difference(got: f64, expected: f64) -> f64 {
    (got - expected).abs() / (expected + 0.01)
}

/// A direction in f32 is off by 1e-7, and a lobe of width alpha changes by 4 / alpha of that.
fn tolerance(roughness: f64) -> f64 {
    3e-5 + 2e-6 / (roughness * roughness)
}

/// Energy compensation divides by one minus the mean albedo, which is an f32 next to 1 where the surface is smooth.
fn cancellation(roughness: f64) -> f64 {
    1.2e-7 / (1.0 - tabulated_mean(roughness)[0])
}

/// Values and densities against the formulas, for random pairs of directions.
fn values(bsdf: &dyn Bsdf, m: &Material, verdict: &mut Verdict) {
    let pairs = pairs(3);
    let (mut value, mut density) = (Vec::new(), Vec::new());
    for ([wo, wi], got) in pairs.iter().zip(bsdf.values(m, &pairs)) {
        value.push(difference(got[0], m.value(*wo, *wi)));
        density.push(difference(got[1], m.density(*wo)(*wi)));
    }
    verdict.deviation(format!("{}, value", name(m)), value, tolerance(m.roughness) + cancellation(m.roughness));
    verdict.deviation(format!("{}, density", name(m)), density, tolerance(m.roughness));
}

/// f(wo, wi) = f(wi, wo).
fn reciprocity(bsdf: &dyn Bsdf, m: &Material, verdict: &mut Verdict) {
    let pairs = pairs(4);
    let swapped: Vec<_> = pairs.iter().map(|[wo, wi]| [*wi, *wo]).collect();
    let there = bsdf.values(m, &pairs);
    let back = bsdf.values(m, &swapped);
    let off = pairs
        .iter()
        .zip(there.iter().zip(&back))
        .map(|([wo, wi], (there, back))| difference(there[0] / wi.z, back[0] / wo.z));
    verdict.deviation(format!("{}, reciprocity", name(m)), off, 1e-4);
}

/// Half of them anywhere, half of them near each other's mirror direction. Rounded as the shader gets them.
fn pairs(seed: u64) -> Vec<[DVec3; 2]> {
    let mut random = Random(seed);
    let round = |w: DVec3| w.as_vec3().as_dvec3();
    let uniform = |random: &mut Random| direction(0.995 * random.unit(), std::f64::consts::TAU * random.unit());
    (0..PAIRS)
        .map(|i| {
            let wo = uniform(&mut random);
            let mut wi = uniform(&mut random);
            if i % 2 == 0 {
                let near = DVec3::new(-wo.x, -wo.y, wo.z) + wi * 0.1 * random.unit();
                wi = near.normalize();
            }
            [round(wo), round(wi)]
        })
        .collect()
}

/// White furnace: weights of samples average to 1. Without energy compensation: to the albedo by quadrature.
fn furnace(bsdf: &dyn Bsdf, roughnesses: &[f64]) -> Verdict {
    const DEGREES: [f64; 8] = [0.0, 15.0, 30.0, 45.0, 60.0, 75.0, 85.0, 89.0];
    let mut verdict = Verdict::new("white furnace", bsdf.engine());
    let points = FURNACE.map(lattice);
    for &roughness in roughnesses {
        for angle in DEGREES {
            let wo = viewer(angle);
            let facets = if roughness == 0.0 { [1.0, (1.0 - wo.z).powi(5)] } else { albedo(roughness, wo.z) };
            let base = lambert_below(wo.z);
            let u = &points[usize::from(angle > 80.0 && roughness > 0.0 && roughness < 0.2)];
            for metallic in METALLIC {
                for multiple_scattering in [true, false] {
                    let m = Material { color: 1.0, metallic, roughness, multiple_scattering };
                    let mean = bsdf.weights(&m, wo, u).iter().sum::<f64>() / u.len() as f64;
                    let expected = if multiple_scattering { 1.0 } else { m.single_scattering_albedo(facets, base) };
                    let off = (mean / expected - 1.0).abs();
                    let case = format!("{}, {angle} degrees: {mean:.5} for {expected:.5}", name(&m));
                    // Between the entries of the albedo table; docs/accuracy.md lists these.
                    let allowed = if angle > 88.0 && roughness < 0.2 { 2e-3 } else { 1e-3 };
                    verdict.deviation(case, [off], allowed);
                }
            }
        }
    }
    verdict
}

/// What is broken to see whether the tests find it.
const FAULTS: [(&str, Fault, f64); 5] = [
    (
        "probability of the microfacet lobe in the density",
        Fault {
            right: "pdf += bsdf.specular_probability * specular_pdf(",
            wrong: |e| format!("pdf += {} * bsdf.specular_probability * specular_pdf(", 1.0 + e),
        },
        0.01,
    ),
    (
        "choice of the lobe",
        Fault {
            right: "choice < bsdf.specular_probability",
            wrong: |e| format!("choice < {} * bsdf.specular_probability", 1.0 - e),
        },
        0.02,
    ),
    (
        "value of the microfacet lobe",
        Fault {
            right: "value += schlick(bsdf.f0, bsdf.f90, cos_h)",
            wrong: |e| format!("value += {} * schlick(bsdf.f0, bsdf.f90, cos_h)", 1.0 - e),
        },
        0.01,
    ),
    (
        "width of sampled normals",
        Fault {
            right: "return normalize(vec3f(alpha * h.xy, max(h.z, 0.0)));",
            wrong: |e| format!("return normalize(vec3f(alpha * {} * h.xy, max(h.z, 0.0)));", 1.0 + e),
        },
        0.02,
    ),
    (
        "masking of one side (not reciprocal)",
        Fault {
            right: "return 0.5 / (cos_i * sqrt(a2 + (1.0 - a2) * cos_o * cos_o)",
            wrong: |e| format!("return 0.5 / ({} * cos_i * sqrt(a2 + (1.0 - a2) * cos_o * cos_o)", 1.0 + e),
        },
        0.01,
    ),
];

#[test]
fn of_the_shader() {
    judge(&Shader::new(None), &ROUGHNESS, &DEGREES).assert();
}

#[test]
fn white_furnaces_of_the_shader() {
    furnace(&Shader::new(None), &FURNACE_ROUGHNESS).assert();
}

#[test]
fn of_the_f64_engine() {
    judge(&F64, &ROUGHNESS, &DEGREES).assert();
}

#[test]
fn white_furnaces_of_the_f64_engine() {
    furnace(&F64, &FURNACE_ROUGHNESS).assert();
}

/// The renderer's table of albedos between its entries, against quadrature.
#[test]
fn albedo_table() {
    let mut verdict = Verdict::new("albedo table", "both");
    for roughness in [0.04, 0.055, 0.1, 0.21, 0.37, 0.5, 0.71, 0.93, 1.0] {
        for angle in [0.0f64, 14.0, 33.0, 48.0, 61.0, 74.0, 83.0, 88.0, 89.5] {
            let cosine = angle.to_radians().cos();
            let (exact, table) = (albedo(roughness, cosine), tabulated_albedo(roughness, cosine));
            for (what, k) in [("E", 0), ("B", 1)] {
                let off = (exact[k] - table[k]).abs();
                let allowed = if angle < 85.0 { 5e-4 } else { 5e-3 };
                verdict.deviation(format!("{what}, roughness {roughness}, {angle} degrees"), [off], allowed);
            }
        }
    }
    verdict.assert();
}

fn all(bsdf: &dyn Bsdf) -> Vec<String> {
    let mut failures = judge(bsdf, &[0.3], &[60.0]).failures();
    failures.extend(furnace(bsdf, &[0.3]).failures());
    failures
}

#[test]
fn faults_are_found() {
    for (name, fault, size) in FAULTS {
        assert!(!all(&Shader::new(Some((fault, size)))).is_empty(), "{name}: a fault of {size} was not found");
    }
}

#[test]
#[ignore = "prints the power of the tests"]
fn power() {
    for (name, fault, _) in FAULTS {
        let found = |size| !all(&Shader::new(Some((fault, size)))).is_empty();
        eprintln!("| whole BSDF | {name} | {:?} |", smallest_found(found));
        let by_samples = |size| {
            let mut verdict = Verdict::new("whole BSDF", "shader");
            let material = Material { color: COLOR, metallic: 0.5, roughness: 0.3, multiple_scattering: true };
            samples(&Shader::new(Some((fault, size))), &material, 60.0, &mut verdict);
            verdict.failures().iter().any(|failure| failure.contains("p ="))
        };
        eprintln!("| whole BSDF, chi-square alone | {name} | {:?} |", smallest_found(by_samples));
    }
}
