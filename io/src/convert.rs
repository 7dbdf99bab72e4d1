//! A cache of one format as one of another, frame by frame: other frames, another unit or axis, the same cloth.
//!
//! Faces, texture coordinates, face sets and other attributes go with it, as far as the two formats know them. Numbers are
//! copied where unit, axis and origin stay; else they are rounded once more. Only one frame is in memory; of a single layer of USD,
//! all are. Samples between frames go with it where they lie alike behind every frame and the new format holds them.

mod samples;
mod single;

use std::fs;
use std::path::{Path, PathBuf};

use drapery_core::Vec3;
use drapery_core::mesh::PolygonMesh;
use drapery_core::scene::Timeline;

use crate::atomic_file::{check_name, put, unfinished};
use crate::attributes::{PREF, REST, StoredValues};
use crate::cache::{CacheFrame, CachePlan};
use crate::cache_frames::CacheFrames;
use crate::cache_frames::rates;
use crate::error::IoError;
use crate::formats::{self, CreateCache, ResumeCache, folder_of, of_file, remove_folder};
use crate::garment_mesh::{GarmentMesh, cut};
use crate::mesh_data::{Connectivity, MeshData};
use crate::normals::{self, SplitNormals};
use crate::units::{LengthUnit, Units, UpAxis, unlikely_size};

use samples::Chosen;
pub use single::{bytes_of, write_shot};

/// Request to convert a cache.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Conversion {
    /// The cache.
    pub from: PathBuf,
    /// The new one, whose extension says its format.
    pub to: PathBuf,
    /// Path of the mesh, where the cache holds several.
    pub object: Option<String>,
    /// First and last frame; all of the cache when left out.
    pub frames: Option<[i64; 2]>,
    /// Unit of the old cache, whatever it says of itself; what it says, or metres, when left out.
    pub from_length: Option<LengthUnit>,
    /// Up axis of the old cache, likewise; Y where it does not say it.
    pub from_up: Option<UpAxis>,
    /// Unit of the new cache; that of the old one when left out.
    pub length: Option<LengthUnit>,
    /// Up axis of the new cache; that of the old one when left out.
    pub up: Option<UpAxis>,
    /// Frame rate as a fraction, where the cache does not state it. One that a cache states stays.
    pub fps: Option<(u32, u32)>,
    /// Whether the new cache has the triangles that were simulated in the place of the faces.
    pub triangles: bool,
    /// Whether a file that is there is replaced.
    pub overwrite: bool,
}

/// Outcome of a conversion.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Converted {
    /// First and last frame.
    pub frames: [i64; 2],
    /// Number of points.
    pub points: usize,
    /// Unit and axis of the new cache.
    pub units: Units,
    /// Content of these meshes that the old cache holds and the new one does not, a sentence each.
    pub left_out: Vec<String>,
    /// Doubts about the units of the old cache, a sentence each.
    pub doubts: Vec<String>,
}

/// Writes the new cache; `wrote` hears of every frame. Until all frames are there, the new file has another name.
///
/// # Errors
/// The cache cannot be read, lacks a frame that is asked for, holds a number that is none or several meshes of which none is chosen,
/// or does not tell its frame rate; the new file is there already, is the old one, or cannot be written.
pub fn convert(conversion: &Conversion, wrote: &mut dyn FnMut(i64)) -> Result<Converted, IoError> {
    let format = of_file(&conversion.to);
    if let Some(single) = format.and_then(|format| format.single.as_ref()) {
        refuse_target(conversion)?;
        return single::convert(conversion, single, wrote);
    }
    let open = format.and_then(|format| Some((format.create?, format.resume)));
    let open = open.ok_or_else(|| not_written(&conversion.to))?;
    refuse_target(conversion)?;
    let source = opened(conversion)?;
    let mesh = chosen(&source, conversion.object.as_deref())?;
    rate(&source, conversion.fps)?;
    let (samples, mut left_out) = samples::chosen(&source, mesh, conversion.frames, &conversion.to)?;
    left_out.extend(source.meshes[mesh].left_out.iter().cloned());
    let garment = conversion.to.file_stem().unwrap_or_default().to_string_lossy();
    let data = described(&source, mesh, (samples.all[0].0, conversion.triangles))?;
    left_out.extend(without_place(&data, &conversion.to));
    let (split, kept) = (SplitFaces::of(&data), GarmentMesh::kept(data));
    let work = Work {
        source: &source,
        mesh,
        split: split.as_ref(),
        plan: plan(conversion, (&source, mesh), &samples, (&garment, &kept))?,
    };
    let doubts = doubts(conversion, &source, [(mesh, &samples)].into_iter())?;
    work.write(&conversion.to, open, &samples, wrote)?;
    let frames = [work.plan.first_frame, work.plan.last_frame];
    Ok(Converted { frames, points: source.meshes[mesh].points, units: work.plan.units, left_out, doubts })
}

