//! Proofs by directions that turn while time passes: what rotates closely past something else needs few of them.
//!
//! A direction is a quadratic in time with three control vectors, so the height of a corner along it is a cubic. A
//! cubic stays above zero where its control polygon does, and the direction is never longer than the longest control
//! vector.

use crate::Vec3;
use crate::contact::ccd::four::{Corners, Four};
use crate::contact::ccd::motion::Motion;

/// Proof by a direction in an interval.
struct Proof {
    /// Share of the interval for which the proof holds; 1 includes its end.
    share: f64,
    /// About where the first height is zero, as a share of the interval; a guess.
    first_root: f64,
}

/// Until when, at most `until`, the direction across the side between two corners, in the plane that it spans with
/// `direction` at `time`, proves the corners of `motion` farther than the gap from the origin.
pub(super) fn reach_beside(motion: &Motion, time: f64, direction: &Vec3, side: [usize; 2], until: f64) -> f64 {
    let along = |corners: &Corners| corners.corner(side[1]) - corners.corner(side[0]);
    reach(motion, time, until, |now, then| {
        let plane = direction.cross(&along(now));
        let (first, last) = (along(now).cross(&plane), along(then).cross(&plane));
        [first, (first + last) * 0.5, last]
    })
}

/// The same for the direction across the triangle or both edges, on the side of `direction`.
pub(super) fn reach_across(motion: &Motion, time: f64, direction: &Vec3, until: f64) -> f64 {
    let sides = |c: &Corners| [c.corner(1) - c.corner(0), c.corner(2) - c.corner(0)];
    reach(motion, time, until, |now, then| {
        let ([u, v], [u_then, v_then]) = (sides(now), sides(then));
        let first = u.cross(&v);
        let sign = if first.dot(direction) < 0.0 { -1.0 } else { 1.0 };
        let middle = (u.cross(&v_then) + u_then.cross(&v)) * 0.5;
        [first * sign, middle * sign, u_then.cross(&v_then) * sign]
    })
}

/// Reach of the directions with the control vectors `turning(corners at time, corners at to)`.
///
/// A turn that is good for a while is not for long: the second try ends where the first seems to fail.
#[inline(always)]
fn reach(motion: &Motion, time: f64, until: f64, turning: impl Fn(&Corners, &Corners) -> [Vec3; 3]) -> f64 {
    let now = motion.at(time);
    let proof = |to: f64| {
        let then = motion.at(to);
        let proof = prove(motion, &now, &then, &turning(&now, &then));
        (if proof.share >= 1.0 { to } else { time + proof.share * (to - time) }, proof.first_root)
    };
    let (reached, first_root) = proof(until);
    let near = time + first_root * (until - time);
    if reached < near && near < until { reached.max(proof(near).0) } else { reached }
}

/// Returns the proof by a direction with the control vectors `n` between the corners `x` and `y`.
#[inline(always)]
fn prove(motion: &Motion, x: &Corners, y: &Corners, n: &[Vec3; 3]) -> Proof {
    let lengths = [n[0].norm(), n[1].norm(), n[2].norm()];
    let needed = motion.needed() * lengths[0].max(lengths[1]).max(lengths[2]);
    let above = |corners: &Corners, i: usize| corners.along(&n[i]) - Four::all(needed);
    let (first, last) = (above(x, 0), above(y, 2));
    let second = (above(x, 1) * 2.0 + above(y, 0)) * (1.0 / 3.0);
    let third = (above(x, 2) + above(y, 1) * 2.0) * (1.0 / 3.0);
    let mut proof = Proof { share: 1.0, first_root: f64::INFINITY };
    for k in 0..4 {
        let control = [first.0[k], second.0[k], third.0[k], last.0[k]];
        proof.share = proof.share.min(positive_until(&control));
        // The quadratic with the same value and slope at the start and the same value at the end, above what is
        // needed there.
        let [height, slope] = [control[0] + needed - motion.needed() * lengths[0], 3.0 * (control[1] - control[0])];
        let bend = control[3] + needed - motion.needed() * lengths[2] - height - slope;
        let root = 2.0 * height / ((slope * slope - 4.0 * bend * height).sqrt() - slope);
        if root > 0.0 {
            proof.first_root = proof.first_root.min(root);
        }
    }
    proof
}

/// Until which share of the time a cubic with these Bernstein coefficients is proven positive; 1 includes the end.
///
/// The hull of its control polygon first meets zero between a positive and a later coefficient.
#[inline(always)]
fn positive_until(control: &[f64; 4]) -> f64 {
    // Written so that what is not a number proves nothing.
    if control.iter().all(|&c| c > 0.0) {
        return 1.0;
    }
    if !(control[0] > 0.0 && control.iter().sum::<f64>().is_finite()) {
        return 0.0;
    }
    let mut until = 1.0_f64;
    for j in 1..4 {
        for i in 0..j {
            if control[i] > 0.0 && control[j] <= 0.0 {
                let crossing = i as f64 + (j - i) as f64 * (control[i] / (control[i] - control[j]));
                until = until.min(crossing / 3.0);
            }
        }
    }
    until
}
