//! Tangents for normal maps.

use crate::scene::{Primitive, TextureRef};
use bevy_mikktspace::{Geometry, TangentSpace, generate_tangents};
use glam::{Vec2, Vec3, Vec4};
use std::collections::HashMap;

/// Unit vector of any finite vector, however short or long; zero of zero.
pub(super) fn unit(vector: Vec3) -> Vec3 {
    let largest = vector.abs().max_element();
    if largest > 0.0 { (vector / largest).normalize_or_zero() } else { Vec3::ZERO }
}

/// A tangent of the file with unit length and a sign of 1 or -1; zero stays zero.
pub(super) fn orthonormal(tangent: Vec4) -> Vec4 {
    let direction = unit(tangent.truncate());
    if direction == Vec3::ZERO { Vec4::ZERO } else { direction.extend(if tangent.w < 0.0 { -1.0 } else { 1.0 }) }
}

/// Makes the tangents of a primitive for its normal map, splitting vertices where faces disagree. Follows MikkTSpace,
/// which glTF names (3.7.2.1), on the texture coordinates as the map's transform leaves them. A corner without any
/// tangent gets zero. False: the mesh would take MikkTSpace too long, and each face got its own tangents.
/// `pairs` counts the work done in the scene so far.
pub(super) fn generate(primitive: &mut Primitive, texture: &TextureRef, pairs: &mut u64) -> bool {
    let faces = Faces::new(primitive, texture);
    let more = faces.pairs();
    let usual = USUAL_PAIRS.saturating_mul(faces.triangles.len() as u64);
    let exact = more <= usual || pairs.saturating_add(more) <= MAX_PAIRS;
    if exact && more > usual {
        *pairs += more;
    }
    let corners = if exact { faces.mikktspace() } else { faces.by_face() };
    split(primitive, &corners);
    exact
}

/// Pairs of corners that share a position, in all meshes of a scene that have more than [`USUAL_PAIRS`], above which
/// MikkTSpace (whose time grows with them) is not run.
const MAX_PAIRS: u64 = 300_000_000;

/// Pairs per triangle that cost no more than the triangle itself; a regular mesh has about 20.
const USUAL_PAIRS: u64 = 64;

/// A primitive as MikkTSpace sees it.
struct Faces<'a> {
    triangles: &'a [[u32; 3]],
    positions: Vec<Vec3>,
    normals: Option<&'a [Vec3]>,
    uvs: Vec<Vec2>,
}

impl<'a> Faces<'a> {
    /// Positions and coordinates are scaled by a power of two to about 1, which changes no direction, lest products overflow.
    fn new(primitive: &'a Primitive, texture: &TextureRef) -> Self {
        let scale =
            |largest: f32| if largest > 0.0 { (-largest.log2().floor()).clamp(-126.0, 126.0).exp2() } else { 1.0 };
        let extent =
            primitive.positions.iter().fold(0.0_f32, |extent, position| extent.max(position.abs().max_element()));
        let positions = primitive.positions.iter().map(|position| *position * scale(extent)).collect();
        let uvs = primitive.uvs.get(texture.uv_set).map_or(&[][..], Vec::as_slice);
        let uvs: Vec<Vec2> = uvs.iter().map(|uv| texture.transform.transform_point2(*uv)).collect();
        let extent = uvs.iter().fold(0.0_f32, |extent, uv| extent.max(uv.abs().max_element()));
        let uvs = uvs.iter().map(|uv| *uv * scale(extent)).collect();
        Self { triangles: &primitive.triangles, positions, normals: primitive.normals.as_deref(), uvs }
    }

    fn vertex(&self, face: usize, corner: usize) -> usize {
        self.triangles.get(face).and_then(|triangle| triangle.get(corner)).map_or(0, |vertex| *vertex as usize)
    }

    fn point(&self, face: usize, corner: usize) -> Vec3 {
        self.positions.get(self.vertex(face, corner)).copied().unwrap_or_default()
    }

