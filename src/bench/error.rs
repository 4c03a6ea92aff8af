//! Run time against error, for each way of looking for light and each engine.

use super::{cases, plot};
use crate::film::Picture;
use crate::params::EngineChoice;
use crate::render::prepare::render_to_end;
use crate::render::{Engine, Engines, Render, RenderError, Settings, Strategy, Work};
use anyhow::{Context, Result};
use std::io::Write;
use std::path::Path;
use std::time::Instant;

/// Seeds of the two halves of a reference, which no other render has.
const REFERENCE_SEEDS: [u32; 2] = [0x00c0_ffee, 0x00be_ef00];
/// Most scattering events, for all ways alike: without Russian roulette nothing else may end a path.
const BOUNCES: u32 = 12;
/// Samples from which on the error's decay is measured.
const SETTLED: f64 = 16.0;

/// How much to render.
#[derive(Debug, Clone, Copy)]
pub struct Size {
    /// Pixels a side.
    pub side: u32,
    /// Samples per pixel to go to.
    pub samples: u32,
    /// Samples per pixel of a reference.
    pub reference: u32,
}

/// What to render.
#[derive(Debug, Clone, Copy)]
pub struct Choice<'a> {
    /// A folder with a folder `cases`, if there is one.
    pub peers: Option<&'a Path>,
    /// Words, one of which a scene's name must have; none: all scenes.
    pub scenes: &'a [String],
    /// Names of ways; none: all of them.
    pub ways: &'a [String],
}

/// How a picture may be made.
struct Way {
    name: &'static str,
    set: fn(&mut Settings),
}

const WAYS: [Way; 7] = [
    Way { name: "gpu", set: |settings| settings.engine = EngineChoice::Gpu },
    Way { name: "cpu", set: |settings| settings.engine = EngineChoice::Cpu },
    Way { name: "cpu, uniform", set: |settings| set(settings, |_| {}) },
    Way { name: "cpu, independent points", set: |settings| set(settings, |s| s.sobol = false) },
    Way { name: "cpu, lights sampled only", set: |settings| set(settings, |s| s.scattered_light = false) },
    Way { name: "cpu, scattered rays only", set: |settings| set(settings, |s| s.light_samples = false) },
    Way { name: "cpu, no roulette", set: |settings| set(settings, |s| s.roulette = false) },
];

/// Another strategy on the processor, all pixels alike.
fn set(settings: &mut Settings, change: fn(&mut Strategy)) {
    settings.engine = EngineChoice::Cpu;
    settings.adaptive = false;
    change(&mut settings.strategy);
}

/// How far a render was: samples per pixel, seconds of tracing, relative mean square error.
#[derive(Debug, Clone, Copy)]
pub struct Point {
    /// Per pixel.
    pub samples: f64,
    /// Of tracing.
    pub seconds: f64,
    /// Against the reference, whose own noise is subtracted.
    pub rel_mse: f64,
}

/// One way in one scene.
pub struct Curve {
    /// Of the way.
    pub name: &'static str,
    /// In order of time.
    pub points: Vec<Point>,
}

/// Renders each chosen case in each chosen way, slice by slice in turns; writes a table to `out`, every
/// point to `error.csv` and a plot to `error.svg` in `folder`.
///
/// # Errors
/// No adapter, a device fault, a case that cannot be read, a file that cannot be written.
pub fn run(size: Size, choice: Choice<'_>, folder: &Path, out: &mut dyn Write) -> Result<()> {
    let Size { side, samples, reference } = size;
    let ways: Vec<&Way> =
        WAYS.iter().filter(|way| choice.ways.is_empty() || choice.ways.iter().any(|name| name == way.name)).collect();
    let wanted = |name: &str| choice.scenes.is_empty() || choice.scenes.iter().any(|word| name.contains(word.as_str()));
    let mut engines = Engines::new();
    let mut panels = Vec::new();
    writeln!(out, "| scene | way | relMSE at {samples} | slope | s to 1e-2 | s to 1e-3 |")?;
    writeln!(out, "|---|---|---|---|---|---|")?;
    for (name, mut work) in cases::all(side, samples, choice.peers)?.into_iter().filter(|(name, _)| wanted(name)) {
        work.settings.max_bounces = Some(work.settings.max_bounces.unwrap_or(BOUNCES).min(BOUNCES));
        let truth = Truth::new(&mut engines, &work, reference, Picture::rel_mse_from)?;
        let curves = trace(&mut engines, &ways, &work, &truth)?;
        for curve in &curves {
            writeln!(out, "| {name} | {} | {} |", curve.name, row(&curve.points))?;
        }
        out.flush()?;
        panels.push((name, curves));
    }
    write_csv(&folder.join("error.csv"), &panels)?;
    plot::error_over_time(&folder.join("error.svg"), &panels)
}

/// A reference of two halves, by whose difference its noise is known.
pub struct Truth {
    /// Their mean.
    pub picture: Picture,
    /// Its mean square error.
    pub noise: f64,
}

