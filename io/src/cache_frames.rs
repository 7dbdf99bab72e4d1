//! Reading caches back, frame by frame: what comparisons and pages need of an Alembic, HDF5 or USD file, in metres with Y up
//! whatever the file's own unit and axis are.
//!
//! Nothing is kept in memory but the frame that is asked for, and a file that is still being written may be read: only
//! frames that are complete are listed.

mod alembic;
pub(crate) mod rates;
#[cfg(feature = "usd")]
mod stage;
mod transforms;
#[cfg(feature = "usd")]
pub(crate) mod usd;

use std::path::{Path, PathBuf};

use drapery_alembic::Archive;
use drapery_core::Vec3;
use drapery_core::mesh::PolygonMesh;
use globset::escape;

pub use alembic::{faces_of, triangles_of};

use crate::error::IoError;
use crate::formats::alembic_writer::CROSSINGS;
use crate::formats::hdf5::stored;
use crate::formats::open_mesh;
use crate::input_file;
use crate::mesh_data::{Connectivity, MeshData, Uvs};
use crate::units::{InputUnits, LengthUnit, Units, UpAxis};

/// An opened cache.
#[derive(Debug)]
pub struct CacheFrames {
    path: PathBuf,
    units: Units,
    meshes: Vec<CacheMesh>,
    stored: Stored,
}

/// A mesh of a cache.
#[derive(Debug, Clone, PartialEq)]
pub struct CacheMesh {
    /// Full path of the object.
    pub name: String,
    /// Number of points of the first frame.
    pub points: usize,
    /// Faces of the first frame, counter-clockwise.
    pub faces: Connectivity,
    /// The triangles that were simulated, or the faces cut into triangles.
    pub triangles: Vec<[u32; 3]>,
    /// Frame number of every complete sample, ascending; sample numbers where nobody says the frame rate of the file, or none of
    /// them is a whole frame ([`CacheFrames::counts_samples`]). Of files with several samples a frame, whole frames only.
    pub frames: Vec<i64>,
    /// The samples between and around these, ascending. As samples of the cache they are counted behind the frames: the first is
    /// `frames.len()`.
    pub between: Vec<Between>,
}

/// A sample that is no whole frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Between {
    /// The frame before it.
    pub frame: i64,
    /// How far behind that, in frames; between 0 and 1.
    pub behind: f64,
}

impl Between {
    /// At a time in frames.
    pub(crate) fn at(time: f64) -> Self {
        Self { frame: time.floor() as i64, behind: time - time.floor() }
    }
}

/// Positions of a sample as a cache stores them.
#[derive(Debug, Clone, PartialEq)]
pub struct StoredPositions {
    /// Unit and axes of the numbers.
    pub units: Units,
    /// What they are counted from.
    pub origin: [f64; 3],
    /// The positions.
    pub points: Vec<[f32; 3]>,
}

/// All that a cache stores of a frame.
#[derive(Debug, Clone, PartialEq)]
pub struct StoredFrame {
    /// Positions, counted from the cache's origin.
    pub positions: Vec<[f32; 3]>,
    /// Velocities, if there are any.
    pub velocities: Option<Vec<[f32; 3]>>,
    /// Normals at the points, if there are any.
    pub normals: Option<Vec<[f32; 3]>>,
    /// Number of crossings, if the cache counts them.
    pub crossings: Option<u32>,
    /// Whether the bounds that are stored, if any, are those of the positions to the last bit.
    pub has_bounds_of_points: bool,
}

#[derive(Debug)]
enum Stored {
    /// The archive and its samples.
    Alembic(Box<alembic::ArchiveFrames>),
    /// The file, and what its positions are counted from.
    Hdf5(hdf5::File, [f64; 3]),
    /// The layer, and what of it does not move.
    #[cfg(feature = "usd")]
    Usd(Box<drapery_usd::cache::Cache>),
    /// A stage with any meshes, composed.
    #[cfg(feature = "usd")]
    Stage(Box<stage::StageFrames>),
}

