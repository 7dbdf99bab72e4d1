//! One checkpoint file: how it is written and read.
//!
//! HDF5 with a seal in front. The HDF5 library lays the file out, with room for every array; the arrays themselves are
//! written and read with plain calls, so that a full disk is an ordinary error, and at the speed of the disk. They pass
//! through piece by piece: a checkpoint is never in memory as a whole, unless somebody asks for a [`Checkpoint`].

mod reader;
mod writer;

use std::collections::BTreeMap;
use std::path::Path;

use drapery_core::snapshot::Snapshot;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::bytes::ContentHash;
use crate::error::IoError;

pub use reader::CheckpointReader;
pub use writer::CheckpointWriter;

// The arrays are written as little-endian bytes under the machine's own types.
const _: () = assert!(cfg!(target_endian = "little"), "checkpoints need a little-endian machine");

/// Shot and moment that a checkpoint belongs to. Everything in it follows from the shot, nothing from the machine.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Head {
    /// Version of the layout.
    pub format_version: u32,
    /// Program and version that wrote it.
    pub application: String,
    /// Name of the shot.
    pub shot: String,
    /// Last frame that was reached.
    pub frame: i64,
    /// Collision-free steps since that frame; 0 at the frame itself.
    pub sub_step: u64,
    /// Time of the state [s].
    pub time: f64,
    /// Last frame that the caches hold at this moment; `None` before the first that is delivered.
    pub delivered: Option<i64>,
    /// Frames per second, numerator and denominator.
    pub fps: [u32; 2],
    /// Hashes of the parts of the shot, by name, to tell whether they were changed.
    pub digests: BTreeMap<String, String>,
    /// End of each cache at this moment.
    pub caches: Vec<Value>,
}

impl Head {
    /// The text that is stored.
    fn text(&self) -> String {
        // A struct of texts and numbers always has a JSON form.
        serde_json::to_string(self).unwrap_or_default()
    }
}

/// The exact state of a run, in memory: for comparisons.
#[derive(Debug, Clone, PartialEq)]
pub struct Checkpoint {
    /// Shot and moment that it belongs to.
    pub head: Head,
    /// State of the solver.
    pub snapshot: Snapshot,
}

impl Checkpoint {
    /// SHA-256 of everything in it, in hexadecimal digits; equal for equal states.
    ///
    /// It is the hash of a text with a line for the head and one for each array in order, see
    /// `docs/reference/checkpoint.md`.
    pub fn content_hash(&self) -> String {
        let mut hash = ContentHash::new(&self.head.text());
        self.snapshot.give(&mut hash);
        hash.finish()
    }

    /// Writes it to `path` and brings it to the disk; returns the length of the file [bytes] and the content hash.
    ///
    /// # Errors
    /// As [`CheckpointWriter::finish`].
    ///
    /// # Panics
    /// As the sink of [`CheckpointWriter`].
    pub fn write(&self, path: &Path) -> Result<(u64, String), IoError> {
        let mut writer = CheckpointWriter::create(path, &self.head)?;
        self.snapshot.give(&mut writer);
        writer.finish()
    }

    /// Reads what [`Checkpoint::write`] wrote.
    ///
    /// # Errors
    /// As [`CheckpointReader::open`].
    pub fn read(path: &Path) -> Result<Self, IoError> {
        CheckpointReader::open(path)?.whole()
    }
}

#[cfg(test)]
mod tests;
