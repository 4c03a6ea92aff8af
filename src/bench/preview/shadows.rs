//! Shadow algorithms: time per frame against error, by taps, map size, light size and kind of light. The truth is the same light as
//! a disk, by many rays a pixel.

use super::frames;
use super::similarity::{acne_and_leak, relative_mse, relative_rmse};
use crate::bench::clock::{Clock, trace};
use crate::bench::flip::flip;
use crate::bench::pictures::write_sheet;
use crate::bench::plot::{self, Line};
use crate::bench::skip::kernel::demo_scene;
use crate::compile::{CompiledScene, compile_scene};
use crate::film::Picture;
use crate::render::Work;
use crate::render::gpu::GpuEngine;
use crate::render::prepare::prepare;
use crate::scene::{self, Package, Scene};
use anyhow::{Context, Result};
use glam::DVec3;
use serde_json::{Value, json};
use std::fmt::Write as _;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;

const ALGORITHMS: [&str; 6] = ["basic", "pcf", "noise", "pcss", "pcss_noise", "ray"];
const TAPS: [u32; 3] = [4, 16, 64];
const MAP_SIZES: [u32; 2] = [512, 2048];
/// Diameters of the light in parts of its distance.
const LIGHT_SIZES: [f64; 2] = [0.02, 0.2];
const LIGHTS: [&str; 2] = ["point", "spot"];
/// Rays of the truth.
const MANY: u32 = 1024;

/// One way of finding shadows.
#[derive(Clone, PartialEq)]
struct Setting {
    algorithm: &'static str,
    taps: u32,
    map_size: u32,
}

impl Setting {
    fn name(&self) -> String {
        match self.algorithm {
            "basic" => format!("basic, {}", self.map_size),
            "ray" => format!("ray, {} rays", self.taps),
            name => format!("{name}, {} taps, {}", self.taps, self.map_size),
        }
    }

    /// One of each algorithm is shown.
    fn is_shown(&self) -> bool {
        (self.taps == 1 || self.taps == TAPS[1]) && (self.algorithm == "ray" || self.map_size == MAP_SIZES[0])
    }

    /// All of them; `basic` has one tap, `ray` no map.
    fn all() -> Vec<Self> {
        let mut all = Vec::new();
        for algorithm in ALGORITHMS {
            let taps: &[u32] = if algorithm == "basic" { &[1] } else { &TAPS };
            let sizes: &[u32] = if algorithm == "ray" { &[16] } else { &MAP_SIZES };
            for &taps in taps {
                all.extend(sizes.iter().map(|&map_size| Self { algorithm, taps, map_size }));
            }
        }
        all
    }
}

/// What was measured of one setting in one case.
#[derive(Clone, Default)]
struct Measured {
    seconds: f64,
    mse: f64,
    rmse: f64,
    flip: f64,
    acne: f64,
    leak: f64,
}

/// One scene under one light.
struct Case {
    name: String,
    soft: bool,
    measured: Vec<Measured>,
    /// By the settings that are [`Setting::is_shown`], then the truth.
    pictures: Vec<Picture>,
}

/// Writes tables to `out`, every point to `shadows.csv`, a plot to `shadows.svg` and pictures to `shadows.jpg` in `folder`. `models`: glTF files beside the plane
/// with an object.
///
/// # Errors
/// A device fault, a file that cannot be read or written.
pub fn run(
    engine: &mut GpuEngine,
    models: &[PathBuf],
    side: u32,
    rounds: u32,
    folder: &Path,
    out: &mut dyn Write,
) -> Result<()> {
    let settings = Setting::all();
    let mut cases = Vec::new();
    for (name, scene) in scenes(&["still-life"], models)? {
        let compiled = Arc::new(compile_scene(&scene, None)?);
        for light in LIGHTS {
            for size in LIGHT_SIZES {
                let make = |shadows: Value| picture(&scene, &compiled, light, size, side, shadows);
                let name = format!("{name}, {light}, size {size}");
                eprintln!("{name}");
                let (measured, pictures) = measure(engine, &settings, &make, rounds)?;
                cases.push(Case { name, soft: size == LIGHT_SIZES[1], measured, pictures });
            }
        }
    }
    write_csv(&folder.join("shadows.csv"), &settings, &cases)?;
    for (soft, title) in [(false, "small lights"), (true, "large lights")] {
        writeln!(out, "### Mean over scenes, {title}\n")?;
        write_table(&settings, &cases, soft, out)?;
        writeln!(out)?;
    }
    plot::error_of_settings(&folder.join("shadows.svg"), &panels(&settings, &cases))?;
    let soft = cases.into_iter().filter(|case| case.soft);
    write_sheet(&folder.join("shadows.jpg"), &soft.map(|case| case.pictures).collect::<Vec<_>>())
}

