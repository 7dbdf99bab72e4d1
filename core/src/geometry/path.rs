//! A point that moves straight against a triangle whose corners move straight: when does it pass through?
//!
//! With AB, AC, AP the vectors from the first corner, all linear in the fraction s of the step, the signed volume
//! f(s) = (AB × AC) · AP is a cubic: positive in front of the triangle, negative behind it. It is held in Bernstein form,
//! whose four coefficients of one sign prove that there is no crossing, and whose ends are the exact start and end
//! values, so that consecutive steps agree on which side a point is (`docs/theory/friction.md#one-vertex-on-one-body`).
//!
//! Limits: made for bodies, where a missed graze is caught by the closest-point test at the end of the step. Transversal
//! crossings are found also if the triangle turns, shrinks or loses its area on the way; two crossings of one triangle
//! closer together than rounding may cancel.

use crate::Vec3;
use crate::geometry::distance::{TrianglePoint, closest_on_triangle};
use crate::geometry::tolerances;

/// Newton and bisection steps at most; bisection alone needs 53.
const ROOT_STEPS: usize = 64;

/// Kinds of crossings that are asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Crossings {
    /// Only those from the front of a triangle to its back: into a closed body.
    Entering,
    /// In both directions: through an open surface.
    Any,
}

/// The side of a triangle a point came from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Side {
    /// The side its normal points to.
    Front,
    /// The other one.
    Back,
}

/// Place and time at which a point passes through a triangle.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Crossing {
    /// Fraction of the step, in \[0, 1\].
    pub fraction: f64,
    /// Barycentric weights of the crossed point.
    pub weights: [f64; 3],
    /// The side the point came from.
    pub side: Side,
}

/// Earliest crossing of a point moving from `point[0]` to `point[1]` through a triangle whose corners move from
/// `start` to `end`.
///
/// A point on the surface, or behind it by rounding, at the start counts as outside; on it at the end, as still
/// outside: a chain of steps never loses it.
#[inline]
pub(crate) fn first_crossing(
    point: &[Vec3; 2],
    start: &[Vec3; 3],
    end: &[Vec3; 3],
    wanted: Crossings,
) -> Option<Crossing> {
    let volume = Volume::new(point, start, end);
    if volume.keeps_its_sign() {
        return None;
    }
    roots_between(&volume, point, start, end, wanted)
}

/// f(s) in Bernstein form.
struct Volume {
    coefficients: [f64; 4],
    rounding: f64,
    /// Longest vector from the first corner at either end \[m\].
    size: f64,
}

impl Volume {
    #[inline]
    fn new(point: &[Vec3; 2], start: &[Vec3; 3], end: &[Vec3; 3]) -> Volume {
        let (ab0, ac0, ap0) = (start[1] - start[0], start[2] - start[0], point[0] - start[0]);
        let (ab1, ac1, ap1) = (end[1] - end[0], end[2] - end[0], point[1] - end[0]);
        let (n0, n2) = (ab0.cross(&ac0), ab1.cross(&ac1));
        let n1 = ab0.cross(&ac1) + ab1.cross(&ac0);
        let coefficients =
            [n0.dot(&ap0), (n1.dot(&ap0) + n0.dot(&ap1)) / 3.0, (n2.dot(&ap0) + n1.dot(&ap1)) / 3.0, n2.dot(&ap1)];
        let longest = |a: &Vec3, b: &Vec3| a.norm_squared().max(b.norm_squared()).sqrt();
        let (ab, ac, ap) = (longest(&ab0, &ab1), longest(&ac0, &ac1), longest(&ap0, &ap1));
        Volume { coefficients, rounding: tolerances::VOLUME * ab * ac * ap, size: ab.max(ac).max(ap) }
    }

    #[inline]
    fn keeps_its_sign(&self) -> bool {
        let b = &self.coefficients;
        (b[0] > 0.0 && b[1] > 0.0 && b[2] > 0.0 && b[3] > 0.0)
            || (b[0] < -self.rounding && b[1] < 0.0 && b[2] < 0.0 && b[3] < 0.0)
    }

    /// Value and derivative (de Casteljau).
    fn at(&self, s: f64) -> (f64, f64) {
        let mix = |a: f64, b: f64| a * (1.0 - s) + b * s;
        let [a, b, c, d] = self.coefficients;
        let (ab, bc, cd) = (mix(a, b), mix(b, c), mix(c, d));
        let (left, right) = (mix(ab, bc), mix(bc, cd));
        (mix(left, right), 3.0 * (right - left))
    }

