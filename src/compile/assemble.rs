//! Triangle soups -> trees, instances and the top level over them.

use super::bvh::{self, Tree, Visits};
use super::emitters;
use super::geometry::Soup;
use super::groups::{Group, corner_points, too_large};
use super::materials::Table;
use super::motion::MovingSoup;
use super::repeats;
use super::{Bounds, BvhNode, CompiledScene, Instance, Triangle};
use crate::scene::SceneError;
use glam::{DAffine3, DVec3};
use rayon::prelude::*;
use std::collections::BTreeSet;

/// Most nodes and triangles that a ray may visit on average, of those that meet a part of the scene. Ordinary scenes need about a
/// hundred; more than this have so many triangles that lie on each other that a slice of a render would take seconds.
const MOST_VISITS: f32 = 100_000.0;

/// A mesh in its tree.
#[derive(Default)]
pub struct Bottom {
    /// Of its triangles.
    pub tree: Tree,
    /// In leaf order.
    pub triangles: Vec<Triangle>,
    indices: Vec<[u32; 3]>,
    /// Emitting triangles: index among the mesh's, and mean luminance.
    pub lit: Vec<(u32, f32)>,
    /// Around all of it.
    pub bounds: Bounds,
}

impl Soup {
    /// Builds the tree, without triangles that lie on their like, and brings the others into its order.
    fn build(mut self, table: &Table) -> Bottom {
        let boxes: Vec<Bounds> = self.triangles.iter().map(Triangle::bounds).collect();
        let tree = bvh::build(&boxes, |_| Visits::ONE);
        let opaque = |triangle: &Triangle| table.is_opaque(triangle);
        if let Some(stays) = repeats::first_ones(&self.triangles, &boxes, &tree.by_place, opaque) {
            self.keep(&stays);
            return self.build(table);
        }
        let bounds = boxes.iter().fold(Bounds::default(), |a, b| a.union(*b));
        Bottom { bounds, ..Bottom::new(&self, tree) }
    }
}

impl Bottom {
    /// Brings triangles into the order of a tree. The bounds are still to be told.
    pub fn new(soup: &Soup, tree: Tree) -> Self {
        let mut bottom = Self::default();
        for (position, from) in (0..).zip(&tree.order) {
            let from = *from as usize;
            let mut triangle = soup.triangles[from];
            if soup.luminance[from] > 0.0 {
                triangle.light = bottom.lit.len() as u32;
                bottom.lit.push((position, soup.luminance[from]));
            }
            bottom.triangles.push(triangle);
            bottom.indices.push(soup.indices[from]);
        }
        bottom.tree = tree;
        bottom
    }
}

/// An instance before the top level orders it.
pub struct Standing {
    /// Index of its mesh among the bottoms.
    pub bottom: usize,
    /// To world, relative to the origin.
    pub map: DAffine3,
    bounds: Bounds,
    /// [`Instance::flags`].
    flags: u32,
}

/// Puts everything into trees and the trees into the scene.
///
/// # Errors
/// So much lies on each other that rays would take too long.
pub fn assemble(
    compiled: &mut CompiledScene,
    table: &Table,
    merged: Soup,
    soups: Vec<Soup>,
    moving: Option<MovingSoup>,
    groups: &[Group],
) -> Result<(), SceneError> {
    let mut bottoms: Vec<Bottom> = soups.into_par_iter().map(|soup| soup.build(table)).collect();
    bottoms.push(merged.build(table));
    let merged = bottoms.len() - 1;
    let mut standing = instances(&bottoms, groups, compiled.origin);
    repeats::keep_first_places(&mut standing, |bottom| bottoms[bottom].triangles.iter().all(|t| table.is_opaque(t)));
    let in_world =
        |bottom: usize, bounds: Bounds, flags: u32| Standing { bottom, map: DAffine3::IDENTITY, bounds, flags };
    let later = moving.map(|moving| {
        let (bottom, later) = moving.build();
        standing.push(in_world(bottoms.len(), bottom.bounds, Instance::MOVING));
        bottoms.push(bottom);
        later
    });
    compiled.two_level = !standing.is_empty();
    let empty = bottoms[merged].triangles.is_empty();
    if !(compiled.two_level && empty) {
        standing.push(in_world(merged, bottoms[merged].bounds, 0));
    }
    let mut order: Vec<u32> = vec![0];
    let mut visits = bottoms[merged].tree.visits;
    if compiled.two_level {
        let boxes: Vec<Bounds> = standing.iter().map(|place| place.bounds).collect();
        let top = bvh::build(&boxes, |place| bottoms[standing[place].bottom].tree.visits);
        (compiled.depth, compiled.nodes) = (top.depth, top.nodes);
        (order, visits) = (top.order, top.visits);
    }
    check_visits(visits)?;
    let roots = append_bottoms(compiled, &mut bottoms, &standing);
    for index in order {
        push_instance(compiled, &standing[index as usize], &bottoms, &roots, table);
    }
    compiled.stats.triangles = compiled.triangles.len() as u64;
    compiled.stats.instances = compiled.instances.len() as u64;
    if let (Some(later), Some((_, first_triangle))) = (later, roots.last()) {
        later.append(compiled, *first_triangle);
    }
    Ok(())
}

