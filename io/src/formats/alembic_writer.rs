//! Alembic caches: the garment as the artist made it, moving.
//!
//! One file a garment with one mesh at the object path of the source, under one identity transform a level, points in
//! world space in the file's unit. Uniform sampling: the first sample is the first delivered frame, at frame / fps.
//! Faces, UVs, face sets and other attributes are written once; positions, velocities per second and bounds with every
//! frame. Among the user properties of the mesh stand how the file was made, [`TRIANGLES`] if there are larger faces, and
//! with every frame [`CROSSINGS`] if the shot counts them. The file is committed after every frame, so it is a valid archive whenever a reader looks.

use std::path::{Path, PathBuf};

use drapery_alembic::{
    ArchiveOptions, ArchiveWriter, Bounds, DataType, Durability, EMPTY_BOUNDS, GeomParamSpec, GeomParamWriter, Indexed,
    MetaData, PodType, PolyMeshSample, PolyMeshWriter, PropertyId, Scope, TimeSampling, Topology, XformWriter,
    write_face_set,
};
use drapery_core::Vec3;

use crate::cache::{APPLICATION, CacheFrame, CachePlan, CacheWriter, MeshData};
use crate::error::IoError;
use crate::units::Units;

/// User property: the triangles that were simulated, three points each, counter-clockwise. Only in meshes with other faces;
/// who cuts those along other diagonals sees another surface.
pub(crate) const TRIANGLES: &str = "triangles";

/// User property, one number a frame: how many edges of cloth pass through triangles of cloth in all garments of the shot.
pub(crate) const CROSSINGS: &str = "crossings";

/// An Alembic cache being written. The file appears with its first frame: an archive without samples would be refused
/// by the applications that load it.
#[derive(Debug)]
pub struct AlembicWriter {
    path: PathBuf,
    object_path: String,
    options: ArchiveOptions,
    properties: Vec<(&'static str, String)>,
    units: Units,
    sampling: TimeSampling,
    velocities: bool,
    mesh: MeshData,
    triangles: Vec<[u32; 3]>,
    open: Option<Open>,
    positions: Vec<[f32; 3]>,
    rates: Vec<[f32; 3]>,
}

/// What exists once the file does.
#[derive(Debug)]
struct Open {
    archive: ArchiveWriter,
    mesh: PolyMeshWriter,
    sampling: u32,
    crossings: Option<PropertyId>,
}

impl AlembicWriter {
    /// Prepares a cache at `path`; the first frame creates it and replaces what is there.
    ///
    /// # Errors
    /// The frame rate cannot be expressed.
    pub fn create(path: &Path, plan: &CachePlan<'_>) -> Result<Self, IoError> {
        let (numerator, denominator) = (plan.timeline.fps_numerator, plan.timeline.fps_denominator);
        let options = ArchiveOptions {
            application: APPLICATION.into(),
            description: format!("garment {}", plan.garment),
            // Without a date, equal runs give equal bytes.
            date: None,
            frames_per_second: Some(plan.fps()),
            extra: MetaData::new()
                .with("lengthUnit", plan.units.length.word())
                .with("metersPerUnit", &plan.units.length.metres().to_string())
                .with("upAxis", &format!("{:?}", plan.units.up)),
        };
        let properties = vec![
            ("application", APPLICATION.to_owned()),
            ("length_unit", plan.units.length.word().to_owned()),
            ("up_axis", format!("{:?}", plan.units.up)),
            ("fps", format!("{numerator}/{denominator}")),
        ];
        Ok(Self {
            path: path.to_owned(),
            object_path: plan.object_path(),
            options,
            properties,
            units: plan.units,
            sampling: TimeSampling::uniform(plan.file_time(plan.first_frame), plan.timeline.frame_duration())?,
            velocities: plan.velocities,
            mesh: plan.mesh.clone(),
            triangles: plan.triangles.to_vec(),
            open: None,
            positions: Vec::new(),
            rates: Vec::new(),
        })
    }

    /// Creates the file with its objects; the mesh has no sample yet.
    fn open(&self) -> Result<Open, IoError> {
        let mut archive = ArchiveWriter::create(&self.path, &self.options)?;
        let sampling = archive.add_time_sampling(self.sampling.clone())?;
        let mut names: Vec<&str> = self.object_path.split('/').filter(|name| !name.is_empty()).collect();
        let shape = names.pop().unwrap_or("mesh");
        let mut parent = archive.root();
        for name in names {
            parent = XformWriter::still(&mut archive, parent, name, None)?.object();
        }
        let mesh = PolyMeshWriter::declare(&mut archive, parent, shape, sampling)?;
        Ok(Open { archive, mesh, sampling, crossings: None })
    }

    /// Writes the first frame and everything that does not change.
    fn write_first(&mut self, crossings: Option<u32>) -> Result<Open, IoError> {
        let mut open = self.open()?;
        let polygons = &self.mesh.mesh;
        let counts: Vec<i32> = polygons.face_counts.iter().map(|&n| n as i32).collect();
        let indices: Vec<i32> = reversed(&polygons.face_counts, &polygons.face_indices).map(|i| i as i32).collect();
        let uv_indices: Option<Vec<u32>> =
            self.mesh.uvs.as_ref().map(|uvs| reversed(&polygons.face_counts, &uvs.indices).collect());
        let uv = self.mesh.uvs.as_ref().map(|uvs| Indexed {
            values: &uvs.values,
            indices: uv_indices.as_deref(),
            scope: Scope::FaceVarying,
            source_name: Some(uvs.name.as_str()).filter(|name| !name.is_empty()),
        });
        let sample = PolyMeshSample {
            topology: Some(Topology { face_counts: &counts, face_indices: &indices }),
            uv,
            ..self.sample()
        };
        open.write(&sample)?;
        self.write_attributes(&mut open, crossings.is_some())?;
        open.write_crossings(crossings)?;
        Ok(open)
    }

