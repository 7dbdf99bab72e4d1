//! The checkpoints of a run: `checkpoints/` in its folder.
//!
//! A checkpoint is called `frame_01043.h5`, or `frame_01043.step_000012.h5` when it was written twelve steps after that
//! frame; a frame before 0 is `frame_-0010.h5`. Programs order them by number ([`list`]); a listing of the folder shows
//! them in the same order, except that frames before 0 come backwards. Beside each stands a `.json` with the
//! [`Account`]. Whatever begins with a point and ends in `.part` is unfinished.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Instant;

use drapery_core::snapshot::SnapshotSink;
use drapery_io::atomic_file;
use drapery_io::checkpoint::{CheckpointReader, CheckpointWriter, Head, damaged};
use drapery_io::error::IoError;
use drapery_io::input_file;
use serde::{Deserialize, Serialize};
use serde_json::Value;

/// Folder of the checkpoints inside that of a run.
pub(crate) const FOLDER: &str = "checkpoints";

/// File in it with the pinned frames, one a line: those of earlier attempts stay pinned.
const PINNED: &str = "pinned.txt";

/// Account of the time and counts of a run when a checkpoint was written: it depends on the machine, so it stands
/// beside the checkpoint.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Account {
    /// Number of the attempt that wrote the checkpoint.
    pub attempt: u32,
    /// Length of `run.jsonl` at that moment [bytes].
    pub record_bytes: u64,
    /// Times of stages and counts up to there.
    pub totals: Value,
}

/// An account and the checkpoint that it belongs to, as stored.
#[derive(Serialize, Deserialize)]
struct StoredAccount {
    content_hash: String,
    #[serde(flatten)]
    account: Account,
}

/// A checkpoint in the folder; in the order of [`list`].
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Entry {
    /// Last frame that was reached.
    pub frame: i64,
    /// Collision-free steps since that frame.
    pub sub_step: u64,
    /// The file.
    pub path: PathBuf,
}

/// A checkpoint that was written.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Saved {
    /// The file.
    pub path: PathBuf,
    /// Its length [bytes].
    pub bytes: u64,
    /// Time that it took, with the wait for the disk [s].
    pub seconds: f64,
    /// Hash of its content.
    pub content_hash: String,
}

/// A checkpoint that was opened.
#[derive(Debug)]
pub(crate) struct Loaded {
    /// Its content.
    pub checkpoint: CheckpointReader,
    /// Account of the run up to there; `None` when the file beside it is missing or belongs to another checkpoint.
    pub account: Option<Account>,
    /// The file.
    pub path: PathBuf,
}

/// Result of a search.
#[derive(Debug, Default)]
pub(crate) struct Search {
    /// The newest that can be used.
    pub found: Option<Loaded>,
    /// Checkpoints that were newer and cannot be used, with the reason; they are left in their places.
    pub refused: Vec<IoError>,
}

/// The checkpoints of a run that is being simulated.
#[derive(Debug, Clone)]
pub(crate) struct Store {
    folder: PathBuf,
    keep: usize,
    pinned: BTreeSet<i64>,
}

impl Store {
    /// Opens the checkpoints in the folder `out` of a run, and removes what an earlier run left unfinished: parts of files, and
    /// accounts whose checkpoint was never written.
    ///
    /// The last `keep` are kept, at least one, beside those at the frames `pinned` and at those that earlier attempts have pinned.
    /// Only the holder of the run's lock may do this.
    ///
    /// # Errors
    /// The folder cannot be created or changed; the file of the pinned frames holds something else.
    pub(crate) fn open(out: &Path, keep: usize, pinned: &[i64]) -> Result<Self, IoError> {
        let folder = out.join(FOLDER);
        fs::create_dir_all(&folder).map_err(|e| IoError::creating(&folder, e))?;
        for path in files(&folder)? {
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            if name.ends_with(".part") || is_orphan(&path) {
                fs::remove_file(&path).map_err(|e| IoError::writing(&path, e))?;
            }
        }
        let path = folder.join(PINNED);
        let earlier = pinned_in(&path)?;
        let pinned: BTreeSet<i64> = earlier.iter().chain(pinned).copied().collect();
        if pinned != earlier {
            let lines: String = pinned.iter().map(|frame| format!("{frame}\n")).collect();
            atomic_file::replace(&path, lines.as_bytes())?;
        }
        Ok(Self { folder, keep: keep.max(1), pinned })
    }

    /// Whether the checkpoint at a frame is to be written and kept in any case.
    pub(crate) fn is_pinned(&self, frame: i64) -> bool {
        self.pinned.contains(&frame)
    }

