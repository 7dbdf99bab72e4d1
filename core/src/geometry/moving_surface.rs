//! An animated triangle mesh as a collision body: its vertices move straight from one sample to the next.
//!
//! Two samples are given with [`MovingSurface::set_samples`]; every time step between them calls
//! [`MovingSurface::set_step`] once and then asks, from any thread, for the closest point with its signed distance, for
//! the velocity of a surface point, and for the place where the path of a cloth node passes through. Triangles turn
//! counter-clockwise seen from outside.
//!
//! The sign comes from the angle-weighted pseudo-normal of the closest vertex, edge or face (Bærentzen and Aanæs 2005),
//! which is exact for a closed surface that does not cross itself. Where it does, see
//! [`self_crossing`]. A closed surface that turns inside out goes on with its sides exchanged. Vertices that coincide but
//! are not shared leave a border in the mesh: weld them first, or the sign beside such a seam may be wrong.

mod motion_grid;
mod neighbourhood;

use rayon::prelude::*;
use thiserror::Error;

use crate::Vec3;
use crate::geometry::aabb::Aabb;
use crate::geometry::bvh::Bvh;
use crate::geometry::distance::{TriangleFeature, closest_on_triangle};
use crate::geometry::path::{Crossings, Side, first_crossing};
use crate::geometry::self_crossing::{self, SelfCrossing};
use crate::geometry::tolerances;
use crate::mesh::unpaired_edges;

pub(crate) use neighbourhood::Neighbourhood;

use motion_grid::MotionGrid;

/// Vertices one task moves at least.
const MOVE_CHUNK: usize = 8192;

/// Windows into which the interval between two samples is divided. The tree holds the paths of the triangles during a window, so
/// that short steps share a refit. Changes time only, never an answer:
/// `every_answer_is_the_one_of_all_triangles_however_steps_lie_in_the_interval`.
const WINDOWS: f64 = 16.0;

/// A window that holds no step.
const NO_WINDOW: [f64; 2] = [f64::INFINITY, f64::NEG_INFINITY];

/// Why a mesh cannot be a body.
#[derive(Debug, Clone, PartialEq, Error)]
pub(crate) enum SurfaceError {
    /// There is nothing to collide with.
    #[error("the body has no triangles\n  help: give a mesh with faces, or leave the body out")]
    NoTriangles,
    /// A triangle names a point that does not exist.
    #[error(
        "triangle {triangle} uses point {point}, but the body has {point_count} points\n  help: export the mesh again"
    )]
    PointOutOfRange {
        /// Index of the triangle.
        triangle: usize,
        /// The index it holds.
        point: u32,
        /// Points there are.
        point_count: usize,
    },
    /// A sample of another mesh.
    #[error(
        "the sample at {time} s has {found} points, the body has {expected}\n  \
         help: the number of points must not change during a shot"
    )]
    PointCount {
        /// Time of the sample \[s\].
        time: f64,
        /// Points of the body.
        expected: usize,
        /// Points of the sample.
        found: usize,
    },
    /// A coordinate that is no number.
    #[error("point {point} of the sample at {time} s is not finite\n  help: check the deformers in that frame")]
    NotFinite {
        /// Time of the sample \[s\].
        time: f64,
        /// Index of the point.
        point: usize,
    },
    /// The second sample lies before the first.
    #[error("the samples at {time_a} s and {time_b} s are in the wrong order\n  help: give the earlier one first")]
    Times {
        /// Time of the first sample \[s\].
        time_a: f64,
        /// Time of the second sample \[s\].
        time_b: f64,
    },
}

/// The point of a surface closest to a query point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct SurfacePoint {
    /// The triangle it lies on; the lowest index if several share it.
    pub triangle: u32,
    /// Barycentric weights in that triangle.
    pub weights: [f64; 3],
    /// The point at the end of the step \[m\].
    pub point: Vec3,
    /// Unit angle-weighted pseudo-normal of the vertex, edge or face it lies on.
    pub normal: Vec3,
    /// Signed distance from the surface to the query point \[m\], negative inside.
    pub distance: f64,
}

