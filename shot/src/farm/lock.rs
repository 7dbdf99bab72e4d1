//! `OUT/lock.json`: one run a folder, whatever machine it comes from.
//!
//! The file names its owner and the time of the last heartbeat. It appears under its name with all of its content, and
//! exactly one of several starters gets it. A heartbeat overwrites the owner's own file in place, through the handle
//! that created it; taking a lock over puts another file in its place. So a run that was taken for dead can never write
//! over the lock of its successor, and sees that the file under the name is not its own any more.
//! The file system has to know hard links; those of farms do.
//!
//! Heartbeats come from a thread of their own and not from the frame loop: a single step of a large shot may take longer
//! than [`DEAD_AFTER`]. They say that the process lives; whether it gets on is what the manifest tells.

use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::{ErrorKind, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::mpsc::{self, RecvTimeoutError, Sender};
use std::thread::JoinHandle;
use std::time::{Duration, SystemTime};

use drapery_io::error::IoError;
use drapery_io::input_file;
use drapery_io::platform::{self, FileIdentity};
use serde::{Deserialize, Serialize};

use crate::farm::process::Owner;

/// File name of the lock in the folder of a run.
pub const LOCK: &str = "lock.json";

/// Time between two heartbeats.
pub(crate) const BEAT_EVERY: Duration = Duration::from_secs(10);

/// Age of the last heartbeat from which a run that cannot be seen from here is taken for dead: many missed heartbeats,
/// because file servers pass changes on late and clocks of machines differ.
pub(crate) const DEAD_AFTER: Duration = Duration::from_secs(180);

/// Room for a heartbeat to grow in digits: the file keeps its length, so that a reader never sees half of one.
const SPARE: usize = 8;

/// Cap on the looks of a starter while the lock changes hands under its eyes.
const LOOKS: usize = 100;

/// Time between two looks.
const LOOK_AGAIN: Duration = Duration::from_millis(10);

/// Content of the file.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
struct Record {
    #[serde(flatten)]
    owner: Owner,
    /// Last heartbeat, in seconds since 1970.
    heartbeat: u64,
}

/// Holder of a folder, as another process sees it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Holder {
    /// The process; `None` when the file cannot be understood.
    pub owner: Option<Owner>,
    /// Time since its last heartbeat.
    pub silent_for: Duration,
    /// Time by which its last heartbeat lies in the future: one of the clocks is wrong, or was set back.
    pub ahead: Duration,
    /// Whether it is still there.
    pub presence: Presence,
}

/// Whether the holder of a lock is still there.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Presence {
    /// It runs, or was heard of lately.
    Alive,
    /// It runs where it cannot be seen, if at all, and was not heard of for [`DEAD_AFTER`]: probably dead.
    Silent,
    /// It has certainly ended, without the chance to tidy up.
    Gone,
}

impl std::fmt::Display for Holder {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match &self.owner {
            Some(owner) => write!(f, "{owner}"),
            None => write!(f, "an unknown process ({LOCK} is damaged)"),
        }
    }
}

/// Finds the holder of the folder; `None` when nobody holds it. Reads only.
///
/// # Errors
/// The lock is there and cannot be read.
pub fn holder(folder: &Path, now: SystemTime) -> Result<Option<Holder>, IoError> {
    let found = Found::read(&folder.join(LOCK))?;
    Ok(found.map(|found| found.holder(&Owner::this_process(), now)))
}

/// Whether a folder is this process' own.
///
/// # Errors
/// The lock is there and cannot be read.
pub(crate) fn is_held_by(folder: &Path, owner: &Owner) -> Result<bool, IoError> {
    let found = Found::read(&folder.join(LOCK))?;
    Ok(found.and_then(|found| found.record).is_some_and(|record| record.owner == *owner))
}

/// Gives a folder back that this process holds, and that it will not write into any more: it ends.
///
/// # Errors
/// The lock cannot be removed; the next run finds that the process has ended.
pub(crate) fn give_back(folder: &Path) -> Result<(), IoError> {
    let path = folder.join(LOCK);
    fs::remove_file(&path).map_err(|e| IoError::writing(&path, e))
}

