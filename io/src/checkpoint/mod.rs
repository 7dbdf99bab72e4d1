//! Checkpoints: the exact state of a run in a file, from which it goes on as if it had never stopped.
//!
//! A checkpoint holds a [snapshot](drapery_core::snapshot) of the solver and a [`Head`] that says of which
//! shot, when, and with which inputs. Equal states give files with equal bytes: whatever depends on the machine or the
//! day stands in a small file beside it ([`Account`]). The layout is described in `docs/reference/checkpoint.md`, the
//! reasons for it in `docs/decisions/0008-checkpoint-files.md`.
//!
//! * `file` writes and reads one file; what was damaged is refused before it is interpreted.
//! * `store` keeps those of a run: written aside and renamed, the last few kept, the newest good one found.
//! * `cadence` decides when to write one.

pub mod cadence;
pub mod every;
pub mod file;
pub mod store;

mod bytes;
mod seal;

pub use cadence::Cadence;
pub use every::Every;
pub use file::{Checkpoint, CheckpointReader, CheckpointWriter, Head};
pub use seal::FORMAT_VERSION;
pub use store::{Account, Entry, Loaded, Saved, Search, Store};
