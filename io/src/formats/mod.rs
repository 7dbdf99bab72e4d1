//! The file formats: which are read, which are written, and what this build leaves out.

pub mod alembic;
pub mod alembic_writer;
#[cfg(feature = "hdf5")]
pub mod hdf5;
pub mod obj;

use std::path::Path;

use crate::cache::{CachePlan, CacheWriter, MeshReader};
use crate::error::IoError;

/// Opens a mesh, or the objects of it whose path fits the pattern.
pub type OpenMesh = fn(&Path, Option<&str>) -> Result<Box<dyn MeshReader>, IoError>;

/// Creates a cache.
pub type CreateCache = fn(&Path, &CachePlan<'_>) -> Result<Box<dyn CacheWriter>, IoError>;

/// A file format.
pub struct Format {
    /// File name extension, which is also its word in the scene file.
    pub extension: &'static str,
    /// One line about it.
    pub summary: &'static str,
    /// How meshes are read from it, if they are.
    pub open: Option<OpenMesh>,
    /// How caches are written to it, if they are.
    pub create: Option<CreateCache>,
    /// Cargo feature that this build lacks, if the format needs one.
    pub left_out: Option<&'static str>,
}

/// All formats.
pub static FORMATS: &[Format] = &[
    Format {
        extension: "abc",
        summary: "Alembic (Ogawa): bodies and garments in, caches out",
        open: Some(|path, pattern| Ok(Box::new(alembic::AlembicMesh::open(path, pattern)?))),
        create: Some(|path, plan| Ok(Box::new(alembic_writer::AlembicWriter::create(path, plan)?))),
        left_out: None,
    },
    Format {
        extension: "obj",
        summary: "Wavefront OBJ: garments and still bodies in",
        open: Some(open_obj),
        create: None,
        left_out: None,
    },
    Format {
        extension: "h5",
        summary: "HDF5: caches out, for analysis",
        open: None,
        create: CREATE_HDF5,
        left_out: if cfg!(feature = "hdf5") { None } else { Some("hdf5") },
    },
];

#[cfg(feature = "hdf5")]
const CREATE_HDF5: Option<CreateCache> = Some(|path, plan| Ok(Box::new(hdf5::Hdf5Writer::create(path, plan)?)));
#[cfg(not(feature = "hdf5"))]
const CREATE_HDF5: Option<CreateCache> = None;

/// The format with this extension or word.
pub fn by_extension(extension: &str) -> Option<&'static Format> {
    FORMATS.iter().find(|format| format.extension.eq_ignore_ascii_case(extension))
}

/// Opens a mesh by the extension of its file.
///
/// # Errors
/// The format is not read here, or its reader fails.
pub fn open_mesh(path: &Path, pattern: Option<&str>) -> Result<Box<dyn MeshReader>, IoError> {
    let extension = path.extension().unwrap_or_default().to_string_lossy();
    let Some(open) = by_extension(&extension).and_then(|format| format.open) else {
        let readable: Vec<String> =
            FORMATS.iter().filter(|f| f.open.is_some()).map(|f| format!(".{}", f.extension)).collect();
        return Err(IoError::Format {
            path: path.to_owned(),
            what: format!("meshes are not read from .{extension} files"),
            advice: format!("export it as one of {}", readable.join(", ")),
        });
    };
    open(path, pattern)
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
