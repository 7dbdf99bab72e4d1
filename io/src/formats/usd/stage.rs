//! Stages of other programs as caches: their meshes in whole frames, as USD has them at the time codes of these.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use drapery_core::Vec3;
use drapery_usd::read::{About, Stage, Stored, UsdError};

use super::read::{frame_rate, left_out, mesh_data, seen, stated_units};
use crate::attributes::{PointAttributes, REST, StoredValues, THICKNESS};
use crate::cache_frames::transforms::in_world;
use crate::cache_frames::{Between, CacheFrames, CacheMesh, CacheSamples, Shifted, StoredFrame, cut, listed_triangles};
use crate::error::IoError;
use crate::formats::Opening;
use crate::mesh_data::{Connectivity, MeshData};
use crate::normals::SplitNormals;
use crate::units::decide;

/// Triangles that were simulated, how often cloth crosses cloth, which attributes were computed, and the number of each corner's normal
/// where hard edges split them, in caches of this program.
const TRIANGLES: &str = "drapery:triangles";
const CROSSINGS: &str = "drapery:crossings";
const ATTRIBUTES: &str = "drapery:attributes";
const NORMAL_INDICES: &str = "drapery:normalIndices";

/// Normals of face corners, as [`Stage`] names what it does not read by itself.
const CORNER_NORMALS: &str = "normals (faceVarying)";

/// Most frames of a stage: an hour of film.
const MOST_FRAMES: f64 = 100_000.0;

/// A time this close to a whole frame is that frame.
const WHOLE_FRAME: f64 = 1e-3;

/// Bounds are compared relative to the size of the mesh; positions are f32.
const BOUNDS_TOLERANCE: f32 = 1e-5;

/// A stage whose meshes are read frame by frame.
struct Samples {
    path: PathBuf,
    stage: Stage,
    /// Frames a second.
    fps: f64,
    /// Time codes of a frame.
    codes_per_frame: f64,
    meshes: Vec<Mesh>,
}

struct Mesh {
    /// Time codes of the samples: those of frames, then those between them.
    codes: Vec<f64>,
    faces_move: bool,
    /// Shift that transforms apply to stored points, where they do no more and never change.
    origin: Option<[f64; 3]>,
    /// From stored points to the world, where that never changes.
    fixed: Option<[f64; 16]>,
    /// Attributes that this program computed.
    attributes: PointAttributes,
    /// Normals that this program computed, where hard edges split them.
    split_normals: Option<SplitNormals>,
}

/// Opens all meshes that are to be seen, whatever their purpose.
///
/// # Errors
/// The stage is missing or damaged, or nothing is to be seen of it.
pub(super) fn open(path: &Path, _: Opening) -> Result<CacheFrames, IoError> {
    let stage = Stage::open(path)?;
    let places = seen(path, &stage)?;
    let chosen = stage.choose(&places)?;
    let about = stage.about();
    let stated = stated_units(path, about)?;
    let (units, unit_note) = decide(stated, None, None);
    let (fps, codes_per_frame) = frame_rate(path, about)?;
    let mut notes: Vec<String> = unit_note.into_iter().collect();
    notes.extend(notes_on(about));
    notes.extend(chosen.notes.iter().cloned());
    let (mut meshes, mut described) = (Vec::new(), Vec::new());
    for (mesh, place) in places.iter().enumerate() {
        let entry = &about.meshes[*place];
        let (name, stored) = (&entry.path, &chosen.codes_of_each[mesh]);
        let (frames, between) = samples_of(path, name, (about.range, stored), codes_per_frame)?;
        let of_frames = frames.iter().map(|frame| *frame as f64 * codes_per_frame);
        let codes: Vec<f64> = of_frames.chain(between.iter().copied()).collect();
        let fixed = stage.fixed_to_world(mesh)?;
        let origin = fixed.and_then(shift);
        let (attributes, split_normals) = match origin {
            Some(_) => (attributes(&stage, (mesh, codes[0]))?, split_normals(&stage, (mesh, codes[0]))?),
            // Rest positions and normals would have to be moved with the points.
            None => (PointAttributes::default(), None),
        };
        let left = chosen.left_out_of_each[mesh].iter();
        let left = left.filter(|left| split_normals.is_none() || *left != CORNER_NORMALS);
        let left = left.map(|left| left_out(name, left));
        let read = |name: &str| attributes.moving().any(|read| primvar_of(read) == name);
        let moving = chosen.moving_primvars_of_each[mesh].iter().filter(|name| !read(name));
        let moving =
            moving.map(|moving| format!("{name}: {moving} is animated; its first value is used in all frames"));
        let about_it = CacheMesh {
            name: name.clone(),
            between: between.iter().map(|code| Between::at(code / codes_per_frame)).collect(),
            is_still: stored.is_empty(),
            purpose: entry.purpose.clone(),
            left_out: left.chain(moving).collect(),
            frames,
            attributes: attributes.clone(),
            split_normals: split_normals.clone(),
            ..CacheMesh::default()
        };
        let faces_move = stage.faces_move(mesh)?;
        described.push(first_sample(&stage, (mesh, codes[0]), about_it, &mut notes)?);
        meshes.push(Mesh { codes, faces_move, origin, fixed, attributes, split_normals });
    }
    let hidden = hidden(about).map(|(path, why)| format!("{path} is left out: {why}")).collect();
    let samples = Samples { path: path.to_owned(), stage, fps, codes_per_frame, meshes };
    let (states_length, cache) =
        (stated.metres.is_some(), CacheFrames::new(path, (units, Some(fps)), described, samples));
    Ok(CacheFrames { states_length, codes_per_frame, notes, hidden, ..cache })
}

