//! Which triangles lie together: the topology of a scene's compressed trees, made fit for nodes of plain boxes and leaves
//! of more primitives.
//!
//! Testing eight boxes costs the same however many are in use, and so does a leaf. Hence leaves of a node are joined where the
//! joint box is hardly larger than the two together (surface area heuristic), and nodes are dissolved into their parents
//! where there is room. (The optimal cut of a binary tree into such nodes was tried: no faster, and three times the time to build.)

use crate::compile::{Bounds, BvhNode};
use glam::Vec3;
use obvhs::cwbvh::node::CwBvhNode;
use rayon::prelude::*;

/// Children of a node.
const WIDTH: usize = 8;
/// How much larger than two leaves together one may be that takes their place: measured, as fast as 1 and a fifth smaller.
const JOIN: f64 = 1.2;
/// Levels from the root that are worth a thread.
const PARALLEL: u32 = 4;
/// The box of nothing.
pub const EMPTY: Bounds = Bounds { min: Vec3::INFINITY, max: Vec3::NEG_INFINITY };

/// A subtree and its box.
pub struct Item {
    pub bounds: Bounds,
    pub content: Content,
}

/// What a subtree is.
pub enum Content {
    /// Primitives.
    Leaf(Vec<u32>),
    /// At most [`WIDTH`] subtrees.
    Node(Vec<Item>),
}

/// A tree in the compressed format, and the primitives in it.
pub struct Source<'a, F, A> {
    /// Of all trees.
    pub nodes: &'a [BvhNode],
    /// Most primitives of a leaf.
    pub leaf_size: usize,
    /// The box of a primitive.
    pub bounds: F,
    /// Whether a primitive must have a leaf of its own.
    pub alone: A,
}

/// The box around all.
pub fn hull(items: &[Item]) -> Bounds {
    items.iter().fold(EMPTY, |all, item| all.union(item.bounds))
}

impl<F: Fn(u32) -> Bounds + Sync, A: Fn(u32) -> bool + Sync> Source<'_, F, A> {
    /// The children of a node, and all below them.
    pub fn gather(&self, index: u32, level: u32) -> Vec<Item> {
        let node: CwBvhNode = bytemuck::cast(self.nodes[index as usize]);
        let slots: Vec<usize> = (0..WIDTH).filter(|slot| node.child_meta[*slot] != 0).collect();
        let child = |slot: usize| {
            if node.is_leaf(slot) {
                let (first, count) = node.child_primitives(slot);
                self.leaf(&Vec::from_iter(first..first + count))
            } else {
                node_of(self.gather(node.child_node_index(slot), level + 1))
            }
        };
        let mut items: Vec<Item> = if level < PARALLEL {
            slots.into_par_iter().map(child).collect()
        } else {
            slots.into_iter().map(child).collect()
        };
        while self.join_leaves(&mut items) || dissolve_node(&mut items) {}
        items
    }

    fn leaf(&self, primitives: &[u32]) -> Item {
        let mixed = primitives.len() > 1 && primitives.iter().any(|primitive| (self.alone)(*primitive));
        if primitives.len() > self.leaf_size || mixed {
            return node_of(primitives.iter().map(|primitive| self.leaf(&[*primitive])).collect());
        }
        let bounds = primitives.iter().fold(EMPTY, |all, primitive| all.union((self.bounds)(*primitive)));
        Item { bounds, content: Content::Leaf(primitives.to_vec()) }
    }

    /// Joins the two leaves that gain most by it, if any do.
    fn join_leaves(&self, items: &mut Vec<Item>) -> bool {
        let size = |item: &Item| match &item.content {
            Content::Leaf(primitives) if !(self.alone)(primitives[0]) => primitives.len(),
            Content::Leaf(_) | Content::Node(_) => usize::MAX / 2,
        };
        let mut best = (0.0, 0, 0);
        for b in 1..items.len() {
            for a in (0..b).filter(|a| size(&items[*a]) + size(&items[b]) <= self.leaf_size) {
                let (one, other) = (items[a].bounds, items[b].bounds);
                let gain = JOIN * (area(one) + area(other)) - area(one.union(other));
                if gain > best.0 {
                    best = (gain, a, b);
                }
            }
        }
        let (gain, a, b) = best;
        if gain > 0.0 {
            let other = items.swap_remove(b);
            let one = &mut items[a];
            one.bounds = one.bounds.union(other.bounds);
            if let (Content::Leaf(all), Content::Leaf(more)) = (&mut one.content, other.content) {
                all.extend(more);
            }
        }
        gain > 0.0
    }
}

fn node_of(items: Vec<Item>) -> Item {
    Item { bounds: hull(&items), content: Content::Node(items) }
}

/// Replaces the largest node whose children there is room for by these, if there is one.
fn dissolve_node(items: &mut Vec<Item>) -> bool {
    let room = WIDTH + 1 - items.len();
    let fits = |item: &Item| matches!(&item.content, Content::Node(below) if below.len() <= room);
    let largest = (items.iter().enumerate().filter(|(_, item)| fits(item)))
        .max_by(|(_, a), (_, b)| area(a.bounds).total_cmp(&area(b.bounds)));
    let Some((index, _)) = largest else { return false };
    if let Content::Node(below) = items.swap_remove(index).content {
        items.extend(below);
    }
    true
}

/// Half the surface.
fn area(bounds: Bounds) -> f64 {
    let e = bounds.extent();
    e.x * e.y + e.y * e.z + e.z * e.x
}
