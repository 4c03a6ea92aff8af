//! What microfacets of a roughness mirror of an environment: means of its radiance over their lobes, seen from straight above (Karis 2013,
//! "Real Shading in Unreal Engine 4", "Pre-Filtered Environment Map").

use glam::{DMat3, DVec3, Vec3};
use rayon::prelude::*;
use std::f64::consts::{PI, TAU};

/// Roughnesses that are stored, the last of them 1; as in `shaders/preview/surroundings.wesl`.
pub const LEVELS: u32 = 5;
/// Rows of the least rough level, halved for each after it; as there.
pub const ROWS: u32 = 128;
/// Directions of a mean.
const SAMPLES: u32 = 128;

/// Levels one above the other, each twice as wide as high.
pub struct Prefiltered {
    /// Texels across; levels after the first fill a part.
    pub width: u32,
    /// Texels down.
    pub height: u32,
    /// Row by row.
    pub texels: Vec<[f32; 4]>,
}

impl Prefiltered {
    /// Of a picture whose rows run from +y to -y, by the means of its texels.
    pub fn of_picture(width: u32, height: u32, radiance: impl Fn(u32, u32) -> Vec3 + Sync) -> Self {
        let pyramid = Pyramid::new(width, height, radiance);
        Self::new(2 * ROWS, |direction, spread| pyramid.radiance(direction, spread))
    }

    /// Of radiance that depends on the height of its direction alone.
    pub fn of_heights(radiance: impl Fn(f32) -> Vec3 + Sync) -> Self {
        Self::new(1, |direction, _| radiance(direction.y as f32))
    }

    /// `radiance`: of a direction, as a mean over a solid angle around it.
    fn new(width: u32, radiance: impl Fn(DVec3, f64) -> Vec3 + Sync) -> Self {
        let height = first_row(LEVELS);
        let mut texels = vec![[0.0; 4]; (width * height) as usize];
        for level in 0..LEVELS {
            let (across, down) = ((width >> level).max(1), ROWS >> level);
            let lobe = Lobe::new(roughness(level));
            let rows = texels[(first_row(level) * width) as usize..].par_chunks_mut(width as usize);
            rows.take(down as usize).enumerate().for_each(|(y, row)| {
                for (x, texel) in row.iter_mut().take(across as usize).enumerate() {
                    let place = |at: usize, count: u32| (at as f64 + 0.5) / f64::from(count);
                    *texel = lobe.mean(direction(place(x, across), place(y, down)), &radiance).extend(0.0).to_array();
                }
            });
        }
        Self { width, height, texels }
    }
}

fn first_row(level: u32) -> u32 {
    2 * ROWS - ((2 * ROWS) >> level)
}

/// Perceptual roughness of a level: denser where lobes are narrow.
fn roughness(level: u32) -> f64 {
    (f64::from(level + 1) / f64::from(LEVELS)).powf(1.5)
}

/// Of a place in an equirectangular picture, in its own frame.
fn direction(u: f64, v: f64) -> DVec3 {
    let (sine, y) = (PI * v).sin_cos();
    let (z, x) = (TAU * (u - 0.5)).sin_cos();
    DVec3::new(sine * x, y, sine * z)
}

/// Directions mirrored by GGX facets of one roughness around +z.
struct Lobe {
    /// Direction, and solid angle that it stands for.
    samples: Vec<(DVec3, f64)>,
}

impl Lobe {
    fn new(roughness: f64) -> Self {
        let squared = roughness.powi(4);
        let sample = |index: u32| {
            let u = (f64::from(index) + 0.5) / f64::from(SAMPLES);
            let cosine_squared = (1.0 - u) / (1.0 + (squared - 1.0) * u);
            let cosine = cosine_squared.sqrt();
            let sine = (1.0 - cosine_squared).max(0.0).sqrt();
            let turn = TAU * f64::from(index.reverse_bits()) / 2f64.powi(32);
            let half = DVec3::new(sine * turn.cos(), sine * turn.sin(), cosine);
            // View and normal are +z.
            let light = 2.0 * cosine * half - DVec3::Z;
            let density = squared / (PI * (cosine_squared * (squared - 1.0) + 1.0).powi(2)) / 4.0;
            (light, 1.0 / (f64::from(SAMPLES) * density))
        };
        Self { samples: (0..SAMPLES).map(sample).filter(|(light, _)| light.z > 0.0).collect() }
    }

