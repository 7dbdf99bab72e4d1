//! Polygon meshes and subdivision surfaces.

use super::archive::Archive;
use super::geom_param::GeomParam;
use super::object::{Object, Schema};
use super::properties::{Compound, Samples};
use super::xform::world_matrix_at;
use std::ops::Range;

use crate::error::AlembicError;
use crate::geom::{Bounds, Matrix, transform_point};
use crate::time_sampling::TimeSampling;

/// Difference between the samples of a mesh.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TopologyVariance {
    /// Neither positions nor faces change.
    Constant,
    /// Positions change, faces do not: samples may be interpolated.
    Homogeneous,
    /// Faces change.
    Heterogeneous,
}

/// Faces of one sample, checked against each other and the number of vertices. Clockwise seen from outside.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Faces {
    /// Number of corners of each face.
    pub face_counts: Vec<u32>,
    /// Vertex of each face corner, face by face.
    pub face_indices: Vec<u32>,
}

/// A named group of faces.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FaceSet {
    /// Name of the object.
    pub name: String,
    /// Face numbers of the first sample.
    pub faces: Vec<i32>,
    /// No face is in two exclusive sets.
    pub exclusive: bool,
}

/// A polygon mesh, or a subdivision surface read as one.
#[derive(Debug, Clone)]
pub struct PolyMesh {
    object: Object,
    geom: Compound,
    positions: Samples,
    face_indices: Samples,
    face_counts: Samples,
}

impl PolyMesh {
    /// The mesh at `path`, such as `/body/bodyShape`.
    pub fn open(archive: &Archive, path: &str) -> Result<Self, AlembicError> {
        Self::of(&archive.object(path)?)
    }

    /// All meshes and subdivision surfaces of `archive` in stored order.
    pub fn all(archive: &Archive) -> Result<Vec<Self>, AlembicError> {
        let is_mesh = |object: &Object| matches!(object.schema(), Schema::PolyMesh | Schema::SubD);
        archive.objects().filter(is_mesh).map(|object| Self::of(&object)).collect()
    }

    /// `object` as a mesh.
    pub fn of(object: &Object) -> Result<Self, AlembicError> {
        if !matches!(object.schema(), Schema::PolyMesh | Schema::SubD) {
            let reason = format!("not a mesh (schema `{}`)", object.schema_name());
            return Err(object.missing("", reason, "choose an object that is a mesh; `PolyMesh::all` lists them"));
        }
        let geom = object.schema_compound(".geom", "mesh")?;
        let member = |name: &str| {
            geom.samples(name).cloned().ok_or_else(|| {
                object.missing(&format!(".geom/{name}"), "a mesh needs this property".into(), "export the mesh again")
            })
        };
        let (positions, face_indices, face_counts) = (member("P")?, member(".faceIndices")?, member(".faceCounts")?);
        Ok(Self { object: object.clone(), geom, positions, face_indices, face_counts })
    }

    /// The object this mesh is.
    pub fn object(&self) -> &Object {
        &self.object
    }

    /// Number of samples.
    pub fn sample_count(&self) -> usize {
        self.positions.len().max(self.face_indices.len()).max(self.face_counts.len())
    }

    /// Times of the samples.
    pub fn time_sampling(&self) -> &TimeSampling {
        self.positions.time_sampling()
    }

    /// Time of sample `index` (s).
    pub fn time(&self, index: usize) -> f64 {
        self.time_sampling().time(index)
    }

    /// Times of all samples (s).
    pub fn times(&self) -> Vec<f64> {
        (0..self.sample_count()).map(|index| self.time(index)).collect()
    }

    /// Returns the difference between the samples.
    pub fn topology_variance(&self) -> TopologyVariance {
        if !self.face_indices.is_constant() || !self.face_counts.is_constant() {
            TopologyVariance::Heterogeneous
        } else if !self.positions.is_constant() {
            TopologyVariance::Homogeneous
        } else {
            TopologyVariance::Constant
        }
    }

