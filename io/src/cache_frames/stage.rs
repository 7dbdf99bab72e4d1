//! Stages of other programs as caches: their meshes in whole frames, as USD has them at the time codes of these.

use std::fmt;
use std::path::{Path, PathBuf};

use drapery_core::Vec3;
use drapery_usd::read::{About, Stage, Stored, UsdError};

use super::transforms::in_world;
use super::{Between, CacheMesh, StoredFrame, cut};
use crate::error::IoError;
use crate::formats::usd_reader::{frame_rate, left_out, mesh_data, seen, stated_units};
use crate::mesh_data::{Connectivity, MeshData};
use crate::units::{InputUnits, decide};

/// Triangles that were simulated, and how often cloth crosses cloth, in caches of this program.
const TRIANGLES: &str = "drapery:triangles";
const CROSSINGS: &str = "drapery:crossings";

/// Most frames of a stage: an hour of film.
const MOST_FRAMES: f64 = 100_000.0;

/// A time this close to a whole frame is that frame.
const WHOLE_FRAME: f64 = 1e-3;

/// Bounds are compared relative to the size of the mesh; positions are f32.
const BOUNDS_TOLERANCE: f32 = 1e-5;

/// Where points are counted from, and the points.
type Shifted = ([f64; 3], Vec<[f32; 3]>);

/// A stage whose meshes are read frame by frame.
pub(super) struct StageFrames {
    path: PathBuf,
    stage: Stage,
    /// Frames a second.
    pub(super) fps: f64,
    pub(super) units: InputUnits,
    /// Whether the stage says its unit of length.
    pub(super) states_length: bool,
    /// Time codes of a frame.
    pub(super) codes_per_frame: f64,
    /// Frames and transforms of the meshes.
    meshes: Vec<Mesh>,
    /// What somebody may want to know.
    pub(super) notes: Vec<String>,
}

struct Mesh {
    /// What it is for, if not for everything.
    purpose: Option<String>,
    /// What of it is not handed through, a sentence each.
    left_out: Vec<String>,
    frames: Vec<i64>,
    /// Time codes of the samples between these.
    between: Vec<f64>,
    moves: bool,
    faces_move: bool,
    /// What the transforms make of stored points, where that is a shift that never changes.
    origin: Option<[f64; 3]>,
    /// From stored points to the world, where that never changes.
    fixed: Option<[f64; 16]>,
}

impl fmt::Debug for StageFrames {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("StageFrames").field("path", &self.path).finish()
    }
}

impl StageFrames {
    /// Opens all meshes that are to be seen, whatever their purpose.
    pub(super) fn open(path: &Path) -> Result<(Self, Vec<CacheMesh>), IoError> {
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
        let (path, states_length) = (path.to_owned(), stated.metres.is_some());
        let mut found = Self { path, fps, units, states_length, codes_per_frame, meshes: Vec::new(), notes, stage };
        let mut described = Vec::new();
        for (mesh, place) in places.iter().enumerate() {
            let about = found.stage.about();
            let (name, range, codes) = (about.meshes[*place].path.clone(), about.range, &chosen.codes_of_each[mesh]);
            let purpose = about.meshes[*place].purpose.clone();
            let names = chosen.left_out_of_each[mesh].iter().map(|left| left_out(&name, left));
            let moving = chosen.moving_primvars_of_each[mesh].iter();
            let moving = moving.map(|moving| format!("{name}: {moving} moves, and has its first value in all frames"));
            let left_out = names.chain(moving).collect();
            let frames = found.frames_of(&name, range, codes)?;
            let fixed = found.stage.fixed_to_world(mesh)?;
            let faces_move = found.stage.faces_move(mesh)?;
            found.meshes.push(Mesh {
                purpose,
                left_out,
                between: found.between(&frames, codes),
                frames,
                moves: !codes.is_empty(),
                faces_move,
                origin: fixed.and_then(shift),
                fixed,
            });
            described.push(found.describe(mesh, name)?);
        }
        Ok((found, described))
    }

