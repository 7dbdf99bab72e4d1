//! The rest shape of a garment that is read piece by piece.

use std::sync::Arc;

use crate::Vec3;
use crate::mesh::MeshStream;
use crate::scene::GarmentDescription;

impl GarmentDescription {
    /// Number of points of the rest shape.
    pub fn point_count(&self) -> usize {
        self.stream.as_ref().map_or(self.mesh.points.len(), |stream| stream.point_count())
    }

    /// Number of faces of the rest shape.
    pub fn face_count(&self) -> usize {
        self.stream.as_ref().map_or(self.mesh.face_counts.len(), |stream| stream.face_count())
    }

    /// All rest positions [m], for those who cannot do with pieces.
    ///
    /// # Errors
    /// What is wrong with the data.
    pub fn rest_positions(&self) -> Result<Vec<Vec3>, String> {
        let Some(stream) = &self.stream else { return Ok(self.mesh.points.clone()) };
        let mut all = Vec::with_capacity(stream.point_count());
        stream.points(&mut |points| all.extend_from_slice(points))?;
        Ok(all)
    }

    /// The rest shape, which it no longer has after that.
    pub(super) fn take_mesh(&mut self) -> Arc<dyn MeshStream> {
        let mesh = std::mem::take(&mut self.mesh);
        self.stream.take().unwrap_or_else(|| Arc::new(mesh))
    }
}
