//! Caches as one file that stands for itself: all meshes of a cache with all their frames, or all caches of a shot.

use std::fs::{self, File};
use std::path::Path;

use drapery_core::mesh::MeshStream;

use super::samples::{self, Chosen};
use super::{Conversion, Converted, SplitFaces, Work, aside, chosen, described, doubts, opened, plan, rate};
use crate::atomic_file::put;
use crate::cache::CachePlan;
use crate::cache_frames::CacheFrames;
use crate::error::IoError;
use crate::formats::{ShotFiles, SingleFormat, SinglePlan, of_file};
use crate::garment_mesh::GarmentMesh;

/// Bytes of a vector in single precision.
const VECTOR: u64 = 12;

/// Bytes of a number in single precision.
const NUMBER: u64 = 4;

/// Bytes that these numbers of vectors and of single values take in one file.
pub fn bytes_of(vectors: u64, numbers: u64) -> u64 {
    vectors.saturating_mul(VECTOR).saturating_add(numbers.saturating_mul(NUMBER))
}

/// A mesh that goes into the file.
struct Part<'a> {
    source: &'a CacheFrames,
    mesh: usize,
    garment: &'a str,
    samples: Chosen,
    split: Option<SplitFaces>,
    kept: GarmentMesh,
}

/// Writes all meshes of the cache, or the one that is chosen.
pub(super) fn convert(
    conversion: &Conversion,
    single: &SingleFormat,
    wrote: &mut dyn FnMut(i64),
) -> Result<Converted, IoError> {
    let source = &opened(conversion)?;
    rate(source, conversion.fps)?;
    let meshes = match &conversion.object {
        Some(object) => vec![chosen(source, Some(object))?],
        None => (0..source.meshes.len()).collect(),
    };
    let garment = &*conversion.to.file_stem().unwrap_or_default().to_string_lossy();
    let (mut parts, mut left_out) = (Vec::new(), Vec::new());
    for mesh in meshes {
        let (samples, lacking) = shown(source, mesh, conversion)?;
        left_out.extend(lacking);
        left_out.extend(source.meshes[mesh].left_out.iter().cloned());
        let data = described(source, mesh, (samples.all[0].0, conversion.triangles))?;
        let (split, kept) = (SplitFaces::of(&data), GarmentMesh::kept(data));
        parts.push(Part { source, mesh, garment, samples, split, kept });
    }
    if conversion.object.is_none() {
        left_out.extend(source.hidden.iter().cloned());
    }
    let works = works(conversion, single, &parts)?;
    let doubts = doubts(conversion, source, parts.iter().map(|part| (part.mesh, &part.samples)))?;
    let (frames, units) = (frames_of(&works), works[0].0.plan.units);
    write(single, (&conversion.to, frames, None), &works, wrote)?;
    let points = parts.iter().map(|part| source.meshes[part.mesh].points).sum();
    Ok(Converted { frames, points, units, left_out, doubts })
}

/// Writes all caches of a shot, which lie beside `to`, as one file, or replaces it as a whole: objects, attributes and values are
/// those of the shot's stage.
///
/// # Errors
/// A cache cannot be read; there is too much for one file; the disk refuses. A file that was there before then stays.
pub fn write_shot(to: &Path, shot: &ShotFiles<'_>) -> Result<(), IoError> {
    let Some(single) = of_file(to).and_then(|format| format.single.as_ref()) else { return Ok(()) };
    let conversion = Conversion { to: to.to_owned(), frames: Some(shot.frames), ..Conversion::default() };
    let sources = shot.caches.iter().map(|cache| CacheFrames::open(&to.with_file_name(&cache.file)));
    let sources = sources.collect::<Result<Vec<_>, _>>()?;
    let mut parts = Vec::new();
    for (source, cache) in sources.iter().zip(&shot.caches) {
        let (samples, _) = samples::chosen(source, 0, Some(shot.frames), to)?;
        let data = described(source, 0, (samples.all[0].0, false))?;
        let (split, kept) = (SplitFaces::of(&data), GarmentMesh::kept(data));
        parts.push(Part { source, mesh: 0, garment: cache.name, samples, split, kept });
    }
    let works = works(&conversion, single, &parts)?;
    write(single, (to, shot.frames, Some(shot)), &works, &mut |_| {})
}

