//! Points that follow a surface of triangles: bound to it at rest, moved with it.
//!
//! A point P is bound to the closest point of the surface at rest, Σ bᵢ Xᵢ, by the offset d = P − Σ bᵢ Xᵢ. While the surface
//! moves to x, the point is at
//!
//! ```text
//! p = Σ bᵢ xᵢ + R(b) d        v = Σ bᵢ vᵢ + ω(b) × R(b) d
//! ```
//!
//! where R(b) is a rotation that is continuous over the whole surface: every vertex has one, the mean of those of its triangles
//! as quaternions ([`frames`]), and inside a triangle they are blended by the same weights b. It is always a proper rotation, so
//! an offset keeps its length: no point is ever farther from the surface than at rest, and nothing collapses at a fold. ω(b) is
//! the exact rate of R(b), so that velocities are the derivative of the positions. Rigid motions are followed to rounding.
//!
//! Parts that stay rigid, such as buttons, are bound as a whole to the closest point of their middle.

mod check;
mod frames;

#[cfg(test)]
mod tests;

use rayon::prelude::*;

use crate::Vec3;
use crate::geometry::aabb::Aabb;
use crate::geometry::bvh::Bvh;
use crate::geometry::distance::closest_on_triangle;

use frames::{Frame, RestFrames};

/// A point bound to a triangle.
#[derive(Debug, Clone, Copy, PartialEq)]
struct BoundPoint {
    triangle: u32,
    /// Barycentric weights, adding up to one.
    weights: [f64; 3],
    /// From the surface to the point, at rest [m].
    offset: Vec3,
}

/// Points bound to a surface.
#[derive(Debug, Clone)]
pub struct SurfaceBinding {
    rest: Vec<Vec3>,
    frames: RestFrames,
    points: Vec<BoundPoint>,
}

impl SurfaceBinding {
    /// Binds `points` [m] to a surface at rest: its vertices [m] and their triangles, of which those without an area are left out. The
    /// points of each list in `rigid` move as one piece; no point is in two of them. `None` if no triangle has an area.
    pub fn new(rest: Vec<Vec3>, mut triangles: Vec<[u32; 3]>, points: &[Vec3], rigid: &[Vec<u32>]) -> Option<Self> {
        // The frame of a triangle without an area would be NaN.
        triangles.retain(|corners| {
            let [a, b, c] = corners.map(|v| rest[v as usize]);
            (b - a).cross(&(c - a)).norm() > 0.0
        });
        if triangles.is_empty() {
            return None;
        }
        let corners = |t: u32| triangles[t as usize].map(|v| rest[v as usize]);
        let boxes: Vec<Aabb> = (0..triangles.len() as u32)
            .map(|t| {
                let [a, b, c] = corners(t);
                Aabb::of_segment(&a, &b).union(&Aabb::of_point(&c))
            })
            .collect();
        let tree = Bvh::build(&boxes);
        let bind = |point: &Vec3| {
            let distance = |t| closest_on_triangle(point, &corners(t)).distance_squared;
            // There is a triangle, and an infinite reach finds it wherever it is.
            let (triangle, _) = tree.nearest(point, f64::INFINITY, None, distance).unwrap_or((0, 0.0));
            let weights = closest_on_triangle(point, &corners(triangle)).weights;
            BoundPoint { triangle, weights, offset: point - blended(&rest, triangles[triangle as usize], weights) }
        };
        let mut bound: Vec<BoundPoint> = points.par_iter().map(bind).collect();
        for part in rigid.iter().filter(|part| !part.is_empty()) {
            let middle = part.iter().map(|&p| points[p as usize]).sum::<Vec3>() / part.len() as f64;
            let BoundPoint { triangle, weights, .. } = bind(&middle);
            let base = blended(&rest, triangles[triangle as usize], weights);
            for &point in part {
                bound[point as usize] = BoundPoint { triangle, weights, offset: points[point as usize] - base };
            }
        }
        let frames = RestFrames::new(&rest, triangles);
        Some(Self { rest, frames, points: bound })
    }

    /// The place that each point is bound to: the corners of a triangle, and their barycentric weights.
    pub fn places(&self) -> impl Iterator<Item = ([u32; 3], [f64; 3])> {
        self.points.iter().map(|point| (self.frames.triangles[point.triangle as usize], point.weights))
    }

    /// Distance of each bound point from the place that it is bound to [m]: it is never farther from the surface.
    pub fn distances(&self) -> impl Iterator<Item = f64> {
        self.points.iter().map(|point| point.offset.norm())
    }

    /// Returns the positions of the bound points when the vertices of the surface are at `x` [m]. The same bits on
    /// any number of threads.
    pub fn positions(&self, x: &[Vec3]) -> Vec<Vec3> {
        let (triangles, vertices) = self.frames.at(x, None);
        self.points.par_iter().map(|point| self.place(point, x, &triangles, &vertices).0).collect()
    }

    /// The same, and how fast they are [m/s] when the vertices move with `v` [m/s].
    pub fn motion(&self, x: &[Vec3], v: &[Vec3]) -> (Vec<Vec3>, Vec<Vec3>) {
        let (triangles, vertices) = self.frames.at(x, Some(v));
        let moved = |point: &BoundPoint| {
            let (place, apart, frame) = self.place(point, x, &triangles, &vertices);
            let rate = blended(v, self.frames.triangles[point.triangle as usize], point.weights);
            (place, rate + frame.angular_velocity().cross(&apart))
        };
        self.points.par_iter().map(moved).unzip()
    }

    /// Numbers of the bound points, from one for each vertex of the surface, linear in each triangle.
    pub fn interpolated(&self, numbers: &[f32]) -> Vec<f32> {
        let of_point = |point: &BoundPoint| {
            let corners = self.frames.triangles[point.triangle as usize];
            let parts = corners.iter().zip(point.weights).map(|(v, weight)| f64::from(numbers[*v as usize]) * weight);
            parts.sum::<f64>() as f32
        };
        self.points.par_iter().map(of_point).collect()
    }

    /// Place of a point, its offset as it is turned now, and its frame.
    fn place(&self, point: &BoundPoint, x: &[Vec3], triangles: &[Frame], vertices: &[Frame]) -> (Vec3, Vec3, Frame) {
        let corners = self.frames.triangles[point.triangle as usize];
        let around = corners.map(|v| vertices[v as usize]);
        let frame = Frame::blend(&triangles[point.triangle as usize], around, point.weights);
        let apart = frame.turn(&point.offset);
        (blended(x, corners, point.weights) + apart, apart, frame)
    }
}

/// Value of the corners of a triangle at a place in it.
fn blended(values: &[Vec3], corners: [u32; 3], weights: [f64; 3]) -> Vec3 {
    (0..3).map(|i| values[corners[i] as usize] * weights[i]).sum()
}
