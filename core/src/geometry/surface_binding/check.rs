//! Checks for suspicious features of a binding.

use std::collections::{BTreeSet, VecDeque};

use crate::Vec3;
use crate::geometry::distance::closest_on_triangle;

use super::{SurfaceBinding, blended};

/// Neighbours may be bound this many times farther apart than they are, as on the inside of a curve, before anybody looks whether
/// the surface hangs together between them.
const APART: f64 = 2.0;

/// Cap on the length of a path over a curved surface, as a multiple of the straight line.
const DETOUR: f64 = 2.0;

impl SurfaceBinding {
    /// Finds, among `edges` between two bound points, the edges whose ends are bound to different layers of the
    /// surface: no path over the surface joins the two places within reach. `points` are the bound points at
    /// rest [m].
    pub fn torn(&self, points: &[Vec3], edges: impl Iterator<Item = [u32; 2]>) -> Vec<[u32; 2]> {
        edges.filter(|edge| self.is_torn(points, *edge)).collect()
    }

    /// Share of the area of `triangles` of bound points, at rest, that faces against the surface that it is bound to.
    pub fn facing_against(&self, points: &[Vec3], triangles: &[[u32; 3]]) -> f64 {
        let mut areas = [0.0; 2];
        for corners in triangles {
            let [a, b, c] = corners.map(|p| points[p as usize]);
            let normal = (b - a).cross(&(c - a));
            let surface = self.frames.rest_normal(self.points[corners[0] as usize].triangle);
            areas[usize::from(normal.dot(&surface) < 0.0)] += normal.norm();
        }
        areas[1] / (areas[0] + areas[1]).max(f64::MIN_POSITIVE)
    }

    fn is_torn(&self, points: &[Vec3], edge: [u32; 2]) -> bool {
        let [a, b] = edge.map(|point| self.points[point as usize]);
        if a.triangle == b.triangle || self.frames.neighbours(a.triangle).any(|t| t == b.triangle) {
            return false;
        }
        let [from, to] =
            [a, b].map(|end| blended(&self.rest, self.frames.triangles[end.triangle as usize], end.weights));
        let length = (points[edge[0] as usize] - points[edge[1] as usize]).norm();
        let same_side = self.frames.rest_normal(a.triangle).dot(&self.frames.rest_normal(b.triangle)) > 0.0;
        if same_side && (from - to).norm() <= APART * length {
            return false;
        }
        let reach = DETOUR * (length + a.offset.norm() + b.offset.norm());
        let within = |t: u32| {
            let corners = self.frames.triangles[t as usize].map(|v| self.rest[v as usize]);
            closest_on_triangle(&from, &corners).distance_squared <= reach * reach
        };
        let (mut seen, mut waiting) = (BTreeSet::from([a.triangle]), VecDeque::from([a.triangle]));
        while let Some(triangle) = waiting.pop_front() {
            for next in self.frames.neighbours(triangle) {
                if next == b.triangle {
                    return false;
                }
                if within(next) && seen.insert(next) {
                    waiting.push_back(next);
                }
            }
        }
        true
    }
}
