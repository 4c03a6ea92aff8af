//! Paths per second on meshes of growing size, beside a native tracer in the same run.

use super::yardstick::{Pinhole, Yardstick};
use crate::compile::{self, CompiledScene};
use crate::params::RenderParams;
use crate::render::gpu::GpuEngine;
use crate::render::{Engine, RenderError, Settings, Work};
use crate::scene::{Material, Mesh, Node, Primitive, Scene, SceneRoot};
use anyhow::Result;
use glam::{Vec3, Vec4};
use std::io::Write;
use std::sync::Arc;
use std::time::Instant;

const SIDE: u32 = 512;
const ALBEDO: f32 = 0.8;
const SEGMENTS: u32 = 5;
const CAMERA: Pinhole = Pinhole { eye: Vec3::new(0.0, 1.2, 3.9), tan_half_yfov: 0.363_970_23 };

/// Runs `rounds` interleaved rounds on each mesh and writes the table to `out`.
///
/// # Errors
/// No adapter, or a device fault.
pub fn run(engine: &mut GpuEngine, sizes: &[u32], rounds: u32, out: &mut dyn Write) -> Result<()> {
    writeln!(out, "| triangles | tree ms | Mtri/s | bytes/tri | compute Mpaths/s | native Mpaths/s | ratio | means |")?;
    writeln!(out, "|---|---|---|---|---|---|---|---|")?;
    for &size in sizes {
        let mesh = bumpy_sphere(size);
        let yardstick = Yardstick::new(&mesh.positions, &mesh.triangles);
        let scene = single_mesh(mesh);
        let begun = Instant::now();
        let compiled = Arc::new(compile::compile_scene(&scene, None)?);
        let compile_seconds = begun.elapsed().as_secs_f64();
        let (mut compute, mut native) = (0.0f64, 0.0f64);
        let (mut mean, mut native_mean) = (0.0, 0.0);
        for round in 0..=rounds {
            let (rate, value) = time_compute(engine, &scene, &compiled, round)?;
            let begun = Instant::now();
            let native_value = yardstick.render(CAMERA, SIDE, ALBEDO, SEGMENTS, round);
            let native_rate = f64::from(SIDE * SIDE) / begun.elapsed().as_secs_f64();
            // The first round warms up.
            if round > 0 {
                compute = compute.max(rate);
                native = native.max(native_rate);
                mean += value / f64::from(rounds);
                native_mean += native_value / f64::from(rounds);
            }
        }
        let triangles = compiled.triangles.len() as f64;
        writeln!(
            out,
            "| {} | {:.0} | {:.2} | {:.0} | {:.2} | {:.2} | {:.2} | {mean:.4} {native_mean:.4} |",
            compiled.triangles.len(),
            compile_seconds * 1e3,
            triangles / compiled.stats.bvh_seconds / 1e6,
            bytes(&compiled) / triangles,
            compute / 1e6,
            native / 1e6,
            compute / native,
        )?;
    }
    Ok(())
}

fn time_compute(engine: &mut GpuEngine, scene: &Scene, compiled: &Arc<CompiledScene>, seed: u32) -> Result<(f64, f64), RenderError> {
    let work = diffuse_work(scene, compiled, seed);
    let samples = work.settings.max_samples;
    let mut render = engine.begin(work, None)?;
    let begun = Instant::now();
    while render.step()?.is_none() {}
    let rate = f64::from(SIDE * SIDE * samples) / begun.elapsed().as_secs_f64();
    let picture = render.film().picture();
    let mean = picture.pixels.iter().map(|p| f64::from(p[1])).sum::<f64>() / picture.pixels.len() as f64;
    Ok((rate, mean))
}

/// The task: diffuse only, without the dielectric's reflection, which the yardstick has not.
fn diffuse_work(scene: &Scene, compiled: &Arc<CompiledScene>, seed: u32) -> Work {
    let text = format!(
        r#"{{"width":{SIDE},"height":{SIDE},"max_bounces":{SEGMENTS},"filter":{{"kind":"box"}},"max_samples":4,"seed":{seed},
            "environment":{{"constant":[1,1,1]}},"camera":{{"position":[0,1.2,3.9],"target":[0,0,0],"yfov_degrees":40}}}}"#
    );
    let params: RenderParams = serde_json::from_str(&text).unwrap_or_default();
    let (lighting, _) = compile::light(scene, compiled, &params, None).unwrap_or_default();
    let (view, _) = compile::view(scene, compiled, &params).expect("a camera in place");
    let mut features = compile::features(compiled, &lighting, &view, &params);
    features.specular = false;
    let settings = Settings {
        mode: params.mode,
        max_bounces: Some(SEGMENTS - 1),
        multiple_scattering: true,
        seed,
        max_samples: params.max_samples,
        target_error: None,
        deadline: None,
    };
    Work { scene: Arc::clone(compiled), lighting: Arc::new(lighting), view, features, settings }
}

fn bytes(compiled: &CompiledScene) -> f64 {
    (size_of_val(&compiled.nodes[..])
        + size_of_val(&compiled.triangles[..])
        + size_of_val(&compiled.indices[..])
        + size_of_val(&compiled.vertices[..])) as f64
}

fn single_mesh(primitive: Primitive) -> Scene {
    let material = Material { base_color: Vec4::new(ALBEDO, ALBEDO, ALBEDO, 1.0), metallic: 0.0, ..Material::default() };
    Scene {
        meshes: vec![Mesh { name: None, primitives: vec![Primitive { material: Some(0), ..primitive }] }],
        materials: vec![material],
        nodes: vec![Node { mesh: Some(0), ..Node::default() }],
        scenes: vec![SceneRoot { name: None, nodes: vec![0] }],
        ..Scene::default()
    }
}

/// A sphere with waves on it, of about `triangles` triangles, flat shaded.
fn bumpy_sphere(triangles: u32) -> Primitive {
    let rings = (f64::from(triangles) / 4.0).sqrt().round() as u32;
    let spokes = 2 * rings;
    let mut primitive = Primitive::default();
    for ring in 0..=rings {
        let theta = std::f32::consts::PI * ring as f32 / rings as f32;
        for spoke in 0..=spokes {
            let phi = std::f32::consts::TAU * (spoke % spokes) as f32 / spokes as f32;
            let radius = 1.0 + 0.08 * (9.0 * phi).sin() * (11.0 * theta).sin() + 0.02 * (41.0 * phi).sin() * (37.0 * theta).cos();
            let direction = Vec3::new(theta.sin() * phi.cos(), theta.cos(), -theta.sin() * phi.sin());
            primitive.positions.push(radius * direction);
        }
    }
    for ring in 0..rings {
        for spoke in 0..spokes {
            let a = ring * (spokes + 1) + spoke;
            let b = a + spokes + 1;
            primitive.triangles.push([a, b, b + 1]);
            primitive.triangles.push([a, b + 1, a + 1]);
        }
    }
    primitive
}
