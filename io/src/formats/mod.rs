//! The file formats: which are read and which are written.

pub mod alembic;
mod alembic_summary;
pub mod alembic_writer;
mod continuing;
pub mod hdf5;
mod obj;
#[cfg(feature = "usd")]
pub(crate) mod usd_reader;
#[cfg(feature = "usd")]
pub(crate) mod usd_writer;

use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use crate::cache::{CacheMark, CachePlan, CacheWriter};
use crate::error::IoError;
use crate::file_summary::FileSummary;
use crate::input_file;
use crate::mesh_data::MeshReader;
use crate::units::Units;

/// Opens a mesh, or the objects of it whose path fits the pattern.
pub type OpenMesh = fn(&Path, Option<&str>) -> Result<Box<dyn MeshReader>, IoError>;

/// Creates a cache.
pub type CreateCache = fn(&Path, &CachePlan<'_>) -> Result<Box<dyn CacheWriter>, IoError>;

/// Opens a cache to go on after its mark: what is behind the mark is cut off. The final file has the bytes of one that
/// was written without a break.
///
/// A cache that is missing, damaged or was made with another plan is an error that says what to do, and stays as it is.
/// Only the last frame may be another than planned before, as long as it is not before a frame that the file holds.
pub type ResumeCache = fn(&Path, &CachePlan<'_>, &CacheMark) -> Result<Box<dyn CacheWriter>, IoError>;

/// Looks into a file.
pub type Summarise = fn(&Path) -> Result<FileSummary, IoError>;

/// The caches of a shot in one format.
#[derive(Debug)]
pub struct ShotFiles<'a> {
    /// Name of the shot.
    pub name: &'a str,
    /// Units and up axis of the caches.
    pub units: Units,
    /// Frames per second.
    pub fps: f64,
    /// First and last frame that are complete in all of them.
    pub frames: [i64; 2],
    /// Their caches.
    pub caches: Vec<ShotCache<'a>>,
}

/// A cache of a shot.
#[derive(Debug)]
pub struct ShotCache<'a> {
    /// Name of the garment or render mesh.
    pub name: &'a str,
    /// Name of the file, in the same folder.
    pub file: String,
    /// Whether it is to be seen where a render mesh and the garment that it follows are there.
    pub part: Part,
}

/// What is rendered of a garment.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Part {
    /// The garment itself.
    Alone,
    /// The garment, in the place of which a render mesh is rendered.
    Followed,
    /// The render mesh of a garment.
    RenderMesh,
}

/// One file that ties the caches of a shot together.
pub struct ShotFormat {
    /// Its extension, behind the name of the shot.
    pub extension: &'static str,
    /// Writes it, or replaces it as a whole.
    pub write: fn(&Path, &ShotFiles<'_>) -> Result<(), IoError>,
}

/// A file format.
pub struct Format {
    /// File name extension, which is also its word in the scene file.
    pub extension: &'static str,
    /// One line about it.
    pub summary: &'static str,
    /// Whether Blender, Houdini, Maya or other applications load caches in it.
    pub opens_in_applications: bool,
    /// Whether its caches hold whole frames alone, and no samples between them.
    pub whole_frames: bool,
    /// How meshes are read from it, if they are.
    pub open: Option<OpenMesh>,
    /// How caches are written to it, if they are.
    pub create: Option<CreateCache>,
    /// How caches in it are continued, if they are written.
    pub resume: Option<ResumeCache>,
    /// What a file of it holds.
    pub summary_of: Summarise,
    /// The folder beside a cache that holds a part of it, if there is one.
    pub folder_of: Option<fn(&Path) -> PathBuf>,
    /// The file over all caches of a shot, if there is one.
    pub shot: Option<ShotFormat>,
}

/// All formats.
pub static FORMATS: &[Format] = &[
    Format {
        extension: "abc",
        summary: "Alembic (Ogawa): bodies and garments in, caches out",
        opens_in_applications: true,
        whole_frames: false,
        open: Some(|path, pattern| Ok(Box::new(alembic::AlembicMesh::open(path, pattern)?))),
        create: Some(|path, plan| Ok(Box::new(alembic_writer::AlembicWriter::create(path, plan)?))),
        resume: Some(|path, plan, mark| Ok(Box::new(alembic_writer::AlembicWriter::resume(path, plan, mark)?))),
        summary_of: alembic_summary::summary,
        folder_of: None,
        shot: None,
    },
    Format {
        extension: "obj",
        summary: "Wavefront OBJ: garments and still bodies in",
        opens_in_applications: true,
        whole_frames: false,
        open: Some(open_obj),
        create: None,
        resume: None,
        summary_of: obj::summary,
        folder_of: None,
        shot: None,
    },
    Format {
        extension: "h5",
        summary: "HDF5: caches out, for analysis",
        opens_in_applications: false,
        whole_frames: true,
        open: None,
        create: Some(|path, plan| Ok(Box::new(hdf5::Hdf5Writer::create(path, plan)?))),
        resume: Some(|path, plan, mark| Ok(Box::new(hdf5::Hdf5Writer::resume(path, plan, mark)?))),
        summary_of: hdf5::summary,
        folder_of: None,
        shot: None,
    },
    #[cfg(feature = "usd")]
    Format {
        create: Some(|path, plan| Ok(Box::new(usd_writer::UsdWriter::create(path, plan)))),
        resume: Some(|path, plan, mark| Ok(Box::new(usd_writer::UsdWriter::resume(path, plan, mark)?))),
        folder_of: Some(usd_writer::clips_of),
        shot: Some(ShotFormat { extension: "usda", write: usd_writer::write_shot }),
        ..usd("usd", "USD, text or binary: bodies and garments in; caches out, a layer over value clips")
    },
    #[cfg(feature = "usd")]
    usd("usda", "USD as text: bodies and garments in"),
    #[cfg(feature = "usd")]
    usd("usdc", "USD, binary: bodies and garments in"),
    #[cfg(feature = "usd")]
    usd("usdz", "USD as a package: bodies and garments in"),
];

/// A spelling of USD, which is read alike in all of them.
#[cfg(feature = "usd")]
const fn usd(extension: &'static str, summary: &'static str) -> Format {
    Format {
        extension,
        summary,
        opens_in_applications: true,
        whole_frames: false,
        open: Some(|path, pattern| Ok(Box::new(usd_reader::UsdMesh::open(path, pattern)?))),
        create: None,
        resume: None,
        summary_of: usd_reader::summary,
        folder_of: None,
        shot: None,
    }
}

/// The format with this extension or word.
pub fn by_extension(extension: &str) -> Option<&'static Format> {
    FORMATS.iter().find(|format| format.extension.eq_ignore_ascii_case(extension))
}

