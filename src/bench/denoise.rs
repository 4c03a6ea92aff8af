//! What denoising does to the error: pictures of few samples before and after it against a reference, by what the denoiser is told.

use super::error::Truth;
use super::pictures::write_sheet;
use super::preview::shadows::scenes;
use super::skip::kernel::compiled;
use crate::denoise::{Denoiser, Guidance};
use crate::film::{Guides, Picture};
use crate::params::EngineChoice;
use crate::render::{Engine, Engines, Work};
use anyhow::{Context, Result, anyhow};
use serde_json::json;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Instant;

const DEMOS: [&str; 4] = ["still-life", "box", "grid", "detail"];

/// What the denoiser is told, from least to most.
const WAYS: [Guidance; 3] = [Guidance::None, Guidance::Noisy, Guidance::Prefiltered];

/// Part of its radiance by which a pixel counts as further off.
const FURTHER: f64 = 0.01;

/// How much to render.
#[derive(Debug, Clone, Copy)]
pub struct Size<'a> {
    /// Pixels a side.
    pub side: u32,
    /// Samples per pixel of the pictures.
    pub samples: &'a [u32],
    /// Samples per pixel of a reference.
    pub reference: u32,
    /// Who traces.
    pub engine: EngineChoice,
}

/// A picture that is to be denoised.
struct Traced {
    picture: Picture,
    guides: Guides,
    /// Seconds of all slices, and of those that went into the guides.
    seconds: [f64; 2],
}

/// Writes a table to `out`, and to `denoise.jpg` in `folder` a row for each scene at the first number of samples: before, after, reference.
/// `models`: glTF files beside the demos.
///
/// # Errors
/// A device fault, a denoiser that fails, a file that cannot be read or written.
pub fn run(denoiser: &Denoiser, models: &[PathBuf], size: Size<'_>, folder: &Path, out: &mut dyn Write) -> Result<()> {
    let mut engines = Engines::new();
    writeln!(
        out,
        "| scene | samples | error before | after, light alone | with guides as traced | with guides denoised first | worth samples | \
         pixels further off | mean radiance | trace s, of it guides | denoise s |"
    )?;
    writeln!(out, "|---|---|---|---|---|---|---|---|---|---|---|")?;
    let mut rows = Vec::new();
    for (name, scene) in scenes(&DEMOS, models)? {
        let request = json!({
            "width": size.side, "height": size.side, "max_samples": size.reference, "engine": size.engine, "denoise": true
        });
        let work = compiled(&scene, request)?;
        eprintln!("{name}: reference");
        let truth = Truth::new(&mut engines, &work, size.reference, |a, b| a.relative_rms_from(b).powi(2))?;
        for &samples in size.samples {
            let mut work = work.clone();
            (work.settings.max_samples, work.settings.seed) = (samples, samples);
            let traced = trace(&mut engines, work)?;
            let mut denoised = Vec::new();
            let mut seconds = 0.0;
            for way in WAYS {
                let begun = Instant::now();
                let after = denoiser.denoise(&traced.picture, Some(&traced.guides), way, &|| true);
                seconds = begun.elapsed().as_secs_f64();
                denoised.push(after.map_err(|why| anyhow!(why))?);
            }
            writeln!(out, "| {name} | {samples} | {} {seconds:.2} |", row(&traced, &denoised, &truth))?;
            out.flush()?;
            if size.samples.first() == Some(&samples) {
                rows.push(vec![traced.picture, denoised.swap_remove(WAYS.len() - 1), truth.picture.clone()]);
            }
        }
    }
    write_sheet(&folder.join("denoise.jpg"), &rows)
}

fn trace(engine: &mut dyn Engine, work: Work) -> Result<Traced> {
    let mut render = engine.begin_ready(work, None)?;
    let begun = Instant::now();
    let mut found = None;
    while render.step()?.is_none() {
        let guides = render.take_guides();
        found = found.or_else(|| guides.map(|guides| (guides, begun.elapsed().as_secs_f64())));
    }
    let seconds = begun.elapsed().as_secs_f64();
    let (guides, of_guides) = found.context("no guides were traced")?;
    Ok(Traced { picture: render.film().picture(), guides, seconds: [seconds, of_guides] })
}

fn row(traced: &Traced, after: &[Picture], truth: &Truth) -> String {
    let error = |picture: &Picture| (picture.relative_rms_from(&truth.picture).powi(2) - truth.noise).max(0.0).sqrt();
    let before = error(&traced.picture);
    let errors: Vec<f64> = after.iter().map(error).collect();
    let best = after.last().unwrap_or(&traced.picture);
    let worth = (before / errors.last().copied().unwrap_or(before)).powi(2);
    let means: Vec<f64> = [&traced.picture, best].map(|picture| mean(picture) / mean(&truth.picture)).to_vec();
    let errors: String = errors.iter().map(|error| format!("{error:.4} | ")).collect();
    let [all, of_guides] = traced.seconds;
    format!(
        "{before:.4} | {errors}{worth:.1} x | {:.0} % | {:.3}, {:.3} | {all:.1}, {of_guides:.2} |",
        100.0 * part_further(&traced.picture, best, &truth.picture),
        means[0],
        means[1],
    )
}

fn mean(picture: &Picture) -> f64 {
    picture.pixels.iter().flat_map(|&[r, g, b, _]| [r, g, b]).map(f64::from).sum()
}

/// Part of the pixels whose radiance is further from the truth after than before, by more than a hundredth of it.
fn part_further(before: &Picture, after: &Picture, truth: &Picture) -> f64 {
    let length = |pixel: [f64; 3]| pixel.iter().map(|value| value * value).sum::<f64>().sqrt();
    let distance = |a: &[f32; 4], b: &[f32; 4]| length(std::array::from_fn(|i| f64::from(a[i] - b[i])));
    let seen = |pixel: &[f32; 4]| FURTHER * length(std::array::from_fn(|i| f64::from(pixel[i])));
    let pixels = before.pixels.iter().zip(&after.pixels).zip(&truth.pixels);
    let further = pixels
        .filter(|((before, after), truth)| distance(after, truth) > distance(before, truth) + seen(truth))
        .count();
    further as f64 / truth.pixels.len().max(1) as f64
}