    /// Writes a checkpoint of what `give` gives, and then removes those that are no longer kept. One of the same frame and
    /// step is replaced.
    ///
    /// # Errors
    /// There is not enough room, or the disk refuses; all earlier checkpoints are then still there.
    ///
    /// # Panics
    /// As the sink of [`CheckpointWriter`].
    pub(crate) fn save(
        &self,
        head: &Head,
        account: &Account,
        give: impl FnOnce(&mut dyn SnapshotSink),
    ) -> Result<Saved, IoError> {
        let start = Instant::now();
        let path = self.folder.join(file_name(head.frame, head.sub_step));
        let part = part_path(&path);
        let write = |mut writer: CheckpointWriter| {
            writer.look_for_room(&path);
            give(&mut writer);
            writer.finish()
        };
        let written = CheckpointWriter::create(&part, head).and_then(write).and_then(|(bytes, content_hash)| {
            let stored = StoredAccount { content_hash, account: account.clone() };
            // A struct of texts and numbers always has a JSON form.
            let text = serde_json::to_string_pretty(&stored).unwrap_or_default() + "\n";
            // Before the checkpoint: one that is seen has its account.
            atomic_file::replace(&account_path(&path), text.as_bytes())?;
            fs::rename(&part, &path).map_err(|e| IoError::writing(&path, e))?;
            atomic_file::sync_folder(&self.folder);
            Ok((bytes, stored.content_hash))
        });
        if written.is_err() {
            // It would only take room; if it cannot be removed either, the first error says why.
            let _ = fs::remove_file(&part);
        }
        let (bytes, content_hash) = written?;
        self.prune(&path)?;
        Ok(Saved { path, bytes, seconds: start.elapsed().as_secs_f64(), content_hash })
    }

    /// The checkpoints, earliest first.
    ///
    /// # Errors
    /// The folder cannot be read.
    pub(crate) fn list(&self) -> Result<Vec<Entry>, IoError> {
        entries(&self.folder)
    }

    /// Reads the newest checkpoint that can be used; with `at_most`, one that is not later than that frame.
    ///
    /// # Errors
    /// The folder cannot be read.
    pub(crate) fn newest_valid(&self, at_most: Option<i64>) -> Result<Search, IoError> {
        let mut search = Search::default();
        let early_enough = |e: &Entry| at_most.is_none_or(|frame| (e.frame, e.sub_step) <= (frame, 0));
        for entry in self.list()?.into_iter().rev().filter(early_enough) {
            match load(&entry) {
                Ok(found) => {
                    search.found = Some(found);
                    break;
                }
                Err(error) => search.refused.push(error),
            }
        }
        Ok(search)
    }

    /// Moves the checkpoints later than a frame and step into the folder `into`, with their accounts; returns where
    /// they are now. A name that is taken there gets a number: nothing is replaced.
    ///
    /// # Errors
    /// The folder cannot be created, or a file cannot be moved there.
    pub(crate) fn set_aside_after(&self, frame: i64, sub_step: u64, into: &Path) -> Result<Vec<PathBuf>, IoError> {
        let later = self.list()?.into_iter().filter(|e| (e.frame, e.sub_step) > (frame, sub_step));
        let mut moved = Vec::new();
        for entry in later {
            fs::create_dir_all(into).map_err(|e| IoError::creating(into, e))?;
            let target = free_path(into, &entry);
            fs::rename(&entry.path, &target).map_err(|e| IoError::writing(&target, e))?;
            let (from, to) = (account_path(&entry.path), account_path(&target));
            match fs::rename(&from, &to) {
                Err(e) if e.kind() != std::io::ErrorKind::NotFound => return Err(IoError::writing(&to, e)),
                _ => moved.push(target),
            }
        }
        if !moved.is_empty() {
            atomic_file::sync_folder(into);
            atomic_file::sync_folder(&self.folder);
        }
        Ok(moved)
    }

    /// Removes all checkpoints in the folder `out` of a run that is replaced, and forgets which frames were pinned.
    ///
    /// # Errors
    /// A file cannot be removed.
    pub(crate) fn clear(out: &Path) -> Result<(), IoError> {
        list(out)?.iter().try_for_each(|entry| remove(&entry.path))?;
        remove_file(&out.join(FOLDER).join(PINNED))
    }

    /// Removes all but the last few, the pinned ones and `saved`.
    fn prune(&self, saved: &Path) -> Result<(), IoError> {
        let mut unpinned = self.list()?;
        unpinned.retain(|entry| !(self.is_pinned(entry.frame) && entry.sub_step == 0));
        let kept = unpinned.len().saturating_sub(self.keep);
        for entry in unpinned.into_iter().take(kept).filter(|entry| entry.path != saved) {
            remove(&entry.path)?;
        }
        Ok(())
    }
}

/// Removes a checkpoint. The account goes last: a checkpoint that is seen has its account.
fn remove(path: &Path) -> Result<(), IoError> {
    for path in [path.to_owned(), account_path(path)] {
        remove_file(&path)?;
    }
    Ok(())
}

