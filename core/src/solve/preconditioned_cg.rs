//! Preconditioned, projected conjugate gradients for `P A P d = P b` with an assembled matrix
//! (`docs/theory/linear_solver.md`).
//!
//! The unknowns are changes of velocity [m/s], the right-hand side is an impulse [N s], A has the unit of a mass [kg]. The
//! residual is measured by the largest nodal r/m [m/s]. Each iteration is three passes over the parts.

use crate::Vec3;
use crate::block_matrix::BlockMatrix;
use crate::parallel::for_each_part::{PerBlock, PerVertex};
use crate::parallel::parts::Parts;
use crate::parallel::reduce::{SUM_BLOCK, largest};
use crate::solve::conjugate_gradient::{BREAKDOWN, Outcome, Reach, Stop};
use crate::solve::preconditioner::Preconditioner;

/// Constraints of a solve: an orthogonal projection of each vertex' vector.
pub trait Projection: Sync {
    /// Removes the constrained directions of one part from `r`, the part's own slice.
    fn project(&self, part: usize, r: &mut [Vec3]);
}

/// A system to be solved.
#[derive(Debug)]
pub struct BlockSystem<'a, C> {
    /// The split of the vertices.
    pub parts: &'a Parts,
    /// Masses of the local vertices [kg].
    pub masses: &'a [f64],
    /// A [kg].
    pub matrix: &'a BlockMatrix,
    /// P.
    pub constraints: &'a C,
}

/// Scratch and preconditioner of the solver; made once for the elements of a matrix.
#[derive(Debug)]
pub struct PreconditionedCg {
    preconditioner: Preconditioner,
    /// Which own parts need vertices of other ranks.
    reaches_ghosts: Vec<bool>,
    r: Vec<Vec3>,
    z: Vec<Vec3>,
    s: Vec<Vec3>,
    q: Vec<Vec3>,
    dots: Vec<f64>,
    residuals: Vec<f64>,
}

impl PreconditionedCg {
    /// Scratch for the vertices of a rank and the elements of this matrix; `rest` are the rest positions of the local vertices
    /// [m]. All ranks call it together.
    pub fn new(parts: &Parts, matrix: &BlockMatrix, rest: &[Vec3]) -> Self {
        let own = vec![Vec3::zeros(); parts.own().len()];
        let blocks = vec![0.0; parts.block_count()];
        Self {
            preconditioner: Preconditioner::new(parts, matrix, rest),
            reaches_ghosts: matrix.parts().iter().map(|rows| rows.reaches_beyond(&parts.own())).collect(),
            r: own.clone(),
            z: own.clone(),
            s: vec![Vec3::zeros(); parts.local_count()],
            q: own,
            dots: blocks.clone(),
            residuals: blocks,
        }
    }

    /// Memory held [bytes].
    pub fn bytes(&self) -> usize {
        (3 * self.r.len() + self.s.len()) * size_of::<Vec3>()
            + 2 * size_of_val(&*self.dots)
            + self.preconditioner.bytes()
    }

    /// Makes the preconditioner that of this system. It may be kept while matrix and constraints change: solves then take more
    /// iterations and come to the same result. All ranks call it together.
    pub fn prepare(&mut self, system: &BlockSystem<'_, impl Projection>) {
        self.preconditioner.prepare(system);
    }

    /// Solves `P A P d = P b` from d = 0, `b` on the own vertices [N s]; the ghosts of `d` [m/s] are those of their owners
    /// afterwards. All ranks call it together.
    pub fn solve(
        &mut self,
        system: &BlockSystem<'_, impl Projection>,
        b: &[Vec3],
        d: &mut [Vec3],
        stop: Stop,
    ) -> Outcome {
        d.fill(Vec3::zeros());
        self.r.copy_from_slice(b);
        let (mut rho, mut residual) = self.precondition(system);
        let first = residual;
        let mut rho_before = f64::INFINITY;
        for iterations in 0.. {
            let finite = rho.is_finite();
            let converged = residual <= stop.tolerance && (iterations >= 1 || residual < f64::EPSILON);
            if converged || rho <= 0.0 || !finite || iterations == stop.max_iterations {
                let converged = finite && (converged || residual == 0.0);
                let worse = !converged && (residual > BREAKDOWN * first || rho < 0.0);
                return Outcome { iterations, converged, finite, worse };
            }
            self.direction(system, if iterations > 0 { rho / rho_before } else { 0.0 });
            let curvature = self.product(system);
            rho_before = rho;
            self.advance(system, d, rho / curvature);
            (rho, residual) = self.precondition(system);
        }
        unreachable!("the loop ends at the largest number of iterations")
    }

