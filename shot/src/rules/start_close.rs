//! Garments that start closer to a body than its thickness, and are pushed out.

use std::collections::BTreeSet;

use drapery_core::Vec3;
use drapery_core::effects::body_collision;
use drapery_core::geometry::surface_binding::SurfaceBinding;
use drapery_core::scene::{BodyShape, ContactSide, PinTarget};

use super::{Facts, Finding, bounds};

/// Distances from so much of the thickness on are far enough.
const FAR_ENOUGH: f64 = 0.9;

/// One free vertex in so many may be closer before it is said: folds and seams of a garment often are.
const FEW: usize = 20;

/// Push that nobody sees [m].
const UNSEEN: f64 = 0.001;

/// A body that is a mesh, at the start.
struct Body<'a> {
    number: usize,
    triangles: &'a [[u32; 3]],
    positions: &'a [Vec3],
}

pub(super) fn find(facts: &Facts<'_>) -> Vec<Finding> {
    if facts.request(body_collision::SPEC.name).is_none() {
        return Vec::new();
    }
    // Files that cannot be read are reported elsewhere.
    let Ok(input) = facts.inputs.at(facts.inputs.timeline.start) else { return Vec::new() };
    let bodies = facts.scene.bodies.iter().zip(&input.bodies).enumerate();
    let meshes = bodies.filter_map(|(number, (body, samples))| match (&body.shape, samples.last()) {
        (BodyShape::Surface { triangles, point_count }, Some(sample)) if sample.positions.len() == *point_count => {
            Some(Body { number, triangles, positions: &sample.positions })
        }
        _ => None,
    });
    let meshes: Vec<Body<'_>> = meshes.collect();
    if meshes.is_empty() {
        return Vec::new();
    }
    let garments =
        (0..facts.scene.garments.len()).filter_map(|garment| Some((garment, free_vertices(facts, garment)?)));
    garments
        .flat_map(|(garment, free)| {
            meshes.iter().filter_map(|body| of_pair(facts, garment, &free, body)).collect::<Vec<_>>()
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

fn of_pair(facts: &Facts<'_>, garment: usize, free: &[(u32, Vec3)], mesh: &Body<'_>) -> Option<Finding> {
    let body = &facts.scene.bodies[mesh.number];
    let rule = facts.scene.contact_rule(ContactSide::Garment(garment), ContactSide::Body(mesh.number));
    if rule.is_some_and(|rule| rule.ignore) {
        return None;
    }
    let of_rule = rule.and_then(|rule| rule.thickness);
    let thickness = of_rule.unwrap_or(body.thickness);
    let [low, high] = bounds(mesh.positions)?;
    let limit = FAR_ENOUGH * thickness;
    let is_near = |place: &Vec3| (0..3).all(|axis| (low[axis] - limit..=high[axis] + limit).contains(&place[axis]));
    let (vertices, places): (Vec<u32>, Vec<Vec3>) = free.iter().copied().filter(|(_, place)| is_near(place)).unzip();
    if places.len() * FEW <= free.len() || places.is_empty() {
        return None;
    }
    let bound = SurfaceBinding::new(mesh.positions.to_vec(), mesh.triangles.to_vec(), &places, &[])?;
    let close: Vec<(f64, u32)> = bound.distances().zip(vertices).filter(|(distance, _)| *distance < limit).collect();
    let (closest, vertex) = close.iter().copied().min_by(|a, b| a.0.total_cmp(&b.0))?;
    if close.len() * FEW <= free.len() || thickness - closest < UNSEEN {
        return None;
    }
    let found = facts.body_thickness.get(mesh.number).copied().flatten();
    let because = match (of_rule, found) {
        (Some(_), _) => "which its `[[contact]]` sets",
        (None, Some(found)) if !found.is_written && found.needed == thickness => {
            "chosen automatically for the size of the faces of body and garments"
        }
        (None, Some(found)) if !found.is_written => "the largest of the garments' materials",
        _ => "which the scene sets",
    };
    let [close_enough, thickness_mm] = [closest, thickness].map(|length| length * 1e3);
    Some(Finding {
        object: format!("garment \"{}\", vertex {vertex}", facts.scene.garments[garment].name),
        message: format!(
            "{} of its {} free vertices start closer to body \"{}\" than its thickness of {thickness_mm:.2} mm, {because}; this one is \
             closest, at {close_enough:.2} mm. Contact pushes them out, which strains the garment in the first frames: model it at least \
             {thickness_mm:.2} mm off the body, or lower the thickness. Less thickness may let the body show through coarse cloth, \
             which the rule `thin_body` tells: finer faces need less",
            close.len(),
            free.len(),
            body.name
        ),
        line: format!("thickness = \"{} mm\"", ((close_enough * 10.0).floor() / 10.0).max(0.1)),
    })
}
