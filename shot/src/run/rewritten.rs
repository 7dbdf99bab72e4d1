//! Caches that a run goes on with in another form than it began: a format more, or without velocities. The frames that are
//! there are written anew from a cache that holds them; both store single precision, so nothing is lost. Only where a change that
//! was insisted on has moved their origin, positions are rounded once more.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use drapery_core::Vec3;
use drapery_io::attributes::{FromPositions, StoredValues};
use drapery_io::cache::{CacheFrame, CachePlan, CacheWriter};
use drapery_io::cache_frames::{Between, CacheFrames};
use drapery_io::error::IoError;
use drapery_io::formats::{CreateCache, ResumeCache, holds_whole_frames};

use crate::frame_digest::GarmentDigests;
use crate::quality::CROSSINGS_WRITTEN;
use crate::run_record::RECORD;
use crate::run_record::reader::frame_counts;

/// Samples that lie closer to each other behind a frame are one [frames].
const ALIKE: f64 = 1e-6;

/// A cache in its new form.
pub(super) struct NewForm<'a> {
    /// The file.
    pub(super) path: &'a Path,
    /// Contents that it will have.
    pub(super) plan: CachePlan<'a>,
    /// Functions that create it and go on with it.
    pub(super) open: (CreateCache, ResumeCache),
}

