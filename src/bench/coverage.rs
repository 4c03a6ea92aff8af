//! Whether the error that a picture states is its error: many renders against references of many samples.

use super::cases;
use crate::film::Picture;
use crate::params::EngineChoice;
use crate::render::prepare::render_to_end;
use crate::render::{Engine, Engines, Work};
use anyhow::Result;
use std::io::Write;
use std::path::Path;

/// Pixels a side.
const SIDE: u32 = 32;
/// Samples per pixel of the renders, taken in turns.
const SAMPLES: [u32; 4] = [16, 64, 128, 256];
/// Seed of references, which no other render has.
const REFERENCE_SEED: u32 = 0x00c0_ffee;

/// Stated and true errors of one scene at one sample count.
#[derive(Debug, Default)]
struct Tally {
    held: u32,
    renders: u32,
    ratios: Vec<f64>,
}

/// Renders each case `renders` times at every sample count, each with a seed of its own, and writes a table. `reference`: samples
/// per pixel of the truth.
///
/// # Errors
/// No adapter, a device fault, or a case that cannot be read.
pub fn run(
    choice: EngineChoice,
    renders: u32,
    reference: u32,
    peers: Option<&Path>,
    out: &mut dyn Write,
) -> Result<()> {
    let mut engines = Engines::new();
    let (mut held, mut all, mut ratios) = (0, 0, Vec::new());
    writeln!(
        out,
        "| scene | samples | renders | under the bound | stated error over true error: median | 5 % .. 95 % |"
    )?;
    writeln!(out, "|---|---|---|---|---|---|")?;
    for (name, mut work) in cases::all(SIDE, reference, peers)? {
        work.settings.engine = choice;
        let truth = picture(&mut engines, &work, reference)?;
        for samples in SAMPLES {
            let mut tally = Tally::default();
            for seed in 1..=renders {
                tally.add(&mut engines, &work, (samples, seed), &truth)?;
            }
            (held, all) = (held + tally.held, all + tally.renders);
            ratios.extend(&tally.ratios);
            writeln!(out, "| {name} | {samples} | {} |", tally.row())?;
            out.flush()?;
        }
    }
    let total = Tally { held, renders: all, ratios };
    writeln!(out, "| **all** | | {} |", total.row())?;
    Ok(())
}

fn picture(engine: &mut dyn Engine, work: &Work, samples: u32) -> Result<Picture> {
    let mut work = work.clone();
    (work.settings.max_samples, work.settings.seed) = (samples, REFERENCE_SEED);
    Ok(render_to_end(engine, work, &mut |_| {})?.film.picture())
}

impl Tally {
    fn add(
        &mut self,
        engine: &mut dyn Engine,
        work: &Work,
        (samples, seed): (u32, u32),
        truth: &Picture,
    ) -> Result<()> {
        let mut work = work.clone();
        (work.settings.max_samples, work.settings.seed) = (samples, seed);
        let film = render_to_end(engine, work, &mut |_| {})?.film;
        let Some(stated) = film.error() else { return Ok(()) };
        let error = film.picture().relative_rms_from(truth);
        self.renders += 1;
        self.held += u32::from(error <= stated.upper_bound_95);
        if error > 0.0 {
            self.ratios.push(stated.relative_rms / error);
        }
        Ok(())
    }

    fn row(mut self) -> String {
        self.ratios.sort_by(f64::total_cmp);
        let quantile = |part: f64| {
            let last = self.ratios.len().saturating_sub(1) as f64;
            self.ratios.get((part * last).round() as usize).copied().unwrap_or(f64::NAN)
        };
        format!(
            "{} | {:.1} % | {:.2} | {:.2} .. {:.2}",
            self.renders,
            100.0 * f64::from(self.held) / f64::from(self.renders.max(1)),
            quantile(0.5),
            quantile(0.05),
            quantile(0.95),
        )
    }
}
