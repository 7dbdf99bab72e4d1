//! Four numbers or four vectors at once, so that processors work on all corners of a query together.

use std::ops::{Add, Mul, Sub};

use crate::Vec3;

/// One number for each of the four corners.
#[derive(Clone, Copy)]
#[repr(C, align(32))]
pub(super) struct Four(pub(super) [f64; 4]);

impl Four {
    #[inline(always)]
    pub(super) fn all(value: f64) -> Self {
        Self([value; 4])
    }

    #[inline(always)]
    fn with(self, other: Self, of: impl Fn(f64, f64) -> f64) -> Self {
        let ([a, b, c, d], [e, f, g, h]) = (self.0, other.0);
        Self([of(a, e), of(b, f), of(c, g), of(d, h)])
    }

    /// The smaller ones; of a pair that cannot be compared that of `other`.
    #[inline(always)]
    pub(super) fn min(self, other: Self) -> Self {
        self.with(other, |a, b| if a < b { a } else { b })
    }

    /// The larger ones; of a pair that cannot be compared that of `other`.
    #[inline(always)]
    pub(super) fn max(self, other: Self) -> Self {
        self.with(other, |a, b| if a > b { a } else { b })
    }

    #[inline(always)]
    pub(super) fn abs(self) -> Self {
        let [a, b, c, d] = self.0;
        Self([a.abs(), b.abs(), c.abs(), d.abs()])
    }

    #[inline(always)]
    pub(super) fn sum(self) -> f64 {
        let [a, b, c, d] = self.0;
        (a + c) + (b + d)
    }

    #[inline(always)]
    pub(super) fn least(self) -> f64 {
        let [a, b, c, d] = self.0;
        let least = |a: f64, b: f64| if a < b { a } else { b };
        least(least(a, c), least(b, d))
    }

    #[inline(always)]
    pub(super) fn largest(self) -> f64 {
        let [a, b, c, d] = self.0;
        let largest = |a: f64, b: f64| if a > b { a } else { b };
        largest(largest(a, c), largest(b, d))
    }
}

impl Add for Four {
    type Output = Self;

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        self.with(other, |a, b| a + b)
    }
}

impl Sub for Four {
    type Output = Self;

    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        self.with(other, |a, b| a - b)
    }
}

impl Mul<f64> for Four {
    type Output = Self;

    #[inline(always)]
    fn mul(self, factor: f64) -> Self {
        let [a, b, c, d] = self.0;
        Self([a * factor, b * factor, c * factor, d * factor])
    }
}

/// The four corners, component by component.
#[derive(Clone, Copy)]
pub(super) struct Corners {
    pub(super) x: Four,
    pub(super) y: Four,
    pub(super) z: Four,
}

impl Corners {
    #[inline(always)]
    pub(super) fn new(corners: &[Vec3; 4]) -> Self {
        let [a, b, c, d] = corners;
        Self { x: Four([a.x, b.x, c.x, d.x]), y: Four([a.y, b.y, c.y, d.y]), z: Four([a.z, b.z, c.z, d.z]) }
    }

    /// Corner `k`.
    #[inline(always)]
    pub(super) fn corner(&self, k: usize) -> Vec3 {
        Vec3::new(self.x.0[k], self.y.0[k], self.z.0[k])
    }

    /// All of them.
    #[inline(always)]
    pub(super) fn all(&self) -> [Vec3; 4] {
        [self.corner(0), self.corner(1), self.corner(2), self.corner(3)]
    }

    /// Scalar products with `direction`.
    #[inline(always)]
    pub(super) fn along(&self, direction: &Vec3) -> Four {
        self.x * direction.x + self.y * direction.y + self.z * direction.z
    }

    #[inline(always)]
    pub(super) fn map(self, of: impl Fn(Four) -> Four) -> Self {
        Self { x: of(self.x), y: of(self.y), z: of(self.z) }
    }

    /// These at time 0 and `end` at time 1, in between.
    #[inline(always)]
    pub(super) fn between(self, end: Self, time: f64) -> Self {
        let mix = |a: Four, b: Four| a * (1.0 - time) + b * time;
        Self { x: mix(self.x, end.x), y: mix(self.y, end.y), z: mix(self.z, end.z) }
    }

    /// Absolute values of the largest components of each.
    #[inline(always)]
    pub(super) fn sizes(self) -> Four {
        self.x.abs().max(self.y.abs()).max(self.z.abs())
    }
}