    /// Ascending ends of the intervals of \[0, 1\] in which f is monotone; unused entries are 1.
    fn monotone_intervals(&self) -> [f64; 4] {
        let [a, b, c, d] = self.coefficients;
        let (d0, d1, d2) = (b - a, c - b, d - c);
        // f'/3 = q2 s² + 2 q1 s + q0, roots without cancellation.
        let (q2, q1, q0) = (d0 - 2.0 * d1 + d2, d1 - d0, d0);
        let discriminant = q1 * q1 - q2 * q0;
        let mut turns = [1.0; 2];
        if discriminant > 0.0 {
            let q = -(q1 + discriminant.sqrt().copysign(q1));
            let inside = |s: f64| if s > 0.0 && s < 1.0 { s } else { 1.0 };
            turns = [inside(q / q2), inside(q0 / q)];
            turns.sort_by(f64::total_cmp);
        }
        [0.0, turns[0], turns[1], 1.0]
    }

    /// The root between `low` and `high`, which have different signs.
    fn root(&self, mut low: f64, mut high: f64, low_is_outside: bool) -> f64 {
        let mut s = 0.5 * (low + high);
        for _ in 0..ROOT_STEPS {
            let (value, slope) = self.at(s);
            if (value >= 0.0) == low_is_outside {
                low = s;
            } else {
                high = s;
            }
            let newton = s - value / slope;
            let next = if newton > low && newton < high { newton } else { 0.5 * (low + high) };
            if next == s || next <= low || next >= high {
                break;
            }
            s = next;
        }
        s
    }
}

/// Goes through the sign changes of f in order and returns the first wanted one inside the triangle.
fn roots_between(
    volume: &Volume,
    point: &[Vec3; 2],
    start: &[Vec3; 3],
    end: &[Vec3; 3],
    wanted: Crossings,
) -> Option<Crossing> {
    let ends = volume.monotone_intervals();
    let mut outside = volume.coefficients[0] >= -volume.rounding;
    for interval in ends.windows(2) {
        if interval[0] >= interval[1] {
            continue;
        }
        let value = if interval[1] == 1.0 { volume.coefficients[3] } else { volume.at(interval[1]).0 };
        let was_outside = outside;
        outside = value >= 0.0;
        if outside == was_outside || (outside && wanted == Crossings::Entering) {
            continue;
        }
        let fraction = volume.root(interval[0], interval[1], was_outside);
        let found = closest_at(fraction, point, start, end);
        let slit = tolerances::SLIT * volume.size;
        if found.distance_squared <= slit * slit {
            let side = if was_outside { Side::Front } else { Side::Back };
            return Some(Crossing { fraction, weights: found.weights, side });
        }
    }
    None
}

