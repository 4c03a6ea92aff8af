//! Paths per second on meshes of growing size, beside a native tracer in the same run.

use super::yardstick::{Pinhole, Yardstick};
use crate::compile::{self, CompiledScene};
use crate::render::cpu::CpuEngine;
use crate::render::gpu::GpuEngine;
use crate::render::prepare::{prepare, render_to_end};
use crate::render::{Engine, Work};
use crate::scene::{self, Limits, Package, Scene};
use anyhow::{Context, Result};
use glam::Vec3;
use std::io::Write;
use std::sync::Arc;
use std::time::Instant;

const SIDE: u32 = 512;
const ALBEDO: f32 = 0.8;
const SEGMENTS: u32 = 5;
const CAMERA: Pinhole = Pinhole { eye: Vec3::new(0.0, 1.2, 3.9), yfov_degrees: 40.0 };

/// Runs `rounds` interleaved rounds on each demo mesh and writes the table to `out`.
///
/// # Errors
/// No such demo, no adapter, or a device fault.
pub fn run(engine: &mut GpuEngine, demos: &[&str], rounds: u32, out: &mut dyn Write) -> Result<()> {
    let columns = ["triangles", "tree ms", "Mtri/s", "bytes/tri", "cpu tree ms", "cpu bytes/tri", "cpu node, leaf"];
    let rates = ["compute Mpaths/s", "cpu Mpaths/s", "obvhs Mpaths/s", "compute/obvhs", "cpu/obvhs", "means"];
    writeln!(out, "| {} | {} |", columns.join(" | "), rates.join(" | "))?;
    writeln!(out, "{}|", "|---".repeat(columns.len() + rates.len()))?;
    for demo in demos {
        run_mesh(engine, &mesh(demo)?, rounds, out)?;
    }
    Ok(())
}

fn run_mesh(engine: &mut GpuEngine, scene: &Scene, rounds: u32, out: &mut dyn Write) -> Result<()> {
    let compiled = Arc::new(compile::compile_scene(scene, None)?);
    let primitive = &scene.meshes[0].primitives[0];
    let yardstick = Yardstick::new(&primitive.positions, &primitive.triangles);
    let begun = Instant::now();
    let mut processor = CpuEngine::new();
    let tree = processor.tree(&compiled);
    let cpu_build = begun.elapsed();
    // Compute, CPU, obvhs: paths per second and mean of the picture.
    let (mut rates, mut means) = ([0.0f64; 3], [0.0; 3]);
    for round in 0..=rounds {
        let measured = [
            time_engine(engine, diffuse_work(scene, &compiled, round)?)?,
            time_engine(&mut processor, diffuse_work(scene, &compiled, round)?)?,
            time(|| yardstick.render(CAMERA, SIDE, ALBEDO, SEGMENTS, round)),
        ];
        // The first round warms up.
        for (tracer, (rate, mean)) in measured.into_iter().enumerate().filter(|_| round > 0) {
            rates[tracer] = rates[tracer].max(rate);
            means[tracer] += mean / f64::from(rounds);
        }
    }
    let triangles = compiled.triangles.len() as f64;
    let stats = tree.stats();
    let trees = format!(
        "{triangles} | {:.0} | {:.2} | {:.0} | {:.0} | {:.0} | {:.1}, {:.1}",
        compiled.stats.bvh_seconds * 1e3,
        triangles / compiled.stats.bvh_seconds / 1e6,
        bytes(&compiled) / triangles,
        cpu_build.as_secs_f64() * 1e3,
        stats.bytes as f64 / triangles,
        stats.children_per_node,
        stats.triangles_per_block,
    );
    let [compute, cpu, obvhs] = rates.map(|rate| rate / 1e6);
    let ratios = format!("{:.2} | {:.2}", compute / obvhs, cpu / obvhs);
    let [a, b, c] = means;
    writeln!(out, "| {trees} | {compute:.2} | {cpu:.2} | {obvhs:.2} | {ratios} | {a:.4} {b:.4} {c:.4} |")?;
    Ok(())
}

/// (paths per second, mean of the picture) of one sample a pixel on the processor.
fn time(render: impl FnOnce() -> f64) -> (f64, f64) {
    let begun = Instant::now();
    let mean = render();
    (f64::from(SIDE * SIDE) / begun.elapsed().as_secs_f64(), mean)
}

/// (paths per second, mean of the picture)
fn time_engine(engine: &mut dyn Engine, work: Work) -> Result<(f64, f64)> {
    let samples = work.settings.max_samples;
    let rendered = render_to_end(engine, work, &mut |_| {})?;
    let picture = rendered.film.picture();
    let mean = picture.pixels.iter().map(|p| f64::from(p[1])).sum::<f64>() / picture.pixels.len() as f64;
    Ok((f64::from(SIDE * SIDE * samples) / rendered.trace.as_secs_f64(), mean))
}

/// The task: diffuse only, without the dielectric's reflection, which the yardstick has not.
fn diffuse_work(scene: &Scene, compiled: &Arc<CompiledScene>, seed: u32) -> Result<Work> {
    let Pinhole { eye, yfov_degrees } = CAMERA;
    let params = serde_json::from_value(serde_json::json!({
        "width": SIDE, "height": SIDE, "max_samples": 4, "seed": seed, "filter": {"kind": "box"},
        "max_bounces": SEGMENTS - 1, "environment": {"constant": [1, 1, 1]},
        "camera": {"position": eye, "target": [0, 0, 0], "yfov_degrees": yfov_degrees},
    }))?;
    let mut work = prepare(scene, Arc::clone(compiled), &params, None)?.work;
    work.features.specular = false;
    Ok(work)
}

fn bytes(compiled: &CompiledScene) -> f64 {
    (size_of_val(&compiled.nodes[..])
        + size_of_val(&compiled.triangles[..])
        + size_of_val(&compiled.indices[..])
        + size_of_val(&compiled.vertices[..])) as f64
}

/// The mesh of a demo, white-grey and flat shaded: what the yardstick can draw.
fn mesh(demo: &str) -> Result<Scene> {
    let bytes = crate::demo::by_name(demo).with_context(|| format!("no demo {demo}"))?;
    let package = Package::from_bytes(bytes, &Limits::default())?;
    let mut scene = scene::import(&package, &Limits::default())?;
    for primitive in Arc::make_mut(&mut scene.meshes).iter_mut().flat_map(|mesh| &mut mesh.primitives) {
        primitive.normals = None;
    }
    Ok(scene)
}
