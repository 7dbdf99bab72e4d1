//! USD caches: a text layer a garment over binary value clips, one a frame (`docs/reference/usd_cache.md`).
//!
//! `OUT/<garment>.usd` is small and is replaced as a whole after every frame, when the clip that it names next is there: a
//! reader finds all frames up to one, whenever it looks and wherever the process was killed. What does not move stands in a
//! layer of its own, written with the first frame. It and the clips are in `OUT/<garment>.clips/<digest>/`, where the digest
//! is that of what does not move: caches of another form (other units, without velocities) never share clips, and a cache
//! that is written anew takes the old one's place by the one renaming of its text.
//!
//! A cache is continued by taking the frames after its mark out of the text, and then out of the folder.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};

use drapery_alembic::murmur3_x64_128;
use drapery_core::mesh::MeshStream;
use drapery_usd::cache::{Cache, CacheError};
use drapery_usd::write::{
    CacheLayer, GarmentReference, Members, MeshPath, Moving, ShotLayer, StillMesh, Units as LayerUnits, WriteError,
    cache_layer, clip, clip_manifest, shot_layer, topology,
};

use super::attributes;
use crate::atomic_file::unfinished;
use crate::attributes::{PointAttributes, REST};
use crate::cache::{APPLICATION, CacheFrame, CacheMark, CachePlan, CacheWriter};
use crate::error::IoError;
use crate::formats::continuing::{cannot_continue, hexadecimal, lost, marked_frames, remove, sync_name, too_short};
use crate::formats::{Part, ShotFiles, remove_folder};
use crate::garment_mesh::{GarmentMesh, triangles_to_store};
use crate::mesh_data::MeshData;
use crate::normals::SplitNormals;
use crate::units::{InputUnits, Units, UpAxis};
use crate::written_file;

/// Digits of the digest that a folder of clips is named by.
const DIGITS: usize = 16;

/// A USD cache being written. The text layer appears with the first frame.
#[derive(Debug)]
pub(super) struct UsdWriter {
    path: PathBuf,
    /// Folder of clips of all forms, beside the layer.
    clips: PathBuf,
    mesh: GarmentMesh,
    /// Normals that hard edges split; known with the first frame.
    split_normals: Option<SplitNormals>,
    mesh_path: MeshPath,
    units: LayerUnits,
    origin: Option<[f64; 3]>,
    documentation: String,
    properties: Vec<(&'static str, String)>,
    first_frame: i64,
    sub_frames: Vec<f64>,
    velocities: bool,
    normals: bool,
    crossings: bool,
    attributes: PointAttributes,
    stage: Stage,
    mark: CacheMark,
    /// Paths that are written but may not be on the disk.
    unsynced: Vec<PathBuf>,
    /// Lengths of all files that the cache is made of [bytes].
    lengths: BTreeMap<PathBuf, u64>,
}

/// Progress of the cache.
#[derive(Debug, Clone, PartialEq, Eq)]
enum Stage {
    /// No frame yet, so no file.
    Empty,
    /// One frame at least; the folder of clips of this form.
    Open(PathBuf),
    /// Given up after an error.
    Closed,
}

/// Folder of the clips of a cache, which the cache is nothing without.
pub(super) fn clips_of(cache: &Path) -> PathBuf {
    cache.with_extension("clips")
}

/// Returns the units that layers state for their numbers.
pub(super) fn layer_units(units: Units, fps: f64) -> LayerUnits {
    LayerUnits { metres_per_unit: units.length.metres(), z_up: units.up == UpAxis::Z, time_codes_per_second: fps }
}

impl UsdWriter {
    /// Prepares a cache at `path`; the first frame creates it and replaces what is there.
    pub(super) fn create(path: &Path, plan: &CachePlan<'_>) -> Self {
        let (numerator, denominator) = (plan.timeline.fps_numerator, plan.timeline.fps_denominator);
        let properties = vec![
            ("application", APPLICATION.to_owned()),
            ("fps", format!("{numerator}/{denominator}")),
            ("garment", plan.garment.to_owned()),
            ("length_unit", plan.units.length.word().to_owned()),
        ];
        Self {
            path: path.to_owned(),
            // By the garment and not by the file, which may get its final name only when it is whole.
            clips: clips_of(&path.with_file_name(format!("{}.usd", plan.garment))),
            mesh: plan.mesh.clone(),
            split_normals: None,
            mesh_path: MeshPath::of(&plan.object_path()),
            units: layer_units(plan.units, plan.timeline.fps()),
            origin: plan.file_origin(),
            documentation: format!("Garment {}", plan.garment),
            properties,
            first_frame: plan.first_frame,
            sub_frames: plan.sub_frames.to_vec(),
            velocities: plan.velocities,
            normals: plan.normals,
            crossings: plan.crossings,
            attributes: plan.attributes.clone(),
            stage: Stage::Empty,
            mark: CacheMark::none(path),
            unsynced: Vec::new(),
            lengths: BTreeMap::new(),
        }
    }