    /// Whole frames of a mesh: those that the stage says it has, or else those from its first sample to its last.
    fn frames_of(&self, name: &str, range: Option<[f64; 2]>, codes: &[f64]) -> Result<Vec<i64>, IoError> {
        let sampled = || codes.first().copied().zip(codes.last().copied()).map_or([0.0; 2], |(a, b)| [a, b]);
        let range = range.filter(|[first, last]| first.is_finite() && last.is_finite() && first <= last);
        let [first, last] = range.unwrap_or_else(sampled).map(|code| code / self.codes_per_frame);
        if last - first > MOST_FRAMES || first.abs().max(last.abs()) > i64::from(i32::MAX) as f64 {
            let what = format!("its time codes are those of the frames {first} to {last}, which are too many");
            let advice = format!("a cache has at most {MOST_FRAMES} frames; mend startTimeCode and endTimeCode");
            return Err(IoError::data(&self.path, name, what, advice));
        }
        let (from, to) = (first.ceil() as i64, last.floor() as i64);
        // Where all samples lie between two frames, the one before them shows what there is.
        Ok(if from <= to { (from..=to).collect() } else { vec![to] })
    }

    /// Time codes of samples between the first and the last of these frames.
    fn between(&self, frames: &[i64], codes: &[f64]) -> Vec<f64> {
        let (first, last) = (frames[0] as f64, frames[frames.len() - 1] as f64);
        let is_between = |code: &&f64| {
            let time = **code / self.codes_per_frame;
            (time - time.round()).abs() > WHOLE_FRAME && (first..=last).contains(&time)
        };
        codes.iter().filter(is_between).copied().collect()
    }

    fn describe(&mut self, mesh: usize, name: String) -> Result<CacheMesh, IoError> {
        let code = self.code(mesh, 0);
        let points: Vec<Vec3> = self.stage.points(mesh, code)?.into_iter().map(Vec3::from).collect();
        let faces = self.stage.faces(mesh, code)?;
        let stored = self.stage.integers(mesh, TRIANGLES, code)?.and_then(|corners| triangles(&corners, points.len()));
        if let Some(stored) = self.stage.stored(mesh, code)?.filter(|stored| stored.extent.is_none()) {
            let what = format!("{name}: no extent at frame {}", self.meshes[mesh].frames[0]);
            self.notes.push(format!("{what}, for {} points: applications have to look for it", stored.points.len()));
        }
        Ok(CacheMesh {
            name,
            points: points.len(),
            triangles: stored.unwrap_or_else(|| cut(&faces.counts, &faces.indices, &points)),
            faces: Connectivity { face_counts: faces.counts, face_indices: faces.indices },
            frames: self.meshes[mesh].frames.clone(),
            between: self.meshes[mesh].between.iter().map(|code| Between::at(code / self.codes_per_frame)).collect(),
        })
    }

    fn code(&self, mesh: usize, sample: usize) -> f64 {
        let Mesh { frames, between, .. } = &self.meshes[mesh];
        match sample.checked_sub(frames.len()) {
            None => frames[sample] as f64 * self.codes_per_frame,
            Some(index) => between[index],
        }
    }

    /// Whether anything of a mesh changes with time.
    pub(super) fn moves(&self, mesh: usize) -> bool {
        self.meshes[mesh].moves
    }

