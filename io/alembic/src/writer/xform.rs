//! Transform objects with one matrix operation.

use super::archive::ArchiveWriter;
use super::tree::{CompoundId, ObjectId, PropertyId};
use crate::error::AlembicError;
use crate::geom::{IDENTITY, Matrix};
use crate::metadata::MetaData;
use crate::property::{DataType, PodType, encode};

/// Code of the matrix operation in `.ops`.
const MATRIX_OP: u8 = 0x30;
/// Property of a transform that is not the identity all the time.
const MOVES: &str = "isNotConstantIdentity";
const CHANNELS: [u32; 16] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15];

/// Writes the samples of one transform.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct XformWriter {
    object: ObjectId,
    compound: CompoundId,
    inherits: PropertyId,
    values: PropertyId,
}

impl XformWriter {
    /// A transform that never changes: `matrix`, or the identity.
    pub fn still(
        archive: &mut ArchiveWriter,
        parent: ObjectId,
        name: &str,
        matrix: Option<&Matrix>,
    ) -> Result<Self, AlembicError> {
        let xform = Self::declare(archive, parent, name, 0)?;
        let matrix = matrix.unwrap_or(&IDENTITY);
        if archive.sample_count(xform.values) == 0 {
            xform.write(archive, matrix)?;
        } else {
            archive.write_static_raw(xform.values, &encode(matrix))?;
            archive.declare_member(xform.compound, MOVES);
        }
        Ok(xform)
    }

    /// A transform with the sampling `time_sampling`; samples are given by [`XformWriter::write`].
    pub fn declare(
        archive: &mut ArchiveWriter,
        parent: ObjectId,
        name: &str,
        time_sampling: u32,
    ) -> Result<Self, AlembicError> {
        let metadata = MetaData::new().with("schema", "AbcGeom_Xform_v3");
        let object_metadata = metadata.clone().with("schemaObjTitle", "AbcGeom_Xform_v3:.xform");
        let object = archive.add_object(parent, name, &object_metadata)?;
        let top = archive.top_compound(object);
        let compound = archive.add_compound(top, ".xform", &metadata)?;
        let none = MetaData::new();
        let inherits = archive.add_scalar_property(
            compound,
            ".inherits",
            &none,
            DataType::new(PodType::Bool, 1),
            time_sampling,
        )?;
        archive.write_static_scalar(compound, ".ops", &[MATRIX_OP])?;
        let values =
            archive.add_scalar_property(compound, ".vals", &none, DataType::new(PodType::F64, 16), time_sampling)?;
        Ok(Self { object, compound, inherits, values })
    }

    /// The transform object: parent of what it moves.
    pub fn object(&self) -> ObjectId {
        self.object
    }

    /// Next sample: the local matrix, which applies before those of the parents.
    pub fn write(&self, archive: &mut ArchiveWriter, matrix: &Matrix) -> Result<(), AlembicError> {
        archive.write_sample(self.values, matrix)?;
        match archive.sample_count(self.inherits) {
            0 => archive.write_sample(self.inherits, &[true])?,
            _ => archive.set_same_as_previous(self.inherits)?,
        }
        let moved = archive.properties[self.values.0].last_changed > 0;
        if moved && archive.find_property(self.compound, ".animChans").is_none() {
            let channel_type = DataType::new(PodType::U32, 1);
            let channels =
                archive.add_array_property(self.compound, ".animChans", &MetaData::new(), channel_type, 0)?;
            archive.write_sample(channels, &CHANNELS)?;
        }
        if *matrix != IDENTITY && archive.find_property(self.compound, MOVES).is_none() {
            archive.write_static_scalar(self.compound, MOVES, &[true])?;
        }
        Ok(())
    }
}
