//! [`CompiledScene`] -> [`Bvh`]. Which triangles lie together is taken from the scene's compressed trees; everything else,
//! boxes above all, is made anew from the vertices.

use super::boxes::{Child, Node};
use super::traverse::Unit;
use super::triangle::Block;
use super::{Bvh, Instance, Tree};
use crate::compile::{Bounds, BvhNode, CompiledScene, Triangle};
use glam::{DAffine3, DMat3, DVec3, Vec3};
use obvhs::cwbvh::node::CwBvhNode;
use rayon::prelude::*;

/// A run of primitives: first and number.
type Leaf = (u32, u32);

impl Bvh {
    /// Builds the trees of a scene, on all cores.
    pub fn new(scene: &CompiledScene) -> Self {
        let mut roots: Vec<u32> = scene.instances.iter().map(|instance| instance.root).collect();
        roots.sort_unstable();
        roots.dedup();
        let mut bvh = Self {
            nodes: Vec::new(),
            blocks: Vec::new(),
            top: None,
            trees: Vec::new(),
            instances: Vec::new(),
            unit: Unit::detect(),
        };
        // Per tree, the boxes of its root's children.
        let mut hulls = Vec::new();
        for (index, root) in roots.iter().enumerate() {
            let end = roots.get(index + 1).map_or(scene.nodes.len(), |next| *next as usize);
            hulls.push(bvh.add_triangles(scene, &scene.nodes[*root as usize..end], *root));
        }
        bvh.instances = (scene.instances.par_iter())
            .map(|instance| Instance {
                to_object: affine(&instance.to_object),
                tree: roots.partition_point(|root| *root < instance.root) as u32,
            })
            .collect();
        if scene.two_level {
            let end = roots.first().map_or(scene.nodes.len(), |root| *root as usize);
            bvh.add_instances(&scene.nodes[..end], &hulls);
        }
        bvh
    }

    /// Adds the tree of a mesh and returns the boxes of its root's children.
    fn add_triangles(&mut self, scene: &CompiledScene, nodes: &[BvhNode], root: u32) -> [Bounds; 8] {
        let mut leaves: Vec<Leaf> = Vec::new();
        let first_block = self.blocks.len();
        let children = topology(nodes, root, Block::SIZE as u32, |leaf| {
            leaves.push(leaf);
            Child::leaf(leaves.len() as u32 - 1)
        });
        let triangles = |(first, count): Leaf| &scene.triangles[first as usize..(first + count) as usize];
        self.blocks.par_extend(leaves.par_iter().map(|leaf| Block::new(triangles(*leaf), leaf.0)));
        let bounds: Vec<Bounds> = leaves.par_iter().map(|leaf| hull(triangles(*leaf))).collect();
        let (tree, hull) = self.add_nodes(&children, &bounds, first_block as u32);
        self.trees.push(tree);
        hull
    }

    /// Adds the top level.
    fn add_instances(&mut self, nodes: &[BvhNode], hulls: &[[Bounds; 8]]) {
        let children = topology(nodes, 0, 1, |(first, _)| Child::leaf(first));
        let world = |i: &Instance| world_bounds(&hulls[i.tree as usize], &i.to_object);
        let bounds: Vec<Bounds> = self.instances.par_iter().map(world).collect();
        self.top = Some(self.add_nodes(&children, &bounds, 0).0);
    }

    /// Adds nodes with boxes around their children, given those of the leaves. Children's indices count from 0; in
    /// the end, those of leaves count from `first_leaf`. Also returns the boxes of the root's children.
    fn add_nodes(&mut self, children: &[[Child; 8]], leaves: &[Bounds], first_leaf: u32) -> (Tree, [Bounds; 8]) {
        let root = self.nodes.len() as u32;
        let boxes = boxes(children, leaves);
        let hull = boxes.first().map_or([EMPTY; 8], |root| *root);
        let scale = unit_scale(union(&hull));
        self.nodes.par_extend(boxes.par_iter().zip(children).map(|(boxes, children)| {
            let moved = children.map(|child| match child {
                Child::NONE => child,
                leaf if leaf.is_leaf() => Child::leaf(leaf.index() as u32 + first_leaf),
                node => Child::node(node.index() as u32 + root),
            });
            Node::new(boxes, moved, scale)
        }));
        (Tree { root, scale }, hull)
    }
}

