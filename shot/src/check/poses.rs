//! Poses that no cloth could follow, from sample to sample of a moving input: jumps, changes of size, faces that lose their
//! area. They are possible, so they are said and not refused.

use drapery_core::Vec3;
use drapery_core::geometry::moving_surface::{enclosed_share, is_closed};
use drapery_core::geometry::shapes::Shape;
use drapery_core::scene::RigidMotion;

use super::{flat_faces, listed};

/// Speed from which on a motion is taken for a jump [m/s]. The hand of a dancer reaches 15 m/s and a thrown ball 50; what
/// appears elsewhere after a cut goes metres in a frame, which at 24 frames a second is 100 m/s and more.
pub(crate) const JUMP: f64 = 100.0;

/// Factor by which a body may change its size (the root of its area) from one sample to the next. Skin stretches by a few
/// percent in a frame; a factor of two is a wrong unit or a broken sample.
const RESIZED: f64 = 2.0;

/// Factor to which the ratio of volume to area (the cube of its size) of a closed body may fall against its first
/// sample: the remainder of a body that is squashed flat has area on both sides and next to nothing between them. A
/// chest that breathes out or an arm that bends changes it by a few percent.
const FLATTENED: f64 = 0.01;

/// Findings of one kind: the first, and the number of samples.
#[derive(Debug, Default)]
struct Found {
    /// Description of the first sample with the finding.
    first: Option<String>,
    samples: usize,
}

impl Found {
    fn note(&mut self, place: impl FnOnce() -> String) {
        self.samples += 1;
        self.first.get_or_insert_with(place);
    }

    fn warnings(self, advice: &str) -> Option<String> {
        let more = match self.samples {
            0 | 1 => String::new(),
            2 => ", and in 1 more sample".to_owned(),
            samples => format!(", and in {} more samples", samples - 1),
        };
        self.first.map(|first| format!("{first}{more}: {advice}"))
    }
}

/// The samples of an input, looked at in their order.
#[derive(Debug)]
pub(super) struct Poses<'a> {
    /// Faces of a body.
    triangles: &'a [[u32; 3]],
    /// Time [s], size [m] and positions of the sample before.
    before: Option<(f64, f64, Vec<Vec3>)>,
    jumps: Found,
    sizes: Found,
    flat: Found,
    /// Volume to area of the first sample; `None` of surfaces that enclose none.
    first_share: Option<f64>,
    collapses: Found,
}

impl<'a> Poses<'a> {
    /// Nothing seen yet of an input with these faces; a track has none.
    pub(super) fn new(triangles: &'a [[u32; 3]]) -> Self {
        Self {
            triangles,
            before: None,
            jumps: Found::default(),
            sizes: Found::default(),
            flat: Found::default(),
            first_share: None,
            collapses: Found::default(),
        }
    }

    /// Looks at the sample of a time [s]; `place` names it.
    pub(super) fn look(&mut self, time: f64, positions: &[Vec3], place: &dyn Fn() -> String) {
        let size = size(self.triangles, positions);
        let share = enclosed_share(self.triangles, positions).abs();
        match self.first_share {
            None if self.before.is_none() && is_closed(self.triangles) => self.first_share = Some(share),
            Some(first) if share < FLATTENED * first => self.collapses.note(|| {
                let left = 100.0 * share / first;
                format!(
                    "{}: the body collapses: its ratio of volume to area is {left:.1} % of the value in the first \
                     sample",
                    place()
                )
            }),
            _ => {}
        }
        if let Some((since, size_before, before)) = &self.before {
            let (speed, vertex) = fastest(before, positions, time - since);
            if speed > JUMP {
                self.jumps.note(|| format!("{}: vertex {vertex} moves at {speed:.0} m/s", place()));
            }
            let factor = size / size_before;
            if !(1.0 / RESIZED..=RESIZED).contains(&factor) && !factor.is_nan() {
                self.sizes
                    .note(|| format!("{}: the body is {factor:.3} times as large as in the sample before", place()));
            }
            // Those of the first sample are errors, and are reported as such.
            if let Some(faces) = listed(flat_faces(self.triangles, positions)) {
                self.flat.note(|| format!("{}: faces between the points {faces} have no area", place()));
            }
        }
        let mut kept = self.before.take().map_or_else(Vec::new, |(.., positions)| positions);
        kept.clear();
        kept.extend_from_slice(positions);
        self.before = Some((time, size, kept));
    }

