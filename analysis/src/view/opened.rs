//! A run that was opened to be looked at: its caches, and its scene if that can still be read.

use std::fs::Metadata;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use drapery_core::Vec3;
use drapery_core::scene::{BodyShape, ContactSide};
use drapery_io::error::IoError;
use drapery_io::shot_description::ShotDescription;
use drapery_shot::run_record::MANIFEST;
use drapery_shot::run_record::folder::RunFolder;
use serde::Serialize;

use super::arrays::{self, Precision};
use super::contact::{self, Surface};
use super::rest::Rest;
use super::{Field, ViewError};
use crate::drawn::bodies;
use crate::drawn::cloth::{self, Garment};

/// Size of the square that stands for a ground without end, by the size of the cloth.
const GROUND: f64 = 3.0;

/// A mesh of a garment.
pub(super) struct Cloth {
    /// Place among the garments that are drawn.
    garment: usize,
    /// Place in the cache.
    mesh: usize,
    /// Number of the garment in the scene, and its rest shape; `None` where the scene cannot be read.
    rest: Option<(usize, Rest)>,
}

/// An opened run.
pub(super) struct Opened {
    /// Manifest and record.
    pub(super) folder: RunFolder,
    /// The manifest and the caches as they were when they were opened.
    marks: Vec<Mark>,
    /// The garments.
    garments: Vec<Garment>,
    /// Their meshes: the first objects of the page.
    pub(super) cloth: Vec<Cloth>,
    /// The scene; its bodies are the next objects.
    pub(super) shot: Option<ShotDescription>,
    /// Frames that all garments have.
    pub(super) frames: Vec<i64>,
    /// Parts that cannot be shown, with the reason.
    pub(super) notices: Vec<String>,
    /// Middle and size of the cloth at its first frame [m], for the ground.
    around: (Vec3, f64),
    /// The frame that was last looked at for contacts.
    last: Option<(i64, Vec<Surface>)>,
}

/// Length and time of a file: other ones mean that it was written in the meantime.
#[derive(Debug, PartialEq, Eq)]
struct Mark {
    path: PathBuf,
    length: u64,
    changed: Option<SystemTime>,
}

impl Mark {
    fn of(path: PathBuf) -> Self {
        let found = path.metadata().ok();
        let length = found.as_ref().map_or(0, Metadata::len);
        Self { path, length, changed: found.and_then(|found| found.modified().ok()) }
    }

    fn is_current(&self) -> bool {
        *self == Self::of(self.path.clone())
    }
}

/// Description of an object, for the page.
#[derive(Debug, Serialize)]
pub(super) struct About {
    /// Name of the garment or body.
    pub(super) name: String,
    /// `cloth`, `body`, or `ground` for a body without end.
    pub(super) kind: &'static str,
    /// Colour: red, green and blue.
    pub(super) colour: [u8; 3],
    /// Number of points.
    pub(super) points: usize,
    /// Number of triangles.
    pub(super) triangles: usize,
    /// Whether strain, thickness and contact are known.
    pub(super) has_fields: bool,
    /// Name of the material.
    pub(super) material: Option<String>,
    /// Largest strain that the material takes.
    pub(super) strain_limit: Option<f64>,
}

/// Colour of bodies.
const BODY: [u8; 3] = [186, 182, 174];

/// Colour of the ground.
const BELOW: [u8; 3] = [150, 150, 146];

impl Opened {
    /// Reads a run and opens its caches; `known` is the run as it was opened before, whose scene is kept while the attempt is the same.
    ///
    /// # Errors
    /// The folder holds no run, or its manifest cannot be understood.
    pub(super) fn new(path: &Path, known: Option<Self>) -> Result<Self, IoError> {
        // Before the manifest is read, so that no change of it is missed.
        let mut marks = vec![Mark::of(path.join(MANIFEST))];
        let folder = RunFolder::read(path)?;
        let names = cloth::simulated(&folder).flat_map(|garment| &garment.files);
        marks.extend(names.filter_map(|name| folder.cache(name)).map(Mark::of));
        let mut notices = Vec::new();
        let mut garments = Vec::new();
        for garment in cloth::garments(&folder) {
            match garment {
                Ok(garment) => garments.push(garment),
                // A run that has just begun has no caches yet.
                Err(_) if folder.manifest.last_complete_frame.is_none() => {}
                Err(error) => notices.push(error.to_string()),
            }
        }
        let kept = known.filter(|known| known.attempt() == attempt(&folder)).and_then(|known| known.shot);
        let shot = kept.map_or_else(|| crate::drawn::scene(&folder), Ok);
        let shot = shot.map_err(|errors| {
            let first = errors.first().map_or(String::new(), ToString::to_string);
            let what = "bodies, strain, thickness and contact are not shown, because the scene cannot be read";
            notices.push(format!("{what}:\n{first}"));
        });
        let mut opened = Self {
            folder,
            marks,
            frames: cloth::common_frames(&garments),
            garments,
            cloth: Vec::new(),
            shot: shot.ok(),
            notices,
            around: (Vec3::zeros(), 1.0),
            last: None,
        };
        opened.add_cloth();
        opened.around = opened.size();
        Ok(opened)
    }

