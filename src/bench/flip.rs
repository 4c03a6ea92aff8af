//! FLIP (Andersson, Nilsson, Akenine-Möller, Oskarsson, Åström and Fairchild 2020, "FLIP: A Difference Evaluator for Alternating
//! Images"): how strong a difference a person sees who flips between two pictures, 0 none, 1 the largest.
//!
//! Its form for displayed pictures, at the paper's usual distance. Sections and symbols are the paper's. All filters are
//! separable: sums of Gaussians, and the first and second derivative of one.

use crate::film::Picture;
use glam::{DMat3, DVec3};
use std::f64::consts::PI;

/// Pixels per degree: a screen 0.7 m wide of 3,840 pixels, seen from 0.7 m.
const PIXELS_PER_DEGREE: f64 = 3840.0 * PI / 180.0;

/// Contrast sensitivity as `a sqrt(pi / b) exp(-pi^2 x^2 / b)` over degrees (section 4.1.1, table 1): achromatic, red-green, and the two
/// terms of blue-yellow.
const ACHROMATIC: (f64, f64) = (1.0, 0.0047);
const RED_GREEN: (f64, f64) = (1.0, 0.0053);
const BLUE_YELLOW: [(f64, f64); 2] = [(34.1, 0.04), (13.5, 0.025)];
/// The widest of them, which all windows follow.
const WIDEST: f64 = 0.04;

/// Exponent of colour differences (section 4.1.3).
const COLOR_EXPONENT: f64 = 0.7;
/// Part of the largest colour difference that is mapped to [`BEND_VALUE`].
const BEND: f64 = 0.4;
const BEND_VALUE: f64 = 0.95;
/// Width of the feature detectors in degrees (section 4.2).
const FEATURE_WIDTH: f64 = 0.082;
/// Exponent of feature differences.
const FEATURE_EXPONENT: f64 = 0.5;

/// Mean over the pixels of two pictures of one size, clipped to what a screen shows.
///
/// # Panics
/// If the pictures differ in size.
pub fn flip(picture: &Picture, reference: &Picture) -> f64 {
    assert_eq!((picture.width, picture.height), (reference.width, reference.height), "pictures of one size");
    let (a, b) = (Seen::new(picture), Seen::new(reference));
    let largest = color_distance(hunt_lab(DVec3::Y), hunt_lab(DVec3::Z)).powf(COLOR_EXPONENT);
    let difference = |i: usize| {
        let color = redistribute(color_distance(a.colors[i], b.colors[i]).powf(COLOR_EXPONENT), largest);
        let feature = (a.edges[i] - b.edges[i]).abs().max((a.points[i] - b.points[i]).abs());
        color.powf(1.0 - (feature / 2f64.sqrt()).powf(FEATURE_EXPONENT).min(1.0))
    };
    (0..a.colors.len()).map(difference).sum::<f64>() / a.colors.len().max(1) as f64
}

/// What the eye makes of a picture.
struct Seen {
    /// L*a*b* after contrast sensitivity and Hunt's effect.
    colors: Vec<DVec3>,
    /// Magnitudes of edges and points.
    edges: Vec<f64>,
    points: Vec<f64>,
}

impl Seen {
    fn new(picture: &Picture) -> Self {
        let shown = |pixel: &[f32; 4]| DVec3::from_array([0, 1, 2].map(|i| f64::from(pixel[i]).clamp(0.0, 1.0)));
        let opponent: Vec<DVec3> = picture.pixels.iter().map(|pixel| to_opponent(shown(pixel))).collect();
        let plane = |channel: usize| Plane {
            width: picture.width as usize,
            values: opponent.iter().map(|color| color[channel]).collect(),
        };
        let filtered = [
            sensitivity(&plane(0), &[ACHROMATIC]),
            sensitivity(&plane(1), &[RED_GREEN]),
            sensitivity(&plane(2), &BLUE_YELLOW),
        ];
        let color = |i: usize| DVec3::from_array([0, 1, 2].map(|channel| filtered[channel].values[i]));
        let colors = (0..opponent.len()).map(|i| hunt_lab(from_opponent(color(i)).clamp(DVec3::ZERO, DVec3::ONE)));
        let mut gray = plane(0);
        gray.values.iter_mut().for_each(|y| *y = (*y + 16.0) / 116.0);
        let (edges, points) = features(&gray);
        Self { colors: colors.collect(), edges, points }
    }
}

