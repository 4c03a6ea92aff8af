//! The way of a ray through the trees.

use super::boxes::{Child, Node, Slabs};
use super::simd::{Portable, Simd};
use super::sphere::SphereHit;
use super::triangle::{Block, BlockHits, Shear, intersect, intersect_between};
use super::{Bvh, Hit, Ray, Tree, TriangleId};
use crate::compile::Triangle;
use glam::DVec3;
use std::mem::MaybeUninit;
use std::ops::RangeInclusive;

/// Entries of a stack: a walk leaves at most seven children behind per level, and a tree has at most
/// 67 levels (`compile::bvh`: 40 + log2 of the number of triangles; one more for instances).
const STACK: usize = 512;

/// Directions that can be scaled without overflow, in every space.
const LENGTHS: RangeInclusive<f64> = 1e-200..=1e200;

/// The vector unit to use.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Unit {
    /// Any processor.
    Portable,
    /// AVX2, FMA and BMI1; only [`Unit::detect`] makes it.
    #[cfg(target_arch = "x86_64")]
    Avx2,
}

impl Unit {
    /// The best that this processor has.
    pub fn detect() -> Self {
        #[cfg(target_arch = "x86_64")]
        if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") && is_x86_feature_detected!("bmi1") {
            return Self::Avx2;
        }
        Self::Portable
    }

    /// For people.
    pub fn name(self) -> &'static str {
        match self {
            Self::Portable => "portable instructions",
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => "AVX2",
        }
    }
}

/// The closest hit, or if `ANY` some hit.
pub fn search<const ANY: bool>(bvh: &Bvh, ray: &Ray, accept: impl FnMut(&Hit) -> bool) -> Option<Hit> {
    let is_finite = ray.origin.is_finite() && ray.direction.is_finite();
    if !is_finite || !LENGTHS.contains(&ray.direction.abs().max_element()) {
        return None;
    }
    match bvh.unit {
        Unit::Portable if bvh.moves => search_with::<Portable, _, ANY, true>(bvh, ray, accept),
        Unit::Portable => search_with::<Portable, _, ANY, false>(bvh, ray, accept),
        #[cfg(target_arch = "x86_64")]
        // SAFETY: this unit exists only where the features were detected.
        Unit::Avx2 if bvh.moves => unsafe { search_avx2::<_, ANY, true>(bvh, ray, accept) },
        #[cfg(target_arch = "x86_64")]
        // SAFETY: the same.
        Unit::Avx2 => unsafe { search_avx2::<_, ANY, false>(bvh, ray, accept) },
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma,bmi1")]
fn search_avx2<A: FnMut(&Hit) -> bool, const ANY: bool, const MOTION: bool>(
    bvh: &Bvh,
    ray: &Ray,
    accept: A,
) -> Option<Hit> {
    search_with::<super::avx2::Avx2, A, ANY, MOTION>(bvh, ray, accept)
}

/// `MOTION`: some instance may move.
#[inline(always)]
fn search_with<S: Simd, A: FnMut(&Hit) -> bool, const ANY: bool, const MOTION: bool>(
    bvh: &Bvh,
    ray: &Ray,
    accept: A,
) -> Option<Hit> {
    let best = Hit { t: ray.t_max, u: 0.0, v: 0.0, triangle: 0, instance: 0 };
    let mut search = Search::<A, ANY> { bvh, best, found: false, ends: ray.ends, accept };
    match &bvh.top {
        None => search.tree::<S>(&bvh.trees[0], 0, ray.origin, ray.direction),
        Some(top) => {
            let slabs = Slabs::new(ray.origin, ray.direction, top.scale);
            let limit = slabs.limit(ray.t_max);
            walk(
                &bvh.nodes,
                top.root,
                &slabs,
                limit,
                InstanceLeaves::<S, A, ANY, MOTION> { ray, slabs: &slabs, search: &mut search },
            );
        }
    }
    search.found.then_some(search.best)
}

/// What has been found so far.
struct Search<'a, A, const ANY: bool> {
    bvh: &'a Bvh,
    best: Hit,
    found: bool,
    ends: [TriangleId; 2],
    accept: A,
}

impl<A: FnMut(&Hit) -> bool, const ANY: bool> Search<'_, A, ANY> {
    /// Searches the triangles of one tree, in its space.
    #[inline(always)]
    fn tree<S: Simd>(&mut self, tree: &Tree, instance: u32, origin: DVec3, direction: DVec3) {
        let slabs = Slabs::new(origin, direction, tree.scale);
        let shear = Shear::new(origin, direction);
        let limit = slabs.limit(self.best.t);
        let nodes = &self.bvh.nodes;
        walk(
            nodes,
            tree.root,
            &slabs,
            limit,
            BlockLeaves::<S, A, ANY> { origin, direction, shear, slabs: &slabs, instance, search: self },
        );
    }

    /// The same of the triangles of an instance that moves, whose space is the world.
    #[inline(always)]
    fn moving_tree<S: Simd>(&mut self, instance: u32, ray: &Ray) {
        let tree = &self.bvh.trees[(self.bvh.instances[instance as usize].tree + ray.moment.piece) as usize];
        let slabs = Slabs::new(ray.origin, ray.direction, tree.scale);
        let shear = Shear::new(ray.origin, ray.direction);
        let limit = slabs.limit(self.best.t);
        let nodes = &self.bvh.nodes;
        let leaves = MovingLeaves::<S, A, ANY> { part: ray.moment.part, shear, slabs: &slabs, instance, search: self };
        walk(nodes, tree.root, &slabs, limit, leaves);
    }

    /// How far to look from now on.
    #[inline(always)]
    fn limit<S: Simd>(&self, slabs: &Slabs<S>) -> f32 {
        if ANY && self.found { -1.0 } else { slabs.limit(self.best.t) }
    }

    #[inline(always)]
    fn take(&mut self, block: &Block, hits: &BlockHits, instance: u32) {
        let mut lanes = hits.lanes;
        while lanes != 0 {
            let lane = (lanes.trailing_zeros() & 3) as usize;
            lanes &= lanes - 1;
            let id = block.ids[lane];
            let triangle = id & !Triangle::ALPHA;
            let hit = Hit { t: hits.t[lane], u: hits.u[lane], v: hits.v[lane], triangle, instance };
            if self.is_better(&hit) && (id & Triangle::ALPHA == 0 || (self.accept)(&hit)) {
                self.best = hit;
                self.found = true;
            }
        }
    }

    #[inline(never)]
    fn take_sphere(&mut self, leaf: usize, origin: DVec3, direction: DVec3, instance: u32) {
        let sphere = &self.bvh.spheres[Child::LAST_LEAF as usize - leaf];
        let Some(SphereHit { t, place: [u, v] }) = sphere.intersect(origin, direction) else { return };
        let hit = Hit { t, u, v, triangle: sphere.id, instance };
        if t < self.best.t && self.is_better(&hit) {
            self.best = hit;
            self.found = true;
        }
    }

    /// Nearer; of two at the same distance, that of the lower numbers, so that the order of visits shows nowhere.
    #[inline(always)]
    fn is_better(&self, hit: &Hit) -> bool {
        let tie = || (hit.instance, hit.triangle) < (self.best.instance, self.best.triangle);
        let nearer = hit.t > 0.0 && (hit.t < self.best.t || self.found && hit.t == self.best.t && tie());
        nearer && !self.ends.contains(&TriangleId::from(hit))
    }
}

