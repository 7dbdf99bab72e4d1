//! Geometry parameters: UVs, normals and free attributes.

use super::properties::{Compound, Property, PropertyKind, Samples};
use crate::error::AlembicError;
use crate::geom::Scope;
use crate::metadata::MetaData;
use crate::property::{DataType, PodValue};
use crate::writer::GeomParamSpec;

/// A geometry parameter, plain or indexed.
#[derive(Debug, Clone)]
pub struct GeomParam {
    name: String,
    metadata: MetaData,
    values: Samples,
    indices: Option<Samples>,
}

impl GeomParam {
    /// `property` as a geometry parameter; none when it is neither an array nor a compound with values.
    pub(super) fn of(property: &Property) -> Option<Self> {
        let (values, indices) = match property.kind() {
            PropertyKind::Array(samples) => (samples.clone(), None),
            PropertyKind::Compound(compound) => {
                (compound.samples(".vals")?.clone(), compound.samples(".indices").cloned())
            }
            PropertyKind::Scalar(_) => return None,
        };
        Some(Self { name: property.name().to_owned(), metadata: property.metadata().clone(), values, indices })
    }

    pub(super) fn all(compound: &Compound) -> Vec<Self> {
        compound.iter().filter_map(Self::of).collect()
    }

    /// Name of the property.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Returns the part of the object that one value belongs to.
    pub fn scope(&self) -> Scope {
        Scope::from_name(self.metadata.get("geoScope").unwrap_or_default())
    }

    /// Returns the meaning of the numbers; a text as in [`crate::Interpretation::name`].
    pub fn interpretation(&self) -> &str {
        self.metadata.get("interpretation").unwrap_or_default()
    }

    /// Name of a UV set, when it has one.
    pub fn source_name(&self) -> Option<&str> {
        self.metadata.get("sourceName")
    }

    /// Type of one value.
    pub fn data_type(&self) -> DataType {
        self.values.data_type()
    }

    /// True when values are stored once and used by index.
    pub fn is_indexed(&self) -> bool {
        self.indices.is_some()
    }

    /// True when no sample differs from the first.
    pub fn is_constant(&self) -> bool {
        self.values.is_constant() && self.indices.as_ref().is_none_or(Samples::is_constant)
    }

    /// Number of samples.
    pub fn sample_count(&self) -> usize {
        self.values.len().max(self.indices.as_ref().map_or(0, Samples::len))
    }

    /// Times of the samples.
    pub fn samples(&self) -> &Samples {
        &self.values
    }

    /// Returns the specification that a writer needs to make the same parameter with the sampling `time_sampling` of
    /// its archive.
    pub fn spec(&self, time_sampling: u32) -> GeomParamSpec<'_> {
        GeomParamSpec {
            name: &self.name,
            scope: self.scope(),
            data_type: self.data_type(),
            interpretation: self.interpretation(),
            source_name: self.source_name(),
            indexed: self.is_indexed(),
            time_sampling,
        }
    }

    /// Stored bytes of the values of sample `index`, for [`crate::GeomParamWriter::write_raw`].
    pub fn values(&self, index: usize) -> Result<Vec<u8>, AlembicError> {
        self.values.raw(clamp(index, &self.values))
    }

    /// Indices of sample `index`; none when the parameter is not indexed.
    pub fn indices(&self, index: usize) -> Result<Option<Vec<u32>>, AlembicError> {
        self.indices.as_ref().map(|indices| indices.values(clamp(index, indices))).transpose()
    }

    /// Values of sample `index` as stored, without the indices applied. Fails when `T` × `N` is not the stored type.
    pub fn elements<T: PodValue, const N: usize>(&self, index: usize) -> Result<Vec<[T; N]>, AlembicError> {
        self.values.elements(clamp(index, &self.values))
    }

    /// Values of sample `index` with the indices applied: one for each place of the scope.
    ///
    /// Fails when `T` × `N` is not the stored type and when an index is out of range.
    pub fn expanded<T: PodValue, const N: usize>(&self, index: usize) -> Result<Vec<[T; N]>, AlembicError> {
        let values = self.elements::<T, N>(index)?;
        let Some(indices) = self.indices(index)? else {
            return Ok(values);
        };
        let pick = |&index: &u32| values.get(index as usize).copied();
        indices.iter().map(pick).collect::<Option<_>>().ok_or_else(|| {
            self.values.damaged(format!("sample {index}: an index is not below the {} values", values.len()))
        })
    }

    /// Text values of sample `index`, without the indices applied.
    pub fn strings(&self, index: usize) -> Result<Vec<String>, AlembicError> {
        self.values.strings(clamp(index, &self.values))
    }
}

/// A static parameter holds for every sample of its mesh.
fn clamp(index: usize, samples: &Samples) -> usize {
    index.min(samples.len().saturating_sub(1))
}
