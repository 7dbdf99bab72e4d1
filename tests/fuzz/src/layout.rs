//! HDF5 files of any well-formed layout: attributes, groups and arrays, changed by edits and written by the library.
//!
//! Damage inside the library's own structures is left out: the library does not survive it
//! (`docs/dev/decisions/0008-checkpoint-files.md`). What it can read of a file that is merely not as expected is ours.

use std::path::Path;

use hdf5::types::VarLenUnicode;
use hdf5::{Dataset, File, Group, H5Type, Location};

use crate::edits::Bytes;

/// Largest array whose values are written; a larger one is a promise without values.
const LARGEST: usize = 1 << 16;

/// Content of an attribute.
#[derive(Debug, Clone)]
pub enum Value {
    /// Text.
    Text(String),
    /// Unsigned number.
    Count(u64),
    /// Signed number.
    Number(i64),
    /// Real number.
    Real(f64),
    /// A list, where a single value is expected.
    List(Vec<u32>),
}

/// Type of the values of an array.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[allow(missing_docs)] // the names say all
pub enum Kind {
    F32,
    F64,
    I32,
    I64,
    U32,
    U64,
    U8,
    U16,
}

const KINDS: [Kind; 8] = [Kind::F32, Kind::F64, Kind::I32, Kind::I64, Kind::U32, Kind::U64, Kind::U8, Kind::U16];

/// An array.
#[derive(Debug, Clone)]
pub struct Array {
    /// Group; empty for the root.
    pub group: String,
    /// Name.
    pub name: String,
    /// Type of its values.
    pub kind: Kind,
    /// Extents.
    pub shape: Vec<usize>,
    /// Its values, repeated or cut to what the extents need.
    pub bytes: Vec<u8>,
    /// Whether it is stored in compressed chunks.
    pub chunked: bool,
}

/// An attribute of the file (no place), a group, or an array.
#[derive(Debug, Clone)]
pub struct Attribute {
    /// Path of the group or array.
    pub place: String,
    /// Name.
    pub name: String,
    /// Content.
    pub value: Value,
}

/// A file.
#[derive(Debug, Clone, Default)]
pub struct Layout {
    /// Groups.
    pub groups: Vec<String>,
    /// Arrays.
    pub arrays: Vec<Array>,
    /// Attributes.
    pub attributes: Vec<Attribute>,
    /// Bytes in front of the file, a power of two from 512, or none.
    pub user_block: u64,
}

impl Layout {
    /// Adds an array.
    pub fn array(&mut self, group: &str, name: &str, kind: Kind, shape: &[usize], bytes: &[u8]) {
        let (group, name, bytes) = (group.to_owned(), name.to_owned(), bytes.to_vec());
        self.arrays.push(Array { group, name, kind, shape: shape.to_vec(), bytes, chunked: false });
    }

    /// Adds an attribute.
    pub fn attribute(&mut self, place: &str, name: &str, value: Value) {
        self.attributes.push(Attribute { place: place.to_owned(), name: name.to_owned(), value });
    }

    /// Changes it as the bytes say.
    pub fn edit(&mut self, bytes: &mut Bytes<'_>) {
        while !bytes.is_empty() {
            let what = bytes.byte();
            let array = bytes.below(self.arrays.len());
            let attribute = bytes.below(self.attributes.len());
            match (what % 12, self.arrays.get_mut(array), self.attributes.get_mut(attribute)) {
                (0, Some(_), _) => drop(self.arrays.remove(array)),
                (1, Some(array), _) => array.shape = bytes.shape(),
                (2, Some(array), _) => array.kind = KINDS[bytes.below(KINDS.len())],
                (3, Some(array), _) => array.bytes = bytes.piece().to_vec(),
                (4, Some(array), _) => array.name = bytes.text(),
                (5, Some(array), _) => array.chunked = !array.chunked,
                (6, _, Some(_)) => drop(self.attributes.remove(attribute)),
                (7, _, Some(attribute)) => attribute.value = Self::value(bytes),
                (8, _, Some(attribute)) => attribute.name = bytes.text(),
                (9, Some(array), _) => {
                    let copy = Array { name: bytes.text(), ..array.clone() };
                    self.arrays.push(copy);
                }
                (10, _, Some(Attribute { value: Value::Text(text), .. })) => {
                    let at = usize::from(bytes.byte());
                    let at = (0..=at.min(text.len())).rev().find(|at| text.is_char_boundary(*at)).unwrap_or(0);
                    text.insert_str(at, &bytes.text());
                }
                (11, _, _) if self.groups.len() < 6 => self.groups.push(bytes.text()),
                _ => {}
            }
        }
    }