/// Removes a file, if it is there.
fn remove_file(path: &Path) -> Result<(), IoError> {
    atomic_file::remove(path).map_err(|e| IoError::writing(path, e))?;
    Ok(())
}

/// The frames that a file lists, one a line; none where there is no file.
fn pinned_in(path: &Path) -> Result<BTreeSet<i64>, IoError> {
    let text = match input_file::text(path) {
        Err(IoError::Missing { .. }) => return Ok(BTreeSet::new()),
        other => other?,
    };
    let frame = |(index, line): (usize, &str)| {
        let what = format!("{line:?} is no frame");
        let advice = "the file lists frames whose checkpoints are kept, one a line; correct it, or remove it";
        line.trim().parse().map_err(|_| IoError::data(path, format!("line {}", index + 1), what, advice))
    };
    text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty()).map(frame).collect()
}

/// The checkpoints in the folder `out` of a run, earliest first; none when there is no such folder. Changes nothing.
///
/// # Errors
/// The folder cannot be read.
pub(crate) fn list(out: &Path) -> Result<Vec<Entry>, IoError> {
    let folder = out.join(FOLDER);
    if folder.is_dir() { entries(&folder) } else { Ok(Vec::new()) }
}

/// Opens a checkpoint and what belongs to it.
///
/// # Errors
/// As [`CheckpointReader::open`]; also when the file has the name of another frame or step.
pub(crate) fn load(entry: &Entry) -> Result<Loaded, IoError> {
    let checkpoint = CheckpointReader::open(&entry.path)?;
    let head = &checkpoint.head;
    if (head.frame, head.sub_step) != (entry.frame, entry.sub_step) {
        let name = file_name(head.frame, head.sub_step);
        return Err(damaged(&entry.path, "name", format!("its content belongs in {name}")));
    }
    let account = read_account(&entry.path, checkpoint.content_hash());
    Ok(Loaded { checkpoint, account, path: entry.path.clone() })
}

fn read_account(path: &Path, hash: &str) -> Option<Account> {
    let text = input_file::text(&account_path(path)).ok()?;
    let stored: StoredAccount = serde_json::from_str(&text).ok()?;
    (stored.content_hash == hash).then_some(stored.account)
}

/// The checkpoints in a folder, earliest first.
///
/// # Errors
/// The folder cannot be read.
pub(crate) fn entries(folder: &Path) -> Result<Vec<Entry>, IoError> {
    let mut found: Vec<Entry> = files(folder)?.into_iter().filter_map(entry).collect();
    found.sort_unstable();
    Ok(found)
}

fn files(folder: &Path) -> Result<Vec<PathBuf>, IoError> {
    let reading = |e| IoError::reading(folder, e);
    fs::read_dir(folder).map_err(reading)?.map(|item| Ok(item.map_err(reading)?.path())).collect()
}

fn file_name(frame: i64, sub_step: u64) -> String {
    if sub_step == 0 { format!("frame_{frame:05}.h5") } else { format!("frame_{frame:05}.step_{sub_step:06}.h5") }
}

/// The inverse of [`file_name`]; `None` for files that are called otherwise.
fn entry(path: PathBuf) -> Option<Entry> {
    let name = path.file_name()?.to_str()?;
    let stem = name.strip_prefix("frame_")?.strip_suffix(".h5")?;
    let (frame, sub_step) = stem.split_once(".step_").unwrap_or((stem, "0"));
    let (frame, sub_step) = (frame.parse().ok()?, sub_step.parse().ok()?);
    (file_name(frame, sub_step) == name).then_some(Entry { frame, sub_step, path })
}

/// Returns the path under which a file is written before it gets its name.
fn part_path(path: &Path) -> PathBuf {
    let mut name = std::ffi::OsString::from(".");
    name.push(path.file_name().unwrap_or_default());
    name.push(".part");
    path.with_file_name(name)
}

/// The account that belongs to a checkpoint.
fn account_path(path: &Path) -> PathBuf {
    path.with_extension("json")
}

/// Whether a file is an account that belongs to no checkpoint.
fn is_orphan(path: &Path) -> bool {
    let of = path.with_extension("h5");
    account_path(&of) == path && !of.exists() && entry(of).is_some()
}

/// A name in `folder` that is not taken.
fn free_path(folder: &Path, entry: &Entry) -> PathBuf {
    let name = file_name(entry.frame, entry.sub_step);
    let stem = name.trim_end_matches(".h5");
    let numbered = (2..).map(|number: u64| folder.join(format!("{stem}.{number}.h5")));
    let mut names = std::iter::once(folder.join(&name)).chain(numbered);
    // There are more numbers than files.
    names.find(|path| !path.exists() && !account_path(path).exists()).unwrap_or_else(|| folder.join(&name))
}

#[cfg(test)]
mod tests;
