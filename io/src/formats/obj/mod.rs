//! Wavefront OBJ.

mod read;
mod summary;

use super::Format;
use crate::error::IoError;

/// The format.
pub(super) const FORMAT: Format = Format {
    open: Some(|path, pattern| {
        if pattern.is_some() {
            return Err(IoError::Format {
                path: path.to_owned(),
                what: "an OBJ file is read as a whole; its objects cannot be chosen by path".into(),
                advice: "leave `path` out, or export the object alone".into(),
            });
        }
        Ok(Box::new(read::ObjMesh::open(path)?))
    }),
    ..Format::new("obj", "Wavefront OBJ: garments and still bodies in", summary::summary)
};