/// One channel, row by row.
struct Plane {
    width: usize,
    values: Vec<f64>,
}

impl Plane {
    /// Convolution with one kernel across and one down; beyond the border its pixels go on.
    fn filtered(&self, across: &[f64], down: &[f64]) -> Self {
        let (width, height) = (self.width, self.values.len() / self.width.max(1));
        let place = |at: usize, tap: usize, taps: usize, end: usize| (at + tap).saturating_sub(taps / 2).min(end - 1);
        let mut rows = Vec::with_capacity(self.values.len());
        for row in self.values.chunks(width) {
            rows.extend((0..width).map(|x| {
                across.iter().enumerate().map(|(tap, k)| k * row[place(x, tap, across.len(), width)]).sum::<f64>()
            }));
        }
        let at = |x: usize, y: usize| -> f64 {
            down.iter().enumerate().map(|(tap, k)| k * rows[place(y, tap, down.len(), height) * width + x]).sum()
        };
        Self {
            width,
            values: (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).map(|(x, y)| at(x, y)).collect(),
        }
    }
}

/// Section 4.1.1: a mean weighted by a sum of Gaussians.
fn sensitivity(plane: &Plane, terms: &[(f64, f64)]) -> Plane {
    let radius = (3.0 * (WIDEST / (2.0 * PI * PI)).sqrt() * PIXELS_PER_DEGREE).ceil() as i32;
    let mut sum = vec![0.0; plane.values.len()];
    let mut total = 0.0;
    for &(a, b) in terms {
        let kernel = taps(radius, |x| (-PI * PI * (x / PIXELS_PER_DEGREE).powi(2) / b).exp());
        let weight = a * (PI / b).sqrt();
        total += weight * kernel.iter().sum::<f64>().powi(2);
        let filtered = plane.filtered(&kernel, &kernel);
        sum.iter_mut().zip(filtered.values).for_each(|(sum, value)| *sum += weight * value);
    }
    sum.iter_mut().for_each(|value| *value /= total);
    Plane { width: plane.width, values: sum }
}

/// Section 4.2: magnitudes of the first and of the second derivative of a Gaussian, across and down.
fn features(gray: &Plane) -> (Vec<f64>, Vec<f64>) {
    let deviation = 0.5 * FEATURE_WIDTH * PIXELS_PER_DEGREE;
    let radius = (3.0 * deviation).ceil() as i32;
    let gaussian = |x: f64| (-0.5 * (x / deviation).powi(2)).exp();
    let smooth = balanced(taps(radius, gaussian));
    let edge = balanced(taps(radius, |x| -x * gaussian(x)));
    let point = balanced(taps(radius, |x| ((x / deviation).powi(2) - 1.0) * gaussian(x)));
    let magnitude = |kernel: &[f64]| {
        let (across, down) = (gray.filtered(kernel, &smooth), gray.filtered(&smooth, kernel));
        across.values.iter().zip(&down.values).map(|(x, y)| x.hypot(*y)).collect()
    };
    (magnitude(&edge), magnitude(&point))
}

fn taps(radius: i32, weight: impl Fn(f64) -> f64) -> Vec<f64> {
    (-radius..=radius).map(|x| weight(f64::from(x))).collect()
}

