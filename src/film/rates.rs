//! How many samples each tile should get, relative to the others: measured once, at the pilot.
//!
//! The error is a mean of squares, so the samples of a tile should go with the standard deviation of its relative error
//! (Neyman 1934). What a tile has seen itself must not decide, or pixels that happened to miss a rare bright path would
//! get fewer samples and keep their fault: tiles of one colour of the chessboard are measured to allot the samples of the
//! other colour (docs/accuracy.md).

use super::error::{Block, scale, typical_radiance};
use super::{Film, REPLICATES, TILE_PIXELS};
use rayon::prelude::*;

/// Samples per replicate after which rates are measured.
pub const PILOT: u32 = 4;

/// Steps of a rate in an octave.
pub const STEPS: i32 = 4;

/// Largest rate, and the inverse of the smallest, in steps: 8.
pub const MOST: i32 = 3 * STEPS;

/// Pixels of average noise that every measured variance is mixed with, so that neither one bright pixel nor a quiet
/// neighbourhood is taken at its word.
const PRIOR_PIXELS: f64 = 8.0;

/// Times fewer samples that the rates must promise, or all tiles get the same: below that, counts that are not the best
/// for Sobol points, and noisy tiles whose samples take longer than those of the sky, eat the gain up.
const LEAST_GAIN: f64 = 1.1;

/// Weights of a neighbourhood of regions, by distance in x and in y: their product counts.
const WEIGHTS: [f64; 2] = [2.0, 1.0];

/// Squared relative errors, summed over pixels.
#[derive(Debug, Clone, Copy, Default)]
struct Noise {
    pixels: f64,
    sum: f64,
    sum_of_squares: f64,
}

impl Film {
    /// Rates by tile as steps of a quarter of an octave (4: twice the average), -12 to 12; none before the pilot.
    pub fn rates(&self) -> Option<&[i8]> {
        self.rates.as_deref()
    }

    /// Measures the rates if all tiles are just at the end of the pilot.
    pub(super) fn note_pilot(&mut self) {
        let at_pilot = |tile| {
            let counts = (0..REPLICATES as u32).map(|replicate| self.replicate_samples(replicate, tile));
            self.tiles.pixels(tile) == 0 || counts.into_iter().all(|count| count == PILOT)
        };
        if self.rates.is_none() && (0..self.tiles.count()).all(at_pilot) {
            self.rates = Some(self.measured_rates(|color| 1 - color));
        }
    }

    /// Rates by tile. `source`: the colour that is measured for the tiles of a colour.
    fn measured_rates(&self, source: fn(u32) -> u32) -> Vec<i8> {
        let mut rates = vec![0; self.tiles.count() as usize];
        for color in 0..2 {
            let around = self.neighbourhoods(&self.noise(source(color)));
            let weights: Vec<f64> = self.regions().map(|r| f64::from(self.tiles.pixels(2 * r + color))).collect();
            for (region, rate) in steps(&wanted(&around), &weights).into_iter().enumerate() {
                rates[2 * region + color as usize] = rate;
            }
        }
        rates
    }

    /// What must not be done: rates by the tiles' own samples.
    #[cfg(test)]
    pub(crate) fn let_tiles_rate_themselves(&mut self) {
        if self.rates.is_some() {
            self.rates = Some(self.measured_rates(|color| color));
        }
    }

    fn regions(&self) -> std::ops::Range<u32> {
        0..self.tiles.count() / 2
    }

    /// Noise of the tiles of one colour, by region.
    fn noise(&self, color: u32) -> Vec<Noise> {
        let block = |region| {
            let tile = 2 * region + color;
            let lanes = (0..TILE_PIXELS as u32).filter(move |&lane| self.tiles.pixel(tile, lane).is_some());
            lanes.map(|lane| self.pixel_statistics(tile, lane)).fold(Block::default(), Block::with)
        };
        let blocks: Vec<Block> = self.regions().into_par_iter().map(block).collect();
        let typical = typical_radiance(&blocks);
        let noise = |block: &Block| {
            let scale = scale(block, typical);
            let (sum, sum_of_squares) = if scale > 0.0 {
                (block.variance / scale, block.variance_squared / (scale * scale))
            } else {
                (0.0, 0.0)
            };
            Noise { pixels: block.pixels, sum, sum_of_squares }
        };
        blocks.iter().map(noise).collect()
    }

    /// Weighted sums over each region and its neighbours.
    fn neighbourhoods(&self, noise: &[Noise]) -> Vec<Noise> {
        let (across, down) = (self.tiles.regions_across(), self.tiles.regions_down());
        let around = |region: u32| {
            let (x, y) = (region % across, region / across);
            let mut total = Noise::default();
            for row in y.saturating_sub(1)..(y + 2).min(down) {
                for column in x.saturating_sub(1)..(x + 2).min(across) {
                    let weight = WEIGHTS[x.abs_diff(column) as usize] * WEIGHTS[y.abs_diff(row) as usize];
                    let part = noise[(row * across + column) as usize];
                    total.pixels += weight * part.pixels;
                    total.sum += weight * part.sum;
                    total.sum_of_squares += weight * weight * part.sum_of_squares;
                }
            }
            total
        };
        self.regions().map(around).collect()
    }
}

