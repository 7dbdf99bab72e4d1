//! Reading a checkpoint piece by piece.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::ops::Range;
use std::path::{Path, PathBuf};

use drapery_core::snapshot::{
    DatasetOutline, SectionOutline, Snapshot, SnapshotError, SnapshotSink, SnapshotSource, ValueKind, Values,
};
use hdf5::Group;
use hdf5::types::{FloatSize, IntSize, TypeDescriptor, VarLenUnicode};

use super::{Checkpoint, Head};
use crate::checkpoint::bytes::{self, ContentHash};
use crate::checkpoint::seal::{self, damaged};
use crate::error::IoError;
use crate::formats::hdf5::datasets::place_of;
use crate::hdf5_file;
use crate::input_file;

/// Number of bytes that are checked at a time.
const BLOCK: u64 = 1 << 20;

/// A checkpoint whose content was checked; its arrays are read when they are asked for.
#[derive(Debug)]
pub struct CheckpointReader {
    /// Shot and moment that it belongs to.
    pub head: Head,
    path: PathBuf,
    file: File,
    content_hash: String,
    outline: Vec<SectionOutline>,
    /// Offset of each array in the file [bytes], by section and name.
    places: BTreeMap<(String, String), u64>,
}

/// A section and where its arrays lie.
type PlacedSection = (SectionOutline, Vec<u64>);

impl CheckpointReader {
    /// Opens what [`super::CheckpointWriter`] wrote.
    ///
    /// # Errors
    /// The file is missing, is no checkpoint, was cut off or changed in any bit, or was written by a newer program. It
    /// is not interpreted before its hash was checked.
    pub fn open(path: &Path) -> Result<Self, IoError> {
        input_file::check_for_hdf5(path)?;
        let mut file = input_file::open(path)?;
        seal::check(path, &mut file)?;
        let length = file.metadata().map_err(|e| IoError::reading(path, e))?.len();
        let (head, content_hash, sections) =
            read_sealed(path, length).map_err(|e| damaged(path, "HDF5", format!("unknown layout: {e}")))?;
        let mut places = BTreeMap::new();
        for (section, offsets) in &sections {
            let names = section.datasets.iter().map(|dataset| (section.name.clone(), dataset.name.clone()));
            places.extend(names.zip(offsets.iter().copied()));
        }
        let outline = sections.into_iter().map(|(section, _)| section).collect();
        let mut reader = Self { head, path: path.to_owned(), file, content_hash, outline, places };
        let found = reader.hash_content().map_err(|e| IoError::reading(path, e))?;
        if found != reader.content_hash {
            return Err(damaged(path, "content", "its arrays or their names do not match its content_hash".into()));
        }
        Ok(reader)
    }

    /// SHA-256 of everything in it, as [`Checkpoint::content_hash`].
    pub fn content_hash(&self) -> &str {
        &self.content_hash
    }

    /// All of it.
    ///
    /// # Errors
    /// The file can no longer be read.
    pub fn whole(mut self) -> Result<Checkpoint, IoError> {
        let snapshot = Snapshot::take(&mut self).map_err(|error| damaged(&self.path, "content", error.to_string()))?;
        Ok(Checkpoint { head: self.head, snapshot })
    }

    fn hash_content(&mut self) -> std::io::Result<String> {
        let mut hash = ContentHash::new(&self.head.text());
        for section in &self.outline {
            hash.section(&section.name, section.version);
            for dataset in &section.datasets {
                hash.dataset(&dataset.name, &dataset.shape, dataset.kind);
                let start = self.places.get(&(section.name.clone(), dataset.name.clone())).copied().unwrap_or(0);
                let end = start + dataset.bytes();
                let mut next = start;
                while next < end {
                    let piece = read_at(&mut self.file, next..end.min(next + BLOCK))?;
                    hash.bytes(&piece);
                    next += piece.len() as u64;
                }
            }
        }
        Ok(hash.finish())
    }
}

impl SnapshotSource for CheckpointReader {
    fn outline(&self) -> Vec<SectionOutline> {
        self.outline.clone()
    }