impl NewForm<'_> {
    /// Writes the frames up to `last`, a frame and a number of samples behind it, from the cache `source`, puts the file in its
    /// place and goes on with it; `take` is given each frame with the digests of what was written of it.
    ///
    /// # Errors
    /// The source cannot be read, lacks a frame, a sample between frames or the velocities that are asked for; the disk refuses.
    pub(super) fn write(
        &self,
        source: &Path,
        last: (i64, usize),
        take: &mut dyn FnMut(i64, GarmentDigests),
    ) -> Result<Box<dyn CacheWriter>, IoError> {
        let (create, resume) = self.open;
        let aside = aside(self.path);
        let mut writer = create(&aside, &self.plan)?;
        self.copy_frames(source, last, (writer.as_mut(), take))?;
        writer.finish()?;
        let mut mark = writer.mark();
        drop(writer);
        fs::rename(&aside, self.path).map_err(|e| IoError::writing(self.path, e))?;
        mark.file = self.path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        resume(self.path, &self.plan, &mark)
    }

    /// Finds out whether the cache `source` has the frames up to `last` with all that is asked for; changes nothing.
    ///
    /// # Errors
    /// The errors of [`NewForm::write`], without those of writing. All samples have to be there. Only the first is read.
    pub(super) fn check(&self, source: &Path, last: (i64, usize)) -> Result<(), IoError> {
        let frames = CacheFrames::open(source)?;
        let samples = self.samples_until(last).map(|at| self.sample(&frames, at));
        let numbers: Vec<usize> = samples.collect::<Result<_, _>>().map_err(|what| lacks(source, what))?;
        let Some(first) = numbers.first() else { return Ok(()) };
        self.velocities(&frames, *first)?;
        if self.plan.attributes.strain || self.plan.attributes.contact {
            let held = frames.samples.frame(0, *first)?.values;
            let of_positions = self.plan.attributes.strain && self.plan.mesh.read()?.render_mesh_of.is_none();
            let strain = held.strain.or(of_positions.then(Vec::new));
            self.refuse_missing(source, &StoredValues { strain, ..held })?;
        }
        Ok(())
    }

    /// The samples to write up to `last`: frames, and which one behind each.
    fn samples_until(&self, last: (i64, usize)) -> impl Iterator<Item = (i64, usize)> + use<> {
        // A format of whole frames passes over the samples between them.
        let between = if holds_whole_frames(self.path) { 0 } else { self.plan.sub_frames.len() };
        let samples_of = move |frame: i64| 0..=if frame < last.0 { between } else { between.min(last.1) };
        (self.plan.first_frame..=last.0).flat_map(move |frame| samples_of(frame).map(move |k| (frame, k)))
    }

    /// Velocities of a sample, as they are stored; empty where none are asked for and none are there.
    fn velocities(&self, frames: &CacheFrames, sample: usize) -> Result<Vec<Vec3>, IoError> {
        match frames.velocities(0, sample)? {
            Some(velocities) => Ok(velocities),
            None if self.plan.velocities => Err(lacks(&frames.path, "it holds no velocities".to_owned())),
            None => Ok(Vec::new()),
        }
    }

    /// Refuses attributes that are asked for and not there.
    fn refuse_missing(&self, source: &Path, values: &StoredValues) -> Result<(), IoError> {
        let asked = [(self.plan.attributes.strain, "strain"), (self.plan.attributes.contact, "contact")];
        let is_held = |name: &str| values.named().any(|(held, _)| held == name);
        match asked.into_iter().find(|(is_asked, name)| *is_asked && !is_held(name)) {
            Some((_, name)) => Err(lacks(source, format!("it holds no {name}"))),
            None => Ok(()),
        }
    }

    fn copy_frames(
        &self,
        source: &Path,
        last: (i64, usize),
        (writer, take): (&mut dyn CacheWriter, &mut dyn FnMut(i64, GarmentDigests)),
    ) -> Result<(), IoError> {
        let frames = CacheFrames::open(source)?;
        let folder = source.parent().unwrap_or(Path::new("."));
        let crossings = if self.plan.crossings { crossings_of(folder) } else { BTreeMap::new() };
        let from_positions = self.attributes_of_positions()?;
        for (frame, sub_frame) in self.samples_until(last) {
            let sample = self.sample(&frames, (frame, sub_frame)).map_err(|what| lacks(source, what))?;
            let positions = self.positions(&frames, sample)?;
            let velocities = self.velocities(&frames, sample)?;
            // The record counts whole frames alone.
            let counted = if sub_frame > 0 { frames.samples.frame(0, sample)?.crossings } else { None };
            let counted = counted.or_else(|| crossings.get(&frame).copied());
            let crossings = self.plan.crossings.then(|| counted.unwrap_or(0));
            let velocities = self.plan.units.stored_all(&velocities);
            let (positions, velocities) = (&positions[..], &velocities[..]);
            let normals = from_positions.normals(positions);
            let asked = [self.plan.attributes.strain, self.plan.attributes.contact];
            let stored = match asked {
                [false, false] => StoredValues::default(),
                _ => frames.samples.frame(0, sample)?.values,
            };
            let metres = self.plan.units.length.metres();
            let strain = from_positions.has_strain().then(|| from_positions.strain(positions, metres));
            let values = StoredValues { strain: strain.or(stored.strain), contact: stored.contact };
            self.refuse_missing(source, &values)?;
            let (normals, values) = (&normals[..], values.values());
            writer.write(&CacheFrame { frame, sub_frame, positions, velocities, normals, crossings, values })?;
            let stored = if self.plan.velocities { velocities } else { &[] };
            if sub_frame == 0 {
                take(frame, GarmentDigests::of(positions, stored));
            }
        }
        Ok(())
    }

    /// Normals, and strain from the positions of a garment; a render mesh has the strain of its garment, which only an earlier cache
    /// holds.
    fn attributes_of_positions(&self) -> Result<FromPositions, IoError> {
        let is_asked = self.plan.attributes.strain && self.plan.mesh.read()?.render_mesh_of.is_none();
        FromPositions::new(self.plan.mesh, self.plan.normals, is_asked)
    }

    /// The number in a cache of the sample that lies `sub_frame` samples behind a frame, or what it lacks.
    fn sample(&self, frames: &CacheFrames, (frame, sub_frame): (i64, usize)) -> Result<usize, String> {
        let mesh = &frames.meshes[0];
        let Some(number) = sub_frame.checked_sub(1) else {
            return mesh.frames.binary_search(&frame).map_err(|_| format!("frame {frame} is missing in it"));
        };
        let behind = self.plan.sub_frames[number];
        if holds_whole_frames(&frames.path) {
            let what = "it holds whole frames, and no other cache of this garment has the samples between them";
            return Err(format!("{what}: the first is at frame {}", frame as f64 + behind));
        }
        let is_it = |at: &Between| at.frame == frame && (at.behind - behind).abs() < ALIKE;
        let found = mesh.between.iter().position(is_it).map(|place| mesh.frames.len() + place);
        found.ok_or_else(|| format!("the sample at frame {} is missing in it", frame as f64 + behind))
    }

    /// Positions of a frame as the new form stores them.
    fn positions(&self, frames: &CacheFrames, sample: usize) -> Result<Vec<[f32; 3]>, IoError> {
        let (units, origin) = (self.plan.units, self.plan.file_origin().unwrap_or_default());
        match frames.stored_positions(0, sample)? {
            Some(stored) if (stored.units, stored.origin) == (units, origin) => Ok(stored.points),
            _ => {
                let world = frames.positions(0, sample)?;
                Ok(world.iter().map(|x| units.stored_from(self.plan.origin, *x)).collect())
            }
        }
    }
}

/// The error of a cache that does not have the frames so far as they are asked for.
fn lacks(source: &Path, what: String) -> IoError {
    IoError::data(source, "the frames so far", what, "restore [output], or start over with --overwrite")
}

/// Returns the path at which the new form is written until it is whole; it keeps its extension.
fn aside(path: &Path) -> PathBuf {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let extension = path.extension().unwrap_or_default().to_string_lossy();
    path.with_file_name(format!(".{stem}.rewritten.{extension}"))
}

/// Reads the number of crossings of every frame from the record beside the caches.
fn crossings_of(folder: &Path) -> BTreeMap<i64, u32> {
    let counts = frame_counts(&folder.join(RECORD), CROSSINGS_WRITTEN);
    counts.into_iter().map(|(frame, count)| (frame, u32::try_from(count).unwrap_or(u32::MAX))).collect()
}
