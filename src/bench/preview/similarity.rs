//! How far one picture is from another.

use crate::film::Picture;

/// Mean square error over the square of the reference's mean.
pub fn relative_mse(picture: &Picture, reference: &Picture) -> f64 {
    let mean = mean_radiance(reference);
    mean_square(picture, reference) / (mean * mean).max(f64::MIN_POSITIVE)
}

/// Mean luminance.
pub fn mean_radiance(picture: &Picture) -> f64 {
    mean(picture.pixels.iter().map(gray))
}

/// Root mean square error over the reference's mean.
pub fn relative_rmse(picture: &Picture, reference: &Picture) -> f64 {
    relative_mse(picture, reference).sqrt()
}

fn mean_square(picture: &Picture, reference: &Picture) -> f64 {
    let square = |(a, b): (&[f32; 4], &[f32; 4])| {
        (0..3).map(|channel| f64::from(a[channel] - b[channel]).powi(2)).sum::<f64>() / 3.0
    };
    mean(picture.pixels.iter().zip(&reference.pixels).map(square))
}

/// Light that a picture lacks where the reference is fully lit, and that it has where the reference is dark: self-shadowing and
/// leaks, each in parts of the light that reaches such places without any shadow.
pub fn acne_and_leak(picture: &Picture, reference: &Picture, unshadowed: &Picture) -> (f64, f64) {
    let (mut lacking, mut lit, mut leaked, mut dark) = (0.0, 0.0, 0.0, 0.0);
    for ((pixel, reference), open) in picture.pixels.iter().zip(&reference.pixels).zip(&unshadowed.pixels) {
        let (pixel, reference, open) = (gray(pixel), gray(reference), gray(open));
        if open <= 0.0 {
            continue;
        }
        if reference >= 0.999 * open {
            lacking += (reference - pixel).max(0.0);
            lit += open;
        } else if reference <= 0.001 * open {
            leaked += (pixel - reference).max(0.0);
            dark += open;
        }
    }
    (lacking / f64::max(lit, f64::MIN_POSITIVE), leaked / f64::max(dark, f64::MIN_POSITIVE))
}

/// Part of the pixels of which a channel differs by more than a step of 8 bits; where more than 1 is white, relative to that.
pub fn part_differing(a: &Picture, b: &Picture) -> f64 {
    let differs = |(a, b): (&[f32; 4], &[f32; 4])| {
        let differs = a.iter().zip(b).any(|(a, b)| (a - b).abs() > a.abs().max(1.0) / 255.0);
        f64::from(u8::from(differs))
    };
    mean(a.pixels.iter().zip(&b.pixels).map(differs))
}

fn gray(pixel: &[f32; 4]) -> f64 {
    0.2126 * f64::from(pixel[0]) + 0.7152 * f64::from(pixel[1]) + 0.0722 * f64::from(pixel[2])
}

fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0.0), |(sum, count), value| (sum + value, count + 1.0));
    sum / f64::max(count, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(value: impl Fn(u32, u32) -> f32) -> Picture {
        let pixels = (0..32).flat_map(|y| (0..32).map(move |x| (x, y))).map(|(x, y)| [value(x, y); 3]);
        Picture { width: 32, height: 32, pixels: pixels.map(|[r, g, b]| [r, g, b, 1.0]).collect() }
    }

    #[test]
    fn the_same_picture_is_the_same() {
        let a = picture(|x, y| (x * y) as f32 / 1024.0);
        assert_eq!(relative_rmse(&a, &a), 0.0);
    }

    #[test]
    fn differences_count() {
        let (a, b) = (picture(|_, _| 0.5), picture(|_, _| 0.6));
        assert!((relative_rmse(&b, &a) - 0.2).abs() < 1e-6);
    }

    #[test]
    fn acne_and_leaks_are_told_apart() {
        let open = picture(|_, _| 1.0);
        let reference = picture(|x, _| f32::from(u8::from(x < 16)));
        let spotted = picture(|x, y| if x < 16 { f32::from(u8::from(y % 4 > 0)) } else { 0.5 });
        let (acne, leak) = acne_and_leak(&spotted, &reference, &open);
        assert!((acne - 0.25).abs() < 1e-9 && (leak - 0.5).abs() < 1e-9, "{acne}, {leak}");
    }
}
