//! The archive under construction: creation, declarations of objects and properties.

use std::collections::HashMap;
use std::fs::File;
use std::io::{Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use super::mark::ArchiveMark;
use super::tree::{
    CompoundId, CompoundNode, Member, ObjectId, ObjectNode, PropertyId, PropertyNode, SampleKey, StoredSample,
};
use crate::error::AlembicError;
use crate::metadata::MetaData;
use crate::ogawa::{HEADER_SIZE, unfinished_header};
use crate::property::DataType;
use crate::time_sampling::TimeSampling;

/// Text stored with a new archive.
#[derive(Debug, Clone, Default)]
pub struct ArchiveOptions {
    /// Name and version of the writing program.
    pub application: String,
    /// Free text about the content.
    pub description: String,
    /// Date of writing. Left out when `None`, so that equal input gives equal bytes.
    pub date: Option<String>,
    /// Frames per second, a hint for importers (time is stored in seconds).
    pub frames_per_second: Option<f64>,
    /// Further key-value pairs, such as metres per unit.
    pub extra: MetaData,
}

/// Durability that a commit reaches before it returns.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Durability {
    /// Handed to the operating system: survives the end of this process, not a power cut.
    Flushed,
    /// On the disk, tables before the root that points to them: survives a power cut too.
    Synced,
}

/// Compounds may be nested this deep; readers have limits too.
const MOST_NESTED: usize = 100;

/// Writes an Alembic (Ogawa) archive piece by piece.
///
/// The layout of the file after a commit depends on what was given up to that commit alone. A commit appends all
/// tables, so its cost grows with the samples written (about 16 bytes per stored array sample): commit every frame for
/// hundreds of frames, every tenth for many thousands.
///
/// After an error of the disk, drop the writer: the file shows the last commit and can be continued from there with
/// [`ArchiveWriter::append`].
///
/// Declaring the same objects and properties again after [`ArchiveWriter::append`] or [`ArchiveWriter::resume`] finds
/// the stored ones, so the code that sets up a shot is the same for a new and a continued file.
#[derive(Debug)]
pub struct ArchiveWriter {
    pub(super) path: PathBuf,
    pub(super) file: File,
    /// Position of the next chunk.
    pub(super) end: u64,
    pub(super) metadata: String,
    pub(super) samplings: Vec<TimeSampling>,
    pub(super) objects: Vec<ObjectNode>,
    pub(super) compounds: Vec<CompoundNode>,
    pub(super) properties: Vec<PropertyNode>,
    /// Payloads already in the file; asked by key only, so its order never shows.
    pub(super) known: HashMap<SampleKey, StoredSample>,
    /// Bytes of the chunk being written, kept for its capacity until the next commit.
    pub(super) chunk: Vec<u8>,
    pub(super) committed: bool,
    pub(super) changed: bool,
    /// The last commit, if this writer made it or was continued from its mark.
    pub(super) mark: Option<ArchiveMark>,
    /// True while the declarations of a continued archive are compared with the file: nothing may be written yet.
    pub(super) sealed: bool,
}

impl ArchiveWriter {
    /// Creates `path`, replacing what is there. The file is not a valid archive before the first commit.
    pub fn create(path: impl AsRef<Path>, options: &ArchiveOptions) -> Result<Self, AlembicError> {
        let path = path.as_ref().to_owned();
        let failed = |source| AlembicError::Io { path: path.clone(), action: "create", source };
        let mut file = File::create(&path).map_err(failed)?;
        file.write_all(&unfinished_header()).map_err(failed)?;
        let mut writer = Self::empty(path, file, archive_metadata(options));
        writer.samplings.push(TimeSampling::identity());
        writer.insert_object(None, "ABC", String::new());
        writer.objects[0].declared = true;
        Ok(writer)
    }

    pub(super) fn empty(path: PathBuf, file: File, metadata: String) -> Self {
        Self {
            path,
            file,
            end: HEADER_SIZE,
            metadata,
            samplings: Vec::new(),
            objects: Vec::new(),
            compounds: Vec::new(),
            properties: Vec::new(),
            known: HashMap::new(),
            chunk: Vec::new(),
            committed: false,
            changed: true,
            mark: None,
            sealed: false,
        }
    }

    /// Gives the file another name in the same file system; what has that name is replaced in one step.
    ///
    /// An archive that is begun beside its final name and renamed after its first commit is never seen unfinished.
    pub fn rename(&mut self, path: impl AsRef<Path>) -> Result<(), AlembicError> {
        let path = path.as_ref().to_owned();
        std::fs::rename(&self.path, &path).map_err(|source| AlembicError::Io {
            path: path.clone(),
            action: "rename the new file to",
            source,
        })?;
        self.path = path;
        Ok(())
    }

    /// The file being written.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The file being written, open: whether its name still leads to it can be asked. Nothing else may be done with it.
    pub fn file(&self) -> &File {
        &self.file
    }