    /// Whether a mesh, or all, can be read as they are meant: an error says what the stage refers to that is not there.
    pub(super) fn check_complete(&self, mesh: Option<&str>) -> Result<(), IoError> {
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

    /// Points in the world, in units and axes of the stage.
    pub(super) fn world(&self, mesh: usize, sample: usize) -> Result<Vec<[f64; 3]>, IoError> {
        Ok(self.stage.points(mesh, self.code(mesh, sample))?)
    }

    /// What is stored, and what it is counted from, where transforms only shift it and stay.
    pub(super) fn shifted(&self, mesh: usize, sample: usize) -> Result<Option<Shifted>, IoError> {
        let Some(origin) = self.meshes[mesh].origin else { return Ok(None) };
        Ok(self.stored(mesh, sample)?.map(|stored| (origin, stored.points)))
    }

    fn stored(&self, mesh: usize, sample: usize) -> Result<Option<Stored>, UsdError> {
        self.stage.stored(mesh, self.code(mesh, sample))
    }

    /// Velocities in the world, in units and axes of the stage, per second.
    pub(super) fn velocities(&self, mesh: usize, sample: usize) -> Result<Option<Vec<[f32; 3]>>, IoError> {
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

    /// All that is stored of a frame; of a mesh that is moved by more than transforms, what is made of it.
    pub(super) fn stored_frame(&self, mesh: usize, sample: usize) -> Result<StoredFrame, IoError> {
        let crossings = self.stage.integers(mesh, CROSSINGS, self.code(mesh, sample))?;
        let crossings = crossings.and_then(|all| u32::try_from(*all.first()?).ok());
        Ok(match self.stored(mesh, sample)? {
            Some(Stored { points, velocities, normals, extent, .. }) => StoredFrame {
                has_bounds_of_points: extent.is_none_or(|extent| contains(extent, &points)),
                positions: points,
                velocities,
                normals,
                crossings,
            },
            None => {
                let positions = self.world(mesh, sample)?.into_iter().map(|p| p.map(|x| x as f32)).collect();
                StoredFrame { positions, velocities: None, normals: None, crossings, has_bounds_of_points: true }
            }
        })
    }

    /// Faces of a frame, where they may be others than those of the first.
    pub(super) fn faces(&self, mesh: usize, sample: usize) -> Result<Option<Connectivity>, IoError> {
        if !self.meshes[mesh].faces_move {
            return Ok(None);
        }
        let faces = self.stage.faces(mesh, self.code(mesh, sample))?;
        Ok(Some(Connectivity { face_counts: faces.counts, face_indices: faces.indices }))
    }

    /// Faces and what is handed through, of the first frame.
    pub(super) fn attributes(&self, mesh: usize, name: &str) -> Result<MeshData, IoError> {
        let data = mesh_data(name.to_owned(), self.stage.mesh(mesh, self.code(mesh, 0))?);
        Ok(MeshData { purpose: self.meshes[mesh].purpose.clone(), ..data })
    }

    /// What a mesh is for, if not for everything.
    pub(super) fn purpose(&self, mesh: usize) -> Option<&str> {
        self.meshes[mesh].purpose.as_deref()
    }

    /// What of a mesh is not handed through, a sentence each.
    pub(super) fn left_out(&self, mesh: usize) -> Vec<String> {
        self.meshes[mesh].left_out.clone()
    }

    /// Meshes that nothing is to be seen of, a sentence each.
    pub(super) fn hidden(&self) -> Vec<String> {
        hidden(self.stage.about()).map(|(path, why)| format!("{path} is left out: {why}")).collect()
    }
}

/// What a stage leaves open.
fn notes_on(about: &About) -> Vec<String> {
    let mut notes = Vec::new();
    if about.default_prim.is_none() {
        notes.push("the stage has no defaultPrim: whoever references it has to name a prim".to_owned());
    }
    if about.range.is_none() {
        notes.push("the stage does not say its first and last time code; frames are those of the samples".to_owned());
    }
    notes.extend(hidden(about).map(|(path, why)| format!("{path} is not looked at: {why}")));
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

/// Triangles of a flat list of corners, if they are corners of a mesh with so many points.
fn triangles(corners: &[i64], points: usize) -> Option<Vec<[u32; 3]>> {
    let corner = |v: i64| u32::try_from(v).ok().filter(|v| (*v as usize) < points);
    corners.as_chunks().0.iter().map(|[a, b, c]| Some([corner(*a)?, corner(*b)?, corner(*c)?])).collect()
}

/// Whether bounds hold all points, up to rounding.
fn contains([low, high]: [[f32; 3]; 2], points: &[[f32; 3]]) -> bool {
    let size = low.iter().chain(&high).fold(0.0_f32, |size, x| size.max(x.abs()));
    let margin = BOUNDS_TOLERANCE * size;
    points.iter().all(|p| (0..3).all(|axis| p[axis] >= low[axis] - margin && p[axis] <= high[axis] + margin))
}