    /// Index in `samples` that belongs to sample `index` of the mesh: by number where the times are shared, otherwise
    /// by time.
    fn aligned(&self, samples: &Samples, index: usize) -> usize {
        if samples.time_sampling_index() == self.positions.time_sampling_index() {
            // A count out of range stays out of range, so that the error names the sample.
            if index < self.sample_count() { index.min(samples.len().saturating_sub(1)) } else { index }
        } else {
            samples.floor_index(self.time(index))
        }
    }

    /// Local positions of sample `index`.
    pub fn positions(&self, index: usize) -> Result<Vec<[f32; 3]>, AlembicError> {
        self.positions.elements(self.aligned(&self.positions, index))
    }

    /// Number of vertices of sample `index`.
    pub fn vertex_count(&self, index: usize) -> Result<usize, AlembicError> {
        self.positions.element_count(self.aligned(&self.positions, index))
    }

    /// Number of faces of sample `index`.
    pub fn face_count(&self, index: usize) -> Result<usize, AlembicError> {
        self.face_counts.element_count(self.aligned(&self.face_counts, index))
    }

    /// Local positions of some vertices of sample `index`.
    pub fn positions_in(&self, index: usize, range: Range<usize>) -> Result<Vec<[f32; 3]>, AlembicError> {
        if self.positions.data_type().extent != 3 {
            return Err(self.positions.wrong_type("positions of three values"));
        }
        let values: Vec<f32> =
            self.positions.values_in(self.aligned(&self.positions, index), 3 * range.start..3 * range.end)?;
        Ok(values.as_chunks().0.to_vec())
    }

    /// World positions of sample `index`, with the transforms above the mesh at the time of the sample.
    pub fn world_positions(&self, index: usize) -> Result<Vec<[f64; 3]>, AlembicError> {
        let matrix = self.world_matrix_at(self.time(index))?;
        let world = |p: [f32; 3]| transform_point(p.map(f64::from), &matrix);
        Ok(self.positions(index)?.into_iter().map(world).collect())
    }

    /// Matrix from local to world space at `time` (s).
    pub fn world_matrix_at(&self, time: f64) -> Result<Matrix, AlembicError> {
        world_matrix_at(&self.object, time)
    }

    /// Number of corners of each face of sample `index`, as stored.
    pub fn face_counts(&self, index: usize) -> Result<Vec<i32>, AlembicError> {
        self.face_counts.values(self.aligned(&self.face_counts, index))
    }

    /// Vertex of each face corner of sample `index`, as stored.
    pub fn face_indices(&self, index: usize) -> Result<Vec<i32>, AlembicError> {
        self.face_indices.values(self.aligned(&self.face_indices, index))
    }

    /// Faces of sample `index`. Fails when counts and indices contradict each other or name no vertex.
    pub fn faces(&self, index: usize) -> Result<Faces, AlembicError> {
        let mut all = Faces::default();
        // There is but one piece.
        self.faces_in_pieces(index, usize::MAX, &mut |piece| all = std::mem::take(piece))?;
        Ok(all)
    }

    /// Gives the faces of sample `index`, no more than `most` at a time. Fails as [`PolyMesh::faces`] does, where it comes to
    /// what is wrong.
    pub fn faces_in_pieces(
        &self,
        index: usize,
        most: usize,
        take: &mut dyn FnMut(&mut Faces),
    ) -> Result<(), AlembicError> {
        let [of_counts, of_indices] =
            [&self.face_counts, &self.face_indices].map(|samples| self.aligned(samples, index));
        let (faces, corners) = (self.face_count(index)?, self.face_indices.element_count(of_indices)?);
        let vertices = self.vertex_count(index)?;
        let damaged = |reason: String| self.object.damaged(".geom", format!("sample {index}: {reason}"));
        let unsigned = |values: Vec<i32>, limit: usize, what: &str| {
            let convert = |value: i32| {
                let fits = u32::try_from(value).ok().filter(|&value| (value as usize) < limit);
                fits.ok_or_else(|| {
                    damaged(format!("{what} {value} is out of range; it has to be 0 or more and below {limit}"))
                })
            };
            values.into_iter().map(convert).collect::<Result<Vec<u32>, AlembicError>>()
        };
        let (mut face, mut corner) = (0, 0);
        while face < faces {
            let end = face.saturating_add(most).min(faces);
            let face_counts = self.face_counts.values_in(of_counts, face..end)?;
            let face_counts = unsigned(face_counts, corners + 1, "face corner count")?;
            let here: usize = face_counts.iter().map(|&count| count as usize).sum();
            if here > corners - corner {
                break;
            }
            let face_indices = self.face_indices.values_in(of_indices, corner..corner + here)?;
            let face_indices = unsigned(face_indices, vertices, "vertex")?;
            take(&mut Faces { face_counts, face_indices });
            (face, corner) = (end, corner + here);
        }
        if face == faces && corner == corners {
            return Ok(());
        }
        let counts = self.face_counts(index)?;
        let total: i64 = counts.iter().map(|&count| i64::from(count)).sum();
        Err(damaged(format!("faces have {total} corners, but {corners} vertex indices are stored")))
    }