/// Refuses what would hold the device for seconds at a time.
fn check_visits(visits: Visits) -> Result<(), SceneError> {
    if visits.most <= MOST_VISITS {
        return Ok(());
    }
    let (seen, most) = (visits.most, MOST_VISITS);
    let detail = format!(
        "{seen:.0} triangles and nodes of the tree over them that a ray visits on average where most of them lie on each other; \
         at most {most:.0} are supported. Remove copies of the same surface, and cut long thin triangles"
    );
    Err(too_large(&detail))
}

/// All instances of meshes drawn several times that have something to show.
fn instances(bottoms: &[Bottom], groups: &[Group], origin: DVec3) -> Vec<Standing> {
    let mut standing = Vec::new();
    for (bottom, group) in groups.iter().enumerate().filter(|(bottom, _)| !bottoms[*bottom].triangles.is_empty()) {
        let points = corner_points(group.mesh);
        let maps = group.worlds.par_iter().map(|world| DAffine3 { translation: world.translation - origin, ..*world });
        let placed = maps.map(|map| Standing {
            bottom,
            map,
            bounds: instance_bounds(&points, &map),
            flags: u32::from(map.matrix3.determinant() < 0.0),
        });
        standing.par_extend(placed);
    }
    standing
}

/// Bounds of a placed mesh, as a ray sees it that goes through the rounded inverse of the map.
fn instance_bounds(points: &[DVec3], map: &DAffine3) -> Bounds {
    let placed = points.iter().map(|p| map.transform_point3(*p));
    let (min, max) = placed.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(min, max), p| (min.min(p), max.max(p)));
    // Rounding the inverse A of M moves a point x by at most |M| (ulp |A| (|x| + |t|)); a factor of 4 covers sums.
    let (m, inverse) = (map.matrix3, map.matrix3.inverse());
    let reach = min.abs().max(max.abs()) + map.translation.abs();
    let slack = m.abs() * (inverse.abs() * reach) * (4.0 * f64::from(f32::EPSILON));
    Bounds::outwards(min - slack, max + slack)
}

/// Moves triangles and nodes of all meshes that stand somewhere into the scene; returns (root, first triangle) of each.
fn append_bottoms(compiled: &mut CompiledScene, bottoms: &mut [Bottom], standing: &[Standing]) -> Vec<(u32, u32)> {
    let used: BTreeSet<usize> = standing.iter().map(|s| s.bottom).collect();
    let mut roots = vec![(0, 0); bottoms.len()];
    let mut deepest = 0;
    for index in used {
        let bottom = &mut bottoms[index];
        let (root, first_triangle) = (compiled.nodes.len() as u32, compiled.triangles.len() as u32);
        roots[index] = (root, first_triangle);
        deepest = deepest.max(bottom.tree.depth);
        compiled.nodes.extend(bottom.tree.nodes.drain(..).map(|node| shifted(node, root, first_triangle)));
        compiled.triangles.extend_from_slice(&bottom.triangles);
        compiled.indices.append(&mut bottom.indices);
    }
    compiled.depth += deepest;
    roots
}

/// A node whose indices count from elsewhere: word 4 is the first child node, word 5 the first primitive.
pub fn shifted(mut node: BvhNode, nodes: u32, primitives: u32) -> BvhNode {
    node.words[4] += nodes;
    node.words[5] += primitives;
    node
}

fn push_instance(
    compiled: &mut CompiledScene,
    standing: &Standing,
    bottoms: &[Bottom],
    roots: &[(u32, u32)],
    table: &Table,
) {
    let bottom = &bottoms[standing.bottom];
    let (root, first_triangle) = roots[standing.bottom];
    let index = compiled.instances.len() as u32;
    compiled.instances.push(Instance {
        to_world: rows(&standing.map),
        to_object: rows(&standing.map.inverse()),
        root,
        first_triangle,
        light_base: compiled.emitters.len() as u32,
        flags: standing.flags,
    });
    let emitters = emitters::of_instance(index, bottom, first_triangle, &table.materials, standing.map);
    compiled.emitters.extend(emitters);
    compiled.bounds = compiled.bounds.union(standing.bounds);
    compiled.stats.instanced_triangles += bottom.triangles.len() as u64;
}

/// Rows of a 3x4 matrix.
fn rows(map: &DAffine3) -> [[f32; 4]; 3] {
    let m = map.matrix3;
    std::array::from_fn(|i| [m.x_axis[i], m.y_axis[i], m.z_axis[i], map.translation[i]].map(|v| v as f32))
}
