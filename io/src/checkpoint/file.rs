//! One checkpoint file: how it is written and read.
//!
//! HDF5 with a seal in front. The HDF5 library lays the file out, with room for every array; the arrays themselves are
//! written with plain writes, so that a full disk is an ordinary error, and at the speed of the disk.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::io::{Seek, SeekFrom, Write};
use std::path::Path;

use drapery_core::snapshot::{Dataset, Section, Snapshot, Values};
use hdf5::plist::dataset_create::{AllocTime, FillTime};
use hdf5::types::{FloatSize, IntSize, TypeDescriptor, VarLenUnicode};
use hdf5::{Group, H5Type};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use sha2::{Digest, Sha256};

use super::bytes;
use super::seal::{self, damaged};
use crate::error::IoError;

/// Version of the layout that is written. The one before it will stay readable when it is raised.
pub const FORMAT_VERSION: u32 = 1;

// The arrays are written as little-endian bytes under the machine's own types.
const _: () = assert!(cfg!(target_endian = "little"), "checkpoints need a little-endian machine");

/// What a checkpoint is of. Everything in it follows from the shot, nothing from the machine.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Head {
    /// Version of the layout.
    pub format_version: u32,
    /// Program and version that wrote it.
    pub application: String,
    /// Name of the shot.
    pub shot: String,
    /// Last frame that was reached.
    pub frame: i64,
    /// Collision-free steps since that frame; 0 at the frame itself.
    pub sub_step: u64,
    /// Time of the state [s].
    pub time: f64,
    /// Last frame that the caches hold at this moment; `None` before the first that is delivered.
    pub delivered: Option<i64>,
    /// Frames per second, numerator and denominator.
    pub fps: [u32; 2],
    /// What the shot is made of, by name: hashes that tell whether it was changed.
    pub digests: BTreeMap<String, String>,
    /// Where each cache ends at this moment.
    pub caches: Vec<Value>,
}

/// The exact state of a run.
#[derive(Debug, Clone, PartialEq)]
pub struct Checkpoint {
    /// What it is of.
    pub head: Head,
    /// State of the solver.
    pub snapshot: Snapshot,
}

impl Checkpoint {
    /// SHA-256 of everything in it, in hexadecimal digits; equal for equal states.
    ///
    /// It is the hash of a text with a line for the head and one for each array in order, see
    /// `docs/reference/checkpoint.md`.
    pub fn content_hash(&self) -> String {
        let head = Sha256::digest(self.head_text().as_bytes());
        let mut text = format!("head {}\n", bytes::hex(&head));
        for section in &self.snapshot.sections {
            text += &format!("{} {}\n", section.name, section.version);
            for dataset in &section.datasets {
                let extents: Vec<String> = dataset.shape.iter().map(usize::to_string).collect();
                let (kind, hash) = (bytes::type_name(&dataset.values), bytes::hash(dataset));
                text += &format!("{}/{} {kind} ({}) {hash}\n", section.name, dataset.name, extents.join(","));
            }
        }
        bytes::hex(&Sha256::digest(text.as_bytes()))
    }

    /// Bytes that its arrays take.
    pub fn array_bytes(&self) -> u64 {
        let datasets = self.snapshot.sections.iter().flat_map(|section| &section.datasets);
        let sizes = datasets.map(|dataset| bytes::extent(&dataset.values));
        sizes.map(|(count, size)| (count * size) as u64).sum()
    }

    /// Writes it to `path` and brings it to the disk; returns the length of the file [bytes] and the content hash.
    ///
    /// # Errors
    /// The file cannot be created, or the disk refuses; a part may be left, which nothing accepts.
    ///
    /// # Panics
    /// Names of sections or datasets are empty, contain `/` or occur twice, or a shape does not fit its values: the
    /// solver promises otherwise.
    pub fn write(&self, path: &Path) -> Result<(u64, String), IoError> {
        self.check_names();
        let hash = self.content_hash();
        let mut file = open_new(path)?;
        let offsets = self.lay_out(path, &hash).map_err(|e| library_refused(path, &e))?;
        let arrays = self.snapshot.sections.iter().flat_map(|section| &section.datasets);
        let filled = arrays.zip(offsets).try_for_each(|(dataset, offset)| {
            file.seek(SeekFrom::Start(offset.unwrap_or(0)))?;
            bytes::for_each_block(&dataset.values, &mut |block| file.write_all(block))
        });
        let length = filled
            .and_then(|()| seal::put(&mut file))
            .and_then(|()| file.sync_all())
            .and_then(|()| Ok(file.metadata()?.len()))
            .map_err(|e| IoError::writing(path, e))?;
        Ok((length, hash))
    }

