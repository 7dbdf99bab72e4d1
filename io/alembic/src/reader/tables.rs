//! The six children of the archive root, and the headers of objects.

use crate::error::{AlembicError, Fault};
use crate::ogawa::{ChunkSource, Group, Slot};
use crate::packed::{MetaDataTable, PackedObject, PackedSamples, unpack_objects, unpack_time_samplings};
use crate::time_sampling::TimeSampling;

/// Hash bytes behind the child headers of an object.
const HASHES: usize = 32;
/// Oldest library version whose files look like this.
const OLDEST_LIBRARY: i32 = 9999;

/// Data that an archive states before any object.
#[derive(Debug)]
pub(crate) struct Tables {
    pub(crate) library_version: i32,
    pub(crate) metadata: String,
    /// Sampling and largest number of samples of a property that uses it.
    pub(crate) samplings: Vec<(TimeSampling, u32)>,
    pub(crate) texts: MetaDataTable,
    pub(crate) top: Group,
}

impl Tables {
    pub(crate) fn read(source: &ChunkSource, root: Group) -> Result<Self, AlembicError> {
        let at = |place: &'static str| move |fault: Fault| fault.at(&source.path, place);
        if root.count < 6 {
            let fault = Fault::damaged(format!("the root group has {} entries, 6 are needed", root.count));
            return Err(at("root group")(fault));
        }
        let child = |index| source.child(root, index).map_err(at("root group"));
        let version = |index| {
            let bytes = source.data_start(child(index)?, 4).map_err(at("archive version"))?;
            Ok::<i32, AlembicError>(crate::property::decode::<i32>(&bytes)[0]) // four bytes are one value
        };
        let (layer, library_version) = (version(0)?, version(1)?);
        if layer != 0 || library_version < OLDEST_LIBRARY {
            let reason = format!("property layer {layer}, library {library_version}: not a known combination");
            return Err(at("archive version")(Fault::damaged(reason)));
        }
        let top = source.group(child(2)?).map_err(at("top object"))?;
        let metadata = source.data(child(3)?).map_err(at("archive metadata"))?;
        let samplings = source.data(child(4)?).and_then(|blob| unpack_time_samplings(&blob));
        let texts = source.data(child(5)?).and_then(|blob| MetaDataTable::unpack(&blob));
        Ok(Self {
            library_version,
            metadata: String::from_utf8_lossy(&metadata).into_owned(),
            samplings: samplings.map_err(at("time sampling table"))?,
            texts: texts.map_err(at("metadata table"))?,
            top,
        })
    }
}

/// Headers and groups of the children of an object.
pub(crate) fn child_headers(
    source: &ChunkSource,
    object: Group,
    texts: &MetaDataTable,
) -> Result<Vec<(PackedObject, Slot)>, Fault> {
    if object.count == 0 {
        return Ok(Vec::new());
    }
    let last = source.child(object, object.count - 1)?;
    if !last.is_data() {
        return Ok(Vec::new());
    }
    let blob = source.data(last)?;
    let Some(headers) = blob.len().checked_sub(HASHES).filter(|&length| length > 0) else {
        return Ok(Vec::new());
    };
    let headers = unpack_objects(&blob[..headers], texts)?;
    let slots = source.children(object)?;
    if headers.len() + 2 > slots.len() {
        let reason = format!("{} child headers where {} groups are stored", headers.len(), slots.len());
        return Err(Fault::damaged(reason));
    }
    Ok(headers.into_iter().zip(slots.into_iter().skip(1)).collect())
}

/// Number of slots that the samples of a property take.
pub(crate) fn sample_group_size(samples: &PackedSamples) -> usize {
    samples.stored_count() as usize * if samples.is_array { 2 } else { 1 }
}
