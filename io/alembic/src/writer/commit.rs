//! Commit: all tables and a new root behind the payloads, then eight bytes in the file header.

use std::io::ErrorKind;

use super::archive::{ArchiveWriter, Durability};
use super::mark::ArchiveMark;
use super::tree::{Member, chain};
use crate::error::AlembicError;
use crate::murmur::murmur3_x64_128;
use crate::ogawa::Slot;
use crate::packed::{MetaDataTable, PackedObject, PackedProperty, pack_object, pack_property, pack_time_sampling};

/// Library version that readers are given: 1.8.12.
const LIBRARY_VERSION: i32 = 10812;

/// Commits as large as the last one for which the file has room ahead, and the least and the most room [bytes].
const COMMITS_AHEAD: u64 = 16;
const LEAST_AHEAD: u64 = 1 << 20;
const MOST_AHEAD: u64 = 1 << 30;

impl ArchiveWriter {
    /// Makes everything written so far visible to readers.
    ///
    /// The previous state stays valid until the last eight bytes are written; when the process dies at any moment the
    /// file shows this commit or the one before. Samples written later are not visible before the next commit.
    ///
    /// The file is longer than what it holds until [`ArchiveWriter::finish`]: programs that map it into memory look up
    /// its length before they look up the root, and may find there one of a later commit.
    pub fn commit(&mut self, durability: Durability) -> Result<(), AlembicError> {
        let (root, bytes) = self.packed_tables(self.end);
        self.write_at(self.end, &bytes)?;
        let end = self.end + bytes.len() as u64;
        self.make_room(end, end - self.mark.map_or(0, |mark| mark.end.min(end)))?;
        // Between frames others need the room.
        self.chunk = Vec::new();
        self.synchronise(durability)?;
        self.write_at(8, &root.0.to_le_bytes())?;
        if !self.committed {
            self.synchronise(durability)?;
            self.write_at(5, &[0xff])?;
        }
        self.synchronise(durability)?;
        self.end += bytes.len() as u64;
        self.mark = Some(ArchiveMark { root: root.0, end: self.end, digest: murmur3_x64_128(&bytes) });
        self.committed = true;
        self.changed = false;
        Ok(())
    }

    /// Makes the file longer than a commit of `size` bytes that ends at `end`, by what the next ones may need; nothing is
    /// written there, so that it takes no room on the disk.
    pub(super) fn make_room(&mut self, end: u64, size: u64) -> Result<(), AlembicError> {
        let ahead = size.saturating_mul(COMMITS_AHEAD).clamp(LEAST_AHEAD, MOST_AHEAD);
        let longer = self.file.metadata().and_then(|about| match about.len() < end + ahead / 2 {
            true => self.file.set_len(end + ahead),
            false => Ok(()),
        });
        match longer {
            // Where files may not be that long it has to do without; no frame is lost for it.
            Err(source) if source.kind() != ErrorKind::FileTooLarge => {
                Err(AlembicError::Io { path: self.path.clone(), action: "make room in", source })
            }
            _ => Ok(()),
        }
    }

    /// All tables as they would stand at `base` in the file, and the root among them.
    pub(super) fn packed_tables(&self, base: u64) -> (Slot, Vec<u8>) {
        let mut tables = Tables { archive: self, base, bytes: Vec::new(), metadata: MetaDataTable::default() };
        let root = tables.pack_archive();
        (root, tables.bytes)
    }

    /// Brings everything written so far to the disk; may be called at any time.
    pub fn sync(&mut self) -> Result<(), AlembicError> {
        self.synchronise(Durability::Synced)
    }

    /// Commits what is not committed yet, cuts off what an earlier writer left behind it, and closes the file.
    pub fn finish(mut self, durability: Durability) -> Result<(), AlembicError> {
        if self.changed {
            self.commit(durability)?;
        }
        self.cut_tail()?;
        self.synchronise(durability)
    }

    pub(super) fn synchronise(&mut self, durability: Durability) -> Result<(), AlembicError> {
        if durability == Durability::Flushed {
            return Ok(());
        }
        self.file.sync_all().map_err(|source| AlembicError::Io {
            path: self.path.clone(),
            action: "flush to disk",
            source,
        })
    }
}

/// The tables of one commit, built in memory: `bytes` will stand at `base` in the file.
struct Tables<'a> {
    archive: &'a ArchiveWriter,
    base: u64,
    bytes: Vec<u8>,
    metadata: MetaDataTable,
}

