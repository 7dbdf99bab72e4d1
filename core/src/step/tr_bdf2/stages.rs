//! The two stages of the scheme: predictions, and what each stage balances.

use super::arrays::StageArrays;
use super::prescription::Prescription;
use super::{ALPHA, GAMMA, U, W};
use crate::Vec3;
use crate::contact::bodies::Bodies;
use crate::contact::bodies::active_set::{ActiveContact, ActiveSet, StageDrag, StartOfContact};
use crate::contact::bodies::recovery_speed::RecoverySpeed;
use crate::contact::self_contact::SelfContact;
use crate::effects::force::{BlockFactors, ForceContext};
use crate::parallel::parts::Parts;
use crate::pins::{HardPins, PinTargets};
use crate::solve::conjugate_gradient::{Outcome, Stop};
use crate::solve::force_evaluation::ForceEvaluation;
use crate::solve::implicit_velocity::PartForces;
use crate::state::State;
use crate::volumes::Volumes;
use crate::wind_grid::WindGrid;

/// A step as its stages see it.
#[derive(Clone, Copy)]
pub(super) struct StageContext<'a> {
    pub(super) parts: &'a Parts,
    pub(super) masses: &'a [f64],
    pub(super) dt: f64,
    pub(super) stop: Stop,
    pub(super) recovery_speed: RecoverySpeed,
    pub(super) held: &'a [u32],
    /// The state at the start of the step.
    pub(super) start: &'a State,
    pub(super) wind: &'a WindGrid,
    pub(super) pins: Option<&'a HardPins>,
    pub(super) targets: &'a PinTargets,
    /// Cap on the extrapolated displacement of a vertex [m].
    pub(super) extrapolated: f64,
}

impl<'a> StageContext<'a> {
    /// Extrapolated change of a velocity, capped [m/s].
    fn extrapolated(&self, change: Vec3) -> Vec3 {
        let moved = change.norm() * ALPHA * self.dt;
        if moved > self.extrapolated { change * (self.extrapolated / moved) } else { change }
    }

    pub(super) fn with(&self, active: &'a ActiveSet) -> Prescription<'a> {
        let Self { parts, pins, targets, recovery_speed, held, .. } = *self;
        Prescription { parts, pins, targets, recovery_speed, held, active }
    }
}

/// A step in its stages: its arrays, and all that they evaluate.
pub(super) struct Stages<'a> {
    pub(super) at: StageContext<'a>,
    pub(super) arrays: &'a mut StageArrays,
    /// Vertices that rest on bodies.
    pub(super) active: &'a mut ActiveSet,
    pub(super) forces: &'a mut PartForces,
    pub(super) volumes: &'a mut Volumes,
    /// Pairs of cloth that repel each other, and edges and faces of cloth that deforming bodies do.
    pub(super) repulsion: Option<&'a mut SelfContact>,
    pub(super) bodies: &'a Bodies,
}

/// A solve of a step.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Stage {
    First,
    Second,
    /// The second, in B.5.
    SecondAgain,
}

impl Stage {
    /// Its end, as a fraction of the step.
    pub(super) fn fraction(self) -> f64 {
        if self == Self::First { GAMMA } else { 1.0 }
    }

    /// Weight of forces of pairs at its end, over the weight of forces of elements.
    pub(super) fn share_of_pairs(self) -> f64 {
        if self == Self::First { 2.0 } else { 1.0 }
    }
}

impl<'a> Stages<'a> {
    /// The forces on the parts that are worked on, at the stage, and, `with_matrix`, the matrix there.
    pub(super) fn evaluate(&mut self, fraction: f64, with_matrix: bool) {
        let (dt, alpha) = (self.at.dt, ALPHA * self.at.dt);
        let StageArrays { matrix, slots, x, v, f, unconverged: solved, .. } = &mut *self.arrays;
        self.volumes.update(self.at.parts, x);
        let (targets, wind, volumes) = (self.at.targets, self.at.wind, &*self.volumes);
        let context = ForceContext { time: self.at.start.time + fraction * dt, targets, v, wind, volumes };
        let at = ForceEvaluation { parts: self.at.parts, masses: self.at.masses, solved, x, v, fraction, context };
        if with_matrix {
            let factors = BlockFactors { damping: alpha, stiffness: alpha * alpha };
            at.linearise(self.forces, f, factors, matrix, slots);
        } else {
            at.forces(self.forces, f);
        }
    }

