//! Ranks, messages and logical parts: the same scene gives the same bits on any number of threads and ranks. No order comes from
//! a thread, a rank, a clock or a hash map.
//!
//! * [`parts`]: each garment's vertices are split by recursive bisection of the rest positions (ties by vertex number), which
//!   depends on the scene alone, and all vertices of the scene are numbered in that order. A *rank* owns a run of parts; its
//!   arrays hold ghosts below, own vertices, ghosts above ([`ghosted_index`]), so that local numbers ascend as those of the
//!   scene do. [`halo`] keeps ghosts as their owners have them. One rank alone has no ghosts and sends nothing.
//! * [`for_each_part`] hands each part its own slice of every array, in parallel. Nobody writes into another part: a spring
//!   across a border is evaluated by both, each changing its own end.
//! * [`reduce`] adds in blocks inside a part and joins the sums of blocks by a fixed tree; ranks exchange the subtrees that
//!   are theirs alone.
//!
//! A rank is a process (`core/mpi`) or, in tests, a thread ([`local_ranks`]); one alone is [`serial`]. They speak through a
//! [`communicator`], which [`ranks`] wraps, counts and times; `message` says of which two kinds messages are,
//! rows and encoded values. All ranks call the same operations in the same order, never inside a parallel loop: each has its own
//! pool of threads, and a frame runs inside it.

pub mod communicator;
pub mod for_each_part;
pub(crate) mod ghosted_index;
pub(crate) mod halo;
pub mod local_ranks;
pub mod message;
pub mod parts;
pub(crate) mod problems;
pub mod ranks;
pub(crate) mod reduce;
pub mod serial;
pub mod simd4;

/// Vertices that one task of a plain vector update works on.
pub(crate) const CHUNK: usize = 4096;
