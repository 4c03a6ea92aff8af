//! Texture coordinates of spheres.

use super::relief::Chart;
use crate::compile::Triangle;
use glam::{DVec2, DVec3};
use std::f64::consts::{PI, TAU};

/// Sine of the angle to a pole below which u has no meaning any more.
const POLE: f64 = 1e-6;

/// Texture coordinates and how they lie, at a unit normal of a sphere: u around the axis, v from the positive pole.
pub fn layout(sphere: &Triangle, normal: DVec3) -> (DVec2, Chart) {
    let (radius, axis) = (f64::from(sphere.v1[0]), sphere.v1[1] as usize);
    // With the axis in z: axes in cyclic order, so that left stays left.
    let turned = |v: DVec3, first: usize| DVec3::new(v[first % 3], v[(first + 1) % 3], v[(first + 2) % 3]);
    let n = turned(normal, axis + 1);
    let back = |v: DVec3| turned(v, 5 - axis);
    let across = n.truncate().length();
    let uv = DVec2::new(0.5 + n.y.atan2(n.x) / TAU, across.atan2(n.z) / PI);
    let sine = across.max(POLE);
    let u = DVec3::new(-n.y, n.x, 0.0) / (sine * sine * TAU * radius);
    let v = DVec3::new(n.x * n.z / sine, n.y * n.z / sine, -sine) / (PI * radius);
    (uv, Chart { u: back(u), v: back(v) })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sphere(axis: f32) -> Triangle {
        Triangle { v1: [2.5, axis, 0.0], ..Triangle::default() }
    }

    #[test]
    fn poles_lie_on_the_axis() {
        for (axis, pole) in [(0.0, DVec3::X), (1.0, DVec3::Y), (2.0, DVec3::Z)] {
            assert!(layout(&sphere(axis), pole).0.y.abs() < 1e-9);
            assert!((layout(&sphere(axis), -pole).0.y - 1.0).abs() < 1e-9);
        }
        // Seen from +z with y up, u grows to the right.
        let right = layout(&sphere(1.0), DVec3::new(0.1, 0.0, 1.0).normalize()).0;
        assert!(right.x > 0.5 && right.x < 0.52 && (right.y - 0.5).abs() < 1e-9, "{right}");
    }

    #[test]
    fn charts_are_the_derivatives_of_the_coordinates() {
        for axis in [0.0, 1.0, 2.0] {
            let sphere = sphere(axis);
            for i in 0..50 {
                let f = f64::from(i);
                let n = DVec3::new((f * 0.7).sin(), (f * 1.3).cos(), (f * 2.1).sin()).normalize();
                let (uv, chart) = layout(&sphere, n);
                let tangent = n.any_orthonormal_vector();
                let step = 1e-6;
                let (moved, _) = layout(&sphere, (n + tangent * (step / 2.5)).normalize());
                let change = (moved - uv) / step;
                let expected = DVec2::new(chart.u.dot(tangent), chart.v.dot(tangent));
                let seam = change.x.abs() > 1e3;
                assert!(
                    seam || change.distance(expected) < 1e-3 * (1.0 + expected.length()),
                    "{change} for {expected}"
                );
            }
        }
    }
}
