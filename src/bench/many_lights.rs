//! Many emitting triangles: time to the same error with the tree of emitters and with the table of their power, by their number.

use crate::compile::{self, LightTree, MapFiles};
use crate::params::{EngineChoice, EnvironmentChoice, RenderParams};
use crate::render::prepare::{prepare, render_to_end};
use crate::render::{Engine, Engines, Work};
use crate::scene::{Material, Mesh, Node, Primitive, Scene, SceneRoot};
use anyhow::{Context, Result};
use glam::{Quat, Vec3, Vec4};
use std::io::Write;
use std::sync::Arc;
use std::time::Instant;

/// Error that times are scaled to: halving it takes four times as long.
const ERROR: f64 = 0.05;
/// Half a side of the floor.
const HALF: f32 = 5.0;
/// Area of all lamps together.
const AREA: f32 = 1.0;
/// Kinds of lamps, each twice as bright as the last.
const KINDS: usize = 8;

/// What to measure.
#[derive(Debug, Clone, Copy)]
pub struct Size {
    /// Pixels a side.
    pub side: u32,
    /// Samples per pixel.
    pub samples: u32,
    /// Rounds, tree and table in turns.
    pub rounds: u32,
}

/// Measures scenes of so many lamps and writes the table.
///
/// # Errors
/// A fault of the device.
pub fn run(choice: EngineChoice, counts: &[usize], size: Size, out: &mut dyn Write) -> Result<()> {
    let mut engine = Engines::new();
    writeln!(out, "{} x {0} pixels, {} samples, best of {} rounds in turns.\n", size.side, size.samples, size.rounds)?;
    writeln!(
        out,
        "| emitting triangles | building the tree, s | a sample with the tree, of one without | error, tree | error, table | s to 5 %, \
         tree | s to 5 %, table | table / tree |"
    )?;
    writeln!(out, "|---|---|---|---|---|---|---|---|")?;
    for &count in counts {
        let (works, build) = works(choice, count, size)?;
        let mut ways = [Measured::NONE; 2];
        for round in 1..=size.rounds {
            for (way, work) in ways.iter_mut().zip(&works) {
                way.render(&mut engine, work, round)?;
            }
        }
        let [tree, table] = ways;
        writeln!(
            out,
            "| {count} | {build:.3} | {:.2} | {:.4} | {:.4} | {:.2} | {:.2} | {:.2} |",
            tree.seconds / table.seconds,
            tree.error(size),
            table.error(size),
            tree.to_error(size),
            table.to_error(size),
            table.to_error(size) / tree.to_error(size),
        )?;
        out.flush()?;
    }
    Ok(())
}

/// What came of some rounds.
#[derive(Clone, Copy)]
struct Measured {
    /// The shortest.
    seconds: f64,
    /// Sum of squared errors.
    squares: f64,
}

impl Measured {
    const NONE: Self = Self { seconds: f64::INFINITY, squares: 0.0 };

    fn render(&mut self, engine: &mut dyn Engine, work: &Work, seed: u32) -> Result<()> {
        let mut work = work.clone();
        work.settings.seed = seed;
        let rendered = render_to_end(engine, work, &mut |_| {})?;
        self.seconds = self.seconds.min(rendered.trace.as_secs_f64());
        let error = rendered.film.error().context("too few samples to measure an error")?.relative_rms;
        self.squares += error * error;
        Ok(())
    }

    fn error(&self, size: Size) -> f64 {
        (self.squares / f64::from(size.rounds)).sqrt()
    }

    fn to_error(self, size: Size) -> f64 {
        self.seconds * (self.error(size) / ERROR).powi(2)
    }
}

/// The same picture with the tree and with the table, and the seconds that building the tree takes.
fn works(choice: EngineChoice, count: usize, size: Size) -> Result<([Work; 2], f64)> {
    let scene = lamps(count);
    let params = RenderParams {
        width: size.side,
        height: size.side,
        max_samples: size.samples,
        adaptive: false,
        engine: choice,
        environment: EnvironmentChoice::None,
        camera: serde_json::from_value(
            // The floor alone, from below the lamps: how soon these are found by sight has nothing to do with how they are drawn.
            serde_json::json!({"position": [0, 0.25, 0], "target": [0, 0, 0.25], "yfov_degrees": 45}),
        )?,
        ..RenderParams::default()
    };
    let compile = || compile::compile_request(&scene, &params, &MapFiles::new());
    let (mut compiled, mut without) = (compile()?, compile()?);
    without.light_tree = LightTree::default();
    let begun = Instant::now();
    compiled.light_tree = LightTree::of(&compiled);
    let build = begun.elapsed().as_secs_f64();
    let work = |compiled| prepare(&scene, Arc::new(compiled), &params, None).map(|prepared| prepared.work);
    Ok(([work(compiled)?, work(without)?], build))
}

/// Triangles that look everywhere over a floor, of the same area together however many they are.
fn lamps(count: usize) -> Scene {
    let across = (count as f32).sqrt().ceil();
    let size = (2.0 * AREA / count as f32).sqrt();
    let mut kinds: [Primitive; KINDS] =
        std::array::from_fn(|kind| Primitive { material: Some(kind), ..Primitive::default() });
    for index in 0..count {
        let [jitter, height, turn, tilt] = [0, 1, 2, 3].map(|salt| random(index, salt));
        let cell = Vec3::new(index as f32 % across + jitter, 0.0, (index as f32 / across).floor() + random(index, 4));
        let place = ((cell / across - 0.5) * 2.0 * HALF).with_y(0.3 + 1.5 * height);
        let turn =
            Quat::from_rotation_y(turn * std::f32::consts::TAU) * Quat::from_rotation_x(tilt * std::f32::consts::PI);
        let lamp = &mut kinds[(random(index, 5) * KINDS as f32) as usize % KINDS];
        let first = lamp.positions.len() as u32;
        lamp.positions.extend([Vec3::ZERO, Vec3::X * size, Vec3::Z * size].map(|corner| place + turn * corner));
        lamp.triangles.push([first, first + 1, first + 2]);
    }
    let floor = Primitive {
        positions: [(-1.0, 1.0), (1.0, 1.0), (1.0, -1.0), (-1.0, -1.0)]
            .map(|(x, z)| Vec3::new(x, 0.0, z) * HALF)
            .to_vec(),
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        material: Some(KINDS),
        ..Primitive::default()
    };
    let grey = Material { base_color: Vec4::new(0.5, 0.5, 0.5, 1.0), metallic: 0.0, ..Material::default() };
    let lamp = |kind| Material { emissive: Vec3::splat(2f32.powi(kind as i32)), double_sided: true, ..grey.clone() };
    let mut scene = Scene { materials: (0..KINDS).map(lamp).chain([grey.clone()]).collect(), ..Scene::default() };
    let lit = kinds.into_iter().filter(|lamp| !lamp.triangles.is_empty());
    scene.meshes = Arc::new(vec![Mesh { name: None, primitives: lit.chain([floor]).collect() }]);
    scene.nodes.push(Node { mesh: Some(0), ..Node::default() });
    scene.scenes.push(SceneRoot { nodes: vec![0], ..SceneRoot::default() });
    scene
}

/// In [0, 1): a hash of two numbers (SplitMix64's finaliser).
fn random(index: usize, salt: u64) -> f32 {
    let mut z = (index as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ salt.wrapping_mul(0xd134_2543_de82_ef95);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((z ^ (z >> 31)) >> 40) as f32 / 16_777_216.0
}
