//! From samples to a file: accumulation in replicates, the measured error, tone mapping, encoders.

mod aov;
mod changes;
mod distance;
mod encode;
mod error;
mod groups;
mod guides;
mod rates;
#[cfg(test)]
pub(crate) mod testing;
mod tiles;
pub mod tone_mapping;

pub use aov::{Aov, Aovs};
pub use changes::{Changes, Seen};
pub use encode::{EncodeError, encode, encode_aov};
pub use error::ErrorEstimate;
pub use guides::Guides;
pub use rates::{MOST, PILOT, STEPS};
pub use tiles::{TILE_PIXELS, Tiles};

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Independent estimates of the picture that the film keeps apart, to measure its error.
pub const REPLICATES: usize = 4;

/// Samples of all pixels of one tile.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TileSamples {
    /// Tile of the film's [`Tiles`].
    pub tile: u32,
    /// Replicate, below [`REPLICATES`].
    pub replicate: u32,
    /// Index of the first sample in the sequence that the replicate has for this tile.
    pub first: u32,
    /// Samples per pixel.
    pub samples: u32,
}

/// Sums of samples per pixel, one set per replicate.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Film {
    tiles: Tiles,
    /// Samples per pixel, by replicate, then tile.
    counts: Vec<u32>,
    /// Sums of (R, G, B, coverage), by replicate, then tile, then lane.
    sums: Vec<[f64; 4]>,
    rates: Option<Vec<i8>>,
    groups: Vec<groups::Group>,
}

impl Film {
    /// An empty film.
    pub fn new(width: u32, height: u32) -> Self {
        let tiles = Tiles::new(width, height);
        let cells = REPLICATES * tiles.count() as usize;
        Self {
            tiles,
            counts: vec![0; cells],
            sums: vec![[0.0; 4]; cells * TILE_PIXELS],
            rates: None,
            groups: Vec::new(),
        }
    }

    /// Adds samples: for each entry of `work`, the sums of its samples of (R, G, B, coverage) in the 64 lanes of its tile.
    /// Lanes outside of the picture are of no account. The same tile may come again with its next samples.
    ///
    /// # Panics
    /// If `sums` does not have 64 entries for each of `work`, or samples are not those that follow what the film holds.
    pub fn add(&mut self, work: &[TileSamples], sums: &[[f32; 4]]) {
        assert_eq!(sums.len(), work.len() * TILE_PIXELS, "a sum for each lane");
        // Places in `work` by cell (replicate and tile), in order: cells can then be added to in parallel.
        let mut order: Vec<(u32, u32)> = Vec::with_capacity(work.len());
        for (place, entry) in work.iter().enumerate() {
            let cell = self.cell(entry.replicate, entry.tile);
            assert_eq!(self.counts[cell], entry.first, "the sequence of a replicate has no gap");
            self.counts[cell] += entry.samples;
            order.push((cell as u32, place as u32));
        }
        order.par_sort_unstable();
        self.sums.par_chunks_mut(TILE_PIXELS).enumerate().for_each(|(cell, totals)| {
            let begin = order.partition_point(|&(other, _)| (other as usize) < cell);
            for &(_, place) in order[begin..].iter().take_while(|&&(other, _)| other as usize == cell) {
                let sums = &sums[place as usize * TILE_PIXELS..][..TILE_PIXELS];
                totals.iter_mut().zip(sums).for_each(|(total, sum)| {
                    for (t, s) in total.iter_mut().zip(sum) {
                        *t += f64::from(*s);
                    }
                });
            }
        });
        self.note_pilot();
    }

    /// The mean of all samples of each pixel; black and empty where there are none.
    pub fn picture(&self) -> Picture {
        let (width, height) = (self.width(), self.height());
        let pixel = |x: u32, y: u32| {
            let (tile, lane) = self.tiles.place(x, y);
            let per_sample = 1.0 / f64::from(self.tile_samples(tile).max(1));
            let sum = |channel: usize| (0..REPLICATES as u32).map(|r| self.sum(r, tile, lane)[channel]).sum::<f64>();
            std::array::from_fn(|channel| (sum(channel) * per_sample) as f32)
        };
        let row = |y: u32| (0..width).map(move |x| pixel(x, y));
        Picture { width, height, pixels: (0..height).into_par_iter().flat_map_iter(row).collect() }
    }

    /// How the picture is cut.
    pub fn tiles(&self) -> Tiles {
        self.tiles
    }

    /// Samples per pixel of a tile in one replicate.
    pub fn replicate_samples(&self, replicate: u32, tile: u32) -> u32 {
        self.counts[self.cell(replicate, tile)]
    }

    /// Samples per pixel of a tile in all replicates.
    pub fn tile_samples(&self, tile: u32) -> u32 {
        (0..REPLICATES as u32).map(|replicate| self.replicate_samples(replicate, tile)).sum()
    }

    /// Samples of all pixels together.
    pub fn pixel_samples(&self) -> u64 {
        let of = |tile| u64::from(self.tiles.pixels(tile)) * u64::from(self.tile_samples(tile));
        (0..self.tiles.count()).map(of).sum()
    }

    /// Samples per pixel, on the average of the picture, to the nearest whole number.
    pub fn samples(&self) -> u32 {
        let pixels = u64::from(self.width()) * u64::from(self.height());
        ((self.pixel_samples() + pixels / 2) / pixels.max(1)) as u32
    }

    /// Samples of the pixels that have fewest and most.
    pub fn samples_range(&self) -> (u32, u32) {
        let with_pixels = (0..self.tiles.count()).filter(|&tile| self.tiles.pixels(tile) > 0);
        let counts = with_pixels.map(|tile| self.tile_samples(tile));
        counts.fold((u32::MAX, 0), |(least, most), count| (least.min(count), most.max(count)))
    }

    /// Picture width in pixels.
    pub fn width(&self) -> u32 {
        self.tiles.width()
    }

    /// Picture height in pixels.
    pub fn height(&self) -> u32 {
        self.tiles.height()
    }

    /// Adds so many samples per replicate of every pixel: `sum` is asked for (x, y, replicate, samples).
    #[cfg(test)]
    pub(crate) fn fill(&mut self, samples: [u32; REPLICATES], mut sum: impl FnMut(u32, u32, u32, u32) -> [f32; 4]) {
        for (replicate, samples) in (0..).zip(samples).filter(|&(_, samples)| samples > 0) {
            let entry = |tile| TileSamples { tile, replicate, first: self.replicate_samples(replicate, tile), samples };
            let work: Vec<_> = (0..self.tiles.count()).map(entry).collect();
            let sums = self.tiles.lanes(&work, |entry, (x, y)| sum(x, y, replicate, entry.samples));
            self.add(&work, &sums);
        }
    }

    fn cell(&self, replicate: u32, tile: u32) -> usize {
        replicate as usize * self.tiles.count() as usize + tile as usize
    }

    fn sum(&self, replicate: u32, tile: u32, lane: u32) -> &[f64; 4] {
        &self.sums[self.cell(replicate, tile) * TILE_PIXELS + lane as usize]
    }
}

/// A picture as light: not yet exposed, tone mapped or encoded.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Picture {
    /// Pixels across.
    pub width: u32,
    /// Pixels down.
    pub height: u32,
    /// Row by row from the top: radiance in linear Rec. 709, premultiplied by coverage, and coverage (0 to 1).
    pub pixels: Vec<[f32; 4]>,
}
