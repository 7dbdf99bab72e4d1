//! Geometry parameters: UVs, normals and free attributes, plain or indexed, in any scope.

use super::archive::ArchiveWriter;
use super::tree::{CompoundId, PropertyId};
use crate::error::AlembicError;
use crate::geom::{Interpretation, Scope};
use crate::metadata::MetaData;
use crate::property::{DataType, PodType, PodValue};

/// Specification of a geometry parameter.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct GeomParamSpec<'a> {
    /// Name of the property, such as `uv` or `temperature`.
    pub name: &'a str,
    /// Part of the object that one value belongs to.
    pub scope: Scope,
    /// Type of one value, such as 2 × `F32`.
    pub data_type: DataType,
    /// Meaning of the numbers; a text as in [`Interpretation::name`].
    pub interpretation: &'a str,
    /// Name of a UV set, when it has one.
    pub source_name: Option<&'a str>,
    /// True to store each value once and an index for each place it is used.
    pub indexed: bool,
    /// Index from [`ArchiveWriter::add_time_sampling`]; 0 for a static parameter.
    pub time_sampling: u32,
}

impl GeomParamSpec<'_> {
    /// UV coordinates of a mesh: 2 × `F32`, one for each face corner.
    pub fn uv(indexed: bool, time_sampling: u32) -> Self {
        Self {
            name: "uv",
            scope: Scope::FaceVarying,
            data_type: DataType::new(PodType::F32, 2),
            interpretation: Interpretation::Vector.name(),
            source_name: None,
            indexed,
            time_sampling,
        }
    }

    /// Normals of a mesh: 3 × `F32`.
    pub fn normals(scope: Scope, indexed: bool, time_sampling: u32) -> Self {
        Self {
            name: "N",
            scope,
            data_type: DataType::new(PodType::F32, 3),
            interpretation: Interpretation::Normal.name(),
            source_name: None,
            indexed,
            time_sampling,
        }
    }

    fn metadata(&self) -> MetaData {
        MetaData::new()
            .with("arrayExtent", "1")
            .with("geoScope", self.scope.name())
            .with("interpretation", self.interpretation)
            .with("isGeomParam", "true")
            .with("podExtent", &self.data_type.extent.to_string())
            .with("podName", self.data_type.pod.name())
            .with("sourceName", self.source_name.unwrap_or_default())
    }
}

/// Writes the samples of one geometry parameter.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct GeomParamWriter {
    values: PropertyId,
    indices: Option<PropertyId>,
}

impl GeomParamWriter {
    /// Declares the parameter in `parent`, a `.geom` or `.arbGeomParams` compound.
    pub fn declare(
        archive: &mut ArchiveWriter,
        parent: CompoundId,
        spec: &GeomParamSpec<'_>,
    ) -> Result<Self, AlembicError> {
        let metadata = spec.metadata();
        let (data_type, sampling) = (spec.data_type, spec.time_sampling);
        if !spec.indexed {
            let values = archive.add_array_property(parent, spec.name, &metadata, data_type, sampling)?;
            return Ok(Self { values, indices: None });
        }
        let compound = archive.add_compound(parent, spec.name, &metadata)?;
        let values = archive.add_array_property(compound, ".vals", &metadata, data_type, sampling)?;
        let index_type = DataType::new(PodType::U32, 1);
        let indices = archive.add_array_property(compound, ".indices", &MetaData::new(), index_type, sampling)?;
        Ok(Self { values, indices: Some(indices) })
    }

    /// The parameter `name` that `parent` already has.
    pub(super) fn find(archive: &ArchiveWriter, parent: CompoundId, name: &str) -> Option<Self> {
        if let Some(values) = archive.find_property(parent, name) {
            return Some(Self { values, indices: None });
        }
        let compound = archive.find_compound(parent, name)?;
        let values = archive.find_property(compound, ".vals")?;
        Some(Self { values, indices: archive.find_property(compound, ".indices") })
    }

    pub(super) fn is_indexed(&self) -> bool {
        self.indices.is_some()
    }

    /// Number of samples.
    pub fn sample_count(&self, archive: &ArchiveWriter) -> usize {
        archive.sample_count(self.values)
    }

    /// Whether the last sample has these values and indices.
    pub(super) fn last_is<T: PodValue>(&self, archive: &ArchiveWriter, values: &[T], indices: Option<&[u32]>) -> bool {
        archive.last_sample_is(self.values, values)
            && match (self.indices, indices) {
                (Some(property), Some(indices)) => archive.last_sample_is(property, indices),
                (stored, given) => stored.is_none() && given.is_none(),
            }
    }

    /// Next sample: `values` one element after another, and `indices` exactly when the parameter is indexed.
    pub fn write<T: PodValue>(
        &self,
        archive: &mut ArchiveWriter,
        values: &[T],
        indices: Option<&[u32]>,
    ) -> Result<(), AlembicError> {
        if let Some(indices) = indices {
            let count = values.len() / usize::from(archive.properties[self.values.0].data_type.extent);
            if let Some(wrong) = indices.iter().find(|&&index| index as usize >= count) {
                return Err(archive.refuse_sample(self.values, &format!("index {wrong} of {count} values")));
            }
        }
        self.check_indices(archive, indices)?;
        archive.write_sample(self.values, values)?;
        self.write_indices(archive, indices)
    }

    /// Next sample from stored bytes, such as those of [`crate::GeomParam::values`].
    pub fn write_raw(
        &self,
        archive: &mut ArchiveWriter,
        values: &[u8],
        indices: Option<&[u32]>,
    ) -> Result<(), AlembicError> {
        self.check_indices(archive, indices)?;
        archive.write_raw_sample(self.values, values)?;
        self.write_indices(archive, indices)
    }

    /// The only sample of a static parameter, from stored bytes; in a continued file it must be the stored one.
    pub fn write_static(
        &self,
        archive: &mut ArchiveWriter,
        values: &[u8],
        indices: Option<&[u32]>,
    ) -> Result<(), AlembicError> {
        self.check_indices(archive, indices)?;
        archive.write_static_raw(self.values, values)?;
        match (self.indices, indices) {
            (Some(property), Some(indices)) => archive.write_static_raw(property, &crate::property::encode(indices)),
            _ => Ok(()),
        }
    }

    /// The next sample equals the previous one.
    pub fn set_same_as_previous(&self, archive: &mut ArchiveWriter) -> Result<(), AlembicError> {
        archive.set_same_as_previous(self.values)?;
        self.indices.map_or(Ok(()), |indices| archive.set_same_as_previous(indices))
    }

    fn check_indices(&self, archive: &ArchiveWriter, indices: Option<&[u32]>) -> Result<(), AlembicError> {
        match (self.indices, indices) {
            (Some(_), None) => Err(archive.refuse_sample(self.values, "an indexed parameter needs indices")),
            (None, Some(_)) => Err(archive.refuse_sample(self.values, "indices for a parameter declared without")),
            _ => Ok(()),
        }
    }

    fn write_indices(&self, archive: &mut ArchiveWriter, indices: Option<&[u32]>) -> Result<(), AlembicError> {
        match (self.indices, indices) {
            (Some(property), Some(indices)) => archive.write_sample(property, indices),
            _ => Ok(()),
        }
    }
}
