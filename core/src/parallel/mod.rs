//! Logical parts and ranks. The parts are a fixed split of all vertices, made from the scene alone: every order that can
//! reach a result is written in terms of parts and vertex numbers, never in terms of threads or ranks, so that their number
//! changes no bit. A rank holds a run of parts, and copies of what lies next to it.

pub mod communicator;
pub mod for_each_part;
pub mod ghosted_index;
pub mod halo;
pub mod local_ranks;
pub(crate) mod message;
pub mod parts;
pub(crate) mod problems;
pub mod ranks;
pub mod reduce;
pub mod serial;
pub mod simd4;
