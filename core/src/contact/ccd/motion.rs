//! Four corners that move linearly, and proofs that their convex hull stays away from the origin.
//!
//! # Rounding
//!
//! With u = 2⁻⁵³ and M the largest component of all corners at both ends (and the gap): a corner is a rounded difference
//! of coordinates (relative error u, at most √3 u M as a vector), interpolation in time adds at most 3 √3 u M, a scalar
//! product with a vector of length l at most 3 √3 u M l, its comparison u M l. In all less than 14 u M l;
//! a time rounded by u moves a corner by at most 2 √3 u M more. [`CCD_ROUNDING`] u M l covers it with room.

use crate::Vec3;
use crate::contact::tolerances::{CCD_LARGEST, CCD_ROUNDING, CCD_SMALLEST, CCD_TIME_ROUNDING};

/// Components of the four corners: x of all, y of all, z of all.
pub(super) type Corners = [[f64; 4]; 3];

/// The linear motion of the corners, from time 0 to 1.
pub(super) struct Motion {
    start: Corners,
    end: Corners,
    gap: f64,
    slack: f64,
}

/// Open interval of time for which one direction proves the hull apart from the origin; the ends of [0, 1] belong to it
/// where `from` is negative or `to` above 1.
#[derive(Clone, Copy)]
pub(super) struct Span {
    /// The proof holds after this time …
    pub(super) from: f64,
    /// … and before this one.
    pub(super) to: f64,
}

impl Span {
    /// Does the proof hold from `time` on for a while?
    #[inline(always)]
    pub(super) fn covers(&self, time: f64) -> bool {
        self.from <= time && time < self.to
    }
}

impl Motion {
    /// The corners at time 0 and 1 \[m\], and the gap to keep \[m\].
    #[inline(always)]
    pub(super) fn new(start: &[Vec3; 4], end: &[Vec3; 4], gap: f64) -> Self {
        let [start, end] = [start, end].map(|x| [0, 1, 2].map(|i| [0, 1, 2, 3].map(|k| x[k][i])));
        let mut largest = [gap; 4];
        for row in start.iter().chain(&end) {
            for k in 0..4 {
                largest[k] = largest[k].max(row[k].abs());
            }
        }
        let size = largest[0].max(largest[1]).max(largest[2].max(largest[3]));
        if (CCD_SMALLEST..CCD_LARGEST).contains(&size) {
            return Self { start, end, gap, slack: CCD_ROUNDING * size };
        }
        Self::scaled(start, end, gap, size)
    }

    /// The same question at a size whose fourth power is neither too small nor too large for an `f64`.
    #[cold]
    fn scaled(start: Corners, end: Corners, gap: f64, size: f64) -> Self {
        let mut factor = 1.0;
        while size * factor > 0.0 && size * factor < CCD_SMALLEST {
            factor *= CCD_LARGEST;
        }
        while size.is_finite() && size * factor > CCD_LARGEST {
            factor *= CCD_SMALLEST;
        }
        let scale = |x: f64| x * factor;
        let [start, end] = [start, end].map(|corners| corners.map(|row| row.map(scale)));
        Self { start, end, gap: scale(gap), slack: CCD_ROUNDING * scale(size) }
    }

    /// The gap, in the scale of the corners.
    pub(super) fn gap(&self) -> f64 {
        self.gap
    }

    /// Bound on the rounding of a height.
    pub(super) fn slack(&self) -> f64 {
        self.slack
    }

    #[inline(always)]
    pub(super) fn corners_at(&self, time: f64) -> Corners {
        let mut at = self.start;
        for i in 0..3 {
            for k in 0..4 {
                at[i][k] = (1.0 - time) * self.start[i][k] + time * self.end[i][k];
            }
        }
        at
    }

    /// The corners at a time in \[0, 1\].
    #[inline(always)]
    pub(super) fn at(&self, time: f64) -> [Vec3; 4] {
        let [x, y, z] = self.corners_at(time);
        [0, 1, 2, 3].map(|k| Vec3::new(x[k], y[k], z[k]))
    }

    /// When `direction`, a unit vector, proves the hull farther than the gap from the origin.
    #[inline(always)]
    pub(super) fn span(&self, direction: &Vec3) -> Span {
        let least = self.gap + self.slack;
        let (start, end) = (heights(&self.start, direction, least), heights(&self.end, direction, least));
        let mut span = Span { from: 0.0, to: f64::INFINITY };
        for k in 0..4 {
            let crossing = start[k] / (start[k] - end[k]);
            let starts_apart = start[k] > 0.0;
            let ends_apart = end[k] > 0.0;
            let from = if starts_apart {
                0.0
            } else if ends_apart {
                crossing * (1.0 + CCD_TIME_ROUNDING)
            } else {
                f64::INFINITY
            };
            let to = if ends_apart {
                f64::INFINITY
            } else if starts_apart {
                crossing * (1.0 - CCD_TIME_ROUNDING)
            } else {
                0.0
            };
            span.from = span.from.max(from);
            span.to = span.to.min(to);
        }
        span
    }

    /// Distance below which the direction of the closest points is noise.
    pub(super) fn resolution(&self) -> f64 {
        self.slack
    }

    /// Normal of a contact whose closest points coincide: the last proof's direction, else across the primitives, else
    /// against their motion, else any.
    pub(super) fn normal(&self, apart: Option<Vec3>, now: &super::Nearest) -> Vec3 {
        if let Some(direction) = apart {
            return direction;
        }
        let (start, end) = (self.at(0.0), self.at(1.0));
        let motion: Vec3 = (0..4).map(|k| (end[k] - start[k]) * now.shares[k]).sum();
        let across = if now.across.dot(&motion) > 0.0 { -now.across } else { now.across };
        if across != Vec3::zeros() {
            return across;
        }
        (-motion).try_normalize(0.0).unwrap_or(Vec3::y())
    }
}

/// Scalar products of the corners with a direction, less `least`.
#[inline(always)]
pub(super) fn heights(corners: &Corners, direction: &Vec3, least: f64) -> [f64; 4] {
    [0, 1, 2, 3]
        .map(|k| corners[0][k] * direction.x + corners[1][k] * direction.y + corners[2][k] * direction.z - least)
}
