//! Morph targets and skins: vertices moved in f64, stored in f32 (glTF 2.0, 3.7.2.2 and 3.7.3).

use super::{Mesh, Primitive};
use glam::{DAffine3, DMat3, DVec3, Vec3, Vec4};
use rayon::prelude::*;

/// What moves the vertices of meshes.
#[derive(Debug, Clone, Default)]
pub struct Skin {
    /// Name in the file.
    pub name: Option<String>,
    /// Indices into [`super::Scene::nodes`].
    pub joints: Vec<usize>,
    /// By joint: object to the joint's space as the mesh was bound.
    pub inverse_bind: Vec<DAffine3>,
}

/// By how much the joints of a skin move each vertex.
#[derive(Debug, Clone, Default)]
pub struct Influences {
    /// Entries per vertex, four for each JOINTS_n.
    pub per_vertex: usize,
    /// Indices into [`Skin::joints`].
    pub joints: Vec<u16>,
    /// Not negative; those of a vertex add up to 1.
    pub weights: Vec<f32>,
}

/// A morph target: differences to the base mesh. A list is empty (nothing moves) or has one entry per vertex.
#[derive(Debug, Clone, Default)]
pub struct Target {
    /// Of positions.
    pub positions: Vec<Vec3>,
    /// Of normals of unit length.
    pub normals: Vec<Vec3>,
    /// Of tangents of unit length, without the sign.
    pub tangents: Vec<Vec3>,
}

impl Mesh {
    fn all(&self) -> impl Iterator<Item = &Primitive> {
        self.primitives
            .iter()
            .flat_map(|primitive| primitive.alternatives.iter().map(|(_, other)| other).chain([primitive]))
    }

    /// Whether joints move any of it.
    pub fn is_skinned(&self) -> bool {
        self.all().any(|primitive| primitive.influences.is_some())
    }

    /// Whether morph targets with these weights move any of it.
    pub fn is_morphed(&self, weights: &[f64]) -> bool {
        let moves = |(target, weight): (&Target, &f64)| {
            let lists = [&target.positions, &target.normals, &target.tangents];
            *weight != 0.0 && lists.iter().any(|list| !list.is_empty())
        };
        self.all().any(|primitive| primitive.targets.iter().zip(weights).any(moves))
    }
}

/// The joints of a skin at a moment.
pub(super) struct Joints {
    /// By joint: object to world.
    maps: Vec<DAffine3>,
    /// Where vertices go that no joint moves.
    node: DAffine3,
}

impl Joints {
    /// `worlds` are those of all nodes; `node` that of the node which shows the mesh, whose place joints make void.
    pub(super) fn new(skin: &Skin, worlds: &[DAffine3], node: DAffine3) -> Self {
        let joint = |(joint, bind): (&usize, &DAffine3)| worlds.get(*joint).map_or(node, |world| *world * *bind);
        Self { maps: skin.joints.iter().zip(&skin.inverse_bind).map(joint).collect(), node }
    }

    /// Object to world for a vertex: the weighted sum of its joints' maps.
    fn map(&self, influences: Option<&Influences>, vertex: usize) -> DAffine3 {
        let Some(influences) = influences else { return self.node };
        let range = vertex * influences.per_vertex..(vertex + 1) * influences.per_vertex;
        let joints = influences.joints.get(range.clone()).unwrap_or_default();
        let weights = influences.weights.get(range).unwrap_or_default();
        let mut sum = DAffine3::ZERO;
        for (joint, weight) in joints.iter().zip(weights).filter(|(_, weight)| **weight != 0.0) {
            let map = self.maps.get(usize::from(*joint)).unwrap_or(&self.node);
            sum.matrix3 += map.matrix3 * f64::from(*weight);
            sum.translation += map.translation * f64::from(*weight);
        }
        sum
    }
}

/// A mesh with its morph targets applied, in its own space; none: not finite.
pub(super) fn morphed(mesh: &Mesh, weights: &[f64]) -> Option<Mesh> {
    let moved = each(mesh, &|primitive| Moved::new(primitive, weights, &|_| DAffine3::IDENTITY));
    store(mesh, moved, DVec3::ZERO)
}

/// A mesh moved by its morph targets, then by joints, with the world transform at which it is to be drawn: a mere
/// translation to its centre, near which f32 is precise. None: not finite.
pub(super) fn skinned(mesh: &Mesh, weights: &[f64], joints: &Joints) -> Option<(Mesh, DAffine3)> {
    let moved = each(mesh, &|primitive| {
        Moved::new(primitive, weights, &|vertex| joints.map(primitive.influences.as_ref(), vertex))
    });
    let points =
        moved.iter().flat_map(|(moved, others)| others.iter().chain([moved])).flat_map(|moved| &moved.positions);
    let (min, max) = points.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(min, max), p| (min.min(*p), max.max(*p)));
    let centre = if min.cmple(max).all() { (min + max) * 0.5 } else { DVec3::ZERO };
    Some((store(mesh, moved, centre)?, DAffine3::from_translation(centre)))
}