    /// Goes on with the cache at `path` after its mark. Readers find a valid stage all the time, with the frames up to the
    /// mark.
    ///
    /// # Errors
    /// The cache is missing, damaged, not the one of the mark, or was made with another plan; it then stays as it is.
    pub(super) fn resume(path: &Path, plan: &CachePlan<'_>, mark: &CacheMark) -> Result<Self, IoError> {
        let mut writer = Self::create(path, plan);
        let Some((folder, last)) = writer.found_sound(plan, mark)? else {
            // What a run without a break has at this point: nothing before the first frame.
            remove(path)?;
            remove_folder(&writer.clips)?;
            return Ok(writer);
        };
        writer.write_layer(&folder, (last, mark.sub_frame))?;
        writer.remove_later(&folder, (last, mark.sub_frame))?;
        writer.mark = mark.clone();
        writer.note_lengths(&folder)?;
        writer.stage = Stage::Open(folder);
        Ok(writer)
    }

    /// Finds out whether [`UsdWriter::resume`] would go on; changes nothing.
    ///
    /// # Errors
    /// The errors of [`UsdWriter::resume`], without those of writing.
    pub(super) fn check_resume(path: &Path, plan: &CachePlan<'_>, mark: &CacheMark) -> Result<(), IoError> {
        Self::create(path, plan).found_sound(plan, mark).map(|_| ())
    }

    /// The folder of clips to go on in, and the last frame; nothing where the mark is before the first frame.
    fn found_sound(&mut self, plan: &CachePlan<'_>, mark: &CacheMark) -> Result<Option<(PathBuf, i64)>, IoError> {
        let path = &self.path.clone();
        if marked_frames(path, plan, mark)? == 0 {
            return Ok(None);
        }
        let failed = |e| IoError::writing(path, e);
        let last = mark.last_frame.unwrap_or(plan.first_frame);
        let refused = |what: &str| cannot_continue(path, format!("frame {last}"), what);
        let layer = match fs::read_to_string(path) {
            Err(e) if e.kind() == ErrorKind::NotFound => return Err(lost(path, format!("frame {last}"))),
            layer => layer.map_err(failed)?,
        };
        if let Some(held) = last_frame_in(&layer).filter(|held| *held > plan.last_frame) {
            return Err(too_short(path, plan, held));
        }
        let still = self.topology()?;
        let folder = self.folder_of(&still);
        match fs::read(folder.join(CacheLayer::TOPOLOGY)) {
            Ok(there) if there == still => {}
            Ok(_) => return Err(refused("its topology is no longer the one that was written")),
            Err(e) if e.kind() == ErrorKind::NotFound && self.clips.is_dir() => {
                return Err(refused(
                    "the cache was started with different settings: a different mesh, origin, unit or content",
                ));
            }
            Err(e) if e.kind() == ErrorKind::NotFound => return Err(refused("the folder of its clips is missing")),
            Err(e) => return Err(failed(e)),
        }
        drop(still);
        let clip = |frame, sub_frame| folder.join(CacheLayer::clip(frame, sub_frame));
        let is_missing = |frame: &i64| (0..=plan.sub_frames.len()).any(|sub_frame| !clip(*frame, sub_frame).is_file());
        if let Some(frame) = (plan.first_frame..last).find(is_missing) {
            return Err(refused(&format!("the clip of frame {frame} is missing")));
        }
        if (0..mark.sub_frame).any(|sub_frame| !clip(last, sub_frame).is_file()) {
            return Err(refused("the clip of this frame is missing"));
        }
        match fs::read(clip(last, mark.sub_frame)) {
            Ok(bytes) if hexadecimal(murmur3_x64_128(&bytes)) == mark.digest => {}
            Ok(_) => return Err(refused("the clip of this frame differs from the one that was written")),
            Err(e) if e.kind() == ErrorKind::NotFound => return Err(refused("the clip of this frame is missing")),
            Err(e) => return Err(failed(e)),
        }
        // The layer of what does not move does not tell how many points there are.
        let held = Cache::open(path).and_then(|cache| match cache.frames.binary_search(&last) {
            Ok(place) => Ok(cache.frame(place)?.points.len()),
            Err(_) => Ok(0),
        });
        if held.map_err(|e| refused(&e.to_string()))? != plan.mesh.point_count() {
            return Err(refused("the cache was started with different settings: a different number of points"));
        }
        Ok(Some((folder, last)))
    }

