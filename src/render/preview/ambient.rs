//! The environment as spherical harmonics (Ramamoorthi and Hanrahan 2001, "An Efficient Representation for Irradiance Environment
//! Maps").

use glam::Vec3;
use rayon::prelude::*;
use std::f64::consts::{PI, TAU};

/// Coefficients of irradiance over pi, in the environment's own frame at intensity 1, in the order and with the polynomials of
/// `shaders/preview/shading.wesl`.
pub type Harmonics = [[f32; 4]; 9];

/// Rows of the grid on which a sky without detail is summed up.
const ROWS: u32 = 128;

/// Square of each harmonic's constant, times what the cosine lobe lets through of its band over pi: 1, 2/3, 1/4.
const WEIGHTS: [f64; 9] = {
    let linear = 3.0 / (4.0 * PI) * 2.0 / 3.0;
    let square = 15.0 / (4.0 * PI) / 4.0;
    [
        1.0 / (4.0 * PI),
        linear,
        linear,
        linear,
        square,
        square,
        5.0 / (16.0 * PI) / 4.0,
        square,
        15.0 / (16.0 * PI) / 4.0,
    ]
};

/// Of radiance that depends on the height of its direction alone.
pub fn of_heights(radiance: impl Fn(f32) -> Vec3 + Sync) -> Harmonics {
    of_picture(2 * ROWS, ROWS, |_, y| radiance((PI * (f64::from(y) + 0.5) / f64::from(ROWS)).cos() as f32))
}

/// Integrals over an equirectangular picture.
pub fn of_picture(width: u32, height: u32, radiance: impl Fn(u32, u32) -> Vec3 + Sync) -> Harmonics {
    let row = |y: u32| {
        let theta = |edge: u32| PI * f64::from(edge) / f64::from(height);
        let solid_angle = (theta(y).cos() - theta(y + 1).cos()) * TAU / f64::from(width);
        let (sine, cosine) = (0.5 * (theta(y) + theta(y + 1))).sin_cos();
        let mut sums = [[0.0; 3]; 9];
        for x in 0..width {
            let (z, across) = (TAU * ((f64::from(x) + 0.5) / f64::from(width) - 0.5)).sin_cos();
            let light = radiance(x, y).as_dvec3().to_array();
            for (sum, value) in sums.iter_mut().zip(polynomials([sine * across, cosine, sine * z])) {
                for (channel, light) in sum.iter_mut().zip(light) {
                    *channel += light * value * solid_angle;
                }
            }
        }
        sums
    };
    let rows: Vec<[[f64; 3]; 9]> = (0..height).into_par_iter().map(row).collect();
    std::array::from_fn(|term| {
        let [r, g, b] = std::array::from_fn(|channel| {
            (WEIGHTS[term] * rows.iter().map(|row| row[term][channel]).sum::<f64>()) as f32
        });
        [r, g, b, 0.0]
    })
}

fn polynomials([x, y, z]: [f64; 3]) -> [f64; 9] {
    [1.0, y, z, x, x * y, y * z, 3.0 * z * z - 1.0, x * z, x * x - y * y]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Irradiance over pi by the harmonics.
    fn evaluated(harmonics: &Harmonics, normal: Vec3) -> f64 {
        let terms = polynomials(normal.as_dvec3().to_array());
        terms.iter().zip(harmonics).map(|(term, h)| term * f64::from(h[0])).sum()
    }

    #[test]
    fn a_white_sky_is_white_from_everywhere() {
        let white = of_picture(64, 32, |_, _| Vec3::ONE);
        for normal in [Vec3::X, Vec3::Y, Vec3::NEG_Z, Vec3::ONE.normalize()] {
            assert!((evaluated(&white, normal) - 1.0).abs() < 2e-3);
        }
    }

    /// Radiance `1 + y` is 1 + 2/3 n.y in irradiance over pi: bands 0 and 1 are exact.
    #[test]
    fn a_linear_sky_is_exact() {
        let sky = of_picture(256, 128, |_, y| Vec3::splat(1.0 + (PI * (f64::from(y) + 0.5) / 128.0).cos() as f32));
        for normal in [Vec3::Y, Vec3::NEG_Y, Vec3::X, Vec3::new(0.6, 0.8, 0.0)] {
            let expected = 1.0 + 2.0 / 3.0 * f64::from(normal.y);
            assert!((evaluated(&sky, normal) - expected).abs() < 1e-3, "{normal}");
        }
    }

    /// The squares of x and z differ by band 2 alone.
    #[test]
    fn a_square_sky_is_exact() {
        let sky = of_picture(256, 128, |x, y| {
            let theta = PI * (f64::from(y) + 0.5) / 128.0;
            let phi = TAU * ((f64::from(x) + 0.5) / 256.0 - 0.5);
            Vec3::splat((theta.sin() * phi.cos()).powi(2) as f32)
        });
        // x^2 = 1/3 + (x^2 - 1/3); the second part is of band 2 and keeps a quarter.
        for normal in [Vec3::X, Vec3::Y, Vec3::Z, Vec3::new(0.6, 0.0, 0.8)] {
            let expected = 1.0 / 3.0 + (f64::from(normal.x).powi(2) - 1.0 / 3.0) / 4.0;
            assert!((evaluated(&sky, normal) - expected).abs() < 1e-3, "{normal}");
        }
    }
}