/// Finds doubts about the units of a cache, from its own statement of them and from the size that these meshes have
/// in their first sample.
fn doubts<'a>(
    conversion: &Conversion,
    source: &CacheFrames,
    meshes: impl Iterator<Item = (usize, &'a Chosen)>,
) -> Result<Vec<String>, IoError> {
    let units = source.input_units;
    let place = source.path.display();
    let mut found = Vec::new();
    if conversion.from_length.is_none() && !source.states_length {
        let unit = LengthUnit::plural(units.named().unwrap_or_default());
        found.push(format!("{place}: the file states no unit and is read in {unit}; --from-length sets another"));
    }
    let mut bounds = [Vec3::repeat(f64::INFINITY), Vec3::repeat(f64::NEG_INFINITY)];
    for (mesh, samples) in meshes {
        let positions = source.positions(mesh, samples.all[0].0)?;
        bounds = positions.iter().fold(bounds, |[low, high], p| [low.inf(p), high.sup(p)]);
    }
    if let Some(size) = unlikely_size(bounds, units) {
        let remedy = match size.likely {
            Some(unit) => format!("if it is, set --from-length {}", unit.word()),
            None => "--from-length sets the unit in which it is read".to_owned(),
        };
        found.push(format!("{place}: {}; {remedy}", size.looks_like(size.likely)));
    }
    Ok(found)
}

/// Lists the properties of a mesh that the new format has no place for, a sentence each.
fn without_place(data: &MeshData, to: &Path) -> Vec<String> {
    let materials = data.material.is_some() || data.face_sets.iter().any(|set| set.material.is_some());
    let all = [
        (data.double_sided.is_some(), "doubleSided"),
        (materials, "material:binding"),
        (data.purpose.is_some(), "the purpose"),
    ];
    if of_file(to).is_some_and(|format| format.holds_points_alone) {
        let what = "faces, UVs, velocities and attributes are left out: the format holds points alone";
        return vec![format!("{}: {what}", data.object_path)];
    }
    let left = all.iter().filter(|(there, _)| *there && !of_file(to).is_some_and(|format| format.binds_materials));
    left.map(|(_, what)| format!("{}: {what} is left out: the format cannot store it", data.object_path)).collect()
}

/// Plans the cache that the samples of a mesh go into.
fn plan<'a>(
    conversion: &Conversion,
    (source, mesh): (&CacheFrames, usize),
    samples: &'a Chosen,
    (garment, kept): (&'a str, &'a GarmentMesh),
) -> Result<CachePlan<'a>, IoError> {
    source.samples.check_complete(Some(&source.meshes[mesh].name))?;
    let ((start, first, _), (_, last, _)) = (samples.all[0], samples.all[samples.all.len() - 1]);
    let stored = source.stored_positions(mesh, start)?;
    let sample = source.samples.frame(mesh, start)?;
    let (fps_numerator, fps_denominator) = rate(source, conversion.fps)?;
    let units = Units {
        length: conversion.length.unwrap_or(source.units().length),
        up: conversion.up.unwrap_or(source.units().up),
    };
    // Whole metres stay what they are; others are rounded as the positions are.
    let source_origin = stored.map_or(Vec3::zeros(), |stored| stored.units.to_si(Vec3::from(stored.origin)));
    let has_origin = !of_file(&conversion.to).is_some_and(|format| format.holds_points_alone);
    let origin = if has_origin { source_origin } else { Vec3::zeros() };
    let attributes = source.meshes[mesh].attributes.converted((source.units(), source_origin), (units, origin));
    Ok(CachePlan {
        sub_frames: &samples.sub_frames,
        garment,
        mesh: kept,
        units,
        origin,
        timeline: Timeline { fps_numerator, fps_denominator, origin: first, start: first },
        first_frame: first,
        last_frame: last,
        velocities: source.samples.velocities(mesh, start)?.is_some(),
        normals: sample.normals.is_some(),
        crossings: sample.crossings.is_some(),
        attributes,
    })
}

