//! [`Simd`] by AVX2 and FMA.
//!
//! The types stay within this room, which makes them only in functions that are compiled for these features and
//! called only after they have been detected ([`super::traverse`]). Every `unsafe` block here rests on that.

use super::simd::{F32x8, F64x4, Lanes, Simd};
use std::arch::x86_64::*;
use std::ops::{Add, Div, Mul, Sub};

/// For processors with AVX2 and FMA.
pub struct Avx2;

impl Simd for Avx2 {
    type F32 = M256;
    type F64 = M256d;
}

/// Eight f32.
#[derive(Clone, Copy)]
pub struct M256(__m256);

/// Four f64.
#[derive(Clone, Copy)]
pub struct M256d(__m256d);

macro_rules! operator {
    ($type:ident, $trait:ident, $function:ident, $intrinsic:ident) => {
        impl $trait for $type {
            type Output = Self;

            #[inline(always)]
            fn $function(self, other: Self) -> Self {
                // SAFETY: the feature was detected (see the module).
                Self(unsafe { $intrinsic(self.0, other.0) })
            }
        }
    };
}

operator!(M256, Add, add, _mm256_add_ps);
operator!(M256, Sub, sub, _mm256_sub_ps);
operator!(M256, Mul, mul, _mm256_mul_ps);
operator!(M256d, Add, add, _mm256_add_pd);
operator!(M256d, Sub, sub, _mm256_sub_pd);
operator!(M256d, Mul, mul, _mm256_mul_pd);
operator!(M256d, Div, div, _mm256_div_pd);

macro_rules! lanes {
    ($type:ident, $min:ident, $max:ident, $compare:ident, $mask:ident) => {
        impl Lanes for $type {
            #[inline(always)]
            fn min(self, other: Self) -> Self {
                // SAFETY: the feature was detected (see the module).
                Self(unsafe { $min(self.0, other.0) })
            }

            #[inline(always)]
            fn max(self, other: Self) -> Self {
                // SAFETY: the feature was detected (see the module).
                Self(unsafe { $max(self.0, other.0) })
            }

            #[inline(always)]
            fn at_most(self, other: Self) -> u32 {
                // SAFETY: the feature was detected (see the module).
                (unsafe { $mask($compare::<_CMP_LE_OQ>(self.0, other.0)) }) as u32
            }
        }
    };
}

lanes!(M256, _mm256_min_ps, _mm256_max_ps, _mm256_cmp_ps, _mm256_movemask_ps);
lanes!(M256d, _mm256_min_pd, _mm256_max_pd, _mm256_cmp_pd, _mm256_movemask_pd);

impl F32x8 for M256 {
    #[inline(always)]
    fn splat(value: f32) -> Self {
        // SAFETY: the feature was detected (see the module).
        Self(unsafe { _mm256_set1_ps(value) })
    }

    #[inline(always)]
    fn load(values: &[f32; 8]) -> Self {
        // SAFETY: the feature was detected (see the module); eight values are read.
        Self(unsafe { _mm256_loadu_ps(values.as_ptr()) })
    }

    #[inline(always)]
    fn to_array(self) -> [f32; 8] {
        let mut values = [0.0; 8];
        // SAFETY: the feature was detected (see the module); eight values are written.
        unsafe { _mm256_storeu_ps(values.as_mut_ptr(), self.0) };
        values
    }

    #[inline(always)]
    fn mul_sub(self, factor: Self, subtrahend: Self) -> Self {
        // SAFETY: the feature was detected (see the module).
        Self(unsafe { _mm256_fmsub_ps(self.0, factor.0, subtrahend.0) })
    }
}

impl F64x4 for M256d {
    #[inline(always)]
    fn splat(value: f64) -> Self {
        // SAFETY: the feature was detected (see the module).
        Self(unsafe { _mm256_set1_pd(value) })
    }

    #[inline(always)]
    fn widen(values: &[f32; 4]) -> Self {
        // SAFETY: the feature was detected (see the module); four values are read.
        Self(unsafe { _mm256_cvtps_pd(_mm_loadu_ps(values.as_ptr())) })
    }

    #[inline(always)]
    fn to_array(self) -> [f64; 4] {
        let mut values = [0.0; 4];
        // SAFETY: the feature was detected (see the module); four values are written.
        unsafe { _mm256_storeu_pd(values.as_mut_ptr(), self.0) };
        values
    }
}
