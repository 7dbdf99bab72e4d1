//! Going back to an earlier commit of an archive and on from there.

use std::fs::{self, File, OpenOptions};
use std::io::{self, Read};
use std::path::{Path, PathBuf};

use super::archive::{ArchiveOptions, ArchiveWriter, Durability, archive_metadata};
use super::mark::ArchiveMark;
use super::tree::{CompoundId, Member};
use crate::error::{AlembicError, Fault};
use crate::metadata::MetaData;
use crate::murmur::murmur3_x64_128;
use crate::ogawa::{ChunkSource, Slot};

/// Metadata that names the writing program: another version of it may continue an archive.
const ABOUT_THE_WRITER: [&str; 2] = ["_ai_Application", "_ai_AlembicVersion"];

impl ArchiveWriter {
    /// The last commit of this writer; none before the first, and none in an archive opened by
    /// [`ArchiveWriter::append`].
    pub fn mark(&self) -> Option<ArchiveMark> {
        self.mark
    }

    /// Opens the archive as it was after the commit `mark` and goes on from there. The bytes written then are those of
    /// a writer that went on after that commit without a break.
    ///
    /// `declare` declares everything that the archive has, with the values of static properties; what it returns is
    /// handed on. Refused is what is declared and not in the file, what is in the file and not declared, and other
    /// `options`; but another version of the program may continue. Nothing in the file is changed before all that is
    /// found to be right.
    ///
    /// Readers find a valid archive all the time. Where the header points to a later commit, programs that opened the
    /// file, and may have mapped it into memory, look at what is to be overwritten: the archive then goes on in a copy
    /// of its first `mark.end` bytes, begun as `path` with `.part` behind and renamed to `path` when it is complete and
    /// on the disk. They keep the file that they have. Behind the last commit nobody looks; it is overwritten in place.
    /// Remains of such a copy that a killed process left are removed.
    ///
    /// It costs reading the tables, 24 bytes of every stored sample, the last sample of every property, and the copy.
    ///
    /// # Errors
    /// The file is missing, shorter than the mark, has other content there, or another set-up than declared; the copy
    /// cannot be made. The file is then as it was.
    pub fn resume<T>(
        path: impl AsRef<Path>,
        options: &ArchiveOptions,
        mark: &ArchiveMark,
        declare: impl FnOnce(&mut Self) -> Result<T, AlembicError>,
    ) -> Result<(Self, T), AlembicError> {
        let path = path.as_ref();
        let (mut writer, declared, is_last) = Self::at_mark(path, options, mark, declare)?;
        if is_last {
            remove_if_there(&unfinished(path))?;
        } else {
            writer.go_on_in_copy(mark)?;
        }
        writer.make_room(mark.end, mark.end)?;
        Ok((writer, declared))
    }

    /// Finds out whether the archive can go on after the commit `mark`; changes nothing.
    ///
    /// # Errors
    /// The errors of [`ArchiveWriter::resume`], without those of writing the copy.
    pub fn check_resume<T>(
        path: impl AsRef<Path>,
        options: &ArchiveOptions,
        mark: &ArchiveMark,
        declare: impl FnOnce(&mut Self) -> Result<T, AlembicError>,
    ) -> Result<(), AlembicError> {
        Self::at_mark(path.as_ref(), options, mark, declare).map(|_| ())
    }

    /// The archive as it was after the commit `mark`, what `declare` returned, and whether the header points to that commit.
    fn at_mark<T>(
        path: &Path,
        options: &ArchiveOptions,
        mark: &ArchiveMark,
        declare: impl FnOnce(&mut Self) -> Result<T, AlembicError>,
    ) -> Result<(Self, T, bool), AlembicError> {
        let (source, root) = ChunkSource::open_at(path, mark.root)?;
        let mut writer = Self::restored(path, &source, root)?;
        if writer.end != mark.end || writer.packed_mark() != Some(*mark) {
            let reason = "the content at its mark differs from what was written there".into();
            return Err(AlembicError::Damaged { path: path.to_owned(), place: "commit".into(), reason });
        }
        writer.check_last_samples(&source)?;
        if described(&writer.metadata) != described(&archive_metadata(options)) {
            return Err(writer.refuse("metadata", "the archive was started with different settings"));
        }
        writer.sealed = true;
        let declared = declare(&mut writer)?;
        if writer.changed {
            return Err(writer.refuse("declarations", "objects, properties or time samplings are not in the file"));
        }
        if let Some(place) = writer.undeclared() {
            return Err(writer.refuse(&place, "the file has it, but it is not being continued"));
        }
        writer.sealed = false;
        writer.mark = Some(*mark);
        Ok((writer, declared, source.root_in_header() == mark.root))
    }

