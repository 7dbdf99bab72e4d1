//! Passing content of a read archive on to a written one, unchanged and of any type.

use super::archive::ArchiveWriter;
use super::geom_param::GeomParamWriter;
use super::tree::CompoundId;
use crate::error::AlembicError;
use crate::reader::{Compound, GeomParam, PropertyKind};

impl GeomParamWriter {
    /// Declares `param` in `parent` as a static parameter and writes its sample `index`.
    pub fn copy_static(
        archive: &mut ArchiveWriter,
        parent: CompoundId,
        param: &GeomParam,
        index: usize,
    ) -> Result<(), AlembicError> {
        let writer = Self::declare(archive, parent, &param.spec(0))?;
        if param.sample_count() == 0 {
            return Ok(());
        }
        writer.write_static(archive, &param.values(index)?, param.indices(index)?.as_deref())
    }
}

impl ArchiveWriter {
    /// Declares all properties of `from` in `into` as static ones and writes their first samples.
    pub fn copy_static_properties(&mut self, into: CompoundId, from: &Compound) -> Result<(), AlembicError> {
        for property in from.iter() {
            let (name, metadata) = (property.name(), property.metadata());
            let (copy, samples) = match property.kind() {
                PropertyKind::Compound(inside) => {
                    let compound = self.add_compound(into, name, metadata)?;
                    self.copy_static_properties(compound, inside)?;
                    continue;
                }
                PropertyKind::Scalar(samples) => {
                    (self.add_scalar_property(into, name, metadata, samples.data_type(), 0)?, samples)
                }
                PropertyKind::Array(samples) => {
                    (self.add_array_property(into, name, metadata, samples.data_type(), 0)?, samples)
                }
            };
            if !samples.is_empty() {
                self.write_static_raw(copy, &samples.raw(0)?)?;
            }
        }
        Ok(())
    }
}