    /// Whether nothing was written since it was opened.
    pub(super) fn is_current(&self) -> bool {
        self.marks.iter().all(Mark::is_current)
    }

    /// Number of the last attempt, and when it began: another one may write frames again.
    pub(super) fn attempt(&self) -> String {
        attempt(&self.folder)
    }

    fn add_cloth(&mut self) {
        for (garment, drawn) in self.garments.iter().enumerate() {
            for (mesh, about) in drawn.cache.meshes.iter().enumerate() {
                let rest = self.shot.as_ref().and_then(|shot| {
                    let number = shot.scene.garments.iter().position(|known| known.name == drawn.name)?;
                    let description = &shot.scene.garments[number];
                    let points = shot.garments.get(number)?.positions().ok()?;
                    // A cache of another scene, or one of several meshes.
                    if points.len() != about.points || drawn.cache.meshes.len() > 1 {
                        return None;
                    }
                    let of_all = description.thickness;
                    let map = description.maps.get("thickness");
                    let at = |v: usize| map.map_or(of_all, |map| map.at(v, of_all)) as f32;
                    let thickness = (0..points.len()).map(at).collect();
                    Some((number, Rest::new(&points, &about.triangles, thickness)))
                });
                self.cloth.push(Cloth { garment, mesh, rest });
            }
        }
    }

    /// Middle and size of the cloth at its first frame [m].
    fn size(&self) -> (Vec3, f64) {
        let Some(first) = self.frames.first() else { return (Vec3::zeros(), 1.0) };
        let meshes = self.garments.iter().filter_map(|garment| garment.positions(*first).ok()).flatten();
        let points: Vec<Vec3> = meshes.flatten().filter(|p| p.iter().all(|x| x.is_finite())).collect();
        let Some(start) = points.first() else { return (Vec3::zeros(), 1.0) };
        let (low, high) = points.iter().fold((*start, *start), |(low, high), p| (low.inf(p), high.sup(p)));
        (0.5 * (low + high), GROUND * (high - low).max())
    }

    fn bodies(&self) -> usize {
        self.shot.as_ref().map_or(0, |shot| shot.scene.bodies.len())
    }

    /// Number of objects: meshes of cloth, then bodies.
    pub(super) fn objects(&self) -> usize {
        self.cloth.len() + self.bodies()
    }

    /// Description of an object.
    pub(super) fn about(&self, object: usize) -> About {
        if let Some(cloth) = self.cloth.get(object) {
            let garment = &self.garments[cloth.garment];
            let mesh = &garment.cache.meshes[cloth.mesh];
            let listed = cloth::simulated(&self.folder).find(|listed| listed.name == garment.name);
            return About {
                name: garment.name.clone(),
                kind: "cloth",
                colour: garment.colour,
                points: mesh.points,
                triangles: mesh.triangles.len(),
                has_fields: cloth.rest.is_some(),
                material: listed.and_then(|listed| listed.material.clone()),
                strain_limit: listed.and_then(|listed| listed.strain_limit),
            };
        }
        let body = self.shot.as_ref().and_then(|shot| shot.scene.bodies.get(object - self.cloth.len()));
        let mesh = self.frames.first().and_then(|frame| self.body(object, *frame).ok());
        let is_ground = mesh.as_ref().is_some_and(|mesh| mesh.is_ground);
        About {
            name: body.map_or(String::new(), |body| body.name.clone()),
            kind: if is_ground { "ground" } else { "body" },
            colour: if is_ground { BELOW } else { BODY },
            points: mesh.as_ref().map_or(0, |mesh| mesh.positions.len()),
            triangles: mesh.as_ref().map_or(0, |mesh| mesh.triangles.len()),
            has_fields: false,
            material: None,
            strain_limit: None,
        }
    }

