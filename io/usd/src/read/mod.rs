//! Stages: meshes with their transforms, time samples and skeletons.
//!
//! A stage is what `openusd` composes of its layers: sublayers, references, payloads, variants as they are selected, value clips,
//! instances. Everything above that is done here: which meshes are rendered ([`Entry::skipped`]), transforms, points in the world at
//! any time code, characters moved by a skeleton (`UsdSkel`), meshes at the places of a `PointInstancer`.
//!
//! Limits. A layer is held in memory as a whole, and so are all samples of an attribute that is read, unless they are value clips.
//! Point instancers within others, and characters that they place, are not read.
//!
//! Damage. Layers come through `Guard`, which refuses what is no regular file and what promises far more than it holds.
//! `openusd` runs on a thread of its own; where it panics, that is an error of the file like any other, and
//! [`answers_panics`] tells the program's panic hook to be silent.

mod blend_shapes;
mod classes;
mod error;
mod guard;
mod instancer;
mod left_out;
mod matrix;
mod mesh;
mod primvars;
pub(crate) mod promises;
mod reading;
mod session;
mod skeleton;
mod skin;
mod transform;
mod values;
mod worker;

use std::path::{Path, PathBuf};

pub use error::{UsdError, UsdErrorKind};
pub use worker::answers_panics;

use crate::Interpolation;
use crate::material::BoundMaterial;
use session::{Failure, Session};
use worker::{Panicked, Worker};

/// A mesh of a stage.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Entry {
    /// Path of its prim; of a prototype that lies elsewhere, behind the path of its `PointInstancer`.
    pub path: String,
    /// Why nothing is to be seen of it: its visibility, or that it is only a prototype.
    pub hidden: Option<String>,
    /// Purpose, if it is not for everything: `render`, `proxy` or `guide`.
    pub purpose: Option<String>,
    /// Whose prototype it is a part of, to be seen at all places of that.
    pub(crate) prototype: Option<instancer::Prototype>,
    /// Whether it is under a `SkelRoot`, so that a skeleton may move it.
    pub(crate) skinnable: bool,
}

impl Entry {
    /// Why it is not part of what is rendered, if it is not: its purpose, or that it is hidden.
    pub fn skipped(&self) -> Option<String> {
        match self.purpose.as_deref() {
            Some(purpose @ ("proxy" | "guide")) => Some(format!("its purpose is {purpose}")),
            _ => self.hidden.clone(),
        }
    }
}

/// Description that a stage gives of itself.
#[derive(Debug, Clone, Default)]
pub struct About {
    /// Length of a unit [m], where a layer says so; USD's default is 0.01.
    pub metres_per_unit: Option<f64>,
    /// Axis that points up, where a layer says so; USD's default is Y.
    pub up_axis: Option<String>,
    /// Time codes per second.
    pub codes_per_second: f64,
    /// Frames per second, where a layer says so; otherwise a time code is a frame.
    pub frames_per_second: Option<f64>,
    /// First and last time code, where a layer says so.
    pub range: Option<[f64; 2]>,
    /// Name of the prim that stands for the stage.
    pub default_prim: Option<String>,
    /// Texts of `customLayerData` of the file itself: name and text.
    pub custom: Vec<(String, String)>,
    /// Meshes, in the order of their paths.
    pub meshes: Vec<Entry>,
    /// Other prims, the first thousand: path and type.
    pub others: Vec<(String, String)>,
    /// Faults of the composition: path of the prim (empty for the whole stage), and the error.
    pub flaws: Vec<(String, UsdError)>,
    /// Files that it is made of, as far as they are open.
    pub layers: Vec<PathBuf>,
}

/// Information about meshes that were chosen.
#[derive(Debug, Clone, Default)]
pub struct Chosen {
    /// Time codes at which something of them is stored, ascending; none when nothing moves.
    pub codes: Vec<f64>,
    /// The same of each of them, in the order in which they were chosen.
    pub codes_of_each: Vec<Vec<f64>>,
    /// Remarks that may be of interest to a user.
    pub notes: Vec<String>,
    /// Data that each of them has and that are not read, a few words each.
    pub left_out_of_each: Vec<Vec<String>>,
    /// Primvars of each of them that move, by their names.
    pub moving_primvars_of_each: Vec<Vec<String>>,
    /// Files that the stage is made of.
    pub layers: Vec<PathBuf>,
}

/// Faces of a mesh, counter-clockwise in the world as seen from outside.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Faces {
    /// Number of corners of each.
    pub counts: Vec<u32>,
    /// Point of each corner, face by face.
    pub indices: Vec<u32>,
}

/// A set of faces (`GeomSubset`).
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Subset {
    /// Name of its prim.
    pub name: String,
    /// Faces, ascending.
    pub faces: Vec<u32>,
    /// The material that it is bound to.
    pub material: Option<BoundMaterial>,
}

/// Type of a number, or a text.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[allow(missing_docs)] // the names say all
pub enum Element {
    Bool,
    U8,
    I32,
    U32,
    I64,
    U64,
    F16,
    F32,
    F64,
    Text,
}

