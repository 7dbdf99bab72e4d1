//! Writing samples: payload to disk once, slot to the property.

use super::archive::ArchiveWriter;
use super::tree::{CompoundId, PropertyId, SampleKey, StoredSample};
use crate::error::AlembicError;
use crate::geom::{Bounds, Visibility};
use crate::metadata::MetaData;
use crate::murmur::murmur3_x64_128;
use crate::ogawa::Slot;
use crate::property::{DataType, PodType, PodValue, encode_strings};

/// Most payloads remembered for de-duplication; later ones are simply stored again when they repeat.
pub(super) const MOST_KNOWN: usize = 1 << 18;

impl ArchiveWriter {
    /// Writes the next sample of an array property, or of a scalar property with `extent` values.
    ///
    /// Fails when `T` is not the declared type, when the number of values does not fit, when the disk is full, and
    /// when an acyclic sampling has no more times.
    pub fn write_sample<T: PodValue>(&mut self, property: PropertyId, values: &[T]) -> Result<(), AlembicError> {
        let declared = self.properties[property.0].data_type;
        if declared.pod != T::POD {
            let reason = format!("{} values given, {} declared", T::POD.name(), declared.pod.name());
            return Err(self.refuse_sample(property, &reason));
        }
        self.begin_chunk();
        self.chunk.reserve(std::mem::size_of_val(values));
        for value in values {
            value.put(&mut self.chunk);
        }
        self.store_chunk(property)
    }

    /// Writes the next sample of a string property.
    pub fn write_string_sample<S: AsRef<str>>(
        &mut self,
        property: PropertyId,
        strings: &[S],
    ) -> Result<(), AlembicError> {
        if self.properties[property.0].data_type.pod != PodType::String {
            return Err(self.refuse_sample(property, "strings given to a property of another type"));
        }
        let Some(bytes) = encode_strings(strings) else {
            return Err(self.refuse_sample(property, "strings cannot contain NUL"));
        };
        self.write_raw_sample(property, &bytes)
    }

    /// Writes the next sample from its stored bytes: little-endian values, or strings each followed by a NUL.
    pub fn write_raw_sample(&mut self, property: PropertyId, payload: &[u8]) -> Result<(), AlembicError> {
        self.begin_chunk();
        self.chunk.extend_from_slice(payload);
        self.store_chunk(property)
    }

    /// Whether the last sample of a property has these values, by their digests.
    pub fn last_sample_is<T: PodValue>(&self, property: PropertyId, values: &[T]) -> bool {
        let node = &self.properties[property.0];
        node.previous == Some(key_of(node.data_type, &crate::property::encode(values)))
    }

    /// The next sample equals the previous one; nothing is hashed or written.
    pub fn set_same_as_previous(&mut self, property: PropertyId) -> Result<(), AlembicError> {
        self.check_room(property)?;
        let node = &mut self.properties[property.0];
        if node.count == 0 {
            return Err(self.refuse_sample(property, "there is no previous sample; give the first one"));
        }
        node.count += 1;
        self.changed = true;
        Ok(())
    }

    /// Declares a static scalar property and gives its value; in a continued file it must be the stored one.
    pub fn write_static_scalar<T: PodValue>(
        &mut self,
        parent: CompoundId,
        name: &str,
        values: &[T],
    ) -> Result<(), AlembicError> {
        let Some(extent) = u8::try_from(values.len()).ok().filter(|&extent| extent > 0) else {
            return Err(self.refuse(&self.place_in(parent, name), "a scalar has 1 to 255 values; use an array"));
        };
        let data_type = DataType::new(T::POD, extent);
        let property = self.add_scalar_property(parent, name, &MetaData::new(), data_type, 0)?;
        self.write_static_raw(property, &crate::property::encode(values))
    }

    /// Declares a static string property and gives its value; in a continued file it must be the stored one.
    pub fn write_static_string(&mut self, parent: CompoundId, name: &str, text: &str) -> Result<(), AlembicError> {
        let data_type = DataType::new(PodType::String, 1);
        let property = self.add_scalar_property(parent, name, &MetaData::new(), data_type, 0)?;
        match encode_strings(&[text]) {
            Some(bytes) => self.write_static_raw(property, &bytes),
            None => Err(self.refuse_sample(property, "strings cannot contain NUL")),
        }
    }

    /// Gives the only sample of a static property. In a continued file, checks that it is the stored one.
    pub fn write_static_raw(&mut self, property: PropertyId, payload: &[u8]) -> Result<(), AlembicError> {
        let node = &self.properties[property.0];
        if node.count == 0 {
            return self.write_raw_sample(property, payload);
        }
        if node.count == 1 && node.previous == Some(key_of(node.data_type, payload)) {
            return Ok(());
        }
        let reason =
            "a static property already has a different value; continue with the values that the file was started with";
        Err(self.refuse_sample(property, reason))
    }

    /// Declares `visible` of an object; samples are given by [`ArchiveWriter::write_visibility`].
    pub fn add_visibility(&mut self, object: super::ObjectId, time_sampling: u32) -> Result<PropertyId, AlembicError> {
        let top = self.top_compound(object);
        self.add_scalar_property(top, "visible", &MetaData::new(), DataType::new(PodType::I8, 1), time_sampling)
    }

    /// Next sample of a property made by [`ArchiveWriter::add_visibility`].
    pub fn write_visibility(&mut self, property: PropertyId, value: Visibility) -> Result<(), AlembicError> {
        self.write_sample(property, &[value.value()])
    }

