//! The frame loop.
pub mod motion;