    /// Removes the archive at `path`, if there is one, and what a process that was killed while it
    /// [resumed](ArchiveWriter::resume) left of a copy.
    ///
    /// # Errors
    /// A file cannot be removed.
    pub fn remove(path: impl AsRef<Path>) -> Result<(), AlembicError> {
        let path = path.as_ref();
        remove_if_there(path)?;
        remove_if_there(&unfinished(path))
    }

    /// Puts a copy that ends with the commit `mark` in the place of the file.
    fn go_on_in_copy(&mut self, mark: &ArchiveMark) -> Result<(), AlembicError> {
        let (path, part) = (self.path.clone(), unfinished(&self.path));
        let copied = self.copied(&part, mark).and_then(|()| self.rename(&path));
        if copied.is_err() {
            // What is left of it would only take room.
            let _ = fs::remove_file(&part);
        }
        copied
    }

    /// Copies the file up to the end of the commit `mark` to `part`, and goes on there.
    fn copied(&mut self, part: &Path, mark: &ArchiveMark) -> Result<(), AlembicError> {
        let failed = |source| AlembicError::Io { path: part.to_owned(), action: "copy the archive to", source };
        let mut whole = File::open(&self.path).map_err(failed)?.take(mark.end);
        let mut copy =
            OpenOptions::new().read(true).write(true).create(true).truncate(true).open(part).map_err(failed)?;
        let length = io::copy(&mut whole, &mut copy).map_err(failed)?;
        if length < mark.end {
            return Err(failed(io::ErrorKind::UnexpectedEof.into()));
        }
        self.file = copy;
        self.path = part.to_owned();
        self.write_at(8, &mark.root.to_le_bytes())?;
        self.synchronise(Durability::Synced)
    }

    /// Something that the file has and nobody declared.
    fn undeclared(&self) -> Option<String> {
        let objects = self.objects.iter().map(|object| (object.declared, &object.path));
        let compounds = self.compounds.iter().map(|compound| (compound.declared, &compound.place));
        let properties = self.properties.iter().map(|property| (property.declared, &property.place));
        let mut all = objects.chain(compounds).chain(properties);
        all.find(|(declared, _)| !declared).map(|(_, place)| place.clone())
    }

    /// Counts the member `name` of a compound as declared, with everything in it; nothing if there is none.
    pub(super) fn declare_member(&mut self, compound: CompoundId, name: &str) {
        let mut waiting: Vec<Member> = self.member(compound, name).into_iter().collect();
        while let Some(member) = waiting.pop() {
            match member {
                Member::Property(index) => self.properties[index].declared = true,
                Member::Compound(index) => {
                    self.compounds[index].declared = true;
                    waiting.extend(&self.compounds[index].members);
                }
            }
        }
    }

    /// Checks that the last sample of every property is stored as its digest says. Earlier samples are not looked at:
    /// that would mean to read the whole file.
    fn check_last_samples(&self, source: &ChunkSource) -> Result<(), AlembicError> {
        for node in &self.properties {
            let (Some(last), Some(key)) = (node.stored.last(), node.previous) else {
                continue;
            };
            let at = |fault: Fault| fault.at(&self.path, &node.place);
            let payload = source.data_after(Slot(last.payload), 16).map_err(at)?;
            if key.size > 0 && murmur3_x64_128(&payload) != key.digest {
                return Err(at(Fault::damaged("the last sample differs from what was written")));
            }
        }
        Ok(())
    }

    /// The mark that a commit would have whose tables end where the file ends now.
    fn packed_mark(&self) -> Option<ArchiveMark> {
        let size = self.packed_tables(0).1.len() as u64; // offsets in tables do not change their size
        let (root, tables) = self.packed_tables(self.end.checked_sub(size)?);
        Some(ArchiveMark { root: root.0, end: self.end, digest: murmur3_x64_128(&tables) })
    }

    /// Cuts off what stands behind the last commit.
    pub(super) fn cut_tail(&mut self) -> Result<(), AlembicError> {
        let cut = self.file.metadata().and_then(|about| match about.len() > self.end {
            true => self.file.set_len(self.end),
            false => Ok(()),
        });
        cut.map_err(|source| AlembicError::Io { path: self.path.clone(), action: "cut the end of", source })
    }
}

/// Pairs of the archive's metadata that say how it is set up.
fn described(metadata: &str) -> Vec<(String, String)> {
    let metadata = MetaData::parse(metadata);
    let pairs = metadata.iter().filter(|(key, _)| !ABOUT_THE_WRITER.contains(key));
    pairs.map(|(key, value)| (key.to_owned(), value.to_owned())).collect()
}

/// Removes a file if it exists.
fn remove_if_there(path: &Path) -> Result<(), AlembicError> {
    match fs::remove_file(path) {
        Err(source) if source.kind() != io::ErrorKind::NotFound => {
            Err(AlembicError::Io { path: path.to_owned(), action: "remove", source })
        }
        _ => Ok(()),
    }
}

/// The name under which the copy is made.
fn unfinished(path: &Path) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(".part");
    name.into()
}
