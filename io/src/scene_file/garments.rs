//! Garments of a scene file.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::f64::consts::TAU;
use std::path::{Path as FilePath, PathBuf};
use std::sync::Arc;

use drapery_core::Vec3;
use drapery_core::mesh::{MeshStream, PolygonMesh};
use drapery_core::scene::{Described, GarmentDescription, Mass};

use crate::error::IoError;
use crate::garment_mesh::{GarmentMesh, GarmentReader};
use crate::memory_mesh::MemoryMesh;
use crate::mesh_data::{MeshData, Uvs};
use crate::mesh_source::MeshSource;
use crate::units::InputUnits;

use super::raw::{Garment, LARGEST_LEAF, Leaves};
use super::resolve::{ReadGarment, Resolver};
use super::shapes::{Form, Shape};
use super::tree::Path;

/// A generated mesh.
struct Generated(Form);

impl GarmentReader for Generated {
    fn read(&self) -> Result<MeshData, IoError> {
        let Shape { mesh, uvs } = self.0.shape();
        let values = uvs.iter().map(|uv| uv.map(|t| t as f32)).collect();
        // One texture coordinate per point, so corners count both alike.
        let uvs = Some(Uvs { name: String::new(), values, indices: mesh.face_indices.clone() });
        Ok(MeshData { uvs, ..MeshData::new(mesh) })
    }

    fn points(&self, take: &mut dyn FnMut(&[Vec3])) -> Result<(), IoError> {
        self.0.points(&mut |point, _| take(&[point]));
        Ok(())
    }

    fn faces(&self, take: &mut dyn FnMut(&[u32], &[u32])) -> Result<(), IoError> {
        self.0.triangles(&mut |corners| take(&[3], &corners));
        Ok(())
    }
}

/// A mesh of a file at a time [s].
pub(super) struct FromFile {
    file: PathBuf,
    /// The mesh, if it is no file but one in memory.
    memory: Option<Arc<MemoryMesh>>,
    objects: Option<String>,
    units: InputUnits,
    time: f64,
}

impl FromFile {
    /// Describes the mesh that was opened as `source`, of which these objects were chosen.
    pub(super) fn of(source: &MeshSource, objects: Option<String>, time: f64) -> Self {
        let (file, units) = (source.path().to_owned(), source.units());
        Self { file, memory: source.memory().cloned(), objects, units, time }
    }

    fn open(&self) -> Result<MeshSource, IoError> {
        if let Some(mesh) = &self.memory {
            return Ok(MeshSource::in_memory(mesh, self.units));
        }
        MeshSource::open(&self.file, self.objects.as_deref(), self.units)
    }
}

impl GarmentReader for FromFile {
    fn read(&self) -> Result<MeshData, IoError> {
        let data = self.open()?.mesh_at(self.time)?;
        // What a cache was for says nothing of what is simulated from it.
        Ok(MeshData { purpose: None, render_mesh_of: None, ..data })
    }

    fn units(&self) -> Option<InputUnits> {
        Some(self.units)
    }

    fn points(&self, take: &mut dyn FnMut(&[Vec3])) -> Result<(), IoError> {
        self.open()?.points_at(self.time, take)
    }

    fn faces(&self, take: &mut dyn FnMut(&[u32], &[u32])) -> Result<(), IoError> {
        self.open()?.faces_at(self.time, take)
    }
}