const EMPTY: Bounds = Bounds { min: Vec3::INFINITY, max: Vec3::NEG_INFINITY };

fn hull(triangles: &[Triangle]) -> Bounds {
    let vertices = triangles.iter().flat_map(|triangle| [triangle.v0, triangle.v1, triangle.v2]);
    vertices.fold(EMPTY, |all, vertex| all.with(Vec3::from_array(vertex)))
}

fn union(boxes: &[Bounds]) -> Bounds {
    boxes.iter().fold(EMPTY, |all, b| all.union(*b))
}

/// Children of each node, parents first, indices counting from 0. Leaves of more than `most` primitives become nodes with
/// a leaf for each. `root`: index of the first node in its own numbering.
fn topology(nodes: &[BvhNode], root: u32, most: u32, mut leaf: impl FnMut(Leaf) -> Child) -> Vec<[Child; 8]> {
    let mut all = vec![[Child::NONE; 8]; nodes.len()];
    for (index, node) in nodes.iter().enumerate() {
        let node: CwBvhNode = bytemuck::cast(*node);
        for slot in (0..8).filter(|slot| node.child_meta[*slot] != 0) {
            all[index][slot] = if !node.is_leaf(slot) {
                Child::node(node.child_node_index(slot) - root)
            } else {
                let (first, count) = node.child_primitives(slot);
                if count <= most {
                    leaf((first, count))
                } else {
                    let mut below = [Child::NONE; 8];
                    for (child, primitive) in below.iter_mut().zip(first..first + count) {
                        *child = leaf((primitive, 1));
                    }
                    all.push(below);
                    Child::node(all.len() as u32 - 1)
                }
            };
        }
    }
    all
}

/// Boxes of the children of all nodes.
fn boxes(children: &[[Child; 8]], leaves: &[Bounds]) -> Vec<[Bounds; 8]> {
    let mut boxes = vec![[EMPTY; 8]; children.len()];
    for index in (0..children.len()).rev() {
        boxes[index] = children[index].map(|child| match child {
            Child::NONE => EMPTY,
            leaf if leaf.is_leaf() => leaves[leaf.index()],
            node => union(&boxes[node.index()]),
        });
    }
    boxes
}

/// The power of two that takes all coordinates of a box into [-1, 1].
fn unit_scale(bounds: Bounds) -> f64 {
    let largest = if bounds.is_empty() { 0.0 } else { f64::from(bounds.min.abs().max(bounds.max.abs()).max_element()) };
    if largest > 0.0 { (-largest.log2().ceil()).exp2() } else { 1.0 }
}

fn affine(rows: &[[f32; 4]; 3]) -> DAffine3 {
    let column = |i: usize| DVec3::from_array(rows.map(|row| f64::from(row[i])));
    DAffine3 { matrix3: DMat3::from_cols(column(0), column(1), column(2)), translation: column(3) }
}

/// World bounds of what lies in the boxes, as a ray sees it that goes through `to_object`. Empty if the map cannot be
/// inverted: then no ray arrives in it either.
fn world_bounds(boxes: &[Bounds; 8], to_object: &DAffine3) -> Bounds {
    let inverse = to_object.inverse();
    if !inverse.is_finite() {
        return EMPTY;
    }
    let corners = boxes.iter().filter(|b| !b.is_empty()).flat_map(|b| b.corners());
    let placed = corners.map(|corner| inverse.transform_point3(corner));
    let (min, max) = placed.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(min, max), p| (min.min(p), max.max(p)));
    if !min.cmple(max).all() {
        return EMPTY;
    }
    // The ray's way through the map A and the inverse M were rounded: |M| (|A| |x| + |t|) times some 2^-53.
    let reach = to_object.matrix3.abs() * min.abs().max(max.abs()) + to_object.translation.abs();
    let slack = inverse.matrix3.abs() * reach * (64.0 * f64::EPSILON);
    Bounds::outwards(min - slack, max + slack)
}
