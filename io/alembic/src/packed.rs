//! Packed header blobs: objects, properties, time samplings and the metadata table, in both directions.

use crate::error::Fault;
use crate::property::{DataType, PodType};
use crate::time_sampling::TimeSampling;

/// Metadata index that says "the text follows inline".
const INLINE: u8 = 0xff;
/// Most entries of the metadata table.
const TABLE_ENTRIES: usize = 254;

/// Name and metadata of a child object.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct PackedObject {
    pub(crate) name: String,
    pub(crate) metadata: String,
}

/// Header of one property in a compound.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct PackedProperty {
    pub(crate) name: String,
    pub(crate) metadata: String,
    /// None for a compound.
    pub(crate) samples: Option<PackedSamples>,
}

/// Description of the samples in the header of a scalar or array property.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct PackedSamples {
    pub(crate) is_array: bool,
    /// Every sample has exactly one element (arrays only).
    pub(crate) scalar_like: bool,
    pub(crate) homogeneous: bool,
    pub(crate) data_type: DataType,
    pub(crate) count: u32,
    pub(crate) first_changed: u32,
    pub(crate) last_changed: u32,
    pub(crate) time_sampling: u32,
}

impl PackedSamples {
    /// All samples equal, or none.
    pub(crate) fn is_constant(&self) -> bool {
        self.first_changed == 0 && self.last_changed == 0
    }

    /// Number of the stored sample that holds sample `index`.
    pub(crate) fn stored_index(&self, index: u32) -> u32 {
        if index < self.first_changed || self.is_constant() {
            0
        } else {
            index.min(self.last_changed) - self.first_changed + 1
        }
    }

    /// Returns the number of samples that are stored.
    pub(crate) fn stored_count(&self) -> u32 {
        if self.count == 0 { 0 } else { self.stored_index(self.count - 1) + 1 }
    }
}

/// Texts of the metadata table; entry 0 is the empty text.
#[derive(Debug, Default)]
pub(crate) struct MetaDataTable {
    texts: Vec<String>,
}

impl MetaDataTable {
    /// Index of `text`, which is added if it is new and fits; [`INLINE`] when it has no place.
    fn index_of(&mut self, text: &str) -> u8 {
        if text.is_empty() {
            return 0;
        }
        if let Some(found) = self.texts.iter().position(|known| known == text) {
            return found as u8 + 1; // at most TABLE_ENTRIES
        }
        if text.len() > 255 || self.texts.len() == TABLE_ENTRIES {
            return INLINE;
        }
        self.texts.push(text.to_owned());
        self.texts.len() as u8
    }

    fn text(&self, index: u8) -> Result<String, Fault> {
        let text = match index {
            0 => Some(String::new()),
            _ => self.texts.get(usize::from(index) - 1).cloned(),
        };
        text.ok_or_else(|| Fault::damaged(format!("metadata {index} is not in the table of {}", self.texts.len())))
    }

    pub(crate) fn pack(&self) -> Vec<u8> {
        self.texts.iter().flat_map(|text| std::iter::once(text.len() as u8).chain(text.bytes())).collect()
    }

    pub(crate) fn unpack(bytes: &[u8]) -> Result<Self, Fault> {
        let mut cursor = Cursor { bytes };
        let mut texts = Vec::new();
        while !cursor.bytes.is_empty() {
            let length = cursor.unsigned(1)?;
            texts.push(cursor.text(length)?);
        }
        Ok(Self { texts })
    }
}

/// Reads forward through a blob; every step is checked against its end.
struct Cursor<'a> {
    bytes: &'a [u8],
}

impl<'a> Cursor<'a> {
    fn take(&mut self, count: usize) -> Result<&'a [u8], Fault> {
        let (taken, rest) = self
            .bytes
            .split_at_checked(count)
            .ok_or_else(|| Fault::damaged(format!("a header needs {count} bytes where {} remain", self.bytes.len())))?;
        self.bytes = rest;
        Ok(taken)
    }

    /// Unsigned number of 1, 2 or 4 bytes.
    fn unsigned(&mut self, size: usize) -> Result<u32, Fault> {
        Ok(self.take(size)?.iter().rev().fold(0, |value, &byte| value << 8 | u32::from(byte)))
    }

    fn f64(&mut self) -> Result<f64, Fault> {
        let mut bytes = [0; 8];
        bytes.copy_from_slice(self.take(8)?);
        Ok(f64::from_le_bytes(bytes))
    }

    /// Text; bytes that are no UTF-8 are replaced, so that old exporters' names stay readable.
    fn text(&mut self, length: u32) -> Result<String, Fault> {
        Ok(String::from_utf8_lossy(self.take(length as usize)?).into_owned())
    }

    fn name(&mut self, length: u32) -> Result<String, Fault> {
        let name = self.text(length)?;
        if name.is_empty() || name.contains('/') {
            return Err(Fault::damaged(format!("`{}` is not a name", name.escape_default())));
        }
        Ok(name)
    }
}

