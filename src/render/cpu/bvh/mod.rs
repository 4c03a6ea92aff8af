//! Rays against triangles: a float BVH of eight children per node, blocks of four triangles as leaves.
//!
//! Boxes are tested in f32, conservatively ([`boxes`]); triangles in f64, watertight ([`triangle`]). A hit depends on the
//! scene and the ray alone: neither on the vector unit nor on the order of the tree.

#[cfg(target_arch = "x86_64")]
mod avx2;
mod boxes;
mod build;
mod gather;
mod simd;
pub(super) mod sphere;
#[cfg(test)]
mod tests;
mod traverse;
mod triangle;

use super::motion::Moment;
use crate::compile::NONE;
use boxes::Node;
use glam::{DAffine3, DVec3};
use sphere::Sphere;
pub use traverse::Unit;
use triangle::Block;

/// A ray in world space relative to [`CompiledScene::origin`](crate::compile::CompiledScene::origin).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ray {
    /// Where it starts.
    pub origin: DVec3,
    /// Where it goes; of any length from 1e-200 to 1e200.
    pub direction: DVec3,
    /// Hits lie strictly between 0 and this multiple of the direction.
    pub t_max: f64,
    /// What it begins and what it ends on. A flat triangle cannot be met again from itself, but the distance to a sliver has an error
    /// of its length over its width, which no origin could be moved clear of.
    pub ends: [TriangleId; 2],
    /// When it meets what moves.
    pub moment: Moment,
}

/// A triangle of an instance.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TriangleId {
    /// Index into [`CompiledScene::triangles`](crate::compile::CompiledScene::triangles).
    pub triangle: u32,
    /// Index into [`CompiledScene::instances`](crate::compile::CompiledScene::instances).
    pub instance: u32,
}

impl TriangleId {
    /// No triangle.
    pub const NONE: Self = Self { triangle: NONE, instance: NONE };
}

impl From<&Hit> for TriangleId {
    fn from(hit: &Hit) -> Self {
        Self { triangle: hit.triangle, instance: hit.instance }
    }
}

/// Where a ray meets a triangle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hit {
    /// Multiple of the ray's direction.
    pub t: f64,
    /// Weight of the triangle's second vertex; of a sphere [`sphere::SphereHit::place`], and so is `v`.
    pub u: f64,
    /// Weight of its third vertex.
    pub v: f64,
    /// Index into [`CompiledScene::triangles`](crate::compile::CompiledScene::triangles).
    pub triangle: u32,
    /// Index into [`CompiledScene::instances`](crate::compile::CompiledScene::instances).
    pub instance: u32,
}

/// The trees of a scene.
#[derive(Debug)]
pub struct Bvh {
    /// Of all trees.
    nodes: Vec<Node>,
    /// Leaves of the triangles' trees.
    blocks: Vec<Block>,
    /// Further leaves, numbered from [`Child::LAST_LEAF`] down.
    spheres: Vec<Sphere>,
    /// Tree of the instances, whose leaves are instances; none: the one instance is the world itself.
    top: Option<Tree>,
    /// Trees of triangles.
    trees: Vec<Tree>,
    instances: Vec<Instance>,
    /// Some of them move.
    moves: bool,
    unit: Unit,
}

/// One tree among the nodes.
#[derive(Debug, Clone, Copy)]
struct Tree {
    root: u32,
    /// Power of two that takes coordinates to the units of its boxes.
    scale: f64,
}

/// A placed tree.
#[derive(Debug, Clone, Copy)]
struct Instance {
    to_object: DAffine3,
    /// Index into [`Bvh::trees`].
    tree: u32,
    /// It has a tree for each piece of its motion, of which that is the first. Leaves are two blocks: where its triangles are
    /// at the beginning of the piece and at the end.
    moves: bool,
}

/// What a [`Bvh`] is made of.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stats {
    /// Nodes of all trees.
    pub nodes: usize,
    /// Children per node.
    pub children_per_node: f64,
    /// Leaves of four triangles at most.
    pub blocks: usize,
    /// Triangles per leaf.
    pub triangles_per_block: f64,
    /// Memory.
    pub bytes: usize,
}

impl Bvh {
    /// The nearest hit. `accept` is asked about triangles with [`ALPHA`](crate::compile::Triangle::ALPHA) only, at most once each and in
    /// no particular order; false lets the ray pass.
    ///
    /// Of hits at the same distance it is that of the lowest instance and triangle. A ray that is not finite or has no
    /// direction (of such a length) meets nothing.
    pub fn closest(&self, ray: &Ray, accept: impl FnMut(&Hit) -> bool) -> Option<Hit> {
        traverse::search::<false>(self, ray, accept)
    }

    /// Whether there is any hit; `accept` as in [`Bvh::closest`].
    pub fn occluded(&self, ray: &Ray, accept: impl FnMut(&Hit) -> bool) -> bool {
        traverse::search::<true>(self, ray, accept).is_some()
    }

    /// What it is made of.
    pub fn stats(&self) -> Stats {
        let children: usize = self.nodes.iter().map(Node::len).sum();
        let triangles: usize = self.blocks.iter().map(Block::len).sum();
        Stats {
            nodes: self.nodes.len(),
            children_per_node: children as f64 / self.nodes.len().max(1) as f64,
            blocks: self.blocks.len(),
            triangles_per_block: triangles as f64 / self.blocks.len().max(1) as f64,
            bytes: size_of_val(&self.nodes[..]) + size_of_val(&self.blocks[..]) + size_of_val(&self.instances[..]),
        }
    }
}