impl SurfacePoint {
    /// Unit gradient of the signed distance at the query point: the direction to it from the surface, outwards. Equals
    /// `normal` on a face; beside an edge or vertex it turns with the query point. Falls back to `normal` where
    /// rounding leaves no direction.
    pub(crate) fn gradient(&self, query: &Vec3) -> Vec3 {
        if self.distance.abs() <= tolerances::DIRECTION * query.amax() {
            return self.normal;
        }
        ((query - self.point) * self.distance.signum()).try_normalize(0.0).unwrap_or(self.normal)
    }
}

/// Crossing of the path of a node with the moving surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct PathHit {
    /// The triangle; the lowest index if several are met at the same time.
    pub triangle: u32,
    /// Barycentric weights in that triangle.
    pub weights: [f64; 3],
    /// Fraction of the step, in \[0, 1\].
    pub fraction: f64,
    /// The side the node came from.
    pub side: Side,
}

/// A triangle mesh between two samples.
#[derive(Clone, Debug)]
pub(crate) struct MovingSurface {
    triangles: Vec<[u32; 3]>,
    /// Triangles around vertex v: `stars[star_starts[v]..star_starts[v + 1]]`, ascending.
    star_starts: Vec<u32>,
    stars: Vec<u32>,
    closed: bool,
    /// Whether its triangles face what they enclose, as those of a room do.
    faces_inwards: bool,
    /// Whether it is inside out at the two samples, and at the end of the step.
    turned_at: [bool; 2],
    turned: bool,
    times: [f64; 2],
    samples: [Vec<Vec3>; 2],
    /// Positions at the start and the end of the step.
    positions: [Vec<Vec3>; 2],
    /// Boxes around the paths of the vertices during the window, and the tree of the triangles over these.
    vertex_boxes: Vec<Aabb>,
    tree: Bvh,
    /// The window: fractions of the interval between the samples, empty before the first refit to these.
    window: [f64; 2],
    built_cost: f64,
    /// Number of the interval between samples, from 1 on, and the motion within it.
    interval: u64,
    motion: MotionGrid,
    /// End of the step, since the first sample [s].
    end: f64,
}

impl MovingSurface {
    /// A surface without positions: no query finds anything before the first samples.
    pub(crate) fn new(triangles: Vec<[u32; 3]>, point_count: usize) -> Result<MovingSurface, SurfaceError> {
        if triangles.is_empty() {
            return Err(SurfaceError::NoTriangles);
        }
        for (triangle, corners) in triangles.iter().enumerate() {
            if let Some(&point) = corners.iter().find(|&&v| v as usize >= point_count) {
                return Err(SurfaceError::PointOutOfRange { triangle, point, point_count });
            }
        }
        let (star_starts, stars) = vertex_stars(&triangles, point_count);
        let closed = is_closed(&triangles);
        Ok(MovingSurface {
            triangles,
            star_starts,
            stars,
            closed,
            faces_inwards: false,
            turned_at: [false; 2],
            turned: false,
            times: [0.0; 2],
            samples: [vec![Vec3::zeros(); point_count], vec![Vec3::zeros(); point_count]],
            positions: [vec![Vec3::zeros(); point_count], vec![Vec3::zeros(); point_count]],
            vertex_boxes: vec![Aabb::EMPTY; point_count],
            tree: Bvh::build(&[]),
            window: NO_WINDOW,
            built_cost: 0.0,
            interval: 0,
            motion: MotionGrid::default(),
            end: 0.0,
        })
    }

    /// The same surface, whose triangles face what they enclose if `inwards`.
    pub(crate) fn facing(self, inwards: bool) -> Self {
        Self { faces_inwards: inwards, ..self }
    }

