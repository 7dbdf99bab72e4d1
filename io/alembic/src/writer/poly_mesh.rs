//! Polygon meshes.

use super::archive::ArchiveWriter;
use super::geom_param::{GeomParamSpec, GeomParamWriter};
use super::tree::{CompoundId, ObjectId, PropertyId};
use crate::error::AlembicError;
use crate::geom::{Bounds, Interpretation, Scope, bounds_of};
use crate::metadata::MetaData;
use crate::property::{DataType, PodType};

const POINT: DataType = DataType::new(PodType::F32, 3);

/// Names of velocities, UVs and normals, which not every mesh has.
const OPTIONAL: [&str; 3] = [".velocities", "uv", "N"];

/// Faces of a mesh. Alembic faces are clockwise seen from outside.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Topology<'a> {
    /// Number of corners of each face.
    pub face_counts: &'a [i32],
    /// Vertex of each face corner, face by face.
    pub face_indices: &'a [i32],
}

/// Values of a geometry parameter of N floats, plain or indexed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Indexed<'a, const N: usize> {
    /// The values.
    pub values: &'a [[f32; N]],
    /// Value used at each place of the scope; none when `values` are those already.
    pub indices: Option<&'a [u32]>,
    /// Kind of place that takes one value.
    pub scope: Scope,
    /// Name of a UV set; used by the first sample only.
    pub source_name: Option<&'a str>,
}

/// One sample of a mesh.
///
/// The first sample decides which optional members the mesh has. Later, `None` for `topology` and `uv` means unchanged;
/// `velocities` and `normals` have to be given with every sample or never.
#[derive(Debug, Clone, Copy)]
pub struct PolyMeshSample<'a> {
    /// Position of each vertex, local to the parent transform.
    pub positions: &'a [[f32; 3]],
    /// Faces; required in the first sample.
    pub topology: Option<Topology<'a>>,
    /// Velocity of each vertex, per second.
    pub velocities: Option<&'a [[f32; 3]]>,
    /// UV coordinates.
    pub uv: Option<Indexed<'a, 2>>,
    /// Normals.
    pub normals: Option<Indexed<'a, 3>>,
    /// Bounds of the positions; computed when none are given.
    pub bounds: Option<Bounds>,
}

impl<'a> PolyMeshSample<'a> {
    /// Positions and nothing else.
    pub fn of(positions: &'a [[f32; 3]]) -> Self {
        Self { positions, topology: None, velocities: None, uv: None, normals: None, bounds: None }
    }
}

/// Writes the samples of one polygon mesh.
#[derive(Debug, Clone)]
pub struct PolyMeshWriter {
    object: ObjectId,
    compound: CompoundId,
    time_sampling: u32,
    bounds: PropertyId,
    positions: PropertyId,
    face_indices: PropertyId,
    face_counts: PropertyId,
    velocities: Option<PropertyId>,
    uv: Option<GeomParamWriter>,
    normals: Option<GeomParamWriter>,
    /// True once the optional members are known: from the first sample, or found in a continued file.
    bound: bool,
}

impl PolyMeshWriter {
    /// Declares the mesh object `name` under `parent` (a transform: programs expect pairs of transform and shape).
    pub fn declare(
        archive: &mut ArchiveWriter,
        parent: ObjectId,
        name: &str,
        time_sampling: u32,
    ) -> Result<Self, AlembicError> {
        let metadata =
            MetaData::new().with("schema", "AbcGeom_PolyMesh_v1").with("schemaBaseType", "AbcGeom_GeomBase_v1");
        let object_metadata = metadata.clone().with("schemaObjTitle", "AbcGeom_PolyMesh_v1:.geom");
        let object = archive.add_object(parent, name, &object_metadata)?;
        let top = archive.top_compound(object);
        let compound = archive.add_compound(top, ".geom", &metadata)?;
        let bounds = archive.add_bounds_property(compound, ".selfBnds", time_sampling)?;
        let point = MetaData::new().with("geoScope", "vtx").with("interpretation", Interpretation::Point.name());
        let positions = archive.add_array_property(compound, "P", &point, POINT, time_sampling)?;
        let (index, none) = (DataType::new(PodType::I32, 1), MetaData::new());
        let face_indices = archive.add_array_property(compound, ".faceIndices", &none, index, time_sampling)?;
        let face_counts = archive.add_array_property(compound, ".faceCounts", &none, index, time_sampling)?;
        Ok(Self {
            object,
            compound,
            time_sampling,
            bounds,
            positions,
            face_indices,
            face_counts,
            velocities: None,
            uv: None,
            normals: None,
            bound: false,
        })
    }

    /// The mesh object: parent of face sets, owner of `visible`.
    pub fn object(&self) -> ObjectId {
        self.object
    }

    /// Number of samples so far.
    pub fn sample_count(&self, archive: &ArchiveWriter) -> usize {
        archive.sample_count(self.positions)
    }