/// The samples of a mesh that are written: all that are asked for, and one of what does not move.
fn shown(source: &CacheFrames, mesh: usize, conversion: &Conversion) -> Result<(Chosen, Vec<String>), IoError> {
    let about = &source.meshes[mesh];
    if about.is_still && !about.frames.is_empty() {
        return Ok((samples::still(source, mesh), Vec::new()));
    }
    samples::chosen(source, mesh, conversion.frames, &conversion.to)
}

/// Conversion of each mesh, with its samples.
///
/// # Errors
/// A mesh lacks what its first frame has; there is more than may be held in memory as a whole.
fn works<'a>(
    conversion: &Conversion,
    single: &SingleFormat,
    parts: &'a [Part<'a>],
) -> Result<Vec<(Work<'a>, &'a Chosen)>, IoError> {
    let work = |part: &'a Part<'a>| {
        let Part { source, mesh, garment, samples, split, kept } = part;
        let plan = plan(conversion, (source, *mesh), samples, (garment, kept))?;
        Ok((Work { source, mesh: *mesh, split: split.as_ref(), plan }, samples))
    };
    let works = parts.iter().map(work).collect::<Result<Vec<_>, IoError>>()?;
    let bytes_of = |(work, samples): &(Work<'_>, &Chosen)| {
        let CachePlan { velocities, normals, mesh, attributes, .. } = &work.plan;
        let (vectors, numbers) = (1 + u64::from(*velocities) + u64::from(*normals), attributes.moving().count() as u64);
        let values = (mesh.point_count() as u64).saturating_mul(samples.all.len() as u64);
        bytes_of(values.saturating_mul(vectors), values.saturating_mul(numbers))
    };
    let bytes = works.iter().map(bytes_of).fold(0_u64, u64::saturating_add);
    if bytes <= single.most_bytes {
        return Ok(works);
    }
    let (megabytes, most) = (bytes / 1_000_000, single.most_bytes / 1_000_000);
    let what = format!("positions, velocities and attributes take {megabytes} MB, and one layer has at most {most} MB");
    let advice = "choose fewer frames with --frames A-B or one mesh with --object, or write a .usd file: each of its frames is a \
                  layer of its own";
    Err(IoError::data(&conversion.to, "size", what, advice))
}

/// First and last frame of what moves, or of all.
fn frames_of(works: &[(Work<'_>, &Chosen)]) -> [i64; 2] {
    let moves = works.iter().any(|(_, samples)| samples.all.len() > 1);
    let plans = works.iter().filter(|(_, samples)| !moves || samples.all.len() > 1).map(|(work, _)| &work.plan);
    let (first, last) = (plans.clone().map(|plan| plan.first_frame).min(), plans.map(|plan| plan.last_frame).max());
    [first.unwrap_or_default(), last.unwrap_or_default()]
}

/// Writes all meshes with all their samples under another name, and gives the file its own when it is whole.
fn write(
    single: &SingleFormat,
    (to, frames, shot): (&Path, [i64; 2], Option<&ShotFiles<'_>>),
    works: &[(Work<'_>, &Chosen)],
    wrote: &mut dyn FnMut(i64),
) -> Result<(), IoError> {
    let caches = works.iter().map(|(work, _)| work.plan.clone()).collect();
    let mut writer = (single.create)(SinglePlan { path: to, frames, caches, shot });
    for (mesh, (work, samples)) in works.iter().enumerate() {
        work.frames(samples, &mut |frame| {
            writer.write(mesh, frame)?;
            // A frame is there when all meshes have it.
            if mesh + 1 == works.len() && frame.sub_frame == 0 {
                wrote(frame.frame);
            }
            Ok(())
        })?;
    }
    let aside = aside(to);
    let written = File::create(&aside)
        .map_err(|e| IoError::creating(&aside, e))
        .and_then(|mut file| {
            writer.finish(&mut file)?;
            file.sync_all().map_err(|e| IoError::writing(to, e))
        })
        .and_then(|()| put(&aside, to));
    if written.is_err() {
        // Half a file would only confuse; if it cannot be removed either, the first error says why.
        let _ = fs::remove_file(&aside);
    }
    written
}
