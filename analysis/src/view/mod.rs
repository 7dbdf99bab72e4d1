//! The cloth of a run in three dimensions, for `drapery view`: a page, and the answers to what it asks for, one array at a time, so
//! that neither the program nor the page holds more of a run than it shows. [`write_page`] writes a page that holds frames itself.
//!
//! Files of the run are only read. They may change at any time: a run continues, starts over, or is deleted.

mod arrays;
mod contact;
mod opened;
mod page;
mod rest;

use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::SystemTime;

use drapery_io::error::IoError;
use drapery_shot::fault::{Fault, FaultKind};
use drapery_shot::run_record::folder::RunFolder;
use serde::Serialize;

use crate::report::status::Status;
use arrays::Precision;
use opened::{About, Opened};

pub use page::{LARGEST_PAGE, Written, has_library, page, write_page};

/// Why something cannot be shown.
#[derive(Debug, thiserror::Error)]
pub enum ViewError {
    /// The run cannot be read.
    #[error(transparent)]
    Run(#[from] IoError),
    /// The page asks for something that a run has not, such as an object of an earlier attempt.
    #[error("the run has nothing of this name")]
    Unknown,
    /// The program was built without the library of the page.
    #[error(
        "this build of drapery has no library for WebGL, which the page needs\n  \
         help: in the sources run analysis/viewer/library/build.sh (it needs npm), and build again; packages of drapery have it"
    )]
    NoLibrary,
    /// Nothing to write yet.
    #[error("{}: the run has written no frames yet\n  help: run the command again when `drapery status` counts some", .0.display())]
    NoFrames(PathBuf),
    /// A page with a single frame is too large.
    #[error(
        "a page with one frame of this run would take {} MB, more than the {} MB of a page\n  \
         help: look at the run itself: drapery view, without --page", .0 / 1_000_000, LARGEST_PAGE / 1_000_000
    )]
    TooLarge(usize),
}

impl From<ViewError> for Fault {
    fn from(error: ViewError) -> Self {
        let kind = match error {
            ViewError::Run(error) => return error.into(),
            ViewError::Unknown => FaultKind::Internal,
            ViewError::NoLibrary | ViewError::TooLarge(_) => FaultKind::Usage,
            ViewError::NoFrames(_) => FaultKind::MissingInput,
        };
        Self::new(kind, error.to_string())
    }
}

/// Quantities of an object at a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Field {
    /// Positions [m].
    Points,
    /// Largest strain of the edges at a vertex.
    Strain,
    /// Thickness [m].
    Thickness,
    /// Distance from the nearest other cloth or body by the thickness between them.
    Contact,
}

impl Field {
    const NAMES: [(&'static str, Self); 4] = [
        ("points", Self::Points),
        ("strain", Self::Strain),
        ("thickness", Self::Thickness),
        ("contact", Self::Contact),
    ];
}

/// State of a run, for the page.
#[derive(Debug, Serialize)]
struct RunState {
    #[serde(flatten)]
    status: Status,
    /// Another attempt has another one: what was loaded before may have changed.
    attempt: String,
    /// Why the last attempt ended, if it has.
    reason: Option<String>,
    /// Frames a second.
    fps: f64,
    /// Frames that can be shown.
    frames: Vec<i64>,
    /// Frames that the run has, if fewer are in the page.
    #[serde(skip_serializing_if = "Option::is_none")]
    frames_of_run: Option<usize>,
    objects: Vec<About>,
    notices: Vec<String>,
    /// Largest share of contact that is looked for.
    reach: f64,
}

/// An answer to the page.
#[derive(Debug)]
pub struct Answer {
    /// Its type, in the words of HTTP.
    pub kind: &'static str,
    /// Its bytes.
    pub bytes: Vec<u8>,
}

/// A run that is being looked at.
pub struct Viewer {
    folder: PathBuf,
    opened: Mutex<Option<Opened>>,
}

impl Viewer {
    /// Looks at the run of a folder.
    ///
    /// # Errors
    /// The folder holds no run, or its manifest cannot be understood.
    pub fn new(folder: &Path) -> Result<Self, ViewError> {
        RunFolder::read(folder)?;
        Ok(Self { folder: folder.to_owned(), opened: Mutex::new(None) })
    }

    /// Answers to a path that the page asks for, without a slash in front: `run.json`, `object/0/triangles` or
    /// `object/0/frame/1001/points`.
    ///
    /// # Errors
    /// The run cannot be read (any more), or has nothing of this name.
    pub fn answer(&self, path: &str) -> Result<Answer, ViewError> {
        self.answer_in(path, Precision::Full)
    }

    fn answer_in(&self, path: &str, precision: Precision) -> Result<Answer, ViewError> {
        let binary = |bytes| Answer { kind: "application/octet-stream", bytes };
        let parts: Vec<&str> = path.split('/').collect();
        match parts[..] {
            ["run.json"] => {
                // A struct of texts and numbers always has a JSON form.
                let bytes = serde_json::to_vec(&self.state()?).unwrap_or_default();
                Ok(Answer { kind: "application/json", bytes })
            }
            ["object", object, "triangles"] => {
                let object = object.parse().map_err(|_| ViewError::Unknown)?;
                self.with(|opened| opened.triangles(object)).map(binary)
            }
            ["object", object, "frame", frame, field] => {
                let object = object.parse().map_err(|_| ViewError::Unknown)?;
                let frame = frame.parse().map_err(|_| ViewError::Unknown)?;
                let known = Field::NAMES.iter().find(|(name, _)| *name == field);
                let (_, field) = known.ok_or(ViewError::Unknown)?;
                self.with(|opened| opened.field(object, frame, *field, precision)).map(binary)
            }
            _ => Err(ViewError::Unknown),
        }
    }

    /// Does something with the run as it is now.
    fn with<T>(&self, act: impl FnOnce(&mut Opened) -> Result<T, ViewError>) -> Result<T, ViewError> {
        // A thread that panicked has left nothing half done: a run is replaced as a whole.
        let mut opened = self.opened.lock().unwrap_or_else(PoisonError::into_inner);
        let known = opened.take();
        let now = match known {
            Some(known) if known.is_current() => known,
            known => Opened::new(&self.folder, known)?,
        };
        act(opened.insert(now))
    }

    fn state(&self) -> Result<RunState, ViewError> {
        let status = Status::of(&self.folder, SystemTime::now())?;
        self.with(|opened| {
            let objects = (0..opened.objects()).map(|object| opened.about(object));
            Ok(RunState {
                attempt: opened.attempt(),
                reason: opened.folder.manifest.attempts.last().and_then(|attempt| attempt.end.clone()),
                status,
                fps: rate(&opened.folder.manifest.fps),
                frames: opened.frames.clone(),
                frames_of_run: None,
                objects: objects.collect(),
                notices: opened.notices.clone(),
                reach: contact::REACH,
            })
        })
    }
}

/// Frames a second of a fraction such as `24000/1001`; 24 where there is none.
fn rate(fps: &str) -> f64 {
    let (above, below) = fps.split_once('/').unwrap_or((fps, "1"));
    let rate = above.parse::<f64>().ok().zip(below.parse::<f64>().ok()).map(|(above, below)| above / below);
    rate.filter(|rate| rate.is_finite() && *rate > 0.0).unwrap_or(24.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rates_are_fractions() {
        assert_eq!([rate("24/1"), rate("30"), rate(""), rate("1/0"), rate("-3")], [24.0, 30.0, 24.0, 24.0, 24.0]);
        assert!((rate("24000/1001") - 23.976).abs() < 1e-3);
    }
}
