//! Writing a checkpoint piece by piece.

use std::collections::BTreeSet;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use drapery_core::snapshot::{SnapshotSink, ValueKind, Values};
use hdf5::types::VarLenUnicode;
use hdf5::{Group, H5Type};
use sha2::{Digest, Sha256};

use super::Head;
use crate::checkpoint::bytes::{self, ContentHash};
use crate::checkpoint::seal;
use crate::error::IoError;
use crate::formats::hdf5::reserved;
use crate::hdf5_file;
use crate::sha256::hex;

/// Space that a checkpoint takes beside its arrays and its head, at most [bytes].
const STRUCTURE: u64 = 1 << 20;

/// Number of bytes that are searched at a time.
const BLOCK: usize = 1 << 16;

/// A checkpoint being written. Sections and arrays come in the order in which they are stored; the first thing that goes wrong
/// is returned by [`CheckpointWriter::finish`].
///
/// As a sink it panics when names of sections or arrays are empty, contain `/` or occur twice, or when a shape does not fit its
/// values: the solver promises otherwise.
#[derive(Debug)]
pub struct CheckpointWriter {
    path: PathBuf,
    /// The file to which arrays are written.
    file: File,
    /// The same file, as the library lays it out.
    library: hdf5::File,
    content: ContentHash,
    /// Stands in the file where the hash will be.
    placeholder: String,
    /// For what path room is looked for, if it is.
    room: Option<PathBuf>,
    section: Option<OpenSection>,
    sections: u64,
    array: Option<OpenArray>,
    /// Bytes of all arrays so far.
    array_bytes: u64,
    /// Bytes written of them.
    written: u64,
    /// Names of sections, and of their arrays.
    seen: BTreeSet<(String, String)>,
    error: Option<IoError>,
}

#[derive(Debug)]
struct OpenSection {
    group: Group,
    name: String,
    arrays: u64,
}

/// An array that waits for its rows.
#[derive(Debug)]
struct OpenArray {
    name: String,
    /// Offset of its next byte in the file.
    next: u64,
    /// Bytes that are missing.
    left: u64,
    kind: ValueKind,
}

impl CheckpointWriter {
    /// Creates the file.
    ///
    /// # Errors
    /// The file cannot be created.
    pub fn create(path: &Path, head: &Head) -> Result<Self, IoError> {
        let options = &mut File::options();
        let opened = options.read(true).write(true).create(true).truncate(true).open(path);
        let file = opened.map_err(|e| IoError::creating(path, e))?;
        let text = head.text();
        // As long as the hash, and no part of the head: it would have to contain its own hash.
        let placeholder = hex(&Sha256::digest(format!("to come, of {text}")));
        let library = lay_out_head(path, head, &text, &placeholder).map_err(|e| library_refused(path, &e))?;
        Ok(Self {
            path: path.to_owned(),
            file,
            library,
            content: ContentHash::new(&text),
            placeholder,
            room: None,
            section: None,
            sections: 0,
            array: None,
            array_bytes: 0,
            written: 0,
            seen: BTreeSet::new(),
            error: None,
        })
    }

    /// From now on an array for which the disk has no room is refused before it is written, as one of the file `path`.
    pub fn look_for_room(&mut self, path: &Path) {
        self.room = Some(path.to_owned());
    }

    /// Brings the checkpoint to the disk; returns the length of the file [bytes] and the content hash.
    ///
    /// # Errors
    /// There is not enough room, or the disk refused something; a part may be left, which nothing accepts.
    pub fn finish(mut self) -> Result<(u64, String), IoError> {
        self.end_array();
        let Self { path, mut file, library, content, placeholder, section, error, .. } = self;
        drop(section);
        // What goes wrong while a file is dropped is not heard of.
        let closed = library.flush().and_then(|()| library.close());
        if let Some(error) = error {
            return Err(error);
        }
        closed.map_err(|e| library_refused(&path, &e))?;
        let hash = content.finish();
        let length = replace(&mut file, placeholder.as_bytes(), hash.as_bytes())
            .and_then(|()| seal::put(&mut file))
            .and_then(|()| file.sync_all())
            .and_then(|()| Ok(file.metadata()?.len()))
            .map_err(|e| IoError::writing(&path, e))?;
        Ok((length, hash))
    }