/// Demos by their names, and models that were given.
pub fn scenes(demos: &[&str], models: &[PathBuf]) -> Result<Vec<(String, Scene)>> {
    let demo = |name: &&str| Ok(((*name).to_owned(), demo_scene(name)?));
    let mut scenes: Vec<_> = demos.iter().map(demo).collect::<Result<_>>()?;
    if models.is_empty() {
        eprintln!("SKIPPED: real models; give glTF files as arguments");
    }
    let limits = scene::Limits::default();
    for path in models {
        let package = Package::from_path(path, &limits).with_context(|| path.display().to_string())?;
        let name = path.file_stem().map_or_else(|| "model".into(), |stem| stem.to_string_lossy().into_owned());
        scenes.push((name, scene::import(&package, &limits).with_context(|| path.display().to_string())?));
    }
    Ok(scenes)
}

/// A frame by the file's own camera, or by the automatic one.
fn picture(
    scene: &Scene,
    compiled: &Arc<CompiledScene>,
    light: &str,
    size: f64,
    side: u32,
    shadows: Value,
) -> Result<Work> {
    let centre = compiled.bounds.centre() + compiled.origin;
    let radius = compiled.bounds.radius();
    // Above, beside and before the scene, so that it throws its shadows over itself.
    let position = centre + DVec3::new(0.9, 1.4, 0.8) * radius;
    let distance = position.distance(centre);
    let mut lamp = json!({"type": light, "position": position.to_array(), "intensity": 3.0 * distance * distance});
    if light == "spot" {
        lamp["direction"] = json!((centre - position).to_array());
        lamp["outer_cone_degrees"] = json!(40);
    }
    let mut shadows = shadows;
    shadows["light_size"] = json!(size * distance);
    let params = json!({
        "mode": "preview", "width": side, "height": side, "environment": null, "scene_lights": false, "lights": [lamp],
        "preview": {"shading": "lambert", "samples": 1, "shadows": shadows},
    });
    Ok(prepare(scene, Arc::clone(compiled), &serde_json::from_value(params)?, None)?.work)
}

fn measure(
    engine: &mut GpuEngine,
    settings: &[Setting],
    make: &dyn Fn(Value) -> Result<Work>,
    rounds: u32,
) -> Result<(Vec<Measured>, Vec<Picture>)> {
    let (open, _) = trace(engine, Clock::Wall, &make(json!({"algorithm": "none"}))?)?;
    let (truth, _) = trace(engine, Clock::Wall, &make(json!({"algorithm": "ray", "taps": MANY}))?)?;
    let shadows = |s: &Setting| json!({"algorithm": s.algorithm, "taps": s.taps, "map_size": s.map_size});
    let works: Vec<Work> = settings.iter().map(|setting| make(shadows(setting))).collect::<Result<_>>()?;
    let drawn = frames(engine, &works, rounds)?;
    let measured = drawn.iter().map(|(picture, seconds)| {
        let (acne, leak) = acne_and_leak(picture, &truth, &open);
        let (mse, rmse) = (relative_mse(picture, &truth), relative_rmse(picture, &truth));
        Measured { seconds: *seconds, mse, rmse, flip: flip(picture, &truth), acne, leak }
    });
    let measured = measured.collect();
    let shown = settings.iter().zip(drawn).filter(|(setting, _)| setting.is_shown()).map(|(_, (picture, _))| picture);
    Ok((measured, shown.chain([truth]).collect()))
}

