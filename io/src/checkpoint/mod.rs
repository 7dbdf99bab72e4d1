//! A checkpoint: the exact state of a run in a file, from which it goes on as if it had never stopped.
//!
//! A checkpoint holds a [snapshot](drapery_core::snapshot) of the solver and a [`Head`] that says of which
//! shot, when, and with which inputs. Equal states give files with equal bytes: whatever depends on the machine or the
//! day stands in a small file beside it. The layout is described in `docs/reference/checkpoint.md`, the
//! reasons for it in `docs/dev/decisions/0008-checkpoint-files.md`.
//!
//! * `file` writes and reads one file; what was damaged is refused before it is interpreted.
//! * `every` is how often somebody wants one.

mod every;
mod file;

mod bytes;
mod seal;

pub use every::Every;
pub use file::{Checkpoint, CheckpointReader, CheckpointWriter, Head};
pub use seal::{FORMAT_VERSION, damaged};
