//! Preconditioned, projected conjugate gradients for `P A P d = P b` with an assembled matrix
//! (`docs/theory/linear_solver.md`).
//!
//! The unknowns are changes of velocity [m/s], the right-hand side is an impulse [N s], A has the unit of a mass [kg]. The
//! residual is measured by the largest nodal |r|/m [m/s]. An iteration is three passes over the parts: the direction, its
//! product, and the step with what the preconditioner needs of the new residual; the preconditioned residual itself is never
//! stored. With several ranks it is two latencies: one for the sum of a product; one for the sums of a step, for the residuals of the
//! coarse levels, and for the ghosts, of which the directions follow from residuals ([`GhostDirections`]).

use std::ops::Range;

use crate::Vec3;
use crate::block_matrix::BlockMatrix;
use crate::long_steps::FORCING;
use crate::parallel::for_each_part::{PerBlock, PerPart, PerVertex};
use crate::parallel::parts::Parts;
use crate::parallel::reduce::{SUM_BLOCK, largest};
use crate::parallel::simd4::Simd4;
use crate::solve::block_jacobi::BlockInverses;
pub use crate::solve::block_system::{BlockSystem, Projection};
use crate::solve::conjugate_gradient::{BREAKDOWN, Outcome, Stop};
use crate::solve::constraints::Constraints;
use crate::solve::ghost_directions::{AT_REST, GhostDirections, GhostRow};
use crate::solve::multilevel::Multilevel;
use crate::solve::pair_terms::PairTerms;
use crate::solve::volume_terms::VolumeTerms;

/// Stopping rule of the solves of Newton's method: errors that the next step makes anyway are not worth iterations
/// (S. C. Eisenstat, H. F. Walker, "Choosing the forcing terms in an inexact Newton method", SIAM J. Sci. Comput. 17,
/// 1996, choice 2).
#[derive(Debug)]
pub(crate) struct Forcing {
    /// Squared norm of the error with which the solve before began [J].
    before: Option<f64>,
    /// Changes of velocities up to here are linear enough for a solve to go to its end [m/s].
    far: f64,
}

impl Forcing {
    /// For solves of which those that change no velocity by more than this [m/s] go to their end.
    pub(crate) fn new(far: f64) -> Self {
        Self { before: None, far }
    }

    /// Returns the share of the squared norm of the error, in the norm of the preconditioner, that this solve may
    /// leave. The share is small where the steps before have shown that forces are nearly linear.
    fn share(&mut self, error: f64) -> f64 {
        let left = self.before.replace(error).map_or(FORCING, |before| FORCING.min(0.9 * error / before));
        left * left
    }
}

/// Scratch and preconditioner of the solver; made once for the elements of a matrix.
#[derive(Debug)]
pub struct PreconditionedCg {
    /// The finest level of the preconditioner, by parts.
    inverses: Vec<BlockInverses>,
    /// All others.
    coarse: Multilevel,
    constraints: Constraints,
    /// Terms that pairs in touch add to A.
    pairs: PairTerms,
    /// Terms that enclosed gas adds to A.
    volumes: VolumeTerms,
    ghosts: GhostDirections,
    r: Vec<Simd4>,
    q: Vec<Simd4>,
    /// Search direction of the local vertices.
    s: Vec<Simd4>,
    d: Vec<Simd4>,
    /// Inverse masses of the own vertices [1/kg]; zero where there is no mass.
    inverse_masses: Vec<f64>,
    dots: Vec<f64>,
    residuals: Vec<f64>,
}

impl PreconditionedCg {
    /// Scratch for the vertices of a rank and the elements of this matrix. All ranks call it together.
    pub fn new(parts: &Parts, matrix: &BlockMatrix) -> Self {
        let own = vec![Simd4::ZERO; parts.own().len()];
        let local = vec![Simd4::ZERO; parts.local_count()];
        let blocks = vec![0.0; parts.block_count()];
        Self {
            inverses: parts.ranges().iter().map(|range| BlockInverses::new(range.len())).collect(),
            coarse: Multilevel::new(parts, matrix),
            constraints: Constraints::none(parts),
            pairs: PairTerms::default(),
            volumes: VolumeTerms::default(),
            ghosts: GhostDirections::default(),
            r: own.clone(),
            q: own,
            s: local.clone(),
            d: local,
            inverse_masses: vec![0.0; parts.own().len()],
            dots: blocks.clone(),
            residuals: blocks,
        }
    }

