//! The lens, and the pixel filters against their shapes.

use super::bins::test_uniform;
use super::kernel::{Fault, Kernel, nothing, words};
use super::random::Random;
use super::statistics::chi_square;
use super::verdict::{Verdict, smallest_found};
use candela::params::FilterKind;
use std::f64::consts::{PI, TAU};

/// Draws of each test.
const DRAWS: usize = 1 << 19;
/// Equally probable parts of a filter.
const PARTS: usize = 256;

/// The filters with the distribution functions of their shapes over [-1, 1] (docs/api.md names them).
const FILTERS: [(FilterKind, fn(f64) -> f64); 4] = [
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
    /// Points of the unit disk.
    fn disk(&self, u: &[[f64; 3]]) -> Vec<[f64; 2]>;
    /// Offsets in units of the radius.
    fn filter(&self, kind: FilterKind, u: &[f64]) -> Vec<f64>;
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
    fn disk(&self, u: &[[f64; 3]]) -> Vec<[f64; 2]> {
        let points: Vec<_> = u.iter().map(|u| words([u[0], u[1], 0.0, 0.0])).collect();
        self.disk.run(&[&points]).into_iter().map(|[x, y, ..]| [x, y]).collect()
    }

    fn filter(&self, kind: FilterKind, u: &[f64]) -> Vec<f64> {
        let points: Vec<_> = u.iter().map(|u| words([*u, *u, 0.0, 0.0])).collect();
        let kernel = self.filters.iter().find(|(k, _)| *k == kind).map(|(_, kernel)| kernel);
        kernel.expect("every kind has one").run(&[&points]).into_iter().map(|[x, ..]| x).collect()
    }
}

/// Squared radius and azimuth are uniform.
fn lens(camera: &dyn Camera) -> Verdict {
    let mut verdict = Verdict::new("lens");
    let points: Vec<_> = camera.disk(&Random(2).points(DRAWS));
    let unit = |[x, y]: &[f64; 2]| [x * x + y * y, y.atan2(*x).rem_euclid(TAU) / TAU];
    let mapped: Vec<_> = points.iter().map(unit).collect();
    verdict.probability("disk".into(), test_uniform(&mapped, 32));
    let outside = mapped.iter().map(|[squared, _]| squared - 1.0).fold(0.0, f64::max);
    verdict.deviation("disk, beyond its edge".into(), outside, 1e-6);
    verdict
}

/// The shape's distribution function makes offsets uniform.
fn filters(camera: &dyn Camera) -> Verdict {
    let mut verdict = Verdict::new("pixel filters");
    for (kind, distribution) in FILTERS {
        let mut random = Random(kind as u64 + 40);
        let u: Vec<f64> = (0..DRAWS).map(|_| random.unit()).collect();
        let mut observed = vec![0.0; PARTS];
        for x in camera.filter(kind, &u) {
            observed[((distribution(x) * PARTS as f64) as usize).min(PARTS - 1)] += 1.0;
        }
        let expected = vec![DRAWS as f64 / PARTS as f64; PARTS];
        verdict.probability(format!("{kind:?}"), chi_square(&observed, &expected));
        let steps: Vec<f64> = (0..1 << 16).map(|i| f64::from(i) / f64::from(1 << 16)).collect();
        let distances = camera.filter(kind, &steps);
        let off = distances.iter().zip(&steps).map(|(x, u)| (distribution(*x) - u).abs()).fold(0.0, f64::max);
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
