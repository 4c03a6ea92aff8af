//! Two scenes of Lambert surfaces against Blender Cycles and Mitsuba 3, whose converged pictures of them agree.
//!
//! `bigmesh_diffuse` is made by the peers' own script (`make_cases.py bigmesh`); CANDELA_PEERS names a folder that has it.

use crate::support::{params, render, work};
use candela::params::EngineChoice;
use candela::render::Work;
use candela::scene::{self, Limits, Package};
use std::path::{Path, PathBuf};

on_both_engines! {
    cornell_box,
    a_mesh_of_a_million_triangles,
}

/// Side of the pictures, and of the blocks that are compared.
const SIDE: usize = 256;
const BLOCK: usize = 16;
/// Most deviations that one of the blocks may be off: Sidak's for all of them at 0.01.
const MOST: f64 = 4.12;
/// Root mean square of them: 1 for pictures that differ by noise alone.
const RMS: f64 = 1.2;

fn cornell_box(engine: EngineChoice) {
    let camera = r#""camera":{"position":[0,1,4.2],"target":[0,1,0],"yfov_degrees":36},"max_bounces":6"#;
    compare(engine, "cornell", camera);
}

fn a_mesh_of_a_million_triangles(engine: EngineChoice) {
    let camera = r#""camera":{"position":[0,1.2,3.9],"target":[0,0,0],"yfov_degrees":40},"max_bounces":5,
                    "environment":{"constant":[1,1,1]}"#;
    compare(engine, "bigmesh_diffuse", camera);
}

fn compare(engine: EngineChoice, case: &str, extra: &str) {
    let usual = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/peers");
    let peers = std::env::var_os("CANDELA_PEERS").map_or(usual, PathBuf::from);
    let glb = peers.join(format!("glb/{case}.glb"));
    if !glb.exists() {
        eprintln!("SKIPPED: {} is not here", glb.display());
        return;
    }
    let halves = [1, 2].map(|seed| luminances(&render(engine, half(&glb, extra, seed)).pixels));
    for peer in ["cycles", "mitsuba-llvm"] {
        let folder = peers.join("references");
        let theirs = ["", ".b"].map(|half| reference(&folder.join(format!("{case}.{peer}{half}.exr"))));
        let [worst, rms] = deviations(&halves, &theirs, 1.0);
        let weaker = deviations(&halves, &theirs, 0.99);
        eprintln!(
            "{case}, {engine:?} against {peer}: {} blocks off by {rms:.2} deviations, at most {worst:.2}; \
             1 % darker by {:.2} and {:.2}",
            (SIDE / BLOCK).pow(2),
            weaker[1],
            weaker[0]
        );
        assert!(rms < RMS && worst < MOST, "{case} differs from {peer}");
        assert!(weaker[1] > RMS, "the comparison cannot tell 1 %");
    }
}

/// Half of our samples.
fn half(glb: &Path, extra: &str, seed: u32) -> Work {
    let package = Package::from_path(glb, &Limits::default()).expect("the case's scene");
    let scene = scene::import(&package, &Limits::default()).expect("a scene");
    let size = format!(r#""width":{SIDE},"height":{SIDE},"max_samples":32,"adaptive":false"#);
    work(&scene, &params(&format!(r#"{{{size},"seed":{seed},{extra}}}"#)))
}

/// Largest deviation of a block's mean, in standard deviations of the noise of both pictures, and the root mean square of all. The noise is that
/// between halves of each, pixel by pixel. Ours is taken times `factor`.
fn deviations(ours: &[Vec<f64>; 2], theirs: &[Vec<f64>; 2], factor: f64) -> [f64; 2] {
    let mut blocks = vec![(0.0, 0.0); (SIDE / BLOCK).pow(2)];
    for index in 0..SIDE * SIDE {
        let block = &mut blocks[index / SIDE / BLOCK * (SIDE / BLOCK) + index % SIDE / BLOCK];
        let [a, b, c, d] = [ours[0][index] * factor, ours[1][index] * factor, theirs[0][index], theirs[1][index]];
        block.0 += 0.5 * (a + b) - 0.5 * (c + d);
        block.1 += 0.25 * (a - b).powi(2) + 0.25 * (c - d).powi(2);
    }
    // Blocks that show the background alone have no noise.
    let noisy = blocks.iter().filter(|(_, variance)| *variance > 1e-6);
    let squares: Vec<f64> = noisy.map(|(difference, variance)| difference * difference / variance).collect();
    let mean = squares.iter().sum::<f64>() / squares.len() as f64;
    [squares.into_iter().fold(0.0, f64::max).sqrt(), mean.sqrt()]
}

fn reference(path: &Path) -> Vec<f64> {
    let picture = image::open(path).expect("a reference").into_rgb32f();
    picture.pixels().map(|pixel| luminance(pixel.0)).collect()
}

fn luminances(pixels: &[[f32; 4]]) -> Vec<f64> {
    pixels.iter().map(|&[r, g, b, _]| luminance([r, g, b])).collect()
}

fn luminance([r, g, b]: [f32; 3]) -> f64 {
    0.2126 * f64::from(r) + 0.7152 * f64::from(g) + 0.0722 * f64::from(b)
}
