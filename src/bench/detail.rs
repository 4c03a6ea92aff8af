//! Surface detail: time on scenes of growing load by kind of map, and error against the same relief as real geometry.

use super::clock::{Clock, trace};
use super::flip::flip;
use super::pictures::write_sheet;
use super::plot::{self, Line};
use super::preview::similarity::{relative_mse, relative_rmse};
use crate::compile::{MapFiles, compile_request};
use crate::film::Picture;
use crate::params::EngineChoice;
use crate::render::prepare::prepare;
use crate::render::{Engines, Work};
use crate::scene::{Material, Mesh, Node, Primitive, Scene, SceneRoot};
use anyhow::Result;
use glam::{DVec3, Vec2};
use image::{DynamicImage, ImageBuffer, ImageFormat, Luma, Rgb, RgbImage};
use serde_json::{Value, json};
use std::f64::consts::{PI, TAU};
use std::io::{Cursor, Write};
use std::path::Path;
use std::sync::Arc;

/// Numbers of spheres of the seven scenes.
const LOADS: [usize; 7] = [1, 2, 4, 8, 16, 32, 64];
/// Texels of a map, across and down.
const TEXELS: u32 = 512;
/// Depth of the relief in scene units, on a sheet two units wide and a sphere of radius 1.
const DEPTH: f64 = 0.06;
/// Cells of the real relief along each side.
const CELLS: u32 = 1024;
const METHODS: [&str; 4] = ["offset", "offset_limited", "steep", "relief"];

/// Ways of showing a relief, as the request has them; the first shows none.
fn ways() -> Vec<(&'static str, Value)> {
    let mut ways = vec![
        ("none", json!({})),
        ("height", json!({"height": {"image": "heights", "scale": DEPTH}})),
        ("normal", json!({"normal": {"image": "normals"}})),
    ];
    for method in METHODS {
        ways.push((method, json!({"parallax": {"image": "heights", "scale": DEPTH, "method": method}})));
    }
    let shadowed = json!({"image": "heights", "scale": DEPTH, "method": "relief", "self_shadow": true});
    ways.push(("relief, shadowed", json!({ "parallax": shadowed })));
    ways
}

/// Round studs and a wave: 1 is the surface itself.
fn height(u: f64, v: f64) -> f64 {
    let stud = |x: f64, y: f64| {
        let r = ((8.0 * x).fract() - 0.5).hypot((8.0 * y).fract() - 0.5);
        (0.5 + 0.5 * (PI * (r / 0.45).min(1.0)).cos()).powf(0.7)
    };
    0.75 * stud(u, v) + 0.25 * (0.5 + 0.5 * (TAU * 2.0 * u).cos() * (TAU * 2.0 * v).cos())
}

/// The relief as heights and as normals, and checks to see it by. `size`: of the surface in scene units along u and v.
fn maps(size: [f64; 2]) -> Result<MapFiles> {
    let at = |texel: u32| (f64::from(texel) + 0.5) / f64::from(TEXELS);
    let heights = ImageBuffer::from_fn(TEXELS, TEXELS, |x, y| Luma([(height(at(x), at(y)) * 65535.0) as u16]));
    let normals = RgbImage::from_fn(TEXELS, TEXELS, |x, y| {
        let (u, v, step) = (at(x), at(y), 0.5 / f64::from(TEXELS));
        let du = (height(u + step, v) - height(u - step, v)) / (2.0 * step);
        let dv = (height(u, v + step) - height(u, v - step)) / (2.0 * step);
        let normal = DVec3::new(-DEPTH * du / size[0], DEPTH * dv / size[1], 1.0).normalize();
        Rgb((127.5 + 127.5 * normal).round().to_array().map(|byte| byte as u8))
    });
    let checks = RgbImage::from_fn(TEXELS, TEXELS, |x, y| {
        if (x / 32 + y / 32) % 2 == 0 { Rgb([225, 190, 150]) } else { Rgb([150, 95, 70]) }
    });
    let files = [
        ("heights", DynamicImage::ImageLuma16(heights)),
        ("normals", DynamicImage::ImageRgb8(normals)),
        ("checks", DynamicImage::ImageRgb8(checks)),
    ];
    let mut maps = MapFiles::new();
    for (name, picture) in files {
        let mut bytes = Cursor::new(Vec::new());
        picture.write_to(&mut bytes, ImageFormat::Png)?;
        maps.insert(name.to_owned(), Arc::from(bytes.into_inner()));
    }
    Ok(maps)
}

