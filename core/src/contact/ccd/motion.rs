//! Four corners that move linearly, and proofs that their convex hull stays away from the origin.
//!
//! # Rounding
//!
//! With u = 2⁻⁵³ and M the largest component of all corners at both ends (and the gap), to first order in u: a corner
//! is a rounded difference of coordinates (relative error u, at most √3 u M as a vector), interpolation in time adds
//! at most 3 √3 u M, a scalar product with a vector of length l at most 3 √3 u M l, mixing two of them 3 √3 u M l,
//! taking away the needed height u M l, the length itself 3 u M l. A crossing time is rounded by 7 u at most, which
//! moves a corner by 14 √3 u M. In all less than 46 u M l plus terms of u². `CCD_ROUNDING` M l covers it with room.

use crate::Vec3;
use crate::contact::ccd::four::{Corners, Four};
use crate::contact::ccd::nearest::{Nearest, unit};
use crate::contact::tolerances::{CCD_LARGEST, CCD_ROUNDING, CCD_SMALLEST};

/// The linear motion of the corners, from time 0 to 1.
pub(super) struct Motion {
    start: Corners,
    end: Corners,
    gap: f64,
    slack: f64,
}

/// Interval of time for which one direction proves the hull apart from the origin.
#[derive(Clone, Copy)]
pub(super) struct Span {
    /// The proof holds from this time on …
    pub(super) from: f64,
    /// … and before this one; infinite if it holds at time 1 too.
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
        let (start, end) = (Corners::new(start), Corners::new(end));
        let size = start.sizes().max(end.sizes()).max(Four::all(gap)).largest();
        if (CCD_SMALLEST..CCD_LARGEST).contains(&size) {
            return Self { start, end, gap, slack: CCD_ROUNDING * size };
        }
        Self::scaled(start, end, gap, size)
    }

    /// The same question at a size whose sixth power is neither too small nor too large for an `f64`.
    #[cold]
    #[inline(never)]
    fn scaled(start: Corners, end: Corners, gap: f64, size: f64) -> Self {
        let mut factor = 1.0;
        while size * factor > 0.0 && size * factor < CCD_SMALLEST {
            factor *= CCD_LARGEST;
        }
        while size.is_finite() && size * factor > CCD_LARGEST {
            factor *= CCD_SMALLEST;
        }
        let [start, end] = [start, end].map(|corners| corners.map(|row| row * factor));
        Self { start, end, gap: gap * factor, slack: CCD_ROUNDING * (size * factor) }
    }

    /// The gap, in the scale of the corners.
    pub(super) fn gap(&self) -> f64 {
        self.gap
    }

    /// Bound on the rounding of a height; directions of shorter vectors are noise.
    pub(super) fn slack(&self) -> f64 {
        self.slack
    }

    /// Height above the origin, per length of the direction, from which on a corner is proven to be farther than the
    /// gap.
    #[inline(always)]
    pub(super) fn needed(&self) -> f64 {
        self.gap + self.slack
    }

    /// The corners at a time in \[0, 1\].
    #[inline(always)]
    pub(super) fn at(&self, time: f64) -> Corners {
        self.start.between(self.end, time)
    }

    /// Does `direction`, of any length, or its opposite prove the hull apart from the origin at all times?
    #[inline(always)]
    pub(super) fn is_apart_along(&self, direction: &Vec3) -> bool {
        let (start, end) = (self.start.along(direction), self.end.along(direction));
        let (least, largest) = (start.min(end).least(), start.max(end).largest());
        let height = if least > -largest { least } else { -largest };
        // Minima pass over what is not a number, the sum does not.
        let ordinary = (start + end).sum().is_finite();
        let needed = self.needed();
        ordinary && height > 0.0 && height * height > needed * needed * direction.norm_squared()
    }

    /// When `direction`, a unit vector, proves the hull farther than the gap from the origin.
    #[inline(always)]
    pub(super) fn span(&self, direction: &Vec3) -> Span {
        let needed = Four::all(self.needed());
        let (start, end) = (self.start.along(direction) - needed, self.end.along(direction) - needed);
        let mut span = Span { from: 0.0, to: f64::INFINITY };
        for k in 0..4 {
            // Written so that what is not a number proves nothing.
            let (from, to) = match (start.0[k] > 0.0, end.0[k] > 0.0) {
                (true, true) => continue,
                (true, false) => (0.0, start.0[k] / (start.0[k] - end.0[k])),
                (false, true) => (start.0[k] / (start.0[k] - end.0[k]), f64::INFINITY),
                (false, false) => (f64::INFINITY, 0.0),
            };
            if !(from >= 0.0 && to >= 0.0) {
                return Span { from: f64::INFINITY, to: 0.0 };
            }
            span = Span { from: span.from.max(from), to: span.to.min(to) };
        }
        span
    }

    /// Returns the displacement in a unit of time of the point with these weights of the corners.
    pub(super) fn motion_of(&self, shares: &[f64; 4]) -> Vec3 {
        (0..4).map(|k| (self.end.corner(k) - self.start.corner(k)) * shares[k]).sum()
    }

    /// Normal of a contact whose closest points coincide: the last proof's direction, else across the primitives, else
    /// against their motion, else any.
    pub(super) fn normal(&self, apart: Option<Vec3>, now: &Nearest) -> Vec3 {
        if let Some(direction) = apart {
            return direction;
        }
        let motion = self.motion_of(&now.shares);
        let across = unit(&now.across);
        if across != Vec3::zeros() {
            return if across.dot(&motion) > 0.0 { -across } else { across };
        }
        let against = unit(&-motion);
        if against == Vec3::zeros() { Vec3::y() } else { against }
    }
}