impl Tables<'_> {
    fn data(&mut self, data: &[u8]) -> Slot {
        if data.is_empty() {
            return Slot::EMPTY_DATA;
        }
        let offset = self.base + self.bytes.len() as u64;
        self.bytes.extend_from_slice(&(data.len() as u64).to_le_bytes());
        self.bytes.extend_from_slice(data);
        Slot::data(offset)
    }

    fn group(&mut self, slots: &[Slot]) -> Slot {
        if slots.is_empty() {
            return Slot::EMPTY_GROUP;
        }
        let offset = self.base + self.bytes.len() as u64;
        self.bytes.extend_from_slice(&(slots.len() as u64).to_le_bytes());
        slots.iter().for_each(|slot| self.bytes.extend_from_slice(&slot.0.to_le_bytes()));
        Slot(offset)
    }

    fn pack_archive(&mut self) -> Slot {
        let top = self.pack_objects();
        let slots = [
            self.data(&0_i32.to_le_bytes()),
            self.data(&LIBRARY_VERSION.to_le_bytes()),
            top,
            self.data(self.archive.metadata.as_bytes()),
            self.data(&self.pack_time_samplings()),
            self.data(&self.metadata.pack()),
        ];
        self.group(&slots)
    }

    /// All object groups, children before parents; returns the top one.
    fn pack_objects(&mut self) -> Slot {
        let objects = &self.archive.objects;
        // Order of the tree, not of declaration: a re-opened file knows only the tree.
        let mut order = vec![0];
        let mut next = 0;
        while let Some(&object) = order.get(next) {
            order.extend(&objects[object].children);
            next += 1;
        }
        let mut packed = vec![(Slot::EMPTY_GROUP, [0; 32]); objects.len()];
        for &index in order.iter().rev() {
            let object = &objects[index];
            let (properties, own_hash) = self.pack_compound(object.properties);
            let mut slots = vec![properties];
            let mut headers = Vec::new();
            let mut children_hash = [0; 16]; // stays zero without children
            for &child in &object.children {
                let header =
                    PackedObject { name: objects[child].name.clone(), metadata: objects[child].metadata.clone() };
                pack_object(&header, &mut self.metadata, &mut headers);
                let (slot, hashes) = packed[child];
                slots.push(slot);
                let named = murmur3_x64_128(&[&described(&header.name, &header.metadata)[..], &hashes].concat());
                children_hash = chain(&children_hash, &named);
            }
            let hashes: Vec<u8> = [own_hash, children_hash].concat();
            packed[index].1.copy_from_slice(&hashes);
            headers.extend_from_slice(&hashes);
            slots.push(self.data(&headers));
            packed[index].0 = self.group(&slots);
        }
        packed[0].0
    }

    /// A compound with everything in it, and the hash of its content.
    fn pack_compound(&mut self, index: usize) -> (Slot, [u8; 16]) {
        let archive = self.archive;
        let compound = &archive.compounds[index];
        let mut hash = murmur3_x64_128(&described(&compound.name, &compound.metadata));
        if compound.members.is_empty() {
            return (Slot::EMPTY_GROUP, hash);
        }
        let mut slots = Vec::with_capacity(compound.members.len() + 1);
        let mut headers = Vec::new();
        for &member in &compound.members {
            let (slot, member_hash, header) = match member {
                Member::Compound(index) => {
                    let (slot, hash) = self.pack_compound(index);
                    let node = &archive.compounds[index];
                    let (name, metadata) = (node.name.clone(), node.metadata.clone());
                    (slot, hash, PackedProperty { name, metadata, samples: None })
                }
                Member::Property(index) => self.pack_property(index),
            };
            slots.push(slot);
            hash = chain(&hash, &member_hash);
            pack_property(&header, &mut self.metadata, &mut headers);
        }
        slots.push(self.data(&headers));
        (self.group(&slots), hash)
    }

    fn pack_property(&mut self, index: usize) -> (Slot, [u8; 16], PackedProperty) {
        let node = &self.archive.properties[index];
        let samples = node.packed();
        let mut slots = Vec::with_capacity(2 * node.stored.len());
        for stored in &node.stored {
            slots.push(Slot(stored.payload));
            if node.is_array {
                slots.push(Slot(stored.dimensions));
            }
        }
        let mut about = described(&node.name, &node.metadata);
        let type_code = samples.data_type.pod.code() as u8;
        about.extend_from_slice(&[u8::from(samples.is_array), type_code, samples.data_type.extent]);
        pack_time_sampling(&self.archive.samplings[node.time_sampling as usize], 0, &mut about);
        for number in [samples.count, samples.first_changed, samples.last_changed] {
            about.extend_from_slice(&number.to_le_bytes());
        }
        about.extend_from_slice(&node.content);
        let header =
            PackedProperty { name: node.name.clone(), metadata: node.metadata.clone(), samples: Some(samples) };
        (self.group(&slots), murmur3_x64_128(&about), header)
    }

    fn pack_time_samplings(&self) -> Vec<u8> {
        let mut most = vec![0_u32; self.archive.samplings.len()];
        for property in &self.archive.properties {
            let samples = property.packed();
            let count = if samples.is_constant() { samples.count.min(1) } else { samples.count };
            let entry = &mut most[property.time_sampling as usize];
            *entry = count.max(*entry);
        }
        let mut blob = Vec::new();
        for (sampling, most) in self.archive.samplings.iter().zip(most) {
            pack_time_sampling(sampling, most, &mut blob);
        }
        blob
    }
}

/// Name and metadata as bytes that no other pair gives.
fn described(name: &str, metadata: &str) -> Vec<u8> {
    [name.as_bytes(), &[0], metadata.as_bytes(), &[0]].concat()
}
