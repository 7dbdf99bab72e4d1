//! Matrix-free, projected conjugate gradients for `(I - h M⁻¹ G) v = b` in the mass inner product
//! (`docs/theory/step.md#the-damping-solve`).
//!
//! The unknowns are velocities; the residual is measured by its largest nodal length [m/s]. Because the initial guess
//! satisfies every constraint, the first projected residual is `P h M⁻¹ G v` and the right-hand side itself is not needed.
//! Each iteration is three passes over the parts, each reading and writing every array once. With several ranks it is two
//! latencies: residuals are on their way to the ghosts while all ranks join the sums of these, and the directions of ghosts
//! follow from them.

use crate::Vec3;
use crate::parallel::for_each_part::{PerBlock, PerVertex};
use crate::parallel::parts::Parts;
use crate::parallel::reduce::{SUM_BLOCK, largest, weighted_dot};

/// The operator and the constraints.
pub trait System: Sync {
    /// Writes `h M⁻¹ G s` of one part into `q`, the part's own slice; `s` are velocities of the local vertices.
    fn damping(&self, part: usize, s: &[Vec3], q: &mut [Vec3]);

    /// Removes the constrained directions of one part from `r`, the part's own slice.
    fn project(&self, part: usize, r: &mut [Vec3]);
}

/// Scratch of the solver; made once.
#[derive(Debug)]
pub struct ConjugateGradient {
    /// Residual and search direction of the local vertices.
    r: Vec<Vec3>,
    s: Vec<Vec3>,
    q: Vec<Vec3>,
    dots: Vec<f64>,
    residuals: Vec<f64>,
}

/// When to stop.
#[derive(Debug, Clone, Copy)]
pub struct Stop {
    /// Largest nodal residual [m/s].
    pub tolerance: f64,
    /// Largest number of iterations.
    pub max_iterations: usize,
}

impl Stop {
    /// The same with `times` as many iterations.
    pub(crate) fn later(self, times: usize) -> Self {
        Self { max_iterations: self.max_iterations.saturating_mul(times), ..self }
    }
}

/// Outcome of a solve.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Outcome {
    /// Systems that were solved: one, or one for each round of a stage.
    pub solves: usize,
    /// Iterations made.
    pub iterations: usize,
    /// Whether the tolerance was reached.
    pub converged: bool,
    /// Whether every number stayed finite.
    pub finite: bool,
    /// Whether the residual was much larger at the end than at the beginning.
    pub worse: bool,
}

impl Outcome {
    /// Outcome if nothing was solved.
    pub const NONE: Self = Self { solves: 0, iterations: 0, converged: true, finite: true, worse: false };
}

/// Cap on the final residual of a solve that has not converged, as a multiple of its first residual.
pub(super) const BREAKDOWN: f64 = 10.0;

impl ConjugateGradient {
    /// Scratch for the vertices of a rank.
    pub fn new(parts: &Parts) -> Self {
        let [own, local] = [parts.own().len(), parts.local_count()].map(|count| vec![Vec3::zeros(); count]);
        let blocks = vec![0.0; parts.block_count()];
        Self { r: local.clone(), s: local, q: own, dots: blocks.clone(), residuals: blocks }
    }

    /// Memory held [bytes].
    pub fn bytes(&self) -> usize {
        (2 * self.s.len() + self.q.len()) * size_of::<Vec3>() + 2 * self.dots.len() * size_of::<f64>()
    }

    /// Own vertices at which the last solve has left more than its tolerance, by their numbers in the scene.
    pub(crate) fn unsolved(&self, parts: &Parts, stop: Stop) -> Vec<u32> {
        let left = parts.own().zip(&self.r[parts.own()]).filter(|(_, r)| r.norm() > stop.tolerance);
        left.map(|(vertex, _)| parts.number(vertex)).collect()
    }

    /// Solves in place: `v` holds the initial guess, which satisfies the constraints, and then the solution; the ghosts are
    /// those of their owners before and after.
    pub fn solve(
        &mut self,
        parts: &Parts,
        masses: &[f64],
        system: &impl System,
        v: &mut [Vec3],
        stop: Stop,
    ) -> Outcome {
        let (mut rho, mut residual) = self.first_residual(parts, masses, system, v);
        let first = residual;
        let mut rho_before = f64::INFINITY;
        for iterations in 0.. {
            let finite = rho.is_finite();
            let converged = residual <= stop.tolerance && (iterations >= 1 || residual < f64::EPSILON);
            if converged || rho == 0.0 || !finite || iterations == stop.max_iterations {
                let converged = converged || rho == 0.0;
                let worse = !converged && residual > BREAKDOWN * first;
                return Outcome { solves: 1, iterations, converged, finite, worse };
            }
            if iterations > 0 {
                self.direction(parts, rho / rho_before);
            }
            let curvature = self.product(parts, masses, system);
            rho_before = rho;
            (rho, residual) = self.advance(parts, masses, v, rho / curvature);
        }
        unreachable!("the loop ends at the largest number of iterations")
    }