    /// The layer of what does not move; takes note of the hard edges.
    fn topology(&mut self) -> Result<Vec<u8>, IoError> {
        let data = self.mesh.read()?;
        self.split_normals = data.split_normals.clone().filter(|_| self.normals);
        let Self { origin, velocities, normals, crossings, ref attributes, .. } = *self;
        let up = if self.units.z_up { UpAxis::Z } else { UpAxis::Y };
        let units = InputUnits { metres: self.units.metres_per_unit, up };
        let form = Form { units, origin, velocities, normals, crossings, attributes };
        let still = still_mesh(data, &self.mesh_path, form);
        topology(self.units, still).map_err(|e| self.refused(&e))
    }

    /// The folder of clips that go with a layer of what does not move.
    fn folder_of(&self, topology: &[u8]) -> PathBuf {
        let digest = hexadecimal(murmur3_x64_128(topology));
        self.clips.join(&digest[..DIGITS])
    }

    /// Makes the folder with what does not move.
    fn write_first(&mut self) -> Result<PathBuf, IoError> {
        let still = self.topology()?;
        let folder = self.folder_of(&still);
        fs::create_dir_all(&folder).map_err(|e| IoError::creating(&folder, e))?;
        self.write_file(&folder.join(CacheLayer::TOPOLOGY), &still)?;
        let Self { velocities, normals, crossings, .. } = *self;
        let numbers: Vec<&str> = self.attributes.moving().collect();
        let members = Members { velocities, normals, crossings, numbers: &numbers };
        let manifest = clip_manifest(self.units, &self.mesh_path, members);
        self.write_file(&folder.join(CacheLayer::MANIFEST), manifest.as_bytes())?;
        Ok(folder)
    }

    /// Writes the clip of a frame, then the layer that names it.
    fn write_frame(&mut self, folder: &Path, frame: &CacheFrame<'_>) -> Result<(), IoError> {
        let behind = frame.sub_frame.checked_sub(1).map_or(0.0, |number| self.sub_frames[number]);
        let numbers = self.attributes.moving_of(frame.values);
        let at_corners = self.split_normals.as_ref().map(|split| split.at_corners(frame.normals));
        let moving = Moving {
            time_code: frame.frame as f64 + behind,
            points: frame.positions,
            velocities: self.velocities.then_some(frame.velocities),
            normals: self.normals.then_some(at_corners.as_deref().unwrap_or(frame.normals)),
            crossings: self.crossings.then(|| frame.crossings.unwrap_or(0)),
            numbers: &numbers,
        };
        let bytes = clip(self.units, &self.mesh_path, &moving).map_err(|e| self.refused(&e))?;
        let sample = (frame.frame, frame.sub_frame);
        self.write_file(&folder.join(CacheLayer::clip(sample.0, sample.1)), &bytes)?;
        self.write_layer(folder, sample)?;
        self.mark = CacheMark {
            last_frame: Some(frame.frame),
            sub_frame: frame.sub_frame,
            bytes: bytes.len() as u64,
            digest: hexadecimal(murmur3_x64_128(&bytes)),
            ..CacheMark::none(&self.path)
        };
        Ok(())
    }

    /// Writes the layer with the samples up to this frame and number behind it.
    fn write_layer(&mut self, folder: &Path, (last, last_sub_frame): (i64, usize)) -> Result<(), IoError> {
        let name = |path: &Path| path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let text = cache_layer(&CacheLayer {
            units: self.units,
            path: &self.mesh_path,
            documentation: &self.documentation,
            properties: &self.properties,
            folder: &format!("{}/{}", name(&self.clips), name(folder)),
            frames: [self.first_frame, last],
            sub_frames: &self.sub_frames,
            last_sub_frame,
        });
        self.write_file(&self.path.clone(), text.as_bytes())
    }