    /// The start: velocities that contacts allow, and the forces.
    pub(super) fn begin(&mut self) {
        let at = self.at;
        self.arrays.x.copy_from_slice(&at.start.x);
        self.arrays.unconverged.fill(true);
        self.arrays.pairs.clear();
        self.evaluate_start();
        if let Some(contact) = &mut self.repulsion {
            let own = at.parts.own().zip(&self.arrays.f);
            let free = |(vertex, f): (usize, &Vec3)| (!self.active.holds(vertex)).then(|| f / at.masses[vertex]);
            contact.set_unrepelled(own.map(free));
        }
        let mut repelled = vec![Vec3::zeros(); self.arrays.f.len()];
        self.evaluate_pairs(0.0);
        self.add_pair_impulses(1.0, &mut repelled);
        // Newton's second law says what bodies gave at the end of the step before.
        let given = |vertex: usize| {
            let own = vertex - at.parts.own().start;
            let (acceleration, mass) = (at.start.a[vertex], at.masses[vertex]);
            let force = acceleration * mass - self.arrays.f[own] - repelled[own];
            StartOfContact { force, doubt: at.stop.tolerance * mass / at.dt, acceleration }
        };
        let changed = self.active.expect(at.dt, GAMMA * at.dt, given);
        if at.parts.ranks().any(changed) {
            self.evaluate_start();
        }
        self.arrays.f_start.copy_from_slice(&self.arrays.f);
    }

    /// Velocities and forces at the start, with contacts in these modes.
    fn evaluate_start(&mut self) {
        let (at, dt) = (self.at, self.at.dt);
        let StageArrays { v_start, v, .. } = &mut *self.arrays;
        v_start.copy_from_slice(&at.start.v);
        let pushed =
            |contact: &ActiveContact, v: &mut Vec3| *v = contact.start_velocity(*v, &contact.velocity_at(0.0, dt));
        at.with(self.active).set_velocities(v_start, pushed);
        v.copy_from_slice(v_start);
        self.evaluate(0.0, false);
    }

    /// The trapezoid: x₁ and v₁.
    pub(super) fn first_stage(&mut self) -> Outcome {
        let (dt, alpha) = (self.at.dt, ALPHA * self.at.dt);
        let at = self.at;
        let StageArrays { v_start, x, v, .. } = &mut *self.arrays;
        for ((v, start), a) in v.iter_mut().zip(&*v_start).zip(&self.at.start.a) {
            *v = start + at.extrapolated(a * (GAMMA * dt));
        }
        let prescription = at.with(self.active);
        prescription.set_velocities(v, |contact, v| contact.prescribe(v, &contact.velocity_at(GAMMA, dt)));
        for (((x, start), v_start), v) in x.iter_mut().zip(&self.at.start.x).zip(&*v_start).zip(&*v) {
            *x = start + (v_start + v) * alpha;
        }
        prescription.set_positions(GAMMA, &self.at.start.x, x);
        self.evaluate(GAMMA, true);
        let v_start = &self.arrays.v_start;
        let earlier = |vertex: usize| (v_start[vertex] - self.at.start.v[vertex]) * self.at.masses[vertex];
        self.active.begin_stage(1.0, earlier);
        let outcome = self.solve(Stage::First);
        let StageArrays { v_start, v_first, x, v, .. } = &mut *self.arrays;
        v_first.copy_from_slice(v);
        // Where contacts changed their modes, the start is another one than ghosts know.
        [v_start, x].into_iter().for_each(|ghosted| at.parts.halo().update(at.parts.ranks(), ghosted));
        outcome
    }

    /// BDF2: x₂ and v₂.
    pub(super) fn second_stage(&mut self) -> Outcome {
        let alpha = ALPHA * self.at.dt;
        let at = self.at;
        let StageArrays { v_start, v_first, x, v, unconverged, .. } = &mut *self.arrays;
        unconverged.fill(true);
        for ((v, start), first) in v.iter_mut().zip(&*v_start).zip(&*v_first) {
            *v = first + at.extrapolated((first - start) * ((1.0 - GAMMA) / GAMMA));
        }
        let prescription = at.with(self.active);
        prescription.set_velocities(v, |contact, v| contact.prescribe(v, &contact.velocity));
        for ((x, start), v) in x.iter_mut().zip(&self.at.start.x).zip(&*v) {
            // w x₁ − u x, such that what does not move stays where it is to the last bit.
            *x = start + (*x - start) * W + v * alpha;
        }
        prescription.set_positions(1.0, &self.at.start.x, x);
        self.evaluate(1.0, true);
        // Of a constant reaction this stage has half of what the first one had.
        self.active.begin_stage(0.5, |_| Vec3::zeros());
        let outcome = self.solve(Stage::Second);
        let StageArrays { x, .. } = &mut *self.arrays;
        self.active.stop_reversed(x, |contact| self.at.start.x[contact.vertex] + contact.carried);
        self.at.parts.halo().update(self.at.parts.ranks(), x);
        outcome
    }

