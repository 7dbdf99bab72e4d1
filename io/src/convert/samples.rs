//! Choice of the samples of a cache that go into the new one.

use std::path::Path;

use crate::cache_frames::{Between, CacheFrames, CacheMesh};
use crate::error::IoError;
use crate::formats;

/// Samples that lie closer to each other behind their frames lie alike [frames].
const ALIKE: f64 = 1e-6;

/// Samples that are written.
#[derive(Debug, PartialEq)]
pub(super) struct Chosen {
    /// Number of the sample in the old cache, its frame, and which one behind that, in the order of their times.
    pub(super) all: Vec<(usize, i64, usize)>,
    /// Times of the samples behind each frame, as fractions of a frame.
    pub(super) sub_frames: Vec<f64>,
}

/// The samples of the frames that are asked for, and what is left out of those between them.
pub(super) fn chosen(
    source: &CacheFrames,
    mesh: usize,
    asked: Option<[i64; 2]>,
    to: &Path,
) -> Result<(Chosen, Vec<String>), IoError> {
    let described = &source.meshes[mesh];
    if described.frames.is_empty() && !described.between.is_empty() {
        return Err(no_frames(source, described));
    }
    let range = range(source, described, asked)?;
    let frames = &described.frames[range.clone()];
    let whole = || range.clone().zip(frames).map(|(sample, frame)| (sample, *frame, 0)).collect();
    let (first, last) = (frames[0], frames[frames.len() - 1]);
    // A cache ends with its last frame: what comes behind that belongs to no interval.
    let numbered = described.between.iter().enumerate().filter(|(_, at)| (first..last).contains(&at.frame));
    let between: Vec<(usize, Between)> = numbered.map(|(index, at)| (described.frames.len() + index, *at)).collect();
    let sub_frames: Vec<f64> = between.iter().filter(|(_, at)| at.frame == first).map(|(_, at)| at.behind).collect();
    let outside = if asked.is_none() { described.between.len() - between.len() } else { 0 };
    let note = |number: usize, which: &str, why: &str| {
        (number > 0).then(|| format!("{}: {number} samples {which} are left out: {why}", described.name))
    };
    let around = note(outside, "before the first frame or after the last", "a cache begins and ends with a frame");
    let left_out = |why: &str| {
        let all = around.iter().cloned().chain(note(between.len(), "between frames", why)).collect();
        (Chosen { all: whole(), sub_frames: Vec::new() }, all)
    };
    if between.is_empty() {
        return Ok(left_out(""));
    }
    if formats::holds_whole_frames(to) {
        return Ok(left_out("the format holds whole frames"));
    }
    let of_frame = |frame: i64| between.iter().filter(move |(_, at)| at.frame == frame);
    let is_alike = |frame: &i64| {
        of_frame(*frame).count() == sub_frames.len()
            && of_frame(*frame).zip(&sub_frames).all(|((_, at), behind)| (at.behind - behind).abs() < ALIKE)
    };
    if !frames[..frames.len() - 1].iter().all(is_alike) {
        return Ok(left_out("they are not at the same times after every frame"));
    }
    let mut all: Vec<(usize, i64, usize)> = whole();
    all.extend(
        between.iter().enumerate().map(|(place, (sample, at))| (*sample, at.frame, place % sub_frames.len() + 1)),
    );
    all.sort_by_key(|(_, frame, sub_frame)| (*frame, *sub_frame));
    Ok((Chosen { all, sub_frames }, around.into_iter().collect()))
}

/// Says that times are those of no frame.
fn no_frames(source: &CacheFrames, mesh: &CacheMesh) -> IoError {
    let fps = source.fps.unwrap_or_default();
    let what = format!("none of its {} samples is at a whole frame at {fps} frames per second", mesh.between.len());
    let advice = "export it with samples at whole frames; if the file does not state its frame rate, check --fps";
    IoError::data(&source.path, mesh.name.clone(), what, advice)
}

/// Without samples between frames: one of what does not move.
pub(super) fn still(source: &CacheFrames, mesh: usize) -> Chosen {
    Chosen { all: vec![(0, source.meshes[mesh].frames[0], 0)], sub_frames: Vec::new() }
}

/// The frames that are asked for.
fn range(source: &CacheFrames, mesh: &CacheMesh, asked: Option<[i64; 2]>) -> Result<std::ops::Range<usize>, IoError> {
    let frames = &mesh.frames;
    let held = match (frames.first(), frames.last()) {
        (Some(first), Some(last)) => format!("it holds {first}-{last}"),
        _ => return Err(IoError::data(&source.path, "frames", "it holds no frame", "give a cache with frames")),
    };
    let missing = |frame: i64| {
        let what = format!("frame {frame} is missing");
        IoError::data(&source.path, "frames", what, format!("{held}; choose with --frames A-B"))
    };
    let place = |frame: i64| frames.binary_search(&frame).map_err(|_| missing(frame));
    let range = match asked {
        None => 0..frames.len(),
        Some([first, last]) => place(first)?..place(last)? + 1,
    };
    match frames[range.clone()].windows(2).find(|pair| pair[1] != pair[0] + 1) {
        Some(pair) => Err(missing(pair[0] + 1)),
        None => Ok(range),
    }
}