/// Says that caches are not written as files of this name.
fn not_written(to: &Path) -> IoError {
    let extension = to.extension().unwrap_or_default().to_string_lossy();
    let what = match extension.as_ref() {
        "" => "the file name needs an extension, which sets the format".to_owned(),
        _ => format!("caches cannot be written as .{extension} files"),
    };
    let endings = formats::endings(|format| format.create.is_some() || format.single.is_some());
    IoError::Format { path: to.to_owned(), what, advice: format!("give a file that ends with {endings}") }
}

/// Refuses a new file that is the old one, or there already.
fn refuse_target(conversion: &Conversion) -> Result<(), IoError> {
    let to = &conversion.to;
    if fs::canonicalize(to).is_ok_and(|to| fs::canonicalize(&conversion.from).is_ok_and(|from| from == to)) {
        return Err(IoError::Format {
            path: to.clone(),
            what: "the old cache and the new one are the same file".to_owned(),
            advice: "give the new one another name".to_owned(),
        });
    }
    let taken = [Some(to.clone()), folder_of(to)].into_iter().flatten().find(|path| path.symlink_metadata().is_ok());
    if let Some(path) = taken.filter(|_| !conversion.overwrite) {
        return Err(IoError::FileExists { path });
    }
    check_name(to)
}

/// The mesh of this path, or the only one.
fn chosen(source: &CacheFrames, object: Option<&str>) -> Result<usize, IoError> {
    let meshes = &source.meshes;
    let found = meshes.iter().position(|mesh| object.is_none_or(|object| mesh.name == object));
    if let Some(index) = found.filter(|_| object.is_some() || meshes.len() == 1) {
        return Ok(index);
    }
    let names = meshes.iter().map(|mesh| mesh.name.as_str()).collect::<Vec<_>>().join(", ");
    let what = match object {
        Some(object) => format!("it contains no mesh {object}"),
        None => format!("it contains {} meshes, but a Drapery cache holds one", meshes.len()),
    };
    Err(IoError::data(&source.path, "objects", what, format!("choose one with --object: {names}")))
}

/// The cache that is converted. Its frames follow from its times and the given rate, or its own.
fn opened(conversion: &Conversion) -> Result<CacheFrames, IoError> {
    let mut source = match conversion.fps {
        Some((numerator, denominator)) => {
            CacheFrames::open_at_rate(&conversion.from, f64::from(numerator) / f64::from(denominator))?
        }
        None => CacheFrames::open(&conversion.from)?,
    };
    source.read_in(conversion.from_length, conversion.from_up);
    Ok(source)
}

/// The frame rate as a fraction.
fn rate(source: &CacheFrames, said: Option<(u32, u32)>) -> Result<(u32, u32), IoError> {
    let refused = |what: String| {
        IoError::data(&source.path, "frame rate", what, "set it with --fps, for example --fps 24 or --fps 24000/1001")
    };
    if let Some(said) = said {
        return Ok(said);
    }
    let fps = source.fps.ok_or_else(|| refused("the file does not state it".to_owned()))?;
    rates::fraction(fps).ok_or_else(|| refused(format!("{fps} is not a standard frame rate")))
}