    /// `r = P h M⁻¹ G v`, which is also the first direction `s`; returns `<r, r>` and the largest nodal residual.
    fn first_residual(&mut self, parts: &Parts, masses: &[f64], system: &impl System, v: &[Vec3]) -> (f64, f64) {
        let vectors = (PerVertex(&mut self.r[parts.own()]), PerVertex(&mut self.s[parts.own()]));
        let blocks = (PerBlock(&mut self.dots), PerBlock(&mut self.residuals));
        parts.for_each((vectors, blocks), &|part, ((r, s), (dots, residuals))| {
            system.damping(part, v, r.0);
            system.project(part, r.0);
            s.0.copy_from_slice(r.0);
            measure(&masses[parts.ranges()[part].clone()], r.0, dots.0, residuals.0);
        });
        let norms = self.norms(parts);
        parts.ghost_places().for_each(|ghost| self.s[ghost] = self.r[ghost]);
        norms
    }

    /// `s = r + β s`.
    fn direction(&mut self, parts: &Parts, beta: f64) {
        let own = parts.own();
        parts.for_each((PerVertex(&mut self.s[own.clone()]), PerVertex(&mut self.r[own])), &|_, (s, r)| {
            for (s, r) in s.0.iter_mut().zip(&*r.0) {
                *s = r + *s * beta;
            }
        });
        // The same operations as their owners do.
        parts.ghost_places().for_each(|ghost| self.s[ghost] = self.r[ghost] + self.s[ghost] * beta);
    }

    /// `<r, r>` and the largest nodal residual, of all ranks; the ghosts get their residuals.
    fn norms(&mut self, parts: &Parts) -> (f64, f64) {
        let flight = parts.halo().start(parts.ranks(), &self.r);
        let (sum, largest) = parts.join_with_max(&self.dots, largest(&self.residuals));
        flight.finish(&mut self.r);
        (sum, largest.sqrt())
    }

    /// `q = P A s`; returns `<s, q>`.
    pub fn product(&mut self, parts: &Parts, masses: &[f64], system: &impl System) -> f64 {
        let s = &self.s;
        parts.for_each((PerVertex(&mut self.q), PerBlock(&mut self.dots)), &|part, (q, dots)| {
            let range = parts.ranges()[part].clone();
            system.damping(part, s, q.0);
            for (q, s) in q.0.iter_mut().zip(&s[range.clone()]) {
                *q = s - *q;
            }
            system.project(part, q.0);
            let blocks =
                masses[range.clone()].chunks(SUM_BLOCK).zip(s[range].chunks(SUM_BLOCK)).zip(q.0.chunks(SUM_BLOCK));
            for (dot, ((m, s), q)) in dots.0.iter_mut().zip(blocks) {
                *dot = weighted_dot(m, s, q);
            }
        });
        parts.tree_sum(&self.dots)
    }

    /// `v += α s`, `r -= α q`; returns `<r, r>` and the largest nodal residual.
    fn advance(&mut self, parts: &Parts, masses: &[f64], v: &mut [Vec3], alpha: f64) -> (f64, f64) {
        let s = &self.s;
        let own = parts.own();
        let blocks = (PerBlock(&mut self.dots), PerBlock(&mut self.residuals));
        let vectors = (PerVertex(&mut v[own.clone()]), PerVertex(&mut self.r[own]), PerVertex(&mut self.q));
        parts.for_each((vectors, blocks), &|part, ((v, r, q), (dots, residuals))| {
            let range = parts.ranges()[part].clone();
            let steps = v.0.iter_mut().zip(r.0.iter_mut()).zip(s[range.clone()].iter().zip(&*q.0));
            for ((v, r), (s, q)) in steps {
                *v += s * alpha;
                *r -= q * alpha;
            }
            measure(&masses[range], r.0, dots.0, residuals.0);
        });
        // Ghosts go the same way as with their owners: their directions are here.
        parts.ghost_places().for_each(|ghost| v[ghost] += s[ghost] * alpha);
        self.norms(parts)
    }
}

/// Block sums of `<r, r>` and block maxima of `|r|²`.
fn measure(masses: &[f64], r: &[Vec3], dots: &mut [f64], residuals: &mut [f64]) {
    let blocks = masses.chunks(SUM_BLOCK).zip(r.chunks(SUM_BLOCK));
    for ((dot, residual), (m, r)) in dots.iter_mut().zip(residuals).zip(blocks) {
        let (mut sum, mut max) = (0.0, 0.0_f64);
        for (m, r) in m.iter().zip(r) {
            let squared = r.norm_squared();
            sum += m * squared;
            max = max.max(squared);
        }
        (*dot, *residual) = (sum, max);
    }
}
