//! Trees over boxes: a binary tree by binned surface area (Wald 2007, "On fast Construction of SAH-based Bounding
//! Volume Hierarchies"), collapsed to eight children per node by the `obvhs` crate, quantised by [`super::quantize`].
//!
//! Why not obvhs's own builder (PLOC): boxes that are equal or nested give it one merge per round, so that N of them
//! cost N^2 time and a tree of depth N, which then overflows the stack. Here depth is bounded by
//! [`SAH_DEPTH`] + log2(N) whatever the boxes are.

use super::{Bounds, BvhNode, quantize};
use glam::{Vec3, Vec3A};
use obvhs::aabb::Aabb;
use obvhs::bvh2::{Bvh2, node::Bvh2Node};
use obvhs::cwbvh::bvh2_to_cwbvh::bvh2_to_cwbvh;

/// Primitives per leaf; the node format allows no more.
const LEAF_SIZE: u32 = 3;
/// Bins per axis.
const BINS: usize = 16;
/// Bins per axis for ranges of fewer than [`FEW`] primitives: a third off the build time, the same cost.
const FEW_BINS: usize = 8;
/// See [`FEW_BINS`].
const FEW: usize = 12;
/// Depth of the binary tree below which ranges are halved instead of split by cost.
const SAH_DEPTH: u32 = 40;
/// Smallest size of a box relative to the whole, 2^-50.
const SPECK: f32 = 8.881_784e-16;
/// Ranges of at least this many primitives are built by two threads.
const PARALLEL: usize = 4096;

/// A CWBVH on its own: node and primitive indices count from 0.
#[derive(Debug, Default)]
pub struct Tree {
    /// Root first; children after their parents.
    pub nodes: Vec<BvhNode>,
    /// Leaf order: position -> index of the box.
    pub order: Vec<u32>,
    /// Nodes on the longest chain from the root.
    pub depth: u32,
    /// Another order, in which boxes of one centre are neighbours.
    pub by_place: Vec<u32>,
    /// Visits that a ray costs in the worst part of the tree.
    pub visits: Visits,
}

/// Nodes and primitives of the binary tree that a ray meets, going by surface area.
#[derive(Debug, Clone, Copy, Default)]
pub struct Visits {
    /// On average over the rays that meet the root.
    pub root: f32,
    /// The most over all nodes, on average over the rays that meet the node.
    pub most: f32,
}

impl Visits {
    /// Of a primitive.
    pub const ONE: Self = Self { root: 1.0, most: 1.0 };
}

/// Builds a tree over finite boxes, of whose contents a ray visits so much. No box: one node without children.
pub fn build(boxes: &[Bounds], contents: impl Fn(usize) -> Visits) -> Tree {
    if boxes.is_empty() {
        return Tree { nodes: vec![BvhNode::default()], depth: 1, ..Tree::default() };
    }
    let (binary, visits) = binary(boxes, contents);
    let wide = bvh2_to_cwbvh(&binary, LEAF_SIZE, true, false);
    let mut nodes: Vec<BvhNode> = bytemuck::cast_vec(wide.nodes);
    let depth = quantize::refit(&mut nodes, |leaf| boxes[wide.primitive_indices[leaf] as usize]);
    Tree { nodes, order: wide.primitive_indices, depth, by_place: binary.primitive_indices, visits }
}

/// A box scaled to about one and grown by a speck, so that areas neither overflow nor vanish (where they vanish,
/// collapsing sees no gain in wide nodes). It shapes the tree, no more.
#[derive(Clone, Copy)]
struct Item {
    aabb: Aabb,
    index: u32,
    visits: Visits,
}

fn binary(boxes: &[Bounds], contents: impl Fn(usize) -> Visits) -> (Bvh2, Visits) {
    let all = boxes.iter().fold(Bounds::default(), |all, b| all.union(*b));
    let largest = all.min.abs().max(all.max.abs()).max_element().max(f32::MIN_POSITIVE);
    let scale = f64::from(largest).log2().floor().exp2().recip();
    let unit = |v: Vec3| (v.as_dvec3() * scale).as_vec3a();
    let mut items: Vec<Item> = (boxes.iter().zip(0..))
        .map(|(b, index)| Item {
            aabb: Aabb::new(unit(b.min), unit(b.max) + SPECK),
            index,
            visits: contents(index as usize),
        })
        .collect();
    let mut nodes = vec![Bvh2Node::default(); 2 * items.len() - 1];
    let (root, rest) = nodes.split_at_mut(1);
    let visits = Range { items: &mut items, first_item: 0, root: &mut root[0], rest, first_node: 1 }.build(0);
    let primitive_indices = items.iter().map(|item| item.index).collect();
    (Bvh2 { nodes, primitive_indices, children_are_ordered_after_parents: true, ..Bvh2::default() }, visits)
}

/// A subtree to build: n items, its root, and the 2n - 2 nodes below it.
struct Range<'a> {
    items: &'a mut [Item],
    first_item: u32,
    root: &'a mut Bvh2Node,
    rest: &'a mut [Bvh2Node],
    first_node: u32,
}

