//! The camera as a projection.

use super::layout::Projection;
use crate::compile::{Bounds, Lens, View};
use crate::render::gpu::layout::FILTER_STEPS;
use glam::Vec3;

/// Distance of the near plane in radii of the scene: depths are floats of `1 / z`, whose precision does not depend on it.
const NEAR: f32 = 1e-5;

/// The projection of a view whose pixels show what lies `jitter` pixels beside their centres (x to the right, y down).
pub fn projection(view: &View, bounds: &Bounds, jitter: [f32; 2]) -> Projection {
    let (width, height) = (view.width as f32, view.height as f32);
    let m = view.to_world.matrix3;
    let axes = [m.x_axis, m.y_axis, -m.z_axis].map(Vec3::from);
    let eye = Vec3::from(view.to_world.translation);
    let rows = axes.map(|axis| axis.extend(-axis.dot(eye)).to_array());
    let offset = [-2.0 * jitter[0] / width, 2.0 * jitter[1] / height];
    let scale = |half_height: f32| [height / (width * half_height), 1.0 / half_height];
    match view.lens {
        Lens::Perspective { tan_half_yfov, .. } => {
            let near = (NEAR * bounds.radius() as f32).max(f32::MIN_POSITIVE * 1e6);
            Projection { rows, scale: scale(tan_half_yfov), offset, near, far: 0.0, pad: [0.0; 2] }
        }
        Lens::Orthographic { ymag } => {
            let ahead = bounds
                .corners()
                .map(|corner| axes[2].dot(corner.as_vec3() - eye))
                .into_iter()
                .filter(|z| z.is_finite())
                .fold(0.0, f32::max);
            let far = (1.001 * ahead).max(f32::MIN_POSITIVE * 1e6);
            Projection { rows, scale: scale(ymag), offset, near: 0.0, far, pad: [0.0; 2] }
        }
    }
}

/// Where frame `index` of `count` samples the pixels, in pixels from their centre: Hammersley points through the reconstruction
/// filter, whose table of quantiles is `table` and whose half width is `radius`. One frame alone takes the centre.
pub fn jitter(table: &[f32; FILTER_STEPS], radius: f32, index: u32, count: u32) -> [f32; 2] {
    if count == 1 {
        return [0.0; 2];
    }
    let quantile = |u: f32| {
        let x = u * (FILTER_STEPS - 1) as f32;
        let low = (x as usize).min(FILTER_STEPS - 2);
        let step = x - low as f32;
        (table[low] * (1.0 - step) + table[low + 1] * step) * radius
    };
    let half = 0.5 / count as f32;
    let inverse = f64::from(index.reverse_bits()) / f64::from(u32::MAX);
    [quantile(index as f32 / count as f32 + half), quantile((inverse as f32 + half).min(1.0))]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_surround_the_centre() {
        let table = std::array::from_fn(|i| 2.0 * i as f32 / (FILTER_STEPS - 1) as f32 - 1.0);
        assert_eq!(jitter(&table, 0.5, 0, 1), [0.0; 2]);
        for count in [2, 4, 16, 64] {
            let points: Vec<_> = (0..count).map(|index| jitter(&table, 0.5, index, count)).collect();
            for axis in 0..2 {
                let mean = points.iter().map(|p| p[axis]).sum::<f32>() / count as f32;
                assert!(mean.abs() < 1e-4, "{count} frames, axis {axis}: {mean}");
                assert!(points.iter().all(|p| p[axis].abs() <= 0.5));
            }
        }
    }
}