    fn end_array(&mut self) {
        if let (Some(array), None) = (self.array.take(), &self.error) {
            assert_eq!(array.left, 0, "the shape of {} fits its values", array.name);
        }
    }

    fn note_name(&mut self, section: &str, name: &str) {
        let usable = |name: &str| !name.is_empty() && name != "." && !name.contains(['/', '\0', '\n']);
        assert!(usable(section), "section {section:?} has a name that HDF5 cannot hold");
        assert!(name.is_empty() || usable(name), "array {name:?} of {section} has a name that HDF5 cannot hold");
        assert!(self.seen.insert((section.to_owned(), name.to_owned())), "{section}/{name} is there twice");
    }

    fn begin_section(&mut self, name: &str, version: u32) -> Result<(), IoError> {
        let refused = |e| library_refused(&self.path, &e);
        let group = begin_group(&self.library, (self.sections, name, version)).map_err(refused)?;
        self.sections += 1;
        self.section = Some(OpenSection { group, name: name.to_owned(), arrays: 0 });
        Ok(())
    }

    fn begin_array(&mut self, name: &str, shape: &[usize], kind: ValueKind) -> Result<(), IoError> {
        let size = (shape.iter().product::<usize>() * kind.size()) as u64;
        self.array_bytes += size;
        self.check_room()?;
        let section = self.section.as_mut().expect("a section is begun before its arrays");
        let offset = reserve(&section.group, section.arrays, (name, shape, kind));
        let offset = offset.map_err(|e| library_refused(&self.path, &e))?;
        section.arrays += 1;
        let name = format!("{}/{name}", section.name);
        self.array = Some(OpenArray { name, next: offset.unwrap_or(0), left: size, kind });
        Ok(())
    }

    fn check_room(&self) -> Result<(), IoError> {
        let Some(path) = &self.room else { return Ok(()) };
        let needed = seal::LENGTH as u64 + self.array_bytes + STRUCTURE;
        match free_bytes(path.parent().unwrap_or(Path::new("."))) {
            Some(free) if free.saturating_add(self.written) < needed => {
                Err(IoError::NoRoom { path: path.clone(), needed, free })
            }
            _ => Ok(()),
        }
    }

    fn write_rows(&mut self, values: &Values) -> Result<(), IoError> {
        let array = self.array.as_mut().expect("an array is begun before its rows");
        assert_eq!(values.kind(), array.kind, "the values of {} are of one kind", array.name);
        let size = (values.len() * array.kind.size()) as u64;
        assert!(size <= array.left, "the shape of {} fits its values", array.name);
        let Self { file, content, path, .. } = self;
        let mut write = |file: &mut File| {
            file.seek(SeekFrom::Start(array.next))?;
            bytes::for_each_block(values, &mut |block| {
                content.bytes(block);
                file.write_all(block)
            })
        };
        write(file).map_err(|e| IoError::writing(path, e))?;
        array.next += size;
        array.left -= size;
        self.written += size;
        Ok(())
    }

    /// Does the next piece of work, unless an earlier one has failed.
    fn unless_failed(&mut self, work: impl FnOnce(&mut Self) -> Result<(), IoError>) {
        if self.error.is_none() {
            self.error = work(self).err();
        }
    }
}

impl SnapshotSink for CheckpointWriter {
    fn section(&mut self, name: &str, version: u32) {
        self.end_array();
        self.note_name(name, "");
        self.content.section(name, version);
        self.unless_failed(|writer| writer.begin_section(name, version));
    }

    fn dataset(&mut self, name: &str, shape: &[usize], kind: ValueKind) {
        self.end_array();
        if let Some(section) = self.section.as_ref().map(|section| section.name.clone()) {
            assert!(!name.is_empty(), "an array of {section} has no name");
            self.note_name(&section, name);
        }
        self.content.dataset(name, shape, kind);
        self.unless_failed(|writer| writer.begin_array(name, shape, kind));
    }

    fn rows(&mut self, values: Values) {
        self.unless_failed(|writer| writer.write_rows(&values));
    }
}

