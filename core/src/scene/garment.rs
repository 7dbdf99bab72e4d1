//! A garment of a description, and its rest shape where that is read piece by piece.

use std::sync::Arc;

use crate::Vec3;
use crate::mesh::{MeshStream, PolygonMesh};
use crate::scene::vertex_maps::PaintedMaps;
use crate::scene::{DEFAULT_THICKNESS, GarmentDescription, Mass};

impl GarmentDescription {
    /// A garment of areal density `density` [kg/m²] that starts at rest in its rest shape.
    pub fn new(name: &str, mesh: PolygonMesh, density: f64) -> Self {
        Self {
            name: name.into(),
            mesh,
            stream: None,
            start: None,
            velocity: Vec3::zeros(),
            start_velocities: None,
            mass: Mass::Density(density),
            thickness: DEFAULT_THICKNESS,
            maps: PaintedMaps::new(),
        }
    }

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
    /// The data of the stream is at fault; the text says where.
    pub fn rest_positions(&self) -> Result<Vec<Vec3>, String> {
        let Some(stream) = &self.stream else { return Ok(self.mesh.points.clone()) };
        let mut all = Vec::with_capacity(stream.point_count());
        stream.points(&mut |points| all.extend_from_slice(points))?;
        Ok(all)
    }

    /// The rest shape, which it no longer has after that.
    pub(crate) fn take_mesh(&mut self) -> Arc<dyn MeshStream> {
        let mesh = std::mem::take(&mut self.mesh);
        self.stream.take().unwrap_or_else(|| Arc::new(mesh))
    }
}
