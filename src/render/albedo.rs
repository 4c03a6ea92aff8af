//! Directional albedo of the GGX lobe, for energy compensation (Kulla and Conty 2017, "Revisiting Physically Based
//! Shading at Imageworks"): integrated once per process in f64.

use std::f64::consts::PI;
use std::sync::OnceLock;

/// Steps in roughness and in the square root of the cosine.
pub const TABLE_WIDTH: u32 = 64;
/// One row per roughness, and a last one with the means over the hemisphere, by roughness.
pub const TABLE_HEIGHT: u32 = TABLE_WIDTH + 1;

/// Widths below this are perfect mirrors, as in `shaders/lib/bsdf.wesl`.
const MIRROR_ALPHA: f64 = 1e-4;

/// Pairs (E, B): the part of the light of a uniform surrounding that a facet lobe with Fresnel term 1, and with
/// `(1 - V.H)^5`, scatters once towards the viewer. Column: `sqrt(cos) * 63`; row: `roughness * 63`.
/// The last row holds the cosine-weighted means, by `roughness * 63`.
pub struct AlbedoTable {
    /// Row by row.
    pub texels: Vec<[f32; 2]>,
}

/// The table, made at first use.
pub fn albedo_table() -> &'static AlbedoTable {
    static TABLE: OnceLock<AlbedoTable> = OnceLock::new();
    TABLE.get_or_init(|| {
        use rayon::prelude::*;
        let last = f64::from(TABLE_WIDTH - 1);
        let rows: Vec<Vec<[f64; 2]>> = (0..TABLE_WIDTH)
            .into_par_iter()
            .map(|row| {
                let roughness = f64::from(row) / last;
                (0..TABLE_WIDTH).map(|column| lobe_albedo((f64::from(column) / last).powi(2), roughness)).collect()
            })
            .collect();
        let means = rows.iter().map(|row| mean(row));
        let texels = rows.iter().flatten().copied().chain(means).map(|pair| pair.map(|x| x as f32)).collect();
        AlbedoTable { texels }
    })
}

/// (E, B) towards a cosine, by integrating over visible normals (Heitz 2018), where the lobe's value over its density
/// is G2 / G1. The points are a golden-section lattice: directions end at the horizon, and a grid would feel the step.
fn lobe_albedo(cosine: f64, roughness: f64) -> [f64; 2] {
    const POINTS: u32 = 4096;
    const GOLDEN_SECTION: f64 = 0.618_033_988_749_894_9;
    let alpha = roughness * roughness;
    if alpha < MIRROR_ALPHA {
        return [1.0, (1.0 - cosine).powi(5)];
    }
    // At the horizon the limit is taken.
    let cosine = cosine.max(1e-5);
    let wo = [(1.0 - cosine * cosine).sqrt(), 0.0, cosine];
    let mut sum = [0.0; 2];
    for i in 0..POINTS {
        let u = [(f64::from(i) * GOLDEN_SECTION).fract(), (f64::from(i) + 0.5) / f64::from(POINTS)];
        let h = visible_normal(alpha, wo, u);
        let cos_h = wo[0] * h[0] + wo[2] * h[2];
        let cos_i = 2.0 * cos_h * h[2] - wo[2];
        if cos_i > 0.0 {
            let weight = masking_ratio(alpha, wo[2], cos_i);
            sum[0] += weight;
            sum[1] += weight * (1.0 - cos_h).powi(5);
        }
    }
    sum.map(|s| s / f64::from(POINTS))
}

/// A visible normal by spherical caps (Dupuy and Benyoub 2023); `wo` lies in the xz plane.
pub(super) fn visible_normal(alpha: f64, wo: [f64; 3], u: [f64; 2]) -> [f64; 3] {
    let length = (alpha * wo[0]).hypot(wo[2]);
    let stretched = [alpha * wo[0] / length, wo[2] / length];
    let phi = 2.0 * PI * u[0];
    let z = 1.0 - u[1] * (1.0 + stretched[1]);
    let radius = (1.0 - z * z).max(0.0).sqrt();
    let h = [alpha * (radius * phi.cos() + stretched[0]), alpha * radius * phi.sin(), z + stretched[1]];
    let norm = (h[0] * h[0] + h[1] * h[1] + h[2] * h[2]).sqrt();
    h.map(|x| x / norm)
}