impl Element {
    /// Bytes of one; 0 for a text.
    fn size(self) -> usize {
        match self {
            Self::Text => 0,
            Self::Bool | Self::U8 => 1,
            Self::F16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::I64 | Self::U64 | Self::F64 => 8,
        }
    }
}

/// Meaning of the numbers of a primvar, or whether its texts are words that programs know.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[allow(missing_docs)] // the names say all
pub enum Meaning {
    Numbers,
    Colour,
    Point,
    Normal,
    Vector,
    TextureCoordinate,
    Token,
}

/// An attribute of a mesh that is handed through.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Primvar {
    /// Its name, without `primvars:`.
    pub name: String,
    /// Part of the mesh that one value belongs to; corners are in the order of [`Faces`].
    pub interpolation: Interpolation,
    /// Type of its numbers.
    pub element: Element,
    /// Numbers that make a value.
    pub extent: u8,
    /// Meaning of the numbers.
    pub meaning: Meaning,
    /// The values as bytes, little end first; each text ends with a zero.
    pub values: Vec<u8>,
    /// Value used at each place, when values are shared.
    pub indices: Option<Vec<u32>>,
}

/// A mesh at a time code.
#[derive(Debug, Clone, PartialEq)]
pub struct MeshSample {
    /// Points in the world, in units and axes of the stage.
    pub points: Vec<[f64; 3]>,
    /// Its faces.
    pub faces: Faces,
    /// Sets of its faces.
    pub subsets: Vec<Subset>,
    /// Attributes that are handed through.
    pub primvars: Vec<Primvar>,
    /// Normals of face corners or faces, of meshes that are rendered as they are; of a cache of this program, the number of each
    /// corner's normal.
    pub normals: Option<Primvar>,
    /// USD's word for how it is rendered: `none`, `catmullClark`, `loop`, `bilinear`.
    pub subdivision: String,
    /// The material that it is bound to.
    pub material: Option<BoundMaterial>,
    /// Whether both sides of it are rendered, where that is said.
    pub double_sided: Option<bool>,
    /// The garment that it follows to be rendered in its place, if a cache of this program says so.
    pub render_mesh_of: Option<String>,
}

/// Data that a mesh stores at a time code, before any processing.
#[derive(Debug, Clone, PartialEq)]
pub struct Stored {
    /// Points in its own space.
    pub points: Vec<[f32; 3]>,
    /// Velocities in its own space [units per second].
    pub velocities: Option<Vec<[f32; 3]>>,
    /// Normals in its own space, if there is one for each point.
    pub normals: Option<Vec<[f32; 3]>>,
    /// Bounds that the file promises for the points, in its own space.
    pub extent: Option<[[f32; 3]; 2]>,
    /// From its own space to the world, for row vectors, row by row.
    pub to_world: [f64; 16],
}

/// An attribute that holds numbers, and changes over time or is custom.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Channel {
    /// Path of its prim.
    pub prim: String,
    /// Its name.
    pub attribute: String,
    /// Numbers of the first sample.
    pub numbers: usize,
    /// Number of samples: 1 if it never changes.
    pub samples: usize,
}

/// An opened stage.
pub struct Stage {
    path: PathBuf,
    about: About,
    worker: Worker<Session>,
}

impl Stage {
    /// Opens a `.usd`, `.usda`, `.usdc` or `.usdz` file with everything that it refers to.
    ///
    /// # Errors
    /// The file is missing or damaged, or it or a layer that it needs promises more than it holds. What is missing below single
    /// prims is in [`About::flaws`].
    pub fn open(path: &Path) -> Result<Self, UsdError> {
        let (sender, answers) = std::sync::mpsc::channel();
        let file = path.to_owned();
        let make = move || {
            let (session, about) = Session::open(&file).map_err(Failure)?;
            // Opening waits for this.
            drop(sender.send(about));
            Ok(session)
        };
        let worker = Worker::start(make).map_err(|Failure(error)| at(path, error))?;
        let about = answers.try_recv().unwrap_or_default();
        Ok(Self { path: path.to_owned(), about, worker })
    }

    /// Returns the description that the stage gives of itself.
    pub fn about(&self) -> &About {
        &self.about
    }

    /// Chooses meshes, by their places in [`About::meshes`]; they are then known by their places in this list.
    ///
    /// # Errors
    /// One of them contradicts itself, or its skeleton does.
    pub fn choose(&self, meshes: &[usize]) -> Result<Chosen, UsdError> {
        let entries: Vec<Entry> = meshes.iter().filter_map(|mesh| self.about.meshes.get(*mesh)).cloned().collect();
        self.ask(move |session| session.choose(&entries))
    }

    /// Points of a chosen mesh in the world, as USD has them at a time code; outside the samples those of the nearest one.
    ///
    /// # Errors
    /// The mesh contradicts itself.
    pub fn points(&self, mesh: usize, code: f64) -> Result<Vec<[f64; 3]>, UsdError> {
        self.ask(move |session| session.meshes.borrow()[mesh].points(&session.reading, code))
    }