    fn body(&self, object: usize, frame: i64) -> Result<bodies::BodyMesh, ViewError> {
        let shot = self.shot.as_ref().ok_or(ViewError::Unknown)?;
        let body = object.checked_sub(self.cloth.len()).filter(|body| *body < shot.scene.bodies.len());
        let body = body.ok_or(ViewError::Unknown)?;
        bodies::at(shot, body, frame, self.around)?.ok_or(ViewError::Unknown)
    }

    /// Triangles of an object.
    pub(super) fn triangles(&self, object: usize) -> Result<Vec<u8>, ViewError> {
        match self.cloth.get(object) {
            Some(cloth) => Ok(arrays::triangles(&self.garments[cloth.garment].cache.meshes[cloth.mesh].triangles)),
            None => {
                let first = self.frames.first().ok_or(ViewError::Unknown)?;
                Ok(arrays::triangles(&self.body(object, *first)?.triangles))
            }
        }
    }

    /// Positions of an object at a frame [m].
    fn positions(&self, object: usize, frame: i64) -> Result<Vec<Vec3>, ViewError> {
        match self.cloth.get(object) {
            Some(cloth) => Ok(self.garments[cloth.garment].positions_of(cloth.mesh, frame)?),
            None => Ok(self.body(object, frame)?.positions),
        }
    }

    /// A quantity of an object at a frame, as an array.
    pub(super) fn field(
        &mut self,
        object: usize,
        frame: i64,
        field: Field,
        short: Precision,
    ) -> Result<Vec<u8>, ViewError> {
        let scalars = |values: &[f32]| arrays::numbers(&values.iter().map(|value| [*value]).collect::<Vec<_>>(), short);
        if field == Field::Points {
            let points: Vec<[f32; 3]> =
                self.positions(object, frame)?.iter().map(|p| (*p).cast::<f32>().into()).collect();
            return Ok(arrays::numbers(&points, short));
        }
        if field == Field::Contact && self.last.as_ref().is_none_or(|(known, _)| *known != frame) {
            self.last = Some((frame, self.surfaces(frame)?));
        }
        let (_, rest) = self.cloth.get(object).and_then(|cloth| cloth.rest.as_ref()).ok_or(ViewError::Unknown)?;
        match field {
            Field::Thickness => Ok(scalars(&rest.thickness)),
            Field::Strain => Ok(scalars(&rest.strain(&self.positions(object, frame)?))),
            _ => Ok(scalars(&self.contact(object).ok_or(ViewError::Unknown)?)),
        }
    }

    /// All surfaces at a frame, those of cloth first.
    fn surfaces(&self, frame: i64) -> Result<Vec<Surface>, ViewError> {
        let shot = self.shot.as_ref().ok_or(ViewError::Unknown)?;
        let mut surfaces = Vec::new();
        for (object, cloth) in self.cloth.iter().enumerate() {
            let Some((number, _)) = cloth.rest else { continue };
            let triangles = self.garments[cloth.garment].cache.meshes[cloth.mesh].triangles.clone();
            let positions = self.positions(object, frame)?;
            surfaces.push(Surface::mesh(ContactSide::Garment(number), cloth.mesh, positions, triangles));
        }
        let time = shot.scene.timeline.time(frame);
        for (number, body) in shot.scene.bodies.iter().enumerate() {
            let side = ContactSide::Body(number);
            surfaces.push(match &body.shape {
                BodyShape::Rigid(shape) => Surface::rigid(side, *shape, body.motion.clone(), time),
                BodyShape::Surface { triangles, .. } => {
                    let positions = self.positions(self.cloth.len() + number, frame)?;
                    Surface::mesh(side, 0, positions, triangles.clone())
                }
            });
        }
        Ok(surfaces)
    }

    /// Shares of contact of an object at the frame that was last looked at.
    fn contact(&self, object: usize) -> Option<Vec<f32>> {
        let (shot, (_, surfaces)) = (self.shot.as_ref()?, self.last.as_ref()?);
        let cloth = &self.cloth[object];
        let (number, rest) = cloth.rest.as_ref()?;
        let own = ContactSide::Garment(*number);
        let points = surfaces.iter().find(|surface| surface.side == own && surface.mesh == cloth.mesh)?.positions();
        Some(contact::shares(&shot.scene, (*number, cloth.mesh), points, rest, surfaces))
    }
}

fn attempt(folder: &RunFolder) -> String {
    folder.manifest.attempts.last().map_or(String::new(), |attempt| format!("{} {}", attempt.attempt, attempt.began))
}