    /// `r = P r`, `z = P W r` with the preconditioner W; returns `r·z` and the largest nodal `|r|/m`.
    fn precondition(&mut self, system: &BlockSystem<'_, impl Projection>) -> (f64, f64) {
        let parts = system.parts;
        let blocks = (PerBlock(&mut self.dots), PerBlock(&mut self.residuals));
        let vectors = (PerVertex(&mut self.r), PerVertex(&mut self.z));
        let preconditioner = &self.preconditioner;
        parts.for_each((vectors, blocks), &|part, ((r, z), (dots, residuals))| {
            system.constraints.project(part, r.0);
            preconditioner.apply(part, r.0, z.0);
            system.constraints.project(part, z.0);
            let masses = &system.masses[parts.ranges()[part].clone()];
            let blocks = masses.chunks(SUM_BLOCK).zip(r.0.chunks(SUM_BLOCK)).zip(z.0.chunks(SUM_BLOCK));
            for ((dot, residual), ((m, r), z)) in dots.0.iter_mut().zip(residuals.0).zip(blocks) {
                *dot = plain_dot(r, z);
                // What is no number is seen in the sum, and passed over here.
                *residual = m.iter().zip(r).map(|(m, r)| r.norm_squared() / (m * m)).fold(0.0, f64::max);
            }
        });
        let (sum, largest) = parts.join_with_max(&self.dots, largest(&self.residuals));
        (sum, largest.sqrt())
    }

    /// `s = z + β s`.
    fn direction(&mut self, system: &BlockSystem<'_, impl Projection>, beta: f64) {
        let slices = (PerVertex(&mut self.s[system.parts.own()]), PerVertex(&mut self.z));
        system.parts.for_each(slices, &|_, (s, z)| {
            for (s, z) in s.0.iter_mut().zip(&*z.0) {
                // The first direction takes nothing of what an earlier solve has left, which may be no number.
                *s = if beta == 0.0 { *z } else { z + *s * beta };
            }
        });
    }

    /// `q = P A s`; returns `s·q`.
    fn product(&mut self, system: &BlockSystem<'_, impl Projection>) -> f64 {
        let parts = system.parts;
        // Parts without neighbours on other ranks are worked on while the others' directions are on their way.
        let flight = parts.halo().start(parts.ranks(), &self.s);
        if !parts.halo().is_empty() {
            self.product_of(system, Reach::Inside);
        }
        flight.finish(&mut self.s);
        self.product_of(system, if parts.halo().is_empty() { Reach::All } else { Reach::Border });
        parts.tree_sum(&self.dots)
    }

    /// The product of some of the parts.
    fn product_of(&mut self, system: &BlockSystem<'_, impl Projection>, reach: Reach) {
        let (parts, s, reaches_ghosts) = (system.parts, &self.s, &self.reaches_ghosts);
        parts.for_each((PerVertex(&mut self.q), PerBlock(&mut self.dots)), &|part, (q, dots)| {
            if !reach.includes(reaches_ghosts[part]) {
                return;
            }
            system.matrix.parts()[part].multiply(s, q.0);
            system.constraints.project(part, q.0);
            let own = &s[parts.ranges()[part].clone()];
            let blocks = own.chunks(SUM_BLOCK).zip(q.0.chunks(SUM_BLOCK));
            dots.0.iter_mut().zip(blocks).for_each(|(dot, (s, q))| *dot = plain_dot(s, q));
        });
    }

    /// `d += α s`, `r -= α q`.
    fn advance(&mut self, system: &BlockSystem<'_, impl Projection>, d: &mut [Vec3], alpha: f64) {
        let (parts, s) = (system.parts, &self.s);
        let own = parts.own();
        let vectors = (PerVertex(&mut d[own.clone()]), PerVertex(&mut self.r), PerVertex(&mut self.q));
        parts.for_each(vectors, &|part, (d, r, q)| {
            let s = &s[parts.ranges()[part].clone()];
            for ((d, r), (s, q)) in d.0.iter_mut().zip(r.0.iter_mut()).zip(s.iter().zip(&*q.0)) {
                *d += s * alpha;
                *r -= q * alpha;
            }
        });
        // Ghosts go the same way as with their owners: their directions are here.
        for ghost in (0..own.start).chain(own.end..s.len()) {
            d[ghost] += s[ghost] * alpha;
        }
    }
}

/// Sum of `a·b` over a block, one running sum per axis.
fn plain_dot(a: &[Vec3], b: &[Vec3]) -> f64 {
    let mut sum = Vec3::zeros();
    a.iter().zip(b).for_each(|(a, b)| sum += a.component_mul(b));
    sum.x + sum.y + sum.z
}

#[cfg(test)]
mod tests;