    /// Returns the warnings.
    pub(super) fn warnings(self) -> impl Iterator<Item = String> {
        let jumps = self.jumps.warnings(
            "cloth cannot follow that; if the animation is cut there, simulate what comes after it as a shot of its own, with a \
             pre-roll",
        );
        let sizes = self.sizes.warnings("check this frame and the units of the file, and export it again");
        let flat = self.flat.warnings("they have no outside while that lasts; check this frame of the animation");
        let collapses =
            self.collapses.warnings("the body has no inside to keep cloth out; check this frame and export it again");
        [jumps, sizes, flat, collapses].into_iter().flatten()
    }
}

/// Root of the area of triangles [m].
fn size(triangles: &[[u32; 3]], positions: &[Vec3]) -> f64 {
    let area = |corners: &[u32; 3]| {
        let [a, b, c] = corners.map(|v| positions.get(v as usize).copied().unwrap_or_default());
        0.5 * (b - a).cross(&(c - a)).norm()
    };
    triangles.iter().map(area).sum::<f64>().sqrt()
}

/// The highest speed with which a vertex gets from one place to the other in this time [s], and that vertex.
fn fastest(from: &[Vec3], to: &[Vec3], time: f64) -> (f64, usize) {
    let ways = from.iter().zip(to).map(|(a, b)| (b - a).norm()).enumerate();
    let (vertex, way) = ways.fold((0, 0.0), |most, next| if next.1 > most.1 { next } else { most });
    (if way > 0.0 { way / time } else { 0.0 }, vertex)
}

/// Returns the warning about a path of points [s, m], if there is one; `place` names it.
pub(crate) fn path_warning(place: &str, points: &[(f64, Vec3)]) -> Option<String> {
    let mut jumps = Found::default();
    for ends in points.windows(2) {
        let ((since, from), (time, to)) = (ends[0], ends[1]);
        let speed = (to - from).norm() / (time - since);
        if speed > JUMP {
            jumps.note(|| format!("{place}: it moves along its path at {speed:.0} m/s from {since} s to {time} s"));
        }
    }
    jumps.warnings("cloth cannot follow that; give these points of the path more time")
}

