//! Boxes of CWBVH nodes, quantised so that each contains what lies below it: by real arithmetic, not nearly.
//!
//! obvhs rounds `log2` and differences in f32, and clamps what does not fit: boxes may then cut off their content
//! by an ulp of the node's size, which is a hole when the content is flat and lies in that face. Here the grid is
//! chosen anew, from exact boxes, for the topology that obvhs made.

use super::{Bounds, BvhNode};
use glam::{DVec3, Vec3};
use obvhs::cwbvh::node::CwBvhNode;

/// Smallest exponent of a grid, 2^-74: keeps the grid clear of denormals for flat boxes.
const MIN_EXPONENT: i32 = 127 - 74;
/// Wideners of a difference of two f32 in f64 (exact unless their exponents lie more than 29 apart).
const DOWN: f64 = 1.0 - 1e-15;
const UP: f64 = 1.0 + 1e-15;

/// Recomputes all boxes of a tree with children after their parents; `leaf` gives the box of a primitive by its
/// position in leaf order. Returns the depth of the tree.
pub fn refit(nodes: &mut [BvhNode], leaf: impl Fn(usize) -> Bounds) -> u32 {
    let mut exact = vec![Bounds::default(); nodes.len()];
    let mut depth = vec![1; nodes.len()];
    for index in (0..nodes.len()).rev() {
        let mut node: CwBvhNode = bytemuck::cast(nodes[index]);
        let mut children = [Bounds::default(); 8];
        for (slot, child) in children.iter_mut().enumerate().filter(|(slot, _)| node.child_meta[*slot] != 0) {
            if node.is_leaf(slot) {
                let (first, count) = node.child_primitives(slot);
                *child = (first..first + count).fold(*child, |all, i| all.union(leaf(i as usize)));
            } else {
                let below = node.child_node_index(slot) as usize;
                *child = exact[below];
                depth[index] = depth[index].max(depth[below] + 1);
            }
        }
        exact[index] = children.iter().fold(Bounds::default(), |all, child| all.union(*child));
        set_boxes(&mut node, exact[index], &children);
        nodes[index] = bytemuck::cast(node);
    }
    depth.first().copied().unwrap_or(0)
}

fn set_boxes(node: &mut CwBvhNode, all: Bounds, children: &[Bounds; 8]) {
    node.p = all.min;
    let exponents = all.extent().to_array().map(|extent| exponent(extent * UP));
    node.e = exponents.map(|e| e as u8);
    let scale = DVec3::from_array(exponents.map(|e| f64::from(e - 127).exp2()));
    for (slot, child) in children.iter().enumerate().filter(|(_, child)| !child.is_empty()) {
        let min = (offset(child.min, all.min) * DOWN / scale).floor();
        let max = (offset(child.max, all.min) * UP / scale).ceil();
        node.child_min_x[slot] = min.x as u8;
        node.child_min_y[slot] = min.y as u8;
        node.child_min_z[slot] = min.z as u8;
        node.child_max_x[slot] = max.x as u8;
        node.child_max_y[slot] = max.y as u8;
        node.child_max_z[slot] = max.z as u8;
    }
}

fn offset(point: Vec3, corner: Vec3) -> DVec3 {
    point.as_dvec3() - corner.as_dvec3()
}

/// Smallest biased exponent e with `255 * 2^(e - 127) >= extent`.
fn exponent(extent: f64) -> i32 {
    let mut e = MIN_EXPONENT;
    if extent > 0.0 {
        e = e.max((extent / 255.0).log2().floor() as i32 + 127);
    }
    while f64::from(e - 127).exp2() * 255.0 < extent {
        e += 1;
    }
    e
}
