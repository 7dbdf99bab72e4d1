//! Logical parts and ranks. The parts are a fixed split of all vertices, made from the scene alone: every order that can
//! reach a result is written in terms of parts and vertex numbers, never in terms of threads or ranks, so that their number
//! changes no bit. A rank holds a run of parts, and copies of what lies next to it.

pub mod bisection;
pub mod communicator;
pub mod halo;
pub mod lanes;
pub mod local_ranks;
pub mod local_vertices;
pub mod parts;
pub mod ranks;
pub mod serial;
pub mod split;
pub mod spread;
pub mod sum;
pub(crate) mod wire;