/// Positive weights have a sum of 1, negative ones of -1.
fn balanced(mut kernel: Vec<f64>) -> Vec<f64> {
    let positive: f64 = kernel.iter().filter(|k| **k > 0.0).sum();
    let negative: f64 = kernel.iter().filter(|k| **k < 0.0).sum();
    kernel.iter_mut().for_each(|k| *k /= if *k > 0.0 { positive } else { -negative.min(-f64::MIN_POSITIVE) });
    kernel
}

/// Section 4.1.3: what lies below a part of the largest difference takes most of the range.
fn redistribute(difference: f64, largest: f64) -> f64 {
    let bend = BEND * largest;
    if difference < bend {
        BEND_VALUE * difference / bend
    } else {
        BEND_VALUE + (1.0 - BEND_VALUE) * (difference - bend) / (largest - bend)
    }
}

/// HyAB (Abasi, Tehran and Fairchild 2020).
fn color_distance(a: DVec3, b: DVec3) -> f64 {
    let d = a - b;
    d.x.abs() + d.y.hypot(d.z)
}

/// XYZ of linear sRGB (IEC 61966-2-1), in parts of its white.
fn relative_xyz() -> DMat3 {
    let xyz = DMat3::from_cols_array(&[
        0.412_390_8,
        0.212_639,
        0.019_330_8,
        0.357_584_3,
        0.715_168_7,
        0.119_194_8,
        0.180_480_8,
        0.072_192_3,
        0.950_532_2,
    ]);
    DMat3::from_diagonal((xyz * DVec3::ONE).recip()) * xyz
}

/// YCxCz: the linear form of L*a*b*.
fn to_opponent(rgb: DVec3) -> DVec3 {
    let t = relative_xyz() * rgb;
    DVec3::new(116.0 * t.y - 16.0, 500.0 * (t.x - t.y), 200.0 * (t.y - t.z))
}

fn from_opponent(color: DVec3) -> DVec3 {
    let y = (color.x + 16.0) / 116.0;
    relative_xyz().inverse() * DVec3::new(y + color.y / 500.0, y, y - color.z / 200.0)
}

