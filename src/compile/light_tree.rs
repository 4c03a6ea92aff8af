//! A tree over emitting triangles, from which one is drawn by how much it may light a point: Conty Estevez and Kulla 2018,
//! "Importance Sampling of Many Lights with Adaptive Tree Splitting"; pbrt-v4, 12.6.3.

use super::{Bounds, CompiledScene, Emitter};
use bytemuck::{Pod, Zeroable};
use glam::{DVec3, Vec3};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::f32::consts::{FRAC_PI_2, PI};

/// Emitting triangles from which on a tree is built; below, power alone decides. `candela bench many-lights` compares the two.
pub const FEWEST: usize = 64;
/// Most steps from the root to a leaf: bits of a trail.
const MOST_STEPS: u32 = 32;
/// Intervals of centroids along an axis, between which a split may lie.
const BUCKETS: usize = 12;
/// Triangles below which a split in halves does.
const FEW: usize = 4;
/// Triangles from which on both sides of a split are built at once.
const PARALLEL: usize = 4096;
/// Room for the rounding of what kernels compute: of cosines, and of lengths relative to the coordinates.
const SLACK: f32 = 2e-6;

/// A node as kernels read it.
#[derive(Debug, Clone, Copy, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct LightNode {
    /// Lower corner of the box around the triangles.
    pub min: [f32; 3],
    /// Their part of the power of all.
    pub power: f32,
    /// Upper corner.
    pub max: [f32; 3],
    /// The first of two children, which lie side by side; with [`LightNode::LEAF`] the index of the one emitter.
    pub child: u32,
    /// Middle of the cone of their normals.
    pub axis: [f32; 3],
    /// Cosine of that cone's half angle.
    pub cos_spread: f32,
}

impl LightNode {
    /// Bit of `child`: a leaf.
    pub const LEAF: u32 = 1 << 31;
    /// Bit of `child`: some triangle shines to both sides.
    pub const TWO_SIDED: u32 = 1 << 30;
    /// Bits of `child` that are an index.
    pub const INDEX: u32 = Self::TWO_SIDED - 1;
}

/// Nodes, the root first, and the way to each emitter.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct LightTree {
    /// Empty: there are too few emitters.
    #[serde(with = "crate::pod")]
    pub nodes: Vec<LightNode>,
    /// By emitter: bit `k` says which child to take at the `k`-th step.
    #[serde(with = "crate::pod")]
    pub trails: Vec<u32>,
}

impl LightTree {
    /// Of a scene's emitters, if there are enough for it to pay and none moves: a box and a cone stand for one moment.
    pub fn new(scene: &CompiledScene) -> Self {
        let moves = scene.emitters.iter().any(|emitter| scene.motion.moves(emitter.triangle));
        if moves || scene.emitters.len() < FEWEST { Self::default() } else { Self::of(scene) }
    }

    /// Of a scene's emitters, however few.
    pub fn of(scene: &CompiledScene) -> Self {
        if scene.emitters.is_empty() {
            return Self::default();
        }
        let mut items: Vec<Item> = (0u32..)
            .zip(&scene.emitters)
            .collect::<Vec<_>>()
            .into_par_iter()
            .map(|(index, emitter)| Item::new(scene, index, emitter))
            .collect();
        share_power(&mut items, &scene.emitters);
        let mut nodes = vec![LightNode::default(); 2 * items.len() - 1];
        if let [root, below @ ..] = &mut nodes[..] {
            build(&mut items, 0, 0, root, below, 1);
        }
        let mut trails = vec![0; items.len()];
        for item in items {
            trails[item.emitter as usize] = item.trail;
        }
        Self { nodes, trails }
    }
}

/// An emitter on its way into the tree.
#[derive(Debug, Clone, Copy)]
struct Item {
    bounds: Bounds,
    normal: Vec3,
    power: f32,
    emitter: u32,
    trail: u32,
    two_sided: bool,
}