    /// Index of `sampling` for property declarations; equal samplings share one. Index 0 is for static properties.
    pub fn add_time_sampling(&mut self, sampling: TimeSampling) -> Result<u32, AlembicError> {
        if let Some(found) = self.samplings.iter().position(|known| known.matches(&sampling)) {
            return Ok(found as u32);
        }
        self.changed = true;
        self.samplings.push(sampling);
        Ok(self.samplings.len() as u32 - 1)
    }

    /// The top object, parent of all.
    pub fn root(&self) -> ObjectId {
        ObjectId(0)
    }

    /// The compound in which the schemas of `object` live, together with `visible`.
    pub fn top_compound(&self, object: ObjectId) -> CompoundId {
        CompoundId(self.objects[object.0].properties)
    }

    /// Full path of `object`, such as `/body/bodyShape`.
    pub fn object_path(&self, object: ObjectId) -> &str {
        &self.objects[object.0].path
    }

    /// The scalar or array property `name` of `compound`.
    pub fn find_property(&self, compound: CompoundId, name: &str) -> Option<PropertyId> {
        match self.member(compound, name) {
            Some(Member::Property(index)) => Some(PropertyId(index)),
            _ => None,
        }
    }

    /// The compound property `name` of `compound`.
    pub fn find_compound(&self, compound: CompoundId, name: &str) -> Option<CompoundId> {
        match self.member(compound, name) {
            Some(Member::Compound(index)) => Some(CompoundId(index)),
            _ => None,
        }
    }

    /// Number of samples of a property so far.
    pub fn sample_count(&self, property: PropertyId) -> usize {
        self.properties[property.0].count as usize
    }

    /// Declares a child object of `parent`. The name is unique among siblings, not empty and without `/`.
    pub fn add_object(&mut self, parent: ObjectId, name: &str, metadata: &MetaData) -> Result<ObjectId, AlembicError> {
        let metadata = metadata.serialise();
        let siblings = &self.objects[parent.0].children;
        let place = format!("{}/{name}", self.objects[parent.0].path.trim_end_matches('/'));
        self.check_name(&place, name)?;
        if let Some(&found) = siblings.iter().find(|&&child| self.objects[child].name == name) {
            let node = &self.objects[found];
            self.check_restored(&place, node.declared, node.metadata == metadata)?;
            self.objects[found].declared = true;
            return Ok(ObjectId(found));
        }
        let index = self.insert_object(Some(parent.0), name, metadata);
        self.objects[index].declared = true;
        Ok(ObjectId(index))
    }

    /// Declares a compound property in `parent`.
    pub fn add_compound(
        &mut self,
        parent: CompoundId,
        name: &str,
        metadata: &MetaData,
    ) -> Result<CompoundId, AlembicError> {
        let metadata = metadata.serialise();
        let place = self.place_in(parent, name);
        self.check_name(&place, name)?;
        match self.member(parent, name) {
            Some(Member::Compound(found)) => {
                let node = &self.compounds[found];
                self.check_restored(&place, node.declared, node.metadata == metadata)?;
                self.compounds[found].declared = true;
                Ok(CompoundId(found))
            }
            Some(Member::Property(_)) => Err(self.refuse(&place, "the stored property is no compound")),
            None if self.compounds[parent.0].depth >= MOST_NESTED => {
                Err(self.refuse(&place, &format!("compounds may be nested {MOST_NESTED} deep, not deeper")))
            }
            None => {
                let index = self.insert_compound(parent, name, metadata);
                self.compounds[index].declared = true;
                Ok(CompoundId(index))
            }
        }
    }

    /// Declares a property with one element a sample.
    pub fn add_scalar_property(
        &mut self,
        parent: CompoundId,
        name: &str,
        metadata: &MetaData,
        data_type: DataType,
        time_sampling: u32,
    ) -> Result<PropertyId, AlembicError> {
        self.add_property(parent, (name, metadata), false, data_type, time_sampling)
    }

    /// Declares a property with any number of elements a sample.
    pub fn add_array_property(
        &mut self,
        parent: CompoundId,
        name: &str,
        metadata: &MetaData,
        data_type: DataType,
        time_sampling: u32,
    ) -> Result<PropertyId, AlembicError> {
        self.add_property(parent, (name, metadata), true, data_type, time_sampling)
    }

