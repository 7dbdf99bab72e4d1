//! Terms that enclosed gas adds to the matrix of a long step: for each volume the rank-one matrix `A += c g gᵀ` with the gradient g of the
//! volume, because gas pushes every vertex of its garment by the same pressure (`docs/theory/linear_solver.md#enclosed-gas`).
//!
//! Their product takes one sum over all parts, `g · s`, and what each vertex has of it.

use crate::Vec3;
use crate::parallel::for_each_part::{PerPart, PerVertex};
use crate::parallel::parts::Parts;
use crate::parallel::simd4::Simd4;
use crate::solve::implicit_velocity::PartForces;
use crate::volumes::Volumes;

/// The term of one volume.
#[derive(Debug)]
struct VolumeTerm {
    /// The garment that encloses it.
    garment: usize,
    /// c [kg/m⁴].
    factor: f64,
    /// g · s of each part.
    sums: Vec<f64>,
    /// c g · s of the last product [kg/(m s)].
    product: f64,
}

/// The terms of all volumes; without memory where there are none.
#[derive(Debug, Default)]
pub(crate) struct VolumeTerms {
    terms: Vec<VolumeTerm>,
    /// Gradient of its garment's volume at each own vertex [m²].
    gradient: Vec<Simd4>,
}

impl VolumeTerms {
    /// Takes the volumes at the positions `x` of all local vertices [m], at which they were updated, in the parts that are worked on;
    /// `stiffness_factor` is the factor of derivatives by position [s²].
    pub(crate) fn set(
        &mut self,
        (parts, worked_on): (&Parts, &[bool]),
        forces: &PartForces,
        volumes: &Volumes,
        x: &[Vec3],
        stiffness_factor: f64,
    ) {
        if volumes.0.is_empty() {
            return;
        }
        self.terms.resize_with(volumes.0.len(), || VolumeTerm {
            garment: 0,
            factor: 0.0,
            sums: vec![0.0; parts.count()],
            product: 0.0,
        });
        for (term, volume) in self.terms.iter_mut().zip(&volumes.0) {
            term.garment = volume.garment();
            term.factor = stiffness_factor * volume.stiffness();
        }
        self.gradient.resize(parts.own().len(), Simd4::ZERO);
        parts.for_each(PerVertex(&mut self.gradient), &|part, gradient| {
            if worked_on[part] {
                gradient.0.fill(Simd4::ZERO);
                let enclosing = forces[part].iter().filter_map(|force| force.enclosing());
                enclosing.for_each(|force| force.add_volume_gradient(x, gradient.0));
            }
        });
    }

    /// Finds the products with the vectors `s` of all local vertices. All ranks call it together.
    pub(super) fn multiply(&mut self, parts: &Parts, s: &[Simd4]) {
        let Self { terms, gradient } = self;
        let first = parts.own().start;
        for term in terms {
            let garment = term.garment;
            parts.for_each(PerPart(&mut term.sums), &|part, sum| {
                let range = parts.ranges()[part].clone();
                let mut products = Simd4::ZERO;
                if parts.garment_of(range.start) == garment {
                    let pairs = gradient[range.start - first..range.end - first].iter().zip(&s[range]);
                    pairs.for_each(|(g, s)| products += g.component_mul(*s));
                }
                sum.0[0] = products.sum();
            });
            let [sum] = parts.join_parts(&[&term.sums]);
            term.product = term.factor * sum;
        }
    }

    /// Adds the last products to the vectors `q` of a part, its own slice.
    pub(super) fn add_product(&self, parts: &Parts, part: usize, q: &mut [Simd4]) {
        let (range, first) = (&parts.ranges()[part], parts.own().start);
        for term in self.terms.iter().filter(|term| term.garment == parts.garment_of(range.start)) {
            let gradient = &self.gradient[range.start - first..range.end - first];
            q.iter_mut().zip(gradient).for_each(|(q, g)| *q += *g * term.product);
        }
    }

    /// Memory held [bytes].
    pub(super) fn bytes(&self) -> usize {
        let sums = self.terms.iter().map(|term| size_of_val(&*term.sums)).sum::<usize>();
        size_of_val(&*self.gradient) + size_of_val(&*self.terms) + sums
    }
}
