//! Seams whose stitches start with a body between their ends: closing them presses the cloth into it.

use drapery_core::Vec3;
use drapery_core::effects::body_collision;
use drapery_core::geometry::shapes::Shape;
use drapery_core::scene::{ContactSide, RigidMotion, SeamDescription};

use super::solid::{Solid, in_frame_of, solids};
use super::{Facts, Finding, bounds};

/// Stitches of a longer seam that are looked at, evenly spaced.
const STITCHES: usize = 200;

/// Depth of a passage over its length above which the body lies between the ends. Seams that close around a belly cut through it by
/// less: a chord of a circle, by 37° to either side.
const DEEP: f64 = 1.0 / 6.0;

/// Points of a stitch at which the distance from a shape is taken.
const SAMPLES: usize = 65;

/// A stitch at the start.
struct Stitch {
    /// Its vertex in the first garment.
    vertex: u32,
    /// Places of its ends [m].
    ends: [Vec3; 2],
}

/// The part of a stitch inside a body: its length, and the depth of its middle or deepest point [m].
#[derive(Debug, Clone, Copy, PartialEq)]
struct Passage {
    length: f64,
    depth: f64,
}

pub(super) fn find(facts: &Facts<'_>) -> Vec<Finding> {
    if facts.scene.seams.is_empty() || facts.request(body_collision::SPEC.name).is_none() {
        return Vec::new();
    }
    // Files that cannot be read are reported elsewhere.
    let Ok(input) = facts.inputs.at(facts.inputs.timeline.start) else { return Vec::new() };
    let solids = solids(facts, &input);
    let seams = facts.scene.seams.iter().enumerate().filter(|(_, seam)| !seam.keeps_gap);
    seams.flat_map(|(number, seam)| of_seam(facts, number, seam, &solids)).collect()
}

/// The bodies that a seam goes through, each with its deepest stitch.
fn of_seam(facts: &Facts<'_>, number: usize, seam: &SeamDescription, solids: &[(usize, Solid<'_>)]) -> Vec<Finding> {
    let Some(stitches) = stitches(facts, seam) else { return Vec::new() };
    let meets = |body: usize| {
        let ignores = |garment: &usize| facts.scene.ignores(ContactSide::Garment(*garment), ContactSide::Body(body));
        !seam.garments.iter().any(ignores)
    };
    let of_body = |(body, solid): &(usize, Solid<'_>)| {
        let body = &facts.scene.bodies[*body];
        let passages = passages(solid, &stitches);
        let through = passages.iter().zip(&stitches).filter_map(|(passage, stitch)| {
            let passage = (*passage)?;
            (passage.depth > DEEP * passage.length && passage.depth > 2.0 * body.thickness).then_some((passage, stitch))
        });
        let through: Vec<(Passage, &Stitch)> = through.collect();
        let (deepest, stitch) = through.iter().max_by(|(a, _), (b, _)| a.depth.total_cmp(&b.depth))?;
        let [name, other] = seam.garments.map(|garment| &facts.scene.garments[garment].name);
        let message = format!(
            "{} of {} stitches that were looked at start with body \"{}\" between their ends; the deepest, from vertex {} of garment \
             \"{name}\" to garment \"{other}\", is inside it over {:.3} m, up to {:.3} m deep. Closing it presses the cloth into the body: \
             sew vertices that lie on the same side of it, or start the garments so that nothing is between them",
            through.len(),
            stitches.len(),
            body.name,
            stitch.vertex,
            deepest.length,
            deepest.depth,
        );
        Some(Finding { object: format!("seam {number}"), message, line: String::new() })
    };
    solids.iter().filter(|(body, _)| meets(*body)).filter_map(of_body).collect()
}

/// Stitches of a seam at the start; `None` if a garment cannot be read, which is reported elsewhere.
fn stitches(facts: &Facts<'_>, seam: &SeamDescription) -> Option<Vec<Stitch>> {
    let [from, to] = seam.garments.map(|garment| facts.start_of(garment));
    let (from, to) = (from?, to?);
    let pairs = seam.pairs.iter().map(|[a, b]| (*a, to.get(*b as usize).copied()));
    let on_faces = seam.faces.iter().map(|point| {
        let corner = |k: usize| to.get(point.corners[k] as usize).map(|corner| corner * point.weights[k]);
        (point.vertex, (0..3).map(corner).sum::<Option<Vec3>>())
    });
    let step = (seam.pairs.len() + seam.faces.len()).div_ceil(STITCHES).max(1);
    let stitch =
        |(vertex, end): (u32, Option<Vec3>)| Some(Stitch { vertex, ends: [*from.get(vertex as usize)?, end?] });
    Some(pairs.chain(on_faces).step_by(step).filter_map(stitch).collect())
}

/// The part of each stitch inside a body.
fn passages(solid: &Solid<'_>, stitches: &[Stitch]) -> Vec<Option<Passage>> {
    match solid {
        Solid::Shape { shape, motion } => stitches.iter().map(|stitch| through_shape(shape, motion, stitch)).collect(),
        Solid::Mesh { triangles, positions } => through_mesh(triangles, positions, stitches),
    }
}

