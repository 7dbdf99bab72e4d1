//! What contact effects share.

pub mod friction;