/// The right to write into a folder, given back when it is dropped.
#[derive(Debug)]
pub struct RunLock {
    path: PathBuf,
    file: Arc<File>,
    former: Option<Holder>,
    lost: Arc<AtomicBool>,
    heart: Option<(Sender<()>, JoinHandle<()>)>,
}

impl RunLock {
    /// Takes the lock of a folder, which is made if it does not exist.
    ///
    /// The lock of a process that has certainly ended is taken over; [`RunLock::former`] then says whose it was. With
    /// `steal` any lock is.
    ///
    /// # Errors
    /// [`IoError::Locked`] when another run holds the folder, or may; the folder cannot be written to.
    pub fn take(folder: &Path, owner: &Owner, steal: bool, now: SystemTime) -> Result<Self, IoError> {
        Self::take_beating(folder, owner, steal, now, BEAT_EVERY)
    }

    fn take_beating(
        folder: &Path,
        owner: &Owner,
        steal: bool,
        now: SystemTime,
        every: Duration,
    ) -> Result<Self, IoError> {
        fs::create_dir_all(folder).map_err(|e| IoError::creating(folder, e))?;
        let path = folder.join(LOCK);
        let draft = Draft::write(folder, owner, now)?;
        let mut holder = None;
        for _ in 0..LOOKS {
            match Found::read(&path)? {
                None if draft.appear(&path)? => return draft.keep(path, None, every),
                None => {}
                Some(found) => {
                    let seen = found.holder(owner, now);
                    if !steal && seen.presence != Presence::Gone {
                        return Err(refusal(&path, &seen));
                    }
                    if draft.replace(&path, &found)? {
                        return draft.keep(path, Some(seen), every);
                    }
                    holder = Some(seen);
                }
            }
            std::thread::sleep(LOOK_AGAIN);
        }
        // A process that replaces a lock holds the system's lock on it for an instant only; one has stopped in it.
        let name = holder.map_or_else(|| "an unknown process".to_owned(), |holder| holder.to_string());
        let what = format!("several runs are taking over this folder from {name} at the same time");
        Err(IoError::Locked { path, what, advice: "end them, then start one of them again".to_owned() })
    }

    /// The holder whose lock was taken over, for the log; `None` when the folder was free.
    pub(crate) fn former(&self) -> Option<&Holder> {
        self.former.as_ref()
    }

    /// Whether the folder is still this run's. Once it is not, nothing more may be written into it.
    ///
    /// Costs one opening of a small file: ask after every step, and before writing.
    pub(crate) fn still_mine(&self) -> bool {
        if !self.lost.load(Ordering::Acquire) && !is_under(&self.path, &self.file) {
            self.lost.store(true, Ordering::Release);
        }
        !self.lost.load(Ordering::Acquire)
    }

    /// The same as an error, that names the new holder.
    ///
    /// # Errors
    /// [`IoError::LockLost`] when the folder is another run's, [`IoError::LockGone`] when the lock or the folder was removed.
    pub fn check(&self) -> Result<(), IoError> {
        if self.still_mine() {
            return Ok(());
        }
        let path = self.path.clone();
        let folder = path.parent().unwrap_or(&path);
        Err(match Found::read(&path) {
            Ok(None) if folder.is_dir() => IoError::LockGone { path, is_folder: false },
            Ok(None) => IoError::LockGone { path: folder.to_owned(), is_folder: true },
            found => {
                let record = found.ok().flatten().and_then(|found| found.record);
                let taker = record.map_or_else(|| "another run".to_owned(), |record| record.owner.to_string());
                IoError::LockLost { path, taker }
            }
        })
    }
}

impl Drop for RunLock {
    fn drop(&mut self) {
        if let Some((stop, thread)) = self.heart.take() {
            drop(stop);
            // A heart that panicked is as still as one that was told to stop.
            let _ = thread.join();
        }
        // A process that is taking the lock over holds the system's lock on this file; the name is its own then.
        let taken = matches!(self.file.try_lock(), Err(TryLockError::WouldBlock));
        if !taken && self.still_mine() {
            // If it stays, the next run finds that this process has ended.
            let _ = fs::remove_file(&self.path);
        }
    }
}