    fn uv(&self, face: usize, corner: usize) -> Vec2 {
        self.uvs.get(self.vertex(face, corner)).copied().unwrap_or_default()
    }

    fn normal_at(&self, face: usize, corner: usize) -> Vec3 {
        let given = self.normals.and_then(|normals| normals.get(self.vertex(face, corner)));
        match given {
            Some(normal) if *normal != Vec3::ZERO => *normal,
            _ => unit((self.point(face, 1) - self.point(face, 0)).cross(self.point(face, 2) - self.point(face, 0))),
        }
    }

    /// Pairs of corners at the same position that MikkTSpace may compare.
    fn pairs(&self) -> u64 {
        let mut corners: HashMap<[u32; 3], u64> = HashMap::new();
        for vertex in self.triangles.iter().flatten() {
            let position = self.positions.get(*vertex as usize).copied().unwrap_or_default();
            *corners.entry(position.to_array().map(f32::to_bits)).or_default() += 1;
        }
        corners.values().fold(0, |pairs, count| pairs.saturating_add(count.saturating_mul(*count)))
    }

    fn mikktspace(&self) -> Vec<Vec4> {
        let mut sink = Sink { faces: self, tangents: vec![Vec4::ZERO; self.triangles.len() * 3] };
        match generate_tangents(&mut sink) {
            Ok(()) => sink.tangents,
            Err(_) => self.by_face(),
        }
    }

    /// Direction of growing u in each face, made orthogonal to the normal.
    fn by_face(&self) -> Vec<Vec4> {
        let corner = |face: usize, corner: usize| {
            let (edge1, edge2) = (self.point(face, 1) - self.point(face, 0), self.point(face, 2) - self.point(face, 0));
            let (uv1, uv2) = (self.uv(face, 1) - self.uv(face, 0), self.uv(face, 2) - self.uv(face, 0));
            let area = uv1.perp_dot(uv2);
            let along = (edge1 * uv2.y - edge2 * uv1.y) * area.signum();
            let normal = self.normal_at(face, corner);
            // v points down in the picture, the bitangent up.
            clean(unit(along - normal * normal.dot(along)).extend(-area.signum()))
        };
        (0..self.triangles.len()).flat_map(|face| [corner(face, 0), corner(face, 1), corner(face, 2)]).collect()
    }
}

/// Zero for whatever is not a tangent.
fn clean(tangent: Vec4) -> Vec4 {
    if tangent.is_finite() && tangent.truncate() != Vec3::ZERO { tangent } else { Vec4::ZERO }
}

struct Sink<'a> {
    faces: &'a Faces<'a>,
    tangents: Vec<Vec4>,
}

impl Geometry for Sink<'_> {
    fn num_faces(&self) -> usize {
        self.faces.triangles.len()
    }

    fn num_vertices_of_face(&self, _face: usize) -> usize {
        3
    }

    fn position(&self, face: usize, corner: usize) -> [f32; 3] {
        self.faces.point(face, corner).to_array()
    }

    fn normal(&self, face: usize, corner: usize) -> [f32; 3] {
        self.faces.normal_at(face, corner).to_array()
    }

    fn tex_coord(&self, face: usize, corner: usize) -> [f32; 2] {
        self.faces.uv(face, corner).to_array()
    }

    fn set_tangent(&mut self, space: Option<TangentSpace>, face: usize, corner: usize) {
        if let (Some(space), Some(tangent)) = (space, self.tangents.get_mut(face * 3 + corner)) {
            let [x, y, z, sign] = space.tangent_encoded();
            // v points down in the picture, the bitangent up.
            *tangent = clean(unit(Vec3::new(x, y, z)).extend(-sign));
        }
    }
}

