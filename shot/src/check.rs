//! Checks of moving inputs, frame by frame: everything is reported at once, before anything is simulated.

mod poses;
pub(crate) mod rates;

use std::collections::BTreeSet;

use drapery_core::Vec3;
use drapery_core::error::Problem;
use drapery_core::geometry::moving_surface::{is_closed, is_inside_out};
use drapery_core::mesh::{sides, turned_edges};
use drapery_core::scene::{FARTHEST, Timeline, coarse_place, is_possible};
use drapery_core::tolerances::DEGENERATE_AREA;
use drapery_io::error::IoError;
use drapery_io::garment_mesh::GarmentMesh;
use drapery_io::input_motion::InputMotion;
use drapery_io::mesh_data::Connectivity;
use drapery_io::units::{LengthUnit, UpAxis, unlikely_size};

use poses::Poses;
pub(crate) use poses::{JUMP, path_warning, spin_warning};

/// A step between samples this many times longer than usual is a hole.
const HOLE: f64 = 1.5;

/// Elements of one kind that are listed before the rest is only counted.
const LISTED: usize = 5;

/// Frames that the samples have to cover.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Span {
    pub(crate) timeline: Timeline,
    pub(crate) last_frame: i64,
}

impl Span {
    fn first_time(self) -> f64 {
        self.timeline.file_time(self.timeline.origin)
    }

    fn last_time(self) -> f64 {
        self.timeline.file_time(self.last_frame)
    }

    /// The frame at a time of the file, in words.
    fn frame_at(self, time: f64) -> String {
        let frame = time / self.timeline.frame_duration();
        if (frame - frame.round()).abs() < 1e-3 { format!("{}", frame.round()) } else { format!("{frame:.3}") }
    }
}

/// The surface that a scene was built with.
#[derive(Debug, Clone, Copy)]
pub(crate) struct BodySurface<'a> {
    pub(crate) triangles: &'a [[u32; 3]],
    pub(crate) point_count: usize,
    pub(crate) faces_inwards: bool,
}

/// Problems of one moving input over all samples that the shot uses; `body` is its surface, if it is a body.
pub(crate) fn check_motion(
    motion: &InputMotion,
    span: Span,
    body: Option<BodySurface<'_>>,
    warnings: &mut Vec<String>,
) -> Vec<Problem> {
    let mut problems = Vec::new();
    problems.extend(outside(motion, span));
    problems.extend(holes(motion, span));
    if let Err(error) = check_samples(motion, span, body, (&mut problems, warnings)) {
        problems.push(Problem::data(&motion.label, error.to_string(), "export the file again"));
    }
    problems
}

/// A body of an unlikely size. Where another unit explains it, by the size of a person or of the garments: an error, or a warning
/// if somebody has written units for this very body, or only its width is unusual (a floor). Where none does: a warning, unless the
/// body has units of its own, or is small and fits the garments, as a doll or a hand does.
pub(crate) fn check_size(
    motion: &InputMotion,
    span: Span,
    garments: &[GarmentMesh],
    warnings: &mut Vec<String>,
) -> Option<Problem> {
    let mut positions = Vec::new();
    // A file that cannot be read is reported by the check of its samples.
    motion.source.positions_at(span.first_time(), &mut positions).ok()?;
    let empty = [Vec3::repeat(f64::INFINITY), Vec3::repeat(f64::NEG_INFINITY)];
    let bounds = positions.iter().fold(empty, |[low, high], p| [low.inf(p), high.sup(p)]);
    let units = motion.source.units();
    let size = unlikely_size(bounds, units)?;
    let largest = garments.iter().filter_map(extent).fold(0.0, f64::max);
    // The same question for its height alone: a wide floor has a plausible height, or none.
    let height = [Vec3::zeros(), Vec3::new(0.0, bounds[1].y - bounds[0].y, 0.0)];
    let place = format!("{} ({})", motion.label, motion.source.path().display());
    let mistaken = size.mistaken_for(units, largest);
    let likely = mistaken.or(size.likely);
    let (what, remedy) = (size.looks_like(likely), unit_remedy(motion, likely, units.up));
    let across = format!("the largest garment is {largest:.3} m across");
    if mistaken.is_none() {
        if !motion.own_units && !size.fits(largest) {
            warnings.push(format!(
                "{place}: {what}; {across}; {remedy}; if it really is that size, write `units` at this body"
            ));
        }
        return None;
    }
    if motion.own_units || unlikely_size(height, units).is_none() {
        warnings.push(format!("{place}: {what}; {across}; {remedy}"));
        return None;
    }
    let advice = if motion.source.states_length() {
        "a unit stated in the file overrides [units], and `units` at this body overrides both"
    } else {
        "correct the units; if it really is that size, write `units` at this body"
    };
    Some(Problem::scene(place, format!("{what}; {remedy}"), format!("{across}; {advice}")))
}