/// Attributes that this program computed for a mesh, where they are as its caches have them at this time code.
fn attributes(stage: &Stage, (mesh, code): (usize, f64)) -> Result<PointAttributes, UsdError> {
    let Some(listed) = stage.text(mesh, ATTRIBUTES)? else { return Ok(PointAttributes::default()) };
    let points = stage.points(mesh, code)?.len();
    let mut found = BTreeMap::new();
    for word in listed.split(' ') {
        let numbers = stage.floats(mesh, &primvar_of(word), code)?;
        let expected = if word == REST { 3 * points } else { points };
        found.extend(numbers.filter(|numbers| numbers.len() == expected).map(|numbers| (word, numbers)));
    }
    let words = found.keys().copied().collect::<Vec<_>>().join(" ");
    let of = |word: &str| found.get(word).cloned().unwrap_or_default();
    PointAttributes::of_listed(&words, || Ok(of(REST).as_chunks().0.to_vec()), || Ok(of(THICKNESS)))
}

/// Normals that this program computed for a mesh at a time code, where hard edges split them.
fn split_normals(stage: &Stage, (mesh, code): (usize, f64)) -> Result<Option<SplitNormals>, UsdError> {
    let Some(all) = stage.integers(mesh, NORMAL_INDICES, code)? else { return Ok(None) };
    let indices: Option<Vec<u32>> = all.into_iter().map(|index| u32::try_from(index).ok()).collect();
    let Some(indices) = indices else { return Ok(None) };
    let count = indices.iter().max().map_or(0, |last| *last as usize + 1);
    let fits = count <= indices.len();
    Ok(SplitNormals::numbered(indices, count, &stage.faces(mesh, code)?.indices).filter(|_| fits))
}

/// Name of the primvar of an attribute.
fn primvar_of(word: &str) -> String {
    format!("primvars:{word}")
}

/// Whole frames of a mesh: those that the stage says it has (`range`), or else those from its first sample to its last; and the time
/// codes of samples between the first and the last of these frames.
fn samples_of(
    path: &Path,
    name: &str,
    (range, codes): (Option<[f64; 2]>, &[f64]),
    codes_per_frame: f64,
) -> Result<(Vec<i64>, Vec<f64>), IoError> {
    let sampled = || codes.first().copied().zip(codes.last().copied()).map_or([0.0; 2], |(a, b)| [a, b]);
    let range = range.filter(|[first, last]| first.is_finite() && last.is_finite() && first <= last);
    let [first, last] = range.unwrap_or_else(sampled).map(|code| code / codes_per_frame);
    if last - first > MOST_FRAMES || first.abs().max(last.abs()) > i64::from(i32::MAX) as f64 {
        let what = format!("its time codes span the frames {first} to {last}, which are too many");
        let advice = format!("a cache has at most {MOST_FRAMES} frames; correct startTimeCode and endTimeCode");
        return Err(IoError::data(path, name, what, advice));
    }
    let (from, to) = (first.ceil() as i64, last.floor() as i64);
    // Where all samples lie between two frames, the one before them shows what there is.
    let frames: Vec<i64> = if from <= to { (from..=to).collect() } else { vec![to] };
    let within = frames[0] as f64..=to as f64;
    let is_between = |code: &&f64| {
        let time = **code / codes_per_frame;
        (time - time.round()).abs() > WHOLE_FRAME && within.contains(&time)
    };
    let between = codes.iter().filter(is_between).copied().collect();
    Ok((frames, between))
}