impl CacheFrames {
    /// Opens an `.abc` or `.h5` cache, or any stage of USD.
    ///
    /// # Errors
    /// The file is missing, damaged, of another format, or holds no mesh.
    pub fn open(path: &Path) -> Result<Self, IoError> {
        Self::open_as(path, None, None)
    }

    /// The same; of an Alembic file the commit whose tables stand at `root`, if that is given.
    ///
    /// # Errors
    /// As [`CacheFrames::open`].
    pub fn open_at(path: &Path, root: Option<u64>) -> Result<Self, IoError> {
        Self::open_as(path, root, None)
    }

    /// The same; the samples of an Alembic file, which have times, are in frames of this rate whatever the file says.
    ///
    /// # Errors
    /// As [`CacheFrames::open`].
    pub fn open_at_rate(path: &Path, frames_per_second: f64) -> Result<Self, IoError> {
        Self::open_as(path, None, Some(frames_per_second))
    }

    fn open_as(path: &Path, root: Option<u64>, rate: Option<f64>) -> Result<Self, IoError> {
        input_file::open(path)?;
        let extension = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
        match extension.as_str() {
            "abc" => Self::open_alembic(path, root, rate),
            "h5" => {
                input_file::check_for_hdf5(path)?;
                Self::open_hdf5(path).map_err(|source| not_a_cache(path, &source))
            }
            #[cfg(feature = "usd")]
            "usd" => Self::open_usd(path),
            #[cfg(feature = "usd")]
            "usda" | "usdc" | "usdz" => Self::open_stage(path),
            _ => Err(IoError::Format {
                path: path.to_owned(),
                what: format!("files of the kind .{extension} are no caches"),
                advice: "give an .abc, .h5 or .usd file".into(),
            }),
        }
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Unit and axes of the file; metres where its unit is one that caches of this program do not have.
    pub fn units(&self) -> Units {
        self.units
    }

    /// Unit and axes of the file in words, whatever its unit is.
    pub fn unit_in_words(&self) -> String {
        self.input_units().to_string()
    }

    /// Reads the file in this unit and with this axis up from now on, whatever it says of itself.
    pub fn read_in(&mut self, length: Option<LengthUnit>, up: Option<UpAxis>) {
        #[cfg(feature = "usd")]
        if let Stored::Stage(stage) = &mut self.stored {
            stage.units.metres = length.map_or(stage.units.metres, LengthUnit::metres);
            stage.units.up = up.unwrap_or(stage.units.up);
        }
        self.units.length = length.unwrap_or(self.units.length);
        self.units.up = up.unwrap_or(self.units.up);
    }

    /// Whether the file says its unit of length.
    pub fn states_length(&self) -> bool {
        match &self.stored {
            Stored::Alembic(archive) => archive.states_length(),
            #[cfg(feature = "usd")]
            Stored::Stage(stage) => stage.states_length,
            _ => true,
        }
    }

    /// Unit and axes that the numbers of the file are in.
    pub fn input_units(&self) -> InputUnits {
        match &self.stored {
            #[cfg(feature = "usd")]
            Stored::Stage(stage) => stage.units,
            _ => self.units.into(),
        }
    }

    /// What somebody may want to know of a stage of another program, a sentence each.
    pub fn notes(&self) -> &[String] {
        match &self.stored {
            #[cfg(feature = "usd")]
            Stored::Stage(stage) => &stage.notes,
            _ => &[],
        }
    }

    /// What a mesh of a stage is for, in USD's words (`render`, `proxy`, `guide`), if not for everything.
    #[cfg_attr(not(feature = "usd"), allow(unused_variables))]
    pub fn purpose(&self, mesh: usize) -> Option<&str> {
        match &self.stored {
            #[cfg(feature = "usd")]
            Stored::Stage(stage) => stage.purpose(mesh),
            _ => None,
        }
    }

    /// What of a mesh [`CacheFrames::attributes`] and the frames do not hand through, a sentence each.
    ///
    /// # Errors
    /// The mesh cannot be read.
    pub fn left_out(&self, mesh: usize) -> Result<Vec<String>, IoError> {
        match &self.stored {
            Stored::Alembic(archive) => archive.left_out(mesh),
            Stored::Hdf5(..) => Ok(Vec::new()),
            #[cfg(feature = "usd")]
            Stored::Usd(_) => Ok(Vec::new()),
            #[cfg(feature = "usd")]
            Stored::Stage(stage) => Ok(stage.left_out(mesh)),
        }
    }

    /// Meshes of a stage that are no meshes of the cache, since nothing is to be seen of them, a sentence each.
    pub fn hidden(&self) -> Vec<String> {
        match &self.stored {
            #[cfg(feature = "usd")]
            Stored::Stage(stage) => stage.hidden(),
            _ => Vec::new(),
        }
    }

    /// Whether a stage holds all that it refers to and that a mesh needs, or, without one, all meshes.
    ///
    /// # Errors
    /// What is missing or damaged.
    #[cfg_attr(not(feature = "usd"), allow(unused_variables))]
    pub fn check_complete(&self, mesh: Option<usize>) -> Result<(), IoError> {
        match &self.stored {
            #[cfg(feature = "usd")]
            Stored::Stage(stage) => stage.check_complete(mesh.map(|mesh| self.meshes[mesh].name.as_str())),
            _ => Ok(()),
        }
    }

    /// Whether anything of a mesh changes from sample to sample; a stage shows what stands still at all times.
    pub fn moves(&self, mesh: usize) -> bool {
        match &self.stored {
            Stored::Alembic(archive) => archive.moves(mesh),
            #[cfg(feature = "usd")]
            Stored::Stage(stage) => stage.moves(mesh),
            _ => true,
        }
    }

    /// Whether the frames of a mesh are but numbers of its samples: nobody says the frame rate of the file, or at that rate no
    /// sample is a whole frame.
    pub fn counts_samples(&self, mesh: usize) -> bool {
        matches!(&self.stored, Stored::Alembic(archive) if archive.counts_samples(mesh))
    }

    /// Whether samples have times of their own, so that frames follow from a rate; those of other caches have the frames that
    /// the file says.
    pub fn has_times(&self) -> bool {
        matches!(&self.stored, Stored::Alembic(_))
    }

    /// Its meshes, in the order of their paths.
    pub fn meshes(&self) -> &[CacheMesh] {
        &self.meshes
    }

    /// Frames a second, if the file tells or they were said.
    pub fn fps(&self) -> Option<f64> {
        match &self.stored {
            Stored::Alembic(archive) => archive.fps,
            Stored::Hdf5(file, _) => file.attr("fps").and_then(|fps| fps.read_scalar()).ok(),
            #[cfg(feature = "usd")]
            Stored::Usd(cache) => Some(cache.fps),
            #[cfg(feature = "usd")]
            Stored::Stage(stage) => Some(stage.fps),
        }
    }

    /// Time codes of a stage that a frame takes; 1 in all caches of this program.
    pub fn codes_per_frame(&self) -> f64 {
        match &self.stored {
            #[cfg(feature = "usd")]
            Stored::Stage(stage) => stage.codes_per_frame,
            _ => 1.0,
        }
    }

    /// Positions of a sample of a mesh [m], Y up.
    ///
    /// # Errors
    /// The sample cannot be read.
    pub fn positions(&self, mesh: usize, sample: usize) -> Result<Vec<Vec3>, IoError> {
        let units = self.input_units();
        Ok(self.world_positions(mesh, sample)?.into_iter().map(|p| units.to_si(p)).collect())
    }

    /// Positions of a sample of a mesh in the world, in unit and axes of the file.
    ///
    /// # Errors
    /// The sample cannot be read.
    pub fn world_positions(&self, mesh: usize, sample: usize) -> Result<Vec<Vec3>, IoError> {
        let shifted = |points: Vec<[f32; 3]>, origin: [f64; 3]| {
            points.into_iter().map(|p| Vec3::from(p.map(f64::from)) + Vec3::from(origin)).collect()
        };
        Ok(match &self.stored {
            Stored::Alembic(archive) => archive.world(mesh, sample)?.into_iter().map(Vec3::from).collect(),
            Stored::Hdf5(file, origin) => shifted(self.rows(file, "positions", sample)?, *origin),
            #[cfg(feature = "usd")]
            Stored::Usd(cache) => shifted(usd::frame(cache, sample)?.points, cache.still.origin),
            #[cfg(feature = "usd")]
            Stored::Stage(stage) => stage.world(mesh, sample)?.into_iter().map(Vec3::from).collect(),
        })
    }

    /// Positions of a sample of a mesh as they are stored; `None` if its parents do more than shift them, or of a stage with
    /// another unit than [`CacheFrames::units`].
    ///
    /// # Errors
    /// The sample cannot be read.
    pub fn stored_positions(&self, mesh: usize, sample: usize) -> Result<Option<StoredPositions>, IoError> {
        let (origin, points) = match &self.stored {
            Stored::Alembic(archive) => match archive.shifted(mesh, sample)? {
                Some(shifted) => shifted,
                None => return Ok(None),
            },
            Stored::Hdf5(file, origin) => (*origin, self.rows(file, "positions", sample)?),
            #[cfg(feature = "usd")]
            Stored::Usd(cache) => (cache.still.origin, usd::frame(cache, sample)?.points),
            #[cfg(feature = "usd")]
            Stored::Stage(stage) => match stage.shifted(mesh, sample)? {
                Some(shifted) if stage.units == self.units.into() => shifted,
                _ => return Ok(None),
            },
        };
        Ok(Some(StoredPositions { units: self.units, origin, points }))
    }

    /// All that the cache stores of a sample of a mesh.
    ///
    /// # Errors
    /// The sample cannot be read.
    pub fn stored_frame(&self, mesh: usize, sample: usize) -> Result<StoredFrame, IoError> {
        match &self.stored {
            Stored::Alembic(archive) => archive.stored_frame(mesh, sample),
            Stored::Hdf5(file, _) => {
                let has = |name: &str| file.link_exists(name);
                let velocities = has("velocities").then(|| self.rows(file, "velocities", sample)).transpose()?;
                let normals = has("normals").then(|| self.rows(file, "normals", sample)).transpose()?;
                let crossings = has(CROSSINGS).then(|| self.number(file, CROSSINGS, sample)).transpose()?;
                let positions = self.rows(file, "positions", sample)?;
                Ok(StoredFrame { positions, velocities, normals, crossings, has_bounds_of_points: true })
            }
            #[cfg(feature = "usd")]
            Stored::Usd(cache) => usd::stored_frame(cache, sample),
            #[cfg(feature = "usd")]
            Stored::Stage(stage) => stage.stored_frame(mesh, sample),
        }
    }

    /// Faces of a sample of a mesh, where they may be others than those of the first.
    ///
    /// # Errors
    /// The sample cannot be read.
    pub fn faces(&self, mesh: usize, sample: usize) -> Result<Option<Connectivity>, IoError> {
        match &self.stored {
            Stored::Alembic(archive) => archive.faces(mesh, sample),
            #[cfg(feature = "usd")]
            Stored::Stage(stage) => stage.faces(mesh, sample),
            _ => Ok(None),
        }
    }

    /// Checks what is the same in all frames (faces, texture coordinates, transforms, attributes) by the digests in the file, if
    /// its format has any.
    ///
    /// # Errors
    /// Something is not what was written, by name.
    pub fn check_constants(&self) -> Result<(), IoError> {
        match &self.stored {
            Stored::Alembic(archive) => archive.check_constants(),
            Stored::Hdf5(..) => Ok(()),
            #[cfg(feature = "usd")]
            Stored::Usd(cache) => usd::check_constants(cache),
            #[cfg(feature = "usd")]
            Stored::Stage(_) => Ok(()),
        }
    }

    /// Velocities of a sample of a mesh [m/s], Y up; `None` when the cache stores none.
    ///
    /// # Errors
    /// The sample cannot be read.
    pub fn velocities(&self, mesh: usize, sample: usize) -> Result<Option<Vec<Vec3>>, IoError> {
        let units = self.input_units();
        let si = |v: [f32; 3]| units.to_si(Vec3::from(v.map(f64::from)));
        Ok(self.world_velocities(mesh, sample)?.map(|rates| rates.into_iter().map(si).collect()))
    }

    /// Velocities of a sample of a mesh in the world, in unit and axes of the file; those that are stored where parents do not
    /// turn or move it.
    ///
    /// # Errors
    /// The sample cannot be read.
    pub(crate) fn world_velocities(&self, mesh: usize, sample: usize) -> Result<Option<Vec<[f32; 3]>>, IoError> {
        match &self.stored {
            Stored::Alembic(archive) => archive.velocities(mesh, sample),
            Stored::Hdf5(file, _) if file.link_exists("velocities") => {
                Ok(Some(self.rows(file, "velocities", sample)?))
            }
            Stored::Hdf5(..) => Ok(None),
            #[cfg(feature = "usd")]
            Stored::Usd(cache) => Ok(usd::frame(cache, sample)?.velocities),
            #[cfg(feature = "usd")]
            Stored::Stage(stage) => stage.velocities(mesh, sample),
        }
    }

    /// Faces, texture coordinates and what else of a mesh is the same in all frames; without points.
    ///
    /// # Errors
    /// They cannot be read.
    pub fn attributes(&self, mesh: usize) -> Result<MeshData, IoError> {
        let described = &self.meshes[mesh];
        let faces = described.faces.clone();
        let polygons =
            PolygonMesh { points: Vec::new(), face_counts: faces.face_counts, face_indices: faces.face_indices };
        let plain = MeshData { object_path: described.name.clone(), ..MeshData::new(polygons) };
        match &self.stored {
            Stored::Alembic(archive) => {
                let reader = open_mesh(&self.path, Some(&escape(&described.name)))?;
                reader.mesh_at(archive.start(mesh))
            }
            Stored::Hdf5(file, _) if file.link_exists("uv_values") => {
                let read = || -> hdf5::Result<Uvs> {
                    let values = stored::dataset::<2>(file, "uv_values")?.0.read_raw::<f32>()?;
                    let indices = stored::values(file, "uv_indices")?;
                    Ok(Uvs { name: String::new(), values: values.as_chunks().0.to_vec(), indices })
                };
                let uvs = read().map_err(|source| not_a_cache(&self.path, &source))?;
                let fits = uvs.indices.len() == plain.mesh.face_indices.len()
                    && uvs.indices.iter().all(|index| (*index as usize) < uvs.values.len());
                if !fits {
                    let what = "the texture coordinates do not fit the faces";
                    return Err(IoError::data(&self.path, "uv_indices", what, "it is damaged; copy it again"));
                }
                Ok(MeshData { uvs: Some(uvs), ..plain })
            }
            Stored::Hdf5(..) => Ok(plain),
            #[cfg(feature = "usd")]
            Stored::Usd(cache) => {
                let reader = open_mesh(&self.path, Some(&escape(&described.name)))?;
                reader.mesh_at(cache.frames[0] as f64 / cache.fps)
            }
            #[cfg(feature = "usd")]
            Stored::Stage(stage) => stage.attributes(mesh, &described.name),
        }
    }

    fn open_alembic(path: &Path, root: Option<u64>, rate: Option<f64>) -> Result<Self, IoError> {
        let archive = root.map_or_else(|| Archive::open(path), |root| Archive::open_at(path, root))?;
        let word = |key: &str| archive.metadata().get(key).unwrap_or_default().to_owned();
        let units = units(&word("lengthUnit"), &word("upAxis"));
        let (archive, meshes) = alembic::ArchiveFrames::of(archive, rate)?;
        Ok(Self { path: path.to_owned(), units, meshes, stored: Stored::Alembic(Box::new(archive)) })
    }

    #[cfg(feature = "usd")]
    fn open_usd(path: &Path) -> Result<Self, IoError> {
        match usd::open(path)? {
            Some((cache, units, mesh)) => {
                Ok(Self { path: path.to_owned(), units, meshes: vec![mesh], stored: Stored::Usd(Box::new(cache)) })
            }
            None => Self::open_stage(path),
        }
    }

    #[cfg(feature = "usd")]
    fn open_stage(path: &Path) -> Result<Self, IoError> {
        let (stage, meshes) = stage::StageFrames::open(path)?;
        let length = LengthUnit::ALL.into_iter().find(|unit| unit.metres() == stage.units.metres).unwrap_or_default();
        let units = Units { length, up: stage.units.up };
        Ok(Self { path: path.to_owned(), units, meshes, stored: Stored::Stage(Box::new(stage)) })
    }

    fn open_hdf5(path: &Path) -> hdf5::Result<Self> {
        let file = hdf5::File::open(path)?;
        let text = |name: &str| -> hdf5::Result<String> {
            Ok(file.attr(name)?.read_scalar::<hdf5::types::VarLenUnicode>()?.to_string())
        };
        let committed = stored::values::<u8>(&file, "committed")?;
        let numbers = stored::values::<i64>(&file, "frame_numbers")?;
        let triangles = stored::dataset::<2>(&file, "triangles")?.0.read_raw::<u32>()?;
        let (_, [_, points, _]) = stored::dataset::<3>(&file, "positions")?;
        let mesh = CacheMesh {
            name: text("object_path")?,
            points,
            faces: Connectivity {
                face_counts: stored::values(&file, "face_counts")?,
                face_indices: stored::values(&file, "face_indices")?,
            },
            triangles: triangles.chunks_exact(3).map(|t| [t[0], t[1], t[2]]).collect(),
            // Frames are committed in ascending order, so the first mark that is missing ends the file.
            frames: numbers.iter().zip(&committed).take_while(|(_, mark)| **mark == 1).map(|(n, _)| *n).collect(),
            between: Vec::new(),
        };
        let units = units(&text("length_unit")?, &text("up_axis")?);
        let origin = stored::origin(&file)?.unwrap_or_default();
        Ok(Self { path: path.to_owned(), units, meshes: vec![mesh], stored: Stored::Hdf5(file, origin) })
    }

    /// The number of a sample as it is stored.
    fn number(&self, file: &hdf5::File, name: &str, sample: usize) -> Result<u32, IoError> {
        let read = || match stored::dataset::<1>(file, name)? {
            (dataset, [samples]) if sample < samples => dataset.read_slice_1d::<u32, _>(sample..=sample),
            (_, extents) => Err(format!("dataset {name} has the extents {extents:?}").into()),
        };
        let values = read().map_err(|source| not_a_cache(&self.path, &source))?;
        Ok(values[0])
    }

    /// The vectors of a sample as they are stored.
    fn rows(&self, file: &hdf5::File, name: &str, sample: usize) -> Result<Vec<[f32; 3]>, IoError> {
        let read = || match stored::dataset::<3>(file, name)? {
            (dataset, [samples, _, 3]) if sample < samples => dataset.read_slice_2d::<f32, _>((sample, .., ..)),
            (_, extents) => Err(format!("dataset {name} has the extents {extents:?}").into()),
        };
        let values = read().map_err(|source| not_a_cache(&self.path, &source))?;
        Ok((0..values.shape()[0]).map(|row| [0, 1, 2].map(|axis| values[[row, axis]])).collect())
    }
}

fn not_a_cache(path: &Path, source: &hdf5::Error) -> IoError {
    IoError::data(path, "HDF5", source.to_string(), "it is damaged, or not a cache of this program")
}

/// Units by their words; metres with Y up where a file does not say.
fn units(length: &str, up: &str) -> Units {
    let length = LengthUnit::ALL.into_iter().find(|unit| unit.word() == length).unwrap_or_default();
    Units { length, up: if up == "Z" { UpAxis::Z } else { UpAxis::Y } }
}

/// Faces cut into triangles by the solver's rule.
fn cut(face_counts: &[u32], corners: &[u32], points: &[Vec3]) -> Vec<[u32; 3]> {
    let mut polygons = PolygonMesh { points: points.to_vec(), ..PolygonMesh::default() };
    let mut start = 0;
    for count in face_counts {
        let face = &corners[start..start + *count as usize];
        start += *count as usize;
        // Points and lines among the faces cross nothing.
        if face.len() > 2 {
            polygons.face_counts.push(*count);
            polygons.face_indices.extend(face);
        }
    }
    polygons.triangulate().0
}
