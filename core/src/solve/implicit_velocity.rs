//! Half a step of velocity, B.1 and B.5: elastic forces explicit, damping implicit (`docs/theory/step.md`).
//!
//! `(I - h M⁻¹ G) v' = v + h M⁻¹ F` with h half the time step, F the forces that do not depend on velocity and G the damping
//! matrix, both at given positions.

use crate::Vec3;
use crate::contact::bodies::collision::BodyCollision;
use crate::effects::force::{Force, ForceContext, PartMotion, PartView};
use crate::parallel::for_each_part::{PerPart, PerVertex};
use crate::parallel::parts::{PART_SIZE, Parts};
use crate::parallel::simd4::Simd4;
use crate::pins::HardPins;
use crate::solve::conjugate_gradient::{ConjugateGradient, Outcome, Stop, System};

/// Forces of every part, in the order of the registry.
pub type PartForces = Vec<Vec<Box<dyn Force>>>;

/// Inputs of the solve.
pub struct VelocityProblem<'a> {
    /// The split of the vertices.
    pub parts: &'a Parts,
    /// Masses of the local vertices [kg].
    pub masses: &'a [f64],
    /// Inputs of the forces in addition to the positions.
    pub context: ForceContext<'a>,
    /// Hard pins, if there are any.
    pub pins: Option<&'a HardPins>,
    /// Contacts with bodies whose normals are constrained: in the second solve only.
    pub contacts: Option<&'a BodyCollision>,
    /// Half the time step [s].
    pub half_step: f64,
    /// Positions of the local vertices at which forces are evaluated [m], ghosts like those of their owners.
    pub x: &'a [Vec3],
    /// Fraction of the step that these positions belong to.
    pub fraction: f64,
    /// When to stop iterating.
    pub stop: Stop,
    /// Own vertices that stay where they are in this step, ascending.
    pub held: &'a [u32],
}

/// The operator `h M⁻¹ G` of a problem with the directions of the last update, and its constraints.
pub struct DampingSystem<'a> {
    problem: &'a VelocityProblem<'a>,
    forces: &'a PartForces,
}

impl<'a> DampingSystem<'a> {
    /// The operator of these forces.
    pub fn new(problem: &'a VelocityProblem<'a>, forces: &'a PartForces) -> Self {
        Self { problem, forces }
    }
}

impl System for DampingSystem<'_> {
    fn damping(&self, part: usize, s: &[Vec3], q: &mut [Vec3]) {
        let range = self.problem.parts.ranges()[part].clone();
        let mut f = [Simd4::ZERO; PART_SIZE];
        let f = &mut f[..range.len()];
        PartMotion::with(range.clone(), self.problem.x, s, |motion| {
            self.forces[part].iter().for_each(|force| force.add_damping(motion, f));
        });
        let (h, masses) = (self.problem.half_step, &self.problem.masses[range]);
        for ((q, f), m) in q.iter_mut().zip(f).zip(masses) {
            *q = (*f * (h / m)).into();
        }
    }

    fn project(&self, part: usize, r: &mut [Vec3]) {
        let start = self.problem.parts.ranges()[part].start;
        if let Some(contacts) = self.problem.contacts {
            contacts.project(start, r);
        }
        if let Some(pins) = self.problem.pins {
            pins.project(part, start, self.problem.context.targets, r);
        }
        stop_held(self.problem.held, start, r);
    }
}

/// Sets the held vertices, ascending, to zero in vectors of the vertices from `start` on.
pub(crate) fn stop_held(held: &[u32], start: usize, vectors: &mut [Vec3]) {
    if held.is_empty() {
        return;
    }
    let first = |vertex: usize| held.partition_point(|held| (*held as usize) < vertex);
    for held in &held[first(start)..first(start + vectors.len())] {
        vectors[*held as usize - start] = Vec3::zeros();
    }
}

impl VelocityProblem<'_> {
    /// Solves from `v`; the solution goes to `out`, `b = v + h M⁻¹ F` to `explicit`. Forces remember the directions at `x`.
    pub fn solve(
        &self,
        forces: &mut PartForces,
        cg: &mut ConjugateGradient,
        v: &[Vec3],
        explicit: &mut [Vec3],
        out: &mut [Vec3],
    ) -> Outcome {
        let own = self.parts.own();
        let slices = (PerVertex(&mut explicit[own.clone()]), PerVertex(&mut out[own]), PerPart(forces));
        self.parts.for_each(slices, &|part, (explicit, out, forces)| {
            let range = self.parts.ranges()[part].clone();
            let masses = &self.masses[range.clone()];
            let Self { x, fraction, context, .. } = *self;
            let view = PartView { start: range.start, masses, x, fraction, context };
            let mut f = [Simd4::ZERO; PART_SIZE];
            let f = view.update(&mut forces.0[0], &mut f);
            let sums = f.iter().zip(masses).zip(&v[range.clone()]).zip(explicit.0.iter_mut().zip(&mut *out.0));
            for (((f, m), v), (b, out)) in sums {
                *b = v + Vec3::from(*f * (self.half_step / m));
                *out = *b;
            }
            if let Some(contacts) = self.contacts {
                contacts.set_velocities(range.start, out.0);
            }
            if let Some(pins) = self.pins {
                pins.set_velocities(part, range.start, self.context.targets, out.0);
            }
            stop_held(self.held, range.start, explicit.0);
            stop_held(self.held, range.start, out.0);
        });
        self.parts.halo().update(self.parts.ranks(), out);
        cg.solve(self.parts, self.masses, &DampingSystem { problem: self, forces }, out, self.stop)
    }

    /// Undoes the projection: `v ← b + h M⁻¹ G v_cg`, so that constrained vertices get back the velocity that the forces
    /// would have given them, which is the load that friction needs. `v_cg` is not changed.
    ///
    /// In a part without a constrained contact there is nothing to undo: the solution is what the formula gives, to the
    /// tolerance of the solve.
    pub(crate) fn undo_projection(
        &self,
        contacts: &BodyCollision,
        forces: &PartForces,
        explicit: &[Vec3],
        v_cg: &[Vec3],
        out: &mut [Vec3],
    ) {
        let system = DampingSystem { problem: self, forces };
        self.parts.for_each(PerVertex(&mut out[self.parts.own()]), &|part, out| {
            let range = self.parts.ranges()[part].clone();
            if !contacts.is_constrained(range.clone()) {
                out.0.copy_from_slice(&v_cg[range]);
                return;
            }
            system.damping(part, v_cg, out.0);
            for (out, b) in out.0.iter_mut().zip(&explicit[range]) {
                *out += b;
            }
        });
    }
}
