//! Which meshes stand where, and how each is stored: a mesh drawn once is merged with its like in world space; a mesh
//! drawn several times is stored once, with an instance each. A placement that cannot be inverted is merged in any case.

use super::VertexLayout;
use super::look::Sphere;
use super::walk::invalid;
use crate::scene::{Drawn, DrawnOver, Mesh, Moving, Primitive, SceneError, SceneErrorKind};
use glam::{DAffine3, DVec3};
use rayon::prelude::*;

/// Extents that are traced right. A triangle's normal needs the fourth power of its edges, which f32 holds from 1e-10 to
/// 1e9; at the lower end a thousandth of the extent is left for the triangles of a fine mesh.
const EXTENTS: std::ops::RangeInclusive<f32> = 1e-6..=1e9;
/// Most triangles that are stored.
const MAX_TRIANGLES: u64 = 1 << 27;
/// Most instances.
const MAX_INSTANCES: usize = 1 << 24;
/// Volume of a placement's unit cube, relative to its edges, below which it counts as flat.
const FLAT: f64 = 1e-6;

/// What is drawn, by how it is stored.
pub struct Groups<'a> {
    /// Drawn once each.
    pub merged: Vec<(&'a Mesh, DAffine3)>,
    /// Drawn several times each.
    pub instanced: Vec<Group<'a>>,
    /// Drawn once each while they move: mesh and place by moment. A mesh that moves is stored as often as it is drawn.
    pub moving: Vec<Vec<(&'a Mesh, DAffine3)>>,
    /// Variant of the materials, an index into [`Scene::variants`].
    pub variant: Option<usize>,
}

/// A mesh stored once and drawn several times.
pub struct Group<'a> {
    /// What.
    pub mesh: &'a Mesh,
    /// Where: object to world.
    pub worlds: Vec<DAffine3>,
}

impl<'a> Groups<'a> {
    /// Sorts what a scene of the file draws.
    pub fn new(drawn: &'a DrawnOver<'_>, variant: Option<usize>) -> Self {
        let steps = |moving: &'a Moving<'_>| -> Vec<_> {
            moving.steps.iter().map(|(mesh, world)| (mesh.as_ref().as_ref(), *world)).collect()
        };
        let mut moving: Vec<_> = drawn.moving.iter().map(steps).collect();
        moving.retain(|steps| steps.iter().all(|(_, world)| world.is_finite()));
        let mut groups = Self { merged: Vec::new(), instanced: Vec::new(), moving, variant };
        for Drawn { mesh, worlds } in &drawn.still {
            let mesh = mesh.as_ref();
            let worlds = worlds.iter().copied().filter(is_something);
            let (worlds, flat): (Vec<_>, Vec<_>) = worlds.partition(is_invertible);
            groups.merged.extend(flat.into_iter().map(|world| (mesh, world)));
            match worlds[..] {
                [] => {}
                [world] => groups.merged.push((mesh, world)),
                _ => groups.instanced.push(Group { mesh, worlds }),
            }
        }
        groups
    }

