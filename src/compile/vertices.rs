//! Vertex records: only the attributes that some drawn mesh has and some material reads.

use super::{NONE, VertexLayout};
use crate::scene::{Material, Primitive};
use glam::{DAffine3, DMat3, Vec2, Vec3, Vec4};

/// Most uv sets in a record.
pub const UV_SETS: usize = 2;

/// The union of what the drawn primitives need.
pub fn layout<'a>(drawn: impl Iterator<Item = (&'a Primitive, &'a Material)>, uv_sets: usize) -> VertexLayout {
    let (mut normal, mut tangent, mut color) = (false, false, false);
    for (primitive, material) in drawn {
        normal |= primitive.normals.is_some();
        tangent |= primitive.tangents.is_some() && material.reads_tangents();
        color |= primitive.colors.is_some();
    }
    let mut stride = 0;
    let mut place = |there: bool, words: u32| {
        let offset = if there { stride } else { NONE };
        stride += if there { words } else { 0 };
        offset
    };
    let normal = place(normal, 3);
    let tangent = place(tangent, 4);
    let color = place(color, 4);
    let uv = [place(uv_sets > 0, 2), place(uv_sets > 1, 2)];
    VertexLayout { stride, normal, tangent, color, uv }
}

/// How a mesh is moved before it is stored.
#[derive(Debug, Clone, Copy)]
pub struct Placement {
    /// To the space it is stored in.
    pub map: DAffine3,
    /// The same for normals.
    normal: DMat3,
    /// The map turns left into right.
    pub mirrored: bool,
}

impl Placement {
    /// A placement by a map. Normals go by its cofactors: the inverse transpose times the determinant, so that maps
    /// that flatten a mesh work too.
    pub fn new(map: DAffine3) -> Self {
        let m = map.matrix3;
        let mirrored = m.determinant() < 0.0;
        let cofactors = DMat3::from_cols(m.y_axis.cross(m.z_axis), m.z_axis.cross(m.x_axis), m.x_axis.cross(m.y_axis));
        Self { map, normal: if mirrored { -cofactors } else { cofactors }, mirrored }
    }

    /// A moved point, rounded.
    pub fn point(&self, p: Vec3) -> Vec3 {
        self.map.transform_point3(p.as_dvec3()).as_vec3()
    }

    fn normal(&self, n: Vec3) -> Vec3 {
        (self.normal * n.as_dvec3()).normalize_or_zero().as_vec3()
    }

    fn tangent(&self, t: Vec4) -> Vec4 {
        let direction = (self.map.matrix3 * t.truncate().as_dvec3()).normalize_or_zero().as_vec3();
        direction.extend(if self.mirrored { -t.w } else { t.w })
    }
}

/// Appends the records of a primitive. What it lacks is zero (a colour: white).
pub fn push(out: &mut Vec<u32>, layout: &VertexLayout, primitive: &Primitive, placement: &Placement) {
    if layout.stride == 0 {
        return;
    }
    out.reserve(primitive.positions.len() * layout.stride as usize);
    let mut write = |there: u32, values: &[f32]| {
        if there != NONE {
            out.extend(values.iter().map(|value| value.to_bits()));
        }
    };
    for i in 0..primitive.positions.len() {
        let normal = primitive.normals.as_ref().and_then(|n| n.get(i)).map_or(Vec3::ZERO, |n| placement.normal(*n));
        let tangent = primitive.tangents.as_ref().and_then(|t| t.get(i)).map_or(Vec4::ZERO, |t| placement.tangent(*t));
        let color = primitive.colors.as_ref().and_then(|c| c.get(i)).copied().unwrap_or(Vec4::ONE);
        write(layout.normal, &normal.to_array());
        write(layout.tangent, &tangent.to_array());
        write(layout.color, &color.to_array());
        for (set, there) in layout.uv.into_iter().enumerate() {
            write(there, &uv(primitive, set, i).to_array());
        }
    }
}

/// A texture coordinate; zero if the primitive has none.
pub fn uv(primitive: &Primitive, set: usize, vertex: usize) -> Vec2 {
    primitive.uvs.get(set).and_then(|uvs| uvs.get(vertex)).copied().unwrap_or(Vec2::ZERO)
}