    fn values(&mut self, section: &str, dataset: &str, rows: Range<usize>) -> Result<Values, SnapshotError> {
        let error = |what: String| SnapshotError { section: section.to_owned(), what };
        let known = self.outline.iter().find(|known| known.name == section);
        let known = known.ok_or_else(|| error("it is missing".into()))?;
        let known = known.datasets.iter().find(|known| known.name == dataset);
        let known = known.ok_or_else(|| error(format!("`{dataset}` is missing")))?;
        if rows.start > rows.end || rows.end > known.rows() {
            return Err(error(format!("`{dataset}` has fewer than {} rows", rows.end)));
        }
        let row = (known.width() * known.kind.size()) as u64;
        let place = self.places.get(&(section.to_owned(), dataset.to_owned())).copied().unwrap_or(0);
        let range = place + rows.start as u64 * row..place + rows.end as u64 * row;
        let found = read_at(&mut self.file, range).map_err(|e| error(format!("`{dataset}` cannot be read: {e}")))?;
        Ok(bytes::values_of(known.kind, &found))
    }
}

fn read_at(file: &mut File, range: Range<u64>) -> std::io::Result<Vec<u8>> {
    // What the file cannot hold was refused when it was opened.
    let mut bytes = vec![0; (range.end - range.start) as usize];
    if !bytes.is_empty() {
        file.seek(SeekFrom::Start(range.start))?;
        file.read_exact(&mut bytes)?;
    }
    Ok(bytes)
}

/// Head, content hash and sections of a file whose seal was checked and that has `length` bytes.
fn read_sealed(path: &Path, length: u64) -> hdf5::Result<(Head, String, Vec<PlacedSection>)> {
    let file = hdf5_file::open(path)?;
    let text = |name: &str| Ok::<_, hdf5::Error>(file.attr(name)?.read_scalar::<VarLenUnicode>()?.to_string());
    let mut head: Head =
        serde_json::from_str(&text("head")?).map_err(|e| hdf5::Error::from(format!("attribute head: {e}")))?;
    // The digits in JSON may be read with an error in the last place.
    head.time = file.attr("time")?.read_scalar()?;
    let mut sections = Vec::new();
    for group in file.groups()? {
        let order: u64 = group.attr("order")?.read_scalar()?;
        sections.push((order, read_section(&group, length)?));
    }
    sections.sort_by_key(|(order, _)| *order);
    Ok((head, text("content_hash")?, sections.into_iter().map(|(_, section)| section).collect()))
}

fn read_section(group: &Group, length: u64) -> hdf5::Result<PlacedSection> {
    let mut datasets = Vec::new();
    for dataset in group.datasets()? {
        let order: u64 = dataset.attr("order")?.read_scalar()?;
        datasets.push((order, read_dataset(&dataset, length)?));
    }
    datasets.sort_by_key(|(order, _)| *order);
    let (datasets, places) = datasets.into_iter().map(|(_, placed)| placed).unzip();
    let version = group.attr("version")?.read_scalar()?;
    Ok((SectionOutline { name: last_name(&group.name()), version, datasets }, places))
}

fn read_dataset(dataset: &hdf5::Dataset, length: u64) -> hdf5::Result<(DatasetOutline, u64)> {
    let (name, shape) = (last_name(&dataset.name()), dataset.shape());
    let kind = match dataset.dtype()?.to_descriptor()? {
        TypeDescriptor::Float(FloatSize::U8) => ValueKind::F64,
        TypeDescriptor::Unsigned(IntSize::U8) => ValueKind::U64,
        TypeDescriptor::Integer(IntSize::U8) => ValueKind::I64,
        TypeDescriptor::Unsigned(IntSize::U4) => ValueKind::U32,
        TypeDescriptor::Unsigned(IntSize::U1) => ValueKind::U8,
        other => return Err(format!("dataset {name} has the unknown type {other}").into()),
    };
    let place = place_of(dataset, length)?;
    Ok((DatasetOutline { name, shape, kind }, place.unwrap_or(0)))
}

/// Last part of a path inside the file.
fn last_name(path: &str) -> String {
    path.rsplit('/').next().unwrap_or_default().to_owned()
}
