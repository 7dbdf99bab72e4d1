//! Distribution of the bending energy of a mesh over its angles.
//!
//! The angle at an edge, where the cloth has the curvature tensor κ in the plane of a triangle, is for small angles
//! the jump of the slope across the edge of the function ½ r·κ·r, interpolated between the vertices. With t along the
//! edge, n across it, the opposite vertices at the distances h₁, h₂ and at the places a₁, a₂ along the edge of length
//! L:
//!
//! `θ = ½ κ_nn (h₁ + h₂) + κ_tn (a₁ − a₂) + ½ κ_tt (a₁ (a₁ − L)/h₁ + a₂ (a₂ − L)/h₂)`
//!
//! The three angles of a triangle give θ = M κ, and its energy, the least that agrees with them, is ½ A θ·(M C⁻¹ Mᵀ)⁻¹ θ. At the
//! border of the cloth fewer angles are known, and the same formula leaves free what they do not say.

use nalgebra::{DMatrix, SymmetricEigen};

use super::arctangent::arctangent;
use crate::Vec3;
use crate::mesh::{Hinge, TriangleMesh};
use crate::tolerances::{CONIC_TRIANGLE, LOW_TRIANGLE};

/// Bending rigidities of cloth [N·m], all positive.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Rigidity {
    /// Against curvature along the warp and along the weft, and half of that against twist.
    components: [f64; 3],
}

impl Rigidity {
    /// The same in all directions, without coupling between them (a Poisson's ratio of zero), so that a strip and a wide
    /// sheet have the same rigidity.
    pub(super) fn isotropic(rigidity: f64) -> Self {
        Self { components: [rigidity; 3] }
    }
}

/// An angle of the mesh.
#[derive(Debug, Clone)]
pub(super) struct Element {
    /// Vertices of the garment: opposite one, the two of the edge, the other opposite one.
    pub(super) vertices: [u32; 4],
    /// Angle at which it does not act [rad].
    pub(super) rest_angle: f64,
    /// Factor on the moments that its angle gives and feels: below one where a triangle is low over the edge.
    pub(super) softening: f64,
    /// The elements whose angles its moment depends on, itself first, and by how much [N·m per rad].
    pub(super) row: Vec<(u32, f64)>,
}

/// Two triangles at an edge.
///
/// Everything here is computed without branches, so that loops over hinges work on several at once.
#[derive(Debug, Clone, Copy)]
pub(super) struct Shape {
    /// The edge [m].
    pub(super) edge: Vec3,
    /// Its length [m].
    pub(super) length: f64,
    /// Normals of the triangles, twice as long as their areas [m²].
    pub(super) normals: [Vec3; 2],
    /// From the end of the edge to the opposite vertices [m].
    pub(super) opposite: [Vec3; 2],
}

impl Shape {
    /// Returns the shape at the positions of the first opposite vertex, the two of the edge, and the other opposite
    /// one.
    #[inline(always)]
    pub(super) fn at([i, j, k, l]: [Vec3; 4]) -> Self {
        Self::of(k - j, [i - k, l - k])
    }

    /// Returns the shape with this edge and these vectors from its end to the opposite vertices [m].
    #[inline(always)]
    pub(super) fn of(edge: Vec3, opposite: [Vec3; 2]) -> Self {
        let normals = [edge.cross(&opposite[0]), opposite[1].cross(&edge)];
        Self { edge, length: edge.norm_squared().sqrt(), normals, opposite }
    }

    /// The angle [rad], positive where the opposite vertices rise to the side that the first triangle faces; zero where a triangle
    /// has no area.
    #[inline(always)]
    pub(super) fn angle(&self) -> f64 {
        let [n1, n2] = &self.normals;
        arctangent(self.length * n1.dot(&self.opposite[1]), n1.dot(n2))
    }

    /// Heights of the triangles over the edge [m]; zero without area.
    pub(super) fn heights(&self) -> [f64; 2] {
        self.normals.map(|n| if self.length == 0.0 { 0.0 } else { n.norm() / self.length })
    }
}

