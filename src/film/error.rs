//! The measured error of a film; `docs/accuracy.md` defines it.

use super::{Film, REPLICATES};
use rayon::prelude::*;

/// Side in pixels of the blocks whose mean radiance an error is relative to.
pub(super) const BLOCK: usize = 8;

/// Part of the picture's typical radiance below which errors no longer count more for being in the dark.
const DARK: f64 = 0.1;

/// 95 % quantile of the normal distribution.
const Z_95: f64 = 1.644_853_626_951_473;

/// How far the picture is from the truth, measured from the spread of its replicates.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct ErrorEstimate {
    /// Root mean square error relative to the local radiance.
    pub relative_rms: f64,
    /// The error is below this with 95 % confidence.
    pub upper_bound_95: f64,
}

/// Sums over the pixels of one block.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Block {
    pub pixels: f64,
    /// Of the pixels' radiance, mean of the channels.
    pub radiance: f64,
    /// Of the pixels' variances, mean of the channels.
    pub variance: f64,
    pub variance_squared: f64,
}

impl Block {
    /// With one pixel more.
    pub fn with(self, (radiance, variance): (f64, f64)) -> Self {
        Self {
            pixels: self.pixels + 1.0,
            radiance: self.radiance + radiance,
            variance: self.variance + variance,
            variance_squared: self.variance_squared + variance * variance,
        }
    }
}

impl Film {
    /// The error of [`Film::picture`]; none while there is a pixel that fewer than two replicates have samples of.
    pub fn error(&self) -> Option<ErrorEstimate> {
        let used = self.used_replicates();
        if used < 2 {
            return None;
        }
        let blocks = self.blocks();
        let typical = typical_radiance(&blocks);
        let mut pixels = 0.0;
        let mut sum = 0.0;
        let mut sum_of_squares = 0.0;
        for block in &blocks {
            pixels += block.pixels;
            let scale = scale(block, typical);
            if block.variance > 0.0 && scale > 0.0 {
                sum += block.variance / scale;
                sum_of_squares += block.variance_squared / (scale * scale);
            }
        }
        if sum == 0.0 {
            return Some(ErrorEstimate { relative_rms: 0.0, upper_bound_95: 0.0 });
        }
        let relative_rms = (sum / pixels).sqrt();
        // Welch-Satterthwaite: of how many equal, independent, normal pixels would the sum spread as much?
        let effective_pixels = sum * sum / sum_of_squares;
        let bound = f_quantile_95(effective_pixels, effective_pixels * (used - 1) as f64);
        Some(ErrorEstimate { relative_rms, upper_bound_95: relative_rms * bound.sqrt() })
    }

    /// Replicates that have samples, where that is fewest.
    pub(super) fn used_replicates(&self) -> usize {
        let used = |tile| (0..REPLICATES as u32).filter(|&r| self.replicate_samples(r, tile) > 0).count();
        let tiles = 0..self.tiles.count();
        tiles.filter(|&tile| self.tiles.pixels(tile) > 0).map(used).min().unwrap_or(0)
    }

    fn blocks(&self) -> Vec<Block> {
        let (width, height) = (self.width() as usize, self.height() as usize);
        (0..height.div_ceil(BLOCK))
            .into_par_iter()
            .flat_map_iter(|row| {
                let mut blocks = vec![Block::default(); width.div_ceil(BLOCK)];
                for y in row * BLOCK..((row + 1) * BLOCK).min(height) {
                    for x in 0..width {
                        let (tile, lane) = self.tiles.place(x as u32, y as u32);
                        blocks[x / BLOCK] = blocks[x / BLOCK].with(self.pixel_statistics(tile, lane));
                    }
                }
                blocks
            })
            .collect()
    }

    /// Mean of a pixel and variance of that mean, averaged over the channels.
    pub(super) fn pixel_statistics(&self, tile: u32, lane: u32) -> (f64, f64) {
        let (means, variances) = self.pixel_moments(tile, lane);
        (means.iter().sum::<f64>() / 3.0, variances.iter().sum::<f64>() / 3.0)
    }

    /// Mean of a pixel and variance of that mean, by channel. With `n_r` samples of mean `m_r` in replicate r, `n` in all
    /// and mean m, the variance is `sum_r n_r (m_r - m)^2 / ((used - 1) n)`.
    pub(super) fn pixel_moments(&self, tile: u32, lane: u32) -> ([f64; 3], [f64; 3]) {
        let mut sums = [0.0; 3];
        let mut squares = [0.0; 3];
        let mut samples = 0.0;
        let mut used = 0.0;
        for replicate in 0..REPLICATES as u32 {
            let count = f64::from(self.replicate_samples(replicate, tile));
            if count == 0.0 {
                continue;
            }
            samples += count;
            used += 1.0;
            for (channel, sum) in self.sum(replicate, tile, lane)[..3].iter().enumerate() {
                sums[channel] += sum;
                squares[channel] += sum * sum / count;
            }
        }
        let mut variances = [0.0; 3];
        for channel in 0..3 {
            // The difference cancels to rounding noise where replicates agree: what is below that noise is zero.
            let spread = squares[channel] - sums[channel] * sums[channel] / samples;
            if spread > squares[channel] * (REPLICATES as f64 * f64::EPSILON) {
                variances[channel] = spread / ((used - 1.0) * samples);
            }
        }
        (sums.map(|sum| sum / samples), variances)
    }
}