    /// The two samples that the following steps lie between, times in s, positions in m; equal times mean a body at
    /// rest. The step is then the whole interval.
    pub(crate) fn set_samples(&mut self, time_a: f64, a: &[Vec3], time_b: f64, b: &[Vec3]) -> Result<(), SurfaceError> {
        if time_a.partial_cmp(&time_b).is_none_or(std::cmp::Ordering::is_gt) {
            return Err(SurfaceError::Times { time_a, time_b });
        }
        for (time, sample) in [(time_a, a), (time_b, b)] {
            let expected = self.vertex_boxes.len();
            if sample.len() != expected {
                return Err(SurfaceError::PointCount { time, expected, found: sample.len() });
            }
            if let Some(point) = sample.iter().position(|p| !p.iter().all(|c| c.is_finite())) {
                return Err(SurfaceError::NotFinite { time, point });
            }
        }
        // Mostly the earlier sample is the one that was the later one before.
        let turned_a = if a == self.samples[1] { self.turned_at[1] } else { self.is_turned_at(a) };
        self.turned_at = [turned_a, self.is_turned_at(b)];
        self.times = [time_a, time_b];
        self.samples[0].copy_from_slice(a);
        self.samples[1].copy_from_slice(b);
        self.interval += 1;
        self.motion.set(&self.triangles, [a, b], time_b - time_a);
        self.window = NO_WINDOW;
        self.set_step(time_b, time_b);
        if self.tree.is_empty() || self.tree.cost() > tolerances::REBUILD_COST * self.built_cost {
            self.tree =
                Bvh::build(&self.triangles.iter().map(|t| triangle_box(t, &self.vertex_boxes)).collect::<Vec<_>>());
            self.built_cost = self.tree.cost();
        }
        self.set_step(time_a, time_b);
        Ok(())
    }

    /// Moves the surface to a step from `t0` to `t1` \[s\] between the samples (times outside are clamped). Closest
    /// points are then those at `t1`, paths those from `t0` to `t1`. Allocates nothing.
    pub(crate) fn set_step(&mut self, t0: f64, t1: f64) {
        let shares = [self.share_of(t0), self.share_of(t1)];
        self.end = shares[1] * (self.times[1] - self.times[0]);
        let [a, b] = &self.samples;
        let [start, end] = &mut self.positions;
        let targets = start.par_iter_mut().zip(end.par_iter_mut());
        let sources = a.par_iter().zip(b.par_iter());
        targets.zip(sources).with_min_len(MOVE_CHUNK).for_each(|((x0, x1), (a, b))| {
            *x0 = between(a, b, shares[0]);
            *x1 = between(a, b, shares[1]);
        });
        let [at_a, at_b] = self.turned_at;
        let turned = if at_a == at_b { at_a } else { self.is_turned_at(&self.positions[1]) };
        if turned != self.turned {
            self.turned = turned;
            self.triangles.par_iter_mut().for_each(|corners| corners.swap(1, 2));
        }
        self.cover(shares);
    }

    /// Moves the tree to the window in which a step begins, extended to the end of the step, unless it is there. Boxes of the ends of
    /// a straight path hold all of it, with the rounding of the points between, which is far below the one of a box.
    fn cover(&mut self, step: [f64; 2]) {
        let first = (step[0] * WINDOWS).floor().min(WINDOWS - 1.0);
        let window = [first / WINDOWS, ((first + 1.0) / WINDOWS).max(step[1])];
        if window == self.window {
            return;
        }
        let [a, b] = &self.samples;
        let boxes = self.vertex_boxes.par_iter_mut().zip(a.par_iter().zip(b.par_iter()));
        boxes.with_min_len(MOVE_CHUNK).for_each(|(path, (a, b))| {
            *path = Aabb::of_segment(&between(a, b, window[0]), &between(a, b, window[1]));
        });
        let (triangles, boxes) = (&self.triangles, &self.vertex_boxes);
        self.tree.refit(|t| triangle_box(&triangles[t as usize], boxes));
        self.window = window;
    }

