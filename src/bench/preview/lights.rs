//! Forward against deferred shading, 1 to 10,000 lights, listed per tile and not.

use super::frames;
use super::similarity::part_differing;
use crate::bench::pictures::write_sheet;
use crate::bench::plot::{self, Line};
use crate::bench::skip::kernel::{demo_scene, work};
use crate::compile::compile_scene;
use crate::film::Picture;
use crate::render::Work;
use crate::render::gpu::GpuEngine;
use crate::scene::Scene;
use anyhow::Result;
use glam::DVec3;
use serde_json::{Value, json};
use std::io::Write;
use std::path::Path;

/// Numbers of lights.
const COUNTS: [usize; 5] = [1, 10, 100, 1000, 10_000];
/// Ways of drawing: name, path, culling.
const WAYS: [(&str, &str, bool); 4] = [
    ("forward", "forward", false),
    ("forward, listed", "forward", true),
    ("deferred", "deferred", false),
    ("deferred, listed", "deferred", true),
];
/// Radius of a light in parts of the scene's, where all have the same.
const SAME_RADIUS: f64 = 0.2;
/// Lights that reach a place on average, where radii shrink as lights grow in number.
const REACHING: f64 = 10.0;

/// What the lights of a table have in common.
#[derive(Clone, Copy)]
enum Radii {
    /// All lights have the same: the more there are, the more reach each pixel.
    Same,
    /// However many there are, as many reach a pixel.
    Shrinking,
}

/// Writes a table for each demo and kind of radii to `out`, and a plot and pictures to `lights.svg` and `lights.jpg` in `folder`.
///
/// # Errors
/// A device fault, or a file that cannot be written.
pub fn run(engine: &mut GpuEngine, side: u32, rounds: u32, folder: &Path, out: &mut dyn Write) -> Result<()> {
    let (mut panels, mut pictures) = (Vec::new(), Vec::new());
    for demo in ["grid", "emitters"] {
        let scene = demo_scene(demo)?;
        for radii in [Radii::Same, Radii::Shrinking] {
            let title = match radii {
                Radii::Same => format!("{demo}, lights of one radius"),
                Radii::Shrinking => format!("{demo}, {REACHING} lights a place"),
            };
            writeln!(out, "### {title}\n")?;
            let (lines, shown) = table(engine, &scene, radii, (side, rounds), out)?;
            if let Some(ratio) = most_over_ten(&lines) {
                writeln!(out, "\n10,000 lights take {ratio:.2} times as long as ten ({}).", WAYS[WAYS.len() - 1].0)?;
            }
            panels.push((title, lines));
            pictures.push(shown);
            writeln!(out)?;
        }
    }
    plot::time_over(&folder.join("lights.svg"), "lights", &panels)?;
    write_sheet(&folder.join("lights.jpg"), &pictures)
}

/// Time of the last way under the most lights over that under ten.
fn most_over_ten(lines: &[Line]) -> Option<f64> {
    let points = &lines.last()?.points;
    let ten = points.iter().find(|(count, _)| *count == 10.0)?;
    Some(points.last()?.1 / ten.1)
}

/// Also answers the pictures of the last way, by numbers of lights.
fn table(
    engine: &mut GpuEngine,
    scene: &Scene,
    radii: Radii,
    (side, rounds): (u32, u32),
    out: &mut dyn Write,
) -> Result<(Vec<Line>, Vec<Picture>)> {
    let names: Vec<&str> = WAYS.iter().map(|way| way.0).collect();
    writeln!(out, "| lights | {} | pixels that differ |", names.join(", ms | ") + ", ms")?;
    writeln!(out, "|---{}|", "|---".repeat(WAYS.len() + 1))?;
    let mut lines: Vec<Line> = names.iter().map(|name| Line { name: (*name).to_owned(), points: Vec::new() }).collect();
    let mut shown = Vec::new();
    for count in COUNTS {
        let works = WAYS.map(|(_, path, culling)| picture(scene, radii, count, side, path, culling));
        let works: Vec<Work> = works.into_iter().collect::<Result<_>>()?;
        let drawn = frames(engine, &works, rounds)?;
        let cells: Vec<String> = drawn.iter().map(|(_, seconds)| format!("{:.1}", 1e3 * seconds)).collect();
        let worst = drawn.iter().map(|(picture, _)| part_differing(picture, &drawn[0].0)).fold(0.0, f64::max);
        writeln!(out, "| {count} | {} | {:.3} % |", cells.join(" | "), 100.0 * worst)?;
        for (line, (_, seconds)) in lines.iter_mut().zip(&drawn) {
            line.points.push((count as f64, *seconds));
        }
        shown.extend(drawn.into_iter().next_back().map(|(picture, _)| picture));
    }
    Ok((lines, shown))
}

fn picture(scene: &Scene, radii: Radii, count: usize, side: u32, path: &str, culling: bool) -> Result<Work> {
    let compiled = compile_scene(scene, None)?;
    let (min, max) = (compiled.bounds.min.as_dvec3(), compiled.bounds.max.as_dvec3());
    let lights = strewn(count, min + compiled.origin, max + compiled.origin, radii);
    let params = json!({
        "mode": "preview", "width": side, "height": side, "environment": null, "scene_lights": false, "lights": lights,
        "preview": {"path": path, "culling": culling, "samples": 1, "shadows": {"algorithm": "none"}},
    });
    work(scene, compiled, params, None)
}

/// Point lights strewn over the box by a Weyl sequence; together as bright whatever their number.
fn strewn(count: usize, min: DVec3, max: DVec3, radii: Radii) -> Value {
    let extent = max - min;
    let radius = 0.5 * extent.length();
    // Lights lie on a sheet where the box is thin: its two longer sides count.
    let sheet = (extent.x * extent.y).max(extent.y * extent.z).max(extent.z * extent.x);
    let range = match radii {
        Radii::Same => SAME_RADIUS * radius,
        Radii::Shrinking => (REACHING * sheet / (std::f64::consts::PI * count as f64)).sqrt().min(radius),
    };
    let step = DVec3::new(0.819_172_513, 0.671_043_607, 0.549_700_478);
    let light = |index: usize| {
        let place = min + extent * (step * (index as f64 + 1.0)).fract();
        let color = [0.3 + 0.7 * (index % 3) as f64 / 2.0, 0.6, 1.0 - 0.7 * (index % 5) as f64 / 4.0];
        let intensity = 0.1 * range * range;
        json!({"type": "point", "position": place.to_array(), "color": color, "intensity": intensity, "range": range})
    };
    (0..count).map(light).collect()
}