/// Appends the header of a child object.
pub(crate) fn pack_object(object: &PackedObject, table: &mut MetaDataTable, blob: &mut Vec<u8>) {
    blob.extend_from_slice(&(object.name.len() as u32).to_le_bytes());
    blob.extend_from_slice(object.name.as_bytes());
    let index = table.index_of(&object.metadata);
    blob.push(index);
    if index == INLINE {
        blob.extend_from_slice(&(object.metadata.len() as u32).to_le_bytes());
        blob.extend_from_slice(object.metadata.as_bytes());
    }
}

/// Headers of the child objects; `blob` without the hashes.
pub(crate) fn unpack_objects(blob: &[u8], table: &MetaDataTable) -> Result<Vec<PackedObject>, Fault> {
    let mut cursor = Cursor { bytes: blob };
    let mut objects = Vec::new();
    while !cursor.bytes.is_empty() {
        let length = cursor.unsigned(4)?;
        let name = cursor.name(length)?;
        let index = cursor.unsigned(1)? as u8;
        let metadata = if index == INLINE {
            let length = cursor.unsigned(4)?;
            cursor.text(length)?
        } else {
            table.text(index)?
        };
        objects.push(PackedObject { name, metadata });
    }
    Ok(objects)
}

const KIND: u32 = 0x3;
const SCALAR: u32 = 1;
const ARRAY: u32 = 2;
const SCALAR_LIKE_ARRAY: u32 = 3;
const HAS_SAMPLING: u32 = 1 << 8;
const HAS_CHANGES: u32 = 1 << 9;
const HOMOGENEOUS: u32 = 1 << 10;
const CONSTANT: u32 = 1 << 11;

/// Appends the header of a property.
pub(crate) fn pack_property(property: &PackedProperty, table: &mut MetaDataTable, blob: &mut Vec<u8>) {
    let index = table.index_of(&property.metadata);
    let mut info = u32::from(index) << 20;
    let mut largest = property.name.len().max(property.metadata.len());
    let mut numbers = Vec::new();
    if let Some(samples) = &property.samples {
        info |= match (samples.is_array, samples.scalar_like) {
            (false, _) => SCALAR,
            (true, false) => ARRAY,
            (true, true) => SCALAR_LIKE_ARRAY,
        };
        info |= samples.data_type.pod.code() << 4 | u32::from(samples.data_type.extent) << 12;
        info |= if samples.homogeneous { HOMOGENEOUS } else { 0 };
        largest = largest.max(samples.count as usize).max(samples.time_sampling as usize);
        numbers.push(samples.count);
        if samples.is_constant() {
            info |= CONSTANT;
        } else if samples.first_changed != 1 || samples.last_changed + 1 != samples.count {
            info |= HAS_CHANGES;
            numbers.extend([samples.first_changed, samples.last_changed]);
        }
        if samples.time_sampling != 0 {
            info |= HAS_SAMPLING;
            numbers.push(samples.time_sampling);
        }
    }
    let hint = match largest {
        0..=0xff => 0,
        0x100..=0xffff => 1,
        _ => 2,
    };
    blob.extend_from_slice(&(info | hint << 2).to_le_bytes());
    let mut put = |number: u32| blob.extend_from_slice(&number.to_le_bytes()[..1 << hint]);
    numbers.into_iter().for_each(&mut put);
    put(property.name.len() as u32);
    blob.extend_from_slice(property.name.as_bytes());
    if index == INLINE {
        blob.extend_from_slice(&(property.metadata.len() as u32).to_le_bytes()[..1 << hint]);
        blob.extend_from_slice(property.metadata.as_bytes());
    }
}

