//! The two engines against each other: per-pixel tests of their pictures of many scenes.

use crate::compile::{self, Hdri};
use crate::params::{EngineChoice, RenderParams};
use crate::render::prepare::{prepare, render_to_end};
use crate::render::{Engines, NonFinite, Work};
use crate::scene::{self, Limits, Package, Scene};
use anyhow::{Context, Result};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Family-wise significance.
const SIGNIFICANCE: f64 = 0.01;
/// Part of the pixels that must pass.
const MUST_PASS: f64 = 0.9975;
/// Relative difference that is rounding, not bias: single precision, over a path's length.
const ROUNDING: f64 = 1e-5;

/// How many pictures to compare.
#[derive(Debug, Clone, Copy)]
pub struct Size {
    /// Pixels a side.
    pub side: u32,
    /// Samples per pixel of one batch.
    pub samples: u32,
    /// Independent batches of each engine.
    pub batches: u32,
}

/// What came of one scene.
#[derive(Debug, Clone, Copy)]
pub struct Verdict {
    /// Part of the tests, one per pixel and channel, that pass.
    pub passed: f64,
    /// Largest deviate of any.
    pub worst: f64,
    /// Deviate of the mean over the picture.
    pub mean: f64,
    /// Relative difference of the means.
    pub difference: f64,
    /// Dropped samples of both.
    pub non_finite: NonFinite,
}

impl Verdict {
    /// Whether the engines draw the same.
    pub fn agrees(&self) -> bool {
        self.passed >= MUST_PASS && self.mean.abs() < 4.0 && self.non_finite == NonFinite::default()
    }
}

/// Compares the engines on every glTF file among and below `paths`, and writes a table to `out`.
///
/// # Errors
/// A path that cannot be read, or a fault of a device.
pub fn run(paths: &[PathBuf], params: &RenderParams, size: Size, out: &mut dyn Write) -> Result<()> {
    let hdri = hdri(params)?;
    let mut engines = Engines::new();
    writeln!(out, "| scene | pixels that pass | largest deviate | mean differs by | deviate of the mean | |")?;
    writeln!(out, "|---|---|---|---|---|---|")?;
    let (mut agreed, mut compared) = (0, 0);
    for file in files(paths)? {
        let name = file.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let scene = match open(&file) {
            Ok(scene) => scene,
            Err(error) => {
                writeln!(out, "| {name} | | | | | not drawn: {error:#} |")?;
                continue;
            }
        };
        let works = [EngineChoice::Gpu, EngineChoice::Cpu].map(|engine| work(&scene, params, size, engine, &hdri));
        let [Ok(gpu), Ok(cpu)] = works else {
            writeln!(out, "| {name} | | | | | nothing to draw |")?;
            continue;
        };
        let verdict = compare(&mut engines, [gpu, cpu], size)?;
        compared += 1;
        agreed += u32::from(verdict.agrees());
        let Verdict { passed, worst, mean, difference, .. } = verdict;
        let word = if verdict.agrees() { "" } else { "**differs**" };
        writeln!(
            out,
            "| {name} | {:.2} % | {worst:.1} | {:.3} % | {mean:.1} | {word} |",
            100.0 * passed,
            100.0 * difference
        )?;
        out.flush()?;
    }
    writeln!(out, "\n{agreed} of {compared} scenes agree.")?;
    Ok(())
}

/// Two pieces of work, each rendered in batches of their own seeds; Welch's test per pixel and channel.
///
/// # Errors
/// A fault of a device.
pub fn compare(engines: &mut Engines, works: [Work; 2], size: Size) -> Result<Verdict> {
    let mut non_finite = NonFinite::default();
    let mut moments = [Vec::new(), Vec::new()];
    for (which, work) in works.into_iter().enumerate() {
        for batch in 0..size.batches {
            let mut work = work.clone();
            work.settings.seed = 1 + 2 * batch + which as u32;
            let rendered = render_to_end(engines, work, &mut |_| {})?;
            non_finite = non_finite.and(rendered.non_finite);
            let pixels = rendered.film.picture().pixels;
            let values: Vec<f64> = pixels.iter().flat_map(|p| p.map(f64::from)).collect();
            // A last value for the whole picture.
            let mean = values.iter().sum::<f64>() / values.len() as f64;
            add(&mut moments[which], values.into_iter().chain([mean]), batch);
        }
    }
    let [a, b] = moments;
    let deviates: Vec<f64> = a.iter().zip(&b).map(|(a, b)| deviate(*a, *b, size.batches)).collect();
    let (tests, mean) = deviates.split_at(deviates.len() - 1);
    let limit = normal_limit(SIGNIFICANCE, tests.len());
    let passed = tests.iter().filter(|deviate| deviate.abs() <= limit).count();
    let (last_a, last_b) = (a[a.len() - 1].mean, b[b.len() - 1].mean);
    Ok(Verdict {
        passed: passed as f64 / tests.len() as f64,
        worst: tests.iter().fold(0.0, |worst, deviate| worst.max(deviate.abs())),
        mean: mean[0],
        difference: if last_b == 0.0 { last_a } else { last_a / last_b - 1.0 },
        non_finite,
    })
}

