//! Attributes at the points of an archive: a finite number for each point in every sample.

use drapery_alembic::{DataType, GeomParam, PodType, Scope};
use drapery_io::cache_frames::StoredFrame;

use super::MeshCheck;

impl MeshCheck<'_> {
    /// The attributes of single precision that have one value for each point, normals among them.
    pub(super) fn attributes(&mut self) {
        let mesh = self.mesh;
        let is_of_points = |param: &GeomParam| {
            matches!(param.scope(), Scope::Vertex | Scope::Varying)
                && [1, 3].map(|extent| DataType::new(PodType::F32, extent)).contains(&param.data_type())
        };
        for param in mesh.attributes().into_iter().chain(mesh.normals()).filter(is_of_points) {
            if let Some(what) = (0..param.sample_count()).find_map(|sample| self.wrong_with(&param, sample)) {
                self.fail(format_args!("attribute {}, {what}", param.name()));
            }
        }
    }

    /// Returns the fault of a sample of an attribute, if it has one.
    fn wrong_with(&self, param: &GeomParam, sample: usize) -> Option<String> {
        let points = match self.mesh.vertex_count(sample.min(self.mesh.sample_count() - 1)) {
            Ok(points) => points,
            Err(error) => return Some(error.to_string()),
        };
        let numbers = if param.data_type().extent == 1 {
            param.expanded::<f32, 1>(sample).map(|all| all.into_iter().map(|[number]| [number; 3]).collect())
        } else {
            param.expanded::<f32, 3>(sample)
        };
        match numbers {
            Err(error) => Some(error.to_string()),
            Ok(all) if all.len() != points => {
                Some(format!("sample {sample}: {} values for {points} points", all.len()))
            }
            Ok(all) => {
                let point = all.iter().position(|numbers| numbers.iter().any(|number| !number.is_finite()))?;
                Some(format!("sample {sample}, vertex {point}: the value is not a finite number"))
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