/// A grid over the unit square in (u, v), v down, with the surface's own normals.
fn grid(cells: u32, point: impl Fn(f64, f64) -> DVec3) -> Primitive {
    let mut primitive = Primitive::default();
    let mut uvs = Vec::new();
    let mut normals = Vec::new();
    let step = 1e-4;
    for row in 0..=cells {
        for column in 0..=cells {
            let (u, v) = (f64::from(column) / f64::from(cells), f64::from(row) / f64::from(cells));
            primitive.positions.push(point(u, v).as_vec3());
            let du = point(u + step, v) - point(u - step, v);
            let dv = point(u, v + step) - point(u, v - step);
            // v runs down.
            normals.push(dv.cross(du).normalize_or_zero().as_vec3());
            uvs.push(Vec2::new(u as f32, v as f32));
        }
    }
    for row in 0..cells {
        for column in 0..cells {
            let a = row * (cells + 1) + column;
            let c = a + cells + 1;
            primitive.triangles.extend([[a, c, c + 1], [a, c + 1, a + 1]]);
        }
    }
    primitive.uvs = vec![uvs];
    primitive.normals = Some(normals);
    primitive
}

fn scene_of(primitive: Primitive) -> Scene {
    let material = Material { name: Some("detail".to_owned()), metallic: 0.0, roughness: 0.6, ..Material::default() };
    Scene {
        meshes: Arc::new(vec![Mesh { name: None, primitives: vec![Primitive { material: Some(0), ..primitive }] }]),
        nodes: vec![Node { mesh: Some(0), ..Node::default() }],
        materials: vec![material],
        scenes: vec![SceneRoot { name: None, nodes: vec![0] }],
        ..Scene::default()
    }
}

/// A sheet of two units in y = 0, at depths below it.
fn sheet(cells: u32, depth: impl Fn(f64, f64) -> f64) -> Scene {
    scene_of(grid(cells, |u, v| DVec3::new(2.0 * u - 1.0, -depth(u, v), 2.0 * v - 1.0)))
}

/// A unit sphere as spheres of a request lie in their coordinates, at depths below it.
fn ball(cells: u32, depth: impl Fn(f64, f64) -> f64) -> Scene {
    scene_of(grid(cells, |u, v| {
        let (phi, theta) = (TAU * (u - 0.5), PI * v.clamp(1e-6, 1.0 - 1e-6));
        (1.0 - depth(u, v)) * DVec3::new(theta.sin() * phi.sin(), theta.cos(), theta.sin() * phi.cos())
    }))
}

/// One picture to make.
struct Case<'a> {
    scene: &'a Scene,
    maps: &'a MapFiles,
    params: Value,
}

impl Case<'_> {
    fn work(&self, engine: EngineChoice) -> Result<Work> {
        let params = serde_json::from_value(self.params.clone())?;
        let compiled = Arc::new(compile_request(self.scene, &params, self.maps)?);
        let mut work = prepare(self.scene, compiled, &params, None)?.work;
        work.settings.engine = engine;
        Ok(work)
    }
}

/// Each work's picture and the fastest of `rounds` interleaved renders in seconds; a first one makes pipelines and trees.
fn timed(engines: &mut Engines, clock: Clock, works: &[Work], rounds: u32) -> Result<Vec<(Picture, f64)>> {
    let mut best: Vec<(Picture, f64)> = Vec::new();
    for round in 0..=rounds {
        for (index, work) in works.iter().enumerate() {
            let (picture, seconds) = trace(engines, clock, work)?;
            if round == 0 {
                best.push((picture, f64::INFINITY));
            } else {
                best[index].1 = best[index].1.min(seconds);
            }
        }
    }
    Ok(best)
}

/// How a study is taken.
#[derive(Debug, Clone, Copy)]
pub struct Effort {
    /// Pixels a side.
    pub side: u32,
    /// Interleaved renders of each.
    pub rounds: u32,
    /// What times are of.
    pub clock: Clock,
}