    /// Memory held [bytes].
    pub fn bytes(&self) -> usize {
        2 * (self.r.len() + self.s.len()) * size_of::<Simd4>()
            + 2 * size_of_val(&*self.dots)
            + self.inverses.iter().map(BlockInverses::bytes).sum::<usize>()
            + self.coarse.bytes()
            + self.constraints.bytes()
            + self.pairs.bytes()
            + self.volumes.bytes()
            + self.ghosts.bytes()
    }

    /// The pairs in touch, which are part of A.
    pub(crate) fn pairs(&self) -> &PairTerms {
        &self.pairs
    }

    /// The same, to be changed; after a solve they have their products with the solution.
    pub(crate) fn pairs_mut(&mut self) -> &mut PairTerms {
        &mut self.pairs
    }

    /// The volumes of gas, which are part of A but not of its preconditioner: each adds one eigenvalue, which takes one iteration.
    pub(crate) fn volumes_mut(&mut self) -> &mut VolumeTerms {
        &mut self.volumes
    }

    /// Makes the preconditioner that of this system. It may be kept while matrix and constraints change: solves then take more
    /// iterations and come to the same result. All ranks call it together.
    pub fn prepare(&mut self, system: &BlockSystem<'_, impl Projection>) {
        self.prepare_finest(system);
        let parts = system.parts;
        self.begin_ghosts(parts, &vec![true; parts.count()]);
        self.ghosts.send_rows(parts.ranks());
        self.coarse.prepare(parts, system.matrix, &self.pairs, &self.constraints, &self.ghosts);
    }

    /// The same on the finest level alone, in the parts that are solved.
    pub(crate) fn prepare_finest(&mut self, system: &BlockSystem<'_, impl Projection>) {
        let (parts, pairs) = (system.parts, &self.pairs);
        self.constraints.update(system);
        parts.for_each(PerPart(&mut self.inverses), &|part, inverses| {
            if !system.worked_on[part] {
                return;
            }
            let mut blocks = system.matrix.parts()[part].diagonal_blocks();
            pairs.add_diagonal(part, &mut blocks);
            blocks.iter().enumerate().for_each(|(vertex, block)| inverses.0[0].set(vertex, block));
        });
    }

    /// Own vertices at which the last solve has left more than its tolerance, by their numbers in the scene.
    pub(crate) fn unsolved(&self, parts: &Parts, stop: Stop) -> Vec<u32> {
        let nodal = self.r.iter().zip(&self.inverse_masses).map(|(r, inverse_mass)| *r * *inverse_mass);
        let is_left = |r: &Simd4| r.dot(*r).sqrt() > stop.tolerance;
        let left = parts.own().zip(nodal).filter(|(_, r)| is_left(r));
        left.map(|(vertex, _)| parts.number(vertex)).collect()
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
        self.solve_until(system, (b, d), stop, None)
    }

    /// The same as a step of Newton's method, as far as `forcing` says.
    pub(crate) fn newton_step(
        &mut self,
        system: &BlockSystem<'_, impl Projection>,
        b: &[Vec3],
        d: &mut [Vec3],
        stop: Stop,
        forcing: &mut Forcing,
    ) -> Outcome {
        self.solve_until(system, (b, d), stop, Some(forcing))
    }

