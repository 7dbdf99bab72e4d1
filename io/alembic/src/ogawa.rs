//! The container: groups and data chunks at absolute offsets. Every number read from a file is checked here.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use crate::error::{AlembicError, Fault};

/// Bytes before the first chunk.
pub(crate) const HEADER_SIZE: u64 = 16;
const MAGIC: &[u8; 5] = b"Ogawa";
/// Version bytes 0.1, as stored.
const VERSION: [u8; 2] = [0, 1];
const HDF5_SIGNATURE: [u8; 8] = [0x89, b'H', b'D', b'F', 0x0d, 0x0a, 0x1a, 0x0a];
const DATA_BIT: u64 = 1 << 63;

/// One child entry of a group: kind and offset of a chunk.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Slot(pub(crate) u64);

impl Slot {
    pub(crate) const EMPTY_GROUP: Slot = Slot(0);
    pub(crate) const EMPTY_DATA: Slot = Slot(DATA_BIT);

    pub(crate) fn data(offset: u64) -> Self {
        Slot(offset | DATA_BIT)
    }

    pub(crate) fn is_data(self) -> bool {
        self.0 & DATA_BIT != 0
    }

    pub(crate) fn offset(self) -> u64 {
        self.0 & !DATA_BIT
    }

    pub(crate) fn is_empty(self) -> bool {
        self.offset() == 0
    }
}

/// A checked group: `count` slots after the u64 at `offset`. The empty group has no slots.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Group {
    pub(crate) offset: u64,
    pub(crate) count: usize,
}

impl Group {
    /// First byte after the group.
    pub(crate) fn end(self) -> u64 {
        self.offset + 8 + 8 * self.count as u64
    }
}

/// Header bytes of an archive that has no root yet.
pub(crate) fn unfinished_header() -> [u8; 16] {
    let mut header = [0; 16];
    header[..5].copy_from_slice(MAGIC);
    header[6..8].copy_from_slice(&VERSION);
    header
}

#[derive(Debug)]
enum Bytes {
    /// The lock only guards the file cursor, so a poisoned lock is harmless.
    File(Mutex<File>),
    Memory(Vec<u8>),
}

/// Up to eight bytes as a number, the least significant first.
fn number(bytes: &[u8]) -> u64 {
    bytes.iter().rev().fold(0, |value, &byte| value << 8 | u64::from(byte))
}

/// A readable archive file, or the same in memory.
#[derive(Debug)]
pub(crate) struct ChunkSource {
    pub(crate) path: PathBuf,
    pub(crate) length: u64,
    /// The first bytes. They were read before the length: a writer that commits in between moves the root in the header
    /// behind the end of a shorter file.
    header: Vec<u8>,
    bytes: Bytes,
}

impl ChunkSource {
    /// Opens `path` and checks the header; returns the root group too.
    pub(crate) fn open(path: &Path) -> Result<(Self, Group), AlembicError> {
        Self::open_file(path)?.with_root(None)
    }

    /// The same with the root group at `root`, whatever the header says.
    pub(crate) fn open_at(path: &Path, root: u64) -> Result<(Self, Group), AlembicError> {
        Self::open_file(path)?.with_root(Some(root))
    }

    fn open_file(path: &Path) -> Result<Self, AlembicError> {
        let failed = |source| AlembicError::Io { path: path.to_owned(), action: "open", source };
        // Looked at before it is opened, because to open a pipe waits for a writer.
        if !std::fs::metadata(path).map_err(failed)?.is_file() {
            let reason = "this is not a regular file".into();
            return Err(AlembicError::NotOgawa { path: path.to_owned(), reason });
        }
        let mut file = File::open(path).map_err(failed)?;
        let mut header = Vec::new();
        (&mut file).take(HEADER_SIZE).read_to_end(&mut header).map_err(failed)?;
        let length = file.metadata().map_err(failed)?.len();
        Ok(Self { path: path.to_owned(), length, header, bytes: Bytes::File(Mutex::new(file)) })
    }

    /// Returns the position of the root group according to the header.
    pub(crate) fn root_in_header(&self) -> u64 {
        number(self.header.get(8..).unwrap_or_default())
    }

    /// The same for an archive in memory; `name` stands for the path in messages.
    pub(crate) fn from_bytes(bytes: Vec<u8>, name: &Path) -> Result<(Self, Group), AlembicError> {
        let (length, header) = (bytes.len() as u64, bytes.iter().take(HEADER_SIZE as usize).copied().collect());
        Self { path: name.to_owned(), length, header, bytes: Bytes::Memory(bytes) }.with_root(None)
    }

    fn with_root(self, root: Option<u64>) -> Result<(Self, Group), AlembicError> {
        let path = self.path.clone();
        let not_ogawa = |reason: &str| AlembicError::NotOgawa { path: path.clone(), reason: reason.to_owned() };
        let start = &self.header;
        if start.starts_with(&HDF5_SIGNATURE) {
            return Err(AlembicError::Hdf5Container { path });
        }
        if !start.starts_with(MAGIC) {
            return Err(not_ogawa("the first bytes are not `Ogawa`"));
        }
        if start.len() < HEADER_SIZE as usize {
            return Err(not_ogawa("the file ends inside its header"));
        }
        if start[5] != 0xff {
            return Err(AlembicError::Unfinished { path });
        }
        if start[6..8] != VERSION {
            return Err(not_ogawa("the container version is not 0.1"));
        }
        let offset = root.unwrap_or_else(|| self.root_in_header());
        let root = self.group(Slot(offset)).map_err(|fault| fault.at(&path, "root group"))?;
        Ok((self, root))
    }

