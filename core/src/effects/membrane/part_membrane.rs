//! The membrane triangles of one part: every triangle with one of its vertices, in the order of the mesh.

use std::ops::Range;

use crate::Vec3;
use crate::block_matrix::{PartBlocks, Slot};
use crate::effects::force::{BlockFactors, Force, Linearised, PartForce, PartMotion, PartView, Strained};
use crate::effects::membrane::TriangleElement;
use crate::effects::membrane::element::{Blocks, Frame, Gradients, Law, largest_stiffness, rest_edges};
use crate::elements::corners::{add, by_part, gather, outside, own_fraction};
use crate::parallel::simd4::Simd4;
use crate::scene::Scene;

/// A triangle of a part.
#[derive(Debug, Clone, Copy)]
struct Triangle {
    frame: Frame,
    gradients: Gradients,
    /// Rest area, less where the triangle is softened [m²].
    weight: f64,
    /// Damping by stiffness [s], times the weight.
    damping: f64,
    /// Local vertices.
    corners: [u32; 3],
}

/// The triangles of one part.
struct PartMembrane {
    /// First vertex of the part.
    start: usize,
    law: Law,
    triangles: Vec<Triangle>,
    /// Vertices of other parts, ascending.
    neighbours: Vec<u32>,
    /// Largest sum of the lengths of a triangle's gradients [1/m].
    thinnest: f64,
}

/// Sorts the triangles into this rank's parts.
pub(super) fn build(scene: &Scene, elements: &[TriangleElement], law: Law) -> (Vec<PartForce>, usize) {
    let (parts, masses) = (scene.parts(), scene.masses());
    let entries = by_part(parts, elements.iter().map(|element| element.corners));
    let mut bytes = 0;
    let mut built: Vec<PartForce> = Vec::new();
    for group in entries.chunk_by(|a, b| a.0 == b.0) {
        let range = parts.ranges()[group[0].0].clone();
        let triangle = |(_, number): &(usize, usize)| {
            let TriangleElement { corners, gradients, weight, stiffness, damping_ratio } = elements[*number];
            let inverse_mass = corners.iter().map(|corner| 1.0 / masses[*corner]).sum::<f64>() / 3.0;
            let critical = 2.0 / (stiffness * inverse_mass).sqrt();
            // Without stiffness there is no motion to damp.
            let time = if critical.is_finite() { damping_ratio * critical } else { 0.0 };
            let (frame, damping) = (Frame::default(), time * weight);
            Triangle { frame, gradients, weight, damping, corners: corners.map(|corner| corner as u32) }
        };
        let triangles: Vec<Triangle> = group.iter().map(triangle).collect();
        let neighbours = outside(&range, triangles.iter().map(|triangle| triangle.corners));
        let length = |triangle: &Triangle| triangle.gradients.map(|g| libm::hypot(g[0], g[1])).iter().sum::<f64>();
        let thinnest = triangles.iter().map(length).fold(0.0, f64::max);
        bytes += triangles.len() * size_of::<Triangle>() + neighbours.len() * size_of::<u32>();
        let start = range.start;
        built.push((group[0].0, Box::new(PartMembrane { start, law, triangles, neighbours, thinnest })));
    }
    (built, bytes)
}

/// Edges of a triangle from corner 0 [m].
fn edges(triangle: &Triangle, x: &[Vec3]) -> [Vec3; 2] {
    let [a, b, c] = triangle.corners.map(|corner| x[corner as usize]);
    [b - a, c - a]
}

/// Returns the forces on all three corners, given the forces on corners 1 and 2: corner 0 gets the opposite of their
/// sum.
fn balanced([b, c]: [Simd4; 2]) -> [Simd4; 3] {
    [Simd4::ZERO - b - c, b, c]
}

/// The largest rate of relative change of length in any direction, of rates of strain.
fn fastest([warp, weft, shear]: [f64; 3]) -> f64 {
    0.5 * ((warp + weft).abs() + libm::hypot(warp - weft, shear))
}

impl Force for PartMembrane {
    fn neighbours(&self) -> &[u32] {
        &self.neighbours
    }

    fn update(&mut self, view: &PartView<'_>, _: &[Simd4], f: &mut [Simd4]) {
        for triangle in &mut self.triangles {
            let (frame, strain) = Frame::of(&triangle.gradients, edges(triangle, view.x));
            triangle.frame = frame;
            let stress = self.law.stress(strain).map(|stress| -stress * triangle.weight);
            add(self.start, triangle.corners, balanced(frame.forces(&triangle.gradients, stress)), f);
        }
    }