/// What a walk does with the leaves that it comes to.
///
/// Traits and not closures: these would not take on the target features of the function that they end up in.
trait Leaves {
    /// Looks into a leaf up to a limit and returns the limit from there on; a negative one ends the walk.
    fn visit(&mut self, leaf: usize, limit: f32) -> f32;
}

/// Leaves are blocks of triangles, and spheres.
struct BlockLeaves<'s, 'a, S: Simd, A, const ANY: bool> {
    origin: DVec3,
    direction: DVec3,
    shear: Shear,
    slabs: &'s Slabs<S>,
    instance: u32,
    search: &'s mut Search<'a, A, ANY>,
}

impl<S: Simd, A: FnMut(&Hit) -> bool, const ANY: bool> Leaves for BlockLeaves<'_, '_, S, A, ANY> {
    #[inline(always)]
    fn visit(&mut self, leaf: usize, limit: f32) -> f32 {
        let Some(block) = self.search.bvh.blocks.get(leaf) else {
            self.search.take_sphere(leaf, self.origin, self.direction, self.instance);
            return self.search.limit(self.slabs);
        };
        let Some(hits) = intersect::<S>(block, &self.shear, self.search.best.t) else { return limit };
        self.search.take(block, &hits, self.instance);
        self.search.limit(self.slabs)
    }
}

/// Leaves are pairs of blocks: the same triangles at the beginning and at the end of a piece of their way.
struct MovingLeaves<'s, 'a, S: Simd, A, const ANY: bool> {
    part: f64,
    shear: Shear,
    slabs: &'s Slabs<S>,
    instance: u32,
    search: &'s mut Search<'a, A, ANY>,
}

impl<S: Simd, A: FnMut(&Hit) -> bool, const ANY: bool> Leaves for MovingLeaves<'_, '_, S, A, ANY> {
    #[inline(always)]
    fn visit(&mut self, leaf: usize, limit: f32) -> f32 {
        let Some([begin, end]) = self.search.bvh.blocks.get(leaf..leaf + 2) else { return limit };
        let hits = intersect_between::<S>([begin, end], self.part, &self.shear, self.search.best.t);
        let Some(hits) = hits else { return limit };
        self.search.take(begin, &hits, self.instance);
        self.search.limit(self.slabs)
    }
}