    /// The compound for free attributes; pass it to [`GeomParamWriter::declare`]. To be called once.
    pub fn attributes(&self, archive: &mut ArchiveWriter) -> Result<CompoundId, AlembicError> {
        archive.add_compound(self.compound, ".arbGeomParams", &MetaData::new())
    }

    /// The compound for free properties, such as how the cache was made. To be called once.
    pub fn user_properties(&self, archive: &mut ArchiveWriter) -> Result<CompoundId, AlembicError> {
        archive.add_compound(self.compound, ".userProperties", &MetaData::new())
    }

    /// Writes the next sample.
    ///
    /// Checks what belongs together before anything is stored: face corners name existing vertices, counts add up,
    /// velocities are one a vertex, parameters have as many values as their scope has places.
    pub fn write(&mut self, archive: &mut ArchiveWriter, sample: &PolyMeshSample<'_>) -> Result<(), AlembicError> {
        let is_first = self.sample_count(archive) == 0;
        self.check(archive, sample, is_first)?;
        self.bind_optional(archive, sample, is_first)?;
        let bounds = sample.bounds.unwrap_or_else(|| bounds_of(sample.positions));
        archive.write_sample(self.bounds, &bounds)?;
        archive.write_sample(self.positions, sample.positions.as_flattened())?;
        match sample.topology {
            Some(topology) => {
                archive.write_sample(self.face_indices, topology.face_indices)?;
                archive.write_sample(self.face_counts, topology.face_counts)?;
            }
            None => {
                archive.set_same_as_previous(self.face_indices)?;
                archive.set_same_as_previous(self.face_counts)?;
            }
        }
        if let (Some(property), Some(velocities)) = (self.velocities, sample.velocities) {
            archive.write_sample(property, velocities.as_flattened())?;
        }
        match (self.uv, sample.uv) {
            (Some(uv), Some(values)) => uv.write(archive, values.values.as_flattened(), values.indices)?,
            (Some(uv), None) => uv.set_same_as_previous(archive)?,
            _ => {}
        }
        if let (Some(property), Some(normals)) = (self.normals, sample.normals) {
            property.write(archive, normals.values.as_flattened(), normals.indices)?;
        }
        Ok(())
    }

    /// Checks that a continued mesh has what `sample` has: the number of vertices, the members, and the values of those
    /// that a cache writes once, which are faces and UVs. Positions and velocities themselves do not matter.
    pub fn check_continued(
        &mut self,
        archive: &mut ArchiveWriter,
        sample: &PolyMeshSample<'_>,
    ) -> Result<(), AlembicError> {
        self.find_optional(archive);
        self.compare_with_stored(archive, sample)?;
        OPTIONAL.iter().for_each(|name| archive.declare_member(self.compound, name));
        Ok(())
    }

    fn compare_with_stored(&self, archive: &ArchiveWriter, sample: &PolyMeshSample<'_>) -> Result<(), AlembicError> {
        let (given, stored) = (sample.positions.len(), archive.properties[self.positions.0].previous_elements);
        let differs = |property: PropertyId, reason: &str| Err(archive.refuse_sample(property, reason));
        if given as u64 != stored {
            return differs(self.positions, &format!("the mesh has {given} vertices, the file has {stored}"));
        }
        self.check(archive, sample, false)?;
        self.check_members(archive, sample)?;
        let same_faces = sample.topology.is_none_or(|topology| {
            archive.last_sample_is(self.face_counts, topology.face_counts)
                && archive.last_sample_is(self.face_indices, topology.face_indices)
        });
        if !same_faces {
            return differs(self.face_indices, "the mesh has other faces than the file");
        }
        match (self.uv, sample.uv) {
            (Some(uv), Some(values)) if !uv.last_is(archive, values.values.as_flattened(), values.indices) => {
                differs(self.positions, "the mesh has other UVs than the file")
            }
            (Some(_), None) => differs(self.positions, "the file has UVs, the mesh has none"),
            _ => Ok(()),
        }
    }

    /// Finds the optional members of a continued file.
    fn find_optional(&mut self, archive: &ArchiveWriter) {
        if !self.bound {
            let [velocities, uv, normals] = OPTIONAL;
            self.velocities = archive.find_property(self.compound, velocities);
            self.uv = GeomParamWriter::find(archive, self.compound, uv);
            self.normals = GeomParamWriter::find(archive, self.compound, normals);
            self.bound = true;
        }
    }

