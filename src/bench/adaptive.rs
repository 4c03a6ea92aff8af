//! Adaptive sampling against uniform: time and samples until the stated error is the same.

use super::cases;
use crate::params::EngineChoice;
use crate::render::{Engine, Engines, Render, RenderError, Work};
use anyhow::Result;
use std::io::Write;
use std::path::Path;
use std::time::Instant;

/// Least growth of the samples between two looks at the error.
const GROWTH: f64 = 1.05;

/// Runs `rounds` seeds of each case, uniform and adaptive in turns slice by slice, up to `samples` per pixel, and writes
/// the table. `choice`: the engine; `peers`: a folder with `cases` of other renderers' pictures, if there is one;
/// `scenes`: words, one of which a scene's name must have, or none.
///
/// # Errors
/// No adapter, a device fault, or a case that cannot be read.
pub fn run(
    choice: EngineChoice,
    rounds: u32,
    samples: u32,
    peers: Option<&Path>,
    scenes: &[String],
    out: &mut dyn Write,
) -> Result<()> {
    let mut engine = Engines::new();
    let mut cases = cases::all(256, samples, peers)?;
    cases.retain(|(name, _)| scenes.is_empty() || scenes.iter().any(|word| name.contains(word.as_str())));
    for (_, work) in &mut cases {
        work.settings.engine = choice;
    }
    if let Some((_, work)) = cases.first() {
        let render = engine.begin_ready(work.clone(), None)?;
        writeln!(out, "On {}; {rounds} seeds, up to {samples} samples per pixel.\n", super::machine(render.device()))?;
    }
    writeln!(out, "| scene | error | uniform s | adaptive s | time ratio | sample ratio | at twice the error |")?;
    writeln!(out, "|---|---|---|---|---|---|---|")?;
    for (name, work) in cases {
        let pairs = (1..=rounds).map(|seed| Pair::trace(&mut engine, &work, seed)).collect::<Result<Vec<_>>>()?;
        writeln!(out, "| {name} | {} |", row(&pairs))?;
        out.flush()?;
    }
    Ok(())
}

/// How far a render was.
#[derive(Clone, Copy)]
struct Point {
    error: f64,
    seconds: f64,
    samples: f64,
}

/// Both ways with the same seed.
struct Pair {
    uniform: Vec<Point>,
    adaptive: Vec<Point>,
}

impl Pair {
    /// Renders both, slice by slice in turns: what else the machine does slows both down alike.
    fn trace(engine: &mut dyn Engine, work: &Work, seed: u32) -> Result<Self> {
        let mut begin = |adaptive| {
            let mut work = work.clone();
            (work.settings.seed, work.settings.adaptive) = (seed, adaptive);
            Ok::<_, RenderError>(Way { render: engine.begin_ready(work, None)?, seconds: 0.0, points: Vec::new() })
        };
        let (mut uniform, mut adaptive) = (begin(false)?, begin(true)?);
        let mut under_way = [true; 2];
        while under_way.contains(&true) {
            for (way, under_way) in [&mut uniform, &mut adaptive].into_iter().zip(&mut under_way) {
                *under_way = *under_way && way.step()?;
            }
        }
        Ok(Self { uniform: uniform.points, adaptive: adaptive.points })
    }

    /// The error that both have reached.
    fn common(&self) -> f64 {
        let reached = |points: &[Point]| points.iter().map(|point| point.error).fold(f64::INFINITY, f64::min);
        reached(&self.uniform).max(reached(&self.adaptive))
    }
}

/// A render under way.
struct Way {
    render: Box<dyn Render>,
    /// Time of its slices.
    seconds: f64,
    points: Vec<Point>,
}

impl Way {
    /// Takes a slice and looks at the error, if there is much that is new. False: it has ended.
    fn step(&mut self) -> Result<bool, RenderError> {
        let begun = Instant::now();
        let ended = self.render.step()?.is_some();
        self.seconds += begun.elapsed().as_secs_f64();
        let film = self.render.film();
        let pixels = f64::from(film.width()) * f64::from(film.height());
        let samples = film.pixel_samples() as f64 / pixels;
        let grown = samples >= GROWTH * self.points.last().map_or(1.0, |point| point.samples);
        if (grown || ended)
            && let Some(error) = film.error()
        {
            self.points.push(Point { error: error.relative_rms, seconds: self.seconds, samples });
        }
        Ok(!ended)
    }
}

/// Seconds and samples until the error was at most `error`, between looks by power laws.
fn until(points: &[Point], error: f64) -> (f64, f64) {
    let Some(after) = points.iter().position(|point| point.error <= error) else { return (f64::NAN, f64::NAN) };
    let (b, a) = (points[after], points[after.saturating_sub(1)]);
    let part = if a.error > b.error { (a.error / error).ln() / (a.error / b.error).ln() } else { 1.0 };
    let between = |a: f64, b: f64| a * (b / a).powf(part);
    (between(a.seconds, b.seconds), between(a.samples, b.samples))
}

fn row(pairs: &[Pair]) -> String {
    let mean = |value: &dyn Fn(&Pair) -> f64| {
        (pairs.iter().map(|pair| value(pair).ln()).sum::<f64>() / pairs.len() as f64).exp()
    };
    if pairs.iter().any(|pair| pair.common() == 0.0) {
        return "0 | | | | | ".to_owned();
    }
    let seconds = |points: fn(&Pair) -> &[Point]| mean(&|pair| until(points(pair), pair.common()).0);
    let ratio = |pair: &Pair, error: f64| {
        let (uniform, adaptive) = (until(&pair.uniform, error), until(&pair.adaptive, error));
        (uniform.0 / adaptive.0, uniform.1 / adaptive.1)
    };
    let least = pairs.iter().map(|pair| ratio(pair, pair.common()).0).fold(f64::INFINITY, f64::min);
    format!(
        "{:.4} | {:.2} | {:.2} | {:.2} (least {least:.2}) | {:.2} | {:.2}, samples {:.2}",
        mean(&Pair::common),
        seconds(|pair| &pair.uniform),
        seconds(|pair| &pair.adaptive),
        mean(&|pair| ratio(pair, pair.common()).0),
        mean(&|pair| ratio(pair, pair.common()).1),
        mean(&|pair| ratio(pair, 2.0 * pair.common()).0),
        mean(&|pair| ratio(pair, 2.0 * pair.common()).1),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn half_the_error_takes_four_times_the_samples() {
        let point = |samples: f64| Point { error: samples.powf(-0.5), seconds: 3.0 * samples, samples };
        let points = [16.0, 64.0, 256.0].map(point);
        let (seconds, samples) = until(&points, 0.1);
        assert!((samples - 100.0).abs() < 1e-9 && (seconds - 300.0).abs() < 1e-9, "{seconds} s, {samples} samples");
        assert!(until(&points, 0.01).0.is_nan());
        let pair = Pair { uniform: points.to_vec(), adaptive: points[..2].to_vec() };
        assert_eq!(pair.common(), 0.125);
    }
}