/// All angles of a mesh, in the order of its hinges.
///
/// `rigidity` is that of each triangle; `None` for one that does not resist.
pub(super) fn of_mesh(mesh: &TriangleMesh, rigidity: impl Fn(usize) -> Option<Rigidity>, flat: bool) -> Vec<Element> {
    let at = |v: u32| mesh.rest_positions()[v as usize];
    let element = |hinge: &Hinge| {
        let ([j, k], [i, l]) = (mesh.edges()[hinge.edge as usize].vertices, hinge.opposite);
        let vertices = [i, j, k, l];
        let shape = Shape::at(vertices.map(at));
        let rest_angle = if flat { 0.0 } else { shape.angle() };
        Element { vertices, rest_angle, softening: softening(&shape), row: Vec::new() }
    };
    let hinges = mesh.hinges();
    let mut elements: Vec<Element> = hinges.iter().map(element).collect();
    for (triangle, known) in angles_of_triangles(mesh, &hinges).iter().enumerate() {
        // A triangle that shares no edge, such as a button, has no angle to hold.
        let Some(rigidity) = rigidity(triangle).filter(|_| !known.is_empty()) else { continue };
        let moments = moments_of_triangle((mesh, &hinges), triangle, known, rigidity);
        for (a, hinge) in known.iter().enumerate() {
            for (b, other) in known.iter().enumerate() {
                add(&mut elements[*hinge as usize].row, *other, moments[(a, b)]);
            }
        }
    }
    let factors: Vec<f64> = elements.iter().map(|element| element.softening).collect();
    for (number, element) in elements.iter_mut().enumerate() {
        element.row.iter_mut().for_each(|(other, moment)| *moment *= factors[number] * factors[*other as usize]);
        // A hinge that no triangle uses stands for itself with nothing.
        add(&mut element.row, number as u32, 0.0);
        let own = element.row.iter().position(|(other, _)| *other == number as u32).unwrap_or(0);
        element.row[..=own].rotate_right(1);
    }
    elements
}

/// Factor on the moments that the angle of a shape at rest gives and feels: below one where a triangle is low over the edge, or the edge
/// short below a triangle.
///
/// Forces grow with the inverse of the heights, and, where triangles lean, of the edge's length. Without this factor the residual of a solve
/// turns a sliver by angles at which its forces tear the cloth.
fn softening(rest: &Shape) -> f64 {
    let heights = rest.heights();
    let of =
        |size: f64, other: f64| if size < LOW_TRIANGLE * other { (size / (LOW_TRIANGLE * other)).powi(2) } else { 1.0 };
    heights.iter().map(|height| of(*height, rest.length) * of(rest.length, *height)).product()
}

fn add(row: &mut Vec<(u32, f64)>, other: u32, moment: f64) {
    match row.iter_mut().find(|(known, _)| *known == other) {
        Some((_, sum)) => *sum += moment,
        None => row.push((other, moment)),
    }
}

/// The hinges of each triangle by their numbers, ascending; of several at one edge, which more than two triangles share, the first.
fn angles_of_triangles(mesh: &TriangleMesh, hinges: &[Hinge]) -> Vec<Vec<u32>> {
    let mut known: Vec<Vec<u32>> = vec![Vec::new(); mesh.triangles().len()];
    for (number, hinge) in hinges.iter().enumerate() {
        for triangle in hinge.triangles {
            let known = &mut known[triangle as usize];
            if known.last().is_none_or(|last| hinges[*last as usize].edge != hinge.edge) {
                known.push(number as u32);
            }
        }
    }
    known
}

