//! Elements of cloth as its parts evaluate them: one across a border is evaluated by every part that has a corner of it, from the
//! same numbers in the same order.

pub(crate) mod corners;
pub(crate) mod part_triangles;

use crate::Vec3;

/// Values of vertices at the corners of a triangle.
#[inline]
pub(crate) fn at_corners(corners: &[u32; 3], of: &[Vec3]) -> [Vec3; 3] {
    corners.map(|v| of[v as usize])
}
