//! Whether caches still hold what a run has written: every frame, and every sample between frames, is compared with the digests in the run's record.
//!
//! Frames are decoded by the readers of their format, so it does not matter whether a cache was continued in place, in a copy,
//! or was copied elsewhere. Positions, velocities, normals, the number of crossings and bounds are compared to the last bit.

use std::path::{Path, PathBuf};

use drapery_io::cache_frames::{CacheFrames, StoredFrame};
use drapery_io::error::IoError;
use drapery_io::formats;
use drapery_io::normals;

use crate::frame_digest::GarmentDigests;
use crate::quality::CROSSINGS_WRITTEN;
use crate::run_record::reader::{FrameRow, Record, gaps};

/// A cache of a run.
#[derive(Debug, Clone, Copy)]
pub struct RecordedCache<'a> {
    /// The file.
    pub path: &'a Path,
    /// Position of the tables of the commit that is looked at; the last commit when `None`. Alembic only.
    pub root: Option<u64>,
    /// The garment that it holds, as the record calls it.
    pub garment: &'a str,
}

/// A frame of a cache that is not what was written.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{}: frame {frame}: {what}", path.display())]
pub struct FrameFault {
    /// The cache.
    pub path: PathBuf,
    /// The frame.
    pub frame: i64,
    /// Description of the fault.
    pub what: String,
}

/// Result of a comparison.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Compared {
    /// Frames that are what was written.
    pub sound: usize,
    /// Frames of which the record holds no digests, as ranges.
    pub unrecorded: Vec<[i64; 2]>,
    /// Frames that are not what was written, in ascending order.
    pub faults: Vec<FrameFault>,
}

impl RecordedCache<'_> {
    /// Compares the frames from `first` to `last`; ends after the first fault where `only_first` says so.
    ///
    /// # Errors
    /// The file is missing, cannot be read as a whole, or what is the same in all frames is not what was written.
    pub fn compare(&self, record: &Record, [first, last]: [i64; 2], only_first: bool) -> Result<Compared, IoError> {
        let cache = CacheFrames::open_at(self.path, self.root)?;
        cache.samples.check_constants()?;
        let (mut compared, mut recorded) = (Compared::default(), Vec::new());
        for row in record.frames.iter().filter(|row| (first..=last).contains(&row.frame)) {
            let Some(digests) = row.digests.get(self.garment) else { continue };
            recorded.push(row.frame);
            let found = fault(&cache, row, digests).or_else(|| self.fault_behind(&cache, row, row.frame == last));
            match found {
                None => compared.sound += 1,
                Some(what) => {
                    compared.faults.push(FrameFault { path: self.path.to_owned(), frame: row.frame, what });
                    if only_first {
                        break;
                    }
                }
            }
        }
        let looked_at = compared.faults.last().filter(|_| only_first).map_or(last, |fault| fault.frame);
        compared.unrecorded = gaps(first, looked_at, recorded.into_iter());
        Ok(compared)
    }

    /// Finds a fault of the samples between a frame and the next. Behind the last frame fewer may be there than were
    /// recorded: the samples of a frame that is being computed.
    fn fault_behind(&self, cache: &CacheFrames, row: &FrameRow, is_last: bool) -> Option<String> {
        let mesh = &cache.meshes[0];
        let behind = || mesh.between.iter().enumerate().filter(|(_, at)| at.frame == row.frame);
        let recorded = row.samples.iter().filter_map(|(number, all)| Some((*number, all.get(self.garment)?)));
        for (number, digests) in recorded.filter(|_| !formats::holds_whole_frames(self.path)) {
            let place = usize::try_from(number).ok().and_then(|number| behind().nth(number.checked_sub(1)?));
            let what = match place {
                None if is_last => None,
                None => Some("it is missing".to_owned()),
                Some((index, _)) => fault_of(cache, mesh.frames.len() + index, digests, None),
            };
            if let Some(what) = what {
                return Some(format!("sample {number} after it: {what}"));
            }
        }
        None
    }
}

/// Finds a fault of a frame.
fn fault(cache: &CacheFrames, row: &FrameRow, digests: &GarmentDigests) -> Option<String> {
    let Ok(sample) = cache.meshes[0].frames.binary_search(&row.frame) else {
        return Some("it is missing".to_owned());
    };
    fault_of(cache, sample, digests, row.counts.get(CROSSINGS_WRITTEN).copied())
}

/// Finds a fault of a sample; `counted` is its number of crossings, if that is known.
fn fault_of(cache: &CacheFrames, sample: usize, digests: &GarmentDigests, counted: Option<u64>) -> Option<String> {
    let Ok(stored) = cache.samples.frame(0, sample) else {
        return Some("it cannot be read".to_owned());
    };
    let StoredFrame { positions, velocities, normals, crossings, has_bounds_of_points, .. } = stored;
    let (faces, split) = (&cache.meshes[0].faces, cache.meshes[0].split_normals.as_ref());
    let of_points = || normals::of_faces((&faces.face_counts, &faces.face_indices), split, &positions);
    let found = GarmentDigests::of(&positions, &velocities.unwrap_or_default());
    let differs = |what: &str, from: &str| Some(format!("the {what} do not match the {from}"));
    match () {
        () if found.positions != digests.positions => differs("positions", "record"),
        // A run may have gone on without velocities; they are then in none of the frames.
        () if found.velocities.is_some() && found.velocities != digests.velocities => differs("velocities", "record"),
        () if normals.is_some_and(|normals| normals != of_points()) => differs("normals", "points"),
        () if crossings.is_some_and(|stored| counted.is_some_and(|counted| u64::from(stored) != counted)) => {
            Some("the number of intersections does not match the record".to_owned())
        }
        () if !has_bounds_of_points => differs("bounds", "points"),
        () => None,
    }
}
