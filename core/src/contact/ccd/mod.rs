//! Continuous collision detection that misses nothing: point against triangle, edge against edge, points moving
//! linearly.
//!
//! Both cases are one question. The differences between the corners of the first primitive and those of the second
//! span a convex set (a triangle or a parallelogram); the primitives are as far apart as that set is from the origin,
//! and each of its corners moves linearly. A direction along which all corners stay higher than the gap proves that
//! nothing meets for as long as they do ([`motion`]); a direction that turns with a side or with the normal of the
//! set proves it also where the primitives rotate closely past each other ([`turning`]). The closest points
//! ([`nearest`]) only propose directions: however they are rounded, they cannot make an answer wrong. Time advances
//! from proof to proof until the end is reached (`None`) or the distance is the gap ([`Contact`]).
//!
//! This is conservative advancement (Mirtich 1996; Zhang, Lee and Kim 2006) with one linear bound for each corner in
//! place of one bound on the speed. Rounding scales with the distances between the points, not with their distance
//! from the origin: only differences of coordinates are used, each rounded once. Nothing is allocated. An ordinary
//! miss is proven by one of three directions without search.
//!
//! Limits: a pair that comes within a thousandth of the gap, or some hundred roundings, of its gap may be reported
//! although it stays above it.

mod four;
mod motion;
mod nearest;
mod turning;

use crate::Vec3;
use crate::contact::tolerances::{CCD_CLOSE_ENOUGH, CCD_ROUNDS};
use motion::Motion;
use nearest::{Nearest, unit};
use turning::{reach_across, reach_beside};

/// Time and place at which two primitives come as close as the gap.
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
    // Two cheap guesses first: most pairs that a tree finds are apart along one of them.
    let middle = motion.at(0.5).all();
    let mean = middle[0] + middle[1] + middle[2] + middle[3];
    let across = (middle[1] - middle[0]).cross(&(middle[2] - middle[0]));
    if motion.is_apart_along(&mean) || motion.is_apart_along(&across) {
        return None;
    }
    let now = nearest(&motion.at(0.0).all());
    if motion.is_apart_along(&now.direction) {
        return None;
    }
    advance(motion, now, &nearest)
}

/// The same for what one direction does not prove apart. `now` is what is closest at time 0.
#[inline(never)]
fn advance(motion: &Motion, mut now: Nearest, nearest: &impl Fn(&[Vec3; 4]) -> Nearest) -> Option<Contact> {
    // What is proven from the end backwards need not be proven again.
    let last = nearest(&motion.at(1.0).all());
    let tail = motion.span(&last.direction);
    let proven_from = if tail.covers(1.0) { tail.from } else { f64::INFINITY };
    let until = proven_from.min(1.0);
    let mut time = 0.0;
    let mut apart = None;
    for _ in 0..CCD_ROUNDS {
        let mut direction = now.direction;
        let mut span = motion.span(&direction);
        if !span.covers(time) {
            let across = unit(&now.across);
            for other in [across, -across] {
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
        if next < until {
            next = next.max(match now.side {
                Some(side) => reach_beside(motion, time, &direction, side, until),
                None => reach_across(motion, time, &direction, until),
            });
        }
        if next >= proven_from || next > 1.0 {
            return None;
        }
        // What parts from nearly the gap is no contact.
        let near = now.distance <= motion.gap() * (1.0 + CCD_CLOSE_ENOUGH) + motion.slack();
        if near && motion.motion_of(&now.shares).dot(&now.direction) < 0.0 {
            break;
        }
        time = next;
        now = nearest(&motion.at(time).all());
    }
    let directed = now.distance > motion.slack() && now.direction != Vec3::zeros();
    let normal = if directed { now.direction } else { motion.normal(apart, &now) };
    // Only what was not finite to begin with has such weights.
    let weights = now.weights.map(|weight| if weight.is_finite() { weight } else { 0.0 });
    Some(Contact { time, normal, weights })
}
