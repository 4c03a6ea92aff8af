//! Eight boxes against one ray, in f32, never missing what the f64 ray meets.
//!
//! Boxes are stored in units of their tree, in which all coordinates lie in [-1, 1]. With `o` the origin and `d` the
//! direction in these units, `d` scaled so that its largest component is 1 to 2, the ray crosses the plane `b` of an axis at
//! `(b - o) / d`, evaluated as `b i - c`, where `i` is `1 / d` in f32. Why the interval of a box that the ray meets is
//! never empty (compare Ize 2013, "Robust BVH Ray Traversal"):
//!
//! - `i` has a relative error, and so has the last rounding, of some 2^-24 each. Both act on the whole crossing: its sign is
//!   right, and its size is off by a factor within `WIDEN`, by which the far ends are multiplied. (`1 / d` in f32 of a `d`
//!   rounded to f32: 2 roundings; subtraction: 1; the same for the other end: 6 in all, which 2^-20 covers.)
//! - `c` is `o i` by f64, moved outwards by more than its rounding to f32: up for the near planes, down for the far ones.
//!   Where multiply and subtract are not fused, `b i` is rounded too, by at most 2^-24 |i| as |b| <= 1: half of `PAD`.
//! - A component that is zero, or nearly, is replaced by one too small to matter: a ray leaves the unit box at a t of
//!   at most `1 + |o|`, by when the replacement has moved it by less than 2^-26: within the other half of `PAD`. This makes
//!   rays within the plane of a face meet the box, whose crossing would else be `0 * infinity`.
//! - Crossings that overflow become infinite with the right sign; `c` is kept finite, so no NaN comes up.

use super::simd::{F32x8, Lanes, Simd};
use crate::compile::Bounds;
use glam::DVec3;

/// Bound of the relative error of crossings.
const WIDEN: f32 = 1.0 + 1.0 / (1 << 20) as f32;
/// By how much boxes are grown, in their units.
const PAD: f64 = 1.0 / (1 << 23) as f64;
/// Twice the bound of the relative error of a rounding to f32.
const ROUNDING: f64 = 1.0 / (1 << 23) as f64;
/// The bits of the exponent of an f64.
const EXPONENT: u64 = 0x7ff << 52;
/// Least component of a direction, times the distance of what the ray can reach.
const LEAST: f64 = 1.0 / (1 << 27) as f64;

/// What hangs below a node in one place: a node or a leaf.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Child(u32);

impl Child {
    const LEAF: u32 = 1 << 31;
    /// Highest index of a leaf.
    pub const LAST_LEAF: u32 = Self::LEAF - 2;
    /// Nothing; its box is empty and never met.
    pub const NONE: Self = Self(u32::MAX);

    /// A node by its index.
    pub fn node(index: u32) -> Self {
        debug_assert!(index & Self::LEAF == 0);
        Self(index)
    }

    /// A leaf by its index.
    pub fn leaf(index: u32) -> Self {
        debug_assert!(index & Self::LEAF == 0);
        Self(index | Self::LEAF)
    }

    /// From [`Child::bits`].
    #[inline(always)]
    pub fn from_bits(bits: u32) -> Self {
        Self(bits)
    }

    /// As one number.
    #[inline(always)]
    pub fn bits(self) -> u32 {
        self.0
    }

    /// Whether it is a leaf.
    #[inline(always)]
    pub fn is_leaf(self) -> bool {
        self.0 & Self::LEAF != 0
    }

    /// Index of the node or leaf.
    #[inline(always)]
    pub fn index(self) -> usize {
        (self.0 & !Self::LEAF) as usize
    }
}

/// A node: up to eight children and their boxes.
#[derive(Debug, Clone)]
#[repr(C, align(32))]
pub struct Node {
    /// Minima along x, y and z, then maxima; in units of the tree.
    planes: [[f32; 8]; 6],
    /// What is in the boxes.
    pub children: [Child; 8],
}

impl Node {
    /// A node without children yet, from their boxes and the factor (a power of two) that takes these to the tree's units.
    pub fn new(boxes: impl Iterator<Item = Bounds>, scale: f64) -> Self {
        let mut planes = [[f32::INFINITY; 8], [f32::NEG_INFINITY; 8]].map(|ends| [ends; 3]);
        for (slot, bounds) in boxes.take(8).enumerate().filter(|(_, bounds)| !bounds.is_empty()) {
            let scaled = Bounds::outwards(bounds.min.as_dvec3() * scale, bounds.max.as_dvec3() * scale);
            for (ends, corner) in planes.iter_mut().zip([scaled.min, scaled.max]) {
                ends.iter_mut().zip(corner.to_array()).for_each(|(row, plane)| row[slot] = plane);
            }
        }
        let [[a, b, c], [d, e, f]] = planes;
        Self { planes: [a, b, c, d, e, f], children: [Child::NONE; 8] }
    }
}

