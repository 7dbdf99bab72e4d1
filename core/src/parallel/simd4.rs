//! Vectors with a fourth lane, so that processors add and multiply whole vectors at once.

use std::ops::{Add, AddAssign, Mul, Sub, SubAssign};

use crate::Vec3;
use crate::parallel::parts::PART_SIZE;

/// Three components and a zero: what the inner loops of a part work on.
#[derive(Debug, Clone, Copy, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C, align(32))]
pub struct Simd4([f64; 4]);

/// One vector for each vertex of a part, on the stack of the thread that works on it.
pub(crate) type PartSimd4 = [Simd4; PART_SIZE];

impl Simd4 {
    /// No length.
    pub const ZERO: Self = Self([0.0; 4]);

    /// Scalar product. Its order of addition is that of halves, which needs no lane by itself.
    #[inline(always)]
    pub fn dot(self, other: Self) -> f64 {
        self.component_mul(other).sum()
    }

    /// Sum of the lanes, in the order of halves.
    #[inline(always)]
    pub fn sum(self) -> f64 {
        let [even, odd] = [self.0[0] + self.0[2], self.0[1] + self.0[3]];
        even + odd
    }

    /// `self * factors + sum`, lane by lane, rounded once.
    #[inline(always)]
    pub(crate) fn mul_add(self, factors: Self, sum: Self) -> Self {
        let ([x, y, z, w], f, s) = (self.0, factors.0, sum.0);
        Self([x.mul_add(f[0], s[0]), y.mul_add(f[1], s[1]), z.mul_add(f[2], s[2]), w.mul_add(f[3], s[3])])
    }

    /// Lane by lane.
    #[inline(always)]
    pub fn component_mul(self, factors: Self) -> Self {
        let ([x, y, z, w], f) = (self.0, factors.0);
        Self([x * f[0], y * f[1], z * f[2], w * f[3]])
    }

    /// The fourth lane in all lanes.
    #[inline(always)]
    pub fn last(self) -> Self {
        Self([self.0[3]; 4])
    }

    /// In single precision.
    #[inline(always)]
    pub(crate) fn narrowed(self) -> [f32; 4] {
        let [x, y, z, w] = self.0;
        [x as f32, y as f32, z as f32, w as f32]
    }

    /// (y, z, x).
    #[inline(always)]
    pub fn turned(self) -> Self {
        let [x, y, z, w] = self.0;
        Self([y, z, x, w])
    }

    /// (z, x, y).
    #[inline(always)]
    pub(crate) fn turned_back(self) -> Self {
        let [x, y, z, w] = self.0;
        Self([z, x, y, w])
    }

    /// Makes a vector of components and a fourth number, which is zero unless it only meets zeros.
    #[inline(always)]
    pub(crate) fn new(components: [f64; 4]) -> Self {
        Self(components)
    }

    /// Makes a vector of numbers in single precision; the fourth is taken as it is.
    #[inline(always)]
    pub(crate) fn widened(values: &[f32; 4]) -> Self {
        let [x, y, z, w] = *values;
        Self([f64::from(x), f64::from(y), f64::from(z), f64::from(w)])
    }

    /// Copies the vectors of a part to the front of `to`, and returns them.
    pub(crate) fn copy<'a>(from: &[Vec3], to: &'a mut PartSimd4) -> &'a [Self] {
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
        let ([x, y, z, w], o) = (self.0, other.0);
        Self([x + o[0], y + o[1], z + o[2], w + o[3]])
    }
}

impl Sub for Simd4 {
    type Output = Self;

    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        let ([x, y, z, w], o) = (self.0, other.0);
        Self([x - o[0], y - o[1], z - o[2], w - o[3]])
    }
}

impl Mul<f64> for Simd4 {
    type Output = Self;

    #[inline(always)]
    fn mul(self, factor: f64) -> Self {
        let [x, y, z, w] = self.0;
        Self([x * factor, y * factor, z * factor, w * factor])
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