/// Leaves are instances.
struct InstanceLeaves<'s, 'a, S: Simd, A, const ANY: bool, const MOTION: bool> {
    ray: &'s Ray,
    slabs: &'s Slabs<S>,
    search: &'s mut Search<'a, A, ANY>,
}

impl<S: Simd, A: FnMut(&Hit) -> bool, const ANY: bool, const MOTION: bool> Leaves
    for InstanceLeaves<'_, '_, S, A, ANY, MOTION>
{
    #[inline(always)]
    fn visit(&mut self, leaf: usize, _: f32) -> f32 {
        let bvh = self.search.bvh;
        let instance = &bvh.instances[leaf];
        if MOTION && instance.moves {
            self.search.moving_tree::<S>(leaf as u32, self.ray);
            return self.search.limit(self.slabs);
        }
        let origin = instance.to_object.transform_point3(self.ray.origin);
        let direction = instance.to_object.transform_vector3(self.ray.direction);
        self.search.tree::<S>(&bvh.trees[instance.tree as usize], leaf as u32, origin, direction);
        self.search.limit(self.slabs)
    }
}

/// Children that were met and wait, each with the distance at which the ray enters it.
struct Stack {
    entries: [MaybeUninit<u64>; STACK],
    len: usize,
}

/// Distance in the upper half: as it is not negative, its bits are in the order of its value.
#[inline(always)]
fn entry(child: Child, distance: f32) -> u64 {
    u64::from(distance.to_bits()) << 32 | u64::from(child.bits())
}

/// Takes the lowest bit, of which there must be one, and returns the entry of its child.
#[inline(always)]
fn take_first(node: &Node, met: &mut u32, distances: &[f32; 8]) -> u64 {
    let slot = (met.trailing_zeros() & 7) as usize;
    *met &= *met - 1;
    entry(node.children[slot], distances[slot])
}

impl Stack {
    #[inline(always)]
    fn push(&mut self, entry: u64) {
        self.entries[self.len].write(entry);
        self.len += 1;
    }

    /// Pushes, but below what is nearer among the entries from `base` on.
    #[inline(always)]
    fn push_sorted(&mut self, entry: u64, base: usize) {
        let mut at = self.len;
        self.push(entry);
        // SAFETY: entries below `len` were written.
        while at > base && unsafe { self.entries[at - 1].assume_init() } < entry {
            self.entries[at] = self.entries[at - 1];
            at -= 1;
        }
        self.entries[at].write(entry);
    }

    /// Takes up the children that were met (a bit each) and hands out the nearest.
    #[inline(always)]
    fn push_all_but_nearest(&mut self, node: &Node, mut met: u32, distances: &[f32; 8]) -> Option<Child> {
        if met == 0 {
            return None;
        }
        if met & (met - 1) == 0 {
            return Some(node.children[(met.trailing_zeros() & 7) as usize]);
        }
        let base = self.len;
        let mut nearest = take_first(node, &mut met, distances);
        while met != 0 {
            let another = take_first(node, &mut met, distances);
            self.push_sorted(nearest.max(another), base);
            nearest = nearest.min(another);
        }
        Some(Child::from_bits(nearest as u32))
    }

    /// The child on top, without those that lie beyond the limit.
    #[inline(always)]
    fn pop(&mut self, limit: f32) -> Option<Child> {
        while self.len > 0 {
            self.len -= 1;
            // SAFETY: entries below `len` were written.
            let entry = unsafe { self.entries[self.len].assume_init() };
            if f32::from_bits((entry >> 32) as u32) <= limit {
                return Some(Child::from_bits(entry as u32));
            }
        }
        None
    }
}

/// Hands the leaves that the ray meets before `limit` to `leaves`, roughly from near to far.
#[inline(always)]
fn walk<S: Simd>(nodes: &[Node], root: u32, slabs: &Slabs<S>, mut limit: f32, mut leaves: impl Leaves) {
    let mut stack = Stack { entries: [const { MaybeUninit::uninit() }; STACK], len: 0 };
    let mut current = Child::node(root);
    loop {
        while !current.is_leaf() {
            let node = &nodes[current.index()];
            let (met, distances) = slabs.enter(node, limit);
            let Some(nearest) = stack.push_all_but_nearest(node, met, &distances).or_else(|| stack.pop(limit)) else {
                return;
            };
            current = nearest;
        }
        limit = leaves.visit(current.index(), limit);
        let Some(child) = stack.pop(limit) else { return };
        current = child;
    }
}
