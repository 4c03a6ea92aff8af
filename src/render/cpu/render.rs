//! One picture under way: passes cut into slices of tiles, the tiles of a slice shared among the cores.

use super::bvh::Bvh;
use super::integrator::Integrator;
use super::sampler::Sampler;
use crate::film::Film;
use crate::render::schedule::{Pass, Schedule};
use crate::render::slice::SlicePaths;
use crate::render::{DeviceInfo, NonFinite, Render, RenderError, StopReason, Work};
use glam::DVec4;
use rayon::prelude::*;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Side of the square of pixels that a core takes at a time.
const TILE: u32 = 8;

/// A picture under way.
pub struct CpuRender {
    info: DeviceInfo,
    integrator: Integrator,
    schedule: Schedule,
    seed: u32,
    sobol: bool,
    max_samples: u32,
    film: Film,
    /// The pass under way, the tiles of it that are done, and their sums.
    pass: Option<(Pass, u32, Vec<[f32; 4]>)>,
    tracing: Duration,
    slice: SlicePaths,
    non_finite: NonFinite,
}

impl CpuRender {
    /// Nothing traced yet.
    pub(super) fn new(info: DeviceInfo, work: Work, tree: Arc<Bvh>, film: Option<Film>) -> Self {
        let settings = work.settings;
        let film = film.unwrap_or_else(|| Film::new(work.view.width, work.view.height));
        Self {
            info,
            schedule: Schedule::new(&settings),
            seed: settings.seed,
            sobol: settings.strategy.sobol,
            max_samples: settings.max_samples,
            integrator: Integrator::new(work, tree),
            film,
            pass: None,
            tracing: Duration::ZERO,
            slice: SlicePaths::default(),
            non_finite: NonFinite::default(),
        }
    }

    fn tiles(&self) -> (u32, u32) {
        let across = self.film.width().div_ceil(TILE);
        (across, across * self.film.height().div_ceil(TILE))
    }

    /// Sums of a tile, lane by lane, and what was dropped.
    fn trace_tile(&self, tile: u32, pass: Pass) -> (Vec<[f32; 4]>, NonFinite) {
        let mut dropped = NonFinite::default();
        let (across, _) = self.tiles();
        let corner = [tile % across * TILE, tile / across * TILE];
        let lane = |lane: u32| {
            let (x, y) = (corner[0] + lane % TILE, corner[1] + lane / TILE);
            if x >= self.film.width() || y >= self.film.height() {
                return [0.0; 4];
            }
            let pixel = y * self.film.width() + x;
            let mut sum = DVec4::ZERO;
            for sample in pass.first..pass.first + pass.samples {
                let value =
                    self.integrator.sample(x, y, &Sampler::new(pixel, sample, pass.replicate, self.seed, self.sobol));
                match value {
                    _ if value.is_finite() => sum += value,
                    _ if value.is_nan() => dropped.nan += 1,
                    _ => dropped.infinite += 1,
                }
            }
            sum.as_vec4().to_array()
        };
        ((0..TILE * TILE).map(lane).collect(), dropped)
    }

    fn collect(&mut self, pass: Pass, tiles: &[[f32; 4]]) {
        let (across, _) = self.tiles();
        let place = |x: u32, y: u32| {
            let tile = y / TILE * across + x / TILE;
            tiles[(tile * TILE * TILE + y % TILE * TILE + x % TILE) as usize]
        };
        let (width, height) = (self.film.width(), self.film.height());
        let sums: Vec<[f32; 4]> =
            (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).map(|(x, y)| place(x, y)).collect();
        self.film.add(pass.replicate as usize, pass.samples, &sums);
    }
}

impl Render for CpuRender {
    fn device(&self) -> &DeviceInfo {
        &self.info
    }

    fn step(&mut self) -> Result<Option<StopReason>, RenderError> {
        let begun = Instant::now();
        let (pass, done, mut sums) = match self.pass.take() {
            Some(under_way) => under_way,
            None => match self.schedule.next(&self.film) {
                Some(pass) => (pass, 0, Vec::new()),
                None => return Ok(Some(StopReason::MaxSamples)),
            },
        };
        let paths_per_tile = f64::from(TILE * TILE * pass.samples);
        let end = (done + self.slice.tiles(paths_per_tile)).min(self.tiles().1);
        let traced: Vec<_> = (done..end).into_par_iter().map(|tile| self.trace_tile(tile, pass)).collect();
        for (tile, dropped) in traced {
            sums.extend(tile);
            self.non_finite.nan += dropped.nan;
            self.non_finite.infinite += dropped.infinite;
        }
        self.slice.learn(f64::from(end - done) * paths_per_tile, begun.elapsed());
        let finished = end == self.tiles().1;
        if finished {
            self.collect(pass, &sums);
        } else {
            self.pass = Some((pass, end, sums));
        }
        self.tracing += begun.elapsed();
        if finished {
            return Ok(self.schedule.stop(&self.film, self.tracing));
        }
        Ok(self.schedule.overdue(&self.film, self.tracing).then_some(StopReason::Deadline))
    }

    fn film(&self) -> &Film {
        &self.film
    }

    fn into_film(self: Box<Self>) -> Film {
        self.film
    }

    fn progress(&self) -> f64 {
        let under_way = self
            .pass
            .as_ref()
            .map_or(0.0, |(pass, done, _)| f64::from(pass.samples) * f64::from(*done) / f64::from(self.tiles().1));
        (f64::from(self.film.samples()) + under_way) / f64::from(self.max_samples.max(1))
    }

    fn non_finite(&self) -> NonFinite {
        self.non_finite
    }
}
