//! Two ways to the same picture: which is faster, and whether it is the same.

use crate::bench::clock::{self, Clock};
use crate::film::Picture;
use crate::render::{Engine, RenderError, Work};
use std::fmt;

/// Side of the blocks of pixels whose means are compared.
const BLOCK: usize = 16;
/// Share of a block's light that rounding may move.
const ROUNDING: f64 = 1e-6;
/// Standard deviations beyond which a difference is no accident.
const DEVIATIONS: f64 = 4.0;

/// A picture with and without work that it does not need.
pub struct Pair {
    /// The work.
    pub what: &'static str,
    /// Scene, in words.
    pub scene: &'static str,
    /// As renders are.
    pub lean: Work,
    /// With the work.
    pub full: Work,
}

/// A row of the table.
pub struct Row<'a> {
    pair: &'a Pair,
    /// Seconds.
    lean: f64,
    full: f64,
    equality: Equality,
}

/// Traces both ways in turns; the first round warms up and does not count.
pub fn trace<'a>(engine: &mut dyn Engine, clock: Clock, pair: &'a Pair, rounds: u32) -> Result<Row<'a>, RenderError> {
    let (mut lean, mut full) = (Side::default(), Side::default());
    for seed in 0..=rounds {
        for (side, work) in [(&mut full, &pair.full), (&mut lean, &pair.lean)] {
            let (picture, seconds) = picture(engine, clock, work, seed)?;
            if seed > 0 {
                side.add(picture, seconds);
            }
        }
    }
    let equality = Equality::of(&full.pictures, &lean.pictures);
    Ok(Row { pair, lean: lean.best, full: full.best, equality })
}

/// The picture of a seed, and the seconds that tracing took.
pub fn picture(engine: &mut dyn Engine, clock: Clock, work: &Work, seed: u32) -> Result<(Picture, f64), RenderError> {
    let mut work = work.clone();
    work.settings.seed = seed;
    clock::trace(engine, clock, &work)
}

/// Rounds of one way.
struct Side {
    pictures: Vec<Picture>,
    best: f64,
}

impl Default for Side {
    fn default() -> Self {
        Self { pictures: Vec::new(), best: f64::INFINITY }
    }
}

impl Side {
    fn add(&mut self, picture: Picture, seconds: f64) {
        self.pictures.push(picture);
        self.best = self.best.min(seconds);
    }
}

impl fmt::Display for Row<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [full, lean] = [self.full, self.lean].map(|seconds| seconds * 1e3);
        let (Pair { what, scene, .. }, equality) = (self.pair, self.equality);
        write!(f, "| {what} | {scene} | {full:.0} | {lean:.0} | {:.2} | {equality} |", full / lean)
    }
}

/// Whether two ways show the same.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Equality {
    /// Bit for bit.
    Bits,
    /// But for noise or rounding: squared difference of block means over what noise explains, expected 1.
    Noise(f64),
    /// No: the same measure.
    Different(f64),
}

impl Equality {
    /// Compares pictures of the same seeds, two or more. Not bit for bit, the differences of the means of blocks of
    /// pixels are tested for a mean of zero against their spread over the seeds, all blocks at once.
    pub fn of(a: &[Picture], b: &[Picture]) -> Self {
        if a == b {
            return Self::Bits;
        }
        let blocks: Vec<Block> = (0..block_count(&a[0])).map(|index| Block::new(a, b, index)).collect();
        let typical = median(blocks.iter().map(|block| block.level).collect());
        let unit = |block: &Block| block.level.powi(2) + (0.1 * typical).powi(2);
        let found: f64 = blocks.iter().map(|block| block.mean.powi(2) / unit(block)).sum();
        let explained: Vec<f64> =
            blocks.iter().map(|block| block.variance / unit(block) + ROUNDING * ROUNDING).collect();
        let sum: f64 = explained.iter().sum();
        // Degrees of freedom by Welch and Satterthwaite: a few bright blocks may make up most of the sum.
        let freedom = sum * sum / explained.iter().map(|e| e * e).sum::<f64>();
        let seeds = a.len() as f64;
        let deviation = (2.0 / freedom + 2.0 / (freedom * (seeds - 1.0))).sqrt();
        let ratio = found / sum;
        // Written so that NaN is a difference.
        if ratio <= 1.0 + DEVIATIONS * deviation { Self::Noise(ratio) } else { Self::Different(ratio) }
    }
}

