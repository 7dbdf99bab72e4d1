//! Digest of the datasets that are written when a cache is made: faces, texture coordinates, attributes that do not move.

use drapery_alembic::murmur3_x64_128;
use hdf5::types::VarLenUnicode;

use super::datasets::place_of;
use crate::attributes::{CONTACT, STRAIN};
use crate::formats::continuing::hexadecimal;

/// Attribute of the root that holds it.
const FIXED_DIGEST: &str = "fixed_digest";

/// Datasets of the frames, which it leaves out.
const OF_FRAMES: [&str; 7] = ["committed", CONTACT, "crossings", "normals", "positions", STRAIN, "velocities"];

/// Writes the digest of what is in the file.
pub(super) fn write(file: &hdf5::File) -> hdf5::Result<()> {
    file.flush()?;
    let text: VarLenUnicode = digest(file)?.parse().map_err(|e| hdf5::Error::from(format!("{e}")))?;
    file.new_attr::<VarLenUnicode>().create(FIXED_DIGEST)?.write_scalar(&text)
}

/// Whether the file is as it was made. Caches that were made without a digest are.
pub(super) fn is_as_made(file: &hdf5::File) -> hdf5::Result<bool> {
    if !file.attr_names()?.iter().any(|name| name == FIXED_DIGEST) {
        return Ok(true);
    }
    Ok(file.attr(FIXED_DIGEST)?.read_scalar::<VarLenUnicode>()?.as_str() == digest(file)?)
}

/// Digest of all datasets but those of the frames: name, extents and values of each.
fn digest(file: &hdf5::File) -> hdf5::Result<String> {
    let mut names = file.member_names()?;
    names.retain(|name| !OF_FRAMES.contains(&name.as_str()));
    names.sort();
    let mut bytes = Vec::new();
    for name in names {
        let dataset = file.dataset(&name)?;
        place_of(&dataset, file.size())?;
        bytes.extend(name.bytes().chain([0]));
        bytes.extend(dataset.shape().into_iter().flat_map(|extent| (extent as u64).to_le_bytes()));
        let kind = dataset.dtype()?;
        if kind.is::<f32>() {
            bytes.extend(dataset.read_raw::<f32>()?.into_iter().flat_map(f32::to_le_bytes));
        } else if kind.is::<f64>() {
            bytes.extend(dataset.read_raw::<f64>()?.into_iter().flat_map(f64::to_le_bytes));
        } else if kind.is::<i32>() {
            bytes.extend(dataset.read_raw::<i32>()?.into_iter().flat_map(i32::to_le_bytes));
        } else if kind.is::<i64>() {
            bytes.extend(dataset.read_raw::<i64>()?.into_iter().flat_map(i64::to_le_bytes));
        } else {
            return Err(format!("dataset {name} holds no numbers of this program").into());
        }
    }
    Ok(hexadecimal(murmur3_x64_128(&bytes)))
}
