//! Continuation of each cache of a run from a checkpoint: anew, behind its mark, or in another form.

use std::path::{Path, PathBuf};

use drapery_io::cache::{CacheMark, CachePlan, CacheWriter};
use drapery_io::checkpoint::Head;
use drapery_io::error::IoError;
use drapery_io::formats::{CheckCache, CreateCache, ResumeCache, holds_whole_frames};

use crate::frame_digest::GarmentDigests;
use crate::run::folder::file_name;
use crate::run::rewritten::NewForm;

/// A cache to be: file, and how it is made.
pub(super) struct Planned {
    /// The garment, or behind all garments the render mesh.
    pub(super) object: usize,
    /// The file.
    pub(super) path: PathBuf,
    /// Function that creates it.
    pub(super) create: CreateCache,
    /// Function that goes on with it.
    pub(super) resume: ResumeCache,
    /// Function that tells whether it can go on.
    pub(super) check: CheckCache,
}

/// The caches that a checkpoint tells of.
pub(super) struct Continued<'a> {
    folder: &'a Path,
    marks: Vec<CacheMark>,
    /// Last frame that is delivered.
    delivered: Option<i64>,
    /// Whether they have another form than is asked for now.
    other_form: bool,
}

/// Continuation of one cache.
enum Continuation<'a> {
    New,
    Behind(&'a CacheMark),
    /// From a cache that holds its frames, up to a frame and a number of samples behind it.
    NewForm(PathBuf, (i64, usize)),
}

impl<'a> Continued<'a> {
    /// The caches in `folder` that the head of a checkpoint lists.
    pub(super) fn of(head: &Head, folder: &'a Path, other_form: bool) -> Self {
        let marks = head.caches.iter().filter_map(|mark| serde_json::from_value(mark.clone()).ok()).collect();
        Self { folder, marks, delivered: head.delivered, other_form }
    }

    fn continuation(&self, cache: &Planned) -> Continuation<'_> {
        let own = self.marks.iter().find(|mark| mark.file == file_name(&cache.path));
        let Some(last) = self.delivered else { return Continuation::New };
        let stem = cache.path.file_stem();
        let of_object = || self.marks.iter().filter(|mark| Path::new(&mark.file).file_stem() == stem);
        // What cannot be asked for is not lost.
        let is_there = |mark: &&CacheMark| self.folder.join(&mark.file).try_exists().unwrap_or(true);
        // One that has the samples between frames too before others.
        let has_all = |mark: &&CacheMark| !holds_whole_frames(Path::new(&mark.file));
        let other = of_object().filter(is_there).rfind(has_all).or(of_object().rfind(is_there));
        match own {
            // A file that is gone, and no other that holds its frames: the format says so.
            Some(mark) if !self.other_form && (is_there(&mark) || other.is_none()) => Continuation::Behind(mark),
            own => {
                // Its own file first: a cache of another format may have been left out for a while.
                let source = own.filter(is_there).or(other).map(|mark| self.folder.join(&mark.file));
                let last = (last, of_object().map(|mark| mark.sub_frame).max().unwrap_or(0));
                Continuation::NewForm(source.unwrap_or_else(|| cache.path.clone()), last)
            }
        }
    }

    /// Finds out whether a cache can go on; changes nothing. Returns a note if it is gone and written again from another one.
    pub(super) fn check(&self, cache: &Planned, plan: CachePlan<'_>) -> Result<Option<String>, IoError> {
        match self.continuation(cache) {
            Continuation::New => Ok(None),
            Continuation::Behind(mark) => (cache.check)(&cache.path, &plan, mark).map(|()| None),
            Continuation::NewForm(source, last) => {
                new_form(cache, plan).check(&source, last)?;
                let is_lost = !self.other_form && self.marks.iter().any(|mark| mark.file == file_name(&cache.path));
                let (lost, source) = (file_name(&cache.path), file_name(&source));
                Ok(is_lost.then(|| format!("{lost} is missing; its frames are written again from {source}")))
            }
        }
    }

    /// Opens a cache to go on; `take` is given the frames that are written anew for that, with the digests of what was written.
    pub(super) fn open(
        &self,
        cache: &Planned,
        plan: CachePlan<'_>,
        take: &mut dyn FnMut(i64, GarmentDigests),
    ) -> Result<Box<dyn CacheWriter>, IoError> {
        match self.continuation(cache) {
            Continuation::New => (cache.create)(&cache.path, &plan),
            Continuation::Behind(mark) => (cache.resume)(&cache.path, &plan, mark),
            Continuation::NewForm(source, last) => new_form(cache, plan).write(&source, last, take),
        }
    }
}

fn new_form<'a>(cache: &'a Planned, plan: CachePlan<'a>) -> NewForm<'a> {
    NewForm { path: &cache.path, plan, open: (cache.create, cache.resume) }
}
