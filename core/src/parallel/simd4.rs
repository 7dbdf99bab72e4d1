//! Vectors with a fourth lane, so that processors add and multiply whole vectors at once.

use std::ops::{Add, AddAssign, Mul, Sub, SubAssign};

use crate::Vec3;
use crate::parallel::parts::PART_SIZE;

/// Three components and a zero: what the inner loops of a part work on.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
#[repr(C, align(32))]
pub struct Simd4([f64; 4]);

/// One vector for each vertex of a part, on the stack of the thread that works on it.
pub type PartSimd4 = [Simd4; PART_SIZE];

impl Simd4 {
    /// No length.
    pub const ZERO: Self = Self([0.0; 4]);

    /// Scalar product. Its order of addition is that of halves, which needs no lane by itself.
    #[inline(always)]
    pub fn dot(self, other: Self) -> f64 {
        let p = [0, 1, 2, 3].map(|k| self.0[k] * other.0[k]);
        let [even, odd] = [p[0] + p[2], p[1] + p[3]];
        even + odd
    }

    /// Copies the vectors of a part to the front of `to`, and returns them.
    pub fn copy<'a>(from: &[Vec3], to: &'a mut PartSimd4) -> &'a [Self] {
        let to = &mut to[..from.len()];
        to.iter_mut().zip(from).for_each(|(to, from)| *to = Self::from(from));
        to
    }
}

impl From<&Vec3> for Simd4 {
    #[inline(always)]
    fn from(v: &Vec3) -> Self {
        Self([v.x, v.y, v.z, 0.0])
    }
}

impl From<Simd4> for Vec3 {
    #[inline(always)]
    fn from(v: Simd4) -> Self {
        Self::new(v.0[0], v.0[1], v.0[2])
    }
}

impl Add for Simd4 {
    type Output = Self;

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Self([0, 1, 2, 3].map(|k| self.0[k] + other.0[k]))
    }
}

impl Sub for Simd4 {
    type Output = Self;

    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        Self([0, 1, 2, 3].map(|k| self.0[k] - other.0[k]))
    }
}

impl Mul<f64> for Simd4 {
    type Output = Self;

    #[inline(always)]
    fn mul(self, factor: f64) -> Self {
        Self(self.0.map(|a| a * factor))
    }
}

impl AddAssign for Simd4 {
    #[inline(always)]
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl SubAssign for Simd4 {
    #[inline(always)]
    fn sub_assign(&mut self, other: Self) {
        *self = *self - other;
    }
}
