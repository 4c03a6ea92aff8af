//! Camera rays through a place in the pixel that is drawn from its filter.

use super::bvh::{Ray, TriangleId};
use super::motion::Moment;
use super::sampler::{Dimension, Sampler};
use super::sampling::{concentric_disk, uniform_triangle};
use crate::compile::{Lens, View};
use crate::params::FilterKind;
use glam::{DAffine3, DVec2, DVec3};
use std::f64::consts::{PI, TAU};

/// Steps of a filter's tabulated inverse distribution function.
const STEPS: usize = 1024;

/// A view, ready to draw rays from.
#[derive(Debug)]
pub struct Camera {
    view: View,
    /// Of a camera that stands still.
    to_world: DAffine3,
    lens: Lens,
    size: DVec2,
    /// Offset from the pixel's centre at equal steps of probability, in pixels.
    filter: Vec<f64>,
}

impl Camera {
    /// Of a view.
    pub fn new(view: &View) -> Self {
        let radius = f64::from(view.filter.radius());
        Self {
            to_world: Moment::OPEN.camera(&View { way: Vec::new(), ..view.clone() }),
            view: view.clone(),
            lens: view.lens,
            size: DVec2::new(f64::from(view.width), f64::from(view.height)),
            filter: inverse_distribution(view.filter.kind).iter().map(|x| x * radius).collect(),
        }
    }

    /// A ray through a pixel at a moment.
    pub fn ray(&self, x: u32, y: u32, moment: Moment, sampler: &Sampler) -> Ray {
        let u = sampler.pair(Dimension::Filter);
        let raster = DVec2::new(f64::from(x), f64::from(y)) + 0.5 + DVec2::new(self.offset(u[0]), self.offset(u[1]));
        // Half the picture's height is 1, y points up.
        let plane = (2.0 * raster - self.size) / self.size.y * DVec2::new(1.0, -1.0);
        let (origin, direction) = match self.lens {
            Lens::Orthographic { ymag } => ((plane * f64::from(ymag)).extend(0.0), DVec3::NEG_Z),
            Lens::Perspective { tan_half_yfov, aperture_radius, blades, blade_rotation, focus_distance } => {
                let direction = (plane * f64::from(tan_half_yfov)).extend(-1.0);
                if aperture_radius > 0.0 {
                    let lens =
                        opening(blades, blade_rotation, sampler.pair(Dimension::Lens)) * f64::from(aperture_radius);
                    (lens.extend(0.0), direction * f64::from(focus_distance) - lens.extend(0.0))
                } else {
                    (DVec3::ZERO, direction)
                }
            }
        };
        let to_world = if self.view.way.is_empty() { self.to_world } else { moment.camera(&self.view) };
        Ray {
            origin: to_world.transform_point3(origin),
            direction: to_world.transform_vector3(direction).normalize(),
            moment,
            t_max: f64::INFINITY,
            ends: [TriangleId::NONE; 2],
        }
    }

    fn offset(&self, u: f64) -> f64 {
        let place = u * STEPS as f64;
        let step = (place as usize).min(STEPS - 1);
        let (low, high) = (self.filter[step], self.filter[step + 1]);
        low + (high - low) * (place - step as f64)
    }
}

/// A point of the unit disk, or of a regular polygon in it whose first corner is at an angle.
fn opening(blades: u32, rotation: f32, u: [f64; 2]) -> DVec2 {
    if blades == 0 {
        return concentric_disk(u);
    }
    let place = u[0] * f64::from(blades);
    let side = place.floor();
    let corner = |index: f64| DVec2::from_angle(f64::from(rotation) + TAU * index / f64::from(blades));
    let weights = uniform_triangle([u[1], place - side]);
    weights.y * corner(side) + weights.z * corner(side + 1.0)
}

/// Inverse of the filter's distribution function at [`STEPS`] + 1 equal steps, in -1..=1.
fn inverse_distribution(kind: FilterKind) -> Vec<f64> {
    let at = |step: usize| {
        let u = step as f64 / STEPS as f64;
        // Bisection: the functions are known in closed form, their inverses are not.
        let (mut low, mut high) = (-1.0, 1.0);
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if distribution(kind, middle) < u { low = middle } else { high = middle }
        }
        0.5 * (low + high)
    };
    (0..=STEPS).map(at).collect()
}

/// Probability of an offset below `x`, which lies in -1..=1.
fn distribution(kind: FilterKind, x: f64) -> f64 {
    match kind {
        FilterKind::Box => 0.5 * (1.0 + x),
        FilterKind::Triangle => 0.5 + x - 0.5 * x * x.abs(),
        FilterKind::Gaussian => {
            // Of exp(-4.5 x^2) - exp(-4.5): a standard deviation of a third, brought down to zero at the edge.
            let integral = |x: f64| (PI / 18.0).sqrt() * libm::erf(4.5f64.sqrt() * x) - (-4.5f64).exp() * x;
            0.5 + 0.5 * integral(x) / integral(1.0)
        }
        FilterKind::BlackmanHarris => {
            // Of a_0 + a_1 cos(pi x) + a_2 cos(2 pi x) + a_3 cos(3 pi x) (Harris 1978).
            const A: [f64; 4] = [0.35875, 0.48829, 0.14128, 0.01168];
            let wave = |n: f64| (n * PI * x).sin() / (n * PI);
            0.5 + (A[0] * x + A[1] * wave(1.0) + A[2] * wave(2.0) + A[3] * wave(3.0)) / (2.0 * A[0])
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distributions_rise_from_none_to_all() {
        for kind in [FilterKind::Box, FilterKind::Triangle, FilterKind::Gaussian, FilterKind::BlackmanHarris] {
            let values: Vec<f64> = (0..=100).map(|i| distribution(kind, f64::from(i) / 50.0 - 1.0)).collect();
            assert!(values[0].abs() < 1e-12 && (values[100] - 1.0).abs() < 1e-12, "{kind:?}");
            assert!(values.windows(2).all(|pair| pair[0] <= pair[1]), "{kind:?}");
            assert!((values[50] - 0.5).abs() < 1e-12, "{kind:?} is even");
        }
    }
}
