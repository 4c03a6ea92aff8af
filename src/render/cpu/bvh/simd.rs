//! The few vector operations that traversal is made of: eight f32 for the boxes of a node, four f64 for the
//! triangles of a block. The kernels are written once over these traits; [`Portable`] is plain arrays, which the compiler
//! vectorises as it can, and `avx2.rs` has the same by intrinsics.
//!
//! All functions are `inline(always)`: they take on the target features of the function that they end up in.

use std::ops::{Add, Div, Mul, Sub};

/// A set of vector types.
pub trait Simd {
    /// One lane per child of a node.
    type F32: F32x8;
    /// One lane per triangle of a block.
    type F64: F64x4;
}

/// What both types can do.
pub trait Lanes: Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> {
    /// Lane by lane; `other` where either is NaN or both are equal.
    fn min(self, other: Self) -> Self;
    /// Lane by lane; `other` where either is NaN or both are equal.
    fn max(self, other: Self) -> Self;
    /// Bit i is set if lane i is less than or equal to that of `other`.
    fn at_most(self, other: Self) -> u32;
}

/// Eight f32.
pub trait F32x8: Lanes {
    /// The same in all lanes.
    fn splat(value: f32) -> Self;
    /// From memory.
    fn load(values: &[f32; 8]) -> Self;
    /// To memory.
    fn to_array(self) -> [f32; 8];
    /// `self * factor - subtrahend`, rounded once or twice.
    fn mul_sub(self, factor: Self, subtrahend: Self) -> Self;
}

/// Four f64.
pub trait F64x4: Lanes + Div<Output = Self> {
    /// The same in all lanes.
    fn splat(value: f64) -> Self;
    /// From f32 in memory.
    fn widen(values: &[f32; 4]) -> Self;
    /// To memory.
    fn to_array(self) -> [f64; 4];
}

/// For every processor.
pub struct Portable;

impl Simd for Portable {
    type F32 = Array<f32, 8>;
    type F64 = Array<f64, 4>;
}

/// Lanes of [`Portable`].
#[derive(Clone, Copy)]
pub struct Array<T, const N: usize>([T; N]);

macro_rules! operator {
    ($trait:ident, $function:ident) => {
        impl<T: Copy + $trait<Output = T>, const N: usize> $trait for Array<T, N> {
            type Output = Self;

            #[inline(always)]
            fn $function(self, other: Self) -> Self {
                Self(std::array::from_fn(|i| self.0[i].$function(other.0[i])))
            }
        }
    };
}

operator!(Add, add);
operator!(Sub, sub);
operator!(Mul, mul);
operator!(Div, div);

impl<T, const N: usize> Lanes for Array<T, N>
where
    T: Copy + PartialOrd + Add<Output = T> + Sub<Output = T> + Mul<Output = T>,
{
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        Self(std::array::from_fn(|i| if self.0[i] < other.0[i] { self.0[i] } else { other.0[i] }))
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        Self(std::array::from_fn(|i| if self.0[i] > other.0[i] { self.0[i] } else { other.0[i] }))
    }

    #[inline(always)]
    fn at_most(self, other: Self) -> u32 {
        (0..N).map(|i| u32::from(self.0[i] <= other.0[i]) << i).sum()
    }
}

impl F32x8 for Array<f32, 8> {
    #[inline(always)]
    fn splat(value: f32) -> Self {
        Self([value; 8])
    }

    #[inline(always)]
    fn load(values: &[f32; 8]) -> Self {
        Self(*values)
    }

    #[inline(always)]
    fn to_array(self) -> [f32; 8] {
        self.0
    }

    #[inline(always)]
    fn mul_sub(self, factor: Self, subtrahend: Self) -> Self {
        self * factor - subtrahend
    }
}

impl F64x4 for Array<f64, 4> {
    #[inline(always)]
    fn splat(value: f64) -> Self {
        Self([value; 4])
    }

    #[inline(always)]
    fn widen(values: &[f32; 4]) -> Self {
        Self(values.map(f64::from))
    }

    #[inline(always)]
    fn to_array(self) -> [f64; 4] {
        self.0
    }
}