    /// Mean by the cosine, around an axis.
    fn mean(&self, axis: DVec3, radiance: impl Fn(DVec3, f64) -> Vec3) -> Vec3 {
        let (x, y) = axis.any_orthonormal_pair();
        let frame = DMat3::from_cols(x, y, axis);
        let (mut sum, mut weights) = (Vec3::ZERO, 0.0);
        for &(light, spread) in &self.samples {
            sum += light.z as f32 * radiance(frame * light, spread);
            weights += light.z;
        }
        sum / weights as f32
    }
}

/// A picture at sizes that halve: means over solid angles are then one look-up (Krivanek and Colbert 2008, "Real-time Shading with
/// Filtered Importance Sampling").
struct Pyramid {
    /// From large to small, each twice as wide as high.
    levels: Vec<Vec<Vec3>>,
    rows: u32,
}

impl Pyramid {
    /// Rows of the largest.
    const ROWS: u32 = 256;

    fn new(width: u32, height: u32, radiance: impl Fn(u32, u32) -> Vec3 + Sync) -> Self {
        let rows = Self::ROWS.min(height.next_power_of_two());
        let mut levels = vec![shrunk(width, height, rows, radiance)];
        let mut down = rows;
        while down > 1 {
            let larger = &levels[levels.len() - 1];
            let across = 2 * down as usize;
            down /= 2;
            let at = |x: usize, y: usize| {
                let first = 2 * y * across + 2 * x;
                [first, first + 1, first + across, first + across + 1].iter().map(|i| larger[*i]).sum::<Vec3>() / 4.0
            };
            levels.push(
                (0..down as usize).flat_map(|y| (0..across / 2).map(move |x| (x, y))).map(|(x, y)| at(x, y)).collect(),
            );
        }
        Self { levels, rows }
    }

    /// Mean over about a solid angle.
    fn radiance(&self, direction: DVec3, spread: f64) -> Vec3 {
        let texel = 4.0 * PI / f64::from(2 * self.rows * self.rows);
        let level = (0.5 * (spread / texel).log2() + 0.5).round().clamp(0.0, (self.levels.len() - 1) as f64) as u32;
        let down = f64::from(self.rows >> level);
        let across = 2.0 * down;
        let (u, v) = (0.5 + direction.z.atan2(direction.x) / TAU, direction.y.clamp(-1.0, 1.0).acos() / PI);
        let (x, y) = (u * across - 0.5, v * down - 0.5);
        let (fx, fy) = ((x - x.floor()) as f32, (y - y.floor()) as f32);
        let at = |x: f64, y: f64| {
            let (x, y) = (x.rem_euclid(across) as usize, y.clamp(0.0, down - 1.0) as usize);
            self.levels[level as usize][y * across as usize + x.min(across as usize - 1)]
        };
        let row = |y: f64| at(x.floor(), y).lerp(at(x.floor() + 1.0, y), fx);
        row(y.floor()).lerp(row(y.floor() + 1.0), fy)
    }
}