    /// The triangles.
    pub(crate) fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// Positions at the end of the step \[m\].
    pub(crate) fn positions(&self) -> &[Vec3] {
        &self.positions[1]
    }

    /// Positions at the start and at the end of the step \[m\].
    pub(crate) fn path(&self) -> [&[Vec3]; 2] {
        [&self.positions[0], &self.positions[1]]
    }

    /// Adds its positions at a time between the samples to `all` \[m\]; times outside are clamped.
    pub(crate) fn extend_with_positions_at(&self, time: f64, all: &mut Vec<Vec3>) {
        let share = self.share_of(time);
        let [a, b] = &self.samples;
        all.extend(a.iter().zip(b).map(|(a, b)| between(a, b, share)));
    }

    /// Fastest point between the samples [m/s].
    pub(crate) fn fastest(&self) -> f64 {
        self.motion.fastest()
    }

    /// Whether it is inside out at the end of the step, so that its sides are exchanged.
    pub(crate) fn is_turned(&self) -> bool {
        self.turned
    }

    /// Whether the surface, closed and with its points at `positions`, encloses what was outside.
    fn is_turned_at(&self, positions: &[Vec3]) -> bool {
        if !self.closed {
            return false;
        }
        // Turned triangles are those of a surface that faces the other way.
        is_inside_out(&self.triangles, positions, self.faces_inwards != self.turned)
    }

    /// Whether every edge joins two triangles of the same orientation, so that there is an inside.
    pub(crate) fn is_closed(&self) -> bool {
        self.closed
    }

    /// Closest surface point within `max_distance` \[m\] at the end of the step.
    ///
    /// `hint` is a triangle that may be close, such as the answer of the last step: it shortens the search and never
    /// changes its result.
    #[inline]
    pub(crate) fn closest(&self, point: &Vec3, max_distance: f64, hint: Option<u32>) -> Option<SurfacePoint> {
        let distance_squared = |triangle| self.distance_squared(point, triangle);
        let (triangle, _) = self.tree.nearest(point, max_distance, self.existing(hint), distance_squared)?;
        Some(self.surface_point(point, triangle))
    }

    /// A hint, if it is a triangle of the tree.
    fn existing(&self, hint: Option<u32>) -> Option<u32> {
        hint.filter(|&triangle| (triangle as usize) < self.tree.len())
    }

    /// The point of a triangle closest to `point` at the end of the step, of a surface of which no other triangle is closer.
    fn surface_point(&self, point: &Vec3, triangle: u32) -> SurfacePoint {
        let found = closest_on_triangle(point, &self.corners(&self.positions[1], triangle));
        let away = point - found.point;
        let unsigned = found.distance_squared.sqrt();
        let normal = match self.pseudo_normal(triangle, found.feature).try_normalize(0.0) {
            Some(normal) => normal,
            // All triangles around the feature are without area: no side is known, so outside.
            None => away.try_normalize(0.0).unwrap_or_else(Vec3::y),
        };
        let height = away.dot(&normal);
        // In front of a face the height is the distance, and more precise than the length close to the surface.
        let distance = match found.feature {
            TriangleFeature::Face => height,
            _ if height < 0.0 => -unsigned,
            _ => unsigned,
        };
        SurfacePoint { triangle, weights: found.weights, point: found.point, normal, distance }
    }

    /// Velocity of a point of the surface \[m/s\], constant between two samples; zero for a body at rest.
    pub(crate) fn velocity(&self, triangle: u32, weights: [f64; 3]) -> Vec3 {
        let duration = self.times[1] - self.times[0];
        if duration == 0.0 {
            return Vec3::zeros();
        }
        (self.point_of(&self.samples[1], triangle, weights) - self.point_of(&self.samples[0], triangle, weights))
            / duration
    }

