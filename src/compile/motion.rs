//! What moves while the shutter is open: its triangles at the ends of straight pieces of their way, a tree for each piece.
//!
//! Every vertex goes along the straight line from where it is at one moment to where it is at the next, and so do normals, tangents
//! and the camera's matrix (compare the motion steps of Cycles). All are linear in the same time, so that what goes with the
//! camera stands still in the picture, whatever turns both.

use super::assemble::{Bottom, shifted};
use super::geometry::{Soup, Surfaces};
use super::groups::Groups;
use super::vertices::{self, Placement};
use super::{Bounds, BvhNode, CompiledScene, Emitter, Triangle, bvh, moment, quantize};
use crate::params::{FieldError, RenderParams};
use crate::scene::{Moment, Scene};
use glam::{DAffine3, Vec3};
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;

/// Growth of a box that covers what kernels compute of places between two moments, relative to the coordinates.
const ROUNDING: f64 = 1e-6;

/// What of a [`CompiledScene`] moves: its last triangles and vertices. Behind these lie as many further lists of them as there
/// are pieces: where they are at the end of each piece, which is the beginning of the next.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Motion {
    /// Pieces of equal time; 0: no triangle moves, and all else is 0.
    pub pieces: u32,
    /// Triangles from this one on move, which all belong to one instance ([`Instance::MOVING`](super::Instance::MOVING)).
    pub first_triangle: u32,
    /// How many.
    pub triangles: u32,
    /// Vertices from this one on move.
    pub first_vertex: u32,
    /// How many.
    pub vertices: u32,
    /// Nodes of the tree of a piece. The instance's root is that of the first, and the trees lie one behind the other.
    pub nodes: u32,
}

impl Motion {
    /// Whether a triangle moves.
    pub fn moves(&self, triangle: u32) -> bool {
        self.pieces > 0 && triangle >= self.first_triangle
    }
}

/// The scene at the ends of the pieces into which the request's shutter cuts time; empty: there is no shutter, or nothing that
/// could move.
///
/// # Errors
/// The file has no such animation.
pub fn poses(scene: &Scene, params: &RenderParams) -> Result<Vec<Scene>, FieldError> {
    let (Some(shutter), Some(moment)) = (params.open_shutter(), moment(scene, params)?) else { return Ok(Vec::new()) };
    let part = |step: u32| f64::from(step) / f64::from(shutter.steps);
    let time = |step| moment.time + shutter.open + (shutter.close - shutter.open) * part(step);
    Ok((0..=shutter.steps).map(|step| scene.at(Some(Moment { time: time(step), ..moment }))).collect())
}

/// Triangles that move, before they are in trees.
pub struct MovingSoup {
    /// As they stand when the shutter opens.
    pub soup: Soup,
    /// Corners at the later moments, in the order of `soup`.
    later: Vec<Vec<[Vec3; 3]>>,
}

impl MovingSoup {
    /// Moves everything that moves to world space, and stores its vertices; none: there is nothing.
    pub fn new(groups: &Groups, surfaces: &Surfaces, compiled: &mut CompiledScene) -> Option<Self> {
        let pieces = groups.moving.first().map_or(0, |steps| steps.len().saturating_sub(1));
        let first_vertex = compiled.vertex_count();
        let mut vertices = 0;
        let mut soup = Soup::default();
        soup.moves = true;
        // Where the corners of each triangle are among the positions of a moment.
        let mut places = Vec::new();
        let mut later = Vec::new();
        for step in 0..=pieces {
            let mut positions: Vec<Vec3> = Vec::new();
            for (mesh, world) in groups.moving.iter().filter_map(|steps| steps.get(step)) {
                let map = DAffine3 { translation: world.translation - compiled.origin, ..*world };
                let placement = Placement::new(map);
                for primitive in mesh.primitives.iter().map(|primitive| primitive.of_variant(surfaces.variant)) {
                    let (first, before) = (compiled.vertex_count(), positions.len() as u32);
                    vertices::push(&mut compiled.vertices, &compiled.layout, primitive, &placement);
                    positions.extend(primitive.positions.iter().map(|p| placement.point(*p)));
                    if step == 0 {
                        soup.add_primitive(primitive, &placement, surfaces, first, &mut compiled.stats);
                        let added = soup.indices.iter().skip(places.len());
                        places.extend(
                            added.map(|indices| indices.map(|index| index - first + before)).collect::<Vec<_>>(),
                        );
                    }
                }
            }
            if step == 0 {
                vertices = compiled.vertex_count() - first_vertex;
            } else {
                let corner = |index: u32| positions.get(index as usize).copied().unwrap_or_default();
                later.push(places.iter().map(|indices: &[u32; 3]| indices.map(corner)).collect());
            }
        }
        if soup.triangles.is_empty() {
            return None;
        }
        compiled.motion = Motion { pieces: pieces as u32, first_vertex, vertices, ..Motion::default() };
        Some(Self { soup, later })
    }

