//! Re-opening an archive to continue it: the tables of the last commit become writer state again.

use std::fs::OpenOptions;
use std::path::Path;

use super::archive::ArchiveWriter;
use super::samples::{MOST_KNOWN, text_class};
use super::tree::{CompoundId, PropertyNode, SampleKey, StoredSample, chain};
use crate::error::{AlembicError, Fault};
use crate::ogawa::{ChunkSource, Group, Slot};
use crate::packed::{PackedProperty, PackedSamples, unpack_properties};
use crate::property::decode;
use crate::reader::tables::{Tables, child_headers, sample_group_size};

impl ArchiveWriter {
    /// Opens a committed archive to go on after its last commit; what a killed writer left behind it is written
    /// over.
    ///
    /// The bytes of a file written in one go and of one that was closed and continued are equal. Meant for archives
    /// of this writer; it refuses what it cannot continue, such as groups shared between objects.
    pub fn append(path: impl AsRef<Path>) -> Result<Self, AlembicError> {
        let path = path.as_ref();
        let (source, root) = ChunkSource::open(path)?;
        let mut writer = Self::restored(path, &source, root)?;
        writer.make_room(writer.end, writer.end)?;
        Ok(writer)
    }

    /// The writer as it was after the commit with this root; the file is opened for writing and not changed.
    pub(super) fn restored(path: &Path, source: &ChunkSource, root: Group) -> Result<Self, AlembicError> {
        let tables = Tables::read(source, root)?;
        let failed = |source| AlembicError::Io { path: path.to_owned(), action: "open for writing", source };
        let file = OpenOptions::new().read(true).write(true).open(path).map_err(failed)?;
        let mut writer = Self::empty(path.to_owned(), file, tables.metadata.clone());
        writer.samplings = tables.samplings.iter().map(|(sampling, _)| sampling.clone()).collect();
        writer.insert_object(None, "ABC", String::new());
        writer.objects[0].declared = true;

        let mut restore = Restore { source, tables: &tables, writer, end: root.end(), slots: 0, payloads: Vec::new() };
        restore.objects()?;
        let Restore { mut writer, end, mut payloads, .. } = restore;
        // In file order, the order in which a writer that was never closed has met them.
        payloads.sort_by_key(|(_, stored)| stored.payload);
        for (key, stored) in payloads {
            if writer.known.len() < MOST_KNOWN || writer.known.contains_key(&key) {
                let known = writer.known.entry(key).or_insert(stored);
                known.dimensions = known.dimensions.max(stored.dimensions);
            }
        }
        writer.end = end;
        writer.committed = true;
        writer.changed = false;
        Ok(writer)
    }
}

struct Restore<'a> {
    source: &'a ChunkSource,
    tables: &'a Tables,
    writer: ArchiveWriter,
    /// Largest end of any chunk in use.
    end: u64,
    /// Sample slots met so far; more than fit into the file means shared groups.
    slots: usize,
    payloads: Vec<(SampleKey, StoredSample)>,
}