impl Node {
    /// Children in use.
    pub fn len(&self) -> usize {
        self.children.iter().filter(|child| **child != Child::NONE).count()
    }
}

/// A ray as the boxes of one tree see it.
pub struct Slabs<S: Simd> {
    /// `1 / d`.
    inverse: [S::F32; 3],
    /// `c` of the near planes.
    near: [S::F32; 3],
    /// `c` of the far planes.
    far: [S::F32; 3],
    /// Rows of [`Node::planes`] that are met first; all below 6. The others are met last.
    near_rows: [usize; 3],
    /// Box units of one t of the ray.
    unit: f64,
}

impl<S: Simd> Slabs<S> {
    /// For a ray whose direction is finite and not zero, and a tree with this factor to its units.
    #[inline(always)]
    pub fn new(origin: DVec3, direction: DVec3, scale: f64) -> Self {
        let origin = origin * scale;
        // The power of two at or below the longest component, and its inverse.
        let exponent = direction.abs().max_element().to_bits() & EXPONENT;
        let (length, inverse) = (f64::from_bits(exponent), f64::from_bits((2046 << 52) - exponent));
        let direction = direction * inverse;
        let least = LEAST / (1.0 + origin.abs().max_element());
        let [x, y, z] = [
            Axis::new(origin.x, direction.x, least),
            Axis::new(origin.y, direction.y, least),
            Axis::new(origin.z, direction.z, least),
        ];
        Self {
            inverse: splat::<S>([x.inverse, y.inverse, z.inverse]),
            near: splat::<S>([x.near, y.near, z.near]),
            far: splat::<S>([x.far, y.far, z.far]),
            near_rows: [x.row, 1 + y.row, 2 + z.row],
            unit: length * scale,
        }
    }

    /// A t of the ray as a distance in box units, rounded up.
    #[inline(always)]
    pub fn limit(&self, t: f64) -> f32 {
        (t * self.unit) as f32 * WIDEN
    }

    /// Tests the eight boxes. Returns a bit for each that the ray meets before `limit`, and where it enters them (not negative).
    #[inline(always)]
    pub fn enter(&self, node: &Node, limit: f32) -> (u32, [f32; 8]) {
        let near =
            self.crossing::<false>(node, 0).max(self.crossing::<false>(node, 1)).max(self.crossing::<false>(node, 2));
        let far =
            self.crossing::<true>(node, 0).min(self.crossing::<true>(node, 1)).min(self.crossing::<true>(node, 2));
        let near = near.max(S::F32::splat(0.0));
        let far = (far * S::F32::splat(WIDEN)).min(S::F32::splat(limit));
        (near.at_most(far), near.to_array())
    }
    /// Where the ray crosses the near planes (`FAR` false) or the far ones of an axis.
    #[inline(always)]
    fn crossing<const FAR: bool>(&self, node: &Node, axis: usize) -> S::F32 {
        let near = self.near_rows[axis];
        let row = if FAR { 3 + 2 * axis - near } else { near };
        // SAFETY: `new` makes `near` from the axis or the axis plus 3, and so is the other one.
        let planes = unsafe { node.planes.get_unchecked(row) };
        S::F32::load(planes).mul_sub(self.inverse[axis], if FAR { self.far[axis] } else { self.near[axis] })
    }
}

/// One axis of [`Slabs`].
struct Axis {
    inverse: f32,
    near: f32,
    far: f32,
    /// 3 if maxima are met first, else 0.
    row: usize,
}

impl Axis {
    #[inline(always)]
    fn new(origin: f64, direction: f64, least: f64) -> Self {
        let inverse = 1.0 / direction.abs().max(least).copysign(direction) as f32;
        let i = f64::from(inverse);
        let c = origin * i;
        let slack = (PAD + ROUNDING * origin.abs()) * i.abs();
        let most = f64::from(f32::MAX);
        Self {
            inverse,
            near: (c + slack).clamp(-most, most) as f32,
            far: (c - slack).clamp(-most, most) as f32,
            row: if inverse < 0.0 { 3 } else { 0 },
        }
    }
}

/// Each number in all lanes.
#[inline(always)]
fn splat<S: Simd>(values: [f32; 3]) -> [S::F32; 3] {
    [S::F32::splat(values[0]), S::F32::splat(values[1]), S::F32::splat(values[2])]
}