    /// Faces of a chosen mesh at a time code.
    ///
    /// # Errors
    /// The mesh contradicts itself.
    pub fn faces(&self, mesh: usize, code: f64) -> Result<Faces, UsdError> {
        self.ask(move |session| session.meshes.borrow()[mesh].faces(&session.reading, code))
    }

    /// Whether a chosen mesh has samples of its faces, so that they may change.
    ///
    /// # Errors
    /// The library gave up earlier.
    pub fn faces_move(&self, mesh: usize) -> Result<bool, UsdError> {
        self.ask(move |session| Ok(session.meshes.borrow()[mesh].faces_move()))
    }

    /// Returns the data that a chosen mesh stores at a time code; `None` where more than transforms makes its points
    /// of them.
    ///
    /// # Errors
    /// The mesh contradicts itself.
    pub fn stored(&self, mesh: usize, code: f64) -> Result<Option<Stored>, UsdError> {
        self.ask(move |session| session.meshes.borrow()[mesh].stored(&session.reading, code))
    }

    /// From the space of a chosen mesh to the world at a time code, for row vectors, row by row.
    ///
    /// # Errors
    /// A transform contradicts itself.
    pub fn to_world(&self, mesh: usize, code: f64) -> Result<[f64; 16], UsdError> {
        self.ask(move |session| session.meshes.borrow()[mesh].to_world(&session.reading, code))
    }

    /// The same where it never changes and is all that is between what is stored and the world; `None` otherwise.
    ///
    /// # Errors
    /// A transform contradicts itself.
    pub fn fixed_to_world(&self, mesh: usize) -> Result<Option<[f64; 16]>, UsdError> {
        self.ask(move |session| session.meshes.borrow()[mesh].fixed_to_world(&session.reading))
    }

    /// Whole numbers that an attribute of a chosen mesh holds at a time code, those of vectors one after the other; `None` when it
    /// has no such attribute.
    ///
    /// # Errors
    /// The attribute cannot be read.
    pub fn integers(&self, mesh: usize, attribute: &str, code: f64) -> Result<Option<Vec<i64>>, UsdError> {
        let name = attribute.to_owned();
        self.ask(move |session| session.meshes.borrow()[mesh].integers(&session.reading, &name, code))
    }

    /// Numbers in single precision that an attribute of a chosen mesh holds at a time code, those of vectors one after the other;
    /// `None` when it has no such attribute.
    ///
    /// # Errors
    /// The attribute cannot be read.
    pub fn floats(&self, mesh: usize, attribute: &str, code: f64) -> Result<Option<Vec<f32>>, UsdError> {
        let name = attribute.to_owned();
        self.ask(move |session| session.meshes.borrow()[mesh].floats(&session.reading, &name, code))
    }

    /// Text that an attribute of a chosen mesh holds; `None` when it has no such attribute.
    ///
    /// # Errors
    /// The attribute cannot be read.
    pub fn text(&self, mesh: usize, attribute: &str) -> Result<Option<String>, UsdError> {
        let name = attribute.to_owned();
        self.ask(move |session| session.meshes.borrow()[mesh].text(&session.reading, &name))
    }

    /// A chosen mesh at a time code, with what is handed through.
    ///
    /// # Errors
    /// The mesh contradicts itself.
    pub fn mesh(&self, mesh: usize, code: f64) -> Result<MeshSample, UsdError> {
        self.ask(move |session| session.meshes.borrow()[mesh].read(&session.reading, code))
    }

    /// Attributes of the prims that [`About`] lists that hold numbers and either change over time or are custom, without primvars.
    ///
    /// # Errors
    /// A layer is damaged.
    pub fn channels(&self) -> Result<Vec<Channel>, UsdError> {
        let meshes = self.about.meshes.iter().filter(|mesh| mesh.prototype.is_none()).map(|mesh| &mesh.path);
        let prims: Vec<String> = self.about.others.iter().map(|(path, _)| path).chain(meshes).cloned().collect();
        self.ask(move |session| session.channels(&prims))
    }

    /// Samples of an attribute of any prim, each a time code and its numbers; one sample, at 0, of a value that never changes.
    ///
    /// # Errors
    /// There is no such prim or attribute, or it holds no numbers.
    pub fn numbers(&self, prim: &str, attribute: &str) -> Result<Vec<(f64, Vec<f64>)>, UsdError> {
        let (prim, attribute) = (prim.to_owned(), attribute.to_owned());
        self.ask(move |session| session.numbers(&prim, &attribute))
    }

    fn ask<T: Send + 'static>(
        &self,
        question: impl FnOnce(&Session) -> Result<T, UsdError> + Send + 'static,
    ) -> Result<T, UsdError> {
        let answer = self.worker.ask(question);
        answer.map_err(|panicked: Panicked| at(&self.path, Failure::from(panicked).0))?
    }
}

/// The error with the file that it belongs to.
fn at(path: &Path, error: UsdError) -> UsdError {
    UsdError { path: path.to_owned(), ..error }
}
