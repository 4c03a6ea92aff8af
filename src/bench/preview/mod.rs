//! Studies of the preview engine: lights, shadows, and the way from POST to PNG.

pub mod lights;
pub mod post;
pub mod shadows;
pub(super) mod similarity;

use crate::film::Picture;
use crate::render::gpu::GpuEngine;
use crate::render::{Engine, Work};
use anyhow::Result;
use std::time::Instant;

/// Draws one frame, and says in how many seconds: from its passes to the film on the host, uploads and pipelines left out.
fn frame(engine: &mut GpuEngine, work: Work) -> Result<(Picture, f64)> {
    let mut render = engine.begin(work, None)?;
    let begun = Instant::now();
    while render.step()?.is_none() {}
    let seconds = begun.elapsed().as_secs_f64();
    Ok((render.film().picture(), seconds))
}

/// Fastest of `rounds` frames of each work, in turns; the first of each makes its pipelines and does not count.
fn frames(engine: &mut GpuEngine, works: &[Work], rounds: u32) -> Result<Vec<(Picture, f64)>> {
    let mut best: Vec<(Picture, f64)> = Vec::with_capacity(works.len());
    for work in works {
        let (picture, _) = frame(engine, work.clone())?;
        best.push((picture, f64::INFINITY));
    }
    for _ in 0..rounds {
        for (work, best) in works.iter().zip(&mut best) {
            best.1 = best.1.min(frame(engine, work.clone())?.1);
        }
    }
    Ok(best)
}