    /// Declares the optional members with the first sample; finds them again in a continued file.
    fn bind_optional(
        &mut self,
        archive: &mut ArchiveWriter,
        sample: &PolyMeshSample<'_>,
        is_first: bool,
    ) -> Result<(), AlembicError> {
        let (compound, sampling) = (self.compound, self.time_sampling);
        if !is_first {
            self.find_optional(archive);
            return self.check_members(archive, sample);
        }
        if sample.velocities.is_some() {
            let vector = MetaData::new().with("interpretation", Interpretation::Vector.name());
            self.velocities = Some(archive.add_array_property(compound, ".velocities", &vector, POINT, sampling)?);
        }
        if let Some(uv) = &sample.uv {
            let spec = GeomParamSpec {
                scope: uv.scope,
                source_name: uv.source_name,
                ..GeomParamSpec::uv(uv.indices.is_some(), sampling)
            };
            self.uv = Some(GeomParamWriter::declare(archive, compound, &spec)?);
        }
        if let Some(normals) = &sample.normals {
            let spec = GeomParamSpec::normals(normals.scope, normals.indices.is_some(), sampling);
            self.normals = Some(GeomParamWriter::declare(archive, compound, &spec)?);
        }
        self.bound = true;
        Ok(())
    }

    /// Later samples have the members of the first one.
    fn check_members(&self, archive: &ArchiveWriter, sample: &PolyMeshSample<'_>) -> Result<(), AlembicError> {
        let wrong = if sample.velocities.is_some() != self.velocities.is_some() {
            "velocities"
        } else if sample.normals.is_some() != self.normals.is_some() {
            "normals"
        } else if sample.uv.is_some() && self.uv.is_none() {
            "uv"
        } else {
            let differs = |given: Option<bool>, writer: Option<GeomParamWriter>| {
                given.is_some_and(|indexed| writer.is_some_and(|writer| writer.is_indexed() != indexed))
            };
            if differs(sample.uv.map(|uv| uv.indices.is_some()), self.uv)
                || differs(sample.normals.map(|n| n.indices.is_some()), self.normals)
            {
                let reason = "uv and normals are indexed in every sample or never";
                return Err(archive.refuse_sample(self.positions, reason));
            }
            return Ok(());
        };
        Err(archive.refuse_sample(self.positions, &format!("{wrong} are given with every sample or never")))
    }

    fn check(&self, archive: &ArchiveWriter, sample: &PolyMeshSample<'_>, first: bool) -> Result<(), AlembicError> {
        let vertices = sample.positions.len();
        let previous = |property: PropertyId| archive.properties[property.0].previous_elements as usize;
        let refuse = |reason: String| Err(archive.refuse_sample(self.positions, &reason));
        let (faces, corners) = match sample.topology {
            Some(topology) => {
                if let Some(problem) = topology_problem(&topology, vertices) {
                    return refuse(problem);
                }
                (topology.face_counts.len(), topology.face_indices.len())
            }
            None if first => return refuse("the first sample needs the faces".into()),
            None if vertices != previous(self.positions) => {
                let before = previous(self.positions);
                return refuse(format!("{vertices} positions after {before} without new faces; give the topology"));
            }
            None => (previous(self.face_counts), previous(self.face_indices)),
        };
        if let Some(velocities) = sample.velocities.filter(|velocities| velocities.len() != vertices) {
            return refuse(format!("{} velocities for {vertices} vertices", velocities.len()));
        }
        let places = |scope| match scope {
            Scope::Constant => 1,
            Scope::Uniform => faces,
            Scope::Varying | Scope::Vertex => vertices,
            Scope::FaceVarying => corners,
        };
        let uv = sample.uv.and_then(|uv| uv.problem("uv", places(uv.scope)));
        let normals = sample.normals.and_then(|n| n.problem("N", places(n.scope)));
        match uv.or(normals) {
            Some(problem) => refuse(problem),
            None => Ok(()),
        }
    }
}

impl<const N: usize> Indexed<'_, N> {
    /// Returns the fault in these values where the scope has `places` places, if there is one.
    fn problem(&self, name: &str, places: usize) -> Option<String> {
        let given = self.indices.map_or(self.values.len(), <[u32]>::len);
        if given != places {
            let scope = self.scope.name();
            return Some(format!("{given} {name} values, but the scope `{scope}` has {places} places"));
        }
        let count = self.values.len();
        let wrong = self.indices?.iter().find(|&&index| index as usize >= count)?;
        Some(format!("{name} index {wrong} of {count} values, counted from 0"))
    }
}

/// Returns the fault in the faces of a mesh of `vertices` vertices, if there is one.
fn topology_problem(topology: &Topology<'_>, vertices: usize) -> Option<String> {
    let mut corners = 0_usize;
    for (face, &count) in topology.face_counts.iter().enumerate() {
        let Ok(count) = usize::try_from(count) else {
            return Some(format!("face {face} has {count} corners"));
        };
        corners = corners.saturating_add(count);
    }
    if corners != topology.face_indices.len() {
        let given = topology.face_indices.len();
        return Some(format!("the faces have {corners} corners, but {given} vertex indices are given"));
    }
    let outside = |&&vertex: &&i32| usize::try_from(vertex).map_or(true, |vertex| vertex >= vertices);
    let wrong = topology.face_indices.iter().find(outside)?;
    Some(format!("a face names vertex {wrong}, but there are {vertices} vertices, counted from 0"))
}