/// Largest extent of a garment at rest [m]; `None` if it cannot be read, which is reported elsewhere.
fn extent(garment: &GarmentMesh) -> Option<f64> {
    let positions = garment.positions().ok()?;
    let first = *positions.first()?;
    let [low, high] = positions.iter().fold([first; 2], |[low, high], p| [low.inf(p), high.sup(p)]);
    Some((high - low).max())
}

/// Returns the remedy to write where a body has the size that it has in another unit.
fn unit_remedy(motion: &InputMotion, likely: Option<LengthUnit>, up: UpAxis) -> String {
    let of_body = motion.own_units || motion.source.states_length();
    match likely.map(LengthUnit::word) {
        Some(word) if of_body => format!("write units = {{ length = \"{word}\", up = \"{up:?}\" }} at this body"),
        Some(word) => format!("set units.length = \"{word}\""),
        None => "check units.length and the scale of its export".to_owned(),
    }
}

/// Faces of a body that lie on each other, or of which none has a normal, in its first pose; points without faces, and a few faces
/// without a normal, are only odd.
pub(crate) fn check_faces(
    motion: &InputMotion,
    span: Span,
    triangles: &[[u32; 3]],
    warnings: &mut Vec<String>,
) -> Vec<Problem> {
    let mut positions = Vec::new();
    // A file that cannot be read is reported by the check of its samples.
    if motion.source.positions_at(span.first_time(), &mut positions).is_err() {
        return Vec::new();
    }
    let mut seen = BTreeSet::new();
    let doubled = triangles.iter().filter(|corners| {
        let mut key = **corners;
        key.sort_unstable();
        !seen.insert(key)
    });
    let place = place(motion, span, span.first_time());
    let mut problems = problems_of_flat_faces(triangles, &positions, &place, warnings);
    problems.extend(listed(doubled).map(|list| {
        Problem::data(&place, format!("faces between the points {list} are duplicates"), "delete the duplicate faces")
    }));
    let turned = turned_edges(sides(triangles.iter().copied()).collect());
    warnings.extend(listed(turned.iter()).map(|list| {
        format!(
            "{place}: the faces at edges {list} have opposite winding, so there is no outside: make the normals \
             consistent"
        )
    }));
    let used: BTreeSet<u32> = triangles.iter().flatten().copied().collect();
    if used.len() < positions.len() {
        warnings.push(format!("{place}: {} points belong to no face", positions.len() - used.len()));
    }
    problems
}