    /// Reads what [`Checkpoint::write`] wrote.
    ///
    /// # Errors
    /// The file is missing, is no checkpoint, was cut off or changed in any bit, or was written by a newer program. It
    /// is not interpreted before its hash was checked.
    pub fn read(path: &Path) -> Result<Self, IoError> {
        Ok(Self::read_with_hash(path)?.0)
    }

    /// [`Checkpoint::read`], with the content hash.
    pub(super) fn read_with_hash(path: &Path) -> Result<(Self, String), IoError> {
        let mut file = File::open(path).map_err(|e| IoError::reading(path, e))?;
        seal::check(path, &mut file)?;
        let length = file.metadata().map_err(|e| IoError::reading(path, e))?.len();
        let (found, hash) = Self::read_sealed(path, length)
            .map_err(|e| damaged(path, "HDF5", format!("it is laid out in an unknown way: {e}")))?;
        if found.content_hash() != hash {
            return Err(damaged(path, "content", "its arrays or their names do not fit its content_hash".into()));
        }
        Ok((found, hash))
    }

    fn head_text(&self) -> String {
        // A struct of texts and numbers always has a JSON form.
        serde_json::to_string(&self.head).unwrap_or_default()
    }

    fn check_names(&self) {
        let usable = |name: &str| !name.is_empty() && name != "." && !name.contains(['/', '\0', '\n']);
        let mut seen = BTreeSet::new();
        for section in &self.snapshot.sections {
            assert!(usable(&section.name), "section {:?} has a name that HDF5 cannot hold", section.name);
            assert!(seen.insert((section.name.as_str(), "")), "section {} is there twice", section.name);
            for dataset in &section.datasets {
                let name = dataset.name.as_str();
                assert!(usable(name), "dataset {name:?} of {} has a name that HDF5 cannot hold", section.name);
                assert!(seen.insert((&section.name, name)), "dataset {name} of {} is there twice", section.name);
                let count: usize = dataset.shape.iter().product();
                let (held, _) = bytes::extent(&dataset.values);
                assert_eq!(count, held, "the shape of {}/{name} fits its values", section.name);
            }
        }
    }

    /// Creates the file with all that is not an array; returns where each array lies in the file [bytes], `None` for
    /// an empty one.
    fn lay_out(&self, path: &Path, hash: &str) -> hdf5::Result<Vec<Option<u64>>> {
        // Times of change are left out so that equal states give equal bytes. Some network disks have no locks; the
        // lock of the run protects the folder.
        let file = hdf5::File::with_options()
            .with_fapl(|access| access.libver_v110().file_locking(false))
            .with_fcpl(|create| create.userblock(seal::LENGTH as u64).obj_track_times(false))
            .create(path)?;
        self.write_head(&file, hash)?;
        let mut offsets = Vec::new();
        for (order, section) in self.snapshot.sections.iter().enumerate() {
            let group = file.create_group_builder().obj_track_times(false).create(section.name.as_str())?;
            attribute(&group, "order", &(order as u64))?;
            attribute(&group, "version", &u64::from(section.version))?;
            for (order, dataset) in section.datasets.iter().enumerate() {
                offsets.push(reserve(&group, order as u64, dataset)?);
            }
        }
        file.flush()?;
        file.close()?;
        Ok(offsets)
    }

    fn write_head(&self, root: &Group, hash: &str) -> hdf5::Result<()> {
        let head = &self.head;
        let texts = [
            ("application", head.application.as_str()),
            ("shot", &head.shot),
            ("content_hash", hash),
            ("head", &self.head_text()),
        ];
        for (name, text) in texts {
            let value: VarLenUnicode =
                text.replace('\0', " ").parse().map_err(|e| hdf5::Error::from(format!("{e}")))?;
            attribute(root, name, &value)?;
        }
        attribute(root, "format_version", &u64::from(head.format_version))?;
        attribute(root, "frame", &head.frame)?;
        attribute(root, "sub_step", &head.sub_step)?;
        attribute(root, "time", &head.time)?;
        attribute(root, "fps_numerator", &u64::from(head.fps[0]))?;
        attribute(root, "fps_denominator", &u64::from(head.fps[1]))?;
        head.delivered.map_or(Ok(()), |frame| attribute(root, "delivered", &frame))
    }

