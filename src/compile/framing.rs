//! Where to stand so that everything is in the picture.

use super::Bounds;
use glam::DVec3;

/// Share of the picture's half sizes that the bounds fill.
const FILL: f64 = 0.95;

/// Right, up and forward of a camera, unit and orthogonal.
#[derive(Debug, Clone, Copy)]
pub struct Axes {
    /// Right.
    pub right: DVec3,
    /// Up.
    pub up: DVec3,
    /// The way it looks.
    pub forward: DVec3,
}

impl Axes {
    /// Axes from a direction to look in and a hint of up; none: they are parallel or zero.
    pub fn looking(forward: DVec3, up: DVec3) -> Option<Self> {
        let forward = forward.try_normalize()?;
        let side = forward.cross(up.try_normalize()?);
        let right = if side.length_squared() > 1e-12 { side.normalize() } else { return None };
        Some(Self { right, up: right.cross(forward), forward })
    }

    /// Axes of an orbit's camera: `up` is +y as far as can be.
    pub fn orbit(azimuth_degrees: f64, elevation_degrees: f64) -> Self {
        let (azimuth, elevation) = (azimuth_degrees.to_radians(), elevation_degrees.to_radians());
        let back = DVec3::new(azimuth.sin() * elevation.cos(), elevation.sin(), azimuth.cos() * elevation.cos());
        let right = DVec3::new(azimuth.cos(), 0.0, -azimuth.sin());
        Self { right, up: back.cross(right), forward: -back }
    }
}

/// Smallest distance from the target, against the view, from which all corners of the bounds are in the picture with
/// a margin. `tan_half` are the tangents of half the field of view, across and up. No bounds: 1.
pub fn distance(bounds: &Bounds, target: DVec3, axes: &Axes, tan_half: [f64; 2]) -> f64 {
    if bounds.is_empty() {
        return 1.0;
    }
    let needed = bounds.corners().into_iter().map(|corner| {
        let from_target = corner - target;
        let (x, y, z) = (from_target.dot(axes.right), from_target.dot(axes.up), from_target.dot(axes.forward));
        (x.abs() / (tan_half[0] * FILL)).max(y.abs() / (tan_half[1] * FILL)) - z
    });
    let farthest = needed.fold(0.0, f64::max);
    if farthest > 0.0 { farthest } else { 1.0 }
}
