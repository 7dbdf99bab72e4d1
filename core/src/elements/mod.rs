//! Elements of cloth as its parts evaluate them: one across a border is evaluated by every part that has a corner of it, from the
//! same numbers in the same order.

pub(crate) mod corners;
pub(crate) mod part_triangles;