/// A lock that was found under the name.
struct Found {
    file: File,
    record: Option<Record>,
    modified: SystemTime,
    user: Option<u32>,
}

impl Found {
    fn read(path: &Path) -> Result<Option<Self>, IoError> {
        let mut file = match input_file::open(path) {
            Err(IoError::Missing { .. }) => return Ok(None),
            opened => opened?,
        };
        let mut text = Vec::new();
        file.read_to_end(&mut text).map_err(|e| IoError::reading(path, e))?;
        let about = file.metadata().map_err(|e| IoError::reading(path, e))?;
        let modified = about.modified().unwrap_or(SystemTime::UNIX_EPOCH);
        Ok(Some(Self { file, record: serde_json::from_slice(&text).ok(), modified, user: platform::user_of(&about) }))
    }

    fn holder(&self, me: &Owner, now: SystemTime) -> Holder {
        // A number of seconds that no clock holds tells as little as a file that cannot be understood.
        let beat = |record: &Record| SystemTime::UNIX_EPOCH.checked_add(Duration::from_secs(record.heartbeat));
        let last = self.record.as_ref().and_then(beat).unwrap_or(self.modified);
        // A heartbeat from the future comes from a clock that goes ahead.
        let silent_for = now.duration_since(last).unwrap_or_default();
        let owner = self.record.as_ref().map(|record| record.owner.clone());
        let presence = presence(owner.as_ref(), self.user, me, silent_for);
        Holder { owner, silent_for, ahead: last.duration_since(now).unwrap_or_default(), presence }
    }
}

fn presence(owner: Option<&Owner>, user: Option<u32>, me: &Owner, silent_for: Duration) -> Presence {
    let silent = silent_for >= DEAD_AFTER;
    match owner {
        // Processes of other users may be hidden.
        Some(owner) if me.sees(owner) && user.is_some() && user == own_user() => {
            if owner.is_running() {
                Presence::Alive
            } else {
                Presence::Gone
            }
        }
        // The machine was started again, and the process did not survive that.
        Some(owner) if silent && me.host == owner.host && me.boot != owner.boot => Presence::Gone,
        _ if silent => Presence::Silent,
        _ => Presence::Alive,
    }
}

/// Number of the user that this process acts for.
fn own_user() -> Option<u32> {
    platform::user_of(&fs::metadata("/proc/self").ok()?)
}

fn refusal(path: &Path, holder: &Holder) -> IoError {
    let seconds = holder.silent_for.as_secs();
    let (what, advice) = match holder.presence {
        Presence::Silent => (
            format!("{holder} holds this folder, and is probably dead: its last heartbeat was {seconds} s ago"),
            "make sure that it has ended, then run again with --steal-lock",
        ),
        // Silence could not be noticed before that moment.
        _ if holder.ahead >= DEAD_AFTER => (
            format!(
                "this folder holds a run in progress by {holder}, whose last heartbeat lies {} s in the future: a clock is wrong",
                holder.ahead.as_secs()
            ),
            "wait for it, or make sure that it has ended and run again with --steal-lock",
        ),
        _ => (
            format!("this folder holds a run in progress by {holder}, last heartbeat {seconds} s ago"),
            "wait for it, end it with `drapery stop`, or choose another folder with --out",
        ),
    };
    IoError::Locked { path: path.to_owned(), what, advice: advice.to_owned() }
}

/// A complete lock that is not under its name yet.
struct Draft {
    path: PathBuf,
    file: Arc<File>,
    owner: Owner,
    length: usize,
}

