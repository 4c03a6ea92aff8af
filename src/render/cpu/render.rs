//! One picture under way: passes cut into slices of tiles, the tiles of a slice shared among the cores.

use super::bvh::Bvh;
use super::integrator::Integrator;
use super::sampler::Sampler;
use crate::film::{Film, TILE_PIXELS, TileSamples};
use crate::render::schedule::{Pass, Schedule};
use crate::render::slice::SlicePaths;
use crate::render::{DeviceInfo, NonFinite, Render, RenderError, StopReason, Work};
use glam::{DVec3, DVec4};
use rayon::prelude::*;
use std::ops::ControlFlow;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// A picture under way.
pub struct CpuRender {
    info: DeviceInfo,
    integrator: Integrator,
    schedule: Schedule,
    seed: u32,
    sobol: bool,
    film: Film,
    /// The pass under way.
    pass: Pass,
    /// Sums of the entries of the pass that are done, lane by lane, each entry's behind the other's ([`Film::add_split`]).
    sums: Vec<[f32; 4]>,
    tracing: Duration,
    slice: SlicePaths,
    non_finite: NonFinite,
}

impl CpuRender {
    /// Nothing traced yet.
    pub(super) fn new(info: DeviceInfo, work: Work, tree: Arc<Bvh>, film: Option<Film>) -> Self {
        let settings = work.settings;
        let groups = &work.lighting.groups;
        let film = film.unwrap_or_else(|| Film::split(work.view.width, work.view.height, groups));
        Self {
            info,
            schedule: Schedule::new(&settings),
            seed: settings.seed,
            sobol: settings.strategy.sobol,
            integrator: Integrator::new(work, tree),
            film,
            pass: Pass::new(),
            sums: Vec::new(),
            tracing: Duration::ZERO,
            slice: SlicePaths::default(),
            non_finite: NonFinite::default(),
        }
    }

    /// Begins the pass that is due, or says why there is none.
    fn next_pass(&mut self) -> Option<StopReason> {
        self.pass.clear();
        self.sums.clear();
        match self.schedule.next(&self.film, self.tracing) {
            ControlFlow::Break(reason) => return Some(reason),
            ControlFlow::Continue(pass) => self.pass = pass,
        }
        None
    }

    /// Entries of the pass that are done.
    fn done(&self) -> usize {
        self.sums.len() / self.stride()
    }

    /// Sums of an entry.
    fn stride(&self) -> usize {
        TILE_PIXELS * (1 + self.film.groups())
    }

    /// Sums of an entry, lane by lane, and of its groups; returns what was dropped.
    fn trace(&self, entry: TileSamples, lanes: &mut [[f32; 4]]) -> NonFinite {
        let mut dropped = NonFinite::default();
        let mut groups = vec![DVec3::ZERO; self.film.groups()];
        for lane in 0..TILE_PIXELS {
            let Some((x, y)) = self.film.tiles().pixel(entry.tile, lane as u32) else { continue };
            let pixel = y * self.film.width() + x;
            let mut sum = DVec4::ZERO;
            groups.fill(DVec3::ZERO);
            for sample in entry.first..entry.first + entry.samples {
                let sampler = Sampler::new(pixel, sample, entry.replicate, self.seed, self.sobol);
                let (value, split) = self.integrator.sample(x, y, &sampler);
                match value {
                    _ if value.is_finite() => {
                        sum += value;
                        groups.iter_mut().zip(split).for_each(|(sum, light)| *sum += light);
                    }
                    _ if value.is_nan() => dropped.nan += 1,
                    _ => dropped.infinite += 1,
                }
            }
            lanes[lane] = sum.as_vec4().to_array();
            for (group, sum) in groups.iter().enumerate() {
                lanes[(1 + group) * TILE_PIXELS + lane] = sum.extend(0.0).as_vec4().to_array();
            }
        }
        dropped
    }
}

impl Render for CpuRender {
    fn device(&self) -> &DeviceInfo {
        &self.info
    }

    fn step(&mut self) -> Result<Option<StopReason>, RenderError> {
        let begun = Instant::now();
        if self.done() == self.pass.len()
            && let Some(reason) = self.next_pass()
        {
            return Ok(Some(reason));
        }
        let (done, stride) = (self.done(), self.stride());
        let (count, paths) = self.slice.take(&self.pass[done..]);
        let mut sums = std::mem::take(&mut self.sums);
        sums.resize((done + count as usize) * stride, [0.0; 4]);
        let places = sums[done * stride..].par_chunks_exact_mut(stride);
        let traced = places.zip(&self.pass[done..]).map(|(lanes, &entry)| self.trace(entry, lanes));
        let dropped = traced.reduce(NonFinite::default, NonFinite::and);
        (self.sums, self.non_finite) = (sums, self.non_finite.and(dropped));
        self.slice.learn(paths, begun.elapsed());
        if self.done() < self.pass.len() {
            self.tracing += begun.elapsed();
            return Ok(self.schedule.overdue(&self.film, self.tracing).then_some(StopReason::Deadline));
        }
        self.film.add_split(&self.pass, &self.sums);
        self.tracing += begun.elapsed();
        Ok(self.next_pass())
    }

    fn film(&self) -> &Film {
        &self.film
    }

    fn into_film(self: Box<Self>) -> Film {
        self.film
    }

    fn progress(&self) -> f64 {
        self.schedule.fraction(&self.film, &self.pass[..self.done()])
    }

    fn non_finite(&self) -> NonFinite {
        self.non_finite
    }
}