fn write_csv(path: &Path, settings: &[Setting], cases: &[Case]) -> Result<()> {
    let mut text = "case,algorithm,taps,map_size,seconds,rel_rmse,flip,acne,leak\n".to_owned();
    for case in cases {
        for (s, m) in settings.iter().zip(&case.measured) {
            let (name, Measured { seconds, rmse, flip, acne, leak, .. }) = (&case.name, m);
            let (algorithm, taps, size) = (s.algorithm, s.taps, s.map_size);
            writeln!(
                text,
                "\"{name}\",{algorithm},{taps},{size},{seconds:.6},{rmse:.6},{flip:.6},{acne:.6},{leak:.6}"
            )?;
        }
    }
    std::fs::write(path, text).with_context(|| path.display().to_string())
}

/// Means over the cases with lights of one size; then the Pareto fronts by name.
fn write_table(settings: &[Setting], cases: &[Case], soft: bool, out: &mut dyn Write) -> Result<()> {
    let chosen: Vec<&Case> = cases.iter().filter(|case| case.soft == soft).collect();
    let mean = |value: fn(&Measured) -> f64| -> Vec<f64> {
        let of = |index: usize| chosen.iter().map(|case| value(&case.measured[index])).sum::<f64>();
        (0..settings.len()).map(|index| of(index) / chosen.len().max(1) as f64).collect()
    };
    let [seconds, rmse, flip] = [mean(|m| m.seconds), mean(|m| m.rmse), mean(|m| m.flip)];
    let (acne, leak) = (mean(|m| m.acne), mean(|m| m.leak));
    let fronts = [front(&seconds, &rmse), front(&seconds, &flip)];
    writeln!(out, "| algorithm | ms a frame | RMSE / mean | FLIP | acne | leak | Pareto |")?;
    writeln!(out, "|---|---|---|---|---|---|---|")?;
    for (i, setting) in settings.iter().enumerate() {
        let marks: Vec<&str> =
            fronts.iter().zip(["RMSE", "FLIP"]).filter(|(f, _)| f.contains(&i)).map(|(_, m)| m).collect();
        writeln!(
            out,
            "| {} | {:.1} | {:.4} | {:.4} | {:.4} | {:.4} | {} |",
            setting.name(),
            1e3 * seconds[i],
            rmse[i],
            flip[i],
            acne[i],
            leak[i],
            marks.join(", ")
        )?;
    }
    for (front, name) in fronts.iter().zip(["RMSE", "FLIP"]) {
        let names: Vec<String> = front.iter().map(|&index| settings[index].name()).collect();
        writeln!(out, "\nPareto front by {name}, from the fastest on: {}.", names.join("; "))?;
    }
    Ok(())
}

/// Settings than which none is both faster and nearer to the truth, from the fastest on.
fn front(seconds: &[f64], errors: &[f64]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..seconds.len()).collect();
    order.sort_by(|&a, &b| seconds[a].total_cmp(&seconds[b]).then(errors[a].total_cmp(&errors[b])));
    let mut least = f64::INFINITY;
    order.retain(|&index| {
        let is_nearer = errors[index] < least;
        least = least.min(errors[index]);
        is_nearer
    });
    order
}

/// A panel a case, a colour an algorithm.
fn panels(settings: &[Setting], cases: &[Case]) -> Vec<(String, Vec<Line>)> {
    let line = |case: &Case, algorithm: &str| {
        let of = settings.iter().zip(&case.measured).filter(|(setting, _)| setting.algorithm == algorithm);
        let points = of.map(|(_, m)| (m.seconds, m.mse.max(1e-9))).collect();
        Line { name: algorithm.to_owned(), points }
    };
    cases.iter().map(|case| (case.name.clone(), ALGORITHMS.map(|name| line(case, name)).into())).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_front_has_what_nothing_beats() {
        assert_eq!(front(&[3.0, 1.0, 2.0, 2.0, 4.0], &[0.1, 0.5, 0.6, 0.2, 0.1]), [1, 3, 0]);
    }

    #[test]
    fn each_algorithm_is_shown_once() {
        let shown: Vec<&str> = Setting::all().iter().filter(|s| s.is_shown()).map(|s| s.algorithm).collect();
        assert_eq!(shown, ALGORITHMS);
    }
}
