//! Whether the frames that a run would go on behind are still what was written: the record holds their digests.

use std::path::Path;

use drapery_io::cache::CacheMark;
use drapery_io::checkpoint::Head;

use crate::recorded_frames::{FrameFault, RecordedCache};
use crate::run_record::RECORD;
use crate::run_record::reader::{Record, in_words};

/// The earliest frame up to a checkpoint that is not what was written, in any of the caches in `folder` that the checkpoint
/// tells of. `note` hears of frames that cannot be checked.
///
/// A cache that is missing or cannot be read as a whole is not judged here: to go on with it is refused, with the reason.
pub(super) fn earliest_fault(
    folder: &Path,
    (head, first): (&Head, i64),
    record: &Record,
    note: &mut dyn FnMut(String),
) -> Option<FrameFault> {
    let last = head.delivered?;
    let marks = head.caches.iter().filter_map(|mark| serde_json::from_value::<CacheMark>(mark.clone()).ok());
    let (mut earliest, mut unrecorded): (Option<FrameFault>, Vec<[i64; 2]>) = (None, Vec::new());
    for mark in marks {
        // Caches are called after their garments; a name with a folder in it is none of this program.
        let Some(name) = Path::new(&mark.file).file_name() else { continue };
        let garment = Path::new(name).file_stem().unwrap_or_default().to_string_lossy();
        let cache = RecordedCache { path: &folder.join(name), root: mark.root, garment: &garment };
        let until = earliest.as_ref().map_or(last, |fault| fault.frame - 1);
        let Ok(compared) = cache.compare(record, [first, until], true) else { continue };
        earliest = compared.faults.into_iter().next().or(earliest);
        unrecorded = if compared.unrecorded.is_empty() { unrecorded } else { compared.unrecorded };
    }
    if !unrecorded.is_empty() {
        let frames = in_words(&unrecorded);
        note(format!("{frames}: the caches cannot be verified, because {RECORD} has no digests"));
    }
    earliest
}