/// Lists faces without area. Contact takes such a face for its edges, so a few are a warning; a body without any other face is a
/// problem, and so are faces that may have lost their area to rounding far from the origin.
fn problems_of_flat_faces(
    triangles: &[[u32; 3]],
    positions: &[Vec3],
    place: &str,
    warnings: &mut Vec<String>,
) -> Vec<Problem> {
    let at = |i: u32| positions.get(i as usize).copied().unwrap_or_default();
    let coarse = |corners: &&[u32; 3]| coarse_place(corners.map(at));
    let (lost, flat): (Vec<_>, Vec<_>) =
        flat_faces(triangles, positions).partition(|corners| coarse(corners).is_some());
    let farthest = lost.iter().filter_map(coarse).max_by(|a, b| a.0.total_cmp(&b.0));
    let lost = listed(lost.into_iter()).zip(farthest).map(|(list, (far, apart))| {
        let what = format!(
            "faces between the points {list} have no area, so they have no outside: {far:.0} m from the origin, single \
             precision resolves only {apart:.1e} m, and points of a file coincide"
        );
        let advice = "bake the body near the origin, and put the distance into a transform above the mesh, which has \
                      double precision; shot.origin does not help, it affects only the caches";
        Problem::data(place, what, advice)
    });
    let is_whole = flat.len() == triangles.len();
    let flat = listed(flat.into_iter()).map(|list| {
        let what = format!("faces between the points {list} have no area, so they have no outside");
        Problem::data(place, what, "delete these faces or dissolve their corners")
    });
    if !is_whole && let Some(Problem { place, what, advice, .. }) = &flat {
        warnings.push(format!("{place}: {what}; only their edges are touched: {advice}"));
    }
    lost.into_iter().chain(flat.filter(|_| is_whole)).collect()
}

/// Triangles that have no area at these positions.
fn flat_faces<'a>(triangles: &'a [[u32; 3]], positions: &'a [Vec3]) -> impl Iterator<Item = &'a [u32; 3]> {
    let at = |i: u32| positions.get(i as usize).copied().unwrap_or_default();
    triangles.iter().filter(move |&&[a, b, c]| {
        let [u, v, w] = [at(b) - at(a), at(c) - at(a), at(c) - at(b)];
        let longest = u.norm_squared().max(v.norm_squared()).max(w.norm_squared());
        0.5 * u.cross(&v).norm() <= DEGENERATE_AREA * longest
    })
}

/// The first few triangles or edges as text; `None` when there are none.
fn listed<'a, const N: usize>(elements: impl Iterator<Item = &'a [u32; N]>) -> Option<String> {
    let all: Vec<String> = elements.map(|points| points.map(|point| point.to_string()).join("-")).collect();
    let more = all.len().saturating_sub(LISTED);
    match more {
        _ if all.is_empty() => None,
        0 => Some(all.join(", ")),
        _ => Some(format!("{} and {more} more", all[..LISTED].join(", "))),
    }
}

fn place(motion: &InputMotion, span: Span, time: f64) -> String {
    let objects = motion.source.objects();
    let object = match objects.as_slice() {
        [one] => one.clone(),
        many => format!("{} objects", many.len()),
    };
    format!("{} ({}, {object}), frame {}", motion.label, motion.source.path().display(), span.frame_at(time))
}

/// Frames of the shot before the first sample or after the last.
fn outside(motion: &InputMotion, span: Span) -> Option<Problem> {
    let times = motion.source.sample_times();
    if motion.source.covers(span.first_time(), span.last_time()) {
        return None;
    }
    let (first, last) = (times.first()?, times.last()?);
    let (first, last) = (span.frame_at(*first), span.frame_at(*last));
    let fps = span.timeline.fps();
    let own = rates::other_rate(motion.source.frame_rate(), fps);
    let advice = match &own {
        Some((_, line)) => format!("write {line}, or choose frames inside it with shot.frames or --frames"),
        None => "export the whole range, or choose frames inside it with shot.frames or --frames; check shot.fps too"
            .to_owned(),
    };
    let own = own.map_or(String::new(), |(how, _)| format!("; {how} frames per second"));
    Some(Problem::data(
        format!("{} ({})", motion.label, motion.source.path().display()),
        format!(
            "its samples cover frames {first} to {last} at {fps:.6} fps, but the simulation needs frames {} to {}{own}",
            span.timeline.origin, span.last_frame
        ),
        advice,
    ))
}