    fn value(bytes: &mut Bytes<'_>) -> Value {
        match bytes.byte() % 5 {
            0 => Value::Text(bytes.text()),
            1 => Value::Count(bytes.word()),
            2 => Value::Number(bytes.word() as i64),
            3 => Value::Real(f64::from_bits(bytes.word())),
            _ => Value::List(bytes.piece().iter().map(|byte| u32::from(*byte)).collect()),
        }
    }

    /// Writes the file. What the library refuses to write, such as two arrays of one name, is left out.
    ///
    /// # Errors
    /// The file cannot be created.
    pub fn write(&self, path: &Path) -> hdf5::Result<()> {
        let file =
            File::with_options().with_fcpl(|c| c.userblock(self.user_block).obj_track_times(false)).create(path)?;
        for group in &self.groups {
            let _ = file.create_group(group);
        }
        for array in &self.arrays {
            let group = if array.group.is_empty() { file.as_group() } else { file.group(&array.group) };
            let _ = group.and_then(|group| array.write(&group));
        }
        for attribute in &self.attributes {
            let _ = attribute.write(&file);
        }
        file.close()
    }
}

impl Array {
    fn write(&self, group: &Group) -> hdf5::Result<()> {
        match self.kind {
            Kind::F32 => self.write_as(group, f32::from_le_bytes),
            Kind::F64 => self.write_as(group, f64::from_le_bytes),
            Kind::I32 => self.write_as(group, i32::from_le_bytes),
            Kind::I64 => self.write_as(group, i64::from_le_bytes),
            Kind::U32 => self.write_as(group, u32::from_le_bytes),
            Kind::U64 => self.write_as(group, u64::from_le_bytes),
            Kind::U16 => self.write_as(group, u16::from_le_bytes),
            Kind::U8 => self.write_as(group, |[byte]: [u8; 1]| byte),
        }
    }

    fn write_as<T: H5Type, const N: usize>(&self, group: &Group, value: fn([u8; N]) -> T) -> hdf5::Result<()> {
        let builder = group.new_dataset::<T>().no_chunk().obj_track_times(false);
        // No extent of a chunk may be zero; the library multiplies them.
        let chunk: Vec<usize> = self.shape.iter().map(|extent| (*extent).max(1)).collect();
        if chunk.iter().try_fold(1usize, |size, extent| size.checked_mul(*extent)).is_none() {
            return Ok(());
        }
        let count: usize = self.shape.iter().product();
        let small = count <= LARGEST;
        let dataset: Dataset = if self.chunked && small && !self.shape.is_empty() {
            builder.shape(self.shape.clone()).chunk(chunk).create(self.name.as_str())?
        } else {
            builder.shape(self.shape.clone()).create(self.name.as_str())?
        };
        if !small {
            return Ok(());
        }
        let stored = self.bytes.as_chunks::<N>().0;
        let values: Vec<T> =
            (0..count).map(|i| value(stored.get(i % stored.len().max(1)).copied().unwrap_or([0; N]))).collect();
        dataset.write_raw(&values)
    }
}

impl Attribute {
    fn write(&self, file: &File) -> hdf5::Result<()> {
        let group = file.as_group()?;
        if self.place.is_empty() {
            return self.write_to(&group);
        }
        match file.group(&self.place) {
            Ok(group) => self.write_to(&group),
            Err(_) => {
                let dataset = file.dataset(&self.place)?;
                self.write_to(&dataset)
            }
        }
    }

    fn write_to(&self, place: &Location) -> hdf5::Result<()> {
        let name = self.name.as_str();
        match &self.value {
            Value::Text(text) => {
                let text: VarLenUnicode =
                    text.replace('\0', " ").parse().map_err(|e| hdf5::Error::from(format!("{e}")))?;
                place.new_attr::<VarLenUnicode>().create(name)?.write_scalar(&text)
            }
            Value::Count(value) => place.new_attr::<u64>().create(name)?.write_scalar(value),
            Value::Number(value) => place.new_attr::<i64>().create(name)?.write_scalar(value),
            Value::Real(value) => place.new_attr::<f64>().create(name)?.write_scalar(value),
            Value::List(values) => place.new_attr::<u32>().shape([values.len()]).create(name)?.write_raw(values),
        }
    }
}