/// `A (M C⁻¹ Mᵀ)⁻¹` of a triangle with the hinges `known` of a mesh [N·m per rad].
fn moments_of_triangle(
    (mesh, hinges): (&TriangleMesh, &[Hinge]),
    triangle: usize,
    known: &[u32],
    rigidity: Rigidity,
) -> DMatrix<f64> {
    let count = known.len();
    let rows: Vec<[f64; 3]> =
        known.iter().map(|number| angle_of_curvature(mesh, triangle, &hinges[*number as usize])).collect();
    let mut flexibility = DMatrix::from_fn(count, count, |a, b| {
        (0..3).map(|c| rows[a][c] * rows[b][c] / rigidity.components[c]).sum::<f64>()
    });
    let scale: Vec<f64> = (0..count).map(|a| flexibility[(a, a)].sqrt().recip()).collect();
    for a in 0..count {
        for b in 0..count {
            flexibility[(a, b)] *= scale[a] * scale[b];
        }
    }
    // Angles of six vertices near a conic hardly tell curvatures apart: they would be coupled as stiffly as one likes.
    let mut eigen = SymmetricEigen::new(flexibility);
    eigen.eigenvalues.iter_mut().for_each(|value| *value = value.max(CONIC_TRIANGLE).recip());
    let inverse = eigen.recompose();
    let area = mesh.rest_areas()[triangle];
    DMatrix::from_fn(count, count, |a, b| area * scale[a] * inverse[(a, b)] * scale[b])
}

/// The angle at a hinge of a triangle per curvature in its plane [m]: along the first axis, along the second, and √2 times
/// the mixed component. The first axis lies along the triangle's first edge.
fn angle_of_curvature(mesh: &TriangleMesh, triangle: usize, hinge: &Hinge) -> [f64; 3] {
    let at = |v: u32| mesh.rest_positions()[v as usize];
    let corners = mesh.triangles()[triangle];
    let [j, k] = mesh.edges()[hinge.edge as usize].vertices;
    // Seen from the side that this triangle faces, it lies to the left of the edge from p to q.
    let is_ahead = (0..3).any(|c| corners[c] == j && corners[(c + 1) % 3] == k);
    let (p, q) = if is_ahead { (at(j), at(k)) } else { (at(k), at(j)) };
    let length = (q - p).norm();
    let t = (q - p) / length;
    let place = |v: u32| {
        let from = at(v) - p;
        let along = from.dot(&t);
        (along, (from - t * along).norm())
    };
    let own = usize::from(hinge.triangles[1] as usize == triangle);
    let ((a1, h1), (a2, h2)) = (place(hinge.opposite[own]), place(hinge.opposite[1 - own]));
    let nn = 0.5 * (h1 + h2);
    let tn = a1 - a2;
    let tt = 0.5 * (a1 * (a1 - length) / h1 + a2 * (a2 - length) / h2);
    // The angle counts as positive towards the side that the hinge's first triangle, in the order of its vertices, faces.
    let first = if own == 0 { is_ahead } else { !is_ahead };
    let sign = if first { 1.0 } else { -1.0 };
    let [e1, e2] = axes(mesh, triangle);
    let (c, s) = (t.dot(&e1), t.dot(&e2));
    [
        sign * (tt * c * c + nn * s * s - tn * c * s),
        sign * (tt * s * s + nn * c * c + tn * c * s),
        sign * (2.0 * (tt - nn) * c * s + tn * (c * c - s * s)) / std::f64::consts::SQRT_2,
    ]
}

/// Unit vectors in the plane of a triangle at rest: along its first edge, and to the left of it.
fn axes(mesh: &TriangleMesh, triangle: usize) -> [Vec3; 2] {
    let [a, b, c] = mesh.triangles()[triangle].map(|v| mesh.rest_positions()[v as usize]);
    let e1 = (b - a).normalize();
    let normal = (b - a).cross(&(c - a)).normalize();
    [e1, normal.cross(&e1)]
}

/// Energy of a triangle that has all its angles, at these angles of the mesh [J].
#[cfg(test)]
pub(super) fn triangle_energy(mesh: &TriangleMesh, triangle: usize, rigidity: Rigidity, angles: &[f64]) -> Option<f64> {
    let hinges = mesh.hinges();
    let known = angles_of_triangles(mesh, &hinges).swap_remove(triangle);
    let moments = moments_of_triangle((mesh, &hinges), triangle, &known, rigidity);
    let pairs = (0..known.len()).flat_map(|a| (0..known.len()).map(move |b| (a, b)));
    let at = |n: usize| angles[known[n] as usize];
    (known.len() == 3).then(|| 0.5 * pairs.map(|(a, b)| at(a) * moments[(a, b)] * at(b)).sum::<f64>())
}
