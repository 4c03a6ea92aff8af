//! Whole paths in a closed box of known radiance: Russian roulette, the only end that they have, must not change it.

use super::kernel::{Fault, Kernel, words};
use super::statistics::normal;
use super::verdict::{Verdict, smallest_found};
use crate::support::{grey, lambert, params, scene, square, work};
use candela::render::Work;
use candela::render::cpu::bvh::Bvh;
use candela::render::cpu::integrator::Integrator;
use candela::render::cpu::sampler::Sampler;
use candela::scene::Material;
use glam::{DAffine3, DVec3, Vec3};
use rayon::prelude::*;
use std::f64::consts::PI;
use std::sync::Arc;

/// Paths of each test.
const PATHS: usize = 1 << 18;
/// Reflectance of the walls.
const ALBEDOS: [f64; 4] = [0.2, 0.5, 0.8, 0.95];

/// A box of side 2 whose walls emit 1.
fn closed_box(albedo: f64, request: &str) -> Work {
    let wall = Material { emissive: Vec3::ONE, ..grey(albedo as f32, 1.0, 0.0) };
    let half = PI / 2.0;
    let turns = [
        DAffine3::IDENTITY,
        DAffine3::from_rotation_x(PI),
        DAffine3::from_rotation_x(half),
        DAffine3::from_rotation_x(-half),
        DAffine3::from_rotation_z(half),
        DAffine3::from_rotation_z(-half),
    ];
    let inwards = DAffine3::from_translation(DVec3::new(0.0, -1.0, 0.0));
    lambert(work(&scene(turns.map(|turn| (square(1.0), wall.clone(), turn * inwards)).to_vec()), &params(request)))
}

/// Radiance of many paths from one point of the box into one direction.
fn paths(albedo: f64, fault: Option<(Fault, f64)>) -> Vec<f64> {
    let kernel = Kernel::new(&closed_box(albedo, "{}"), "path", fault);
    // Pixels far apart and one sample of each: independent numbers.
    let ids: Vec<_> = (0..PATHS as u32).map(|i| [i * 17, 0, 1, 5]).collect();
    let origin = vec![words([0.2, 0.1, 0.3, 0.0]); PATHS];
    let direction = DVec3::new(-1.2, 0.1, -0.8).normalize();
    let directions = vec![words([direction.x, direction.y, direction.z, 0.0]); PATHS];
    kernel.run(&[&ids, &origin, &directions]).into_iter().map(|[radiance, ..]| radiance).collect()
}

/// The same by the f64 engine: its camera at that point, with a field of view so small that all rays are one.
fn f64_paths(albedo: f64) -> Vec<f64> {
    const CAMERA: &str = r#"{"width":1,"height":1,
        "camera":{"position":[0.2,0.1,0.3],"target":[-1,0.2,-0.5],"yfov_degrees":0.001}}"#;
    let work = closed_box(albedo, CAMERA);
    let bvh = Arc::new(Bvh::new(&work.scene));
    let integrator = Integrator::new(work, bvh);
    let path = |pixel| integrator.sample(0, 0, &Sampler::new(pixel, 0, 1, 5, true)).0.x;
    (0..PATHS as u32).into_par_iter().map(path).collect()
}

fn judge(engine: &'static str, albedos: &[f64], paths: impl Fn(f64) -> Vec<f64>) -> Verdict {
    let mut verdict = Verdict::new("Russian roulette", engine);
    for &albedo in albedos {
        let expected = 1.0 / (1.0 - f64::from(albedo as f32));
        let radiance = paths(albedo);
        let n = radiance.len() as f64;
        let mean = radiance.iter().sum::<f64>() / n;
        let variance = radiance.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / (n - 1.0);
        let error = (variance / n).sqrt();
        let case = format!("albedo {albedo}: {mean:.4} +- {error:.4} for {expected:.4}");
        verdict.probability(case, normal((mean - expected) / error));
    }
    verdict
}

/// What is broken to see whether the tests find it.
const FAULTS: [(&str, Fault, f64); 2] = [
    (
        "weight of the paths that live",
        Fault { right: "throughput /= survival;", wrong: |e| format!("throughput /= {} * survival;", 1.0 + e) },
        0.05,
    ),
    (
        "probability of living",
        Fault { right: "if choice.y >= survival {", wrong: |e| format!("if choice.y >= {} * survival {{", 1.0 - e) },
        0.05,
    ),
];

#[test]
fn of_the_shader() {
    judge("shader", &ALBEDOS, |albedo| paths(albedo, None)).assert();
}

#[test]
fn of_the_f64_engine() {
    judge("f64", &ALBEDOS, f64_paths).assert();
}

#[test]
fn faults_are_found() {
    for (name, fault, size) in FAULTS {
        let failures = judge("shader", &[0.8], |albedo| paths(albedo, Some((fault, size)))).failures();
        assert!(!failures.is_empty(), "{name}: a fault of {size} was not found");
    }
}

#[test]
#[ignore = "prints the power of the tests"]
fn power() {
    for (name, fault, _) in FAULTS {
        let found = |size| !judge("shader", &[0.8], |albedo| paths(albedo, Some((fault, size)))).failures().is_empty();
        eprintln!("| Russian roulette | {name} | {:?} |", smallest_found(found));
    }
}