/// Adds to what is known of a mesh its points and faces in its first sample.
fn first_sample(
    stage: &Stage,
    (mesh, code): (usize, f64),
    about: CacheMesh,
    notes: &mut Vec<String>,
) -> Result<CacheMesh, IoError> {
    let points: Vec<Vec3> = stage.points(mesh, code)?.into_iter().map(Vec3::from).collect();
    let faces = stage.faces(mesh, code)?;
    let stored = stage.integers(mesh, TRIANGLES, code)?;
    let stored = stored.and_then(|corners| listed_triangles(corners.as_chunks().0, points.len()));
    if let Some(stored) = stage.stored(mesh, code)?.filter(|stored| stored.extent.is_none()) {
        let what = format!("{}: no extent at frame {}", about.name, about.frames[0]);
        notes.push(format!("{what}, for {} points: applications have to compute it", stored.points.len()));
    }
    Ok(CacheMesh {
        points: points.len(),
        triangles: stored.unwrap_or_else(|| cut(&faces.counts, &faces.indices, &points)),
        faces: Connectivity { face_counts: faces.counts, face_indices: faces.indices },
        ..about
    })
}

impl Samples {
    fn code(&self, mesh: usize, sample: usize) -> f64 {
        self.meshes[mesh].codes[sample]
    }

    fn points(&self, mesh: usize, sample: usize) -> Result<Vec<[f64; 3]>, UsdError> {
        self.stage.points(mesh, self.code(mesh, sample))
    }

    fn stored(&self, mesh: usize, sample: usize) -> Result<Option<Stored>, UsdError> {
        self.stage.stored(mesh, self.code(mesh, sample))
    }

    fn values(&self, mesh: usize, sample: usize) -> Result<StoredValues, IoError> {
        let code = self.code(mesh, sample);
        StoredValues::read(&self.meshes[mesh].attributes, |name| {
            let numbers = self.stage.floats(mesh, &primvar_of(name), code)?;
            numbers.ok_or_else(|| self.lacking(&primvar_of(name), code))
        })
    }

    /// Normals where hard edges split them, in the order of their numbers.
    fn split_normals(&self, mesh: usize, sample: usize) -> Result<Option<Vec<[f32; 3]>>, IoError> {
        let Some(split) = &self.meshes[mesh].split_normals else { return Ok(None) };
        let code = self.code(mesh, sample);
        let corners = self.stage.floats(mesh, "normals", code)?;
        let normals = corners.and_then(|corners| split.of_corners(corners.as_chunks().0));
        normals.map(Some).ok_or_else(|| self.lacking("normals", code))
    }

    fn lacking(&self, name: &str, code: f64) -> IoError {
        let what = format!("time code {code} does not hold it as the others do");
        IoError::data(&self.path, name, what, "write the cache again")
    }
}

impl CacheSamples for Samples {
    fn world(&self, mesh: usize, sample: usize) -> Result<Vec<Vec3>, IoError> {
        Ok(self.points(mesh, sample)?.into_iter().map(Vec3::from).collect())
    }

    fn shifted(&self, mesh: usize, sample: usize) -> Result<Option<Shifted>, IoError> {
        let Some(origin) = self.meshes[mesh].origin else { return Ok(None) };
        Ok(self.stored(mesh, sample)?.map(|stored| (origin, stored.points)))
    }

