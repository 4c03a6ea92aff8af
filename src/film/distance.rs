//! How far a picture is from another that is known to be true.

use super::Picture;
use super::error::{BLOCK, Block, scale, typical_radiance};

impl Picture {
    /// Relative root mean square error against the truth, as `docs/accuracy.md` defines it.
    ///
    /// # Panics
    /// If the pictures differ in size.
    pub fn relative_rms_from(&self, truth: &Self) -> f64 {
        assert_eq!((self.width, self.height), (truth.width, truth.height), "pictures of one size");
        let (width, height) = (self.width as usize, self.height as usize);
        let across = width.div_ceil(BLOCK);
        let mut blocks = vec![Block::default(); across * height.div_ceil(BLOCK)];
        for (index, (ours, true_pixel)) in self.pixels.iter().zip(&truth.pixels).enumerate() {
            let block = &mut blocks[index / width / BLOCK * across + index % width / BLOCK];
            let mean = |value: &dyn Fn(usize) -> f64| (0..3).map(value).sum::<f64>() / 3.0;
            let radiance = mean(&|channel| f64::from(true_pixel[channel]));
            let square = mean(&|channel| (f64::from(ours[channel]) - f64::from(true_pixel[channel])).powi(2));
            *block = block.with((radiance, square));
        }
        let typical = typical_radiance(&blocks);
        let lit = blocks.iter().filter(|block| block.variance > 0.0);
        let sum: f64 = lit.map(|block| block.variance / scale(block, typical)).sum();
        (sum / self.pixels.len().max(1) as f64).sqrt()
    }

    /// Mean over pixels and colour channels of `(x - r)^2 / (r^2 + 0.01)`, the relative mean square error that
    /// renderers are often compared by (Rousselle et al. 2011, "Adaptive Sampling and Reconstruction using Greedy Error
    /// Minimization").
    ///
    /// # Panics
    /// If the pictures differ in size.
    pub fn rel_mse_from(&self, truth: &Self) -> f64 {
        assert_eq!((self.width, self.height), (truth.width, truth.height), "pictures of one size");
        let pairs = self.pixels.iter().flatten().zip(truth.pixels.iter().flatten());
        let colors = pairs.enumerate().filter(|(index, _)| index % 4 != 3);
        let sum: f64 = colors
            .map(|(_, (x, r))| {
                let (x, r) = (f64::from(*x), f64::from(*r));
                (x - r).powi(2) / (r * r + 0.01)
            })
            .sum();
        sum / (3 * self.pixels.len()).max(1) as f64
    }

    /// The mean of two pictures.
    ///
    /// # Panics
    /// If the pictures differ in size.
    pub fn mean_with(&self, other: &Self) -> Self {
        assert_eq!((self.width, self.height), (other.width, other.height), "pictures of one size");
        let mean = |(a, b): (&[f32; 4], &[f32; 4])| std::array::from_fn(|i| 0.5 * (a[i] + b[i]));
        Self { pixels: self.pixels.iter().zip(&other.pixels).map(mean).collect(), ..*self }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::film::Film;
    use crate::film::testing::{true_error, truth};

    #[test]
    fn is_the_definition_word_by_word() {
        let truth = truth(50, 21);
        let mut film = Film::new(50, 21);
        film.fill([1; 4], |x, y, replicate, _| {
            let value = (truth[(y * 50 + x) as usize] * (1.0 + 0.1 * f64::from(x % 3 + replicate))) as f32;
            [value, 0.5 * value, value, 1.0]
        });
        let pixels = truth.iter().map(|&r| [r as f32, r as f32, r as f32, 1.0]).collect();
        let ours = film.picture().relative_rms_from(&Picture { width: 50, height: 21, pixels });
        let words = true_error(&film);
        assert!((ours / words - 1.0).abs() < 1e-5, "{ours} for {words}");
    }

    #[test]
    fn relative_squares() {
        let picture = |value| Picture { width: 1, height: 1, pixels: vec![[value, value, value, 1.0]] };
        assert!((picture(1.1).rel_mse_from(&picture(1.0)) - 0.01 / 1.01).abs() < 1e-7);
        assert_eq!(picture(1.0).mean_with(&picture(0.0)), picture(0.5).mean_with(&picture(0.5)));
    }
}
