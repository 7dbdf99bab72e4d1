//! A garment of a description, and its rest shape where that is read piece by piece.

use std::collections::BTreeMap;
use std::sync::Arc;

use crate::Vec3;
use crate::mesh::{MeshStream, PolygonMesh};
use crate::scene::described::described;
use crate::scene::vertex_maps::{MapCurves, PaintedMaps};
use crate::scene::{DEFAULT_THICKNESS, GarmentDescription, LARGEST_DENSITY, LARGEST_THICKNESS, Mass, SMALLEST_DENSITY};

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
            rest_scale: 1.0,
            layer: None,
            parts: BTreeMap::new(),
            maps: PaintedMaps::new(),
            map_curves: MapCurves::new(),
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

    /// Areal density [kg/m²], if that gives its mass.
    fn density(&self) -> Option<f64> {
        match self.mass {
            Mass::Density(density) => Some(density),
            Mass::UniformTotal(_) => None,
        }
    }

    /// Mass of the whole garment [kg], if that is given.
    fn total_mass(&self) -> Option<f64> {
        match self.mass {
            Mass::UniformTotal(total) => Some(total),
            Mass::Density(_) => None,
        }
    }

    /// The rest shape, which it no longer has after that.
    pub(crate) fn take_mesh(&mut self) -> Arc<dyn MeshStream> {
        let mesh = std::mem::take(&mut self.mesh);
        self.stream.take().unwrap_or_else(|| Arc::new(mesh))
    }
}

described! { GarmentDescription as garment {
    "density", garment.density() => ArealDensity, default Absent, range (SMALLEST_DENSITY, LARGEST_DENSITY),
        "mass per area, as \"150 g/m²\"; a material brings it";
    "total_mass", garment.total_mass() => Mass, default Absent, range (1e-9, 1e9),
        "mass of the whole garment, the same for every vertex; instead of `density`";
    "thickness", garment.thickness => Length, default Quantity("0.5 mm"), range (1e-9, LARGEST_THICKNESS),
        "distance that `self_repulsion` keeps between its layers and from other garments; lowered where edges are short; \
         left out, that of the material";
    "rest_scale", garment.rest_scale => None, default Number(1.0), range (0.01, 10.0),
        "lengths at rest over those of the rest shape: below 1 the cloth shrinks, above 1 it grows; its mass stays";
} }