    /// v₂ once more, at the positions `x_new` and with the impacts of bodies at the start of the step.
    pub(super) fn second_stage_again(&mut self, x_new: &[Vec3], v_star: &[Vec3], met: Vec<ActiveContact>) -> Outcome {
        let at = self.at;
        let StageArrays { v_start, v_first, x, v, change, .. } = &mut *self.arrays;
        for ((change, x_new), x) in change.iter_mut().zip(x_new).zip(&*x) {
            *change = (x_new - x) / at.dt;
        }
        x.copy_from_slice(x_new);
        // What rested on a body has its velocity from the first solve on; others are struck.
        for vertex in if v_star.is_empty() { 0..0 } else { self.at.parts.own() } {
            let impact = v_star[vertex] - self.at.start.v[vertex];
            if impact != Vec3::zeros() && !self.active.holds(vertex) {
                [&mut *v_start, v_first, v, change].into_iter().for_each(|v| v[vertex] += impact);
            }
        }
        self.active.add(self.at.parts, met);
        at.parts.halo().update(at.parts.ranks(), change);
        // What only rounding moves was not moved.
        let moved = self.parts_moved(f64::EPSILON.sqrt() * at.stop.tolerance);
        for (part, (unconverged, moved)) in self.arrays.unconverged.iter_mut().zip(moved).enumerate() {
            *unconverged |= moved || !self.active.of_part(part).is_empty();
        }
        if !self.is_unconverged() {
            return Outcome::NONE;
        }
        let StageArrays { v, .. } = &mut *self.arrays;
        let prescription = at.with(self.active);
        prescription.set_velocities(v, |contact, v| contact.prescribe(v, &contact.velocity));
        self.evaluate(1.0, true);
        self.active.begin_stage(1.0, |_| Vec3::zeros());
        let outcome = self.solve(Stage::SecondAgain);
        let StageArrays { v, .. } = &mut *self.arrays;
        self.active.stop_reversed(v, |contact| contact.velocity);
        outcome
    }

    /// The drag of pinching surfaces in a stage, which feels that of its end for all of its length, as it does with pairs.
    pub(super) fn drag(&self, stage: Stage) -> StageDrag<'a> {
        StageDrag { duration: stage.share_of_pairs() * ALPHA * self.at.dt, masses: self.at.masses }
    }

    /// Sets the residual of a stage where it stands, without the forces of pairs in touch.
    pub(super) fn set_residual(&mut self, stage: Stage) {
        let (alpha, parts, drag) = (ALPHA * self.at.dt, self.at.parts, self.drag(stage));
        let StageArrays { v_start, v_first, v, f_start, f, residual, unconverged, .. } = &mut *self.arrays;
        for (part, range) in parts.ranges().iter().enumerate().filter(|(part, _)| unconverged[*part]) {
            let own = range.start - parts.own().start..range.end - parts.own().start;
            let residual = &mut residual[own.clone()];
            let starts = v_start[range.clone()].iter().zip(&v_first[range.clone()]);
            let forces = f_start[own.clone()].iter().zip(&f[own]);
            let ends = v[range.clone()].iter().zip(&self.at.masses[range.clone()]).zip(forces);
            for ((residual, (start, first)), ((v, m), (f_start, f))) in residual.iter_mut().zip(starts).zip(ends) {
                *residual = match stage {
                    Stage::First => (start - v) * *m + (f_start + f) * alpha,
                    Stage::Second | Stage::SecondAgain => (first + (first - start) * U - v) * *m + f * alpha,
                };
            }
            self.active.add_friction(part, range.start, residual);
            self.active.add_drag(part, range.start, &drag, v, residual);
        }
    }
}
