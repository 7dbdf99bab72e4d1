//! Face sets: named groups of faces, child objects of a mesh.

use super::archive::ArchiveWriter;
use super::tree::ObjectId;
use crate::error::AlembicError;
use crate::geom::EMPTY_BOUNDS;
use crate::metadata::MetaData;
use crate::property::{DataType, PodType, encode};

/// Writes the static face set `name` with the face numbers `faces` under the mesh object `mesh`.
///
/// `exclusive` says that no face is in two exclusive sets (as for materials). Bounds are stored as empty.
pub fn write_face_set(
    archive: &mut ArchiveWriter,
    mesh: ObjectId,
    name: &str,
    faces: &[i32],
    exclusive: bool,
) -> Result<ObjectId, AlembicError> {
    let metadata = MetaData::new().with("schema", "AbcGeom_FaceSet_v1").with("schemaBaseType", "AbcGeom_GeomBase_v1");
    let object_metadata = MetaData::parse(
        "schema=AbcGeom_FaceSet_v1;schemaBaseType=AbcGeom_GeomBase_v1;schemaObjTitle=AbcGeom_FaceSet_v1:.faceset",
    );
    let object = archive.add_object(mesh, name, &object_metadata)?;
    let top = archive.top_compound(object);
    let compound = archive.add_compound(top, ".faceset", &metadata)?;
    let bounds = archive.add_bounds_property(compound, ".selfBnds", 0)?;
    archive.write_static_raw(bounds, &encode(&EMPTY_BOUNDS))?;
    let index_type = DataType::new(PodType::I32, 1);
    let property = archive.add_array_property(compound, ".faces", &MetaData::new(), index_type, 0)?;
    archive.write_static_raw(property, &encode(faces))?;
    if exclusive {
        archive.write_static_scalar(compound, ".facesExclusive", &[1_u32])?;
    }
    Ok(object)
}