/// Standard deviations that samples should go with.
fn wanted(around: &[Noise]) -> Vec<f64> {
    let pixels: f64 = around.iter().map(|noise| noise.pixels).sum();
    let average = around.iter().map(|noise| noise.sum).sum::<f64>() / pixels.max(1.0);
    let mixed = |noise: &Noise| {
        let variance = noise.sum / noise.pixels.max(1.0);
        // What is above the average counts by the pixels that it is made of (Welch and Satterthwaite, as the bound of the
        // error), what is below by the pixels that were looked at.
        let sure =
            if variance > average { noise.sum * noise.sum / noise.sum_of_squares } else { noise.pixels / WEIGHTS[0] };
        ((sure * variance + PRIOR_PIXELS * average) / (sure + PRIOR_PIXELS)).sqrt()
    };
    around.iter().map(mixed).collect()
}

/// Rates as steps, such that their average by `weights` is 1.
fn steps(wanted: &[f64], weights: &[f64]) -> Vec<i8> {
    let step = |wanted: f64, unit: f64| {
        let step = (f64::from(STEPS) * (wanted / unit).log2()).round();
        step.clamp(f64::from(-MOST), f64::from(MOST)) as i32
    };
    let average = |unit: f64| {
        let rates = wanted.iter().map(|&wanted| (f64::from(step(wanted, unit)) / f64::from(STEPS)).exp2());
        rates.zip(weights).map(|(rate, weight)| rate * weight).sum::<f64>() / weights.iter().sum::<f64>()
    };
    let most = wanted.iter().copied().fold(0.0, f64::max);
    if most == 0.0 {
        return vec![0; wanted.len()];
    }
    // At the first unit the average is at least 1, at the second at most 1.
    let (mut low, mut high) = (most * 2f64.powi(-20), most * 2.0);
    for _ in 0..40 {
        let middle = (low * high).sqrt();
        if average(middle) >= 1.0 { low = middle } else { high = middle }
    }
    let rates: Vec<i8> = wanted.iter().map(|&wanted| step(wanted, low) as i8).collect();
    if gain(wanted, weights, &rates) < LEAST_GAIN { vec![0; wanted.len()] } else { rates }
}

/// Squared error of even samples over that of samples by rates.
fn gain(deviations: &[f64], weights: &[f64], rates: &[i8]) -> f64 {
    let rate = |&step: &i8| (f64::from(step) / f64::from(STEPS)).exp2();
    let squares = || deviations.iter().zip(weights).map(|(deviation, weight)| deviation * deviation * weight);
    let uneven: f64 = squares().zip(rates.iter().map(rate)).map(|(square, rate)| square / rate).sum();
    squares().sum::<f64>() / uneven
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mean_rate(rates: &[i8]) -> f64 {
        rates.iter().map(|&step| (f64::from(step) / 4.0).exp2()).sum::<f64>() / rates.len() as f64
    }

    #[test]
    fn rates_go_with_the_deviation_and_are_one_on_average() {
        let wanted = [1.0, 1.0, 1.0, 2.0, 4.0, 8.0];
        let rates = steps(&wanted, &[1.0; 6]);
        assert_eq!([rates[3] - rates[2], rates[4] - rates[3], rates[5] - rates[4]], [4, 4, 4], "octaves");
        assert!((mean_rate(&rates) - 1.0).abs() < 0.1, "{rates:?}");
        let extreme = steps(&[1e-9, 1e-9, 1e-9, 1.0], &[1.0; 4]);
        assert!(extreme.iter().all(|rate| rate.abs() <= MOST as i8), "{extreme:?}");
    }

    #[test]
    fn little_to_gain_is_not_worth_it() {
        assert_eq!(steps(&[1.0, 1.2, 0.9, 1.1], &[1.0; 4]), [0; 4]);
        assert_eq!(steps(&[0.0; 3], &[1.0; 3]), [0; 3]);
    }

    #[test]
    fn one_bright_pixel_is_not_taken_at_its_word() {
        let quiet = Noise { pixels: 576.0, sum: 5.76, sum_of_squares: 0.0576 };
        let firefly = Noise { pixels: 576.0, sum: 100.0, sum_of_squares: 1e4 };
        let noisy = Noise { pixels: 576.0, sum: 100.0, sum_of_squares: 100.0 * 100.0 / 500.0 };
        let around: Vec<Noise> = [quiet; 98].into_iter().chain([firefly, noisy]).collect();
        let wanted = wanted(&around);
        assert!(wanted[98] < 0.5 * wanted[99], "{} beside {}", wanted[98], wanted[99]);
    }
}