fn closest_at(s: f64, point: &[Vec3; 2], start: &[Vec3; 3], end: &[Vec3; 3]) -> TrianglePoint {
    let corners = [0, 1, 2].map(|i| start[i] * (1.0 - s) + end[i] * s);
    closest_on_triangle(&(point[0] * (1.0 - s) + point[1] * s), &corners)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::random::SplitMix64;

    const RIGHT: [Vec3; 3] = [Vec3::new(0.0, 0.0, 0.0), Vec3::new(1.0, 0.0, 0.0), Vec3::new(0.0, 1.0, 0.0)];

    fn moved(t: &[Vec3; 3], by: Vec3) -> [Vec3; 3] {
        t.map(|p| p + by)
    }

    #[test]
    fn a_point_falling_through_a_triangle_at_rest_is_found_at_the_exact_fraction() {
        let hit =
            first_crossing(&[Vec3::new(0.2, 0.3, 3.0), Vec3::new(0.2, 0.3, -1.0)], &RIGHT, &RIGHT, Crossings::Any);
        let hit = hit.unwrap();
        assert!((hit.fraction - 0.75).abs() < 1e-15 && hit.side == Side::Front);
        assert!((Vec3::from(hit.weights) - Vec3::new(0.5, 0.2, 0.3)).norm() < 1e-15);
        let back = [Vec3::new(0.2, 0.3, -1.0), Vec3::new(0.2, 0.3, 3.0)];
        assert_eq!(first_crossing(&back, &RIGHT, &RIGHT, Crossings::Any).unwrap().side, Side::Back);
        assert!(first_crossing(&back, &RIGHT, &RIGHT, Crossings::Entering).is_none());
        let beside = [Vec3::new(0.7, 0.7, 3.0), Vec3::new(0.7, 0.7, -1.0)];
        assert!(first_crossing(&beside, &RIGHT, &RIGHT, Crossings::Any).is_none());
    }

    #[test]
    fn motion_shared_by_point_and_triangle_changes_nothing() {
        let flight = Vec3::new(40.0, -20.0, 5.0); // a fast limb seen over one second
        let point = [Vec3::new(0.2, 0.3, 0.1), Vec3::new(0.2, 0.3, -0.3) + flight];
        let hit = first_crossing(&point, &RIGHT, &moved(&RIGHT, flight), Crossings::Entering).unwrap();
        assert!((hit.fraction - 0.25).abs() < 1e-13);
    }

    #[test]
    fn of_several_crossings_the_first_wanted_one_is_given() {
        // Random motions, those kept whose f changes its sign at least twice; dense sampling is the judge.
        let mut random = SplitMix64::new(21);
        let mut seen = 0;
        for _ in 0..200_000 {
            let start = [random.vector(), random.vector(), random.vector()];
            let end = [random.vector(), random.vector(), random.vector()];
            let point = [random.vector() * 0.5, random.vector() * 0.5];
            let volume = Volume::new(&point, &start, &end);
            let samples: Vec<bool> = (0..=400).map(|i| volume.at(f64::from(i) / 400.0).0 >= 0.0).collect();
            if samples.windows(2).filter(|w| w[0] != w[1]).count() < 2 {
                continue;
            }
            seen += 1;
            let inside = |i: usize| {
                let found = closest_at((i as f64 + 0.5) / 400.0, &point, &start, &end);
                found.weights.iter().all(|&w| w > 0.02) && found.distance_squared.sqrt() < 0.05
            };
            let certain = (0..400).find(|&i| samples[i] && !samples[i + 1] && inside(i));
            if let Some(i) = certain {
                let hit = first_crossing(&point, &start, &end, Crossings::Entering).expect("a sampled crossing");
                assert!(hit.fraction <= (i as f64 + 1.0) / 400.0 + 1e-12);
                assert!(volume.at(hit.fraction).0.abs() < 1e-12);
            }
        }
        assert!(seen > 500, "{seen}");
    }

    #[test]
    fn a_point_that_starts_on_the_surface_and_sinks_is_caught_at_once() {
        for height in [0.0, 1e-18, -1e-18] {
            let point = [Vec3::new(0.2, 0.3, height), Vec3::new(0.2, 0.3, -1e-3)];
            let hit = first_crossing(&point, &RIGHT, &RIGHT, Crossings::Entering).unwrap();
            assert!(hit.fraction < 1e-12);
        }
    }

    #[test]
    fn a_chain_of_steps_reports_a_sinking_point_exactly_once_or_at_a_joint_twice() {
        let mut random = SplitMix64::new(22);
        for _ in 0..2000 {
            let t = [random.vector(), random.vector(), random.vector()];
            let through = t[0] * 0.3 + t[1] * 0.4 + t[2] * 0.3;
            let normal = (t[1] - t[0]).cross(&(t[2] - t[0])).normalize();
            // The middle joint lies on the surface up to rounding, on a side nobody chose.
            let chain = [through + normal * 0.3, through + normal * 0.1, through, through - normal * 0.1];
            let crossings = chain
                .windows(2)
                .filter(|w| first_crossing(&[w[0], w[1]], &t, &t, Crossings::Entering).is_some())
                .count();
            assert!((1..=2).contains(&crossings), "{crossings}");
        }
    }

    #[test]
    fn paths_through_the_edges_and_corners_of_a_fan_leave_no_slit() {
        let mut random = SplitMix64::new(23);
        let hub = Vec3::new(0.01, 0.02, 0.3);
        let turn = |k: i32| {
            let (sin, cos) = (std::f64::consts::TAU * f64::from(k) / 7.0).sin_cos();
            Vec3::new(cos, sin, 0.05 * f64::from(k % 2))
        };
        let rim: Vec<Vec3> = (0..7).map(turn).collect();
        let flight = Vec3::new(3.0, -2.0, 10.0);
        for round in 0..5000 {
            let k = round % 7;
            let along = if round % 3 == 0 { 0.0 } else { 0.5 + 0.4 * random.signed() };
            let target = hub + (rim[k] - hub) * along; // on an edge, or the hub itself
            let sideways = Vec3::new(random.signed(), random.signed(), 0.0) * 0.3;
            let from = target + sideways + Vec3::z() * 2.0;
            let to = target - sideways - Vec3::z() * 2.0 + flight;
            let hit = (0..7).any(|i| {
                let t = [hub, rim[i], rim[(i + 1) % 7]];
                first_crossing(&[from, to], &t, &moved(&t, flight), Crossings::Entering).is_some()
            });
            assert!(hit, "round {round}");
        }
    }

    #[test]
    fn triangles_without_area_are_never_crossed_and_never_panic() {
        let line = [Vec3::zeros(), Vec3::x(), Vec3::x() * 2.0];
        let path = [Vec3::new(0.5, 0.0, 1.0), Vec3::new(0.5, 0.0, -1.0)];
        assert!(first_crossing(&path, &line, &line, Crossings::Any).is_none());
        assert!(first_crossing(&path, &[Vec3::zeros(); 3], &[Vec3::x(); 3], Crossings::Any).is_none());
        let mut broken = RIGHT;
        broken[1].x = f64::NAN;
        assert!(first_crossing(&path, &broken, &RIGHT, Crossings::Any).is_none());
    }
}
