//! The cloth after lines of the solver's listings, as HDF5: the output of `--dump B.4@1005.3`, for a search for the line in
//! which cloth goes wrong (`docs/reference/dump.md`).

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use drapery_core::observe::{Observation, Tracepoint};
use drapery_io::dump_file;
use drapery_io::error::IoError;

use crate::error::ShotError;
use crate::run::observer::Observer;
use crate::run::options::RunOptions;
use crate::run::totals::Totals;
use crate::shot::Shot;

/// Folder inside that of a run, or beside a bundle.
pub const FOLDER: &str = "dump";

/// Writes what is observed, a file each.
#[derive(Debug, Clone)]
pub(super) struct Dump {
    folder: PathBuf,
    tracepoints: Vec<Tracepoint>,
    written: Arc<Mutex<Written>>,
}

#[derive(Debug, Default)]
struct Written {
    files: u64,
    /// The first that could not be written.
    error: Option<IoError>,
}

impl Dump {
    /// Writes what the simulation of a shot comes to from now on into a folder; `steps` were made since its last frame.
    ///
    /// # Errors
    /// The folder cannot be made.
    pub(super) fn start(
        shot: &mut Shot,
        tracepoints: &[Tracepoint],
        folder: &Path,
        steps: u64,
    ) -> Result<Option<Self>, IoError> {
        if tracepoints.is_empty() {
            return Ok(None);
        }
        fs::create_dir_all(folder).map_err(|e| IoError::creating(folder, e))?;
        let dump = Self { folder: folder.to_owned(), tracepoints: tracepoints.to_vec(), written: Arc::default() };
        let names = dump_file::Names { shot: shot.about.name.clone(), garments: shot.about.garments.clone() };
        let sink = dump.clone();
        let sink = Box::new(move |observation| sink.write(&names, &observation));
        shot.remote_simulation.observe(tracepoints, steps, sink);
        Ok(Some(dump))
    }

    /// The same of what a run asks for, into its folder.
    ///
    /// # Errors
    /// The folder cannot be made.
    pub(super) fn of_run(shot: &mut Shot, options: &RunOptions, totals: &Totals) -> Result<Option<Self>, IoError> {
        let steps = totals.partial.summary.as_ref().map_or(0, |summary| summary.steps);
        Self::start(shot, &options.dump, &options.out.join(FOLDER), steps)
    }

    /// Whether all could be written so far.
    ///
    /// # Errors
    /// The first that could not.
    pub(super) fn check(&self) -> Result<(), IoError> {
        self.written().error.take().map_or(Ok(()), Err)
    }

    /// Says what was written; nothing is worth a warning.
    pub(super) fn report(&self, observer: &mut dyn Observer) {
        // In a scrutinee the lock would be held while the arms take it.
        let files = self.written().files;
        match files {
            0 => observer.note(self.in_words()),
            _ => observer.dumped(self.in_words()),
        }
    }

    /// Describes the written files in a sentence.
    pub(super) fn in_words(&self) -> String {
        let points: Vec<String> = self.tracepoints.iter().map(Tracepoint::to_string).collect();
        let (files, points, folder) = (self.written().files, points.join(", "), self.folder.display());
        match files {
            0 => format!("--dump {points}: reached by no step; nothing was written into {folder}"),
            1 => format!("--dump {points}: 1 file in {folder}"),
            _ => format!("--dump {points}: {files} files in {folder}"),
        }
    }

    fn written(&self) -> std::sync::MutexGuard<'_, Written> {
        // Counts and an error are whole at every moment.
        self.written.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn write(&self, names: &dump_file::Names, observation: &Observation) {
        let mut written = self.written();
        if written.error.is_some() {
            return;
        }
        let Observation { line, frame, step, .. } = observation;
        let path = self.folder.join(format!("frame_{frame:05}.step_{step:06}.{line}.h5"));
        match dump_file::write(&path, names, observation) {
            Ok(()) => written.files += 1,
            Err(error) => written.error = Some(error),
        }
    }
}

/// Says which tracepoints are on the way to frames that are done up to this one: no step to them is made again.
pub(super) fn passed_over(tracepoints: &[Tracepoint], done: i64) -> Option<String> {
    let is_passed = |point: &&Tracepoint| point.frame.is_some_and(|frame| frame <= done);
    let passed: Vec<String> = tracepoints.iter().filter(is_passed).map(Tracepoint::to_string).collect();
    (!passed.is_empty()).then(|| not_made_again(&passed.join(", "), done))
}

/// The same of all tracepoints of a run of which all frames are done.
pub(super) fn nothing_left(tracepoints: &[Tracepoint], last: i64) -> Option<String> {
    let points: Vec<String> = tracepoints.iter().map(Tracepoint::to_string).collect();
    (!points.is_empty()).then(|| not_made_again(&points.join(", "), last))
}

fn not_made_again(points: &str, done: i64) -> String {
    format!(
        "--dump {points}: nothing is written, because frames up to {done} are done and are not simulated again\n  \
         help: resume from an earlier checkpoint with --resume FRAME, simulate into another folder with --out, or \
         start over with --overwrite"
    )
}

/// Refuses tracepoints to which no step leads that ends between these frames.
///
/// # Errors
/// The first such.
pub(super) fn refuse_unreachable(tracepoints: &[Tracepoint], [first, last]: [i64; 2]) -> Result<(), ShotError> {
    let outside = |point: &&Tracepoint| point.frame.is_some_and(|frame| !(first..=last).contains(&frame));
    tracepoints.iter().find(outside).map_or(Ok(()), |point| {
        Err(ShotError::Frames(format!(
            "--dump {point}: no step of this run leads to that frame\n  help: steps lead to the frames {first}-{last}"
        )))
    })
}