/// Writes tables to `out`, and plots and pictures to `detail-load.svg`, `detail.svg` and `detail.jpg` in `folder`.
///
/// # Errors
/// A device fault, a file that cannot be written.
pub fn run(engines: &mut Engines, effort: Effort, folder: &Path, out: &mut dyn Write) -> Result<()> {
    let mut panels = Vec::new();
    for (engine, name) in [(EngineChoice::Cpu, "cpu"), (EngineChoice::Gpu, "gpu")] {
        writeln!(out, "### Time, engine {name}, ms\n")?;
        panels.push((format!("engine {name}"), loads(engines, engine, effort, out)?));
        writeln!(out)?;
    }
    plot::time_over(&folder.join("detail-load.svg"), "spheres", &panels)?;
    errors(engines, effort, folder, out)
}

/// Spheres in rows that fill the picture, over a floor that mirrors a little, under all kinds of lights that the study's author had.
fn loads(engines: &mut Engines, engine: EngineChoice, effort: Effort, out: &mut dyn Write) -> Result<Vec<Line>> {
    let Effort { side, rounds, clock } = effort;
    let (floor, maps) = (sheet(1, |_, _| 0.0), maps([PI, PI])?);
    let ways = ways();
    let mut lines: Vec<Line> =
        ways.iter().map(|(name, _)| Line { name: (*name).to_owned(), points: Vec::new() }).collect();
    writeln!(out, "| spheres | {} |", ways.iter().map(|(name, _)| *name).collect::<Vec<_>>().join(" | "))?;
    writeln!(out, "|{}", "---|".repeat(ways.len() + 1))?;
    for load in LOADS {
        let across = (load as f64).sqrt().ceil() as usize;
        let works: Vec<Work> = ways
            .iter()
            .map(|(_, way)| {
                let spheres: Vec<Value> = (0..load).map(|index| sphere(index, across, way)).collect();
                let params = json!({
                    "mode": "direct", "direct": {"shading": "phong"}, "max_bounces": 3, "max_samples": 4,
                    "adaptive": false, "width": side, "height": side, "environment": null, "spheres": spheres,
                    "camera": {"position": [0, 1.6, 2.2], "target": [0, 0.1, 0], "yfov_degrees": 45},
                    "lights": [{"type": "ambient", "intensity": 0.2}, {"type": "point", "position": [1, 2, 1], "intensity": 8},
                               {"type": "directional", "direction": [-0.5, -1, -0.4], "intensity": 1}],
                });
                Case { scene: &floor, maps: &maps, params }.work(engine)
            })
            .collect::<Result<_>>()?;
        let seconds = timed(engines, clock, &works, rounds)?;
        let cells: Vec<String> = seconds.iter().map(|(_, seconds)| format!("{:.1}", 1e3 * seconds)).collect();
        writeln!(out, "| {load} | {} |", cells.join(" | "))?;
        for (line, (_, seconds)) in lines.iter_mut().zip(&seconds) {
            line.points.push((load as f64, *seconds));
        }
    }
    Ok(lines)
}

fn sphere(index: usize, across: usize, way: &Value) -> Value {
    let cell = 2.0 / across as f64;
    let place = |i: usize| cell * (i as f64 + 0.5) - 1.0;
    let radius = 0.45 * cell;
    let mut sphere = json!({
        "center": [place(index % across), radius, place(index / across)], "radius": radius,
        "shininess": 30, "reflectivity": 0.2, "texture": {"image": "checks"},
    });
    lay(&mut sphere, way);
    // The relief of a small sphere is as deep in proportion.
    for kind in ["height", "parallax"] {
        if let Some(scale) = sphere.pointer_mut(&format!("/{kind}/scale")) {
            *scale = json!(DEPTH * radius);
        }
    }
    sphere
}

fn lay(target: &mut Value, way: &Value) {
    for (name, value) in way.as_object().into_iter().flatten() {
        target[name] = value.clone();
    }
}

/// A surface seen from somewhere, flat and as real relief.
struct View {
    name: &'static str,
    flat: Scene,
    real: Scene,
    eye: [f64; 3],
    /// Of the surface in scene units along u and v, at its middle.
    size: [f64; 2],
    is_sphere: bool,
}

fn views() -> [View; 3] {
    let depth = |u: f64, v: f64| DEPTH * (1.0 - height(u, v));
    let on_sheet = |name, eye| View {
        name,
        flat: sheet(1, |_, _| 0.0),
        real: sheet(CELLS, depth),
        eye,
        size: [2.0; 2],
        is_sphere: false,
    };
    [
        on_sheet("sheet, head-on", [0.0, 3.0, 0.3]),
        on_sheet("sheet, grazing", [0.0, 0.55, 2.4]),
        View {
            name: "sphere",
            flat: Scene { scenes: vec![SceneRoot::default()], ..Scene::default() },
            real: ball(CELLS, depth),
            eye: [0.0, 0.4, 3.2],
            size: [TAU, PI],
            is_sphere: true,
        },
    ]
}