    /// A point of the surface \[m\] at a fraction of the step.
    pub(crate) fn point_at(&self, triangle: u32, weights: [f64; 3], fraction: f64) -> Vec3 {
        let ends = [0, 1].map(|k| self.point_of(&self.positions[k], triangle, weights));
        ends[0] * (1.0 - fraction) + ends[1] * fraction
    }

    /// Earliest place where a node that moves straight from `from` at the start of the step to `to` at its end passes
    /// through the surface.
    pub(crate) fn path_hit(&self, from: &Vec3, to: &Vec3, wanted: Crossings) -> Option<PathHit> {
        let [start, end] = &self.positions;
        let path = [*from, *to];
        let mut best: Option<PathHit> = None;
        self.tree.for_each_overlap(&Aabb::of_segment(from, to), |triangle| {
            let (t0, t1) = (self.corners(start, triangle), self.corners(end, triangle));
            let Some(hit) = first_crossing(&path, &t0, &t1, wanted) else {
                return;
            };
            if best.is_none_or(|b| (hit.fraction, triangle) < (b.fraction, b.triangle)) {
                let (weights, fraction, side) = (hit.weights, hit.fraction, hit.side);
                best = Some(PathHit { triangle, weights, fraction, side });
            }
        });
        best
    }

    /// Returns the winding number of the surface around `point` at the end of the step: 0 outside, 1 inside, 2 where
    /// two parts of the body overlap. Meaningless unless [`MovingSurface::is_closed`].
    pub(crate) fn winding_number(&self, point: &Vec3) -> i32 {
        self_crossing::winding_number(&self.triangles, &self.positions[1], &self.tree, point)
    }

    /// Finds the crossings of the surface with itself when its points are at `positions`, one for each point of the
    /// body (a sample, say).
    pub(crate) fn self_crossing(&self, positions: &[Vec3]) -> SelfCrossing {
        let box_of =
            |t: &[u32; 3]| t.iter().fold(Aabb::EMPTY, |b, &v| b.union(&Aabb::of_point(&positions[v as usize])));
        let tree = if self.tree.is_empty() {
            Bvh::build(&self.triangles.iter().map(box_of).collect::<Vec<_>>())
        } else {
            let mut tree = self.tree.clone();
            tree.refit(|t| box_of(&self.triangles[t as usize]));
            tree
        };
        self_crossing::find(&self.triangles, positions, &tree)
    }

    /// Fraction of the way from the first sample to the second.
    fn share_of(&self, time: f64) -> f64 {
        let duration = self.times[1] - self.times[0];
        if duration == 0.0 { 1.0 } else { ((time - self.times[0]) / duration).clamp(0.0, 1.0) }
    }

    #[inline]
    fn corners(&self, x: &[Vec3], triangle: u32) -> [Vec3; 3] {
        self.triangles[triangle as usize].map(|v| x[v as usize])
    }

    fn point_of(&self, x: &[Vec3], triangle: u32, weights: [f64; 3]) -> Vec3 {
        let corners = self.corners(x, triangle);
        corners[0] * weights[0] + corners[1] * weights[1] + corners[2] * weights[2]
    }

    fn star(&self, vertex: u32) -> &[u32] {
        &self.stars[self.star_starts[vertex as usize] as usize..self.star_starts[vertex as usize + 1] as usize]
    }

    /// Angle-weighted pseudo-normal, not normalised: the face normal, the sum over the triangles of an edge, or over
    /// those of a vertex weighted with their angles. Computed where it is asked for: a step has far fewer contacts than
    /// the body has vertices.
    fn pseudo_normal(&self, triangle: u32, feature: TriangleFeature) -> Vec3 {
        let corners = &self.triangles[triangle as usize];
        match feature {
            TriangleFeature::Face => self.unit_normal(triangle),
            TriangleFeature::Edge(i) => {
                let (a, b) = (corners[i as usize], corners[(i as usize + 1) % 3]);
                let around = self.star(a).iter().filter(|&&t| self.triangles[t as usize].contains(&b));
                around.map(|&t| self.unit_normal(t)).sum()
            }
            TriangleFeature::Vertex(i) => {
                let vertex = corners[i as usize];
                self.star(vertex).iter().map(|&t| self.unit_normal(t) * self.angle_at(t, vertex)).sum()
            }
        }
    }

