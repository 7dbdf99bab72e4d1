//! The mesh of a garment with everything to hand through to its caches. It is read when a scene is handed out, and again when a
//! cache is begun, so that nobody keeps it in between.

use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use sha2::{Digest, Sha256};

use crate::cache::MeshData;
use crate::error::IoError;

/// How a mesh is read.
type Read = dyn Fn() -> Result<MeshData, IoError> + Send + Sync;

/// A mesh that is read whenever it is needed.
#[derive(Clone)]
pub struct GarmentMesh {
    read: Arc<Read>,
    /// The file, for messages; empty where there is none.
    path: PathBuf,
    object_path: String,
    points: usize,
    digest: [u8; 32],
}

impl fmt::Debug for GarmentMesh {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { path, object_path, points, .. } = self;
        f.debug_struct("GarmentMesh").field("path", path).field("object", object_path).field("points", points).finish()
    }
}

impl GarmentMesh {
    /// A mesh that `read` reads from `path`, and that was read before as `data`.
    pub fn new(
        path: &Path,
        data: &MeshData,
        read: impl Fn() -> Result<MeshData, IoError> + Send + Sync + 'static,
    ) -> Self {
        Self {
            read: Arc::new(read),
            path: path.to_owned(),
            object_path: data.object_path.clone(),
            points: data.mesh.points.len(),
            digest: digest(data),
        }
    }

    /// A mesh that is kept.
    pub fn kept(data: MeshData) -> Self {
        let kept = data.clone();
        Self::new(Path::new(""), &data, move || Ok(kept.clone()))
    }

    /// Full path of the object in its file; empty when the format has no paths.
    pub fn object_path(&self) -> &str {
        &self.object_path
    }

    /// Number of its points.
    pub fn point_count(&self) -> usize {
        self.points
    }

    /// Reads the mesh.
    ///
    /// # Errors
    /// It cannot be read, or has other points or faces than before.
    pub fn read(&self) -> Result<MeshData, IoError> {
        let data = (self.read)()?;
        if digest(&data) == self.digest {
            return Ok(data);
        }
        let what = "the mesh has changed since the run began: it has other points or faces";
        Err(IoError::data(
            &self.path,
            data.object_path,
            what,
            "start the run anew, and leave its files alone until it ends",
        ))
    }
}

/// Digest of what is simulated, points and faces.
fn digest(data: &MeshData) -> [u8; 32] {
    let mut digest = Sha256::new();
    for point in &data.mesh.points {
        point.iter().for_each(|x| digest.update(x.to_le_bytes()));
    }
    for list in [&data.mesh.face_counts, &data.mesh.face_indices] {
        digest.update((list.len() as u64).to_le_bytes());
        list.iter().for_each(|number| digest.update(number.to_le_bytes()));
    }
    digest.finalize().into()
}

#[cfg(test)]
mod tests {
    use drapery_core::Vec3;
    use drapery_core::mesh::PolygonMesh;

    use super::*;

    #[test]
    fn a_mesh_that_has_changed_is_refused_when_it_is_read_again() {
        let of = |points| MeshData::new(PolygonMesh::from_triangles(points, &[[0, 1, 2]]));
        let first = of(vec![Vec3::x(), Vec3::y(), Vec3::z()]);
        let again = first.clone();
        let mesh = GarmentMesh::new(Path::new("skirt.obj"), &first, move || Ok(again.clone()));
        assert_eq!((mesh.read().unwrap(), mesh.point_count()), (first.clone(), 3));
        let other = of(vec![Vec3::x(), Vec3::y(), 1.5 * Vec3::z()]);
        let mesh = GarmentMesh::new(Path::new("skirt.obj"), &first, move || Ok(other.clone()));
        let message = mesh.read().unwrap_err().to_string();
        assert!(message.contains("skirt.obj") && message.contains("has changed"), "{message}");
    }
}