impl View {
    fn params(&self, side: u32, way: Option<&Value>) -> Value {
        let mut params = json!({
            "mode": "direct", "max_samples": 16, "adaptive": false, "width": side, "height": side, "environment": null,
            "camera": {"position": self.eye, "target": [0, 0, 0], "yfov_degrees": 40},
            "lights": [{"type": "ambient", "intensity": 0.15}, {"type": "directional", "direction": [-0.5, -1, -0.6], "intensity": 3}],
        });
        let mut surface = json!({"texture": {"image": "checks"}});
        way.iter().for_each(|way| lay(&mut surface, way));
        if self.is_sphere && way.is_some() {
            lay(&mut surface, &json!({"center": [0, 0, 0], "radius": 1, "roughness": 0.6}));
            params["spheres"] = json!([surface]);
        } else {
            surface["material"] = json!("detail");
            params["overrides"] = json!([surface]);
        }
        params
    }
}

/// Each way's picture against that of the real relief.
fn errors(engines: &mut Engines, effort: Effort, folder: &Path, out: &mut dyn Write) -> Result<()> {
    let Effort { side, rounds, clock } = effort;
    let ways = ways();
    let mut panels = Vec::new();
    let mut rows = Vec::new();
    for view in views() {
        let maps = maps(view.size)?;
        let case = |scene, way| Case { scene, maps: &maps, params: view.params(side, way) }.work(EngineChoice::Cpu);
        let (truth, real_seconds) = trace(engines, clock, &case(&view.real, None)?)?;
        let works: Vec<Work> = ways.iter().map(|(_, way)| case(&view.flat, Some(way))).collect::<Result<_>>()?;
        let shown = timed(engines, clock, &works, rounds)?;
        writeln!(out, "### Error, {}; the real relief took {:.1} ms\n", view.name, 1e3 * real_seconds)?;
        writeln!(out, "| way | ms | RMSE / mean | FLIP |\n|---|---|---|---|")?;
        let mut lines = Vec::new();
        for ((name, _), (picture, seconds)) in ways.iter().zip(&shown) {
            let (rmse, seen) = (relative_rmse(picture, &truth), flip(picture, &truth));
            writeln!(out, "| {name} | {:.1} | {rmse:.4} | {seen:.4} |", 1e3 * seconds)?;
            let mse = relative_mse(picture, &truth).max(1e-9);
            lines.push(Line { name: (*name).to_owned(), points: vec![(*seconds, mse)] });
        }
        writeln!(out)?;
        panels.push((view.name.to_owned(), lines));
        rows.push(shown.into_iter().map(|(picture, _)| picture).chain([truth]).collect::<Vec<_>>());
    }
    plot::error_of_settings(&folder.join("detail.svg"), &panels)?;
    write_sheet(&folder.join("detail.jpg"), &rows)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    /// The reference must be the same surface as the request's: a relief of depth 0 looks the same on both.
    #[test]
    fn flat_reliefs_are_the_flat_surfaces() {
        let mut engines = Engines::new();
        let maps = maps([1.0; 2]).expect("maps");
        for view in views() {
            let real = if view.is_sphere { ball(256, |_, _| 0.0) } else { sheet(8, |_, _| 0.0) };
            let none = json!({});
            let look = |scene, way| {
                let case = Case { scene, maps: &maps, params: view.params(48, way) };
                case.work(EngineChoice::Cpu).expect("work")
            };
            let works = [look(&view.flat, Some(&none)), look(&real, None)];
            let shown = timed(&mut engines, Clock::Wall, &works, 1).expect("pictures");
            let error = relative_rmse(&shown[0].0, &shown[1].0);
            assert!(error < 0.02, "{}: {error}", view.name);
        }
    }

    #[test]
    fn fronts_face_the_viewer() {
        let sheet = sheet(2, |_, _| 0.0);
        let primitive = &sheet.meshes[0].primitives[0];
        let [a, b, c] = primitive.triangles[0].map(|index| primitive.positions[index as usize]);
        assert!((b - a).cross(c - a).y > 0.0);
        assert!(primitive.normals.as_ref().is_some_and(|normals| normals.iter().all(|n| n.abs_diff_eq(Vec3::Y, 1e-3))));
    }
}