impl Restore<'_> {
    fn objects(&mut self) -> Result<(), AlembicError> {
        let mut waiting = vec![(0, self.tables.top)];
        let mut seen = 0_u64;
        while let Some((object, group)) = waiting.pop() {
            let place = self.writer.objects[object].path.clone();
            let at = |fault: Fault| fault.at(&self.source.path, &place);
            seen += 1;
            if seen > self.source.length / 8 {
                return Err(at(Fault::damaged("more objects than the file has room for")));
            }
            self.reach(group.end());
            let children = child_headers(self.source, group, &self.tables.texts).map_err(at)?;
            let slots = self.source.children(group).map_err(at)?;
            if let Some(&slot) = slots.first() {
                let properties = self.source.group(slot).map_err(at)?;
                let top = CompoundId(self.writer.objects[object].properties);
                self.compound(properties, top).map_err(at)?;
            }
            if let Some(&slot) = slots.last().filter(|slot| slot.is_data()) {
                self.reach_data(slot).map_err(at)?;
            }
            for (header, slot) in children {
                let group = self.source.group(slot).map_err(at)?;
                let child = self.writer.insert_object(Some(object), &header.name, header.metadata);
                waiting.push((child, group));
            }
        }
        Ok(())
    }

    fn reach(&mut self, end: u64) {
        self.end = self.end.max(end);
    }

    fn reach_data(&mut self, slot: Slot) -> Result<(), Fault> {
        if !slot.is_empty() {
            let size = self.source.data_size(slot)?;
            self.reach(slot.offset() + 8 + size);
        }
        Ok(())
    }

    fn compound(&mut self, group: Group, into: CompoundId) -> Result<(), Fault> {
        if group.count == 0 {
            return Ok(());
        }
        self.reach(group.end());
        if self.writer.compounds[into.0].depth > 200 {
            return Err(Fault::damaged("compounds nested more than 200 deep"));
        }
        let slots = self.source.children(group)?;
        let (&headers, slots) = slots.split_last().ok_or_else(|| Fault::damaged("an empty compound"))?;
        self.reach_data(headers)?;
        let headers = unpack_properties(&self.source.data(headers)?, &self.tables.texts)?;
        if headers.len() != slots.len() {
            return Err(Fault::damaged(format!("{} property headers for {} properties", headers.len(), slots.len())));
        }
        if self.writer.properties.len() + self.writer.compounds.len() > self.source.length as usize / 8 {
            return Err(Fault::damaged("more properties than the file has room for"));
        }
        for (header, &slot) in headers.into_iter().zip(slots) {
            let group = self.source.group(slot)?;
            match header.samples {
                None => {
                    let index = self.writer.insert_compound(into, &header.name, header.metadata);
                    self.compound(group, CompoundId(index))?;
                }
                Some(samples) => self.property(group, into, header, samples)?,
            }
        }
        Ok(())
    }

    fn property(
        &mut self,
        group: Group,
        into: CompoundId,
        header: PackedProperty,
        samples: PackedSamples,
    ) -> Result<(), Fault> {
        if samples.time_sampling as usize >= self.writer.samplings.len() {
            return Err(Fault::damaged(format!("`{}` uses an unknown time sampling", header.name)));
        }
        let per_sample = if samples.is_array { 2 } else { 1 };
        self.slots += group.count;
        if self.slots > self.source.length as usize / 8 {
            return Err(Fault::damaged("groups are shared between properties"));
        }
        let wanted = sample_group_size(&samples);
        if group.count != wanted {
            let reason = format!("`{}` stores {} slots, its header says {wanted}", header.name, group.count);
            return Err(Fault::damaged(reason));
        }
        if group.count > 0 {
            self.reach(group.end());
        }
        let mut node = PropertyNode {
            place: self.writer.place_in(into, &header.name),
            name: header.name,
            metadata: header.metadata,
            is_array: samples.is_array,
            data_type: samples.data_type,
            time_sampling: samples.time_sampling,
            count: samples.count,
            first_changed: samples.first_changed,
            last_changed: samples.last_changed,
            stored: Vec::with_capacity(group.count / per_sample),
            previous: None,
            previous_elements: 0,
            scalar_like: samples.scalar_like || samples.count == 0,
            homogeneous: samples.homogeneous,
            content: [0; 16],
            declared: false,
        };
        let slots = self.source.children(group)?;
        for entry in slots.chunks_exact(per_sample) {
            let dimensions = entry.get(1).map_or(0, |slot| slot.0);
            let stored = StoredSample { payload: entry[0].0, dimensions };
            self.reach_data(entry[0])?;
            entry.get(1).map_or(Ok(()), |&slot| self.reach_data(slot))?;
            let key = self.key(entry[0], &samples)?;
            node.stored.push(stored);
            node.content = chain(&node.content, &key.digest);
            node.previous = Some(key);
            if key.size > 0 {
                self.payloads.push((key, stored));
            }
        }
        if let (Some(stored), Some(key)) = (node.stored.last(), node.previous) {
            node.previous_elements = self.elements(stored, &key, &samples)?;
        }
        self.writer.insert_property(into, node);
        Ok(())
    }

    fn key(&self, payload: Slot, samples: &PackedSamples) -> Result<SampleKey, Fault> {
        let text = text_class(samples.data_type);
        if payload.is_empty() {
            return Ok(SampleKey { size: 0, digest: [0; 16], text });
        }
        let size = self.source.data_size(payload)?;
        let mut digest = [0; 16];
        digest.copy_from_slice(&self.source.data_start(payload, 16)?);
        Ok(SampleKey { size: size - 16, digest, text })
    }

    fn elements(&self, stored: &StoredSample, key: &SampleKey, samples: &PackedSamples) -> Result<u64, Fault> {
        if samples.is_array && !Slot(stored.dimensions).is_empty() {
            let dimensions: Vec<u64> = decode(&self.source.data(Slot(stored.dimensions))?);
            return Ok(dimensions.iter().fold(1, |product: u64, &n| product.saturating_mul(n)));
        }
        Ok(match samples.data_type.element_size() {
            0 => 1,
            size => key.size / size as u64,
        })
    }
}