/// The mesh with everything that is handed through; points are those of a sample [m]. Its faces, or the triangles that were
/// simulated.
fn described(source: &CacheFrames, mesh: usize, (sample, triangles): (usize, bool)) -> Result<MeshData, IoError> {
    let cache = &source.meshes[mesh];
    let mut data = source.attributes(mesh)?;
    // What this program wrote is written anew, in the unit and under the name that it has in the new file.
    data.params.retain(|param| ![PREF, REST].iter().any(|rest| cache.attributes.has(&param.name, rest)));
    data.mesh.points = source.positions(mesh, sample)?;
    data.split_normals = cache.split_normals.clone();
    // As they were simulated: from the shape at rest, which is not in the cache.
    data.triangles = (data.mesh.face_indices == cache.faces.face_indices).then(|| cache.triangles.clone());
    Ok(if triangles { cut(data) } else { data })
}

/// Faces of the new cache where hard edges split its normals.
struct SplitFaces {
    faces: Connectivity,
    normals: SplitNormals,
}

impl SplitFaces {
    fn of(data: &MeshData) -> Option<Self> {
        let normals = data.split_normals.clone()?;
        let PolygonMesh { face_counts, face_indices, .. } = data.mesh.clone();
        Some(Self { faces: Connectivity { face_counts, face_indices }, normals })
    }
}

/// A conversion whose inputs are known.
struct Work<'a> {
    source: &'a CacheFrames,
    mesh: usize,
    split: Option<&'a SplitFaces>,
    plan: CachePlan<'a>,
}