/// Passage through a shape that stands where its path begins.
fn through_shape(shape: &Shape, motion: &RigidMotion, stitch: &Stitch) -> Option<Passage> {
    let [a, b] = stitch.ends.map(|end| in_frame_of(motion, &end));
    let depths = (0..SAMPLES).map(|k| -shape.distance(&a.lerp(&b, k as f64 / (SAMPLES - 1) as f64)));
    let inside: Vec<f64> = depths.filter(|depth| *depth > 0.0).collect();
    let length = inside.len() as f64 / (SAMPLES - 1) as f64 * (b - a).norm();
    inside.into_iter().max_by(f64::total_cmp).map(|depth| Passage { length, depth })
}

/// Passages between the first and the last point in which each stitch meets a mesh.
fn through_mesh(triangles: &[[u32; 3]], positions: &[Vec3], stitches: &[Stitch]) -> Vec<Option<Passage>> {
    let Some([low, high]) = bounds(positions) else { return vec![None; stitches.len()] };
    let inside = |Stitch { ends: [a, b], .. }: &Stitch| -> Option<[Vec3; 2]> {
        let (least, most) = (a.inf(b), a.sup(b));
        if (0..3).any(|axis| least[axis] > high[axis] || most[axis] < low[axis]) {
            return None;
        }
        let met = triangles
            .iter()
            .filter_map(|triangle| meeting_point(&[*a, *b], &triangle.map(|corner| positions[corner as usize])));
        let (first, last) = met.fold((f64::INFINITY, 0.0_f64), |(first, last), t| (first.min(t), last.max(t)));
        (first < last).then(|| [first, last].map(|t| a.lerp(b, t)))
    };
    let spans: Vec<Option<[Vec3; 2]>> = stitches.iter().map(inside).collect();
    let middles: Vec<Vec3> = spans.iter().flatten().map(|[a, b]| (a + b) * 0.5).collect();
    let mut depths = Solid::Mesh { triangles, positions }.distances(&middles).into_iter();
    let passage = |span: &Option<[Vec3; 2]>| {
        let [a, b] = (*span)?;
        Some(Passage { length: (b - a).norm(), depth: depths.next()? })
    };
    spans.iter().map(passage).collect()
}

/// Place on a segment, from 0 to 1, at which it meets a triangle (T. Möller, B. Trumbore, "Fast, Minimum Storage Ray/Triangle
/// Intersection", 1997).
fn meeting_point([a, b]: &[Vec3; 2], [p, q, r]: &[Vec3; 3]) -> Option<f64> {
    let (along, one, other) = (b - a, q - p, r - p);
    let across = along.cross(&other);
    let volume = one.dot(&across);
    if volume == 0.0 {
        return None;
    }
    let from = a - p;
    let u = from.dot(&across) / volume;
    let turned = from.cross(&one);
    let v = along.dot(&turned) / volume;
    let t = other.dot(&turned) / volume;
    (u >= 0.0 && v >= 0.0 && u + v <= 1.0 && (0.0..=1.0).contains(&t)).then_some(t)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn passages_through_a_box_and_a_ball_have_their_chords() {
        let stitch = |from: [f64; 3], to: [f64; 3]| Stitch { vertex: 0, ends: [from.into(), to.into()] };
        // A box of 2 m, 4 m and 6 m.
        let corner = |k: usize| {
            Vec3::new(1.0, 2.0, 3.0).map_with_location(|axis, _, half| if (k >> axis) & 1 == 1 { half } else { -half })
        };
        let positions: Vec<Vec3> = (0..8).map(corner).collect();
        let quads = [[0, 2, 6, 4], [1, 5, 7, 3], [0, 4, 5, 1], [2, 3, 7, 6], [0, 1, 3, 2], [4, 6, 7, 5]];
        let triangles: Vec<[u32; 3]> = quads.iter().flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]]).collect();
        let through = |from, to| through_mesh(&triangles, &positions, &[stitch(from, to)])[0];
        let found = through([-3.0, 0.1, 0.3], [5.0, 0.1, 0.3]).expect("it goes through");
        assert!((found.length - 2.0).abs() < 1e-12 && (found.depth - 1.0).abs() < 1e-12, "{found:?}");
        assert_eq!(through([-3.0, 2.1, 0.3], [5.0, 2.1, 0.3]), None, "beside it");
        assert_eq!(through([2.0, 0.1, 0.3], [5.0, 0.1, 0.3]), None, "before it");
        // A ball, through its centre, and by a chord at 0.8 of its radius.
        let motion = RigidMotion::at(Vec3::x());
        let ball =
            |y: f64| through_shape(&Shape::Sphere { radius: 1.0 }, &motion, &stitch([-2.0, y, 0.0], [4.0, y, 0.0]));
        let found = ball(0.0).expect("it goes through");
        assert!((found.length - 2.0).abs() < 0.1 && (found.depth - 1.0).abs() < 1e-3, "{found:?}");
        let found = ball(0.8).expect("it goes through");
        assert!((found.length - 1.2).abs() < 0.1 && (found.depth - 0.2).abs() < 1e-3, "{found:?}");
        assert_eq!(ball(1.1), None);
    }
}
