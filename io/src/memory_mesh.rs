//! Meshes that a program hands over in memory. Where a scene would name a file, it names one of them as `memory:NAME`. They
//! are still, in metres with Y up.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use drapery_core::Vec3;
use drapery_core::mesh::PolygonMesh;
use sha2::{Digest, Sha256};

use crate::error::IoError;
use crate::mesh_data::{Connectivity, MeshData, MeshReader};
use crate::sha256::hex;
use crate::units::{StatedUnits, UpAxis};

/// Prefix of the name of a mesh in memory in a scene.
pub const MEMORY: &str = "memory:";

/// A mesh in memory.
#[derive(Debug, Clone, PartialEq)]
pub struct MemoryMesh {
    name: String,
    data: MeshData,
}

impl MemoryMesh {
    /// Name in the scene, with `memory:` in front.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// SHA-256 of its points and faces, in hexadecimal digits.
    pub fn digest(&self) -> String {
        let PolygonMesh { points, face_counts, face_indices } = &self.data.mesh;
        let mut digest = Sha256::new();
        for count in [points.len(), face_counts.len(), face_indices.len()] {
            digest.update((count as u64).to_le_bytes());
        }
        points.iter().flatten().for_each(|x| digest.update(x.to_le_bytes()));
        face_counts.iter().chain(face_indices).for_each(|number| digest.update(number.to_le_bytes()));
        hex(&digest.finalize())
    }
}

/// Meshes in memory, by the name that a scene has for them.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct MemoryMeshes(BTreeMap<String, Arc<MemoryMesh>>);

impl MemoryMeshes {
    /// Adds a mesh, in the place of one of the same name: points [m], number of corners of each face, and the point of each
    /// corner, counter-clockwise seen from outside.
    ///
    /// # Errors
    /// The name cannot stand in a scene; corners and points do not fit each other, or a number is not finite.
    pub fn insert(&mut self, name: &str, mesh: PolygonMesh) -> Result<(), IoError> {
        let full = format!("{MEMORY}{name}");
        let refuse =
            |place: &str, what: String, advice: &str| Err(IoError::data(Path::new(&full), place, what, advice));
        if name.is_empty() || name.contains('@') || name.contains(char::is_control) {
            let advice = "a mesh needs a name, without `@`, which stands before a frame";
            return refuse("name", format!("{name:?} cannot be the name of a mesh"), advice);
        }
        let PolygonMesh { points, face_counts, face_indices } = &mesh;
        if let Some(face) = face_counts.iter().position(|count| *count < 3) {
            let what = format!("it has {} corners", face_counts[face]);
            return refuse(&format!("face {face}"), what, "a face has three corners or more");
        }
        let corners: u64 = face_counts.iter().map(|count| u64::from(*count)).sum();
        if corners != face_indices.len() as u64 {
            let what = format!("they have {corners} corners in all, and {} are given", face_indices.len());
            return refuse("faces", what, "give the point of every corner, face by face");
        }
        if let Some(corner) = face_indices.iter().position(|point| *point as usize >= points.len()) {
            let what = format!("it is at point {} of {}", face_indices[corner], points.len());
            return refuse(&format!("corner {corner}"), what, "points are counted from 0");
        }
        if let Some(vertex) = points.iter().position(|point| !point.iter().all(|x| x.is_finite())) {
            return refuse(&format!("vertex {vertex}"), "its place is not a finite number".into(), "give metres");
        }
        let data = MeshData::new(mesh);
        self.0.insert(name.to_owned(), Arc::new(MemoryMesh { name: full, data }));
        Ok(())
    }

    /// The mesh that a scene names, if it names one in memory.
    ///
    /// # Errors
    /// There is none of this name.
    pub fn named(&self, file: &str) -> Option<Result<Arc<MemoryMesh>, IoError>> {
        let name = file.strip_prefix(MEMORY)?;
        let missing = || {
            let known: Vec<&str> = self.0.keys().map(String::as_str).collect();
            let advice = match known.as_slice() {
                [] => "meshes in memory exist only in programs that use Drapery as a library; give a file".to_owned(),
                known => format!("there are {}", known.join(", ")),
            };
            IoError::data(Path::new(file), "mesh in memory", "there is no mesh of this name", advice)
        };
        Some(self.0.get(name).cloned().ok_or_else(missing))
    }