/// G2 / G1 of height-correlated Smith masking.
fn masking_ratio(alpha: f64, cos_o: f64, cos_i: f64) -> f64 {
    let lambda = |c: f64| 0.5 * ((1.0 + alpha * alpha * (1.0 - c * c) / (c * c)).sqrt() - 1.0);
    (1.0 + lambda(cos_o)) / (1.0 + lambda(cos_o) + lambda(cos_i))
}

/// `2 * integral of f(cos) cos dcos`, of a row that is linear in `sqrt(cos)` between its entries, exactly.
fn mean(row: &[[f64; 2]]) -> [f64; 2] {
    let step = 1.0 / f64::from(TABLE_WIDTH - 1);
    // With s = sqrt(cos): 4 f s^3 ds; on each step f is linear and s^3 integrates by Gauss with three points exactly.
    const NODES: [(f64, f64); 3] =
        [(-0.774_596_669_241_483_4, 5.0 / 18.0), (0.0, 8.0 / 18.0), (0.774_596_669_241_483_4, 5.0 / 18.0)];
    std::array::from_fn(|channel| {
        row.windows(2)
            .enumerate()
            .map(|(i, pair)| {
                NODES
                    .iter()
                    .map(|&(node, weight)| {
                        let t = 0.5 + 0.5 * node;
                        let s = (i as f64 + t) * step;
                        let value = pair[0][channel] * (1.0 - t) + pair[1][channel] * t;
                        weight * step * 4.0 * value * s.powi(3)
                    })
                    .sum::<f64>()
            })
            .sum()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mirrors_lose_nothing() {
        let texels = &albedo_table().texels;
        for texel in &texels[..TABLE_WIDTH as usize] {
            assert!((texel[0] - 1.0).abs() < 1e-6);
        }
        // Schlick's term averaged over the hemisphere: 1/21 (Kulla and Conty 2017).
        let mean = texels[(TABLE_WIDTH * TABLE_WIDTH) as usize];
        assert!((mean[1] - 1.0 / 21.0).abs() < 2e-3, "{mean:?}");
    }

    #[test]
    fn agrees_with_a_plain_integral_over_directions() {
        for (roughness, cosine) in [(0.4, 0.15), (0.5, 0.3), (0.5, 1.0), (0.8, 0.9), (1.0, 0.5), (1.0, 0.05)] {
            let ours = lobe_albedo(cosine, roughness)[0];
            let plain = plain_albedo(cosine, roughness);
            assert!((ours - plain).abs() < 5e-4, "roughness {roughness} cosine {cosine}: {ours} against {plain}");
        }
    }

    /// Integral of `D G2 / (4 cos_o)` over all directions by the midpoint rule.
    fn plain_albedo(cos_o: f64, roughness: f64) -> f64 {
        const N: u32 = 600;
        let a2 = roughness.powi(4);
        let wo = [(1.0 - cos_o * cos_o).sqrt(), 0.0, cos_o];
        let mut sum = 0.0;
        for i in 0..N {
            for j in 0..N {
                let z = (f64::from(i) + 0.5) / f64::from(N);
                let phi = 2.0 * PI * (f64::from(j) + 0.5) / f64::from(N);
                let r = (1.0 - z * z).sqrt();
                let wi = [r * phi.cos(), r * phi.sin(), z];
                let h: [f64; 3] = std::array::from_fn(|k| wo[k] + wi[k]);
                let hz = h[2] / h.iter().map(|x| x * x).sum::<f64>().sqrt();
                let d = a2 / (PI * (hz * hz * (a2 - 1.0) + 1.0).powi(2));
                let smith = |c: f64| (a2 + (1.0 - a2) * c * c).sqrt();
                sum += d * 0.5 / (z * smith(cos_o) + cos_o * smith(z)) * z;
            }
        }
        sum * 2.0 * PI / f64::from(N * N)
    }
}