    /// Next sample of the world bounds of everything in the archive.
    pub fn write_archive_bounds(&mut self, time_sampling: u32, bounds: &Bounds) -> Result<(), AlembicError> {
        let top = self.top_compound(self.root());
        let property = match self.find_property(top, ".childBnds") {
            Some(found) => found,
            None => self.add_archive_bounds(time_sampling)?,
        };
        self.write_sample(property, bounds)
    }

    /// Declares the world bounds of everything; [`ArchiveWriter::write_archive_bounds`] does it with the first sample.
    pub fn add_archive_bounds(&mut self, time_sampling: u32) -> Result<PropertyId, AlembicError> {
        let top = self.top_compound(self.root());
        self.add_bounds_property(top, ".childBnds", time_sampling)
    }

    pub(super) fn add_bounds_property(
        &mut self,
        parent: CompoundId,
        name: &str,
        time_sampling: u32,
    ) -> Result<PropertyId, AlembicError> {
        let metadata = MetaData::new().with("interpretation", "box");
        self.add_scalar_property(parent, name, &metadata, DataType::new(PodType::F64, 6), time_sampling)
    }

    pub(super) fn refuse_sample(&self, property: PropertyId, reason: &str) -> AlembicError {
        let node = &self.properties[property.0];
        self.refuse(&node.place, &format!("sample {}: {reason}", node.count))
    }

    /// Leaves room for size and digest, which are known only after the payload.
    fn begin_chunk(&mut self) {
        self.chunk.clear();
        self.chunk.resize(24, 0);
    }

    fn check_room(&self, property: PropertyId) -> Result<(), AlembicError> {
        let node = &self.properties[property.0];
        if self.sealed {
            return Err(self.refuse_sample(property, "the file has no value here"));
        }
        let most = self.samplings[node.time_sampling as usize].most_samples().min(u32::MAX as usize - 1);
        if node.count as usize >= most {
            return Err(self.refuse_sample(property, &format!("its time sampling has only {most} times")));
        }
        Ok(())
    }

    /// Stores `self.chunk` (24 free bytes, then the payload) as the next sample.
    fn store_chunk(&mut self, property: PropertyId) -> Result<(), AlembicError> {
        self.check_room(property)?;
        let node = &self.properties[property.0];
        let payload = &self.chunk[24..];
        let Some(elements) = node.data_type.count_elements(payload) else {
            let reason = format!("{} bytes are not a whole number of elements", payload.len());
            return Err(self.refuse_sample(property, &reason));
        };
        if !node.is_array && elements != 1 {
            return Err(self.refuse_sample(property, &format!("{elements} elements given to a scalar property")));
        }
        let (key, is_array) = (key_of(node.data_type, payload), node.is_array);
        let stored = if node.previous == Some(key) {
            StoredSample { payload: Slot::EMPTY_DATA.0, dimensions: Slot::EMPTY_DATA.0 } // not used by `push`
        } else {
            self.stored_payload(key, is_array, elements as u64)?
        };
        self.properties[property.0].push(stored, key, elements as u64);
        self.changed = true;
        Ok(())
    }

    /// Slots of the payload in `self.chunk`: those of an equal one in the file, or of a new chunk.
    fn stored_payload(&mut self, key: SampleKey, is_array: bool, elements: u64) -> Result<StoredSample, AlembicError> {
        let known = self.known.get(&key).copied();
        let mut stored = known.unwrap_or(StoredSample { payload: 0, dimensions: 0 });
        if stored.payload == 0 {
            stored.payload = self.append_payload(&key)?.0;
        }
        if stored.dimensions == 0 && is_array {
            stored.dimensions = if key.text != 0 { self.append_dimensions(elements)? } else { Slot::EMPTY_DATA }.0;
        }
        if key.size > 0 && (known.is_some() || self.known.len() < MOST_KNOWN) {
            self.known.insert(key, stored);
        }
        Ok(stored)
    }

    fn append_payload(&mut self, key: &SampleKey) -> Result<Slot, AlembicError> {
        if key.size == 0 {
            return Ok(Slot::EMPTY_DATA);
        }
        self.chunk[..8].copy_from_slice(&(key.size + 16).to_le_bytes());
        self.chunk[8..24].copy_from_slice(&key.digest);
        let chunk = std::mem::take(&mut self.chunk);
        let done = self.append_chunk(&chunk);
        self.chunk = chunk;
        done
    }

    fn append_dimensions(&mut self, elements: u64) -> Result<Slot, AlembicError> {
        let chunk = [8_u64.to_le_bytes(), elements.to_le_bytes()].concat();
        self.append_chunk(&chunk)
    }

    fn append_chunk(&mut self, chunk: &[u8]) -> Result<Slot, AlembicError> {
        let offset = self.end;
        self.write_at(offset, chunk)?;
        self.end += chunk.len() as u64; // a failed write leaves the end where it was
        Ok(Slot::data(offset))
    }
}

/// Identity of `payload` in a property of this type.
fn key_of(data_type: DataType, payload: &[u8]) -> SampleKey {
    SampleKey { size: payload.len() as u64, digest: murmur3_x64_128(payload), text: text_class(data_type) }
}

/// Strings equal only strings, wide strings only wide strings.
pub(super) fn text_class(data_type: DataType) -> u8 {
    match data_type.pod {
        PodType::String => 1,
        PodType::WideString => 2,
        _ => 0,
    }
}