impl Resolver<'_> {
    /// Resolves one garment and its pins. Problems are recorded.
    pub(super) fn garment(&mut self, garment: &Garment, path: &Path) {
        let mass = self.mass(garment, path);
        let Some((mesh, grid)) = self.garment_mesh(garment, path) else {
            return;
        };
        let (maps, map_curves) = self.maps(garment, path, &mesh);
        let Some(start) = self.start(garment, path, &mesh, grid) else { return };
        let velocities = self.start_velocities(garment, path, mesh.point_count());
        let index = self.description.garments.len();
        let mut parts = BTreeMap::new();
        if !(garment.pin.is_empty() && garment.elastic.is_empty() && garment.part.is_empty()) {
            let looks = garment.pin.iter().any(|pin| pin.region.is_some())
                || garment.elastic.iter().any(|band| band.region.is_some())
                || garment.part.iter().any(|part| part.region.is_some());
            let Some(places) = self.places(path, &mesh, start.as_deref(), looks) else { return };
            let read =
                ReadGarment { points: mesh.point_count(), mesh: &mesh, places: &places, grid, units: garment.units };
            for (number, pin) in garment.pin.iter().enumerate() {
                let pin = self.pin(pin, &path.clone().key("pin").index(number), index, &read);
                self.description.pins.extend(pin);
            }
            for (number, band) in garment.elastic.iter().enumerate() {
                let band = self.elastic(band, &path.clone().key("elastic").index(number), index, &read);
                self.description.elastics.extend(band);
            }
            parts = self.parts(garment, path, &read);
        }
        let settings = self.settings(path, GarmentDescription::FIELDS);
        let (thickness, rest_scale) = (settings.number("thickness"), settings.number("rest_scale"));
        let (Some(mass), Some(start_velocities)) = (mass, velocities) else { return };
        if let Some(written) = &garment.render_mesh {
            let Some(render_mesh) = self.render_mesh(garment, written, path) else { return };
            self.render_meshes.push(render_mesh);
        }
        let velocity = Vec3::from(garment.velocity);
        let stream: Option<Arc<dyn MeshStream>> = Some(Arc::new(mesh.clone()));
        self.garments.push(mesh);
        self.grids.push(grid);
        let (name, mesh) = (garment.name.clone(), PolygonMesh::default());
        let garment = GarmentDescription {
            name,
            mesh,
            stream,
            start,
            velocity,
            start_velocities,
            mass,
            thickness,
            rest_scale,
            layer: garment.layer,
            parts,
            maps,
            map_curves,
        };
        self.description.garments.push(garment);
    }

    /// Finds the start positions of the points of a garment, if somebody looks; `None` after a problem, which is
    /// recorded.
    pub(super) fn places<'a>(
        &mut self,
        path: &Path,
        mesh: &GarmentMesh,
        start: Option<&'a [Vec3]>,
        looks: bool,
    ) -> Option<Cow<'a, [Vec3]>> {
        match start {
            Some(start) => Some(Cow::Borrowed(start)),
            None if looks => self.of_file(path, mesh.positions()).map(Cow::Owned),
            None => Some(Cow::Owned(Vec::new())),
        }
    }

    fn mass(&mut self, garment: &Garment, path: &Path) -> Option<Mass> {
        let settings = self.settings(path, GarmentDescription::FIELDS);
        match (settings.optional("density"), settings.optional("total_mass")) {
            (Some(density), None) => Some(Mass::Density(density)),
            (None, Some(total)) => Some(Mass::UniformTotal(total)),
            (None, None) => {
                let help = "add density = \"150 g/m²\", total_mass in kg, or a material".to_owned();
                self.error_with(path, format!("garment \"{}\" has no mass", garment.name), help);
                None
            }
            (Some(_), Some(_)) => {
                self.error(path, format!("garment \"{}\" takes either `density` or `total_mass`", garment.name));
                None
            }
        }
    }

    fn garment_mesh(&mut self, garment: &Garment, path: &Path) -> Option<(GarmentMesh, Option<[u32; 2]>)> {
        let ways = [
            garment.rest.is_some(),
            garment.panel.is_some(),
            garment.disc.is_some(),
            garment.sphere.is_some(),
            garment.tube.is_some(),
            garment.leaves.is_some(),
        ];
        if ways.iter().filter(|w| **w).count() != 1 {
            let help = "give exactly one of `rest`, `panel`, `disc`, `sphere`, `tube` and `leaves`".to_owned();
            self.error_with(path, format!("garment \"{}\" needs one mesh", garment.name), help);
            return None;
        }
        if let Some(rest) = &garment.rest {
            let here = path.clone().key("rest");
            let (file, time) = self.file_at(&here, rest)?;
            let source = self.open(&here, &file, garment.path.as_deref(), garment.units)?;
            let time = self.time_in(&here, &source, time)?;
            // The path of the first object is that of what several are merged to.
            let object = source.object_path();
            let reader = FromFile::of(&source, garment.path.clone(), time);
            let mesh = GarmentMesh::new(source.path(), object, reader);
            let mesh = self.of_file(&here, mesh)?;
            // A mesh without points is refused with all that are.
            if mesh.face_count() == 0 && mesh.point_count() > 0 {
                let help = "export it with polygons, or choose another object with `path`".to_owned();
                self.data_error(&here, format!("garment \"{}\" has no faces", garment.name), help);
                return None;
            }
            self.has_room(&here, mesh.point_count() as f64)?;
            // They are read again with the first frame, which would be late for bad news.
            self.of_file(&here, source.check_attributes_at(time))?;
            source.left_out().into_iter().for_each(|what| self.warn(&file, &what));
            return Some((mesh, None));
        }
        for (key, written) in [("path", garment.path.is_some()), ("units", garment.units.is_some())] {
            // A generated garment may start from a file, which then has units and a path.
            if written && garment.start.is_none() {
                self.error(&path.clone().key(key), format!("`{key}` applies only to garments from files"));
            }
        }
        let form = self.generate(garment, path)?;
        let grid = form.grid();
        let mesh = GarmentMesh::new(FilePath::new(""), String::new(), Generated(form));
        Some((self.of_file(path, mesh)?, grid))
    }

    fn generate(&mut self, garment: &Garment, path: &Path) -> Option<Form> {
        let Garment { panel, disc, sphere, tube, leaves, .. } = garment;
        let (key, rotation, points) = match (panel, disc, sphere, tube, leaves) {
            (Some(panel), ..) => ("panel", panel.rotation, panel.aspect * f64::from(panel.resolution).powi(2)),
            (_, Some(disc), ..) => ("disc", disc.rotation, 3.0 * f64::from(disc.resolution).powi(2)),
            (_, _, Some(sphere), ..) => ("sphere", None, 4.0 * f64::from(sphere.resolution).powi(2)),
            (_, _, _, Some(tube), _) => {
                let points = f64::from(tube.resolution).powi(2) * tube.length / tube.radius / TAU;
                ("tube", tube.rotation, points)
            }
            (_, _, _, _, leaves) => ("leaves", None, self.leaf_points(leaves.as_ref()?, path)?),
        };
        let here = path.clone().key(key);
        if let Some(rotation) = rotation {
            self.rotation(rotation, &here.clone().key("rotation"));
        }
        let resolution = here.key("resolution");
        self.has_room(&resolution, points)?;
        self.count(&resolution, points)?;
        Form::of(garment)
    }

    /// About how many points leaves have.
    fn leaf_points(&mut self, leaves: &Leaves, path: &Path) -> Option<f64> {
        let here = path.clone().key("leaves");
        let total: f64 = leaves.count.iter().map(|c| f64::from(*c)).product();
        // Every pair is tested until the cells are large enough.
        if !(1.0..=2000.0).contains(&total) {
            self.error(&here.key("count"), format!("{total} leaves are out of range; 1 to 2000 are allowed"));
            return None;
        }
        if leaves.side * leaves.aspect.max(1.0) > LARGEST_LEAF {
            self.error(&here.key("side"), format!("leaves can be at most {LARGEST_LEAF} m long"));
            return None;
        }
        Some(total * leaves.aspect * f64::from(leaves.resolution).powi(2))
    }

    /// Refuses meshes that no machine could simulate.
    fn count(&mut self, path: &Path, points: f64) -> Option<()> {
        const MOST: f64 = if cfg!(fuzzing) { 3e3 } else { 1e8 };
        if points <= MOST {
            return Some(());
        }
        let text = format!("about {points:.0} points are too many; at most {MOST:.0} are allowed");
        self.error_with(path, text, "lower the resolution".to_owned());
        None
    }
}