impl Draft {
    fn write(folder: &Path, owner: &Owner, now: SystemTime) -> Result<Self, IoError> {
        static NUMBER: AtomicU32 = AtomicU32::new(0);
        let number = NUMBER.fetch_add(1, Ordering::Relaxed);
        let host = owner.host.replace('/', "_");
        let path = folder.join(format!(".{LOCK}.{host}.{}.{number}.part", owner.pid));
        // What an earlier process of the same number left behind is overwritten.
        let file = OpenOptions::new().read(true).write(true).create(true).truncate(true).open(&path);
        let file = Arc::new(file.map_err(|e| IoError::creating(&path, e))?);
        let length = content(owner, now).len() + SPARE;
        let draft = Self { path, file, owner: owner.clone(), length };
        beat(&draft.file, owner, length, now).map_err(|e| IoError::writing(&draft.path, e))?;
        Ok(draft)
    }

    /// Puts the lock under its name if nothing is there; says whether it is.
    fn appear(&self, path: &Path) -> Result<bool, IoError> {
        match fs::hard_link(&self.path, path) {
            Ok(()) => Ok(true),
            // Some file servers answer that the name exists when it was this very call that made it.
            Err(error) if error.kind() == ErrorKind::AlreadyExists => Ok(is_under(path, &self.file)),
            Err(error) => Err(IoError::creating(path, error)),
        }
    }

    /// Puts the lock in the place of `found`, unless another one took that place before; says whether it did.
    fn replace(&self, path: &Path, found: &Found) -> Result<bool, IoError> {
        // Where the system knows no locks, the last of several takers wins and the others see that theirs is lost.
        if let Err(TryLockError::WouldBlock) = found.file.try_lock() {
            return Ok(false);
        }
        if !is_under(path, &found.file) {
            return Ok(false);
        }
        fs::rename(&self.path, path).map_err(|e| IoError::creating(path, e))?;
        Ok(true)
    }

    /// Starts the heartbeats of a lock that is in place.
    fn keep(self, path: PathBuf, former: Option<Holder>, every: Duration) -> Result<RunLock, IoError> {
        let (stop, stopped) = mpsc::channel::<()>();
        let lost = Arc::new(AtomicBool::new(false));
        let (file, owner, length) = (Arc::clone(&self.file), self.owner.clone(), self.length);
        let (place, noticed) = (path.clone(), Arc::clone(&lost));
        let heart = move || {
            while stopped.recv_timeout(every) == Err(RecvTimeoutError::Timeout) {
                if !is_under(&place, &file) {
                    noticed.store(true, Ordering::Release);
                    return;
                }
                // A heartbeat that does not reach the disk is missing; there will be others.
                let _ = beat(&file, &owner, length, SystemTime::now());
            }
        };
        let file = Arc::clone(&self.file);
        let thread = std::thread::Builder::new().name("heartbeat".to_owned()).spawn(heart);
        let mut lock = RunLock { path, file, former, lost, heart: None };
        match thread {
            Ok(thread) => lock.heart = Some((stop, thread)),
            Err(error) => return Err(IoError::creating(&lock.path, error)),
        }
        Ok(lock)
    }
}

impl Drop for Draft {
    fn drop(&mut self) {
        // Once it has replaced a lock, it has no name of its own any more.
        let _ = fs::remove_file(&self.path);
    }
}

fn content(owner: &Owner, now: SystemTime) -> String {
    let heartbeat = now.duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default().as_secs();
    let record = Record { owner: owner.clone(), heartbeat };
    // Texts and numbers can always be written.
    serde_json::to_string(&record).unwrap_or_default()
}

/// Writes owner and time over the file, in one piece and always of the same length.
fn beat(mut file: &File, owner: &Owner, length: usize, now: SystemTime) -> std::io::Result<()> {
    let text = format!("{:<length$}\n", content(owner, now));
    file.seek(SeekFrom::Start(0))?;
    file.write_all(text.as_bytes())
}

/// Whether the file under a name is this one. Trouble with the disk is no proof that it is not.
fn is_under(path: &Path, file: &File) -> bool {
    // Opened, and not only looked at: file servers check on opening whether what they remember still holds.
    let there = match File::open(path) {
        Err(error) if error.kind() == ErrorKind::NotFound => return false,
        opened => opened.and_then(|file| FileIdentity::of(&file)),
    };
    match (there, FileIdentity::of(file)) {
        (Ok(there), Ok(own)) => there == own,
        _ => true,
    }
}

#[cfg(test)]
mod tests;