/// Creates the file in the library, with all that is known at the start.
fn lay_out_head(path: &Path, head: &Head, text: &str, hash: &str) -> hdf5::Result<hdf5::File> {
    let root = hdf5_file::create(path, seal::LENGTH as u64)?;
    let texts =
        [("application", head.application.as_str()), ("shot", &head.shot), ("content_hash", hash), ("head", text)];
    for (name, text) in texts {
        let value: VarLenUnicode = text.replace('\0', " ").parse().map_err(|e| hdf5::Error::from(format!("{e}")))?;
        attribute(&root, name, &value)?;
    }
    attribute(&root, "format_version", &u64::from(head.format_version))?;
    attribute(&root, "frame", &head.frame)?;
    attribute(&root, "sub_step", &head.sub_step)?;
    attribute(&root, "time", &head.time)?;
    attribute(&root, "fps_numerator", &u64::from(head.fps[0]))?;
    attribute(&root, "fps_denominator", &u64::from(head.fps[1]))?;
    head.delivered.map_or(Ok(()), |frame| attribute(&root, "delivered", &frame))?;
    Ok(root)
}

/// The library says in words what the system refused; the usual reason is a full disk.
fn library_refused(path: &Path, error: &hdf5::Error) -> IoError {
    IoError::writing(path, hdf5_file::refused(error))
}

fn attribute<T: H5Type>(place: &Group, name: &str, value: &T) -> hdf5::Result<()> {
    place.new_attr::<T>().create(name)?.write_scalar(value)
}

fn begin_group(file: &hdf5::File, (order, name, version): (u64, &str, u32)) -> hdf5::Result<Group> {
    let group = file.create_group_builder().obj_track_times(false).create(name)?;
    attribute(&group, "order", &order)?;
    attribute(&group, "version", &u64::from(version))?;
    Ok(group)
}

/// Makes room for an array; returns where it lies in the file [bytes], `None` for an empty one.
fn reserve(group: &Group, order: u64, about: (&str, &[usize], ValueKind)) -> hdf5::Result<Option<u64>> {
    match about.2 {
        ValueKind::F64 => reserve_as::<f64>(group, order, about),
        ValueKind::U64 => reserve_as::<u64>(group, order, about),
        ValueKind::I64 => reserve_as::<i64>(group, order, about),
        ValueKind::U32 => reserve_as::<u32>(group, order, about),
        ValueKind::U8 => reserve_as::<u8>(group, order, about),
    }
}

fn reserve_as<T: H5Type>(
    group: &Group,
    order: u64,
    (name, shape, _): (&str, &[usize], ValueKind),
) -> hdf5::Result<Option<u64>> {
    let made = reserved::<T>(group, name, shape)?;
    made.new_attr::<u64>().create("order")?.write_scalar(&order)?;
    if made.size() == 0 {
        return Ok(None);
    }
    let offset = made.offset().ok_or_else(|| hdf5::Error::from(format!("dataset {name} has no fixed place")))?;
    Ok(Some(offset))
}

/// Replaces the first place of `old` in the file by `new`, which is as long; it stands near the start.
fn replace(file: &mut File, old: &[u8], new: &[u8]) -> std::io::Result<()> {
    file.seek(SeekFrom::Start(0))?;
    let (mut window, mut start) = (Vec::new(), 0);
    loop {
        let read = Read::by_ref(file).take(BLOCK as u64).read_to_end(&mut window)?;
        if let Some(place) = window.windows(old.len()).position(|bytes| bytes == old) {
            file.seek(SeekFrom::Start(start + place as u64))?;
            return file.write_all(new);
        }
        if read == 0 {
            return Err(std::io::Error::other("the place of the content hash is not in the file"));
        }
        // It may begin at the end of this block.
        let done = window.len().saturating_sub(old.len());
        window.drain(..done);
        start += done as u64;
    }
}

/// Bytes that may be written to the disk of `folder`; `None` where the system cannot tell.
fn free_bytes(folder: &Path) -> Option<u64> {
    let disk = fs4::statvfs(folder).ok()?;
    (disk.total_space() > 0).then(|| disk.available_space())
}
