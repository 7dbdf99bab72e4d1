//! Caches of belts: bodies that the program makes, so that nobody else has their mesh to render. Their motion is known, so that all
//! frames are written when the run begins.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use drapery_core::Vec3;
use drapery_io::attributes::PointValues;
use drapery_io::cache::{CacheFrame, CachePlan, CacheWriter};
use drapery_io::error::IoError;
use drapery_io::formats::{self, Format};
use drapery_io::garment_mesh::GarmentMesh;
use drapery_io::input_motion::InputMotion;

use crate::frame_digest::{FrameDigests, GarmentDigests};
use crate::run::folder::file_name;
use crate::run_record::manifest::ManifestBody;
use crate::shot::Shot;

/// Belts by their names.
fn belts(shot: &Shot) -> impl Iterator<Item = (&str, &InputMotion)> {
    let bodies = &shot.simulation().scene().description().bodies;
    let named = bodies.iter().zip(&shot.inputs.bodies);
    named.filter_map(|(body, motion)| Some((body.name.as_str(), motion.as_ref().filter(|motion| motion.is_made)?)))
}

/// Formats of the caches.
fn written(shot: &Shot) -> impl Iterator<Item = &'static Format> {
    let formats = shot.output().formats.iter().filter_map(|word| formats::by_extension(word));
    formats.filter(|format| format.create.is_some())
}

fn path(folder: &Path, name: &str, format: &Format) -> PathBuf {
    folder.join(format!("{name}.{}", format.extension))
}

/// The caches of all belts in a folder.
pub(super) fn files(shot: &Shot, folder: &Path) -> Vec<PathBuf> {
    belts(shot).flat_map(|(name, _)| written(shot).map(move |format| path(folder, name, format))).collect()
}

/// Belts in the manifest.
pub(super) fn listed(shot: &Shot, folder: &Path) -> Vec<ManifestBody> {
    let of_belt = |(name, _): (&str, &InputMotion)| {
        let files = written(shot).map(|format| file_name(&path(folder, name, format)));
        ManifestBody { name: name.to_owned(), files: files.collect() }
    };
    belts(shot).map(of_belt).collect()
}

/// Digests of all samples of the belts: frame, and which sample behind it.
pub(super) type BeltDigests = BTreeMap<(i64, usize), FrameDigests>;

/// Writes the caches of all belts into a folder, in the place of those of an earlier attempt, with all frames. Returns the digests of
/// what was written.
///
/// # Errors
/// The body of a belt cannot be read; the disk refuses.
pub(super) fn write(shot: &Shot, folder: &Path) -> Result<BeltDigests, IoError> {
    let mut digests = BeltDigests::new();
    for (name, motion) in belts(shot) {
        let about = &shot.about;
        let first = motion.source.mesh_at(about.timeline.file_time(about.timeline.origin))?;
        let mesh = GarmentMesh::kept(first);
        let plan = shot.cache_plan(name, &mesh);
        let create = |format: &'static Format| Some(format.create?(&path(folder, name, format), &plan));
        let mut writers = written(shot).filter_map(create).collect::<Result<Vec<_>, _>>()?;
        let pose = |frame: i64| pose(shot, motion, frame);
        let (mut before, mut now) = (pose(about.first_frame)?, pose(about.first_frame)?);
        for frame in about.first_frame..=about.last_frame {
            let is_last = frame == about.last_frame;
            let after = if is_last { now.clone() } else { pose(frame + 1)? };
            // Over both frames around it; at the ends over the one that is there.
            let frames = f64::from(u8::from(frame > about.first_frame) + u8::from(!is_last)).max(1.0);
            let rate = 1.0 / (frames * about.timeline.frame_duration());
            let velocities: Vec<Vec3> = before.iter().zip(&after).map(|(a, b)| (b - a) * rate).collect();
            let mut write = |sample: (i64, usize), points: (&[Vec3], &[Vec3])| -> Result<(), IoError> {
                let written = write_sample(&mut writers, &plan, sample, points)?;
                digests.entry(sample).or_default().insert(name.to_owned(), written);
                Ok(())
            };
            write((frame, 0), (&now, &velocities))?;
            let fractions = if is_last { &[][..] } else { &about.output.sub_frames };
            for (sub_frame, fraction) in (1..).zip(fractions) {
                let between: Vec<Vec3> = now.iter().zip(&after).map(|(a, b)| a + (b - a) * *fraction).collect();
                let rate = 1.0 / about.timeline.frame_duration();
                let velocities: Vec<Vec3> = now.iter().zip(&after).map(|(a, b)| (b - a) * rate).collect();
                write((frame, sub_frame), (&between, &velocities))?;
            }
            (before, now) = (now, after);
        }
        writers.iter_mut().try_for_each(|writer| writer.finish())?;
    }
    Ok(digests)
}

/// Positions at a frame [m].
fn pose(shot: &Shot, motion: &InputMotion, frame: i64) -> Result<Vec<Vec3>, IoError> {
    let mut samples = motion.samples(shot.about.timeline, shot.inputs.preroll, frame)?;
    Ok(samples.pop().map(|sample| sample.positions).unwrap_or_default())
}

/// Writes positions [m] and velocities [m/s] as a sample of all caches; returns the digests of what is stored.
fn write_sample(
    writers: &mut [Box<dyn CacheWriter>],
    plan: &CachePlan<'_>,
    (frame, sub_frame): (i64, usize),
    (positions, velocities): (&[Vec3], &[Vec3]),
) -> Result<GarmentDigests, IoError> {
    let in_file = |vector: Vec3| <[f64; 3]>::from(plan.units.from_si(vector)).map(|c| c as f32);
    let positions: Vec<[f32; 3]> = positions.iter().map(|place| in_file(place - plan.origin)).collect();
    let velocities: Vec<[f32; 3]> = match plan.velocities {
        true => velocities.iter().map(|velocity| in_file(*velocity)).collect(),
        false => Vec::new(),
    };
    let sample = CacheFrame {
        frame,
        sub_frame,
        positions: &positions,
        velocities: &velocities,
        normals: &[],
        crossings: None,
        values: PointValues::default(),
    };
    writers.iter_mut().try_for_each(|writer| writer.write(&sample))?;
    Ok(GarmentDigests::of(&positions, &velocities))
}