    /// Velocities of sample `index`, per second; none when none are stored.
    ///
    /// Fails when there is not one for each vertex.
    pub fn velocities(&self, index: usize) -> Result<Option<Vec<[f32; 3]>>, AlembicError> {
        let Some(samples) = self.geom.samples(".velocities").filter(|samples| !samples.is_empty()) else {
            return Ok(None);
        };
        let velocities = samples.elements(self.aligned(samples, index))?;
        let vertices = self.positions.element_count(self.aligned(&self.positions, index))?;
        if velocities.is_empty() && vertices > 0 {
            return Ok(None); // some exporters declare velocities and store none
        }
        if velocities.len() != vertices {
            let reason = format!("sample {index}: {} velocities for {vertices} vertices", velocities.len());
            return Err(self.object.damaged(".geom/.velocities", reason));
        }
        Ok(Some(velocities))
    }

    /// Stored local bounds of sample `index`.
    pub fn bounds(&self, index: usize) -> Result<Option<Bounds>, AlembicError> {
        let Some(samples) = self.geom.samples(".selfBnds").filter(|samples| !samples.is_empty()) else {
            return Ok(None);
        };
        Ok(samples.elements::<f64, 6>(self.aligned(samples, index))?.first().copied())
    }

    /// UV coordinates.
    pub fn uv(&self) -> Option<GeomParam> {
        self.param("uv")
    }

    /// Normals.
    pub fn normals(&self) -> Option<GeomParam> {
        self.param("N")
    }

    fn param(&self, name: &str) -> Option<GeomParam> {
        GeomParam::of(self.geom.property(name)?).filter(|param| param.sample_count() > 0)
    }

    /// Free attributes (`.arbGeomParams`) in stored order.
    pub fn attributes(&self) -> Vec<GeomParam> {
        self.geom.compound(".arbGeomParams").map(GeomParam::all).unwrap_or_default()
    }

    /// Free properties (`.userProperties`), such as how the cache was made.
    pub fn user_properties(&self) -> Option<&Compound> {
        self.geom.compound(".userProperties")
    }

    /// The `.geom` compound with everything in it.
    pub fn geom(&self) -> &Compound {
        &self.geom
    }

    /// Face sets in stored order.
    pub fn face_sets(&self) -> Result<Vec<FaceSet>, AlembicError> {
        let is_set = |object: &Object| object.schema() == Schema::FaceSet;
        self.object.children().filter(is_set).map(|object| read_face_set(&object)).collect()
    }
}

fn read_face_set(object: &Object) -> Result<FaceSet, AlembicError> {
    let compound = object.schema_compound(".faceset", "face set")?;
    let first = |name: &str| compound.samples(name).filter(|samples| !samples.is_empty());
    let faces = first(".faces").map(|samples| samples.values::<i32>(0)).transpose()?.unwrap_or_default();
    let exclusive = match first(".facesExclusive") {
        Some(samples) => samples.raw(0)?.iter().any(|&byte| byte != 0),
        None => false,
    };
    Ok(FaceSet { name: object.name().to_owned(), faces, exclusive })
}