impl Item {
    fn new(scene: &CompiledScene, index: u32, emitter: &Emitter) -> Self {
        let instance = &scene.instances[emitter.instance as usize];
        let triangle = &scene.triangles[emitter.triangle as usize];
        let [a, b, c] = [triangle.v0, triangle.v1, triangle.v2].map(|v| instance.point(v));
        // Room for kernels that transform in f32.
        let slack = f64::from(SLACK) * a.abs().max(b.abs()).max(c.abs()).max_element();
        Self {
            bounds: Bounds::outwards(a.min(b).min(c) - slack, a.max(b).max(c) + slack),
            normal: ((b - a).cross(c - a) * instance.handedness()).normalize_or(DVec3::Y).as_vec3(),
            power: 0.0,
            emitter: index,
            trail: 0,
            two_sided: emitter.double_sided,
        }
    }

    fn centroid(&self) -> Vec3 {
        0.5 * self.bounds.min + 0.5 * self.bounds.max
    }

    /// Its normal, or the opposite if it has both and that is nearer to `axis`.
    fn normal_towards(&self, axis: Vec3) -> Vec3 {
        if self.two_sided && self.normal.dot(axis) < 0.0 { -self.normal } else { self.normal }
    }
}

/// Parts of the power of all; equal ones if that is nothing or beyond all numbers.
fn share_power(items: &mut [Item], emitters: &[Emitter]) {
    let total: f64 = emitters.iter().map(Emitter::power).sum();
    let even = 1.0 / items.len() as f64;
    for (item, emitter) in items.iter_mut().zip(emitters) {
        let share = emitter.power() / total;
        item.power = if share.is_finite() { share } else { even } as f32;
    }
}

/// Fills a node and those below it; `below` holds exactly these, the first of them having the index `first`.
fn build(items: &mut [Item], step: u32, trail: u32, node: &mut LightNode, below: &mut [LightNode], first: u32) {
    *node = around(items);
    if let [item] = items {
        item.trail = trail;
        node.child |= LightNode::LEAF | item.emitter;
        return;
    }
    node.child |= first;
    let middle = split(items, step);
    let (left_items, right_items) = items.split_at_mut(middle);
    let [left, right, below @ ..] = below else { return };
    let (left_below, right_below) = below.split_at_mut(2 * middle - 2);
    let first_of_left = first + 2;
    let first_of_right = first_of_left + left_below.len() as u32;
    let parallel = left_items.len() + right_items.len() >= PARALLEL;
    let mut build_left = || build(left_items, step + 1, trail, left, left_below, first_of_left);
    let mut build_right = || build(right_items, step + 1, trail | 1 << step, right, right_below, first_of_right);
    if parallel {
        rayon::join(build_left, build_right);
    } else {
        build_left();
        build_right();
    }
}

/// Box, cone and power of some emitters; no child.
fn around(items: &[Item]) -> LightNode {
    let bounds = items.iter().fold(Bounds::default(), |all, item| all.union(item.bounds));
    let power: f64 = items.iter().map(|item| f64::from(item.power)).sum();
    let towards = items.first().map_or(Vec3::Y, |item| item.normal);
    let sum: Vec3 = items.iter().map(|item| item.normal_towards(towards)).sum();
    let axis = sum.normalize_or(towards);
    let least = items.iter().map(|item| item.normal_towards(axis).dot(axis)).fold(1.0, f32::min);
    LightNode {
        min: bounds.min.to_array(),
        power: power as f32,
        max: bounds.max.to_array(),
        child: if items.iter().any(|item| item.two_sided) { LightNode::TWO_SIDED } else { 0 },
        axis: axis.to_array(),
        cos_spread: (least - SLACK).max(-1.0),
    }
}

/// Brings those of the first child to the front, and says how many they are: at least one and not all.
fn split(items: &mut [Item], step: u32) -> usize {
    let halvings = usize::BITS - (items.len() - 1).leading_zeros();
    if items.len() > FEW && step + halvings < MOST_STEPS {
        let cheapest = (0..3).filter_map(|axis| Split::cheapest(items, axis)).min_by(|a, b| a.cost.total_cmp(&b.cost));
        if let Some(cheapest) = cheapest {
            items.sort_unstable_by_key(|item| !cheapest.is_before(item));
            return items.partition_point(|item| cheapest.is_before(item));
        }
    }
    let centroids = items.iter().fold(Bounds::default(), |all, item| all.with(item.centroid()));
    let axis = (centroids.max - centroids.min).max_position();
    let middle = items.len() / 2;
    items.select_nth_unstable_by(middle, |a, b| {
        a.centroid()[axis].total_cmp(&b.centroid()[axis]).then(a.emitter.cmp(&b.emitter))
    });
    middle
}