/// Gives each corner its tangent; corners of a vertex that agree keep sharing it.
fn split(primitive: &mut Primitive, corners: &[Vec4]) {
    let mut vertices: HashMap<(u32, [u32; 4]), u32> = HashMap::new();
    let mut sources: Vec<u32> = Vec::new();
    let mut tangents: Vec<Vec4> = Vec::new();
    for (corner, tangent) in primitive.triangles.iter_mut().flatten().zip(corners) {
        *corner = *vertices.entry((*corner, tangent.to_array().map(f32::to_bits))).or_insert_with(|| {
            sources.push(*corner);
            tangents.push(*tangent);
            tangents.len() as u32 - 1
        });
    }
    primitive.positions = gather(&primitive.positions, &sources);
    primitive.normals = primitive.normals.take().map(|normals| gather(&normals, &sources));
    primitive.colors = primitive.colors.take().map(|colors| gather(&colors, &sources));
    for uvs in &mut primitive.uvs {
        *uvs = gather(uvs, &sources);
    }
    if let Some(influences) = &mut primitive.influences {
        influences.joints = gather_groups(&influences.joints, influences.per_vertex, &sources);
        influences.weights = gather_groups(&influences.weights, influences.per_vertex, &sources);
    }
    for target in &mut primitive.targets {
        for list in [&mut target.positions, &mut target.normals, &mut target.tangents] {
            if !list.is_empty() {
                *list = gather(list, &sources);
            }
        }
    }
    primitive.tangents = Some(tangents);
}

fn gather<T: Copy + Default>(values: &[T], sources: &[u32]) -> Vec<T> {
    sources.iter().map(|source| values.get(*source as usize).copied().unwrap_or_default()).collect()
}

