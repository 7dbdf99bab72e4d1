//! Parts that caches of all formats share when they are continued: checks of the mark, and names beside the final
//! one.

use std::path::Path;

use crate::atomic_file;
use crate::cache::{CacheMark, CachePlan};
use crate::error::IoError;

/// Remedy for a cache that does not match its mark.
const GO_BACK: &str = "run again from an earlier checkpoint with --resume FRAME, or from the start with --overwrite";

/// Remedy for a cache that is gone, with its frames in no other format: no checkpoint brings them back.
const LOST: &str = "put the file back from a copy, or simulate all frames again with --overwrite; a cache in a second format, as \
                    in output.format = [\"abc\", \"h5\"], would be enough to write this one again";

/// The error of a cache that is gone.
pub(super) fn lost(path: &Path, place: impl Into<String>) -> IoError {
    IoError::data(path, place, "the cache is missing", LOST)
}

/// The error of a cache that cannot be continued from its mark.
pub(super) fn cannot_continue(path: &Path, place: impl Into<String>, what: impl Into<String>) -> IoError {
    IoError::data(path, place, what, GO_BACK)
}

/// The error of a plan that ends before the last frame of the file.
pub(super) fn too_short(path: &Path, plan: &CachePlan<'_>, held: i64) -> IoError {
    let what = format!("it holds frame {held}, but the run ends at frame {}", plan.last_frame);
    IoError::data(
        path,
        "range",
        what,
        format!("let the run end with frame {held} or later, or write to another folder"),
    )
}

/// Returns the number of frames that a cache has up to its mark.
///
/// # Errors
/// The mark is that of another file, or its frame is outside the plan.
pub(super) fn marked_frames(path: &Path, plan: &CachePlan<'_>, mark: &CacheMark) -> Result<usize, IoError> {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    if name != mark.file.as_str() {
        return Err(cannot_continue(path, "mark", format!("the checkpoint refers to the cache {}", mark.file)));
    }
    match mark.last_frame {
        None => Ok(0),
        Some(last) if last > plan.last_frame => Err(too_short(path, plan, last)),
        Some(last) if last < plan.first_frame => {
            let what = format!("the checkpoint refers to frame {last}, but the run begins at {}", plan.first_frame);
            Err(cannot_continue(path, "mark", what))
        }
        // Within the plan, whose frames are counted by usize.
        Some(last) => Ok((last - plan.first_frame) as usize + 1),
    }
}

/// Removes a file in whose place another one is created, if it is there.
pub(super) fn remove(path: &Path) -> Result<(), IoError> {
    atomic_file::remove(path).map_err(|e| IoError::creating(path, e))?;
    Ok(())
}

/// Brings the name of a file to the disk.
pub(super) fn sync_name(path: &Path) {
    atomic_file::sync_folder(path.parent().unwrap_or(Path::new("")));
}

/// A digest as text.
pub(super) fn hexadecimal(digest: [u8; 16]) -> String {
    format!("{:032x}", u128::from_be_bytes(digest))
}

/// The digest that [`hexadecimal`] wrote.
pub(super) fn digest_of(text: &str) -> Option<[u8; 16]> {
    u128::from_str_radix(text, 16).ok().map(u128::to_be_bytes)
}
