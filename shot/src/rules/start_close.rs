//! Garments that start closer to a body than its thickness, and are pushed out.

use std::collections::{BTreeMap, BTreeSet};

use drapery_core::Vec3;
use drapery_core::effects::body_collision;
use drapery_core::scene::{ContactEntry, ContactMatrix, ContactSide, PinTarget};

use super::solid::{Solid, solids};
use super::{Facts, Finding, rounded_down};

/// Distances from so much of the thickness on are far enough.
const FAR_ENOUGH: f64 = 0.9;

/// Number of free vertices of which one may be closer without a warning: folds and seams of a garment often are.
const FEW: usize = 20;

/// Push that nobody sees [m].
const UNSEEN: f64 = 0.001;

/// Distance that vertices of a garment keep from a body.
struct KeptDistance {
    /// Thickness of the body for the garment [m]; `None` where the two ignore each other.
    whole: Option<Thickness>,
    /// The same for vertices of parts.
    of_parts: BTreeMap<u32, Option<Thickness>>,
}

/// A thickness [m], and whether a `[[contact]]` sets it.
#[derive(Debug, Clone, Copy)]
struct Thickness {
    length: f64,
    is_by_rule: bool,
}

impl KeptDistance {
    fn new(facts: &Facts<'_>, rules: Option<&ContactMatrix>, (garment, body): (usize, usize)) -> Self {
        let written = Thickness { length: facts.scene.bodies[body].thickness, is_by_rule: false };
        let by_rule = |length| Thickness { length, is_by_rule: true };
        let of = |side| {
            let entry = rules.map(|rules| *rules.of_sides(facts.scene, [side, ContactSide::Body(body)]));
            let ContactEntry { is_ignored, thickness, .. } = entry.unwrap_or_default();
            (!is_ignored).then(|| thickness.map_or(written, by_rule))
        };
        let mut of_parts = BTreeMap::new();
        for (part, vertices) in facts.scene.garments[garment].parts.values().enumerate() {
            let kept = of(ContactSide::Part(garment, part));
            of_parts.extend(vertices.iter().map(|vertex| (*vertex, kept)));
        }
        Self { whole: of(ContactSide::Garment(garment)), of_parts }
    }

    /// Thickness for a vertex; `None` where it ignores the body.
    fn of(&self, vertex: u32) -> Option<Thickness> {
        self.of_parts.get(&vertex).copied().unwrap_or(self.whole)
    }

    fn largest(&self) -> f64 {
        let all = self.of_parts.values().chain([&self.whole]).flatten();
        all.fold(0.0, |largest, thickness| largest.max(thickness.length))
    }
}

pub(super) fn find(facts: &Facts<'_>) -> Vec<Finding> {
    if facts.request(body_collision::SPEC.name).is_none() {
        return Vec::new();
    }
    // Files that cannot be read are reported elsewhere.
    let Ok(input) = facts.inputs.at(facts.inputs.timeline.start) else { return Vec::new() };
    let (solids, rules) = (solids(facts, &input), ContactMatrix::of(facts.scene));
    let garments =
        (0..facts.scene.garments.len()).filter_map(|garment| Some((garment, free_vertices(facts, garment)?)));
    garments
        .flat_map(|(garment, free)| {
            solids
                .iter()
                .filter_map(|solid| of_pair((facts, rules.as_ref()), garment, &free, solid))
                .collect::<Vec<_>>()
        })
        .collect()
}

/// Vertices of a garment that no pin holds, with their places at the start [m].
fn free_vertices(facts: &Facts<'_>, garment: usize) -> Option<Vec<(u32, Vec3)>> {
    let pins = facts.scene.pins.iter().filter(|pin| pin.garment == garment);
    let held: BTreeSet<u32> = pins.flat_map(|pin| held_by(&pin.target)).collect();
    let places = facts.start_of(garment)?;
    Some((0..).zip(places).filter(|(vertex, _)| !held.contains(vertex)).collect())
}

fn held_by(target: &PinTarget) -> Vec<u32> {
    match target {
        PinTarget::Path { vertices, .. }
        | PinTarget::Track { vertices, .. }
        | PinTarget::BodyNearest { vertices, .. } => vertices.clone(),
        PinTarget::Body { attachments, .. } => attachments.iter().map(|attachment| attachment.vertex).collect(),
    }
}

fn of_pair(
    (facts, rules): (&Facts<'_>, Option<&ContactMatrix>),
    garment: usize,
    free: &[(u32, Vec3)],
    (number, solid): &(usize, Solid<'_>),
) -> Option<Finding> {
    let body = &facts.scene.bodies[*number];
    let kept = KeptDistance::new(facts, rules, (garment, *number));
    let (vertices, places) = solid.near(free, FAR_ENOUGH * kept.largest());
    // A tree over a mesh costs more than all else here.
    if kept.largest() == 0.0 || places.len() * FEW <= free.len() {
        return None;
    }
    let near = vertices.into_iter().zip(solid.distances(&places));
    let pushed = near.filter_map(|(vertex, distance)| Some((vertex, distance, kept.of(vertex)?)));
    let close: Vec<(u32, f64, Thickness)> =
        pushed.filter(|(_, distance, thickness)| *distance < FAR_ENOUGH * thickness.length).collect();
    let push = |(_, distance, thickness): &(u32, f64, Thickness)| thickness.length - distance;
    let farthest = close.iter().reduce(|most, other| if push(other) > push(most) { other } else { most })?;
    let (vertex, closest, Thickness { length: thickness, is_by_rule }) = *farthest;
    if close.len() * FEW <= free.len() || thickness - closest < UNSEEN {
        return None;
    }
    let found = facts.body_thickness.get(*number).copied().flatten();
    let because = match (is_by_rule, found) {
        (true, _) => ", which its `[[contact]]` sets",
        (false, Some(found)) if !found.is_written && found.needed == thickness => {
            ", chosen automatically for the size of the faces of body and garments"
        }
        (false, Some(found)) if !found.is_written => ", the largest of the garments' materials",
        (false, Some(_)) => ", which the scene sets",
        (false, None) => "",
    };
    let coarse = if found.is_some() {
        ", which the rule `thin_body` tells: finer faces need less"
    } else {
        ": finer faces need less"
    };
    let [close_enough, thickness_mm] = [closest, thickness].map(|length| length * 1e3);
    let mut line = format!("thickness = \"{} mm\"", rounded_down(close_enough.max(0.01), 1));
    // With less than the faces need, `thin_body` would ask for the thickness back.
    if found.is_some_and(|found| closest < found.needed) {
        line += " with silence = [\"thin_body\"] in [check], or keep it with silence = [\"start_close\"]";
    }
    Some(Finding {
        object: format!("garment \"{}\", vertex {vertex}", facts.scene.garments[garment].name),
        message: format!(
            "{} of its {} free vertices start closer to body \"{}\" than its thickness of {thickness_mm:.2} mm{because}; this one is \
             closest, at {close_enough:.2} mm. Contact pushes them out, which strains the garment in the first frames: model it at least \
             {thickness_mm:.2} mm off the body, or lower the thickness. Less thickness may let the body show through coarse cloth{coarse}",
            close.len(),
            free.len(),
            body.name
        ),
        line,
    })
}