    fn add_property(
        &mut self,
        parent: CompoundId,
        (name, metadata): (&str, &MetaData),
        is_array: bool,
        data_type: DataType,
        time_sampling: u32,
    ) -> Result<PropertyId, AlembicError> {
        let metadata = metadata.serialise();
        let place = self.place_in(parent, name);
        self.check_name(&place, name)?;
        if data_type.extent == 0 {
            return Err(self.refuse(&place, "elements need at least one value"));
        }
        if time_sampling as usize >= self.samplings.len() {
            return Err(self.refuse(&place, &format!("time sampling {time_sampling} was not added to this archive")));
        }
        match self.member(parent, name) {
            Some(Member::Property(found)) => {
                let node = &self.properties[found];
                let same = node.metadata == metadata
                    && node.is_array == is_array
                    && node.data_type == data_type
                    && node.time_sampling == time_sampling;
                self.check_restored(&place, node.declared, same)?;
                self.properties[found].declared = true;
                return Ok(PropertyId(found));
            }
            Some(Member::Compound(_)) => {
                return Err(self.refuse(&place, "the stored property is a compound"));
            }
            None => {}
        }
        let index = self.insert_property(
            parent,
            PropertyNode {
                name: name.to_owned(),
                place,
                metadata,
                is_array,
                data_type,
                time_sampling,
                count: 0,
                first_changed: 0,
                last_changed: 0,
                stored: Vec::new(),
                previous: None,
                previous_elements: 0,
                scalar_like: true,
                homogeneous: true,
                content: [0; 16],
                declared: true,
            },
        );
        Ok(PropertyId(index))
    }

    pub(super) fn insert_object(&mut self, parent: Option<usize>, name: &str, metadata: String) -> usize {
        let path = match parent {
            Some(parent) => format!("{}/{name}", self.objects[parent].path.trim_end_matches('/')),
            None => "/".to_owned(),
        };
        self.compounds.push(CompoundNode {
            name: String::new(),
            place: format!("{path}:"),
            metadata: String::new(),
            members: Vec::new(),
            depth: 0,
            declared: true,
        });
        let index = self.objects.len();
        self.objects.push(ObjectNode {
            name: name.to_owned(),
            path,
            metadata,
            children: Vec::new(),
            properties: self.compounds.len() - 1,
            declared: false,
        });
        if let Some(parent) = parent {
            self.objects[parent].children.push(index);
        }
        self.changed = true;
        index
    }

    pub(super) fn insert_compound(&mut self, parent: CompoundId, name: &str, metadata: String) -> usize {
        let index = self.compounds.len();
        self.compounds.push(CompoundNode {
            name: name.to_owned(),
            place: format!("{}/", self.place_in(parent, name)),
            metadata,
            members: Vec::new(),
            depth: self.compounds[parent.0].depth + 1,
            declared: false,
        });
        self.compounds[parent.0].members.push(Member::Compound(index));
        self.changed = true;
        index
    }

    pub(super) fn insert_property(&mut self, parent: CompoundId, node: PropertyNode) -> usize {
        let index = self.properties.len();
        self.properties.push(node);
        self.compounds[parent.0].members.push(Member::Property(index));
        self.changed = true;
        index
    }

    pub(super) fn place_in(&self, compound: CompoundId, name: &str) -> String {
        format!("{}{name}", self.compounds[compound.0].place)
    }

    pub(super) fn member(&self, compound: CompoundId, name: &str) -> Option<Member> {
        self.compounds[compound.0].members.iter().copied().find(|member| match *member {
            Member::Compound(index) => self.compounds[index].name == name,
            Member::Property(index) => self.properties[index].name == name,
        })
    }

    fn check_name(&self, place: &str, name: &str) -> Result<(), AlembicError> {
        if name.is_empty() || name.contains(['/', '\0']) {
            return Err(self.refuse(place, "a name is not empty and has no `/` and no NUL; rename it"));
        }
        Ok(())
    }

    /// A name that exists already is right only when it came from the re-opened file and means the same.
    fn check_restored(&self, place: &str, declared: bool, same: bool) -> Result<(), AlembicError> {
        if declared {
            return Err(self.refuse(place, "this name was declared before; names are unique within their parent"));
        }
        if !same {
            let reason = "the stored one has a different type, metadata or sampling; continue with the settings that \
                          the file was started with, or write a new file";
            return Err(self.refuse(place, reason));
        }
        Ok(())
    }

    pub(super) fn refuse(&self, place: &str, reason: &str) -> AlembicError {
        AlembicError::Refused { path: self.path.clone(), place: place.to_owned(), reason: reason.to_owned() }
    }

    pub(super) fn write_at(&mut self, offset: u64, bytes: &[u8]) -> Result<(), AlembicError> {
        let done = self.file.seek(SeekFrom::Start(offset)).and_then(|_| self.file.write_all(bytes));
        done.map_err(|source| AlembicError::Io { path: self.path.clone(), action: "write", source })
    }
}

pub(super) fn archive_metadata(options: &ArchiveOptions) -> String {
    let mut metadata = options.extra.clone();
    metadata = metadata.with("_ai_AlembicVersion", "Alembic 1.8.12 (Ogawa, written by drapery-alembic)");
    metadata = metadata.with("_ai_Application", &options.application);
    metadata = metadata.with("_ai_Description", &options.description);
    if let Some(date) = &options.date {
        metadata = metadata.with("_ai_DateWritten", date);
    }
    if let Some(rate) = options.frames_per_second {
        metadata = metadata.with("_ai_DCC_FPS", &rate.to_string());
    }
    metadata.serialise()
}