    /// Removes what is no longer named: later samples, what a killed run left unfinished, caches of other forms.
    fn remove_later(&self, folder: &Path, last: (i64, usize)) -> Result<(), IoError> {
        let failed = |e| IoError::writing(folder, e);
        for entry in fs::read_dir(folder).map_err(failed)? {
            let path = entry.map_err(failed)?.path();
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            if name.ends_with(".part") || CacheLayer::frame_of(&name).is_some_and(|sample| sample > last) {
                remove(&path)?;
            }
        }
        for entry in fs::read_dir(&self.clips).map_err(failed)? {
            let path = entry.map_err(failed)?.path();
            if path != folder {
                remove_folder(&path)?;
            }
        }
        Ok(())
    }

    /// Takes note of the files that are there, all of them parts of the cache.
    fn note_lengths(&mut self, folder: &Path) -> Result<(), IoError> {
        let failed = |e| IoError::writing(folder, e);
        for entry in fs::read_dir(folder).map_err(failed)? {
            let entry = entry.map_err(failed)?;
            self.lengths.insert(entry.path(), entry.metadata().map_err(failed)?.len());
        }
        Ok(())
    }

    /// Makes sure that all files of the cache are there.
    fn check(&self) -> Result<(), IoError> {
        self.lengths.iter().try_for_each(|(path, length)| written_file::check(path, None, *length))
    }

    /// Writes a file beside its name and renames it.
    fn write_file(&mut self, path: &Path, bytes: &[u8]) -> Result<(), IoError> {
        let part = unfinished(path);
        let mut file = File::create(&part).map_err(|e| IoError::creating(&part, e))?;
        let written = file.write_all(bytes).and_then(|()| fs::rename(&part, path));
        if written.is_err() {
            // It would take the room that is missing.
            let _ = fs::remove_file(&part);
        }
        written.map_err(|e| IoError::writing(path, e))?;
        self.lengths.insert(path.to_owned(), bytes.len() as u64);
        if !self.unsynced.iter().any(|known| known == path) {
            self.unsynced.push(path.to_owned());
        }
        Ok(())
    }

    fn refused(&self, error: &WriteError) -> IoError {
        write_error(&self.path, error)
    }
}

/// The error of a layer that cannot be put together.
pub(super) fn write_error(path: &Path, error: &WriteError) -> IoError {
    let advice = "give the object a name or path that USD accepts, or leave \"usd\" out of output.format";
    IoError::data(path, error.place.clone(), error.what.clone(), advice)
}

impl CacheWriter for UsdWriter {
    fn path(&self) -> &Path {
        &self.path
    }

    fn write(&mut self, frame: &CacheFrame<'_>) -> Result<(), IoError> {
        let expected = self.mark.next(self.first_frame, self.sub_frames.len());
        assert_eq!((frame.frame, frame.sub_frame), expected, "frames come in order");
        assert_eq!(frame.positions.len(), self.mesh.point_count(), "a garment keeps its number of points");
        // Closed until the frame is complete: after an error nothing may follow.
        let folder = match std::mem::replace(&mut self.stage, Stage::Closed) {
            Stage::Empty => self.write_first()?,
            Stage::Open(folder) => {
                // All of them at checkpoints and at the end: there may be thousands.
                let around = [self.path.clone(), folder.join(CacheLayer::TOPOLOGY)];
                let known = around.iter().filter_map(|path| Some((path, self.lengths.get(path)?)));
                known.into_iter().try_for_each(|(path, length)| written_file::check(path, None, *length))?;
                folder
            }
            Stage::Closed => panic!("no frame is written after an error"),
        };
        self.write_frame(&folder, frame)?;
        self.stage = Stage::Open(folder);
        Ok(())
    }

    fn mark(&self) -> CacheMark {
        self.mark.clone()
    }

    fn sync(&mut self) -> Result<(), IoError> {
        self.check()?;
        for path in std::mem::take(&mut self.unsynced) {
            File::open(&path).and_then(|file| file.sync_all()).map_err(|e| IoError::writing(&path, e))?;
        }
        if let Stage::Open(folder) = &self.stage {
            // The names in the folder, then its own and that of the layer.
            sync_name(&folder.join(CacheLayer::TOPOLOGY));
            sync_name(folder);
            sync_name(&self.clips);
        }
        Ok(())
    }