/// Missing frames: a step between two samples that is much longer than the usual one.
fn holes(motion: &InputMotion, span: Span) -> Option<Problem> {
    let times = motion.source.sample_times();
    let mut steps: Vec<f64> = times.windows(2).map(|w| w[1] - w[0]).collect();
    steps.sort_by(f64::total_cmp);
    let usual = *steps.get(steps.len() / 2)?;
    // Steps shorter than a frame (shutter samples) may be uneven; a hole is longer than a frame too.
    let limit = HOLE * usual.max(span.timeline.frame_duration());
    let hole = times.windows(2).find(|w| w[1] - w[0] > limit && w[1] > span.first_time() && w[0] < span.last_time())?;
    Some(Problem::data(
        format!("{} ({})", motion.label, motion.source.path().display()),
        format!("no samples between frames {} and {}", span.frame_at(hole[0]), span.frame_at(hole[1])),
        "frames are missing in the file: export it again without gaps",
    ))
}

/// Topology, number of points and finite positions of every sample in use; the first problem of each kind.
fn check_samples(
    motion: &InputMotion,
    span: Span,
    body: Option<BodySurface<'_>>,
    (problems, warnings): (&mut Vec<Problem>, &mut Vec<String>),
) -> Result<(), IoError> {
    let mut points = body.map(|body| body.point_count);
    let mut closed = body.filter(|body| is_closed(body.triangles));
    let source = &motion.source;
    let mut times = vec![span.first_time()];
    times.extend_from_slice(source.times_between(span.first_time(), span.last_time()));
    if !source.sample_times().is_empty() && span.last_time() > span.first_time() {
        times.push(span.last_time());
    }
    let mut first: Option<Connectivity> = None;
    let mut positions = Vec::new();
    let mut bad_number = false;
    let mut poses = Poses::new(body.map_or(&[], |body| body.triangles));
    for time in times {
        if let Some(now) = source.connectivity_at(time)? {
            let before = first.get_or_insert_with(|| now.clone());
            if *before != now {
                problems.push(Problem::data(
                    place(motion, span, time),
                    topology_change(before, &now),
                    "export it with constant topology: same points, same faces, same order in every frame",
                ));
                // Positions of another mesh would only repeat the message.
                return Ok(());
            }
        }
        source.positions_at(time, &mut positions)?;
        let points = *points.get_or_insert(positions.len());
        if positions.len() != points {
            problems.push(Problem::data(
                place(motion, span, time),
                format!("{} points, but there were {points} at the start", positions.len()),
                "export it with constant topology: same points, same faces, same order in every frame",
            ));
            return Ok(());
        }
        poses.look(time, &positions, &|| place(motion, span, time));
        let turned = |body: &BodySurface<'_>| is_inside_out(body.triangles, &positions, body.faces_inwards);
        if closed.as_ref().is_some_and(turned) {
            closed = None;
            let place = place(motion, span, time);
            warnings.push(format!("{place}: the body is inside out; its sides are swapped while that lasts"));
        }
        if let Some(vertex) = first_impossible(&positions).filter(|_| !bad_number) {
            bad_number = true;
            problems.push(Problem::data(
                format!("{}, vertex {vertex}", place(motion, span, time)),
                format!("its position is not a finite number, or beyond {FARTHEST:e} m"),
                "correct that frame of the animation and export it again",
            ));
        }
    }
    warnings.extend(poses.warnings());
    Ok(())
}

fn topology_change(before: &Connectivity, now: &Connectivity) -> String {
    let (faces_before, faces_now) = (before.face_counts.len(), now.face_counts.len());
    if faces_before != faces_now {
        return format!("the topology changes: {faces_now} faces, {faces_before} in the first frame");
    }
    let corner = before.face_indices.iter().zip(&now.face_indices).position(|(a, b)| a != b);
    format!("the topology changes: the same number of faces, but other points from face corner {}", corner.unwrap_or(0))
}

fn first_impossible(positions: &[Vec3]) -> Option<usize> {
    positions.iter().position(|p| !is_possible(p))
}
