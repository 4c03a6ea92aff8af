//! Pictures whose truth is known, for tests of what a film says of itself.

use super::Film;

/// SplitMix64 (Steele, Lea, Flood 2014).
pub(crate) struct Random(pub u64);

impl Random {
    pub fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        (((z ^ (z >> 31)) >> 11) as f64 + 0.5) / (1u64 << 53) as f64
    }

    pub fn normal(&mut self) -> f64 {
        (-2.0 * self.uniform().ln()).sqrt() * (std::f64::consts::TAU * self.uniform()).cos()
    }
}

/// Noise of mean 1 that a sample is multiplied with.
pub(crate) type Noise = fn(&mut Random) -> f64;

pub(crate) fn gaussian(random: &mut Random) -> f64 {
    1.0 + random.normal()
}

/// Long-tailed, like paths that seldom find a light: e^(sigma x - sigma^2 / 2), sigma = 1.2.
pub(crate) fn log_normal(random: &mut Random) -> f64 {
    (1.2 * random.normal() - 0.72).exp()
}

/// One in a thousand samples has all the light.
pub(crate) fn spikes(random: &mut Random) -> f64 {
    if random.uniform() < 1e-3 { 1e3 } else { 0.0 }
}

/// A gradient with a black quarter and a small lamp.
pub(crate) fn truth(width: u32, height: u32) -> Vec<f64> {
    let pixel = |x: u32, y: u32| match (x, y) {
        (x, y) if x < width / 2 && y < height / 2 => 0.0,
        (x, y) if x + 8 >= width && y + 8 >= height => 1e4,
        _ => 0.05 + f64::from(x) / f64::from(width),
    };
    (0..height).flat_map(|y| (0..width).map(move |x| pixel(x, y))).collect()
}

/// The definition in docs/accuracy.md, word by word, with the truth at hand.
pub(crate) fn true_error(film: &Film) -> f64 {
    let (width, height) = (film.width() as usize, film.height() as usize);
    let truth = truth(film.width(), film.height());
    let picture = film.picture();
    let mut blocks: Vec<(f64, f64, f64)> = Vec::new();
    for top in (0..height).step_by(8) {
        for left in (0..width).step_by(8) {
            let (mut n, mut radiance, mut squares) = (0.0, 0.0, 0.0);
            for y in top..(top + 8).min(height) {
                for x in left..(left + 8).min(width) {
                    let r = truth[y * width + x];
                    let pixel = picture.pixels[y * width + x];
                    n += 1.0;
                    radiance += r;
                    squares += (0..3).map(|c| (f64::from(pixel[c]) - r).powi(2)).sum::<f64>() / 3.0;
                }
            }
            blocks.push((n, radiance / n, squares));
        }
    }
    let mut means: Vec<f64> = blocks.iter().map(|b| b.1).filter(|&m| m > 0.0).collect();
    means.sort_by(f64::total_cmp);
    let typical = means[means.len() / 2];
    let pixels: f64 = blocks.iter().map(|b| b.0).sum();
    (blocks.iter().map(|b| b.2 / (b.1 * b.1 + 0.01 * typical * typical)).sum::<f64>() / pixels).sqrt()
}
