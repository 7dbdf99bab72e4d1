//! Triangles around a place, among which places near it find the closest one without a search of the tree.
//!
//! A neighbourhood outlives steps: the surface around it moves nearly as one piece between two samples, and a vertex in contact goes with
//! it. The margin of a neighbourhood is used up by motion relative to that piece alone.

use super::{MovingSurface, SurfacePoint};
use crate::Vec3;
use crate::geometry::distance::closest_on_triangle;

/// Triangles that a neighbourhood holds at most.
const CAPACITY: usize = 12;

/// Share of the margin that is left to the rounding of distances.
const LEFT_TO_ROUNDING: f64 = 0.01;

/// Every triangle of a surface that came within a radius of a place at some time between two samples.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Neighbourhood {
    /// Number of the interval between samples; 0 for none.
    interval: u64,
    centre: Vec3,
    /// Time since the first sample [s].
    pub(super) time: f64,
    /// No other point of the surface was closer to the centre [m].
    radius: f64,
    /// Velocity of the surface around [m/s], and largest difference from it of the points within `reach` [m].
    velocity: Vec3,
    spread: f64,
    reach: f64,
    count: u32,
    /// These triangles, the closest first, and bounds from below on their distances from the centre [m].
    triangles: [u32; CAPACITY],
    distances: [f32; CAPACITY],
}

/// Triangles met on the way to the closest one, those that a neighbourhood needs.
struct Collector {
    margin: f64,
    /// Squares of the smallest distance so far, and of the distance up to which triangles are kept [m²].
    nearest: f64,
    limit: f64,
    count: usize,
    found: [(u32, f64); CAPACITY],
    is_crowded: bool,
}

impl Neighbourhood {
    /// One that holds no place.
    pub(crate) const NONE: Self = Self {
        interval: 0,
        centre: Vec3::new(0.0, 0.0, 0.0),
        time: 0.0,
        radius: 0.0,
        velocity: Vec3::new(0.0, 0.0, 0.0),
        spread: 0.0,
        reach: 0.0,
        count: 0,
        triangles: [0; CAPACITY],
        distances: [0.0; CAPACITY],
    };
}

impl Collector {
    fn new(max_distance: f64, margin: f64) -> Self {
        let nearest = max_distance * max_distance;
        let limit = (max_distance + margin).powi(2);
        Self { margin, nearest, limit, count: 0, found: [(0, 0.0); CAPACITY], is_crowded: false }
    }

    fn meet(&mut self, triangle: u32, distance_squared: f64) {
        if distance_squared < self.nearest {
            self.nearest = distance_squared;
            self.limit = (distance_squared.sqrt() + self.margin).powi(2);
        }
        let is_known = || self.found[..self.count].iter().any(|(known, _)| *known == triangle);
        if distance_squared > self.limit || self.is_crowded || is_known() {
            return;
        }
        if self.count == CAPACITY {
            self.drop_far();
        }
        self.is_crowded = self.count == CAPACITY;
        if !self.is_crowded {
            self.found[self.count] = (triangle, distance_squared);
            self.count += 1;
        }
    }

    /// Drops triangles beyond the limit, which has become smaller.
    fn drop_far(&mut self) {
        let mut kept = 0;
        for i in 0..self.count {
            if self.found[i].1 <= self.limit {
                self.found[kept] = self.found[i];
                kept += 1;
            }
        }
        self.count = kept;
    }
}

impl MovingSurface {
    /// The same as [`MovingSurface::closest`], and the triangles that are up to `margin` [m] farther from the point than the closest
    /// one; [`Neighbourhood::NONE`] if they are too many.
    pub(crate) fn closest_and_around(
        &self,
        point: &Vec3,
        max_distance: f64,
        hint: Option<u32>,
        margin: f64,
    ) -> (Option<SurfacePoint>, Neighbourhood) {
        let mut collector = Collector::new(max_distance, margin);
        let distance_squared = |triangle| {
            let distance = self.distance_squared(point, triangle);
            collector.meet(triangle, distance);
            distance
        };
        let found = self.tree.nearest_around(point, max_distance, self.existing(hint), margin, distance_squared);
        let found = found.map(|(triangle, _)| self.surface_point(point, triangle));
        if collector.is_crowded {
            return (found, Neighbourhood::NONE);
        }
        collector.drop_far();
        collector.found[..collector.count]
            .sort_unstable_by(|a, b| (a.1, a.0).partial_cmp(&(b.1, b.0)).expect("distances are finite"));
        let left = margin * LEFT_TO_ROUNDING;
        let motion = self.motion.around(point);
        let around = Neighbourhood {
            interval: self.interval,
            centre: *point,
            time: self.end,
            radius: collector.nearest.sqrt() + margin - left,
            velocity: motion.velocity,
            spread: motion.spread,
            reach: motion.reach * (1.0 - LEFT_TO_ROUNDING),
            count: collector.count as u32,
            triangles: collector.found.map(|(triangle, _)| triangle),
            distances: collector.found.map(|(_, distance_squared)| (distance_squared.sqrt() - left) as f32),
        };
        (found, around)
    }

    /// The answer of [`MovingSurface::closest`] if a neighbourhood holds it, as it does near its place for some time.
    #[inline]
    pub(crate) fn closest_among(
        &self,
        around: &Neighbourhood,
        point: &Vec3,
        max_distance: f64,
    ) -> Option<Option<SurfacePoint>> {
        if around.interval != self.interval {
            return None;
        }
        // A point of another triangle was farther than the radius, and has approached with the spread at most; or it was
        // farther than the reach, and moves as fast as any.
        let (moved, elapsed) = (point - around.centre, self.end - around.time);
        let drift = (moved - around.velocity * elapsed).norm() + around.spread * elapsed.abs();
        let from_afar = around.reach - moved.norm() - self.motion.fastest() * elapsed.abs();
        let others = (around.radius - drift).min(from_afar);
        if others <= 0.0 {
            return None;
        }
        let mut best = (max_distance * max_distance, u32::MAX);
        let triangles = around.triangles.iter().zip(&around.distances).take(around.count as usize);
        for (&triangle, &at_first) in triangles {
            let least = f64::from(at_first) - drift;
            if least > 0.0 && least * least > best.0 {
                break;
            }
            let distance = self.distance_squared(point, triangle);
            if (distance, triangle) < best {
                best = (distance, triangle);
            }
        }
        let holds = best.0 <= others * others;
        holds.then(|| (best.1 != u32::MAX).then(|| self.surface_point(point, best.1)))
    }

    #[inline]
    pub(super) fn distance_squared(&self, point: &Vec3, triangle: u32) -> f64 {
        closest_on_triangle(point, &self.corners(&self.positions[1], triangle)).distance_squared
    }
}