    /// All meshes, in the order of their names.
    pub fn iter(&self) -> impl Iterator<Item = &MemoryMesh> {
        self.0.values().map(AsRef::as_ref)
    }
}

/// A shared mesh as a reader of a file that never moves.
#[derive(Debug)]
pub(crate) struct MemoryReader(pub(crate) Arc<MemoryMesh>);

impl MeshReader for MemoryReader {
    fn objects(&self) -> Vec<String> {
        vec![self.0.name.clone()]
    }

    fn sample_times(&self) -> &[f64] {
        &[]
    }

    fn mesh_at(&self, _time: f64) -> Result<MeshData, IoError> {
        Ok(self.0.data.clone())
    }

    fn positions_at(&self, _time: f64, positions: &mut Vec<Vec3>) -> Result<(), IoError> {
        positions.clone_from(&self.0.data.mesh.points);
        Ok(())
    }

    fn points_at(&self, _time: f64, take: &mut dyn FnMut(&[Vec3])) -> Result<(), IoError> {
        take(&self.0.data.mesh.points);
        Ok(())
    }

    fn faces_at(&self, _time: f64, take: &mut dyn FnMut(&[u32], &[u32])) -> Result<(), IoError> {
        take(&self.0.data.mesh.face_counts, &self.0.data.mesh.face_indices);
        Ok(())
    }

    fn check_attributes_at(&self, _time: f64) -> Result<(), IoError> {
        Ok(())
    }

    fn connectivity_at(&self, _time: f64) -> Result<Option<Connectivity>, IoError> {
        Ok(None)
    }

    fn stated_units(&self) -> Option<StatedUnits> {
        Some(StatedUnits { metres: Some(1.0), up: Some(UpAxis::Y) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn triangle() -> PolygonMesh {
        PolygonMesh::from_triangles(vec![Vec3::zeros(), Vec3::x(), Vec3::y()], &[[0, 1, 2]])
    }

    #[test]
    fn meshes_that_contradict_themselves_are_refused_with_the_element() {
        let mut meshes = MemoryMeshes::default();
        let mut refused = |change: fn(&mut PolygonMesh), expected: &str| {
            let mut mesh = triangle();
            change(&mut mesh);
            let message = meshes.insert("hero", mesh).unwrap_err().to_string();
            assert!(message.contains("memory:hero") && message.contains(expected), "{message}");
        };
        refused(|mesh| mesh.face_indices[1] = 3, "corner 1: it is at point 3 of 3");
        refused(|mesh| mesh.face_counts[0] = 4, "4 corners in all, and 3 are given");
        refused(|mesh| mesh.face_counts[0] = 2, "face 0");
        refused(|mesh| mesh.points[2].y = f64::NAN, "vertex 2");
        assert!(meshes.insert("a@b", triangle()).is_err());
        assert!(meshes.insert("", triangle()).is_err());
    }

    #[test]
    fn a_name_that_is_not_there_is_told_with_those_that_are() {
        let mut meshes = MemoryMeshes::default();
        assert!(meshes.named("hero.abc").is_none());
        let alone = meshes.named("memory:hero").unwrap().unwrap_err().to_string();
        assert!(alone.contains("memory:hero") && alone.contains("give a file"), "{alone}");
        meshes.insert("skirt", triangle()).unwrap();
        assert!(meshes.named("memory:hero").unwrap().unwrap_err().to_string().contains("there are skirt"));
        assert!(meshes.named("memory:skirt").unwrap().is_ok());
    }

    #[test]
    fn another_place_or_another_face_is_another_digest() {
        let digest = |mesh: PolygonMesh| {
            let mut meshes = MemoryMeshes::default();
            meshes.insert("a", mesh).unwrap();
            meshes.iter().next().unwrap().digest()
        };
        let (mut moved, mut turned) = (triangle(), triangle());
        moved.points[0].x = 1e-12;
        turned.face_indices.swap(0, 1);
        assert_eq!(digest(triangle()), digest(triangle()));
        assert!(digest(moved) != digest(triangle()) && digest(turned) != digest(triangle()));
    }
}