    fn solve_until(
        &mut self,
        system: &BlockSystem<'_, impl Projection>,
        (b, d): (&[Vec3], &mut [Vec3]),
        stop: Stop,
        forcing: Option<&mut Forcing>,
    ) -> Outcome {
        self.constraints.update(system);
        self.d.fill(Simd4::ZERO);
        self.s.fill(Simd4::ZERO);
        self.q.fill(Simd4::ZERO);
        self.r.fill(Simd4::ZERO);
        self.dots.fill(0.0);
        self.residuals.fill(0.0);
        let (parts, start) = (system.parts, system.parts.own().start);
        let coarse = self.coarse.parts_mut();
        for ((range, worked_on), coarse) in parts.ranges().iter().zip(system.worked_on).zip(coarse) {
            let own = range.start - start..range.end - start;
            if *worked_on {
                self.r[own.clone()].iter_mut().zip(&b[own]).for_each(|(r, b)| *r = Simd4::from(b));
            } else {
                coarse.restrict(&self.r[own]);
            }
        }
        let masses = &system.masses[system.parts.own()];
        let inverse = |mass: &f64| if *mass > 0.0 { mass.recip() } else { 0.0 };
        self.inverse_masses.iter_mut().zip(masses).for_each(|(to, mass)| *to = inverse(mass));
        self.begin_ghosts(parts, system.worked_on);
        let outcome = self.iterate(system, stop, forcing);
        self.pairs.multiply(&self.d[parts.own()], self.ghosts.node_solutions());
        d.iter_mut().zip(&self.d).for_each(|(d, found)| *d = Vec3::from(*found));
        outcome
    }

    /// Lays out the ghosts, and the rows of own vertices that other ranks get.
    fn begin_ghosts(&mut self, parts: &Parts, worked_on: &[bool]) {
        let Self { constraints, inverses, coarse, pairs, ghosts, .. } = self;
        ghosts.begin(parts, pairs.nodes(), |vertex| {
            let part = parts.part_of(vertex);
            let place = vertex - parts.ranges()[part].start;
            let node = if worked_on[part] { coarse.node(vertex) } else { AT_REST };
            GhostRow {
                columns: constraints.columns(part, place),
                inverse: inverses[part].block(place),
                node,
                r: [0.0; 4],
            }
        });
    }

    /// The iterations, from d = 0, r = b and no direction.
    fn iterate(
        &mut self,
        system: &BlockSystem<'_, impl Projection>,
        stop: Stop,
        forcing: Option<&mut Forcing>,
    ) -> Outcome {
        let (mut rho, mut residual) = self.step(system, 0.0);
        let first = residual;
        let (mut enough, far) = forcing.map_or((0.0, 0.0), |forcing| (rho * forcing.share(rho), forcing.far));
        let (mut rho_before, mut alpha) = (f64::INFINITY, 0.0);
        for iterations in 0.. {
            let finite = rho.is_finite();
            if rho <= enough && !self.has_moved(system.parts, alpha, far) {
                enough = 0.0;
            }
            let is_small = residual <= stop.tolerance || rho <= enough;
            let converged = is_small && (iterations >= 1 || residual < f64::EPSILON);
            if converged || rho <= 0.0 || !finite || iterations == stop.max_iterations {
                self.d.iter_mut().zip(&self.s).for_each(|(d, s)| *d += *s * alpha);
                self.ghosts.finish(alpha);
                self.ghosts.local_solutions().for_each(|(ghost, d)| self.d[ghost] = d);
                let converged = finite && (converged || residual == 0.0);
                let worse = !converged && (residual > BREAKDOWN * first || rho < 0.0);
                return Outcome { solves: 1, iterations, converged, finite, worse };
            }
            self.direction(system, alpha, rho / rho_before);
            let curvature = self.product(system);
            (rho_before, alpha) = (rho, rho / curvature);
            (rho, residual) = self.step(system, alpha);
        }
        unreachable!("the loop ends at the largest number of iterations")
    }

    /// Whether some vertex of `d + α s` has changed by more than `far` [m/s].
    fn has_moved(&self, parts: &Parts, alpha: f64, far: f64) -> bool {
        let own = parts.own();
        let mut changes = self.d[own.clone()].iter().zip(&self.s[own]).map(|(d, s)| *d + *s * alpha);
        parts.ranks().any(changes.any(|change| change.dot(change) > far * far))
    }

