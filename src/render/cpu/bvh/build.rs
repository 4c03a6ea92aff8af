//! [`CompiledScene`] -> [`Bvh`].

use super::boxes::{Child, Node};
use super::gather::{Content, EMPTY, Item, Source, hull};
use super::sphere::Sphere;
use super::traverse::Unit;
use super::triangle::Block;
use super::{Bvh, Instance, Tree};
use crate::compile::{Bounds, CompiledScene};
use glam::{DAffine3, DMat3, DVec3};
use rayon::prelude::*;

impl Bvh {
    /// Builds the trees of a scene, on all cores. Which triangles lie together is taken from the scene's compressed trees;
    /// everything else, boxes above all, is made anew from the vertices.
    pub fn new(scene: &CompiledScene) -> Self {
        let motion = scene.motion;
        let moves = |instance: &crate::compile::Instance| instance.flags & crate::compile::Instance::MOVING != 0;
        let roots_of = |instance: &crate::compile::Instance| {
            let trees = if moves(instance) { motion.pieces } else { 1 };
            let root = instance.root;
            (0..trees).map(move |piece| root + piece * motion.nodes)
        };
        let mut roots: Vec<u32> = scene.instances.iter().flat_map(roots_of).collect();
        roots.sort_unstable();
        roots.dedup();
        // Trees of what moves come last, one for each piece.
        let still = roots.len() - if scene.instances.iter().any(moves) { motion.pieces as usize } else { 0 };
        let piece_of = |tree: usize| tree.saturating_sub(still) as u32;
        let gather = |(tree, root): (usize, &u32)| {
            let bounds = |index: u32| match motion.moves(index) {
                true => {
                    let [begin, end] = [0, 1].map(|step| scene.triangle_at(index, piece_of(tree) + step));
                    begin.swept_to(&end)
                }
                false => scene.triangles[index as usize].bounds(),
            };
            let alone = |index: u32| scene.triangles[index as usize].is_sphere();
            Source { nodes: &scene.nodes, leaf_size: Block::SIZE, bounds, alone }.gather(*root, 0)
        };
        let gathered: Vec<Vec<Item>> = roots.par_iter().enumerate().map(gather).collect();
        let instance = |instance: &crate::compile::Instance| Instance {
            to_object: affine(&instance.to_object),
            tree: roots.partition_point(|root| *root < instance.root) as u32,
            moves: moves(instance),
        };
        let mut bvh = Self {
            nodes: Vec::new(),
            blocks: Vec::new(),
            spheres: Vec::new(),
            top: None,
            trees: Vec::new(),
            instances: scene.instances.par_iter().map(instance).collect(),
            moves: scene.instances.iter().any(moves),
            unit: Unit::detect(),
        };
        if scene.two_level {
            let world = |i: &Instance| {
                let trees = if i.moves { motion.pieces } else { 1 };
                let of_tree = |tree: u32| world_bounds(&gathered[tree as usize], &i.to_object);
                (i.tree..i.tree + trees).map(of_tree).fold(EMPTY, |all, bounds| all.union(bounds))
            };
            let bounds: Vec<Bounds> = bvh.instances.par_iter().map(world).collect();
            let source = Source {
                nodes: &scene.nodes,
                leaf_size: 1,
                bounds: |index: u32| bounds[index as usize],
                alone: |_| false,
            };
            bvh.top = Some(bvh.add_tree(&source.gather(0, 0), &mut |_, primitives| Child::leaf(primitives[0])));
        }
        for (tree, items) in gathered.iter().enumerate() {
            let tree = bvh.add_tree(items, &mut |bvh, primitives| {
                if motion.moves(primitives[0]) {
                    let first = bvh.blocks.len() as u32;
                    let at =
                        |step: u32| Block::new(primitives, |index| scene.triangle_at(index, piece_of(tree) + step));
                    bvh.blocks.extend([at(0), at(1)]);
                    return Child::leaf(first);
                }
                if scene.triangles[primitives[0] as usize].is_sphere() {
                    bvh.spheres.push(Sphere::new(&scene.triangles, primitives[0]));
                    return Child::leaf(Child::LAST_LEAF - (bvh.spheres.len() as u32 - 1));
                }
                bvh.blocks.push(Block::new(primitives, |index| scene.triangles[index as usize]));
                Child::leaf(bvh.blocks.len() as u32 - 1)
            });
            bvh.trees.push(tree);
        }
        bvh
    }

    fn add_tree(&mut self, items: &[Item], leaf: &mut impl FnMut(&mut Self, &[u32]) -> Child) -> Tree {
        let scale = unit_scale(hull(items));
        let root = self.add_node(items, scale, leaf);
        Tree { root, scale }
    }

    /// Adds a node and all below it, children after parents; returns its index.
    fn add_node(&mut self, items: &[Item], scale: f64, leaf: &mut impl FnMut(&mut Self, &[u32]) -> Child) -> u32 {
        let index = self.nodes.len();
        self.nodes.push(Node::new(items.iter().map(|item| item.bounds), scale));
        for (slot, item) in items.iter().enumerate() {
            self.nodes[index].children[slot] = match &item.content {
                Content::Leaf(primitives) => leaf(self, primitives),
                Content::Node(below) => Child::node(self.add_node(below, scale, leaf)),
            };
        }
        index as u32
    }
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

/// World bounds of what lies in the boxes of a tree's root, as a ray sees it that goes through `to_object`. Empty if the
/// map cannot be inverted: then no ray arrives in it either.
fn world_bounds(items: &[Item], to_object: &DAffine3) -> Bounds {
    let inverse = to_object.inverse();
    let placed = items.iter().flat_map(|item| item.bounds.corners()).map(|corner| inverse.transform_point3(corner));
    let (min, max) = placed.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(min, max), p| (min.min(p), max.max(p)));
    if !(inverse.is_finite() && min.cmple(max).all()) {
        return EMPTY;
    }
    // The ray's way through the map A and the inverse M were rounded: |M| (|A| |x| + |t|) times some 2^-53.
    let reach = to_object.matrix3.abs() * min.abs().max(max.abs()) + to_object.translation.abs();
    let slack = inverse.matrix3.abs() * reach * (64.0 * f64::EPSILON);
    Bounds::outwards(min - slack, max + slack)
}