    fn finish(&mut self) -> Result<(), IoError> {
        self.sync()
    }
}

/// Data of a mesh that is written beside the mesh.
#[derive(Clone, Copy)]
pub(super) struct Form<'a> {
    /// Unit and axes of its numbers.
    pub(super) units: InputUnits,
    /// Position that its points are counted from, if not from the origin of the world.
    pub(super) origin: Option<[f64; 3]>,
    /// Whether frames have velocities.
    pub(super) velocities: bool,
    /// Whether frames have normals.
    pub(super) normals: bool,
    /// Whether frames have a number of intersections.
    pub(super) crossings: bool,
    /// Other attributes at the points.
    pub(super) attributes: &'a PointAttributes,
}

/// Everything of a mesh that does not move, as USD writes it.
pub(super) fn still_mesh<'a>(mut data: MeshData, path: &'a MeshPath, form: Form<'_>) -> StillMesh<'a> {
    data.convert_params(form.units);
    form.attributes.add_to(&mut data, REST);
    if form.normals {
        // Those of the source are of one pose, and would count more.
        data.params.retain(|param| param.name != "normals");
    }
    let triangles = triangles_to_store(&data);
    let primvars = std::mem::take(&mut data.params);
    let primvars = primvars.into_iter().map(|param| attributes::primvar(param, &data.mesh.face_counts)).collect();
    let faces = data.mesh.face_counts.len();
    let signed = |list: Vec<u32>| list.into_iter().map(|number| number as i32).collect::<Vec<_>>();
    StillMesh {
        path,
        origin: form.origin,
        subdivision: attributes::subdivision(data.subdivision.as_deref()),
        uvs: data.uvs.map(|uvs| (uvs.values, signed(uvs.indices))),
        primvars,
        subsets: data.face_sets.into_iter().map(|set| attributes::subset(set, faces)).collect(),
        material: data.material.map(attributes::bound),
        purpose: data.purpose,
        render_mesh_of: data.render_mesh_of,
        double_sided: data.double_sided,
        triangles: triangles.map(|all| all.into_iter().map(|corners| corners.map(|v| v as i32)).collect()),
        face_counts: signed(data.mesh.face_counts),
        face_indices: signed(data.mesh.face_indices),
        velocities: form.velocities,
        normals: form.normals,
        normal_indices: data.split_normals.filter(|_| form.normals).map(|split| signed(split.indices)),
        crossings: form.crossings,
        numbers: form.attributes.moving().collect(),
        attributes: form.attributes.listed(),
    }
}

/// The last frame that a layer of ours names.
fn last_frame_in(layer: &str) -> Option<i64> {
    layer.lines().find_map(|line| line.trim().strip_prefix("endTimeCode = ")?.parse().ok())
}

/// Writes the layer of a shot, with a reference to each cache.
///
/// # Errors
/// The disk refuses.
pub(super) fn write_shot(path: &Path, shot: &ShotFiles<'_>) -> Result<(), IoError> {
    let garments: Vec<GarmentReference> = shot
        .caches
        .iter()
        .map(|cache| GarmentReference {
            name: cache.name.to_owned(),
            file: cache.file.clone(),
            purpose: purpose_of(cache.part),
        })
        .collect();
    let text = shot_layer(&ShotLayer {
        units: layer_units(shot.units, shot.fps),
        shot: shot.name,
        garments: &garments,
        frames: shot.frames,
    });
    crate::atomic_file::replace(path, text.as_bytes())
}

/// Returns the purpose of a part of a shot; `None` if it serves every purpose.
pub(super) fn purpose_of(part: Part) -> Option<&'static str> {
    match part {
        Part::Alone => None,
        Part::Followed => Some("proxy"),
        Part::RenderMesh => Some("render"),
    }
}

/// The error of a cache that cannot be read, with what helps.
pub(super) fn cache_error(path: &Path, error: CacheError) -> IoError {
    let damaged = "it is damaged: copy it again from where it was written, or run the shot again";
    let other = "give the .usd file of a garment that `drapery run` wrote, with the folder .clips beside it";
    match error {
        CacheError::Io { path, source } if source.kind() == ErrorKind::NotFound => IoError::Missing { path },
        CacheError::Io { path, source } => IoError::Read { path, source },
        CacheError::Damaged { path: file, what } => IoError::data(path, file.display().to_string(), what, damaged),
        CacheError::NotOurs { what, .. } => IoError::data(path, "stage", format!("not a Drapery cache: {what}"), other),
    }
}
