//! Studies of the preview engine: lights, shadows, and the way from POST to PNG.

pub mod lights;
pub mod likeness;
pub mod post;
pub mod shadows;
pub(super) mod similarity;

use crate::bench::clock::{Clock, trace};
use crate::film::Picture;
use crate::render::Work;
use crate::render::gpu::GpuEngine;
use anyhow::Result;

/// Fastest of `rounds` frames of each work, in turns; the first of each makes its pipelines and does not count.
fn frames(engine: &mut GpuEngine, works: &[Work], rounds: u32) -> Result<Vec<(Picture, f64)>> {
    let clock = Clock::of(engine.device());
    let mut best: Vec<(Picture, f64)> = Vec::with_capacity(works.len());
    for work in works {
        let (picture, _) = trace(engine, clock, work)?;
        best.push((picture, f64::INFINITY));
    }
    for _ in 0..rounds {
        for (work, best) in works.iter().zip(&mut best) {
            best.1 = best.1.min(trace(engine, clock, work)?.1);
        }
    }
    Ok(best)
}