/// Square of the radiance that errors in a block are relative to.
pub(super) fn scale(block: &Block, typical: f64) -> f64 {
    (block.radiance / block.pixels.max(1.0)).powi(2) + (DARK * typical).powi(2)
}

/// Median over the blocks that are not black of their mean radiance: unlike a mean, not moved by a lamp in the picture.
pub(super) fn typical_radiance(blocks: &[Block]) -> f64 {
    let mut means: Vec<f64> =
        blocks.iter().map(|b| b.radiance / b.pixels.max(1.0)).filter(|&mean| mean > 0.0).collect();
    if means.is_empty() {
        return 0.0;
    }
    let middle = means.len() / 2;
    *means.select_nth_unstable_by(middle, f64::total_cmp).1
}

/// 95 % quantile of the F distribution: Paulson 1942, "An Approximate Normalization of the Analysis of Variance
/// Distribution", solved for F. Good to a few per cent for `d2 >= 3`, and too high below that.
fn f_quantile_95(d1: f64, d2: f64) -> f64 {
    let (a, b) = (2.0 / (9.0 * d2), 2.0 / (9.0 * d1));
    let quadratic = (1.0 - a).powi(2) - Z_95 * Z_95 * a;
    let linear = (1.0 - a) * (1.0 - b);
    let constant = (1.0 - b).powi(2) - Z_95 * Z_95 * b;
    ((linear + (linear * linear - quadratic * constant).sqrt()) / quadratic).powi(3)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::film::testing::{Noise, Random, gaussian, log_normal, true_error, truth};

    fn noisy(size: (u32, u32), samples: [u32; REPLICATES], noise: Noise, seed: u64) -> Film {
        let mut random = Random(seed);
        let truth = truth(size.0, size.1);
        let mut film = Film::new(size.0, size.1);
        film.fill(samples, |x, y, _, count| {
            let radiance = truth[(y * size.0 + x) as usize];
            let mut sample = || (0..count).map(|_| (radiance * noise(&mut random)) as f32).sum::<f32>();
            [sample(), sample(), sample(), count as f32]
        });
        film
    }

    #[test]
    fn the_stated_error_is_the_true_error() {
        for (noise, tolerance) in [(gaussian as Noise, 0.02), (log_normal, 0.05)] {
            for samples in [[1; 4], [4; 4], [16, 16, 8, 8], [9, 9, 0, 9]] {
                let film = noisy((160, 100), samples, noise, 7);
                let (stated, real) = (film.error().unwrap().relative_rms, true_error(&film));
                assert!((stated / real - 1.0).abs() < tolerance, "{samples:?}: stated {stated}, true {real}");
            }
        }
    }

    #[test]
    fn the_bound_holds_in_95_of_100_renders() {
        for (name, noise) in [("gaussian", gaussian as Noise), ("log-normal", log_normal)] {
            for (size, samples) in [((1, 1), 8), ((3, 3), 4), ((16, 16), 4), ((64, 48), 2)] {
                let trials = 400;
                let held = (0..trials)
                    .filter(|&trial| {
                        let film = noisy(size, [samples; 4], noise, 1000 + trial);
                        true_error(&film) <= film.error().unwrap().upper_bound_95
                    })
                    .count();
                let share = held as f64 / trials as f64;
                eprintln!("{name} {size:?} x {samples}: {share}");
                assert!(share >= 0.95, "{name} noise, {size:?} pixels: the bound held in {share} of the renders");
            }
        }
    }

    #[test]
    fn exposure_does_not_change_the_error() {
        let error = |exposure: f32| {
            let mut film = Film::new(16, 16);
            film.fill([1; REPLICATES], |_, _, replicate, _| {
                let value = exposure * (1.0 + 0.1 * replicate as f32);
                [value, value, value, 1.0]
            });
            film.error().unwrap().relative_rms
        };
        assert!((error(1.0) / error(1024.0) - 1.0).abs() < 1e-6);
        assert!((error(1.0) / error(1e-6) - 1.0).abs() < 1e-6);
    }

    #[test]
    fn agreement_and_blackness_are_no_error() {
        let mut film = Film::new(9, 9);
        assert_eq!(film.error(), None);
        let mut add = |samples| {
            film.fill(samples, |_, _, _, _| [0.3, 0.6, 0.9, 3.0]);
            film.error()
        };
        assert_eq!(add([3, 0, 0, 0]), None, "one replicate has no spread");
        assert_eq!(add([0, 3, 0, 0]), Some(ErrorEstimate { relative_rms: 0.0, upper_bound_95: 0.0 }));
    }

    #[test]
    fn quantiles_of_f_are_those_of_the_tables() {
        for (d1, d2, table) in [(1.0, 3.0, 10.13), (3.0, 9.0, 3.86), (10.0, 30.0, 2.16), (40.0, 120.0, 1.50)] {
            let ours = f_quantile_95(d1, d2);
            assert!((ours / table - 1.0).abs() < 0.05, "F({d1}, {d2}) = {table}, here {ours}");
        }
    }
}