    /// `length` bytes from `offset`; the range is checked before anything is allocated.
    fn read(&self, offset: u64, length: u64) -> Result<Vec<u8>, Fault> {
        let end = offset.checked_add(length).filter(|&end| end <= self.length);
        let size = usize::try_from(length).ok();
        let (Some(end), Some(size)) = (end, size) else {
            return Err(Fault::damaged(format!(
                "{length} bytes at offset {offset} are requested, but the file has {} bytes",
                self.length
            )));
        };
        match &self.bytes {
            Bytes::Memory(bytes) => Ok(bytes[offset as usize..end as usize].to_vec()), // both within its length
            Bytes::File(file) => {
                let mut bytes = vec![0; size];
                let mut file = file.lock().unwrap_or_else(PoisonError::into_inner);
                file.seek(SeekFrom::Start(offset)).map_err(Fault::Io)?;
                file.read_exact(&mut bytes).map_err(Fault::Io)?;
                Ok(bytes)
            }
        }
    }

    fn u64_at(&self, offset: u64) -> Result<u64, Fault> {
        Ok(number(&self.read(offset, 8)?))
    }

    /// The group behind `slot`.
    pub(crate) fn group(&self, slot: Slot) -> Result<Group, Fault> {
        if slot.is_data() {
            return Err(Fault::damaged("a data chunk stands where a group is expected"));
        }
        if slot.is_empty() {
            return Ok(Group { offset: 0, count: 0 });
        }
        let offset = slot.offset();
        if offset < HEADER_SIZE {
            return Err(Fault::damaged(format!("a group at offset {offset}, inside the file header")));
        }
        let count = self.u64_at(offset)?;
        // `u64_at` has shown that offset + 8 is within the file.
        if count > (self.length - offset - 8) / 8 {
            return Err(Fault::damaged(format!("a group of {count} entries at offset {offset} runs past the end")));
        }
        Ok(Group { offset, count: count as usize })
    }

    /// Entry `index` of a group.
    pub(crate) fn child(&self, group: Group, index: usize) -> Result<Slot, Fault> {
        if index >= group.count {
            return Err(Fault::damaged(format!("entry {index} of a group of {} is requested", group.count)));
        }
        self.u64_at(group.offset + 8 + 8 * index as u64).map(Slot)
    }

    /// All entries of a group.
    pub(crate) fn children(&self, group: Group) -> Result<Vec<Slot>, Fault> {
        if group.count == 0 {
            return Ok(Vec::new());
        }
        let bytes = self.read(group.offset + 8, 8 * group.count as u64)?;
        Ok(crate::property::decode::<u64>(&bytes).into_iter().map(Slot).collect())
    }

    /// Number of bytes in the data chunk behind `slot`.
    pub(crate) fn data_size(&self, slot: Slot) -> Result<u64, Fault> {
        if !slot.is_data() {
            return Err(Fault::damaged("a group stands where data is expected"));
        }
        if slot.is_empty() {
            return Ok(0);
        }
        let offset = slot.offset();
        if offset < HEADER_SIZE {
            return Err(Fault::damaged(format!("data at offset {offset}, inside the file header")));
        }
        let size = self.u64_at(offset)?;
        if size > self.length - offset - 8 {
            return Err(Fault::damaged(format!("{size} bytes of data at offset {offset} run past the end")));
        }
        Ok(size)
    }

    /// The bytes of the data chunk behind `slot`.
    pub(crate) fn data(&self, slot: Slot) -> Result<Vec<u8>, Fault> {
        match self.data_size(slot)? {
            0 => Ok(Vec::new()),
            size => self.read(slot.offset() + 8, size),
        }
    }

    /// The bytes of the data chunk behind `slot` after its first `skip`; none when the chunk is empty.
    pub(crate) fn data_after(&self, slot: Slot, skip: u64) -> Result<Vec<u8>, Fault> {
        match self.data_size(slot)? {
            0 => Ok(Vec::new()),
            size if size < skip => Err(Fault::damaged(format!("a sample of {size} bytes, less than its digest"))),
            size => self.read(slot.offset() + 8 + skip, size - skip),
        }
    }

    /// `size` bytes of the data chunk behind `slot`, from its byte `start` on.
    pub(crate) fn data_part(&self, slot: Slot, start: u64, size: u64) -> Result<Vec<u8>, Fault> {
        let whole = self.data_size(slot)?;
        if start.checked_add(size).is_none_or(|end| end > whole) {
            return Err(Fault::damaged(format!(
                "{size} bytes after the first {start} of a chunk of {whole} are wanted"
            )));
        }
        if size == 0 { Ok(Vec::new()) } else { self.read(slot.offset() + 8 + start, size) }
    }

    /// The first `size` bytes of the data chunk behind `slot`.
    pub(crate) fn data_start(&self, slot: Slot, size: u64) -> Result<Vec<u8>, Fault> {
        if self.data_size(slot)? < size {
            return Err(Fault::damaged(format!("a chunk of data is shorter than {size} bytes")));
        }
        self.read(slot.offset() + 8, size)
    }
}