/// L*a*b* of a linear colour, whose chroma counts by its lightness (section 4.1.2).
fn hunt_lab(rgb: DVec3) -> DVec3 {
    const DELTA: f64 = 6.0 / 29.0;
    let root = |t: f64| if t > DELTA.powi(3) { t.cbrt() } else { t / (3.0 * DELTA * DELTA) + 4.0 / 29.0 };
    let [x, y, z] = (relative_xyz() * rgb).to_array().map(root);
    let lightness = 116.0 * y - 16.0;
    DVec3::new(lightness, 5.0 * lightness * (x - y), 2.0 * lightness * (y - z))
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIDE: u32 = 48;

    fn picture(color: impl Fn(u32, u32) -> [f32; 3]) -> Picture {
        let places = (0..SIDE).flat_map(|y| (0..SIDE).map(move |x| (x, y)));
        let pixels = places.map(|(x, y)| color(x, y)).map(|[r, g, b]| [r, g, b, 1.0]).collect();
        Picture { width: SIDE, height: SIDE, pixels }
    }

    fn even(color: [f32; 3]) -> Picture {
        picture(|_, _| color)
    }

    #[test]
    fn the_same_is_no_difference() {
        let a = picture(|x, y| [x as f32 / 48.0, y as f32 / 48.0, (x ^ y) as f32 / 64.0]);
        assert_eq!(flip(&a, &a), 0.0);
        // Beyond white a screen shows white.
        assert!(flip(&even([1.0; 3]), &even([7.0; 3])) < 1e-12);
    }

    /// The largest difference is defined as that of green and blue; black and white are 100 of L* apart, whose 0.7th power lies beyond
    /// the bend; small even differences are linear in their 0.7th power.
    #[test]
    fn even_colors_have_their_closed_form() {
        let (green, blue) = ([0.0, 1.0, 0.0], [0.0, 0.0, 1.0]);
        assert!((flip(&even(green), &even(blue)) - 1.0).abs() < 1e-9);
        let largest = color_distance(hunt_lab(DVec3::Y), hunt_lab(DVec3::Z)).powf(0.7);
        let expected = 0.95 + 0.05 * (100f64.powf(0.7) - 0.4 * largest) / (0.6 * largest);
        let found = flip(&even([0.0; 3]), &even([1.0; 3]));
        assert!((found - expected).abs() < 1e-6 && (found - 0.967).abs() < 5e-4, "{found} for {expected}");
        // L* of 50 and 51.
        let gray = |l: f64| [((l + 16.0) / 116.0).powi(3) as f32; 3];
        let found = flip(&even(gray(50.0)), &even(gray(51.0)));
        let expected = 0.95 / (0.4 * largest);
        assert!((found / expected - 1.0).abs() < 1e-4, "{found} for {expected}");
    }

    /// Values of the authors' own program (flip-evaluator 1.x) for the same pictures.
    #[test]
    fn the_authors_find_the_same() {
        let a = picture(|x, y| [(x % 7) as f32 / 7.0, (y % 5) as f32 / 5.0, 0.3]);
        let b = picture(|x, y| [((x + y) % 7) as f32 / 7.0, 0.4, (x % 3) as f32 / 3.0]);
        let c = picture(|x, y| [x as f32 / 48.0, y as f32 / 48.0, (x ^ y) as f32 / 64.0]);
        let d = picture(|x, y| [x as f32 / 48.0 * 0.9, y as f32 / 48.0, (x ^ y) as f32 / 64.0 * 0.8 + 0.05]);
        let disk =
            |x: u32, y: u32, at: f32| f32::from(u8::from((x as f32 - at).powi(2) + (y as f32 - 20.0).powi(2) < 100.0));
        let e = picture(|x, y| [0.2 + 0.6 * disk(x, y, 24.0), 0.3, 0.5 - 0.3 * disk(x, y, 24.0)]);
        let f = picture(|x, y| [0.2 + 0.6 * disk(x, y, 26.0), 0.3, 0.5 - 0.3 * disk(x, y, 24.0)]);
        for (one, other, expected) in [(&a, &b, 0.473_652), (&c, &d, 0.193_135), (&e, &f, 0.051_928)] {
            let found = flip(one, other);
            assert!((found - expected).abs() < 1e-4, "{found} for {expected}");
        }
    }

    #[test]
    fn both_ways_are_the_same() {
        let a = picture(|x, y| [(x % 7) as f32 / 7.0, (y % 5) as f32 / 5.0, 0.3]);
        let b = picture(|x, y| [((x + y) % 7) as f32 / 7.0, 0.4, (x % 3) as f32 / 3.0]);
        assert_eq!(flip(&a, &b), flip(&b, &a));
        assert!(flip(&a, &b) > 0.0 && flip(&a, &b) < 1.0);
    }

    /// What the eye cannot resolve counts for little: stripes of a pixel against their mean far less than as wide ones as a finger.
    #[test]
    fn fine_patterns_are_seen_less_than_coarse_ones() {
        let stripes = |width: u32| picture(move |x, _| [f32::from(u8::from((x / width).is_multiple_of(2))); 3]);
        let gray = even([0.5; 3]);
        let (fine, coarse) = (flip(&stripes(1), &gray), flip(&stripes(12), &gray));
        assert!(fine < 0.6 * coarse, "{fine}, {coarse}");
    }

    /// A thin line counts more than its colour difference alone: the detectors find it.
    #[test]
    fn lines_are_features() {
        let line = picture(|x, _| [if x == 24 { 0.6 } else { 0.5 }; 3]);
        let gray = even([0.5; 3]);
        let (a, b) = (Seen::new(&line), Seen::new(&gray));
        assert!(b.points.iter().chain(&b.edges).all(|magnitude| *magnitude < 1e-12));
        let at = (SIDE / 2 * SIDE + 24) as usize;
        assert!(a.points[at] > a.edges[at] && a.edges[at - 3] > a.edges[at]);
    }
}
