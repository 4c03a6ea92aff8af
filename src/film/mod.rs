//! From samples to a file: accumulation in replicates, the measured error, tone mapping, encoders.

mod encode;
mod error;
pub mod tone_mapping;

pub use encode::{EncodeError, encode};
pub use error::ErrorEstimate;

use rayon::prelude::*;

/// Independent estimates of the picture that the film keeps apart, to measure its error.
pub const REPLICATES: usize = 4;

/// Sums of samples per pixel, one set per replicate.
#[derive(Debug, Clone)]
pub struct Film {
    width: u32,
    height: u32,
    /// Per replicate: samples per pixel, and sums of (R, G, B, coverage).
    replicates: [(u32, Vec<[f64; 4]>); REPLICATES],
}

impl Film {
    /// An empty film.
    pub fn new(width: u32, height: u32) -> Self {
        let plane = || (0, vec![[0.0; 4]; width as usize * height as usize]);
        Self { width, height, replicates: std::array::from_fn(|_| plane()) }
    }

    /// Adds a pass: for every pixel, row by row from the top, the sum of `samples` samples of (R, G, B, coverage).
    ///
    /// # Panics
    /// If `sums` does not have one entry per pixel.
    pub fn add(&mut self, replicate: usize, samples: u32, sums: &[[f32; 4]]) {
        let (count, plane) = &mut self.replicates[replicate];
        assert_eq!(plane.len(), sums.len(), "a pass covers all pixels");
        *count += samples;
        plane.par_iter_mut().zip(sums).for_each(|(total, sum)| {
            for (t, s) in total.iter_mut().zip(sum) {
                *t += f64::from(*s);
            }
        });
    }

    /// The mean of all samples; black and empty while there are none.
    pub fn picture(&self) -> Picture {
        let per_sample = 1.0 / f64::from(self.samples().max(1));
        let mean = |pixel: usize| {
            let sum = |channel: usize| self.replicates.iter().map(|(_, plane)| plane[pixel][channel]).sum::<f64>();
            std::array::from_fn(|channel| (sum(channel) * per_sample) as f32)
        };
        let pixels = (0..self.width as usize * self.height as usize).into_par_iter().map(mean).collect();
        Picture { width: self.width, height: self.height, pixels }
    }

    /// Samples per pixel of one replicate.
    pub fn replicate_samples(&self, replicate: usize) -> u32 {
        self.replicates[replicate].0
    }

    /// Samples per pixel in all.
    pub fn samples(&self) -> u32 {
        self.replicates.iter().map(|r| r.0).sum()
    }

    /// Picture width in pixels.
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Picture height in pixels.
    pub fn height(&self) -> u32 {
        self.height
    }
}

/// A picture as light: not yet exposed, tone mapped or encoded.
#[derive(Debug, Clone, PartialEq)]
pub struct Picture {
    /// Pixels across.
    pub width: u32,
    /// Pixels down.
    pub height: u32,
    /// Row by row from the top: radiance in linear Rec. 709, premultiplied by coverage, and coverage (0 to 1).
    pub pixels: Vec<[f32; 4]>,
}