    /// A list of the triangles for each moment.
    fn over_time(&self) -> Vec<Vec<Triangle>> {
        let moved = |(triangle, corners): (&Triangle, &[Vec3; 3])| {
            let [v0, v1, v2] = corners.map(|corner| corner.to_array());
            Triangle { v0, v1, v2, ..*triangle }
        };
        let at = |corners: &Vec<[Vec3; 3]>| self.soup.triangles.iter().zip(corners).map(moved).collect();
        std::iter::once(self.soup.triangles.clone()).chain(self.later.iter().map(at)).collect()
    }

    /// Builds a tree for each piece, which differ in their boxes alone. What is handed out has that of the first piece.
    pub fn build(self) -> (Bottom, Later) {
        let steps = self.over_time();
        let boxes: Vec<Vec<Bounds>> = steps.windows(2).map(|ends| swept(&ends[0], &ends[1])).collect();
        let tree = bvh::build(boxes.get(boxes.len() / 2).map_or(&[], |boxes| boxes), |_| bvh::Visits::ONE);
        let mut bottom = Bottom::new(&self.soup, tree);
        let order = &bottom.tree.order;
        let in_order = |step: &Vec<Triangle>| -> Vec<Triangle> {
            let places = order.iter().map(|from| step[*from as usize]).zip(&bottom.triangles);
            places.map(|(moved, first)| Triangle { v0: moved.v0, v1: moved.v1, v2: moved.v2, ..*first }).collect()
        };
        let triangles = steps.iter().skip(1).map(in_order).collect();
        let refitted = |boxes: &Vec<Bounds>| {
            let mut nodes = bottom.tree.nodes.clone();
            quantize::refit(&mut nodes, |leaf| boxes[order[leaf] as usize]);
            nodes
        };
        let mut trees: VecDeque<Vec<BvhNode>> = boxes.iter().map(refitted).collect();
        if let Some(first) = trees.pop_front() {
            bottom.tree.nodes = first;
        }
        bottom.bounds = boxes.iter().flatten().fold(Bounds::default(), |all, b| all.union(*b));
        let nodes = bottom.tree.nodes.len() as u32;
        (bottom, Later { trees, triangles, nodes })
    }
}

/// Of what moves, what comes behind the first piece.
pub struct Later {
    /// By piece.
    trees: VecDeque<Vec<BvhNode>>,
    /// By moment.
    triangles: Vec<Vec<Triangle>>,
    /// Of each tree.
    nodes: u32,
}

impl Later {
    /// Puts it behind everything else, whose last triangles, from `first_triangle` on, are those that move.
    pub fn append(self, compiled: &mut CompiledScene, first_triangle: u32) {
        compiled.motion.first_triangle = first_triangle;
        compiled.motion.triangles = compiled.triangles.len() as u32 - first_triangle;
        compiled.motion.nodes = self.nodes;
        for tree in self.trees {
            let root = compiled.nodes.len() as u32;
            compiled.nodes.extend(tree.into_iter().map(|node| shifted(node, root, first_triangle)));
        }
        compiled.triangles.extend(self.triangles.into_iter().flatten());
        compiled.average_areas();
    }
}

/// Boxes around what goes along straight lines between two moments.
fn swept(before: &[Triangle], after: &[Triangle]) -> Vec<Bounds> {
    before.iter().zip(after).map(|(before, after)| before.swept_to(after)).collect()
}

impl Triangle {
    /// The box around all places on the way to another.
    pub fn swept_to(&self, other: &Self) -> Bounds {
        let bounds = self.bounds().union(other.bounds());
        let (min, max) = (bounds.min.as_dvec3(), bounds.max.as_dvec3());
        let slack = min.abs().max(max.abs()) * ROUNDING;
        Bounds::outwards(min - slack, max + slack)
    }
}

impl CompiledScene {
    /// A triangle at a moment, which for one that stands still must be the first.
    pub fn triangle_at(&self, triangle: u32, step: u32) -> Triangle {
        self.triangles[(triangle + step * self.motion.triangles) as usize]
    }

    /// Gives emitters that move the mean of their areas: what they are drawn by.
    fn average_areas(&mut self) {
        let motion = self.motion;
        let mean = |emitter: &Emitter| {
            let areas = (0..=motion.pieces).map(|step| self.triangle_at(emitter.triangle, step).area());
            (areas.sum::<f64>() / f64::from(motion.pieces + 1)) as f32
        };
        let areas: Vec<f32> =
            self.emitters.iter().map(|e| if motion.moves(e.triangle) { mean(e) } else { e.area }).collect();
        self.emitters.iter_mut().zip(areas).for_each(|(emitter, area)| emitter.area = area);
    }
}
