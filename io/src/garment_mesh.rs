//! The mesh of a garment. Points and faces are read piece by piece when a scene is handed out; everything, with what is handed
//! through to caches, when a cache is begun. Nobody keeps it in between.

use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use drapery_core::Vec3;
use drapery_core::mesh::MeshStream;
use drapery_core::setup::simulated_triangles;
use sha2::{Digest, Sha256};

use crate::error::IoError;
use crate::mesh_cut::into_triangles;
use crate::mesh_data::MeshData;
use crate::units::InputUnits;

/// Reader of the mesh of a garment.
pub trait GarmentReader: Send + Sync {
    /// Reads all of it.
    ///
    /// # Errors
    /// It cannot be read.
    fn read(&self) -> Result<MeshData, IoError>;

    /// Gives the positions [m] piece by piece, in order.
    ///
    /// # Errors
    /// They cannot be read.
    fn points(&self, take: &mut dyn FnMut(&[Vec3])) -> Result<(), IoError>;

    /// Gives the faces piece by piece, in order: the number of corners of each, and the point of each corner.
    ///
    /// # Errors
    /// They cannot be read.
    fn faces(&self, take: &mut dyn FnMut(&[u32], &[u32])) -> Result<(), IoError>;

    /// Unit and up axis in which its file is read; `None` for a mesh of no file.
    fn units(&self) -> Option<InputUnits> {
        None
    }
}

/// A mesh in memory.
struct Kept(MeshData);

impl GarmentReader for Kept {
    fn read(&self) -> Result<MeshData, IoError> {
        Ok(self.0.clone())
    }

    fn points(&self, take: &mut dyn FnMut(&[Vec3])) -> Result<(), IoError> {
        take(&self.0.mesh.points);
        Ok(())
    }

    fn faces(&self, take: &mut dyn FnMut(&[u32], &[u32])) -> Result<(), IoError> {
        take(&self.0.mesh.face_counts, &self.0.mesh.face_indices);
        Ok(())
    }
}

/// A mesh that is read whenever it is needed, and is then what it was.
#[derive(Clone)]
pub struct GarmentMesh {
    reader: Arc<dyn GarmentReader>,
    /// The file, for messages; empty where there is none.
    path: PathBuf,
    object_path: String,
    points: usize,
    faces: usize,
    digest: [u8; 32],
}

impl fmt::Debug for GarmentMesh {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { object_path, points, faces, digest, .. } = self;
        let mut all = f.debug_struct("GarmentMesh");
        all.field("object", object_path).field("points", points).field("faces", faces).field("digest", digest).finish()
    }
}

impl GarmentMesh {
    /// A mesh of `path`, and of this object in it; it is read once, piece by piece.
    ///
    /// # Errors
    /// It cannot be read.
    pub fn new(path: &Path, object_path: String, reader: impl GarmentReader + 'static) -> Result<Self, IoError> {
        let mut seen = Seen::default();
        reader.points(&mut |points| seen.points(points))?;
        reader.faces(&mut |counts, corners| seen.faces(counts, corners))?;
        let (points, faces, digest) = (seen.points, seen.faces, seen.digest.finalize().into());
        Ok(Self { reader: Arc::new(reader), path: path.to_owned(), object_path, points, faces, digest })
    }

    /// A mesh that is kept in memory.
    pub fn kept(data: MeshData) -> Self {
        let (path, digest) = (PathBuf::new(), digest(&data));
        let (points, faces) = (data.mesh.points.len(), data.mesh.face_counts.len());
        Self { path, object_path: data.object_path.clone(), points, faces, digest, reader: Arc::new(Kept(data)) }
    }

    /// Full path of the object in its file; empty when the format has no paths.
    pub fn object_path(&self) -> &str {
        &self.object_path
    }

    /// Its file; empty where it was generated.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Whether it comes from a file and was not generated.
    pub fn is_from_file(&self) -> bool {
        !self.path.as_os_str().is_empty()
    }

    /// Unit and up axis in which its file is read; `None` where it was generated.
    pub fn units(&self) -> Option<InputUnits> {
        self.reader.units()
    }

    /// Reads the mesh.
    ///
    /// # Errors
    /// It cannot be read, or has other points or faces than before.
    pub fn read(&self) -> Result<MeshData, IoError> {
        let data = self.reader.read()?;
        if digest(&data) == self.digest {
            return Ok(data);
        }
        let what = "the mesh has changed since the run began: its points or faces differ";
        let advice = "start over, and do not change its files until the run has ended";
        Err(IoError::data(&self.path, data.object_path, what, advice))
    }

    /// The mesh with the triangles that are simulated in the place of its faces, and everything handed through that belongs to them.
    ///
    /// # Errors
    /// It cannot be read.
    pub fn cut(&self) -> Result<Self, IoError> {
        Self::new(&self.path, self.object_path.clone(), Cut(self.clone()))
    }