    fn meshes(&self) -> impl Iterator<Item = &'a Mesh> {
        let moving = self.moving.iter().filter_map(|steps| steps.first()).map(|(mesh, _)| *mesh);
        self.merged.iter().map(|(mesh, _)| *mesh).chain(self.instanced.iter().map(|group| group.mesh)).chain(moving)
    }

    /// Every mesh that is stored in the world, and where, those that move once for each moment.
    fn in_world(&self) -> impl ParallelIterator<Item = &(&'a Mesh, DAffine3)> {
        self.merged.par_iter().chain(self.moving.par_iter().flatten())
    }

    /// Everything that is stored.
    pub fn primitives(&self) -> impl Iterator<Item = &'a Primitive> {
        self.meshes().flat_map(|mesh| &mesh.primitives).map(|primitive| primitive.of_variant(self.variant))
    }

    /// Refuses too many triangles or instances.
    pub fn check_size(&self) -> Result<(), SceneError> {
        let of_mesh = |mesh: &Mesh| mesh.primitives.iter().map(|p| p.triangles.len() as u64).sum::<u64>();
        let later = self.moving.iter().flat_map(|steps| steps.iter().skip(1)).map(|(mesh, _)| of_mesh(mesh));
        let triangles: u64 = self.primitives().map(|primitive| primitive.triangles.len() as u64).chain(later).sum();
        let instances: usize = self.instanced.iter().map(|group| group.worlds.len()).sum();
        if triangles > MAX_TRIANGLES {
            return Err(too_large(&format!("{triangles} triangles; at most {MAX_TRIANGLES} are supported")));
        }
        if instances > MAX_INSTANCES {
            return Err(too_large(&format!("{instances} instances; at most {MAX_INSTANCES} are supported")));
        }
        Ok(())
    }

    /// Refuses more vertices than 32 bits can count words of.
    pub fn check_vertices(&self, layout: &VertexLayout) -> Result<(), SceneError> {
        let of_mesh = |mesh: &Mesh| mesh.primitives.iter().map(|p| p.positions.len() as u64).sum::<u64>();
        let later = self.moving.iter().flat_map(|steps| steps.iter().skip(1)).map(|(mesh, _)| of_mesh(mesh));
        let vertices: u64 = self.primitives().map(|primitive| primitive.positions.len() as u64).chain(later).sum();
        let words = vertices * u64::from(layout.stride.max(1));
        if words > u64::from(u32::MAX) {
            return Err(too_large(&format!("{vertices} vertices of {} words", layout.stride)));
        }
        Ok(())
    }

    /// Centre of the bounds of all triangles and spheres.
    pub fn centre(&self, spheres: &[Sphere]) -> Result<DVec3, SceneError> {
        let empty = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        let join = |a: (DVec3, DVec3), b: (DVec3, DVec3)| (a.0.min(b.0), a.1.max(b.1));
        let around = |points: &[DVec3], world: &DAffine3| {
            let points = points.iter().map(|p| world.transform_point3(*p)).filter(|p| p.is_finite());
            points.fold(empty, |all, p| (all.0.min(p), all.1.max(p)))
        };
        let merged = self.in_world().map(|(mesh, world)| around(&corner_points(mesh), world));
        let instanced = self.instanced.iter().map(|group| {
            let points = corner_points(group.mesh);
            group.worlds.par_iter().map(|world| around(&points, world)).reduce(|| empty, join)
        });
        let spheres = spheres.iter().map(|sphere| (sphere.center - sphere.radius, sphere.center + sphere.radius));
        let spheres = spheres.fold(empty, join);
        let (min, max) = join(spheres, join(merged.reduce(|| empty, join), instanced.fold(empty, join)));
        if !min.cmple(max).all() {
            return Ok(DVec3::ZERO);
        }
        check_extent("the scene", max - min)?;
        for group in &self.instanced {
            // These are traced in their own space.
            let (min, max) = around(&corner_points(group.mesh), &DAffine3::IDENTITY);
            check_extent("a mesh that is drawn several times", max - min)?;
        }
        Ok((min + max) * 0.5)
    }
}

/// Refuses what is too large or too small for f32; a point, which has no surface, passes.
fn check_extent(what: &str, size: DVec3) -> Result<(), SceneError> {
    let extent = size.max_element();
    if extent <= 0.0 || EXTENTS.contains(&(extent as f32)) {
        return Ok(());
    }
    let (least, most) = (EXTENTS.start(), EXTENTS.end());
    let code = if extent > f64::from(*most) { "extent_too_large" } else { "extent_too_small" };
    let size = if extent.is_finite() { format!("{extent:.3e} units") } else { "more than 1e308 units".to_owned() };
    let detail = format!("{what} is {size} across; from {least:e} to {most:e} are supported: scale it");
    Err(invalid(code, "/scenes", &detail))
}

/// Whether a placement leaves anything of a mesh.
fn is_something(world: &DAffine3) -> bool {
    world.is_finite() && world.matrix3.to_cols_array().iter().any(|v| *v != 0.0)
}

fn is_invertible(world: &DAffine3) -> bool {
    let m = world.matrix3;
    let edges = m.x_axis.length() * m.y_axis.length() * m.z_axis.length();
    m.determinant().abs() > FLAT * edges && world.inverse().is_finite()
}

/// A [`SceneError`] of a scene that is beyond a limit.
pub fn too_large(detail: &str) -> SceneError {
    let detail = format!("the scene has {detail}; simplify its meshes");
    SceneError { kind: SceneErrorKind::TooLarge, code: "scene_too_large", pointer: "/meshes".into(), detail }
}

/// The vertices that some triangle of the mesh uses.
pub fn corner_points(mesh: &Mesh) -> Vec<DVec3> {
    let mut points = Vec::new();
    for primitive in &mesh.primitives {
        let mut used = vec![false; primitive.positions.len()];
        for index in primitive.triangles.iter().flatten() {
            if let Some(used) = used.get_mut(*index as usize) {
                *used = true;
            }
        }
        points.extend(primitive.positions.iter().zip(used).filter(|(_, used)| *used).map(|(p, _)| p.as_dvec3()));
    }
    points
}
