//! Rotations of a surface from rest to where it is, continuous over it, and their rates.
//!
//! The rotation of a triangle is that of the polar decomposition of its deformation, which has a closed form in its plane. That
//! of a vertex is the mean of those around it as quaternions, weighted by areas at rest. A rotation has two quaternions; around
//! a vertex each is taken on the side of its neighbour's, which is the right one as long as triangles are folded by less than
//! 180° against each other. So the mean of two leaves of a sharp fold is the frame half-way, and never vanishes.

use std::collections::BTreeSet;

use nalgebra::{Matrix3, Quaternion, Rotation3, UnitQuaternion};
use rayon::prelude::*;

use crate::Vec3;

/// A rotation and its rate: a quaternion of any length, and its derivative [1/s]. All zero where there is none.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Frame {
    rotation: Quaternion<f64>,
    rate: Quaternion<f64>,
}

impl Frame {
    const NONE: Self = Self {
        rotation: Quaternion::from_vector(nalgebra::Vector4::new(0.0, 0.0, 0.0, 0.0)),
        rate: Quaternion::from_vector(nalgebra::Vector4::new(0.0, 0.0, 0.0, 0.0)),
    };

    /// Adds another, on the side of `reference`.
    fn add(&mut self, other: &Self, weight: f64, reference: &Quaternion<f64>) {
        let weight = if other.rotation.dot(reference) < 0.0 { -weight } else { weight };
        self.rotation += other.rotation * weight;
        self.rate += other.rate * weight;
    }

    /// Returns the frame scaled to length one; none if it has no length.
    fn normalized(&self) -> Option<Self> {
        let length = self.rotation.norm();
        if length == 0.0 {
            return None;
        }
        let rotation = self.rotation / length;
        Some(Self { rotation, rate: (self.rate - rotation * rotation.dot(&self.rate)) / length })
    }

    /// The frame at a place of a triangle with these frames at its corners; its own decides which of two quaternions is meant.
    pub(super) fn blend(own: &Self, corners: [Self; 3], weights: [f64; 3]) -> Self {
        let reference = if own.rotation.norm_squared() == 0.0 { corners[0].rotation } else { own.rotation };
        let mut sum = Self::NONE;
        corners.iter().zip(weights).for_each(|(corner, weight)| sum.add(corner, weight, &reference));
        if sum.rotation.norm_squared() == 0.0 { *own } else { sum }
    }

    /// A vector of the rest shape as it is turned now.
    pub(super) fn turn(&self, vector: &Vec3) -> Vec3 {
        let squared = self.rotation.norm_squared();
        if squared == 0.0 {
            return *vector;
        }
        let axis = self.rotation.imag();
        let across = axis.cross(vector);
        vector + (across * self.rotation.scalar() + axis.cross(&across)) * (2.0 / squared)
    }

    /// Returns the angular velocity [rad/s].
    pub(super) fn angular_velocity(&self) -> Vec3 {
        let squared = self.rotation.norm_squared();
        if squared == 0.0 {
            return Vec3::zeros();
        }
        (self.rate * self.rotation.conjugate()).imag() * (2.0 / squared)
    }
}

/// A triangle at rest.
#[derive(Debug, Clone, Copy)]
struct RestTriangle {
    /// Along its first edge, across it, normal.
    axes: [Vec3; 3],
    /// Length of the first edge; the second edge along and across it [m].
    edges: [f64; 3],
    area: f64,
}

/// A triangle at a vertex, and the place among the triangles there of a neighbour that comes before it.
#[derive(Debug, Clone, Copy)]
struct Incident {
    triangle: u32,
    neighbour: u32,
}

/// A surface at rest, from which rotations are counted.
#[derive(Debug, Clone)]
pub(super) struct RestFrames {
    pub(super) triangles: Vec<[u32; 3]>,
    rest: Vec<RestTriangle>,
    /// Triangles around the vertices, vertex after vertex, and where those of each begin.
    around: Vec<Incident>,
    starts: Vec<u32>,
}

impl RestFrames {
    pub(super) fn new(x: &[Vec3], triangles: Vec<[u32; 3]>) -> Self {
        let rest = triangles.iter().map(|corners| RestTriangle::of(corners.map(|v| x[v as usize]))).collect();
        let mut at_vertex: Vec<[u32; 2]> =
            (0..triangles.len() as u32).flat_map(|t| triangles[t as usize].map(|v| [v, t])).collect();
        at_vertex.sort_unstable();
        let mut starts = vec![0];
        let mut around = Vec::with_capacity(at_vertex.len());
        let mut rest_of = at_vertex.as_slice();
        for vertex in 0..x.len() as u32 {
            let count = rest_of.partition_point(|[v, _]| *v == vertex);
            let (here, later) = rest_of.split_at(count);
            let here: Vec<u32> = here.iter().map(|[_, t]| *t).collect();
            around.extend(in_turn(vertex, &here, &triangles));
            starts.push(around.len() as u32);
            rest_of = later;
        }
        Self { triangles, rest, around, starts }
    }

    /// Unit normal of a triangle at rest.
    pub(super) fn rest_normal(&self, triangle: u32) -> Vec3 {
        self.rest[triangle as usize].axes[2]
    }

    /// Triangles that share a vertex with one.
    pub(super) fn neighbours(&self, triangle: u32) -> impl Iterator<Item = u32> {
        let around = |v: u32| &self.around[self.starts[v as usize] as usize..self.starts[v as usize + 1] as usize];
        self.triangles[triangle as usize].into_iter().flat_map(around).map(|at| at.triangle)
    }

