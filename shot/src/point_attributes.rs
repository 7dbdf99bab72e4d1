//! Attributes at the points of caches (`[output] attributes`): what each cache is to have, and its values in a frame. Nothing
//! here is done in a shot that asks for none.

use drapery_core::Vec3;
use drapery_core::geometry::surface_binding::SurfaceBinding;
use drapery_core::scene::{GarmentDescription, SceneDescription};
use drapery_io::attributes::{Attribute, FromPositions, PointAttributes, PointValues, StoredValues, rest_positions};
use drapery_io::error::IoError;
use drapery_io::garment_mesh::GarmentMesh;
use drapery_io::shot_description::OutputDescription;
use drapery_io::units::Units;

use crate::remote_simulation::RemoteSimulation;
use crate::render_mesh::RenderMesh;

/// Thickness of each garment's fabric at its points [m], as painted; nothing where nobody asks for it.
pub(crate) fn thickness_of(scene: &SceneDescription, output: &OutputDescription, points: &[usize]) -> Vec<Vec<f32>> {
    if !output.has(Attribute::Thickness) {
        return Vec::new();
    }
    let of_garment = |(garment, points): (&GarmentDescription, &usize)| {
        let painted = garment.maps.get("thickness").filter(|map| map.values.len() == *points);
        let at = |point: usize| painted.map_or(garment.thickness, |map| map.at(point, garment.thickness));
        (0..*points).map(|point| at(point) as f32).collect()
    };
    scene.garments.iter().zip(points).map(of_garment).collect()
}

/// Attributes of the caches of all garments, then of all render meshes.
///
/// # Errors
/// A mesh cannot be read.
pub(crate) fn planned(
    output: &OutputDescription,
    origin: Vec3,
    (garments, thickness): (&[GarmentMesh], &[Vec<f32>]),
    render_meshes: &[RenderMesh],
) -> Result<Vec<PointAttributes>, IoError> {
    if output.attributes.is_empty() {
        return Ok(vec![PointAttributes::default(); garments.len() + render_meshes.len()]);
    }
    let units = output.units;
    let in_file = |metres: &f32| (f64::from(*metres) / units.length.metres()) as f32;
    let of = |mesh: &GarmentMesh, thickness: Option<Vec<f32>>| -> Result<PointAttributes, IoError> {
        Ok(PointAttributes {
            rest: output.has(Attribute::Rest).then(|| rest_positions(mesh, (units, origin))).transpose()?,
            thickness: thickness.map(|all| all.iter().map(in_file).collect()),
            strain: output.has(Attribute::Strain),
            contact: output.has(Attribute::Contact),
        })
    };
    let of_garments = garments.iter().enumerate().map(|(garment, mesh)| of(mesh, thickness.get(garment).cloned()));
    let of_render_meshes = render_meshes.iter().map(|mesh| {
        let thickness = thickness.get(mesh.garment).map(|all| mesh.binding().interpolated(all));
        of(&mesh.mesh, thickness)
    });
    of_garments.chain(of_render_meshes).collect()
}

/// Bytes of the attributes of a point in each frame of a garment's cache, and of those that are there once.
pub(crate) fn bytes_per_point(output: &OutputDescription) -> [usize; 2] {
    let of = |still: bool| output.attributes.iter().filter(move |attribute| attribute.is_still() == still);
    [of(false).map(|attribute| attribute.bytes()).sum(), of(true).map(|attribute| attribute.bytes()).sum()]
}

/// Values of the attributes in a frame, as they are asked for.
pub(crate) struct FrameAttributes {
    units: Units,
    /// Attributes of each garment that follow from its positions.
    from_positions: Vec<FromPositions>,
    has_contact: bool,
    /// Contact of each garment in the sample that is written; nothing where nobody asks for it.
    contact: Vec<Vec<f32>>,
}

impl FrameAttributes {
    /// Takes the garments as they are written.
    ///
    /// # Errors
    /// A mesh cannot be read.
    pub(crate) fn of(output: &OutputDescription, garments: &[GarmentMesh]) -> Result<Self, IoError> {
        let has = |attribute| output.has(attribute);
        let (normals, strain) = (has(Attribute::Normals), has(Attribute::Strain));
        let of_garment = |mesh: &GarmentMesh| FromPositions::new(mesh, normals, strain);
        let from_positions = garments.iter().map(of_garment).collect::<Result<_, _>>()?;
        Ok(Self { units: output.units, from_positions, has_contact: has(Attribute::Contact), contact: Vec::new() })
    }

    /// Takes from all ranks what does not follow from the positions of a garment alone.
    pub(crate) fn take(&mut self, remote_simulation: &RemoteSimulation) {
        if self.has_contact {
            self.contact = remote_simulation.contact();
        }
    }

    /// Normals of a garment with these positions as they are stored.
    pub(crate) fn normals(&self, garment: usize, positions: &[[f32; 3]]) -> Vec<[f32; 3]> {
        self.from_positions[garment].normals(positions)
    }

    /// Strain of a garment, likewise.
    pub(crate) fn strain(&self, garment: usize, positions: &[[f32; 3]]) -> Vec<f32> {
        self.from_positions[garment].strain(positions, self.units.length.metres())
    }

    /// Values at the points of a garment with this strain.
    pub(crate) fn values<'a>(&'a self, garment: usize, strain: &'a [f32]) -> PointValues<'a> {
        PointValues { strain, contact: self.contact.get(garment).map_or(&[], Vec::as_slice) }
    }

    /// Values at the points of a mesh that follows a garment, which is at `x` [m] there: those of the cloth below them.
    pub(crate) fn followed(
        &self,
        garment: usize,
        binding: &SurfaceBinding,
        (x, origin): (&[Vec3], Vec3),
    ) -> StoredValues {
        let contact = self.contact.get(garment).map(|all| binding.interpolated(all));
        let positions = || x.iter().map(|x| self.units.stored_from(origin, *x)).collect::<Vec<_>>();
        let strain = self.from_positions[garment].has_strain().then(|| self.strain(garment, &positions()));
        StoredValues { strain: strain.map(|all| binding.interpolated(&all)), contact }
    }
}