/// Headers of the properties of a compound.
pub(crate) fn unpack_properties(blob: &[u8], table: &MetaDataTable) -> Result<Vec<PackedProperty>, Fault> {
    let mut cursor = Cursor { bytes: blob };
    let mut properties = Vec::new();
    while !cursor.bytes.is_empty() {
        properties.push(unpack_property(&mut cursor, table)?);
    }
    Ok(properties)
}

fn unpack_property(cursor: &mut Cursor<'_>, table: &MetaDataTable) -> Result<PackedProperty, Fault> {
    let info = cursor.unsigned(4)?;
    let size = match info >> 2 & 3 {
        0 => 1,
        1 => 2,
        2 => 4,
        hint => {
            return Err(Fault::damaged(format!("number size {hint} in a property header")));
        }
    };
    let samples = if info & KIND == 0 { None } else { Some(unpack_samples(cursor, info, size)?) };
    let length = cursor.unsigned(size)?;
    let name = cursor.name(length)?;
    let index = (info >> 20 & 0xff) as u8;
    let metadata = if index == INLINE {
        let length = cursor.unsigned(size)?;
        cursor.text(length)?
    } else {
        table.text(index)?
    };
    Ok(PackedProperty { name, metadata, samples })
}

fn unpack_samples(cursor: &mut Cursor<'_>, info: u32, size: usize) -> Result<PackedSamples, Fault> {
    let code = info >> 4 & 0xf;
    let pod = PodType::from_code(code).ok_or_else(|| Fault::damaged(format!("element type {code}")))?;
    let extent = (info >> 12 & 0xff) as u8;
    if extent == 0 {
        return Err(Fault::damaged("a property whose elements have no values"));
    }
    let count = cursor.unsigned(size)?;
    let (mut first_changed, mut last_changed) = (1, count.saturating_sub(1));
    if info & HAS_CHANGES != 0 {
        (first_changed, last_changed) = (cursor.unsigned(size)?, cursor.unsigned(size)?);
    } else if info & CONSTANT != 0 || count < 2 {
        (first_changed, last_changed) = (0, 0);
    }
    if first_changed > last_changed || (last_changed > 0 && (first_changed == 0 || last_changed >= count)) {
        return Err(Fault::damaged(format!("samples {first_changed} to {last_changed} of {count} are said to change")));
    }
    let time_sampling = if info & HAS_SAMPLING != 0 { cursor.unsigned(size)? } else { 0 };
    Ok(PackedSamples {
        is_array: info & KIND != SCALAR,
        scalar_like: info & KIND == SCALAR_LIKE_ARRAY,
        homogeneous: info & HOMOGENEOUS != 0,
        data_type: DataType { pod, extent },
        count,
        first_changed,
        last_changed,
        time_sampling,
    })
}

/// Appends one record of the time sampling table.
pub(crate) fn pack_time_sampling(sampling: &TimeSampling, max_samples: u32, blob: &mut Vec<u8>) {
    blob.extend_from_slice(&max_samples.to_le_bytes());
    blob.extend_from_slice(&sampling.time_per_cycle().to_le_bytes());
    blob.extend_from_slice(&(sampling.stored_times().len() as u32).to_le_bytes());
    sampling.stored_times().iter().for_each(|time| blob.extend_from_slice(&time.to_le_bytes()));
}

/// The time sampling table: sampling and largest number of samples of each.
pub(crate) fn unpack_time_samplings(blob: &[u8]) -> Result<Vec<(TimeSampling, u32)>, Fault> {
    let mut cursor = Cursor { bytes: blob };
    let mut samplings = Vec::new();
    while !cursor.bytes.is_empty() {
        let max_samples = cursor.unsigned(4)?;
        let time_per_cycle = cursor.f64()?;
        let count = cursor.unsigned(4)? as usize;
        if count > cursor.bytes.len() / 8 {
            return Err(Fault::damaged(format!("a time sampling of {count} times, more than the table holds")));
        }
        let times = (0..count).map(|_| cursor.f64()).collect::<Result<Vec<_>, _>>()?;
        let sampling = TimeSampling::checked(time_per_cycle, times).map_err(|e| Fault::damaged(e.to_string()))?;
        samplings.push((sampling, max_samples));
    }
    if samplings.is_empty() {
        return Err(Fault::damaged("the time sampling table is empty"));
    }
    Ok(samplings)
}
