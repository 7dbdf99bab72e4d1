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
        match (own, self.delivered) {
            (_, None) => Continuation::New,
            (Some(mark), Some(_)) if !self.other_form => Continuation::Behind(mark),
            (own, Some(last)) => {
                // Its own file first: a cache of another format may have been left out for a while.
                let stem = cache.path.file_stem();
                let others = || self.marks.iter().filter(|mark| Path::new(&mark.file).file_stem() == stem);
                // Then one that has the samples between frames too.
                let has_all = |mark: &&CacheMark| !holds_whole_frames(Path::new(&mark.file));
                let other = others().rfind(has_all).or(others().next_back());
                let source = own.or(other).map(|mark| self.folder.join(&mark.file));
                let last = (last, others().map(|mark| mark.sub_frame).max().unwrap_or(0));
                Continuation::NewForm(source.unwrap_or_else(|| cache.path.clone()), last)
            }
        }
    }

    /// Finds out whether a cache can go on; changes nothing.
    pub(super) fn check(&self, cache: &Planned, plan: CachePlan<'_>) -> Result<(), IoError> {
        match self.continuation(cache) {
            Continuation::New => Ok(()),
            Continuation::Behind(mark) => (cache.check)(&cache.path, &plan, mark),
            Continuation::NewForm(source, last) => new_form(cache, plan).check(&source, last),
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
