//! Memory that a scene will take, by its numbers of points and its effects, estimated before any of it is taken.
//!
//! The estimate is the peak of `drapery check` on one thread, measured with panels of 40,000 and 250,000 points for
//! each effect by itself (`/usr/bin/time -v`); meshes of triangles have about two triangles and three edges for each
//! point.

use drapery_core::effects::{REGISTRY, body_collision};
use drapery_core::scene::EffectRequest;

use crate::memory::available;

use super::tree::{Path, Segment};
use super::{SceneFile, effects, raw};

/// Memory of a point without effects: its mesh while it is cut up, its place among the ranks, the state [bytes].
const OF_POINT: f64 = 460.0;

/// Memory that the garments so far are expected to take, and memory that is available.
#[derive(Debug)]
pub(super) struct Memory {
    /// Ranks that share the garments.
    ranks: usize,
    /// Memory of a point of each garment of the scene file, with the effects that it has [bytes].
    of_point: Vec<f64>,
    needed: f64,
    available: Option<u64>,
}

impl Memory {
    /// Nothing is needed yet.
    pub(super) fn new(scene: &SceneFile, ranks: usize) -> Self {
        let of_point = bytes_of_points(scene, &effects::requests(&scene.root));
        Self { ranks: ranks.max(1), of_point, needed: 0.0, available: available() }
    }

    /// Expected of a point of the garment that a path leads into [bytes].
    pub(super) fn of_point(&self, path: &Path) -> f64 {
        let garment = path.0.iter().find_map(|segment| match segment {
            Segment::Index(index) => Some(*index),
            Segment::Key(_) => None,
        });
        garment.and_then(|garment| self.of_point.get(garment)).copied().unwrap_or(OF_POINT)
    }
}

/// Why a garment has no room.
#[derive(Debug)]
pub(super) struct NoRoom {
    /// Fault, in words.
    pub(super) what: String,
    /// Remedy.
    pub(super) advice: String,
}

impl Memory {
    /// Takes note of a garment by its points and the memory of each [bytes].
    ///
    /// # Errors
    /// There is not enough for it and the garments before.
    pub(super) fn take(&mut self, points: f64, of_point: f64) -> Result<(), NoRoom> {
        self.needed += points * of_point / self.ranks as f64;
        let Self { ranks, needed, available, .. } = *self;
        let Some(available) = available.map(|bytes| bytes as f64).filter(|available| needed > *available) else {
            return Ok(());
        };
        let (needed, available) = (gibibytes(needed), gibibytes(available));
        let rank = if ranks > 1 { format!(" on each of {ranks} ranks") } else { String::new() };
        Err(NoRoom {
            what: format!(
                "not enough memory: about {points:.0} points need about {needed}{rank}, {available} are free"
            ),
            advice: "lower the resolution, use fewer effects, or use more ranks on more machines".to_owned(),
        })
    }
}

/// Expected of a point of each garment [bytes]; every effect that is asked for is looked at once, however many garments there are.
fn bytes_of_points(scene: &SceneFile, requests: &[EffectRequest]) -> Vec<f64> {
    let document = &scene.document;
    let raw::EffectChoice { without, only } = &document.effects;
    let runs =
        |name: &str| !without.iter().any(|out| out == name) && (only.is_empty() || only.iter().any(|one| one == name));
    let bytes = |name: &str| {
        let spec = REGISTRY.iter().find(|spec| spec.name == name && runs(name));
        spec.map_or(0.0, |spec| spec.cost.bytes_of_point)
    };
    let of_bodies = if document.body.is_empty() { 0.0 } else { bytes(body_collision::SPEC.name) };
    let of_all = requests.iter().filter(|request| request.garment.is_none()).map(|request| bytes(&request.effect));
    let mut of_point = vec![OF_POINT + of_bodies + of_all.sum::<f64>(); document.garment.len()];
    for request in requests {
        if let Some(of_garment) = request.garment.and_then(|garment| of_point.get_mut(garment)) {
            *of_garment += bytes(&request.effect);
        }
    }
    of_point
}

fn gibibytes(bytes: f64) -> String {
    format!("{:.1} GiB", bytes / f64::from(1 << 30))
}