    /// The frames of all triangles and all vertices at `x` [m]; with rates where the velocities `v` [m/s] are given.
    pub(super) fn at(&self, x: &[Vec3], v: Option<&[Vec3]>) -> (Vec<Frame>, Vec<Frame>) {
        let of_triangle = |(corners, rest): (&[u32; 3], &RestTriangle)| {
            let at = |values: &[Vec3]| corners.map(|v| values[v as usize]);
            rest.frame(at(x), v.map(at))
        };
        let triangles: Vec<Frame> = self.triangles.par_iter().zip(&self.rest).map(of_triangle).collect();
        let of_vertex = |aligned: &mut Vec<Quaternion<f64>>, range: &[u32]| {
            aligned.clear();
            let mut sum = Frame::NONE;
            for at in &self.around[range[0] as usize..range[1] as usize] {
                let own = &triangles[at.triangle as usize];
                let reference = aligned.get(at.neighbour as usize).copied().unwrap_or(own.rotation);
                sum.add(own, self.rest[at.triangle as usize].area, &reference);
                aligned.push(if own.rotation.dot(&reference) < 0.0 { -own.rotation } else { own.rotation });
            }
            sum.normalized().unwrap_or(Frame::NONE)
        };
        let vertices = self.starts.par_windows(2).map_init(Vec::new, of_vertex).collect();
        (triangles, vertices)
    }
}

/// The triangles at a vertex, in an order in which each but the first of a fan comes after a neighbour.
fn in_turn(vertex: u32, own: &[u32], triangles: &[[u32; 3]]) -> Vec<Incident> {
    let others = |t: u32| triangles[t as usize].into_iter().filter(move |v| *v != vertex);
    let mut spokes: Vec<[u32; 2]> = own.iter().flat_map(|&t| others(t).map(move |v| [v, t])).collect();
    spokes.sort_unstable();
    let (mut found, mut placed) = (Vec::with_capacity(own.len()), BTreeSet::new());
    for &first in own {
        if !placed.insert(first) {
            continue;
        }
        let mut next = found.len();
        // Another fan shares nothing with the first but the vertex.
        found.push(Incident { triangle: first, neighbour: 0 });
        while let Some(&Incident { triangle, .. }) = found.get(next) {
            for spoke in others(triangle) {
                let start = spokes.partition_point(|[v, _]| *v < spoke);
                for &[_, touching] in spokes[start..].iter().take_while(|[v, _]| *v == spoke) {
                    if placed.insert(touching) {
                        found.push(Incident { triangle: touching, neighbour: next as u32 });
                    }
                }
            }
            next += 1;
        }
    }
    found
}

impl RestTriangle {
    fn of([a, b, c]: [Vec3; 3]) -> Self {
        let (first, second) = (b - a, c - a);
        let normal = first.cross(&second);
        let along = first.try_normalize(0.0).unwrap_or_else(Vec3::x);
        let up = normal.try_normalize(0.0).unwrap_or_else(Vec3::y);
        let across = up.cross(&along);
        let edges = [first.norm(), second.dot(&along), second.dot(&across)];
        Self { axes: [along, across, up], edges, area: normal.norm() / 2.0 }
    }

    /// The rotation of a triangle with these corners, and its rate where they have velocities; none where it has no area.
    fn frame(&self, [a, b, c]: [Vec3; 3], v: Option<[Vec3; 3]>) -> Frame {
        let (first, second) = (b - a, c - a);
        let normal = first.cross(&second);
        let (length, doubled) = (first.norm(), normal.norm());
        if length == 0.0 || doubled == 0.0 || self.area == 0.0 {
            return Frame::NONE;
        }
        let (along, up) = (first / length, normal / doubled);
        let across = up.cross(&along);
        // Deformation in the plane, an upper triangular matrix; its rotation is by the angle of (trace, skew).
        let [rest_length, rest_along, rest_across] = self.edges;
        let shear = |length: f64, along: f64| (along - length * rest_along / rest_length) / rest_across;
        let trace = length / rest_length + second.dot(&across) / rest_across;
        let skew = -shear(length, second.dot(&along));
        let size = libm::hypot(trace, skew);
        let (cos, sin) = (trace / size, skew / size);
        let turned = [along * cos + across * sin, across * cos - along * sin, up];
        let matrix = Matrix3::from_columns(&turned) * Matrix3::from_columns(&self.axes).transpose();
        let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(matrix)).into_inner();
        let Some([va, vb, vc]) = v else { return Frame { rotation, ..Frame::NONE } };
        let (first_rate, second_rate) = (vb - va, vc - va);
        let length_rate = first_rate.dot(&along);
        let along_rate = (first_rate - along * length_rate) / length;
        let normal_rate = (first_rate.cross(&second) + first.cross(&second_rate)) / doubled;
        let of_axes = up.cross(&normal_rate) + up * along_rate.dot(&across);
        let across_rate = second_rate.dot(&across) + second.dot(&of_axes.cross(&across));
        let trace_rate = length_rate / rest_length + across_rate / rest_across;
        let skew_rate = -shear(length_rate, second_rate.dot(&along) + second.dot(&along_rate));
        let spin = of_axes + up * ((trace * skew_rate - skew * trace_rate) / (size * size));
        Frame { rotation, rate: Quaternion::from_imag(spin) * rotation * 0.5 }
    }
}