impl Range<'_> {
    fn build(self, depth: u32) -> Visits {
        let aabb = bounds(self.items);
        let count = self.items.len();
        if count == 1 {
            *self.root = Bvh2Node::new(aabb, 1, self.first_item);
            return self.items[0].visits;
        }
        *self.root = Bvh2Node::new(aabb, 0, self.first_node);
        let middle = if depth < SAH_DEPTH { split_by_cost(self.items) } else { None };
        let middle = middle.unwrap_or_else(|| halve(self.items));
        let (left_items, right_items) = self.items.split_at_mut(middle);
        let (pair, rest) = self.rest.split_at_mut(2);
        let (left_root, right_root) = pair.split_at_mut(1);
        let (left_root, right_root) = (&mut left_root[0], &mut right_root[0]);
        let (left_rest, right_rest) = rest.split_at_mut(2 * middle - 2);
        let first_node = self.first_node + 2;
        let left = Range {
            items: left_items,
            first_item: self.first_item,
            root: &mut *left_root,
            rest: left_rest,
            first_node,
        };
        let right = Range {
            items: right_items,
            first_item: self.first_item + middle as u32,
            root: &mut *right_root,
            rest: right_rest,
            first_node: first_node + 2 * middle as u32 - 2,
        };
        let (left, right) = if count >= PARALLEL {
            rayon::join(|| left.build(depth + 1), || right.build(depth + 1))
        } else {
            (left.build(depth + 1), right.build(depth + 1))
        };
        let met = |child: &Bvh2Node| child.aabb.half_area() / aabb.half_area();
        let root = 1.0 + met(left_root) * left.root + met(right_root) * right.root;
        Visits { root, most: root.max(left.most).max(right.most) }
    }
}

fn bounds(items: &[Item]) -> Aabb {
    items.iter().fold(Aabb::empty(), |all, item| all.union(&item.aabb))
}

/// Twice the centre: the factor does not matter.
fn centre(item: &Item) -> Vec3A {
    item.aabb.min + item.aabb.max
}

fn centre_bounds(items: &[Item]) -> Aabb {
    let mut all = Aabb::empty();
    for item in items {
        all.extend(centre(item));
    }
    all
}

/// Splits in the middle of the longest extent of centres (anyhow if they coincide).
fn halve(items: &mut [Item]) -> usize {
    let axis = centre_bounds(items).largest_axis();
    let middle = items.len() / 2;
    items
        .select_nth_unstable_by(middle, |a, b| centre(a)[axis].total_cmp(&centre(b)[axis]).then(a.index.cmp(&b.index)));
    middle
}

#[derive(Clone, Copy)]
struct Bin {
    aabb: Aabb,
    count: u32,
}

/// Reorders the items around the cheapest plane between bins and returns where; none: all centres coincide.
fn split_by_cost(items: &mut [Item]) -> Option<usize> {
    let centres = centre_bounds(items);
    let extent = centres.diagonal();
    let used = if items.len() < FEW { FEW_BINS } else { BINS };
    let scale = Vec3A::select(extent.cmpgt(Vec3A::ZERO), used as f32 / extent, Vec3A::ZERO);
    let bin_of = |item: &Item| {
        let bin = ((centre(item) - centres.min) * scale).min(Vec3A::splat(used as f32 - 1.0));
        [bin.x as usize, bin.y as usize, bin.z as usize]
    };
    let mut bins = [[Bin { aabb: Aabb::empty(), count: 0 }; BINS]; 3];
    for item in items.iter() {
        for (axis, bin) in bin_of(item).into_iter().enumerate() {
            let bin = &mut bins[axis][bin.min(BINS - 1)];
            bin.aabb = bin.aabb.union(&item.aabb);
            bin.count += 1;
        }
    }
    let (_, axis, plane) = (0..3)
        .filter(|axis| extent[*axis] > 0.0)
        .filter_map(|axis| cheapest_plane(&bins[axis][..used]).map(|(cost, plane)| (cost, axis, plane)))
        .min_by(|a, b| a.0.total_cmp(&b.0))?;
    let middle = partition(items, |item| bin_of(item)[axis] < plane);
    (0 < middle && middle < items.len()).then_some(middle)
}

/// The cost and index of the first bin to the right of the cheapest plane that has primitives on both sides.
fn cheapest_plane(bins: &[Bin]) -> Option<(f32, usize)> {
    let mut right = [f32::INFINITY; BINS];
    let mut side = Bin { aabb: Aabb::empty(), count: 0 };
    let add = |side: &mut Bin, bin: &Bin| {
        side.aabb = side.aabb.union(&bin.aabb);
        side.count += bin.count;
        if side.count == 0 { f32::INFINITY } else { side.aabb.half_area() * side.count as f32 }
    };
    for plane in (1..bins.len()).rev() {
        right[plane] = add(&mut side, &bins[plane]);
    }
    side = Bin { aabb: Aabb::empty(), count: 0 };
    (1..bins.len())
        .map(|plane| (add(&mut side, &bins[plane - 1]) + right[plane], plane))
        .filter(|(cost, _)| cost.is_finite())
        .min_by(|a, b| a.0.total_cmp(&b.0))
}

/// Moves the items that satisfy the predicate to the front and returns their number.
fn partition(items: &mut [Item], mut front: impl FnMut(&Item) -> bool) -> usize {
    let mut middle = 0;
    for i in 0..items.len() {
        if front(&items[i]) {
            items.swap(i, middle);
            middle += 1;
        }
    }
    middle
}