/// Between two buckets of centroids along an axis.
struct Split {
    axis: usize,
    low: f32,
    scale: f32,
    /// Buckets of the first child.
    buckets: usize,
    cost: f32,
}

impl Split {
    /// The best along an axis; none: all centroids are in one bucket.
    fn cheapest(items: &[Item], axis: usize) -> Option<Self> {
        let along = items.iter().map(|item| item.centroid()[axis]);
        let (low, high) = along.fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), x| (low.min(x), high.max(x)));
        let scale = BUCKETS as f32 / (high - low);
        if !(scale.is_finite() && scale > 0.0) {
            return None;
        }
        let mut split = Self { axis, low, scale, buckets: 0, cost: f32::INFINITY };
        let mut buckets = [Summary::default(); BUCKETS];
        for item in items {
            buckets[split.bucket(item)].add(item);
        }
        let mut after = buckets;
        for i in (0..BUCKETS - 1).rev() {
            after[i] = after[i].and(&after[i + 1]);
        }
        let size = after[0].bounds.max - after[0].bounds.min;
        // Long boxes are not to be cut into longer ones.
        let shape = size.max_element() / size[axis].max(f32::MIN_POSITIVE);
        let mut before = Summary::default();
        for (i, bucket) in buckets[..BUCKETS - 1].iter().enumerate() {
            before = before.and(bucket);
            if before.count == 0.0 || after[i + 1].count == 0.0 || (bucket.count == 0.0 && split.buckets > 0) {
                continue;
            }
            let cost = shape * (before.cost() + after[i + 1].cost());
            if split.buckets == 0 || cost < split.cost {
                (split.buckets, split.cost) = (i + 1, cost);
            }
        }
        (split.buckets > 0).then_some(split)
    }

    fn bucket(&self, item: &Item) -> usize {
        (((item.centroid()[self.axis] - self.low) * self.scale) as usize).min(BUCKETS - 1)
    }

    fn is_before(&self, item: &Item) -> bool {
        self.bucket(item) < self.buckets
    }
}

/// What a cost is made of, of some emitters.
#[derive(Debug, Clone, Copy, Default)]
struct Summary {
    bounds: Bounds,
    power: f32,
    normals: Vec3,
    count: f32,
}

impl Summary {
    fn add(&mut self, item: &Item) {
        self.bounds = self.bounds.union(item.bounds);
        self.power += item.power;
        self.normals += item.normal_towards(self.normals);
        self.count += 1.0;
    }

    fn and(&self, other: &Self) -> Self {
        Self {
            bounds: self.bounds.union(other.bounds),
            power: self.power + other.power,
            normals: self.normals + other.normals,
            count: self.count + other.count,
        }
    }

    /// Power times the area of the box times the solid angle into which light goes (Conty Estevez and Kulla 2018, 4.4). The cone
    /// of normals is taken from their mean, which for normals that fill a cone evenly is `(1 + cos) / 2` long.
    fn cost(&self) -> f32 {
        let size = self.bounds.max - self.bounds.min;
        let area = size.x * size.y + size.y * size.z + size.z * size.x;
        let cos = (2.0 * self.normals.length() / self.count - 1.0).clamp(-1.0, 1.0);
        let (spread, sin) = (cos.acos(), (1.0 - cos * cos).max(0.0).sqrt());
        let reach = (spread + FRAC_PI_2).min(PI);
        let around = 2.0 * reach * sin - (spread - 2.0 * reach).cos() - 2.0 * spread * sin + cos;
        let orientation = 2.0 * PI * (1.0 - cos) + FRAC_PI_2 * around;
        self.power * orientation * area
    }
}
