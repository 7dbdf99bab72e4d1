//! Half a step of velocity, B.1 and B.5: elastic forces explicit, damping implicit (`docs/theory/step.md`).
//!
//! `(I - h M⁻¹ G) v' = v + h M⁻¹ F` with h half the time step, F the forces that do not depend on velocity and G the damping
//! matrix, both at given positions.
//!
//! A drag −c v that acts on each vertex alone is not in G: moved to the left side it divides the equation of its vertex by
//! 1 + h c/m, as [`EffectiveMasses`] m + h c do. It is then exact at every tolerance of the solve.

use crate::Vec3;
use crate::contact::bodies::collision::BodyCollision;
use crate::effects::force::{Force, ForceContext, PartForce, PartMotion, PartView};
use crate::parallel::for_each_part::{PerPart, PerVertex};
use crate::parallel::parts::{PART_SIZE, Parts};
use crate::parallel::simd4::Simd4;
use crate::pins::HardPins;
use crate::solve::conjugate_gradient::{ConjugateGradient, Outcome, Stop, System};

/// Forces of every part, in the order of the registry.
pub type PartForces = Vec<Vec<Box<dyn Force>>>;

/// Puts forces to the parts on which they act, in the order in which they come.
pub fn by_part(parts: &Parts, forces: impl IntoIterator<Item = PartForce>) -> PartForces {
    let mut all: PartForces = (0..parts.count()).map(|_| Vec::new()).collect();
    forces.into_iter().for_each(|(part, force)| all[part].push(force));
    all
}

/// Masses of the solves, m + h c with the drag coefficient c of each vertex.
#[derive(Debug, Default)]
pub struct EffectiveMasses(Vec<f64>);

impl EffectiveMasses {
    /// For these forces; without memory where none of them has a drag.
    pub fn new(forces: &PartForces, masses: &[f64]) -> Self {
        let has_drag = forces.iter().flatten().any(|force| !force.vertex_drag().is_empty());
        Self(if has_drag { masses.to_vec() } else { Vec::new() })
    }

    /// Sets those of the own vertices for half a time step h [s].
    pub fn set(&mut self, parts: &Parts, forces: &PartForces, masses: &[f64], half_step: f64) {
        if self.0.is_empty() {
            return;
        }
        self.0.copy_from_slice(masses);
        for (range, forces) in parts.ranges().iter().zip(forces) {
            for force in forces {
                let drag = self.0[range.clone()].iter_mut().zip(force.vertex_drag());
                drag.for_each(|(mass, drag)| *mass += half_step * drag);
            }
        }
    }

    /// Masses of the local vertices, set for the own ones [kg]; `None` where there is no drag.
    pub fn get(&self) -> Option<&[f64]> {
        (!self.0.is_empty()).then_some(&self.0)
    }

    /// Memory held [bytes].
    pub fn bytes(&self) -> usize {
        size_of_val(&*self.0)
    }
}

/// Inputs of the solve.
pub struct VelocityProblem<'a> {
    /// The split of the vertices.
    pub parts: &'a Parts,
    /// Masses of the local vertices [kg].
    pub masses: &'a [f64],
    /// Masses of the solve where a force has a drag: [`EffectiveMasses`].
    pub effective_masses: Option<&'a [f64]>,
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
        let (h, masses) = (self.problem.half_step, &self.problem.masses_of_solve()[range]);
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
    /// Masses of the local vertices with which the system is solved [kg].
    fn masses_of_solve(&self) -> &[f64] {
        self.effective_masses.unwrap_or(self.masses)
    }

    /// Solves from `v`; the solution goes to `out`, `b = (M v + h F) / (M + h c)` to `explicit`. Forces remember the directions
    /// at `x`.
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
            if let Some(effective) = self.effective_masses {
                let slowed = explicit.0.iter_mut().zip(&mut *out.0).zip(masses.iter().zip(&effective[range.clone()]));
                for ((b, out), (mass, effective)) in slowed {
                    *b *= mass / effective;
                    *out = *b;
                }
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
        cg.solve(self.parts, self.masses_of_solve(), &DampingSystem { problem: self, forces }, out, self.stop)
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
            for (out, b) in out.0.iter_mut().zip(&explicit[range.clone()]) {
                *out += b;
            }
            if let Some(effective) = self.effective_masses {
                // The drag acts on the velocity of the solution, not on the load that its constraints take.
                let loads = out.0.iter_mut().zip(&v_cg[range.clone()]);
                for ((out, v), (mass, effective)) in loads.zip(self.masses[range.clone()].iter().zip(&effective[range]))
                {
                    *out = v + (*out - v) * (effective / mass);
                }
            }
        });
    }
}