    fn velocities(&self, mesh: usize, sample: usize) -> Result<Option<Vec<[f32; 3]>>, IoError> {
        let Some(Stored { points, velocities: Some(velocities), to_world, .. }) = self.stored(mesh, sample)? else {
            return Ok(None);
        };
        let Mesh { fixed, .. } = &self.meshes[mesh];
        let around = match fixed {
            Some(_) => None,
            None => {
                let (code, half) = (self.code(mesh, sample), self.codes_per_frame / 2.0);
                let at = |code| self.stage.to_world(mesh, code);
                Some(([at(code - half)?, at(code + half)?], 1.0 / self.fps))
            }
        };
        Ok(Some(in_world(velocities, &points, &to_world, around)))
    }

    /// All that is stored; of a mesh that is moved by more than transforms, its points in the world.
    fn frame(&self, mesh: usize, sample: usize) -> Result<StoredFrame, IoError> {
        let crossings = self.stage.integers(mesh, CROSSINGS, self.code(mesh, sample))?;
        let crossings = crossings.and_then(|all| u32::try_from(*all.first()?).ok());
        Ok(match self.stored(mesh, sample)? {
            Some(Stored { points, velocities, normals, extent, .. }) => StoredFrame {
                has_bounds_of_points: extent.is_none_or(|extent| contains(extent, &points)),
                positions: points,
                velocities,
                normals: self.split_normals(mesh, sample)?.or(normals),
                crossings,
                values: self.values(mesh, sample)?,
            },
            None => {
                let positions = self.points(mesh, sample)?.into_iter().map(|p| p.map(|x| x as f32)).collect();
                let (velocities, normals, values) = (None, None, StoredValues::default());
                StoredFrame { positions, velocities, normals, crossings, values, has_bounds_of_points: true }
            }
        })
    }

    fn attributes(&self, mesh: usize, about: &CacheMesh) -> Result<MeshData, IoError> {
        let data = mesh_data(about.name.clone(), self.stage.mesh(mesh, self.code(mesh, 0))?);
        Ok(MeshData { purpose: about.purpose.clone(), ..data })
    }

    fn faces(&self, mesh: usize, sample: usize) -> Result<Option<Connectivity>, IoError> {
        if !self.meshes[mesh].faces_move {
            return Ok(None);
        }
        let faces = self.stage.faces(mesh, self.code(mesh, sample))?;
        Ok(Some(Connectivity { face_counts: faces.counts, face_indices: faces.indices }))
    }

    fn check_complete(&self, mesh: Option<&str>) -> Result<(), IoError> {
        let touches = |prim: &str| {
            let below =
                |path: &str| path.strip_prefix(prim).is_some_and(|rest| rest.starts_with('/') || rest.is_empty());
            prim.is_empty() || prim == "/" || mesh.is_none_or(below)
        };
        match self.stage.about().flaws.iter().find(|(prim, _)| touches(prim)) {
            Some((_, flaw)) => Err(flaw.clone().into()),
            None => Ok(()),
        }
    }
}

/// Notes on what a stage leaves open.
fn notes_on(about: &About) -> Vec<String> {
    let mut notes = Vec::new();
    if about.default_prim.is_none() {
        notes.push("the stage has no defaultPrim: references to it have to name a prim".to_owned());
    }
    if about.range.is_none() {
        notes.push("the stage does not state its first and last time code; its samples set the frames".to_owned());
    }
    notes.extend(hidden(about).map(|(path, why)| format!("{path} is not checked: {why}")));
    notes
}

/// Meshes that nothing is to be seen of, and why.
fn hidden(about: &About) -> impl Iterator<Item = (&String, &String)> {
    about.meshes.iter().filter_map(|mesh| Some((&mesh.path, mesh.hidden.as_ref()?)))
}

/// The shift that a matrix is, if it is no more.
fn shift(matrix: [f64; 16]) -> Option<[f64; 3]> {
    let mut linear = matrix;
    linear[12..15].fill(0.0);
    (linear == drapery_alembic::IDENTITY).then_some([matrix[12], matrix[13], matrix[14]])
}

/// Whether bounds hold all points, up to rounding.
fn contains([low, high]: [[f32; 3]; 2], points: &[[f32; 3]]) -> bool {
    let size = low.iter().chain(&high).fold(0.0_f32, |size, x| size.max(x.abs()));
    let margin = BOUNDS_TOLERANCE * size;
    points.iter().all(|p| (0..3).all(|axis| p[axis] >= low[axis] - margin && p[axis] <= high[axis] + margin))
}