    /// `r = P (r - α q)`, and the correction of the coarse levels; returns `r·W r` with the preconditioner W, and the largest
    /// nodal `|r|/m`.
    fn step(&mut self, system: &BlockSystem<'_, impl Projection>, alpha: f64) -> (f64, f64) {
        let (parts, constraints, inverses) = (system.parts, &self.constraints, &self.inverses);
        let inverse_masses = &self.inverse_masses;
        let vectors = (PerVertex(&mut self.r), PerVertex(&mut self.q));
        let sums = (PerBlock(&mut self.dots), PerBlock(&mut self.residuals));
        let coarse = PerPart(self.coarse.parts_mut());
        let first = parts.own().start;
        parts.for_each((vectors, sums, coarse), &|part, ((r, q), (dots, residuals), coarse)| {
            if !system.worked_on[part] {
                return;
            }
            r.0.iter_mut().zip(&*q.0).for_each(|(r, q)| *r -= *q * alpha);
            constraints.project(part, r.0);
            let Range { start, end } = parts.ranges()[part];
            let inverse_masses = &inverse_masses[start - first..end - first];
            let mut blocks = inverses[part].blocks();
            let chunks = inverse_masses.chunks(SUM_BLOCK).zip(r.0.chunks(SUM_BLOCK));
            for ((dot, residual), (masses, r)) in dots.0.iter_mut().zip(residuals.0).zip(chunks) {
                let (mut sum, mut largest) = (Simd4::ZERO, 0.0_f64);
                for ((inverse_mass, r), block) in masses.iter().zip(r).zip(&mut blocks) {
                    sum += r.component_mul(BlockInverses::times(block, *r));
                    let nodal = *r * *inverse_mass;
                    // A value that is not a number is found in the sum; `max` ignores it.
                    largest = largest.max(nodal.dot(nodal));
                }
                (*dot, *residual) = (sum.sum(), largest);
            }
            coarse.0[0].restrict(r.0);
        });
        let Self { coarse, ghosts, r, dots, residuals, .. } = self;
        let join = || coarse.solve(parts, dots, largest(residuals));
        let (sum, largest) = ghosts.send_residuals(parts.ranks(), r, join);
        (sum, largest.sqrt())
    }

    /// `d += α s` with the direction so far, and the new one, `s = P (W r + β s)`.
    fn direction(&mut self, system: &BlockSystem<'_, impl Projection>, alpha: f64, beta: f64) {
        let (parts, constraints, inverses, coarse) = (system.parts, &self.constraints, &self.inverses, &self.coarse);
        let own = parts.own();
        self.ghosts.advance(alpha, beta, |node| coarse.correction(node));
        self.ghosts.local_directions().for_each(|(ghost, s)| self.s[ghost] = s);
        let vectors = (PerVertex(&mut self.s[own.clone()]), PerVertex(&mut self.d[own]), PerVertex(&mut self.r));
        parts.for_each(vectors, &|part, (s, d, r)| {
            if !system.worked_on[part] {
                return;
            }
            let steps = s.0.iter_mut().zip(&mut *d.0).zip(&*r.0).zip(inverses[part].blocks());
            for ((((s, d), r), block), x) in steps.zip(coarse.corrections(part)) {
                *d += *s * alpha;
                *s = BlockInverses::times(block, *r) + x + *s * beta;
            }
            constraints.project(part, s.0);
        });
    }

    /// `q = P A s`; returns `s·q`.
    fn product(&mut self, system: &BlockSystem<'_, impl Projection>) -> f64 {
        let (parts, s) = (system.parts, &self.s);
        self.pairs.multiply(&s[parts.own()], self.ghosts.node_directions());
        self.volumes.multiply(parts, s);
        let (constraints, pairs, volumes) = (&self.constraints, &self.pairs, &self.volumes);
        parts.for_each((PerVertex(&mut self.q), PerBlock(&mut self.dots)), &|part, (q, dots)| {
            if !system.worked_on[part] {
                return;
            }
            system.matrix.parts()[part].multiply_padded(s, q.0);
            pairs.add_product(part, q.0);
            volumes.add_product(parts, part, q.0);
            constraints.project(part, q.0);
            let chunks = s[parts.ranges()[part].clone()].chunks(SUM_BLOCK).zip(q.0.chunks(SUM_BLOCK));
            for (dot, (s, q)) in dots.0.iter_mut().zip(chunks) {
                let mut sum = Simd4::ZERO;
                s.iter().zip(q).for_each(|(s, q)| sum += s.component_mul(*q));
                *dot = sum.sum();
            }
        });
        parts.tree_sum(&self.dots)
    }
}

#[cfg(test)]
mod tests;