    /// All positions [m], for those who cannot do with pieces.
    ///
    /// # Errors
    /// They cannot be read.
    pub fn positions(&self) -> Result<Vec<Vec3>, IoError> {
        let mut all = Vec::with_capacity(self.points);
        self.reader.points(&mut |points| all.extend_from_slice(points))?;
        Ok(all)
    }
}

/// A mesh with the triangles that are simulated.
struct Cut(GarmentMesh);

impl GarmentReader for Cut {
    fn read(&self) -> Result<MeshData, IoError> {
        Ok(cut(self.0.read()?))
    }

    fn units(&self) -> Option<InputUnits> {
        self.0.units()
    }

    fn points(&self, take: &mut dyn FnMut(&[Vec3])) -> Result<(), IoError> {
        self.0.reader.points(take)
    }

    fn faces(&self, take: &mut dyn FnMut(&[u32], &[u32])) -> Result<(), IoError> {
        let triangles = triangles_of(&self.0.read()?);
        take(&vec![3; triangles.len()], triangles.as_flattened());
        Ok(())
    }
}

impl MeshStream for GarmentMesh {
    fn point_count(&self) -> usize {
        self.points
    }

    fn face_count(&self) -> usize {
        self.faces
    }

    fn points(&self, take: &mut dyn FnMut(&[Vec3])) -> Result<(), String> {
        self.reader.points(take).map_err(|error| error.to_string())
    }

    fn faces(&self, take: &mut dyn FnMut(&[u32], &[u32])) -> Result<(), String> {
        self.reader.faces(take).map_err(|error| error.to_string())
    }
}

/// Numbers of points and faces seen of a mesh, and a digest of it.
#[derive(Default)]
struct Seen {
    points: usize,
    faces: usize,
    digest: Sha256,
}

impl Seen {
    fn points(&mut self, points: &[Vec3]) {
        self.points += points.len();
        points.iter().flatten().for_each(|x| self.digest.update(x.to_le_bytes()));
    }

    fn faces(&mut self, counts: &[u32], corners: &[u32]) {
        self.faces += counts.len();
        let mut rest = corners.iter();
        // Face by face, so that pieces of any length come to the same.
        for count in counts {
            self.digest.update(count.to_le_bytes());
            rest.by_ref().take(*count as usize).for_each(|corner| self.digest.update(corner.to_le_bytes()));
        }
    }
}

/// The triangles that are simulated.
pub fn triangles_of(data: &MeshData) -> Vec<[u32; 3]> {
    data.triangles.clone().unwrap_or_else(|| simulated_triangles(&data.mesh))
}

/// The mesh with the triangles that are simulated in the place of its faces.
pub(crate) fn cut(data: MeshData) -> MeshData {
    let triangles = triangles_of(&data);
    into_triangles(data, triangles)
}

/// The triangles that are simulated, where they are not just the faces.
pub(crate) fn triangles_to_store(data: &MeshData) -> Option<Vec<[u32; 3]>> {
    let (mesh, triangles) = (&data.mesh, triangles_of(data));
    let are_faces = mesh.face_counts.len() == triangles.len() && mesh.face_counts.iter().all(|count| *count == 3);
    (!are_faces).then_some(triangles)
}

/// Digest of what is simulated, points and faces.
fn digest(data: &MeshData) -> [u8; 32] {
    let mut seen = Seen::default();
    seen.points(&data.mesh.points);
    seen.faces(&data.mesh.face_counts, &data.mesh.face_indices);
    seen.digest.finalize().into()
}

#[cfg(test)]
mod tests {
    use drapery_core::mesh::PolygonMesh;

    use super::*;

    /// Gives another mesh as a whole than in pieces.
    struct Changing(Kept, Kept);

    impl GarmentReader for Changing {
        fn read(&self) -> Result<MeshData, IoError> {
            self.1.read()
        }

        fn points(&self, take: &mut dyn FnMut(&[Vec3])) -> Result<(), IoError> {
            self.0.0.mesh.points.chunks(2).for_each(take);
            Ok(())
        }

        fn faces(&self, take: &mut dyn FnMut(&[u32], &[u32])) -> Result<(), IoError> {
            self.0.faces(take)
        }
    }

    #[test]
    fn a_mesh_that_has_changed_is_refused_when_it_is_read_again() {
        let of = |points| MeshData::new(PolygonMesh::from_triangles(points, &[[0, 1, 2]]));
        let first = of(vec![Vec3::x(), Vec3::y(), Vec3::z()]);
        let other = of(vec![Vec3::x(), Vec3::y(), 1.5 * Vec3::z()]);
        let mesh = |then: &MeshData| {
            let reader = Changing(Kept(first.clone()), Kept(then.clone()));
            GarmentMesh::new(Path::new("skirt.obj"), String::new(), reader).unwrap()
        };
        assert_eq!(
            (mesh(&first).read().unwrap(), mesh(&first).positions().unwrap()),
            (first.clone(), first.mesh.points.clone())
        );
        let message = mesh(&other).read().unwrap_err().to_string();
        assert!(message.contains("skirt.obj") && message.contains("has changed"), "{message}");
    }
}