impl fmt::Display for Equality {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Bits => write!(f, "same bits"),
            Self::Noise(ratio) => write!(f, "same but for noise ({ratio:.2})"),
            Self::Different(ratio) => write!(f, "**DIFFERENT** ({ratio:.2})"),
        }
    }
}

/// A block of pixels in two series of pictures.
struct Block {
    /// Mean radiance in the first series.
    level: f64,
    /// Mean of the differences.
    mean: f64,
    /// Variance of that mean.
    variance: f64,
}

impl Block {
    fn new(a: &[Picture], b: &[Picture], index: usize) -> Self {
        let seeds = a.len() as f64;
        let differences: Vec<f64> = a.iter().zip(b).map(|(a, b)| block_mean(a, index) - block_mean(b, index)).collect();
        let mean = differences.iter().sum::<f64>() / seeds;
        let spread: f64 = differences.iter().map(|d| (d - mean).powi(2)).sum();
        let level = a.iter().map(|a| block_mean(a, index)).sum::<f64>() / seeds;
        Self { level, mean, variance: spread / (seeds - 1.0) / seeds }
    }
}

fn blocks_across(picture: &Picture) -> usize {
    (picture.width as usize).div_ceil(BLOCK)
}

fn block_count(picture: &Picture) -> usize {
    blocks_across(picture) * (picture.height as usize).div_ceil(BLOCK)
}

fn block_mean(picture: &Picture, index: usize) -> f64 {
    let (width, height) = (picture.width as usize, picture.height as usize);
    let (left, top) = (index % blocks_across(picture) * BLOCK, index / blocks_across(picture) * BLOCK);
    let (right, bottom) = ((left + BLOCK).min(width), (top + BLOCK).min(height));
    let rows = (top..bottom).map(|y| &picture.pixels[y * width + left..y * width + right]);
    let sum: f64 = rows.flatten().map(|[r, g, b, _]| f64::from(r + g + b) / 3.0).sum();
    sum / ((right - left) * (bottom - top)) as f64
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Noise of deviation 0.3 around a gradient times `gain`.
    fn pictures(salt: u32, gain: f32) -> Vec<Picture> {
        let random = |index: u32| {
            let word = (index ^ salt.wrapping_mul(0x9e37_79b9)).wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
            let word = ((word >> ((word >> 28) + 4)) ^ word).wrapping_mul(277_803_737);
            ((word >> 22) ^ word) as f32 / u32::MAX as f32 - 0.5
        };
        let pixel = |index: u32| [gain * (1.0 + (index % 128) as f32 / 128.0 + random(index)); 4];
        let picture = |seed: u32| Picture {
            width: 128,
            height: 128,
            pixels: (0..128 * 128).map(|index| pixel(seed * 128 * 128 + index)).collect(),
        };
        (0..4).map(picture).collect()
    }

    #[test]
    fn the_same_is_the_same() {
        assert_eq!(Equality::of(&pictures(1, 1.0), &pictures(1, 1.0)), Equality::Bits);
        for salt in 2..12 {
            let equality = Equality::of(&pictures(1, 1.0), &pictures(salt, 1.0));
            assert!(matches!(equality, Equality::Noise(ratio) if ratio > 0.4), "{equality}");
        }
    }

    #[test]
    fn a_difference_below_the_noise_of_a_pixel_is_seen() {
        for salt in 1..12 {
            let equality = Equality::of(&pictures(1, 1.0), &pictures(salt, 1.02));
            assert!(matches!(equality, Equality::Different(_)), "{equality}");
        }
    }

    #[test]
    fn rounding_is_no_difference_and_nan_is() {
        let equality = Equality::of(&pictures(1, 1.0), &pictures(1, 1.0 + 1e-7));
        assert!(matches!(equality, Equality::Noise(_)), "{equality}");
        assert!(matches!(Equality::of(&pictures(1, 1.0), &pictures(1, f32::NAN)), Equality::Different(_)));
    }
}
