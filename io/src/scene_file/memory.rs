//! How much memory a scene will take, by its numbers of points and its effects, before any of it is taken.
//!
//! What is expected is the peak of `drapery check` on one thread, measured with panels of 40,000 and 250,000 points for each
//! effect by itself (`/usr/bin/time -v`); meshes of triangles have about two triangles and three edges for each point.

use drapery_core::effects::{REGISTRY, body_collision};
use drapery_core::scene::EffectRequest;

use crate::memory::available;

use super::resolve::Resolver;
use super::tree::{Path, Segment};
use super::{effects, raw};

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

impl Resolver<'_> {
    /// Takes note of a garment of so many points; refuses it, as a lack of memory, where they have no room. Called before its
    /// points are anywhere.
    pub(super) fn has_room(&mut self, path: &Path, points: f64) -> Option<()> {
        let of_point = self.bytes_of_point(path);
        self.memory.needed += points * of_point / self.memory.ranks as f64;
        let Memory { ranks, needed, available } = self.memory;
        let Some(available) = available.map(|bytes| bytes as f64).filter(|available| needed > *available) else {
            return Some(());
        };
        let (needed, available) = (gibibytes(needed), gibibytes(available));
        let rank = if ranks > 1 { format!(" on each of {ranks} ranks") } else { String::new() };
        self.memory_error(
            path,
            format!("about {points:.0} points are too many here: they need about {needed}{rank}, {available} are free"),
            "lower the resolution, do with fewer effects, or use more ranks on more machines".to_owned(),
        );
        None
    }

    /// Expected of a point of the garment that a path leads into [bytes].
    fn bytes_of_point(&self, path: &Path) -> f64 {
        let document = &self.scene.document;
        let raw::EffectChoice { without, only } = &document.effects;
        let runs = |name: &str| {
            !without.iter().any(|out| out == name) && (only.is_empty() || only.iter().any(|one| one == name))
        };
        let garment = path.0.iter().find_map(|segment| match segment {
            Segment::Index(index) => Some(*index),
            Segment::Key(_) => None,
        });
        let requests = effects::requests(&self.scene.root);
        let is_asked = |name: &str| {
            let of_it = |request: &EffectRequest| {
                request.effect == name && (request.garment.is_none() || request.garment == garment)
            };
            (name == body_collision::SPEC.name && !document.body.is_empty()) || requests.iter().any(of_it)
        };
        let taken = REGISTRY.iter().filter(|spec| runs(spec.name) && is_asked(spec.name));
        OF_POINT + taken.map(|spec| spec.bytes_of_point).sum::<f64>()
    }
}

fn gibibytes(bytes: f64) -> String {
    format!("{:.1} GiB", bytes / f64::from(1 << 30))
}