impl Work<'_> {
    /// Writes all frames under another name, and gives the file its own when they are there.
    fn write(
        &self,
        to: &Path,
        (create, resume): (CreateCache, Option<ResumeCache>),
        samples: &Chosen,
        wrote: &mut dyn FnMut(i64),
    ) -> Result<(), IoError> {
        let aside = aside(to);
        // Half a cache would only confuse; if it cannot be removed either, the first error says why.
        let clear = || [&aside, &unfinished(&aside)].into_iter().for_each(|path| drop(fs::remove_file(path)));
        let mut writer = create(&aside, &self.plan).inspect_err(|_| clear())?;
        let mut write = |frame: &CacheFrame<'_>| {
            writer.write(frame)?;
            if frame.sub_frame == 0 {
                wrote(frame.frame);
            }
            Ok(())
        };
        let written = self.frames(samples, &mut write).and_then(|()| writer.finish());
        let mut mark = writer.mark();
        drop(writer);
        let placed = written.and_then(|()| put(&aside, to));
        if let Err(error) = placed {
            clear();
            if let Some(folder) = folder_of(to).filter(|_| !to.exists()) {
                let _ = remove_folder(&folder);
            }
            return Err(error);
        }
        mark.file = to.file_name().unwrap_or_default().to_string_lossy().into_owned();
        // Clears away what is left of a cache that was replaced.
        resume.map_or(Ok(()), |resume| resume(to, &self.plan, &mark)?.finish())
    }

    /// Gives all samples as the new file stores them.
    fn frames(
        &self,
        samples: &Chosen,
        take: &mut dyn FnMut(&CacheFrame<'_>) -> Result<(), IoError>,
    ) -> Result<(), IoError> {
        let plan = &self.plan;
        for &(sample, frame, sub_frame) in &samples.all {
            self.check_faces(frame, sample)?;
            let stored = self.source.samples.frame(self.mesh, sample)?;
            let (is_copied, positions) = self.positions(sample)?;
            if positions.len() != self.source.meshes[self.mesh].points {
                return Err(self.changes(frame, &format!("{} points", positions.len())));
            }
            if let Some(point) = first_impossible(&positions) {
                return Err(self.impossible((frame, sub_frame), point, "position"));
            }
            let velocities = match (self.source.samples.velocities(self.mesh, sample)?, plan.velocities) {
                (Some(velocities), true) if is_copied => velocities,
                (Some(_), true) => {
                    plan.units.stored_all(&self.source.velocities(self.mesh, sample)?.unwrap_or_default())
                }
                (None, true) => return Err(self.lacks(frame, "velocities")),
                (_, false) => Vec::new(),
            };
            if let Some(point) = first_impossible(&velocities) {
                return Err(self.impossible((frame, sub_frame), point, "velocity"));
            }
            let crossings = match (stored.crossings, plan.crossings) {
                (None, true) => return Err(self.lacks(frame, "a number of intersections")),
                (crossings, true) => crossings,
                (_, false) => None,
            };
            let normals = if plan.normals { self.normals(&positions) } else { Vec::new() };
            let (positions, velocities, normals) = (&positions[..], &velocities[..], &normals[..]);
            let values = stored.values.values();
            if let Some((name, point)) = first_impossible_number(&stored.values) {
                return Err(self.impossible((frame, sub_frame), point, name));
            }
            take(&CacheFrame { frame, sub_frame, positions, velocities, normals, crossings, values })?;
        }
        Ok(())
    }

    /// Normals that belong to positions as the new file stores them.
    fn normals(&self, positions: &[[f32; 3]]) -> Vec<[f32; 3]> {
        let (faces, split) = match self.split {
            Some(split) => (&split.faces, Some(&split.normals)),
            None => (&self.source.meshes[self.mesh].faces, None),
        };
        normals::of_faces((&faces.face_counts, &faces.face_indices), split, positions)
    }

    /// Positions of a frame as the new file stores them, and whether numbers stay what they are.
    fn positions(&self, sample: usize) -> Result<(bool, Vec<[f32; 3]>), IoError> {
        let Self { source, mesh, plan, .. } = self;
        let form = (plan.units, plan.file_origin().unwrap_or_default());
        let stored = source.stored_positions(*mesh, sample)?.filter(|stored| (stored.units, stored.origin) == form);
        if let Some(stored) = stored {
            return Ok((true, stored.points));
        }
        let world = source.positions(*mesh, sample)?;
        Ok((false, world.iter().map(|x| plan.units.stored_from(plan.origin, *x)).collect()))
    }

    /// Caches of this program keep their points and faces.
    fn check_faces(&self, frame: i64, sample: usize) -> Result<(), IoError> {
        match self.source.samples.faces(self.mesh, sample)? {
            Some(faces) if faces != self.source.meshes[self.mesh].faces => Err(self.changes(frame, "different faces")),
            _ => Ok(()),
        }
    }

    fn changes(&self, frame: i64, has: &str) -> IoError {
        let mesh = &self.source.meshes[self.mesh];
        let (first, points, faces) = (mesh.frames[0], mesh.points, mesh.faces.face_counts.len());
        let what = format!("frame {frame} has {has}, but frame {first} has {points} points and {faces} faces");
        let advice = "a Drapery cache keeps its points and faces; export the mesh with constant topology";
        IoError::data(&self.source.path, mesh.name.clone(), what, advice)
    }

    /// A number that no application takes.
    fn impossible(&self, (frame, sub_frame): (i64, usize), point: usize, what: &str) -> IoError {
        let behind = sub_frame.checked_sub(1).map_or(0.0, |number| self.plan.sub_frames[number]);
        let place = format!("{}, frame {}, point {point}", self.source.meshes[self.mesh].name, frame as f64 + behind);
        let what = format!("the {what} is not a finite number");
        IoError::data(
            &self.source.path,
            place,
            what,
            "choose the frames before it with --frames A-B, or make the cache again",
        )
    }

    fn lacks(&self, frame: i64, what: &str) -> IoError {
        let what = format!("frame {frame} has no {what}, but the first frame has");
        IoError::data(&self.source.path, "frames", what, "choose the frames that have them with --frames A-B")
    }
}

/// The first point at which a number is none.
fn first_impossible(vectors: &[[f32; 3]]) -> Option<usize> {
    vectors.iter().position(|vector| vector.iter().any(|number| !number.is_finite()))
}

/// The first attribute and point at which a number is none.
fn first_impossible_number(values: &StoredValues) -> Option<(&'static str, usize)> {
    values.named().find_map(|(name, all)| Some((name, all.iter().position(|number| !number.is_finite())?)))
}

/// Returns the path at which the new cache is written until it is whole; it keeps its extension.
fn aside(path: &Path) -> PathBuf {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let extension = path.extension().unwrap_or_default().to_string_lossy();
    path.with_file_name(format!(".{stem}.converted.{extension}"))
}
