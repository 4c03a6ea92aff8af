//! Places on triangles in world space, and rays that leave them.

use super::bvh::TriangleId;
use super::motion::Moment;
use crate::compile::{CompiledScene, Instance};
use glam::{DMat3, DVec3};

/// Bound of the relative error of `n` f64 roundings (Higham 2002, 3.1).
pub(super) const fn gamma(n: f64) -> f64 {
    let roundings = n * 0.5 * f64::EPSILON;
    roundings / (1.0 - roundings)
}

/// Roundings from the corners of a triangle, by way of a point of it and a ray from there, back to the triangle's plane; generous.
pub(super) const ROUNDINGS: f64 = 32.0;

/// A place on a triangle in world space, or in a medium.
#[derive(Debug, Clone, Copy)]
pub struct Place {
    /// Relative to the scene's origin.
    pub position: DVec3,
    /// Unit normal of the front, or of the side that a ray came from; zero in a medium.
    pub normal: DVec3,
    /// When it is there.
    pub moment: Moment,
    /// Distance along the normal that clears the errors of `position`.
    pub(super) clearance: f64,
}

/// Area of an emitting triangle at a moment; `mean` is that over all of them.
pub fn area(scene: &CompiledScene, triangle: u32, mean: f32, moment: Moment) -> f64 {
    if !scene.motion.moves(triangle) {
        return f64::from(mean);
    }
    let [a, b, c] = moment.corners(scene, triangle);
    0.5 * (b - a).cross(c - a).length()
}

impl Place {
    /// At the given weights of the corners, at a moment.
    pub fn new(scene: &CompiledScene, id: TriangleId, weights: DVec3, moment: Moment) -> Self {
        let instance = &scene.instances[id.instance as usize];
        let [a, b, c] = moment.corners(scene, id.triangle);
        let local = weights.x * a + weights.y * b + weights.z * c;
        let largest = a.abs().max(b.abs()).max(c.abs()).max_element();
        let normal = normal_to_world(scene, instance, (b - a).cross(c - a)).normalize();
        if !scene.two_level {
            return Self { position: local, normal, moment, clearance: gamma(ROUNDINGS) * largest };
        }
        let (matrix, translation) = (linear_part(&instance.to_world), offset(&instance.to_world));
        let position = matrix * local + translation;
        // Rounding in object space, there and back, seen from outside.
        let growth = |m: DMat3| m.x_axis.abs() + m.y_axis.abs() + m.z_axis.abs();
        let back = growth(linear_part(&instance.to_object)).max_element() * position.abs().max_element();
        let inside = largest + back + offset(&instance.to_object).abs().max_element();
        let reach = growth(matrix).max_element() * inside + translation.abs().max_element();
        Self { position, normal, moment, clearance: gamma(ROUNDINGS) * reach }
    }

    /// In a medium.
    pub fn within(position: DVec3, moment: Moment) -> Self {
        Self { position, normal: DVec3::ZERO, moment, clearance: 0.0 }
    }

    /// Origin of a ray that leaves in a direction, clear of the triangle.
    pub fn leave(&self, direction: DVec3) -> DVec3 {
        clear(self.position, self.normal, self.clearance, direction)
    }
}

/// Moves a position along a unit normal, to the side of a direction, so far that it is clear of the surface.
pub(super) fn clear(position: DVec3, normal: DVec3, clearance: f64, direction: DVec3) -> DVec3 {
    // The largest component is moved by the clearance at least, in whatever direction the normal points.
    let distance = clearance * (normal.x.abs() + normal.y.abs() + normal.z.abs());
    position + normal * distance.copysign(direction.dot(normal))
}

/// Of a transform's rows.
pub(super) fn linear_part(rows: &[[f32; 4]; 3]) -> DMat3 {
    DMat3::from_cols_array_2d(&rows.map(|row| [row[0], row[1], row[2]].map(f64::from))).transpose()
}

fn offset(rows: &[[f32; 4]; 3]) -> DVec3 {
    DVec3::from(rows.map(|row| f64::from(row[3])))
}

/// A normal of an instance, by the inverse transpose, so that a mirroring transform keeps the front in front.
pub(super) fn normal_to_world(scene: &CompiledScene, instance: &Instance, normal: DVec3) -> DVec3 {
    if scene.two_level { linear_part(&instance.to_object).transpose() * normal } else { normal }
}
