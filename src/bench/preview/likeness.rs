//! A preview against the path tracer with one bounce, under the same lights: how far apart they are, scene by scene.

use super::similarity::{mean_radiance, part_differing, relative_rmse};
use crate::bench::flip::flip;
use crate::bench::pictures::write_sheet;
use crate::bench::preview::shadows::scenes;
use crate::compile::{CompiledScene, compile_scene};
use crate::film::Picture;
use crate::params::{EngineChoice, Mode};
use crate::render::Engines;
use crate::render::prepare::{prepare, render_to_end};
use crate::scene::Scene;
use anyhow::Result;
use glam::{DVec3, Vec3};
use serde_json::{Value, json};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;

const DEMOS: [&str; 4] = ["still-life", "grid", "box", "detail"];
/// Samples of the tracer, and frames of the preview, through the same box filter.
const SAMPLES: u32 = 256;
const FRAMES: u32 = 64;

/// What shines: name, and what a request says of it around a scene.
type Light = (&'static str, fn(DVec3, f64) -> Value);

const LIGHTS: [Light; 3] = [
    ("sun and lamp", |centre, radius| {
        let position = (centre + DVec3::new(1.2, 1.6, 1.4) * radius).to_array();
        json!({"environment": null, "lights": [
            {"type": "directional", "direction": [-0.5, -1, -0.4], "intensity": 2},
            {"type": "point", "position": position, "color": [1, 0.8, 0.6], "intensity": 4.0 * radius * radius}]})
    }),
    ("even sky", |_, _| json!({"environment": {"constant": [0.8, 0.8, 0.8]}})),
    (
        "gradient sky",
        |_, _| json!({"environment": {"gradient": {"top": [0.6, 0.8, 1.4], "horizon": [1, 0.9, 0.8], "bottom": [0.1, 0.08, 0.06]}}}),
    ),
];

/// Ways of finding shadows, where something throws them.
const SHADOWS: [(&str, &str); 2] =
    [("rays", r#"{"algorithm": "ray"}"#), ("pcf", r#"{"algorithm": "pcf", "map_size": 2048}"#)];

/// Writes a table to `out` and pictures to `likeness.jpg` in `folder`: the tracer's, then the preview's. `models`: glTF files beside the
/// demos.
///
/// # Errors
/// A device fault, a file that cannot be read or written.
pub fn run(engines: &mut Engines, models: &[PathBuf], side: u32, folder: &Path, out: &mut dyn Write) -> Result<()> {
    writeln!(
        out,
        "| scene | light | shadows | mean of the tracer's | preview's mean, % apart | RMSE / mean | FLIP | pixels more than 1/255 apart |"
    )?;
    writeln!(out, "|---|---|---|---|---|---|---|---|")?;
    let mut rows = Vec::new();
    for (name, mut scene) in scenes(&DEMOS, models)? {
        // What emits lights other things on the tracer's paths alone.
        scene.materials.iter_mut().for_each(|material| material.emissive = Vec3::ZERO);
        let compiled = Arc::new(compile_scene(&scene, None)?);
        for (light, fields) in LIGHTS {
            eprintln!("{name}, {light}");
            let mut fields = fields(compiled.bounds.centre() + compiled.origin, compiled.bounds.radius());
            fields["max_bounces"] = json!(1);
            fields["max_samples"] = json!(SAMPLES);
            let traced = picture(engines, &scene, &compiled, side, fields.clone())?;
            let mut row = vec![traced.clone()];
            let ways = if fields["lights"].is_null() { &SHADOWS[..1] } else { &SHADOWS[..] };
            for (shadows, way) in ways {
                fields["mode"] = json!("preview");
                fields["preview"] = json!({"samples": FRAMES, "shadows": serde_json::from_str::<Value>(way)?});
                let drawn = picture(engines, &scene, &compiled, side, fields.clone())?;
                let (mean, other) = (mean_radiance(&traced), mean_radiance(&drawn));
                let shadows = if fields["lights"].is_null() { "none" } else { shadows };
                writeln!(
                    out,
                    "| {name} | {light} | {shadows} | {mean:.4} | {:+.2} | {:.4} | {:.4} | {:.1} % |",
                    100.0 * (other / mean - 1.0),
                    relative_rmse(&drawn, &traced),
                    flip(&drawn, &traced),
                    100.0 * part_differing(&traced, &drawn)
                )?;
                row.push(drawn);
            }
            rows.push(row);
        }
    }
    write_sheet(&folder.join("likeness.jpg"), &rows)
}

fn picture(
    engines: &mut Engines,
    scene: &Scene,
    compiled: &Arc<CompiledScene>,
    side: u32,
    fields: Value,
) -> Result<Picture> {
    let mut params = json!({
        "width": side, "height": side, "scene_lights": false, "adaptive": false, "filter": {"kind": "box", "radius": 0.5},
        "camera": {"orbit": {"azimuth_degrees": -20, "elevation_degrees": 25}},
    });
    if let (Some(params), Value::Object(fields)) = (params.as_object_mut(), fields) {
        params.extend(fields);
    }
    let mut work = prepare(scene, Arc::clone(compiled), &serde_json::from_value(params)?, None)?.work;
    // The engine that shares no code with the preview.
    if work.settings.mode == Mode::Path {
        work.settings.engine = EngineChoice::Cpu;
    }
    Ok(render_to_end(engines, work, &mut |_| {})?.film.picture())
}
