//! Conditions that have to hold before a simulation starts.

use std::collections::BTreeSet;

use crate::Vec3;
use crate::contact::bodies::{Bodies, Samples};
use crate::error::{Problem, Problems};
use crate::parallel::problems::agree;
use crate::pins::HardPins;
use crate::scene::{BodyShape, ContactSide, PinTarget, Scene};
use crate::simulation::{FrameInput, StartInside};
use crate::state::State;

/// The first sample of every track.
pub(super) fn first_tracks(scene: &Scene, start: &FrameInput) -> Result<Vec<Samples>, Problems> {
    let mut problems = Vec::new();
    let mut tracks = Vec::new();
    for (number, track) in start.tracks.iter().enumerate() {
        match track.last() {
            Some(sample) => tracks.push(Samples::still(sample.clone())),
            None => problems.push(Problem::data(
                format!("track {number}"),
                "there is no sample of its positions at the start",
                "look at the file that the pin follows around the first frame",
            )),
        }
    }
    for (p, pin) in scene.description().pins.iter().enumerate() {
        if let PinTarget::Track { track, .. } = &pin.target
            && tracks.get(*track).is_none_or(|t| t.b.positions.len() != scene.track_rows(*track).len())
        {
            let name = &scene.description().garments[pin.garment].name;
            problems.push(Problem::data(
                format!("garment \"{name}\", pin {p}"),
                "the animated positions do not fit the pinned vertices",
                "give one position per pinned vertex at every frame",
            ));
        }
    }
    agree(scene.parts().ranks(), problems).map(|()| tracks)
}

/// Depth up to which the distance from a body's surface is looked for [m].
fn depth_reach(scene: &Scene) -> f64 {
    scene.mean_edge() * 10.0
}

/// Depth of `x` [m] below the surface of a body, at most [`depth_reach`] [m]; `None` outside of it. A point in the overlap of a body
/// that crosses itself is inside as soon as its nearest surface says so.
pub(super) fn depth_inside(scene: &Scene, bodies: &Bodies, body: usize, x: &Vec3) -> Option<f64> {
    let reach = depth_reach(scene);
    match bodies.closest(body, x, x, reach, None) {
        Some(at) => (at.phi < 0.0).then_some(-at.phi),
        None => bodies.contains(body, x).then_some(reach),
    }
}

/// Finds garments of which some free vertices start inside a body, which draws them out.
///
/// # Errors
/// Garments with more free vertices inside than outside, or too deep for a way out to be known; the deepest of each is named.
pub(super) fn find_inside(
    scene: &Scene,
    state: &State,
    bodies: &Bodies,
    pins: Option<&HardPins>,
) -> Result<Vec<StartInside>, Problems> {
    let mut held = vec![false; state.x.len()];
    pins.into_iter().flat_map(HardPins::fully_held).for_each(|(vertex, _)| held[vertex] = true);
    scene.isolated().unwrap_or_default().iter().for_each(|vertex| held[*vertex as usize] = true);
    let description = scene.description();
    let (mut found, mut problems) = (Vec::new(), Vec::new());
    for (g, garment) in description.garments.iter().enumerate() {
        let ignores = |b: usize| description.ignores(ContactSide::Garment(g), ContactSide::Body(b));
        for (b, body) in description.bodies.iter().enumerate().filter(|(b, _)| !ignores(*b)) {
            let passes = |part: usize| description.ignores(ContactSide::Part(g, part), ContactSide::Body(b));
            let parts = garment.parts.values().enumerate().filter(|(part, _)| passes(*part));
            let through: BTreeSet<u32> = parts.flat_map(|(_, vertices)| vertices).copied().collect();
            let meets = |vertex: usize| through.is_empty() || !through.contains(&scene.parts().own_vertex(vertex).1);
            let free = || scene.parts().own_of_garment(g).filter(|vertex| !held[*vertex] && meets(*vertex));
            let inside: Vec<(f64, usize)> =
                free().filter_map(|vertex| Some((depth_inside(scene, bodies, b, &state.x[vertex])?, vertex))).collect();
            // Among equal depths the first vertex.
            let deepest = inside.iter().copied().min_by(|a, b| b.0.total_cmp(&a.0));
            let deepest = deepest.map(|(depth, vertex)| (depth, scene.parts().own_vertex(vertex).1));
            let ranks = scene.parts().ranks();
            let [count, all_free] = ranks.sum_of([inside.len(), free().count()].map(|count| count as u64));
            let all = ranks.all_gather_encoded("deepest vertices", deepest.into_iter().collect());
            let Some((deepest, own)) = all.into_iter().min_by(|a, b| b.0.total_cmp(&a.0)) else { continue };
            if 2 * count <= all_free && deepest < depth_reach(scene) {
                let (garment, body) = (garment.name.clone(), body.name.clone());
                found.push(StartInside { garment, body, vertices: count, deepest: (deepest, own) });
                continue;
            }
            let is_surface = matches!(body.shape, BodyShape::Surface { .. });
            problems.push(Problem::data(
                format!("garment \"{}\", vertex {own}", garment.name),
                format!(
                    "{count} of its vertices start inside body \"{}\"; this one is deepest, at {}{:.2} mm",
                    body.name,
                    if deepest == depth_reach(scene) { "more than " } else { "" },
                    1e3 * deepest
                ),
                if is_surface {
                    "move the garment off the body at the start frame, or start from a draped pose; if everything is \
                     inside, the winding of the body's faces may be reversed"
                } else {
                    "move the garment or the body in the scene"
                },
            ));
        }
    }
    if problems.is_empty() { Ok(found) } else { Err(Problems(problems)) }
}
