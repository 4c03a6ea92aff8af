//! From a picture to what the network can read, and back.

use crate::film::{Guides, Picture};

/// Pixels around the picture, in which it is mirrored: beyond its edges the network sees black, which shows for some pixels (up to 7 % in the
/// corners of a white background), and small pictures have nothing else.
const BORDER: u32 = 16;

/// Radiance, in units of the picture's median, that the network is shown at the most: beside more it misjudges all else.
const BRIGHTEST: f32 = 1e5;

/// How a picture lies in the one that is denoised.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Frame {
    /// Pixels across.
    pub width: u32,
    /// Pixels down.
    pub height: u32,
    /// Of the picture itself.
    size: [u32; 2],
    /// Makes the median about 1, as the network is exact for so much alone; a power of two, so that it changes no digit.
    scale: f32,
}

impl Frame {
    /// For a picture; none: it is black.
    pub fn of(picture: &Picture) -> Option<Self> {
        let scale = (-median(picture)?.log2()).floor().clamp(-120.0, 120.0).exp2();
        let size = [picture.width, picture.height];
        let [width, height] = size.map(|side| side + 2 * BORDER);
        Some(Self { width, height, size, scale })
    }

    /// The light for the network.
    pub fn light(&self, picture: &Picture) -> Vec<[f32; 3]> {
        let scaled = |[r, g, b, _]: [f32; 4]| [r, g, b].map(|value| (value * self.scale).clamp(0.0, BRIGHTEST));
        self.mirrored(&picture.pixels).map(scaled).collect()
    }

    /// The guides for the network.
    pub fn guides(&self, guides: &Guides) -> Guides {
        Guides { albedo: self.mirrored(&guides.albedo).collect(), normal: self.mirrored(&guides.normal).collect() }
    }

    /// The picture with light of the network, where that could say anything; none: it has not made that many values, or some that
    /// are not finite.
    pub fn picture(&self, picture: &Picture, light: &[[f32; 3]]) -> Option<Picture> {
        let whole = light.len() == self.width as usize * self.height as usize;
        if !whole || light.iter().flatten().any(|value| !value.is_finite()) {
            return None;
        }
        let rows = light.chunks_exact(self.width as usize).skip(BORDER as usize).map(|row| &row[BORDER as usize..]);
        let rows = picture.pixels.chunks_exact(self.size[0] as usize).zip(rows);
        let pixel = |(raw, light): (&[f32; 4], &[f32; 3])| {
            let [r, g, b, coverage] = *raw;
            let blinding = r.max(g).max(b) * self.scale >= BRIGHTEST;
            let is_lamp = light[0].max(light[1]).max(light[2]) >= 0.5 * BRIGHTEST;
            // Nothing is there; or a lamp, of which the network was not shown all, rather than a stray sample.
            if coverage == 0.0 || blinding && is_lamp {
                return *raw;
            }
            let [r, g, b] = light.map(|value| value.max(0.0) / self.scale);
            [r, g, b, coverage]
        };
        let pixels = rows.flat_map(|(raw, light)| raw.iter().zip(light).map(pixel)).collect();
        Some(Picture { pixels, ..*picture })
    }

    /// Rows of the frame: those of the picture, mirrored at its edges.
    fn mirrored<T: Copy>(&self, pixels: &[T]) -> impl Iterator<Item = T> {
        let [width, height] = self.size;
        let place = |place: u32, side: u32| {
            // A whole number of there and back before the first pixel of the border.
            let place = (place + 2 * side * BORDER - BORDER) % (2 * side);
            place.min(2 * side - 1 - place)
        };
        let row = move |y: u32| (0..self.width).map(move |x| (place(y, height) * width + place(x, width)) as usize);
        (0..self.height).flat_map(row).map(|index| pixels[index])
    }
}

/// Of the pixels that are not black, their brightest channel; none: all are black.
fn median(picture: &Picture) -> Option<f32> {
    let brightest = picture.pixels.iter().map(|&[r, g, b, _]| r.max(g).max(b));
    let mut lit: Vec<f32> = brightest.filter(|value| *value > 0.0).collect();
    let middle = lit.len() / 2;
    (!lit.is_empty()).then(|| *lit.select_nth_unstable_by(middle, f32::total_cmp).1)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(width: u32, height: u32, value: f32) -> Picture {
        let pixels = (0..width * height).map(|i| [value * (i + 1) as f32, value, 0.0, 1.0]).collect();
        Picture { width, height, pixels }
    }

    #[test]
    fn what_goes_through_unchanged_comes_back_to_the_bit() {
        for (width, height, value) in [(1, 1, 0.5), (1, 70, 1e-12), (3, 2, 7.0), (33, 40, 1e-30), (64, 64, 1e12)] {
            let raw = picture(width, height, value);
            let frame = Frame::of(&raw).unwrap();
            assert_eq!((frame.width, frame.height), (width + 2 * BORDER, height + 2 * BORDER));
            let light = frame.light(&raw);
            assert_eq!(frame.picture(&raw, &light), Some(raw));
        }
    }

    #[test]
    fn small_pictures_are_mirrored_and_dim_ones_scaled() {
        let raw = picture(3, 1, 1e-9);
        let frame = Frame::of(&raw).unwrap();
        let light = frame.light(&raw);
        let first = BORDER as usize;
        let reds: Vec<f32> = light[first - 2..][..7].iter().map(|pixel| (pixel[0] / light[first][0]).round()).collect();
        assert_eq!(reds, [2.0, 1.0, 1.0, 2.0, 3.0, 3.0, 2.0]);
        assert!(light[0][0] > 0.5 && light[0][0] < 4.0, "{}", light[0][0]);
        let guides = Guides { albedo: vec![[0.5; 3]; 3], normal: vec![[0.0, 0.0, 1.0]; 3] };
        assert_eq!(frame.guides(&guides).albedo.len(), light.len());
    }

    #[test]
    fn nothing_blinding_light_and_faults_are_told_apart() {
        assert_eq!(Frame::of(&picture(4, 4, 0.0)), None);
        let mut raw = picture(32, 32, 1.0);
        (raw.pixels[0], raw.pixels[1], raw.pixels[2]) = ([1e30, 0.0, 0.0, 1.0], [0.0; 4], [1e30, 0.0, 0.0, 1.0]);
        let frame = Frame::of(&raw).unwrap();
        let mut light = frame.light(&raw);
        assert!(light.iter().flatten().all(|value| *value <= BRIGHTEST));
        light.fill([2.0, -1.0, 3.0]);
        light[(BORDER * frame.width + BORDER) as usize] = [0.8 * BRIGHTEST, 0.0, 0.0];
        let made = frame.picture(&raw, &light).unwrap();
        assert_eq!(
            made.pixels[..3],
            [[1e30, 0.0, 0.0, 1.0], [0.0; 4], [2.0 / frame.scale, 0.0, 3.0 / frame.scale, 1.0]]
        );
        light[5][1] = f32::NAN;
        assert_eq!(frame.picture(&raw, &light), None);
        assert_eq!(frame.picture(&raw, &light[1..]), None);
    }
}
