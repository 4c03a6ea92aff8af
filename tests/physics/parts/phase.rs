//! Henyey and Greenstein's phase function: directions follow it, and densities are its values.

use super::bins::test_uniform;
use super::kernel::{Fault, Kernel, nothing, words};
use super::random::Random;
use super::verdict::{Verdict, smallest_found};
use candela::render::cpu::layers::scatter;
use glam::DVec3;
use std::f64::consts::{PI, TAU};

/// Draws of each case.
const DRAWS: usize = 1 << 18;
/// Mean cosines.
const ANISOTROPIES: [f64; 5] = [-0.9, -0.3, 0.0, 0.5, 0.98];
/// Direction of flight.
const FLIGHT: DVec3 = DVec3::new(0.36, -0.48, 0.8);

/// Directions and their densities from points of the unit square.
type Phase<'a> = &'a dyn Fn(f64, &[[f64; 3]]) -> Vec<(DVec3, f64)>;

fn shader(fault: Option<(Fault, f64)>) -> impl Fn(f64, &[[f64; 3]]) -> Vec<(DVec3, f64)> {
    let kernel = Kernel::new(&nothing(), "phase_sample", fault);
    move |g, u| {
        let points: Vec<_> = u.iter().map(|u| words([u[0], u[1], g, 0.0])).collect();
        let flights = vec![words([FLIGHT.x, FLIGHT.y, FLIGHT.z, 0.0]); u.len()];
        kernel.run(&[&points, &flights]).into_iter().map(|[x, y, z, density]| (DVec3::new(x, y, z), density)).collect()
    }
}

fn f64_engine(g: f64, u: &[[f64; 3]]) -> Vec<(DVec3, f64)> {
    let draw = |u: &[f64; 3]| {
        let direction = scatter::sample_phase(g, FLIGHT, [u[0], u[1]]);
        (direction, scatter::phase(g, direction.dot(FLIGHT)))
    };
    u.iter().map(draw).collect()
}

/// Distribution function of the cosine, by the antiderivative.
fn distribution(g: f64, cosine: f64) -> f64 {
    if g == 0.0 {
        return 0.5 * (1.0 + cosine);
    }
    (1.0 - g * g) / (2.0 * g) * (1.0 / (1.0 + g * g - 2.0 * g * cosine).sqrt() - 1.0 / (1.0 + g))
}

fn judge(engine: &'static str, phase: Phase<'_>) -> Verdict {
    let mut verdict = Verdict::new("phase function", engine);
    let (x, y) = FLIGHT.any_orthonormal_pair();
    for g in ANISOTROPIES {
        let draws = phase(g, &Random(g.to_bits()).points(DRAWS));
        let cell = |w: &DVec3| [distribution(g, w.dot(FLIGHT)), w.dot(y).atan2(w.dot(x)).rem_euclid(TAU) / TAU];
        let points: Vec<_> = draws.iter().map(|(w, _)| cell(w).map(|c| c.clamp(0.0, 1.0 - 1e-9))).collect();
        verdict.probability(format!("g {g}"), test_uniform(&points, 32));
        let off = draws.iter().map(|(w, density)| {
            let value = (1.0 - g * g) / (4.0 * PI * (1.0 + g * g - 2.0 * g * w.dot(FLIGHT)).powf(1.5));
            (density / value - 1.0).abs()
        });
        // The cosine of a narrow peak is off by 1e-7, of a square of (1 - g)^2.
        verdict.deviation(format!("g {g}, density"), off, 1e-5 + 1e-6 / (1.0 - g.abs()).powi(2));
    }
    verdict
}

#[test]
fn shader_scatters_by_its_phase_function() {
    judge("shader", &shader(None)).assert();
}

#[test]
fn f64_engine_scatters_by_its_phase_function() {
    judge("f64", &f64_engine).assert();
}

const FAULTS: [(&str, Fault); 2] = [
    (
        "mean cosine",
        Fault {
            right: "let d = (1.0 - g * g) / (1.0 - g + 2.0 * g * u.x);",
            wrong: |e| format!("let d = (1.0 - g * g) / (1.0 - g + {} * g * u.x);", 2.0 * (1.0 - e)),
        },
    ),
    (
        "value",
        Fault {
            right: "return (1.0 - g * g) / (4.0 * PI * d * sqrt(d));",
            wrong: |e| format!("return {} * (1.0 - g * g) / (4.0 * PI * d * sqrt(d));", 1.0 + e),
        },
    ),
];

#[test]
fn faults_are_found() {
    for (name, fault) in FAULTS {
        assert!(!judge("shader", &shader(Some((fault, 0.05)))).failures().is_empty(), "{name}");
    }
}

#[test]
#[ignore = "prints how small a fault is found"]
fn smallest_faults() {
    for (name, fault) in FAULTS {
        let found = |size| !judge("shader", &shader(Some((fault, size)))).failures().is_empty();
        eprintln!("| phase function | {name} | {:?} |", smallest_found(found));
    }
}
