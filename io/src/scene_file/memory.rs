//! How much memory a scene will take, by its numbers of points and its effects, before any of it is taken.
//!
//! What is expected is the peak of `drapery check` on one thread, measured with panels of 40,000 and 250,000 points for each
//! effect by itself (`/usr/bin/time -v`); meshes of triangles have about two triangles and three edges for each point.

use drapery_core::effects::{REGISTRY, body_collision};
use drapery_core::scene::EffectRequest;

use crate::memory::available;

use super::tree::{Path, Segment};
use super::{SceneFile, effects, raw};

/// Of a point without effects: its mesh while it is cut up, its place among the ranks, the state [bytes].
const OF_POINT: f64 = 460.0;

/// What the garments so far are expected to take, and what there is.
#[derive(Debug)]
pub(super) struct Memory {
    /// Ranks that share the garments.
    ranks: usize,
    needed: f64,
    available: Option<u64>,
}

impl Memory {
    /// Nothing is needed yet.
    pub(super) fn new(ranks: usize) -> Self {
        Self { ranks: ranks.max(1), needed: 0.0, available: available() }
    }
}

/// Why a garment has no room.
#[derive(Debug)]
pub(super) struct NoRoom {
    /// What is wrong.
    pub(super) what: String,
    /// What to do.
    pub(super) advice: String,
}

impl Memory {
    /// Takes note of a garment of so many points, each of which takes so much [bytes].
    ///
    /// # Errors
    /// There is not enough for it and the garments before.
    pub(super) fn take(&mut self, points: f64, of_point: f64) -> Result<(), NoRoom> {
        self.needed += points * of_point / self.ranks as f64;
        let Self { ranks, needed, available } = *self;
        let Some(available) = available.map(|bytes| bytes as f64).filter(|available| needed > *available) else {
            return Ok(());
        };
        let (needed, available) = (gibibytes(needed), gibibytes(available));
        let rank = if ranks > 1 { format!(" on each of {ranks} ranks") } else { String::new() };
        Err(NoRoom {
            what: format!(
                "about {points:.0} points are too many here: they need about {needed}{rank}, {available} are free"
            ),
            advice: "lower the resolution, do with fewer effects, or use more ranks on more machines".to_owned(),
        })
    }
}

/// Expected of a point of the garment that a path leads into [bytes].
pub(super) fn bytes_of_point(scene: &SceneFile, path: &Path) -> f64 {
    let document = &scene.document;
    let raw::EffectChoice { without, only } = &document.effects;
    let runs =
        |name: &str| !without.iter().any(|out| out == name) && (only.is_empty() || only.iter().any(|one| one == name));
    let garment = path.0.iter().find_map(|segment| match segment {
        Segment::Index(index) => Some(*index),
        Segment::Key(_) => None,
    });
    let requests = effects::requests(&scene.root);
    let is_asked = |name: &str| {
        let of_it = |request: &EffectRequest| {
            request.effect == name && (request.garment.is_none() || request.garment == garment)
        };
        (name == body_collision::SPEC.name && !document.body.is_empty()) || requests.iter().any(of_it)
    };
    let taken = REGISTRY.iter().filter(|spec| runs(spec.name) && is_asked(spec.name));
    OF_POINT + taken.map(|spec| spec.bytes_of_point).sum::<f64>()
}

fn gibibytes(bytes: f64) -> String {
    format!("{:.1} GiB", bytes / f64::from(1 << 30))
}