/// Returns the warning about a shape that spins, if there is one; `place` names it.
pub(crate) fn spin_warning(place: &str, shape: &Shape, motion: &RigidMotion) -> Option<String> {
    let reach = match *shape {
        // Level ground that turns about its normal; there is no farthest point of it.
        Shape::HalfSpace => return None,
        Shape::Sphere { radius } => radius,
        Shape::Capsule { radius, half_length } => radius + half_length,
        Shape::Cylinder { radius, half_length } => radius.hypot(half_length),
        Shape::Box { half_extents } => Vec3::from(half_extents).norm(),
    };
    let turns = motion.angular_velocity.norm();
    let speed = turns * reach;
    (speed > JUMP).then(|| {
        format!(
            "{place}: it spins at {turns:.0} rad/s, and its surface moves at up to {speed:.0} m/s: cloth cannot follow \
             that; write a smaller `angular_velocity`, which is in radians per second"
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Corners of a tetrahedron of this size around a place.
    fn pose(place: Vec3, size: f64) -> Vec<Vec3> {
        [Vec3::zeros(), Vec3::x(), Vec3::y(), Vec3::z()].map(|corner| place + corner * size).into()
    }

    const FACES: [[u32; 3]; 4] = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];

    fn warnings(samples: &[Vec<Vec3>]) -> Vec<String> {
        let mut poses = Poses::new(&FACES);
        for (frame, sample) in samples.iter().enumerate() {
            poses.look(frame as f64 / 24.0, sample, &|| format!("frame {frame}"));
        }
        poses.warnings().collect()
    }

    #[test]
    fn a_dancer_and_a_body_that_grows_slowly_pass_in_silence() {
        let walking =
            (0..6).map(|frame| pose(Vec3::x() * (f64::from(frame) * 15.0 / 24.0), 1.0 + 0.3 * f64::from(frame)));
        assert_eq!(warnings(&walking.collect::<Vec<_>>()), Vec::<String>::new());
    }

    #[test]
    fn jumps_collapses_and_growth_are_said_with_their_frame_and_how_much() {
        let at = |place: f64, size: f64| pose(Vec3::x() * place, size);
        let jump = warnings(&[at(0.0, 1.0), at(0.0, 1.0), at(100.0, 1.0), at(100.0, 1.0)]);
        assert_eq!(jump.len(), 1, "{jump:?}");
        assert!(jump[0].starts_with("frame 2: vertex 0 moves at 2400 m/s: "), "{jump:?}");
        let point = warnings(&[at(0.0, 1.0), at(0.0, 0.0), at(0.0, 1.0)]);
        assert!(point[0].starts_with("frame 1: the body is 0.000 times as large"), "{point:?}");
        assert!(point[0].contains("in 1 more sample"), "{point:?}");
        assert!(point[1].contains("faces between the points 0-2-1") && point[1].contains("have no area"), "{point:?}");
        let grown = warnings(&[at(0.0, 1.0), at(0.0, 1000.0), at(0.0, 1.0)]);
        assert!(grown[0].contains("m/s, and in 1 more sample:"), "{grown:?}");
        assert!(grown[1].starts_with("frame 1: the body is 1000.000 times as large"), "{grown:?}");
    }

    #[test]
    fn a_body_that_is_squashed_to_a_disc_is_said_with_its_frame() {
        let squashed = |height: f64| {
            let full = pose(Vec3::x() * 3.0, 1.0);
            full.iter().map(|x| Vec3::new(x.x, x.y * height, x.z)).collect::<Vec<_>>()
        };
        let disc = warnings(&[squashed(1.0), squashed(1e-3), squashed(1e-3), squashed(1.0)]);
        assert_eq!(disc.len(), 1, "{disc:?}");
        assert!(
            disc[0].starts_with("frame 1: the body collapses: its ratio of volume to area is 0.")
                && disc[0].contains("in 1 more sample"),
            "{disc:?}"
        );
        assert!(warnings(&[squashed(0.0), squashed(0.0)]).iter().all(|said| !said.contains("collapses")));
        assert!(warnings(&[squashed(1.0), squashed(0.5), squashed(0.2)]).is_empty());
    }

    #[test]
    fn a_path_that_jumps_is_said_with_its_times() {
        let path = [(0.0, Vec3::zeros()), (1.0, Vec3::x() * 99.0), (1.1, Vec3::zeros())];
        let warnings = path_warning("body \"ball\"", &path).unwrap_or_default();
        assert!(
            warnings.starts_with("body \"ball\": it moves along its path at 990 m/s from 1 s to 1.1 s"),
            "{warnings}"
        );
        assert_eq!(path_warning("body \"ball\"", &path[..2]), None);
    }

    #[test]
    fn a_spin_that_nothing_follows_is_said_with_the_speed_of_the_surface() {
        let spinning =
            |speed: f64| RigidMotion { angular_velocity: Vec3::y() * speed, ..RigidMotion::at(Vec3::zeros()) };
        let ball = Shape::Sphere { radius: 0.5 };
        assert_eq!(spin_warning("body \"ball\"", &ball, &spinning(199.0)), None);
        let said = spin_warning("body \"ball\"", &ball, &spinning(1000.0)).unwrap_or_default();
        assert!(
            said.starts_with("body \"ball\": it spins at 1000 rad/s, and its surface moves at up to 500 m/s"),
            "{said}"
        );
        let board = Shape::Box { half_extents: [3.0, 0.1, 4.0] };
        assert!(spin_warning("", &board, &spinning(20.0)).is_some_and(|said| said.contains("up to 100 m/s")));
        assert_eq!(spin_warning("", &Shape::HalfSpace, &spinning(1e5)), None);
    }
}
