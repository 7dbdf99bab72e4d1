//! Attributes at the points of an archive: a finite number for each point in every sample.

use drapery_alembic::{DataType, GeomParam, PodType, Scope};
use drapery_io::cache_frames::StoredFrame;

use super::MeshCheck;

impl MeshCheck<'_> {
    /// The attributes of single precision that have one value for each point, and normals of points or face corners.
    pub(super) fn attributes(&mut self) {
        let mesh = self.mesh;
        let is_of_points = |param: &GeomParam| {
            matches!(param.scope(), Scope::Vertex | Scope::Varying)
                && [1, 3].map(|extent| DataType::new(PodType::F32, extent)).contains(&param.data_type())
        };
        let of_corners = |param: &GeomParam| {
            param.scope() == Scope::FaceVarying && param.data_type() == DataType::new(PodType::F32, 3)
        };
        let normals = mesh.normals().filter(|normals| is_of_points(normals) || of_corners(normals));
        for param in mesh.attributes().into_iter().filter(is_of_points).chain(normals) {
            if let Some(what) = (0..param.sample_count()).find_map(|sample| self.wrong_with(&param, sample)) {
                self.fail(format_args!("attribute {}, {what}", param.name()));
            }
        }
    }

    /// Returns the fault of a sample of an attribute, if it has one.
    fn wrong_with(&self, param: &GeomParam, sample: usize) -> Option<String> {
        let of_mesh = sample.min(self.mesh.sample_count() - 1);
        let (held, place, places) = match param.scope() {
            Scope::FaceVarying => (self.mesh.face_indices(of_mesh).map(|corners| corners.len()), "corner", "corners"),
            _ => (self.mesh.vertex_count(of_mesh), "vertex", "points"),
        };
        let count = match held {
            Ok(count) => count,
            Err(error) => return Some(error.to_string()),
        };
        let numbers = if param.data_type().extent == 1 {
            param.expanded::<f32, 1>(sample).map(|all| all.into_iter().map(|[number]| [number; 3]).collect())
        } else {
            param.expanded::<f32, 3>(sample)
        };
        match numbers {
            Err(error) => Some(error.to_string()),
            Ok(all) if all.len() != count => {
                Some(format!("sample {sample}: {} values for {count} {places}", all.len()))
            }
            Ok(all) => {
                let number = all.iter().position(|numbers| numbers.iter().any(|number| !number.is_finite()))?;
                Some(format!("sample {sample}, {place} {number}: the value is not a finite number"))
            }
        }
    }
}

/// Returns the fault of the numbers at the points of a frame of a stage, if they have one; readers make sure that there is one for
/// each point.
pub(super) fn wrong_in(frame: &StoredFrame) -> Option<String> {
    let first_bad = |numbers: &[f32]| numbers.iter().position(|number| !number.is_finite());
    let (name, vertex) = frame.values.named().find_map(|(name, numbers)| Some((name, first_bad(numbers)?)))?;
    Some(format!("attribute {name}, vertex {vertex}: the value is not a finite number"))
}
