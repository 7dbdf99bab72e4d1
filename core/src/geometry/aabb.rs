//! Axis-aligned boxes with single-precision bounds around double-precision points.

use bytemuck::{Pod, Zeroable};

use crate::Vec3;

/// An axis-aligned box \[m\] with `f32` bounds that contain the `f64` points it was made from.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct Aabb {
    /// Lower corner.
    pub min: [f32; 3],
    /// Upper corner.
    pub max: [f32; 3],
}

/// The empty box.
impl Default for Aabb {
    fn default() -> Self {
        Self::EMPTY
    }
}

/// `f32` not above `x`: one unit in the last place further down than the nearest. Branch-free, hence vectorised.
#[inline]
fn below(x: f64) -> f32 {
    let f = x as f32;
    f - f.abs() * f32::EPSILON - f32::MIN_POSITIVE
}

/// `f32` not below `x`.
#[inline]
fn above(x: f64) -> f32 {
    let f = x as f32;
    f + f.abs() * f32::EPSILON + f32::MIN_POSITIVE
}

// Not `f32::min`, whose treatment of NaN takes three instructions instead of one.
#[inline]
fn lower(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

#[inline]
fn upper(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

impl Aabb {
    /// The box of nothing; the union with it changes nothing.
    pub const EMPTY: Aabb = Aabb { min: [f32::INFINITY; 3], max: [f32::NEG_INFINITY; 3] };

    /// Box of one point.
    #[inline]
    pub fn of_point(p: &Vec3) -> Aabb {
        Aabb { min: [below(p.x), below(p.y), below(p.z)], max: [above(p.x), above(p.y), above(p.z)] }
    }

    /// Box of a segment, or of the path of a point that moves straight from `a` to `b`.
    #[inline]
    pub fn of_segment(a: &Vec3, b: &Vec3) -> Aabb {
        Aabb::of_point(a).union(&Aabb::of_point(b))
    }

    /// Box around a point that moves straight from `a` to `b`, less the way `shift` \[m\] that it has in common with others, with every
    /// side moved out by `reach` \[m\].
    pub(crate) fn around_path([a, b]: [&Vec3; 2], shift: &Vec3, reach: f64) -> Aabb {
        Aabb::of_segment(a, &(b - shift)).enlarged(reach)
    }

    /// Smallest box that contains both.
    #[inline]
    pub fn union(&self, other: &Aabb) -> Aabb {
        let mut joined = *self;
        for k in 0..3 {
            joined.min[k] = lower(self.min[k], other.min[k]);
            joined.max[k] = upper(self.max[k], other.max[k]);
        }
        joined
    }

    /// The box with every side moved out by `margin` \[m\].
    #[inline]
    pub(crate) fn enlarged(&self, margin: f64) -> Aabb {
        Aabb {
            min: self.min.map(|x| below(f64::from(x) - margin)),
            max: self.max.map(|x| above(f64::from(x) + margin)),
        }
    }

    /// Whether the boxes share a point; touching counts.
    #[inline]
    pub(crate) fn overlaps(&self, other: &Aabb) -> bool {
        (self.min[0] <= other.max[0])
            & (self.min[1] <= other.max[1])
            & (self.min[2] <= other.max[2])
            & (other.min[0] <= self.max[0])
            & (other.min[1] <= self.max[1])
            & (other.min[2] <= self.max[2])
    }

    /// Squared distance from the box `point` to this one \[m²\], up to a relative `tolerances::BOX_DISTANCE`.
    #[inline]
    pub(crate) fn distance_squared(&self, point: &Aabb) -> f32 {
        let mut sum = 0.0;
        for k in 0..3 {
            let d = upper(upper(self.min[k] - point.max[k], point.min[k] - self.max[k]), 0.0);
            sum += d * d;
        }
        sum
    }

    /// Half the surface, 0 for the empty box.
    pub(crate) fn half_area(&self) -> f64 {
        let d = [0, 1, 2].map(|k| f64::from((self.max[k] - self.min[k]).max(0.0)));
        d[0] * d[1] + d[1] * d[2] + d[2] * d[0]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::random::SplitMix64;

    #[test]
    fn a_box_contains_the_double_precision_points_it_was_made_from() {
        let mut random = SplitMix64::new(3);
        for k in 0..10_000 {
            let p = random.vector() * 10f64.powi(k % 40 - 20);
            let b = Aabb::of_point(&p);
            for axis in 0..3 {
                assert!(f64::from(b.min[axis]) <= p[axis] && p[axis] <= f64::from(b.max[axis]));
            }
        }
        assert!(Aabb::of_point(&Vec3::zeros()).overlaps(&Aabb::of_point(&Vec3::zeros())));
    }
}