/// The vertices of a primitive and those of its alternatives.
type Family = (Moved, Vec<Moved>);

fn each(mesh: &Mesh, moved: &(dyn Fn(&Primitive) -> Moved + Sync)) -> Vec<Family> {
    let family = |primitive: &Primitive| {
        (moved(primitive), primitive.alternatives.iter().map(|(_, other)| moved(other)).collect())
    };
    mesh.primitives.par_iter().map(family).collect()
}

fn store(mesh: &Mesh, moved: Vec<Family>, centre: DVec3) -> Option<Mesh> {
    let primitives = mesh.primitives.iter().zip(moved).map(|(primitive, (moved, others))| {
        let others = primitive.alternatives.iter().zip(others);
        let alternatives =
            others.map(|((variants, other), moved)| Some((variants.clone(), moved.store(other, centre)?)));
        Some(Primitive { alternatives: alternatives.collect::<Option<_>>()?, ..moved.store(primitive, centre)? })
    });
    Some(Mesh { name: mesh.name.clone(), primitives: primitives.collect::<Option<_>>()? })
}

/// Vertices of a primitive after the move.
struct Moved {
    positions: Vec<DVec3>,
    normals: Option<Vec<Vec3>>,
    tangents: Option<Vec<Vec4>>,
    /// The move turned left into right.
    mirrored: bool,
}

impl Moved {
    fn new(primitive: &Primitive, weights: &[f64], map: &(dyn Fn(usize) -> DAffine3 + Sync)) -> Self {
        let targets: Vec<(&Target, f64)> =
            primitive.targets.iter().zip(weights).filter(|(_, w)| **w != 0.0).map(|(t, w)| (t, *w)).collect();
        let count = primitive.positions.len();
        let maps: Vec<DAffine3> = (0..count).into_par_iter().map(map).collect();
        // Most vertices decide: a mesh is turned inside out as a whole, or not at all.
        let turned = maps.par_iter().filter(|map| map.matrix3.determinant() < 0.0).count();
        let mirrored = turned * 2 > count;
        let position = |(i, base): (usize, &Vec3)| {
            maps[i].transform_point3(base.as_dvec3() + sum(&targets, i, |target| &target.positions))
        };
        let positions: Vec<DVec3> = primitive.positions.par_iter().enumerate().map(position).collect();
        let normal = |(i, base): (usize, &Vec3)| {
            let normal = base.as_dvec3() + sum(&targets, i, |target| &target.normals);
            (cofactors(&maps[i].matrix3) * normal).normalize_or_zero().as_vec3()
        };
        let normals = primitive.normals.as_ref();
        let normals: Option<Vec<Vec3>> = normals.map(|normals| normals.par_iter().enumerate().map(normal).collect());
        let tangent = |(i, base): (usize, &Vec4)| {
            let moved = base.truncate().as_dvec3() + sum(&targets, i, |target| &target.tangents);
            let along = maps[i].matrix3 * moved;
            let normal = normals.as_ref().and_then(|normals| normals.get(i)).map_or(DVec3::ZERO, |n| n.as_dvec3());
            let direction = (along - normal * normal.dot(along)).normalize_or_zero().as_vec3();
            direction.extend(if mirrored { -base.w } else { base.w })
        };
        let tangents = primitive.tangents.as_ref();
        let tangents = tangents.map(|tangents| tangents.par_iter().enumerate().map(tangent).collect());
        Self { positions, normals, tangents, mirrored }
    }

    fn store(self, source: &Primitive, centre: DVec3) -> Option<Primitive> {
        let positions: Vec<Vec3> = self.positions.iter().map(|position| (*position - centre).as_vec3()).collect();
        let turned =
            |triangle: &[u32; 3]| if self.mirrored { [triangle[0], triangle[2], triangle[1]] } else { *triangle };
        positions.iter().all(|position| position.is_finite()).then(|| Primitive {
            positions,
            normals: self.normals,
            tangents: self.tangents,
            uvs: source.uvs.clone(),
            colors: source.colors.clone(),
            triangles: source.triangles.iter().map(turned).collect(),
            material: source.material,
            ..Primitive::default()
        })
    }
}

/// The weighted differences of a vertex.
fn sum<'a>(targets: &[(&'a Target, f64)], vertex: usize, list: impl Fn(&'a Target) -> &'a Vec<Vec3>) -> DVec3 {
    let difference = |target| list(target).get(vertex).map_or(DVec3::ZERO, |difference| difference.as_dvec3());
    targets.iter().map(|(target, weight)| difference(*target) * *weight).sum()
}

/// What moves normals: the inverse transpose, times the size of the determinant.
fn cofactors(m: &DMat3) -> DMat3 {
    let cofactors = DMat3::from_cols(m.y_axis.cross(m.z_axis), m.z_axis.cross(m.x_axis), m.x_axis.cross(m.y_axis));
    if m.determinant() < 0.0 { -cofactors } else { cofactors }
}
