//! The lens, and the pixel filters against their shapes.

use super::bins::test_uniform;
use super::kernel::{Fault, Kernel, nothing, words};
use super::random::Random;
use super::statistics::chi_square;
use super::verdict::{Verdict, smallest_found};
use candela::compile::Lens;
use candela::params::FilterKind;
use candela::render::cpu::camera::Camera as F64Camera;
use candela::render::cpu::motion::Moment;
use candela::render::cpu::sampler::{Dimension, Sampler};
use candela::render::cpu::sampling::concentric_disk;
use std::f64::consts::{PI, TAU};

/// Draws of each test.
const DRAWS: usize = 1 << 19;
/// Equally probable parts of a filter.
const PARTS: usize = 256;

/// Probability of an offset below this one.
type Distribution = fn(f64) -> f64;

/// The filters with the distribution functions of their shapes over [-1, 1] (docs/api.md names them).
const FILTERS: [(FilterKind, Distribution); 4] = [
    (FilterKind::Box, |x| 0.5 + 0.5 * x),
    (FilterKind::Triangle, |x| 0.5 + x - 0.5 * x * x.abs()),
    (FilterKind::Gaussian, |x| 0.5 + 0.5 * gaussian_half(x.abs()).copysign(x) / gaussian_half(1.0)),
    (FilterKind::BlackmanHarris, blackman_harris),
];

/// Integral from 0 of a Gaussian with a standard deviation of a third, less its value at 1.
fn gaussian_half(x: f64) -> f64 {
    let deviation = 1.0 / 3.0;
    (PI / 2.0).sqrt() * deviation * libm::erf(x / deviation / 2f64.sqrt()) - (-4.5f64).exp() * x
}

/// Four-term window of Harris 1978, integrated.
fn blackman_harris(x: f64) -> f64 {
    let t = 0.5 * (x + 1.0);
    let harmonic = |k: f64, weight: f64| weight * (TAU * k * t).sin() / (TAU * k);
    (0.35875 * t - harmonic(1.0, 0.48829) + harmonic(2.0, 0.14128) - harmonic(3.0, 0.01168)) / 0.35875
}

/// An implementation.
trait Camera {
    /// For the verdict.
    fn engine(&self) -> &'static str;
    /// Points of the unit disk.
    fn disk(&self, u: &[[f64; 3]]) -> Vec<[f64; 2]>;
    /// Independent random numbers, and the offsets that they give in units of the radius.
    fn filter(&self, kind: FilterKind) -> Vec<[f64; 2]>;
}

struct Shader {
    disk: Kernel,
    filters: Vec<(FilterKind, Kernel)>,
}

impl Shader {
    fn new(fault: Option<(Fault, f64)>) -> Self {
        let filter = |(kind, _): (FilterKind, _)| {
            let mut work = nothing();
            work.view.filter.kind = kind;
            (kind, Kernel::new(&work, "pixel_filter", fault))
        };
        Self { disk: Kernel::new(&nothing(), "disk", fault), filters: FILTERS.map(filter).into() }
    }
}

impl Camera for Shader {
    fn engine(&self) -> &'static str {
        "shader"
    }

    fn disk(&self, u: &[[f64; 3]]) -> Vec<[f64; 2]> {
        let points: Vec<_> = u.iter().map(|u| words([u[0], u[1], 0.0, 0.0])).collect();
        self.disk.run(&[&points]).into_iter().map(|[x, y, ..]| [x, y]).collect()
    }

    fn filter(&self, kind: FilterKind) -> Vec<[f64; 2]> {
        let mut random = Random(kind as u64 + 40);
        let u: Vec<f64> = (0..DRAWS).map(|_| random.unit()).collect();
        let points: Vec<_> = u.iter().map(|u| words([*u, *u, 0.0, 0.0])).collect();
        let kernel = self.filters.iter().find(|(k, _)| *k == kind).map(|(_, kernel)| kernel);
        let offsets = kernel.expect("every kind has one").run(&[&points]);
        u.into_iter().zip(offsets).map(|(u, [x, ..])| [u, x]).collect()
    }
}

struct F64;