/// Mean and sum of squared differences from it (Welford 1962).
#[derive(Debug, Clone, Copy, Default)]
struct Moments {
    mean: f64,
    squares: f64,
}

fn add(moments: &mut Vec<Moments>, values: impl Iterator<Item = f64>, before: u32) {
    for (index, value) in values.enumerate() {
        if moments.len() <= index {
            moments.push(Moments::default());
        }
        let moment = &mut moments[index];
        let step = value - moment.mean;
        moment.mean += step / f64::from(before + 1);
        moment.squares += step * (value - moment.mean);
    }
}

/// Welch's t of two means, as the normal deviate of the same probability (Wallace 1959).
fn deviate(a: Moments, b: Moments, batches: u32) -> f64 {
    let n = f64::from(batches);
    let spread = |moments: Moments| moments.squares / (n - 1.0) / n;
    let rounding = ROUNDING * a.mean.abs().max(b.mean.abs());
    let (va, vb) = (spread(a), spread(b));
    let difference = a.mean - b.mean;
    if difference.abs() <= rounding {
        return 0.0;
    }
    let t = difference / (va + vb + rounding * rounding).sqrt();
    let freedom = if va + vb > 0.0 { (va + vb).powi(2) / ((va * va + vb * vb) / (n - 1.0)) } else { n - 1.0 };
    let z = (freedom * (t * t / freedom).ln_1p()).sqrt() * (8.0 * freedom + 1.0) / (8.0 * freedom + 3.0);
    z.copysign(t)
}

/// Deviate that none of so many independent normal ones exceeds but with the given probability (Sidak 1967).
fn normal_limit(significance: f64, tests: usize) -> f64 {
    let each = -((1.0 - significance).ln() / tests as f64).exp_m1();
    let (mut low, mut high) = (0.0, 40.0);
    for _ in 0..100 {
        let middle = 0.5 * (low + high);
        let outside = libm::erfc(middle / std::f64::consts::SQRT_2);
        if outside > each { low = middle } else { high = middle }
    }
    high
}

/// A small picture of a scene by one engine.
///
/// # Errors
/// The scene has nothing to draw, or not what the parameters name.
pub fn work(
    scene: &Scene,
    params: &RenderParams,
    size: Size,
    engine: EngineChoice,
    hdri: &Option<Arc<Hdri>>,
) -> Result<Work> {
    let params =
        RenderParams { width: size.side, height: size.side, max_samples: size.samples, engine, ..params.clone() };
    let compiled = Arc::new(compile::compile_scene(scene, params.scene)?);
    Ok(prepare(scene, compiled, &params, hdri.clone())?.work)
}

fn open(file: &Path) -> Result<Scene> {
    let limits = Limits::default();
    Ok(scene::import(&Package::from_path(file, &limits)?, &limits)?)
}

fn hdri(params: &RenderParams) -> Result<Option<Arc<Hdri>>> {
    let crate::params::EnvironmentChoice::Given(environment) = &params.environment else { return Ok(None) };
    let Some(file) = &environment.hdri else { return Ok(None) };
    let bytes = std::fs::read(file).with_context(|| format!("environment {file}"))?;
    Ok(Some(Arc::new(compile::decode_hdri(&bytes, compile::ENVIRONMENT_PIXELS)?)))
}

/// All glTF files among and below the paths, in order.
fn files(paths: &[PathBuf]) -> Result<Vec<PathBuf>> {
    let mut found = Vec::new();
    for path in paths {
        if path.is_dir() {
            let entries = std::fs::read_dir(path).with_context(|| path.display().to_string())?;
            let mut below = entries.map(|entry| Ok(entry?.path())).collect::<Result<Vec<_>>>()?;
            below.retain(|path| path.is_dir() || is_gltf(path));
            below.sort();
            found.extend(files(&below)?);
        } else {
            found.push(path.clone());
        }
    }
    Ok(found)
}

fn is_gltf(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension == "glb" || extension == "gltf")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn limits_are_those_of_the_tables() {
        assert!((normal_limit(0.05, 1) - 1.96).abs() < 1e-3);
        assert!((normal_limit(0.01, 1) - 2.576).abs() < 1e-3);
        // 1 - 0.99^(1/1000) on two sides.
        assert!((normal_limit(0.01, 1000) - 4.416).abs() < 5e-3);
    }

    #[test]
    fn deviates_are_those_of_student() {
        // t = 2.228 with 10 degrees of freedom has 5 % outside, as 1.96 in the normal distribution.
        let moments = |mean| Moments { mean, squares: 5.0 * 6.0 * 0.5 };
        let z = deviate(moments(2.228), moments(0.0), 6);
        assert!((z - 1.96).abs() < 0.01, "{z}");
    }
}