/// Whether a cache of this name holds whole frames alone.
pub fn holds_whole_frames(cache: &Path) -> bool {
    let extension = cache.extension().unwrap_or_default().to_string_lossy();
    by_extension(&extension).is_some_and(|format| format.whole_frames)
}

/// The folder that holds a part of a cache, if its format has one.
pub fn folder_of(cache: &Path) -> Option<PathBuf> {
    let extension = cache.extension().unwrap_or_default().to_string_lossy();
    by_extension(&extension)?.folder_of.map(|folder_of| folder_of(cache))
}

/// Removes a folder with all that is in it, if it exists; of a link, the link.
///
/// # Errors
/// The disk refuses.
pub fn remove_folder(path: &Path) -> Result<(), IoError> {
    let removed = match fs::symlink_metadata(path) {
        Ok(about) if about.is_dir() => fs::remove_dir_all(path),
        Ok(_) => fs::remove_file(path),
        Err(e) => Err(e),
    };
    match removed {
        Err(e) if e.kind() != ErrorKind::NotFound => Err(IoError::creating(path, e)),
        _ => Ok(()),
    }
}

/// Opens a mesh by the extension of its file.
///
/// # Errors
/// The format is not read here, or its reader fails.
pub fn open_mesh(path: &Path, pattern: Option<&str>) -> Result<Box<dyn MeshReader>, IoError> {
    let extension = path.extension().unwrap_or_default().to_string_lossy();
    let Some(open) = by_extension(&extension).and_then(|format| format.open) else {
        return Err(IoError::Format {
            path: path.to_owned(),
            what: format!("meshes are not read from .{extension} files"),
            advice: match extension.to_lowercase().starts_with("usd") {
                // Only a build without USD comes here with it.
                true => "this program was built without USD: use one that `make build` makes, or export an .abc".into(),
                false => format!("export it as one of {}", endings(|format| format.open.is_some())),
            },
        });
    };
    open(path, pattern)
}

/// Whether a panic on this thread becomes an error of a file, of which somebody tells the user: of the library that reads USD.
pub fn answers_panics() -> bool {
    #[cfg(feature = "usd")]
    let answers = drapery_usd::read::answers_panics();
    #[cfg(not(feature = "usd"))]
    let answers = false;
    answers
}

/// Extensions of some formats.
fn endings(which: fn(&Format) -> bool) -> String {
    let all: Vec<String> = FORMATS.iter().filter(|f| which(f)).map(|f| format!(".{}", f.extension)).collect();
    all.join(", ")
}

/// Looks into a file.
///
/// # Errors
/// The file is missing, damaged, or of a format that is not read here.
pub fn inspect(path: &Path) -> Result<FileSummary, IoError> {
    input_file::open(path)?;
    let extension = path.extension().unwrap_or_default().to_string_lossy();
    let Some(format) = by_extension(&extension) else {
        return Err(IoError::Format {
            path: path.to_owned(),
            what: format!("files of the kind .{} cannot be looked into", extension.to_lowercase()),
            advice: format!("give a file that ends in {}", endings(|_| true)),
        });
    };
    (format.summary_of)(path)
}

fn open_obj(path: &Path, pattern: Option<&str>) -> Result<Box<dyn MeshReader>, IoError> {
    if pattern.is_some() {
        return Err(IoError::Format {
            path: path.to_owned(),
            what: "an OBJ file is read as a whole; its objects cannot be chosen by path".into(),
            advice: "leave `path` out, or export the object alone".into(),
        });
    }
    Ok(Box::new(obj::ObjMesh::open(path)?))
}