impl Camera for F64 {
    fn engine(&self) -> &'static str {
        "f64"
    }

    fn disk(&self, u: &[[f64; 3]]) -> Vec<[f64; 2]> {
        u.iter().map(|u| concentric_disk([u[0], u[1]]).to_array()).collect()
    }

    /// By parallel rays, whose origins show it; one sample each of many pixels' sequences.
    fn filter(&self, kind: FilterKind) -> Vec<[f64; 2]> {
        let mut view = nothing().view;
        (view.width, view.height) = (1, 1);
        view.to_world = glam::Affine3A::IDENTITY;
        view.lens = Lens::Orthographic { ymag: 1.0 };
        view.filter.kind = kind;
        view.filter.radius = Some(1.0);
        let camera = F64Camera::new(&view);
        let draw = |pixel| {
            let sampler = Sampler::new(pixel, 0, 0, kind as u32, true);
            [sampler.pair(Dimension::Filter)[0], 0.5 * camera.ray(0, 0, Moment::OPEN, &sampler).origin.x]
        };
        (0..DRAWS as u32).map(draw).collect()
    }
}

/// Squared radius and azimuth are uniform.
fn lens(camera: &dyn Camera) -> Verdict {
    let mut verdict = Verdict::new("lens", camera.engine());
    let points: Vec<_> = camera.disk(&Random(2).points(DRAWS));
    let unit = |[x, y]: &[f64; 2]| [x * x + y * y, y.atan2(*x).rem_euclid(TAU) / TAU];
    let mapped: Vec<_> = points.iter().map(unit).collect();
    verdict.probability("disk".into(), test_uniform(&mapped, 32));
    let outside = mapped.iter().map(|[squared, _]| squared - 1.0);
    verdict.deviation("disk, beyond its edge".into(), outside, 1e-6);
    verdict
}

/// The shape's distribution function makes offsets uniform.
fn filters(camera: &dyn Camera) -> Verdict {
    let mut verdict = Verdict::new("pixel filters", camera.engine());
    for (kind, distribution) in FILTERS {
        let mut observed = vec![0.0; PARTS];
        let mut off = Vec::new();
        for [u, x] in camera.filter(kind) {
            observed[((distribution(x) * PARTS as f64) as usize).min(PARTS - 1)] += 1.0;
            off.push((distribution(x) - u).abs());
        }
        let expected = vec![DRAWS as f64 / PARTS as f64; PARTS];
        verdict.probability(format!("{kind:?}"), chi_square(&observed, &expected));
        verdict.deviation(format!("{kind:?}, distribution function"), off, 1e-3);
    }
    verdict
}

/// What is broken to see whether the tests find it.
const LENS_FAULTS: [(&str, Fault, f64); 1] = [(
    "angle in one half of the disk",
    Fault {
        right: "let theta = (PI / 4.0) * (p.y / p.x);",
        wrong: |e| format!("let theta = {} * (PI / 4.0) * (p.y / p.x);", 1.0 - e),
    },
    0.02,
)];
const FILTER_FAULTS: [(&str, Fault, f64); 1] = [(
    "width of the filter",
    Fault {
        right: "return mix(low, high, x - f32(i));",
        wrong: |e| format!("return {} * mix(low, high, x - f32(i));", 1.0 - e),
    },
    0.02,
)];

#[test]
fn lens_of_the_shader() {
    lens(&Shader::new(None)).assert();
}

#[test]
fn filters_of_the_shader() {
    filters(&Shader::new(None)).assert();
}

#[test]
fn of_the_f64_engine() {
    lens(&F64).assert();
    filters(&F64).assert();
}

#[test]
fn faults_are_found() {
    for (name, fault, size) in LENS_FAULTS {
        assert!(!lens(&Shader::new(Some((fault, size)))).failures().is_empty(), "{name}: not found");
    }
    for (name, fault, size) in FILTER_FAULTS {
        assert!(!filters(&Shader::new(Some((fault, size)))).failures().is_empty(), "{name}: not found");
    }
}

#[test]
#[ignore = "prints the power of the tests"]
fn power() {
    for (name, fault, _) in LENS_FAULTS {
        let found = |size| !lens(&Shader::new(Some((fault, size)))).failures().is_empty();
        eprintln!("| lens | {name} | {:?} |", smallest_found(found));
    }
    for (name, fault, _) in FILTER_FAULTS {
        let found = |size| !filters(&Shader::new(Some((fault, size)))).failures().is_empty();
        eprintln!("| pixel filters | {name} | {:?} |", smallest_found(found));
    }
}