/// The same for values of which each vertex has `size`.
fn gather_groups<T: Copy + Default>(values: &[T], size: usize, sources: &[u32]) -> Vec<T> {
    let group = |source: &u32| *source as usize * size..(*source as usize + 1) * size;
    sources.iter().flat_map(|source| values.get(group(source)).unwrap_or_default()).copied().collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Mat3;

    const MAP: TextureRef = TextureRef { texture: 0, uv_set: 0, transform: Mat3::IDENTITY };

    /// A unit square in the xy plane, facing +z, its picture upright (v down) or mirrored.
    fn square(normals: bool, mirrored: bool) -> Primitive {
        let corners = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)];
        Primitive {
            positions: corners.iter().map(|(x, y)| Vec3::new(*x, *y, 0.0)).collect(),
            normals: normals.then(|| vec![Vec3::Z; 4]),
            uvs: vec![corners.iter().map(|(x, y)| Vec2::new(if mirrored { 1.0 - *x } else { *x }, 1.0 - *y)).collect()],
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            ..Primitive::default()
        }
    }

    fn assert_all(primitive: &Primitive, expected: Vec4) {
        for tangent in primitive.tangents.as_ref().unwrap() {
            assert!(tangent.abs_diff_eq(expected, 1e-5), "{tangent} is not {expected}");
        }
    }

    #[test]
    fn the_bitangent_points_up_in_the_picture() {
        for normals in [true, false] {
            let mut upright = square(normals, false);
            assert!(generate(&mut upright, &MAP, &mut 0));
            // cross(z, x) * 1 = y, against growing v.
            assert_all(&upright, Vec4::new(1.0, 0.0, 0.0, 1.0));
            assert_eq!(upright.positions.len(), 4, "agreeing corners stay shared");
            let mut mirrored = square(normals, true);
            assert!(generate(&mut mirrored, &MAP, &mut 0));
            assert_all(&mirrored, Vec4::new(-1.0, 0.0, 0.0, -1.0));
        }
    }

    #[test]
    fn the_transform_turns_tangents() {
        let quarter = Mat3::from_cols(Vec3::new(0.0, -1.0, 0.0), Vec3::new(1.0, 0.0, 0.0), Vec3::Z);
        let mut turned = square(true, false);
        generate(&mut turned, &TextureRef { transform: quarter, ..MAP }, &mut 0);
        // u' = v grows towards -y.
        assert_all(&turned, Vec4::new(0.0, -1.0, 0.0, 1.0));
    }

    #[test]
    fn mirrored_halves_are_split() {
        let mut both = square(true, false);
        both.positions.extend([Vec3::new(2.0, 0.0, 0.0), Vec3::new(2.0, 1.0, 0.0)]);
        both.normals.as_mut().unwrap().extend([Vec3::Z; 2]);
        both.uvs[0].extend([Vec2::new(0.0, 1.0), Vec2::new(0.0, 0.0)]);
        both.triangles.extend([[1, 4, 5], [1, 5, 2]]);
        both.colors = Some(vec![Vec4::ONE; 6]);
        assert!(generate(&mut both, &MAP, &mut 0));
        assert_eq!(both.positions.len(), 8, "the two vertices on the seam are doubled");
        assert_eq!((both.uvs[0].len(), both.colors.as_ref().unwrap().len()), (8, 8));
        let signs: Vec<f32> =
            both.triangles.iter().map(|[a, ..]| both.tangents.as_ref().unwrap()[*a as usize].w).collect();
        assert_eq!(signs, [1.0, 1.0, -1.0, -1.0]);
    }

    #[test]
    fn extremes_give_clean_tangents() {
        for (size, uv_size) in [(1e38_f32, 1e38_f32), (1e-38, 1e-38), (1e-44, 1e-44), (1.0, 0.0), (0.0, 1.0)] {
            let mut primitive = square(true, false);
            primitive.positions.iter_mut().for_each(|position| *position *= size);
            primitive.uvs[0].iter_mut().for_each(|uv| *uv *= uv_size);
            generate(&mut primitive, &MAP, &mut 0);
            for tangent in primitive.tangents.unwrap() {
                let length = tangent.truncate().length();
                assert!(
                    tangent == Vec4::ZERO || ((length - 1.0).abs() < 1e-4 && tangent.w.abs() == 1.0),
                    "{size} {uv_size}: {tangent}"
                );
            }
        }
    }

    #[test]
    fn a_huge_fan_takes_no_quadratic_time() {
        let rim = 300_000_u32;
        let angle = |i: u32| i as f32 / rim as f32 * std::f32::consts::TAU;
        let around = (0..=rim).map(|i| Vec3::new(angle(i).cos(), angle(i).sin(), 0.0));
        let mut fan =
            Primitive { positions: std::iter::once(Vec3::ZERO).chain(around).collect(), ..Primitive::default() };
        fan.uvs = vec![fan.positions.iter().map(|position| Vec2::new(position.x, -position.y)).collect()];
        fan.triangles = (1..=rim).map(|i| [0, i, i + 1]).collect();
        let start = std::time::Instant::now();
        assert!(!generate(&mut fan, &MAP, &mut 0));
        assert!(start.elapsed().as_secs() < 20, "{:?}", start.elapsed());
        let tangents = fan.tangents.unwrap();
        assert!(
            tangents.iter().filter(|tangent| tangent.abs_diff_eq(Vec4::new(1.0, 0.0, 0.0, 1.0), 1e-2)).count()
                > 2 * tangents.len() / 3
        );
    }

    #[test]
    fn given_tangents_are_cleaned() {
        assert_eq!(orthonormal(Vec4::new(0.0, 3.0, 0.0, 0.5)), Vec4::new(0.0, 1.0, 0.0, 1.0));
        assert_eq!(orthonormal(Vec4::new(0.0, 1e-30, 0.0, -2.0)), Vec4::new(0.0, 1.0, 0.0, -1.0));
        assert_eq!(orthonormal(Vec4::ZERO), Vec4::ZERO);
        assert_eq!(unit(Vec3::splat(3e38)), Vec3::splat(1.0 / 3.0_f32.sqrt()));
    }
}