    /// Attributes of the source, face sets, and how the file was made.
    fn write_attributes(&self, open: &mut Open, counts_crossings: bool) -> Result<(), IoError> {
        let archive = &mut open.archive;
        let properties = open.mesh.user_properties(archive)?;
        for (name, text) in &self.properties {
            archive.write_static_string(properties, name, text)?;
        }
        archive.write_static_scalar(properties, "metres_per_unit", &[self.units.length.metres()])?;
        if self.mesh.mesh.face_counts.iter().any(|&count| count != 3) {
            let (kind, none) = (DataType::new(PodType::I32, 3), MetaData::new());
            let property = archive.add_array_property(properties, TRIANGLES, &none, kind, 0)?;
            let bytes: Vec<u8> = self.triangles.iter().flatten().flat_map(|&v| (v as i32).to_le_bytes()).collect();
            archive.write_static_raw(property, &bytes)?;
        }
        if counts_crossings {
            let (kind, none) = (DataType::new(PodType::U32, 1), MetaData::new());
            open.crossings = Some(archive.add_scalar_property(properties, CROSSINGS, &none, kind, open.sampling)?);
        }
        if !self.mesh.params.is_empty() {
            let attributes = open.mesh.attributes(archive)?;
            for param in &self.mesh.params {
                let spec = GeomParamSpec {
                    name: &param.name,
                    scope: param.scope,
                    data_type: param.data_type,
                    interpretation: &param.interpretation,
                    source_name: param.source_name.as_deref(),
                    indexed: param.indices.is_some(),
                    time_sampling: 0,
                };
                let writer = GeomParamWriter::declare(archive, attributes, &spec)?;
                writer.write_static(archive, &param.values, param.indices.as_deref())?;
            }
        }
        for set in &self.mesh.face_sets {
            let faces: Vec<i32> = set.faces.iter().map(|&face| face as i32).collect();
            write_face_set(archive, open.mesh.object(), &set.name, &faces, true)?;
        }
        Ok(())
    }

    /// Positions, velocities and bounds of the frame in hand.
    fn sample(&self) -> PolyMeshSample<'_> {
        PolyMeshSample {
            velocities: self.velocities.then_some(self.rates.as_slice()),
            bounds: Some(bounds_of(&self.positions)),
            ..PolyMeshSample::of(&self.positions)
        }
    }
}

impl Open {
    fn write(&mut self, sample: &PolyMeshSample<'_>) -> Result<(), IoError> {
        self.mesh.write(&mut self.archive, sample)?;
        let bounds = sample.bounds.unwrap_or(EMPTY_BOUNDS);
        self.archive.write_archive_bounds(self.sampling, &bounds)?;
        Ok(())
    }

    fn write_crossings(&mut self, count: Option<u32>) -> Result<(), IoError> {
        if let (Some(property), Some(count)) = (self.crossings, count) {
            self.archive.write_sample(property, &[count])?;
        }
        Ok(())
    }
}

impl CacheWriter for AlembicWriter {
    fn path(&self) -> &Path {
        &self.path
    }

    fn write(&mut self, frame: &CacheFrame<'_>) -> Result<(), IoError> {
        convert(self.units, frame.positions, &mut self.positions);
        convert(self.units, frame.velocities, &mut self.rates);
        let mut open = match self.open.take() {
            None => self.write_first(frame.crossings)?,
            Some(mut open) => {
                open.write(&self.sample())?;
                open.write_crossings(frame.crossings)?;
                open
            }
        };
        open.archive.commit(Durability::Flushed)?;
        self.open = Some(open);
        Ok(())
    }

    fn finish(&mut self) -> Result<(), IoError> {
        match self.open.take() {
            Some(open) => Ok(open.archive.finish(Durability::Synced)?),
            None => Ok(()),
        }
    }
}

fn convert(units: Units, vectors: &[Vec3], converted: &mut Vec<[f32; 3]>) {
    converted.clear();
    converted.extend(vectors.iter().map(|v| units.stored(*v)));
}

fn bounds_of(positions: &[[f32; 3]]) -> Bounds {
    let mut bounds = EMPTY_BOUNDS;
    for p in positions {
        for axis in 0..3 {
            bounds[axis] = bounds[axis].min(f64::from(p[axis]));
            bounds[axis + 3] = bounds[axis + 3].max(f64::from(p[axis]));
        }
    }
    bounds
}

/// Values of face corners with the corners of every face in the opposite order: clockwise from counter-clockwise and
/// back.
pub(crate) fn reversed<'a>(face_counts: &'a [u32], corners: &'a [u32]) -> impl Iterator<Item = u32> + 'a {
    let mut start = 0;
    face_counts.iter().flat_map(move |&count| {
        let face = &corners[start..start + count as usize];
        start += count as usize;
        face.iter().rev().copied()
    })
}