/// Means of a picture's texels by their solid angle, over a grid twice as wide as high and no finer than the picture.
fn shrunk(width: u32, height: u32, rows: u32, radiance: impl Fn(u32, u32) -> Vec3 + Sync) -> Vec<Vec3> {
    let columns = 2 * rows;
    // First texel of a cell; a cell has one at least.
    let edge = |cell: u32, cells: u32, texels: u32| (u64::from(cell) * u64::from(texels) / u64::from(cells)) as u32;
    let row = |y: u32| {
        let (top, bottom) = (edge(y, rows, height), edge(y + 1, rows, height));
        (0..columns).map(move |x| (edge(x, columns, width), edge(x + 1, columns, width), top, bottom.max(top + 1)))
    };
    let cell = |(left, right, top, bottom): (u32, u32, u32, u32)| {
        let (mut sum, mut weights) = (Vec3::ZERO, 0.0);
        for y in top..bottom {
            let weight = (PI * (f64::from(y) + 0.5) / f64::from(height)).sin() as f32;
            for x in left..right.max(left + 1) {
                sum += weight * radiance(x, y);
                weights += weight;
            }
        }
        sum / weights
    };
    (0..rows).into_par_iter().flat_map_iter(row).map(cell).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_white_sky_is_white_at_every_roughness() {
        let white = Prefiltered::of_picture(64, 32, |_, _| Vec3::ONE);
        assert_eq!(white.texels.len(), (white.width * white.height) as usize);
        for level in 0..LEVELS {
            let row = &white.texels[(first_row(level) * white.width) as usize..][..(white.width >> level) as usize];
            assert!(row.iter().all(|texel| (texel[0] - 1.0).abs() < 1e-5), "level {level}");
        }
    }

    /// The mean of `1 + y` over a lobe is `1 + c n.y`, where c is the lobe's mean cosine: by the same samples, and between what
    /// a mirror has (1) and what a cosine has (2/3).
    #[test]
    fn a_linear_sky_keeps_its_shape() {
        let sky = Prefiltered::of_heights(|y| Vec3::splat(1.0 + y));
        for level in 0..LEVELS {
            let rows = ROWS >> level;
            let at = |y: u32| f64::from(sky.texels[(first_row(level) + y) as usize][0]);
            let height = |y: u32| (PI * (f64::from(y) + 0.5) / f64::from(rows)).cos();
            let slope = (at(0) - at(rows - 1)) / (height(0) - height(rows - 1));
            assert!(slope <= 1.0 && slope > 0.6, "level {level}: {slope}");
            for y in 0..rows {
                assert!((at(y) - 1.0 - slope * height(y)).abs() < 0.02, "level {level}, row {y}");
            }
        }
    }

    /// A picture and a function that say the same, through a shrinking of sizes that are no powers of two.
    #[test]
    fn pictures_and_functions_agree() {
        let height = |y: u32, rows: u32| (PI * (f64::from(y) + 0.5) / f64::from(rows)).cos() as f32;
        let picture = Prefiltered::of_picture(1000, 501, |_, y| Vec3::splat(1.0 + height(y, 501).powi(3)));
        let function = Prefiltered::of_heights(|y| Vec3::splat(1.0 + y.powi(3)));
        for level in 0..LEVELS {
            for y in 0..ROWS >> level {
                let row = first_row(level) + y;
                let (a, b) = (picture.texels[(row * picture.width) as usize][0], function.texels[row as usize][0]);
                assert!((a - b).abs() < 0.03, "level {level}, row {y}: {a}, {b}");
            }
        }
    }

    /// A small sun keeps its power, however it is spread.
    #[test]
    fn a_small_sun_is_not_missed() {
        let sky =
            Prefiltered::of_picture(1024, 512, |x, y| Vec3::splat(f32::from(u8::from((x, y) == (700, 200))) * 1e4));
        let solid_angle = |y: u32, rows: u32| {
            let edge = |y: u32| (PI * f64::from(y) / f64::from(rows)).cos();
            (edge(y) - edge(y + 1)) * TAU / f64::from(2 * rows)
        };
        let power = 1e4 * solid_angle(200, 512);
        for level in 0..LEVELS {
            let rows = ROWS >> level;
            let row = |y: u32| {
                let first = ((first_row(level) + y) * sky.width) as usize;
                let sum: f32 = sky.texels[first..first + 2 * rows as usize].iter().map(|texel| texel[0]).sum();
                f64::from(sum) * solid_angle(y, rows)
            };
            let got: f64 = (0..rows).map(row).sum();
            assert!((got / power - 1.0).abs() < 0.15, "level {level}: {got} for {power}");
        }
    }
}
