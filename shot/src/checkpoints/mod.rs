//! The checkpoints of a run: when one is written, which are kept, and which is gone on from. What stands in one file is
//! `drapery_io::checkpoint`.
//!
//! * `store` keeps those of a run: written aside and renamed, the last few kept, the newest good one found.
//! * `cadence` decides when to write one.

mod cadence;
pub(crate) mod store;

pub(crate) use cadence::Cadence;
pub(crate) use store::{Account, Loaded, Saved, Store};
