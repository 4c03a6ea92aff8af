//! Where what moves is at a moment: between the ends of a piece of its way, along a straight line (`compile::motion`).

use super::sampler::{Dimension, Sampler};
use crate::compile::{CompiledScene, Lighting, PunctualLight, Triangle, View};
use glam::{DAffine3, DMat3, DVec3};

/// A moment at which the shutter is open.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Moment {
    /// Which piece of the way.
    pub piece: u32,
    /// How much of it is behind, 0 to 1.
    pub part: f64,
}

impl Moment {
    /// When it opens; for pictures that take no time.
    pub const OPEN: Self = Self { piece: 0, part: 0.0 };

    /// The moment at which a path sees a scene whose way is cut into pieces.
    pub fn draw(pieces: u32, sampler: &Sampler) -> Self {
        let place = sampler.pair(Dimension::Time)[0] * f64::from(pieces);
        let piece = (place as u32).min(pieces.saturating_sub(1));
        Self { piece, part: place - f64::from(piece) }
    }

    /// Corners of a triangle of the scene, in the space of its instance.
    pub fn corners(self, scene: &CompiledScene, triangle: u32) -> [DVec3; 3] {
        if !scene.motion.moves(triangle) {
            return corners(&scene.triangles[triangle as usize]);
        }
        let [begin, end] = [0, 1].map(|step| corners(&scene.triangle_at(triangle, self.piece + step)));
        std::array::from_fn(|corner| begin[corner].lerp(end[corner], self.part))
    }

    /// Numbers of a vertex, from `offset` in its record on, that change as it moves.
    pub fn attribute<const N: usize>(self, scene: &CompiledScene, vertex: u32, offset: u32) -> [f64; N] {
        let motion = scene.motion;
        let stored = |vertex: u32| -> [f64; N] {
            let first = (vertex * scene.layout.stride + offset) as usize;
            std::array::from_fn(|i| f64::from(f32::from_bits(scene.vertices[first + i])))
        };
        if motion.pieces == 0 || vertex < motion.first_vertex {
            return stored(vertex);
        }
        let [begin, end] = [0, 1].map(|step| stored(vertex + (self.piece + step) * motion.vertices));
        std::array::from_fn(|i| begin[i] * (1.0 - self.part) + end[i] * self.part)
    }

    /// A punctual light.
    pub fn light(self, lighting: &Lighting, index: usize) -> PunctualLight {
        let count = lighting.lights.len();
        let at = |step: usize| lighting.way.get(index + (self.piece as usize + step) * count);
        let (Some(begin), Some(end)) = (at(0), at(1)) else { return lighting.lights[index] };
        let between = |begin: [f32; 3], end: [f32; 3]| {
            DVec3::from(begin.map(f64::from)).lerp(DVec3::from(end.map(f64::from)), self.part)
        };
        let direction = between(begin.direction, end.direction).normalize_or(DVec3::NEG_Z);
        let axis = between(begin.axis, end.axis);
        PunctualLight {
            position: between(begin.position, end.position).as_vec3().to_array(),
            direction: direction.as_vec3().to_array(),
            axis: (axis - axis.dot(direction) * direction).normalize_or_zero().as_vec3().to_array(),
            ..*begin
        }
    }

    /// Camera to world.
    pub fn camera(self, view: &View) -> DAffine3 {
        let wide = |map: &glam::Affine3A| {
            let m = map.matrix3;
            let matrix3 = DMat3::from_cols(m.x_axis.as_dvec3(), m.y_axis.as_dvec3(), m.z_axis.as_dvec3());
            DAffine3 { matrix3, translation: map.translation.as_dvec3() }
        };
        let at = |step: u32| view.way.get((self.piece + step) as usize).map(wide);
        let (Some(begin), Some(end)) = (at(0), at(1)) else { return wide(&view.to_world) };
        DAffine3 {
            matrix3: begin.matrix3 * (1.0 - self.part) + end.matrix3 * self.part,
            translation: begin.translation.lerp(end.translation, self.part),
        }
    }
}

fn corners(triangle: &Triangle) -> [DVec3; 3] {
    [triangle.v0, triangle.v1, triangle.v2].map(|corner| DVec3::from(corner.map(f64::from)))
}