    /// Zero for a triangle without area.
    fn unit_normal(&self, triangle: u32) -> Vec3 {
        let [a, b, c] = self.corners(&self.positions[1], triangle);
        (b - a).cross(&(c - a)).try_normalize(0.0).unwrap_or_else(Vec3::zeros)
    }

    /// Angle of the triangle at one of its vertices \[rad\].
    fn angle_at(&self, triangle: u32, vertex: u32) -> f64 {
        let [a, b, c] = self.triangles[triangle as usize];
        let (p, q, r) = if vertex == a {
            (a, b, c)
        } else if vertex == b {
            (b, c, a)
        } else {
            (c, a, b)
        };
        let x = &self.positions[1];
        let (u, v) = (x[q as usize] - x[p as usize], x[r as usize] - x[p as usize]);
        libm::atan2(u.cross(&v).norm(), u.dot(&v))
    }
}

/// The point at a fraction of the way from `a` to `b`: exact at both ends, so that consecutive samples and steps join without a gap.
#[inline]
fn between(a: &Vec3, b: &Vec3, share: f64) -> Vec3 {
    a * (1.0 - share) + b * share
}

#[inline]
fn triangle_box(triangle: &[u32; 3], vertex_boxes: &[Aabb]) -> Aabb {
    let [a, b, c] = triangle.map(|v| vertex_boxes[v as usize]);
    a.union(&b).union(&c)
}

/// Compressed rows of the triangles around each vertex, ascending in each row.
fn vertex_stars(triangles: &[[u32; 3]], point_count: usize) -> (Vec<u32>, Vec<u32>) {
    let mut starts = vec![0u32; point_count + 1];
    for &v in triangles.iter().flatten() {
        starts[v as usize + 1] += 1;
    }
    for v in 0..point_count {
        starts[v + 1] += starts[v];
    }
    let mut next = starts.clone();
    let mut stars = vec![0u32; 3 * triangles.len()];
    for (t, corners) in triangles.iter().enumerate() {
        for &v in corners {
            stars[next[v as usize] as usize] = t as u32;
            next[v as usize] += 1;
        }
    }
    (starts, stars)
}

/// Whether every edge joins two triangles of the same orientation, so that there is an inside.
pub fn is_closed(triangles: &[[u32; 3]]) -> bool {
    unpaired_edges(triangles, |_| true).is_empty()
}

/// Whether closed triangles enclose what was outside; `faces_inwards` if they face what they should enclose.
pub fn is_inside_out(triangles: &[[u32; 3]], positions: &[Vec3], faces_inwards: bool) -> bool {
    let share = enclosed_share(triangles, positions);
    if faces_inwards { share > tolerances::INSIDE_OUT } else { share < -tolerances::INSIDE_OUT }
}

/// The volume that triangles enclose as a share of the cube over the root of their area: 0.094 for a ball, negative where they face
/// inwards, 0 without an area. Meaningless for triangles with borders.
pub fn enclosed_share(triangles: &[[u32; 3]], positions: &[Vec3]) -> f64 {
    let Some(first) = triangles.first() else { return 0.0 };
    // From a point of the surface, so that nothing is lost far away from the origin.
    let origin = positions[first[0] as usize];
    let (mut volume, mut area) = (0.0, 0.0);
    for corners in triangles {
        let [a, b, c] = corners.map(|v| positions[v as usize] - origin);
        volume += a.dot(&b.cross(&c)) / 6.0;
        area += 0.5 * (b - a).cross(&(c - a)).norm();
    }
    if area > 0.0 { volume / (area * area.sqrt()) } else { 0.0 }
}

#[cfg(test)]
mod tests;
