//! Four triangles against one ray, watertight (Woop, Benthin, Wald 2013, "Watertight Ray/Triangle Intersection",
//! appendix A), in f64.
//!
//! The ray's space is sheared so that the ray is the z axis; vertices become points of the plane, and the same vertex becomes
//! the same point in every triangle that has it. Whether the origin lies left of the edge from a to b is the sign of
//! `a.x b.y - a.y b.x`. Rounding is monotonic, so the rounded difference of the rounded products may become zero but never
//! has the wrong sign; zero counts as inside for the triangles on both sides. Hence no ray passes between two
//! triangles that share an edge or around a vertex inside a closed mesh. A fused multiply and add would break this: do not use it here.

use super::simd::{F64x4, Lanes, Simd};
use crate::compile::Triangle;
use glam::DVec3;

/// Up to four triangles, one per lane. Unused lanes hold NaN, which no comparison lets in.
#[derive(Debug, Clone)]
#[repr(C, align(32))]
pub struct Block {
    /// By vertex, axis, lane.
    vertices: [[[f32; 4]; 3]; 3],
    /// Index of each in the scene; bit 31 ([`Triangle::ALPHA`]): its alpha must be tested.
    pub ids: [u32; 4],
}

impl Block {
    /// Triangles in a block.
    pub const SIZE: usize = 4;

    /// Of the triangles with these indices, four at most.
    pub fn new(indices: &[u32], triangle: impl Fn(u32) -> Triangle) -> Self {
        let mut block = Self { vertices: [[[f32::NAN; 4]; 3]; 3], ids: [0; 4] };
        for (lane, index) in indices.iter().enumerate() {
            let triangle = triangle(*index);
            for (rows, vertex) in block.vertices.iter_mut().zip([triangle.v0, triangle.v1, triangle.v2]) {
                for (row, coordinate) in rows.iter_mut().zip(vertex) {
                    row[lane] = coordinate;
                }
            }
            block.ids[lane] = index | triangle.material & Triangle::ALPHA;
        }
        block
    }

    /// Lanes in use.
    pub fn len(&self) -> usize {
        self.vertices[0][0].iter().filter(|x| !x.is_nan()).count()
    }
}

/// A ray as its triangles see it: sheared along its longest axis.
#[derive(Debug, Clone, Copy)]
pub struct Shear {
    /// Two other axes, and the one along which the direction is longest; all below 3.
    axes: [usize; 3],
    /// Origin along these.
    origin: [f64; 3],
    /// What takes the direction to (0, 0, 1).
    shear: [f64; 3],
}

impl Shear {
    /// For a direction that is finite and not zero.
    #[inline(always)]
    pub fn new(origin: DVec3, direction: DVec3) -> Self {
        let magnitude = direction.abs();
        let axes = if magnitude.x >= magnitude.y && magnitude.x >= magnitude.z {
            [1, 2, 0]
        } else if magnitude.y >= magnitude.z {
            [2, 0, 1]
        } else {
            [0, 1, 2]
        };
        let inverse = 1.0 / direction[axes[2]];
        let shear = [direction[axes[0]] * inverse, direction[axes[1]] * inverse, inverse];
        Self { axes, origin: axes.map(|axis| origin[axis]), shear }
    }
}

/// Which lanes were hit, and where.
pub struct BlockHits {
    /// Bit per lane; not zero.
    pub lanes: u32,
    /// Multiples of the direction.
    pub t: [f64; 4],
    /// Weights of the second vertices.
    pub u: [f64; 4],
    /// Weights of the third vertices.
    pub v: [f64; 4],
}

/// The triangles that the ray hits at a t that is not negative and at most `t_max`.
#[inline(always)]
pub fn intersect<S: Simd>(block: &Block, ray: &Shear, t_max: f64) -> Option<BlockHits> {
    let [a, b, c] = &block.vertices;
    let corners = [
        sheared::<S>(turned::<S>(a, ray), ray),
        sheared::<S>(turned::<S>(b, ray), ray),
        sheared::<S>(turned::<S>(c, ray), ray),
    ];
    meet::<S>(corners, ray, t_max)
}

/// The same of triangles that are a part of their way from one block to the next.
#[inline(always)]
pub fn intersect_between<S: Simd>(blocks: [&Block; 2], part: f64, ray: &Shear, t_max: f64) -> Option<BlockHits> {
    let [[a, b, c], [d, e, f]] = [&blocks[0].vertices, &blocks[1].vertices];
    let part = S::F64::splat(part);
    let corners = [
        sheared::<S>(between::<S>(a, d, part, ray), ray),
        sheared::<S>(between::<S>(b, e, part, ray), ray),
        sheared::<S>(between::<S>(c, f, part, ray), ray),
    ];
    meet::<S>(corners, ray, t_max)
}

#[inline(always)]
fn meet<S: Simd>(corners: [(S::F64, S::F64, S::F64); 3], ray: &Shear, t_max: f64) -> Option<BlockHits> {
    let [(ax, ay, az), (bx, by, bz), (cx, cy, cz)] = corners;
    // Weights of the three vertices, not yet divided by their sum.
    let a = cx * by - cy * bx;
    let b = ax * cy - ay * cx;
    let c = bx * ay - by * ax;
    let zero = S::F64::splat(0.0);
    let inside = zero.at_most(a.min(b).min(c)) | a.max(b).max(c).at_most(zero);
    if inside == 0 {
        return None;
    }
    let sum = a + b + c;
    let t = (a * az + b * bz + c * cz) * S::F64::splat(ray.shear[2]) / sum;
    // A sum of zero (the ray lies in the triangle's plane) gives NaN or an infinity: not below any t_max, or told apart
    // by the caller, who asks for less than what it has.
    let lanes = inside & zero.at_most(t) & t.at_most(S::F64::splat(t_max));
    (lanes != 0).then(|| BlockHits { lanes, t: t.to_array(), u: (b / sum).to_array(), v: (c / sum).to_array() })
}

/// Coordinates of a vertex of each lane, in the order of the ray's axes. Written out, as a closure would not take on the target
/// features of its caller.
#[inline(always)]
fn turned<S: Simd>(vertex: &[[f32; 4]; 3], ray: &Shear) -> [S::F64; 3] {
    let [x, y, z] = ray.axes;
    [S::F64::widen(&vertex[x]), S::F64::widen(&vertex[y]), S::F64::widen(&vertex[z])]
}

/// The same a part of the way from one place to another.
#[inline(always)]
fn between<S: Simd>(begin: &[[f32; 4]; 3], end: &[[f32; 4]; 3], part: S::F64, ray: &Shear) -> [S::F64; 3] {
    let ([ax, ay, az], [bx, by, bz]) = (turned::<S>(begin, ray), turned::<S>(end, ray));
    [ax + (bx - ax) * part, ay + (by - ay) * part, az + (bz - az) * part]
}

/// A vertex of each lane in the ray's space, by its coordinates in the order of the ray's axes; z not yet scaled.
#[inline(always)]
fn sheared<S: Simd>([x, y, z]: [S::F64; 3], ray: &Shear) -> (S::F64, S::F64, S::F64) {
    let z = z - S::F64::splat(ray.origin[2]);
    let x = x - S::F64::splat(ray.origin[0]) - S::F64::splat(ray.shear[0]) * z;
    let y = y - S::F64::splat(ray.origin[1]) - S::F64::splat(ray.shear[1]) * z;
    (x, y, z)
}
