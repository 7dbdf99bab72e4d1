//! Running where machines are taken away: one run a folder, requests to stop, what changed between two attempts.
//!
//! ```text
//! OUT/lock.json          who runs here                              lock.rs, with process.rs
//! OUT/control/stop       "write a checkpoint and leave"             stop.rs
//! OUT/control/checkpoint "write a checkpoint and go on"
//! OUT/logs/001.log       log of the first attempt, and 001.jsonl    attempts.rs
//! OUT/stale/attempt_002  what an attempt did not go on from         stale.rs
//! OUT/manifest.json      why a process ended at once                last_words.rs
//! ```
//!
//! Data that a resumed run is compared with: computed in `digest`, and kept in the manifest and in checkpoints.

pub(crate) mod attempts;
pub mod command_line;
pub mod digest;
pub mod last_words;
pub mod lock;
pub mod process;
pub mod stale;
pub mod stop;