    /// The checkpoint in a file whose seal was checked and that has `length` bytes, and its content hash.
    fn read_sealed(path: &Path, length: u64) -> hdf5::Result<(Self, String)> {
        let file = hdf5::File::with_options().with_fapl(|access| access.file_locking(false)).open(path)?;
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
        let sections = sections.into_iter().map(|(_, section)| section).collect();
        Ok((Self { head, snapshot: Snapshot { sections } }, text("content_hash")?))
    }
}

fn open_new(path: &Path) -> Result<File, IoError> {
    let options = &mut File::options();
    options.read(true).write(true).create(true).truncate(true).open(path).map_err(|e| IoError::creating(path, e))
}

/// The library says in words what the system refused; the usual reason is a full disk.
fn library_refused(path: &Path, error: &hdf5::Error) -> IoError {
    IoError::writing(path, std::io::Error::other(format!("HDF5: {error}")))
}

fn attribute<T: H5Type>(place: &Group, name: &str, value: &T) -> hdf5::Result<()> {
    place.new_attr::<T>().create(name)?.write_scalar(value)
}

fn reserve(group: &Group, order: u64, dataset: &Dataset) -> hdf5::Result<Option<u64>> {
    match &dataset.values {
        Values::F64(_) => reserve_as::<f64>(group, order, dataset),
        Values::U64(_) => reserve_as::<u64>(group, order, dataset),
        Values::I64(_) => reserve_as::<i64>(group, order, dataset),
        Values::U32(_) => reserve_as::<u32>(group, order, dataset),
        Values::U8(_) => reserve_as::<u8>(group, order, dataset),
    }
}

fn reserve_as<T: H5Type>(group: &Group, order: u64, dataset: &Dataset) -> hdf5::Result<Option<u64>> {
    let name = dataset.name.as_str();
    let made = group
        .new_dataset::<T>()
        .no_chunk()
        .alloc_time(Some(AllocTime::Early))
        .fill_time(FillTime::Never)
        .obj_track_times(false)
        .shape(dataset.shape.clone())
        .create(name)?;
    made.new_attr::<u64>().create("order")?.write_scalar(&order)?;
    if made.size() == 0 {
        return Ok(None);
    }
    let offset = made.offset().ok_or_else(|| hdf5::Error::from(format!("dataset {name} has no fixed place")))?;
    Ok(Some(offset))
}

fn read_section(group: &Group, length: u64) -> hdf5::Result<Section> {
    let mut datasets = Vec::new();
    for dataset in group.datasets()? {
        let order: u64 = dataset.attr("order")?.read_scalar()?;
        datasets.push((order, read_dataset(&dataset, length)?));
    }
    datasets.sort_by_key(|(order, _)| *order);
    Ok(Section {
        name: last_name(&group.name()),
        version: group.attr("version")?.read_scalar()?,
        datasets: datasets.into_iter().map(|(_, dataset)| dataset).collect(),
    })
}

fn read_dataset(dataset: &hdf5::Dataset, length: u64) -> hdf5::Result<Dataset> {
    let (name, shape) = (last_name(&dataset.name()), dataset.shape());
    let kind = dataset.dtype()?.to_descriptor()?;
    let count = shape.iter().try_fold(1, |count: usize, extent| count.checked_mul(*extent));
    // Memory is taken for what the file can hold, not for what it says.
    if count.is_none_or(|count| count as u64 > length) || dataset.storage_size() > length {
        return Err(format!("dataset {name} is larger than the file").into());
    }
    let values = match kind {
        TypeDescriptor::Float(FloatSize::U8) => Values::F64(dataset.read_raw()?),
        TypeDescriptor::Unsigned(IntSize::U8) => Values::U64(dataset.read_raw()?),
        TypeDescriptor::Integer(IntSize::U8) => Values::I64(dataset.read_raw()?),
        TypeDescriptor::Unsigned(IntSize::U4) => Values::U32(dataset.read_raw()?),
        TypeDescriptor::Unsigned(IntSize::U1) => Values::U8(dataset.read_raw()?),
        other => return Err(format!("dataset {name} has the unknown type {other}").into()),
    };
    Ok(Dataset { name, shape, values })
}

/// Last part of a path inside the file.
fn last_name(path: &str) -> String {
    path.rsplit('/').next().unwrap_or_default().to_owned()
}

#[cfg(test)]
mod tests;