impl Truth {
    /// Renders it on the processor; `square_error` is of a picture against a true one.
    ///
    /// # Errors
    /// A device fault.
    pub fn new(
        engine: &mut dyn Engine,
        work: &Work,
        samples: u32,
        square_error: fn(&Picture, &Picture) -> f64,
    ) -> Result<Self> {
        let mut half = |seed| {
            let mut work = work.clone();
            (work.settings.max_samples, work.settings.seed) = (samples / 2, seed);
            (work.settings.engine, work.settings.adaptive) = (EngineChoice::Cpu, false);
            Ok::<_, RenderError>(render_to_end(engine, work, &mut |_| {})?.film.picture())
        };
        let (a, b) = (half(REFERENCE_SEEDS[0])?, half(REFERENCE_SEEDS[1])?);
        let picture = a.mean_with(&b);
        let noise = square_error(&a, &picture);
        Ok(Self { picture, noise })
    }
}

/// A render under way.
struct UnderWay {
    render: Box<dyn Render>,
    curve: Curve,
    seconds: f64,
    ended: bool,
}

fn trace(engine: &mut dyn Engine, ways: &[&Way], work: &Work, truth: &Truth) -> Result<Vec<Curve>> {
    let mut renders = Vec::new();
    for way in ways {
        let mut work = work.clone();
        (way.set)(&mut work.settings);
        let curve = Curve { name: way.name, points: Vec::new() };
        renders.push(UnderWay { render: engine.begin_ready(work, None)?, curve, seconds: 0.0, ended: false });
    }
    while renders.iter().any(|render| !render.ended) {
        for render in renders.iter_mut().filter(|render| !render.ended) {
            render.step(truth)?;
        }
    }
    Ok(renders.into_iter().map(|render| render.curve).collect())
}

impl UnderWay {
    fn step(&mut self, truth: &Truth) -> Result<(), RenderError> {
        let begun = Instant::now();
        self.ended = self.render.step()?.is_some();
        self.seconds += begun.elapsed().as_secs_f64();
        let film = self.render.film();
        let samples = film.pixel_samples() as f64 / (f64::from(film.width()) * f64::from(film.height()));
        let next = self.curve.points.last().map_or(4.0, |point| 2.0 * point.samples);
        if samples >= next || self.ended {
            let rel_mse = film.picture().rel_mse_from(&truth.picture) - truth.noise;
            self.curve.points.push(Point { samples, seconds: self.seconds, rel_mse: rel_mse.max(0.0) });
        }
        Ok(())
    }
}

fn row(points: &[Point]) -> String {
    let last = points.last().map_or(f64::NAN, |point| point.rel_mse);
    format!("{last:.1e} | {:.2} | {} | {}", slope(points), until(points, 1e-2), until(points, 1e-3))
}

/// Decades of error per decade of samples, by least squares.
fn slope(points: &[Point]) -> f64 {
    let settled = points.iter().filter(|point| point.samples >= SETTLED && point.rel_mse > 0.0);
    let logs: Vec<(f64, f64)> = settled.map(|point| (point.samples.log10(), point.rel_mse.log10())).collect();
    let n = logs.len() as f64;
    let (x, y) = logs.iter().fold((0.0, 0.0), |(x, y), log| (x + log.0 / n, y + log.1 / n));
    let (xy, xx) =
        logs.iter().fold((0.0, 0.0), |(xy, xx), log| (xy + (log.0 - x) * (log.1 - y), xx + (log.0 - x).powi(2)));
    xy / xx
}

/// Seconds until an error; beyond the last point at the slope of independent samples, then marked by `~`.
fn until(points: &[Point], error: f64) -> String {
    let Some(after) = points.iter().position(|point| point.rel_mse <= error) else {
        return points.last().map_or(String::new(), |p| format!("~{:.2}", p.seconds * p.rel_mse / error));
    };
    let (a, b) = (points[after.saturating_sub(1)], points[after]);
    if after == 0 || b.rel_mse <= 0.0 {
        return format!("{:.2}", b.seconds);
    }
    let part = (a.rel_mse / error).ln() / (a.rel_mse / b.rel_mse).ln();
    format!("{:.2}", a.seconds * (b.seconds / a.seconds).powf(part))
}

fn write_csv(path: &Path, panels: &[(String, Vec<Curve>)]) -> Result<()> {
    let mut lines = vec!["scene,way,samples,seconds,rel_mse".to_owned()];
    for (scene, curves) in panels {
        for curve in curves {
            lines.extend(curve.points.iter().map(|Point { samples, seconds, rel_mse }| {
                format!("{scene},\"{}\",{samples},{seconds:.4},{rel_mse:.6e}", curve.name)
            }));
        }
    }
    std::fs::write(path, lines.join("\n") + "\n").with_context(|| format!("cannot write {}", path.display()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn independent_samples_fall_by_a_decade_per_decade() {
        let point = |samples: f64| Point { samples, seconds: 0.1 * samples, rel_mse: 1.0 / samples };
        let points = [4.0, 16.0, 64.0, 256.0].map(point);
        assert!((slope(&points) + 1.0).abs() < 1e-9);
        assert_eq!((until(&points, 1e-2), until(&points, 1e-3)), ("10.00".to_owned(), "~100.00".to_owned()));
    }
}
