//! Continuous collision detection that misses nothing: point against triangle, edge against edge, points moving linearly.
//!
//! Both cases are one question. The differences between the corners of the first primitive and those of the second span
//! a convex set (a triangle or a parallelogram); the primitives are as far apart as that set is from the origin, and each
//! of its corners moves linearly. A direction in which all corners stay more than the gap ahead of the origin proves that
//! nothing meets for as long as they do ([`motion`]); a direction that turns while time passes proves it also where the
//! primitives rotate closely past each other. The closest points ([`nearest`]) only propose directions: however they are
//! rounded, they cannot make an answer wrong. Time advances from proof to proof until the end is reached (`None`) or the
//! distance is the gap up to rounding ([`Contact`]).
//!
//! This is conservative advancement (Mirtich 1996; Zhang, Lee and Kim 2006) with one linear bound for each corner in place of
//! one bound on the speed. Rounding scales with the distances between the points, not with their distance from the
//! origin: only differences of coordinates are used, each rounded once. Nothing is allocated.
//!
//! Limits: a pair that comes closer to the gap than some hundred roundings may be reported although it never gets there.

mod motion;
mod nearest;
mod turning;

use crate::Vec3;
use crate::contact::tolerances::{CCD_CLOSE_ENOUGH, CCD_ROUNDS, CCD_STALLED};
use motion::Motion;
use nearest::Nearest;
use turning::{reach_across, reach_turning};

/// Where and when two primitives come as close as the gap.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Contact {
    /// Time in \[0, 1\], never later than the truth.
    pub time: f64,
    /// Unit vector from the second primitive to the first at that time. Where they touch, the last direction in which
    /// they were apart; where they touch from the start, the normal of the triangle or of both edges against which they
    /// move.
    pub normal: Vec3,
    /// Signed weights of the four points: their weighted sum at that time is the vector from the closest point of the
    /// second primitive to that of the first. Point and triangle: 1, −wa, −wb, −wc. Edges: 1 − α, α, β − 1, −β.
    pub weights: [f64; 4],
}

/// First contact of a point with a triangle: positions \[m\] of the point and of the three corners at time 0 and 1.
///
/// `None` proves that the distance stays above `gap` \[m\] (zero or more) at every time in \[0, 1\]. A pair that starts
/// within the gap has its contact at time 0. Triangles without area are their edges. Positions that are not finite, or
/// whose differences are not, count as a contact at time 0.
pub fn point_triangle(start: &[Vec3; 4], end: &[Vec3; 4], gap: f64) -> Option<Contact> {
    let corners = |x: &[Vec3; 4]| [x[0] - x[1], x[0] - x[2], x[0] - x[3], x[0] - x[3]];
    first_contact(&Motion::new(&corners(start), &corners(end), gap), nearest::of_triangle)
}

/// First contact of two edges: positions \[m\] of the ends of the first and of the second at time 0 and 1.
///
/// The promises are those of [`point_triangle`]. Edges without length are points.
pub fn edge_edge(start: &[Vec3; 4], end: &[Vec3; 4], gap: f64) -> Option<Contact> {
    let corners = |x: &[Vec3; 4]| [x[0] - x[2], x[0] - x[3], x[1] - x[2], x[1] - x[3]];
    first_contact(&Motion::new(&corners(start), &corners(end), gap), nearest::of_parallelogram)
}

/// Advances from proof to proof. `nearest` finds the closest points of the corners' convex set to the origin.
#[inline(always)]
fn first_contact(motion: &Motion, nearest: impl Fn(&[Vec3; 4]) -> Nearest) -> Option<Contact> {
    let now = nearest(&motion.at(0.0));
    let span = motion.span(&now.direction);
    if span.covers(0.0) && span.covers(1.0) {
        return None;
    }
    advance(motion, now, &nearest)
}

/// The same for what one direction does not prove apart. `now` is what is closest at time 0.
#[inline(never)]
fn advance(motion: &Motion, mut now: Nearest, nearest: &impl Fn(&[Vec3; 4]) -> Nearest) -> Option<Contact> {
    // What is proven from the end backwards need not be proven again.
    let last = nearest(&motion.at(1.0));
    let tail = motion.span(&last.direction);
    let proven_from = if tail.covers(1.0) { tail.from } else { f64::INFINITY };
    let until = proven_from.min(1.0);
    let mut time = 0.0;
    let mut before: Option<(f64, Vec3)> = None;
    let mut apart = None;
    for _ in 0..CCD_ROUNDS {
        if std::env::var("DBG").is_ok() { eprintln!("t {time:e} d {:e} n {:?} a {:?} w {:?}", now.distance, now.direction, now.across, now.weights); }
        let mut direction = now.direction;
        let mut span = motion.span(&direction);
        if !span.covers(time) {
            for other in [now.across, -now.across] {
                let proof = motion.span(&other);
                if proof.covers(time) {
                    (direction, span) = (other, proof);
                }
            }
        }
        if !span.covers(time) {
            break;
        }
        apart = Some(direction);
        let mut next = span.to;
        if next < until && proven_from < f64::INFINITY {
            let turn = (last.direction - direction) / (1.0 - time);
            next = next.max(reach_turning(motion, time, &direction, &turn, until));
        }
        if let (true, Some((earlier, from))) = (next < until, before) {
            let turn = (direction - from) / (time - earlier);
            next = next.max(reach_turning(motion, time, &direction, &turn, until));
        }
        if next < until {
            next = next.max(reach_across(motion, time, &direction, until));
        }
        if next >= proven_from || next > 1.0 {
            return None;
        }
        if now.distance <= motion.gap() + motion.slack() + CCD_CLOSE_ENOUGH * motion.gap() && next - time < CCD_STALLED
        {
            break;
        }
        before = Some((time, direction));
        time = next;
        now = nearest(&motion.at(time));
    }
    let normal = if now.distance > motion.resolution() { now.direction } else { motion.normal(apart, &now) };
    // Only what was not finite to begin with has such weights.
    let weights = now.weights.map(|weight| if weight.is_finite() { weight } else { 0.0 });
    Some(Contact { time, normal, weights })
}
