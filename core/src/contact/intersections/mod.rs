//! Unwanted intersections: found with exact arithmetic, left alone by contact, and pushed apart.

pub(crate) mod exact;
pub(crate) mod tangle;
pub(crate) mod untangle;