    fn add_damping(&self, motion: &PartMotion<'_>, f: &mut [Simd4]) {
        for triangle in &self.triangles {
            let [a, b, c] = gather(self.start, triangle.corners, motion.own_v, motion.v);
            let rates = triangle.frame.rates(&triangle.gradients, [b - a, c - a]);
            let stress = self.law.moduli.stress(rates).map(|stress| -stress * triangle.damping);
            add(self.start, triangle.corners, balanced(triangle.frame.forces(&triangle.gradients, stress)), f);
        }
    }

    fn add_stiffness(&self, sums: &mut [f64]) {
        // A quadratic form is no more than its largest eigenvalue times the square of the motion. Adding that up over the
        // triangles of a vertex bounds the whole cloth, with ω² ≤ max Σ / m: steps are proven stable up to a CFL number of 4.
        for triangle in &self.triangles {
            let stiffness = triangle.weight * largest_stiffness(&triangle.gradients, &self.law.moduli);
            for corner in triangle.corners {
                if let Some(sum) = sums.get_mut((corner as usize).wrapping_sub(self.start)) {
                    *sum += stiffness;
                }
            }
        }
    }

    fn energy(&self, view: &PartView<'_>) -> f64 {
        let own = view.start..view.start + view.masses.len();
        let energy = |triangle: &Triangle| {
            let (_, strain) = Frame::of(&triangle.gradients, edges(triangle, view.x));
            self.law.energy(strain) * triangle.weight * own_fraction(&own, triangle.corners)
        };
        self.triangles.iter().map(energy).sum()
    }

    fn linearised(&self) -> Option<&dyn Linearised> {
        Some(self)
    }

    fn strained(&self) -> Option<&dyn Strained> {
        Some(self)
    }
}

impl Linearised for PartMembrane {
    fn visit_elements(&self, visit: &mut dyn FnMut(&[u32])) {
        self.triangles.iter().for_each(|triangle| visit(&triangle.corners));
    }

    fn add_blocks(&self, view: &PartView<'_>, factors: BlockFactors, slots: &[Slot], rows: &mut PartBlocks) {
        for (triangle, slots) in self.triangles.iter().zip(slots.as_chunks::<3>().0) {
            let (frame, strain) = Frame::of(&triangle.gradients, edges(triangle, view.x));
            let blocks = Blocks::new(&frame, &triangle.gradients, strain, &self.law);
            let tension = factors.stiffness * triangle.weight;
            let elastic = tension + factors.damping * triangle.damping;
            let couplings = blocks.couplings(&self.law.moduli, elastic, tension);
            slots.iter().zip(&couplings).for_each(|(slot, coupling)| rows.add_coupling(*slot, coupling));
        }
    }
}

impl Strained for PartMembrane {
    fn strain_rate_bound(&self, part: Range<usize>, v: &[Vec3]) -> f64 {
        // Two corners differ by no more than twice what any vertex differs from the first; a stretch changes by no more than
        // √2 times what the deformation gradient does.
        let reference = v[self.start];
        let squared = |v: &Vec3| (v - reference).norm_squared();
        let own = v[part].iter().map(squared).fold(0.0, f64::max);
        let all = self.neighbours.iter().map(|j| squared(&v[*j as usize])).fold(own, f64::max);
        2.0 * std::f64::consts::SQRT_2 * all.sqrt() * self.thinnest
    }

    fn strain_rate(&self, motion: &PartMotion<'_>) -> f64 {
        let rate = |triangle: &Triangle| {
            let (frame, _) = Frame::of(&triangle.gradients, edges(triangle, motion.x));
            let [a, b, c] = gather(self.start, triangle.corners, motion.own_v, motion.v);
            fastest(frame.rates(&triangle.gradients, [b - a, c - a]))
        };
        self.triangles.iter().map(rate).fold(0.0, f64::max)
    }

    fn largest_strain(&self, x: &[Vec3]) -> Option<(f64, [usize; 2])> {
        let strains = |triangle: &Triangle| {
            let [a, b, c] = triangle.corners.map(|corner| corner as usize);
            let rest = rest_edges(&triangle.gradients);
            [[a, b], [a, c], [b, c]].into_iter().zip(rest).map(|(ends, rest)| {
                let length = (x[ends[1]] - x[ends[0]]).norm();
                (length / libm::hypot(rest[0], rest[1]) - 1.0, ends)
            })
        };
        self.triangles.iter().flat_map(strains).max_by(|a, b| a.0.total_cmp(&b.0))
    }
}
