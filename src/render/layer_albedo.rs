//! Directional albedos of sheen and of rough glass, for energy conservation: integrated once per process in f64, beside those
//! of [`super::albedo`].

use super::albedo::TABLE_WIDTH;
use rayon::prelude::*;
use std::f64::consts::{PI, TAU};
use std::sync::LazyLock;

/// Rows of the sheen's table: by roughness.
pub const SHEEN_ROWS: u32 = 32;
/// Steps of the glass table in the cosine's square root and in roughness.
pub const GLASS_STEPS: u32 = 16;
/// Steps in `(eta - 1) / (eta + 1)`, from -1/2 to 1/2: eta is the index beyond the surface over that before it.
pub const GLASS_SLICES: u32 = 17;
/// Sheen that is smoother than this is taken as this.
pub const SHEEN_LEAST_ROUGHNESS: f64 = 0.07;

/// Rows of [`TABLE_WIDTH`] entries: those of sheen (column: `sqrt(cos) * 63`, row: `roughness * 31`), then for each slice of glass
/// [`GLASS_STEPS`] rows by roughness with as many entries by `sqrt(cos)`.
pub static LAYER_TABLE: LazyLock<Vec<f32>> = LazyLock::new(|| {
    let sheen = (0..SHEEN_ROWS).into_par_iter().flat_map_iter(|row| {
        let roughness = (f64::from(row) / f64::from(SHEEN_ROWS - 1)).max(SHEEN_LEAST_ROUGHNESS);
        (0..TABLE_WIDTH).map(move |column| {
            integrated_sheen((f64::from(column) / f64::from(TABLE_WIDTH - 1)).powi(2), roughness) as f32
        })
    });
    let glass = (0..GLASS_SLICES * GLASS_STEPS).into_par_iter().flat_map_iter(|row| {
        let t = f64::from(row / GLASS_STEPS) / f64::from(GLASS_SLICES - 1) - 0.5;
        let roughness = f64::from(row % GLASS_STEPS) / f64::from(GLASS_STEPS - 1);
        (0..TABLE_WIDTH).map(move |column| {
            let root = f64::from(column.min(GLASS_STEPS - 1)) / f64::from(GLASS_STEPS - 1);
            if column < GLASS_STEPS {
                integrated_glass(root * root, roughness, (1.0 + t) / (1.0 - t)) as f32
            } else {
                0.0
            }
        })
    });
    sheen.chain(glass).collect()
});

/// Albedo of white sheen towards a cosine.
pub fn sheen_albedo(cosine: f64, roughness: f64) -> f32 {
    let (x, y) = (cosine.clamp(0.0, 1.0).sqrt() * f64::from(TABLE_WIDTH - 1), roughness * f64::from(SHEEN_ROWS - 1));
    bilinear(x, y, TABLE_WIDTH, SHEEN_ROWS, |column, row| LAYER_TABLE[(row * TABLE_WIDTH + column) as usize])
}

/// Albedo of rough glass that is hit at a cosine: reflected and refracted once by facets.
pub fn glass_albedo(cosine: f64, roughness: f64, eta: f64) -> f32 {
    let last = f64::from(GLASS_STEPS - 1);
    let (x, y) = (cosine.clamp(0.0, 1.0).sqrt() * last, roughness * last);
    let t = ((eta - 1.0) / (eta + 1.0) + 0.5).clamp(0.0, 1.0) * f64::from(GLASS_SLICES - 1);
    let below = (t as u32).min(GLASS_SLICES - 2);
    let [low, high] = [below, below + 1].map(|slice| {
        bilinear(x, y, GLASS_STEPS, GLASS_STEPS, |column, row| {
            LAYER_TABLE[((SHEEN_ROWS + slice * GLASS_STEPS + row) * TABLE_WIDTH + column) as usize]
        })
    });
    low + (high - low) * (t - f64::from(below)) as f32
}

fn bilinear(x: f64, y: f64, width: u32, height: u32, at: impl Fn(u32, u32) -> f32) -> f32 {
    let (column, row) = ((x as u32).min(width - 2), (y as u32).min(height - 2));
    let (u, v) = ((x - f64::from(column)) as f32, (y - f64::from(row)) as f32);
    let across = |row| at(column, row) * (1.0 - u) + at(column + 1, row) * u;
    across(row) * (1.0 - v) + across(row + 1) * v
}

