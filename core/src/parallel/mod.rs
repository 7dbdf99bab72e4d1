//! Logical parts: a fixed split of all vertices, made from the scene alone. Every order that can reach a result is
//! written in terms of parts, never in terms of threads, so that their number changes no bit.

pub mod communicator;
pub mod lanes;
pub mod local_ranks;
pub mod parts;
pub mod serial;
pub mod split;
pub mod sum;