/// Midpoint rule over the hemisphere.
fn integrated_sheen(cosine: f64, roughness: f64) -> f64 {
    const SIDE: u32 = 48;
    let alpha = roughness * roughness;
    let cosine = cosine.max(1e-4);
    let wo = [(1.0 - cosine * cosine).sqrt(), 0.0, cosine];
    let masking_o = sheen_lambda(alpha, cosine);
    let mut sum = 0.0;
    for i in 0..SIDE {
        let z = (f64::from(i) + 0.5) / f64::from(SIDE);
        let (r, masking) = ((1.0 - z * z).sqrt(), 1.0 / (1.0 + masking_o + sheen_lambda(alpha, z)));
        for j in 0..SIDE {
            // The lobe is symmetric about the plane of the viewer.
            let phi = PI * (f64::from(j) + 0.5) / f64::from(SIDE);
            let h = [wo[0] + r * phi.cos(), r * phi.sin(), wo[2] + z];
            let sine2 = (h[0] * h[0] + h[1] * h[1]) / (h[0] * h[0] + h[1] * h[1] + h[2] * h[2]);
            let distribution = (2.0 + 1.0 / alpha) * sine2.powf(0.5 / alpha) / TAU;
            sum += distribution * masking / (4.0 * cosine);
        }
    }
    (sum * TAU / f64::from(SIDE * SIDE)).min(1.0)
}

/// Estevez and Kulla 2017, section 3.
fn sheen_lambda(alpha: f64, cosine: f64) -> f64 {
    const SMOOTH: [f64; 5] = [25.3245, 3.32435, 0.16801, -1.27393, -4.85967];
    const ROUGH: [f64; 5] = [21.5473, 3.82987, 0.19823, -1.97760, -4.32054];
    let weight = (1.0 - alpha) * (1.0 - alpha);
    let [a, b, c, d, e] = std::array::from_fn(|i| weight * SMOOTH[i] + (1.0 - weight) * ROUGH[i]);
    let fit = |x: f64| a / (1.0 + b * x.powf(c)) + d * x + e;
    if cosine < 0.5 { fit(cosine).exp() } else { (2.0 * fit(0.5) - fit(1.0 - cosine)).exp() }
}

/// Over visible normals: what is reflected and refracted at each, with the masking of where it goes.
fn integrated_glass(cosine: f64, roughness: f64, eta: f64) -> f64 {
    const POINTS: u32 = 1024;
    const GOLDEN_SECTION: f64 = 0.618_033_988_749_894_9;
    let alpha = (roughness * roughness).max(1e-4);
    let cosine = cosine.max(1e-4);
    let wo = [(1.0 - cosine * cosine).sqrt(), 0.0, cosine];
    let lambda = |c: f64| 0.5 * ((1.0 + alpha * alpha * (1.0 - c * c) / (c * c)).sqrt() - 1.0);
    let mut sum = 0.0;
    for i in 0..POINTS {
        let u = [(f64::from(i) * GOLDEN_SECTION).fract(), (f64::from(i) + 0.5) / f64::from(POINTS)];
        let h = super::albedo::visible_normal(alpha, wo, u);
        let cos_h = (wo[0] * h[0] + wo[2] * h[2]).min(1.0);
        let reflectance = fresnel(cos_h, eta);
        let reflected = 2.0 * cos_h * h[2] - wo[2];
        if reflected > 0.0 {
            sum += reflectance * (1.0 + lambda(wo[2])) / (1.0 + lambda(wo[2]) + lambda(reflected));
        }
        let below = 1.0 - (1.0 - cos_h * cos_h) / (eta * eta);
        if below > 0.0 {
            let refracted = (cos_h / eta - below.sqrt()) * h[2] - wo[2] / eta;
            if refracted < 0.0 {
                sum += (1.0 - reflectance) / (1.0 + lambda(-refracted));
            }
        }
    }
    sum / f64::from(POINTS)
}

/// Of a dielectric interface, unpolarised light.
fn fresnel(cosine: f64, eta: f64) -> f64 {
    let below2 = 1.0 - (1.0 - cosine * cosine) / (eta * eta);
    if below2 <= 0.0 {
        return 1.0;
    }
    let below = below2.sqrt();
    let parallel = (eta * cosine - below) / (eta * cosine + below);
    let across = (cosine - eta * below) / (cosine + eta * below);
    0.5 * (parallel * parallel + across * across)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn albedos_are_parts_of_one() {
        assert!(LAYER_TABLE.iter().all(|albedo| (0.0..=1.0).contains(albedo)));
        assert_eq!(LAYER_TABLE.len() as u32, TABLE_WIDTH * (SHEEN_ROWS + GLASS_SLICES * GLASS_STEPS));
    }

    #[test]
    fn smooth_glass_loses_nothing() {
        for eta in [1.0 / 1.5, 1.2, 2.4] {
            for cosine in [0.1, 0.5, 1.0] {
                assert!((glass_albedo(cosine, 0.0, eta) - 1.0).abs() < 2e-3, "{eta} {cosine}");
            }
        }
    }
}
