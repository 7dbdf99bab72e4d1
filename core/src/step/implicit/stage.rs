//! The equation of a stage, and all that its solver evaluates.

use super::arrays::StageArrays;
use super::prescription::Prescription;
use crate::Vec3;
use crate::contact::bodies::Bodies;
use crate::contact::bodies::active_set::{ActiveContact, ActiveSet, ReversalTest, StageDrag, StartOfContact};
use crate::contact::bodies::recovery_speed::RecoverySpeed;
use crate::contact::self_contact::SelfContact;
use crate::effects::force::{BlockFactors, ForceContext};
use crate::long_steps::PREDICTION_NOISE;
use crate::parallel::parts::Parts;
use crate::pins::{HardPins, PinTargets};
use crate::solve::conjugate_gradient::Stop;
use crate::solve::force_evaluation::ForceEvaluation;
use crate::solve::implicit_velocity::PartForces;
use crate::state::State;
use crate::volumes::Volumes;
use crate::wind_grid::WindGrid;

/// A stage as Newton's method sees it. It finds `v`, and with it `x`, which moves by h with `v`:
///
/// ```text
/// m v = m v_inertial + h (f(x, v) + f_start) + h s (pairs(x, v) + drag(v)) + friction,   f_start only if it feels the start
/// ```
#[derive(Debug, Clone, Copy)]
pub(in crate::step) struct StageEquation {
    /// End of the stage, as a fraction of the step.
    pub(in crate::step) fraction: f64,
    /// Time for which the stage feels the forces of its end, and by which its positions follow its velocities, h [s].
    pub(in crate::step) weight: f64,
    /// Time for which it feels the pairs of its end and the drag of pinching surfaces, over h: s.
    pub(in crate::step) share_of_pairs: f64,
    /// True if it feels the forces of the start of the step for h as well, and its positions follow the velocities there by h.
    pub(in crate::step) feels_start: bool,
    /// True if contacts that change their modes change the velocities that the step starts with.
    pub(in crate::step) may_restart: bool,
    /// True if positions are given, and the stage is solved for velocities alone.
    pub(in crate::step) positions_given: bool,
    /// Quantity that shows that a slip has turned round.
    pub(in crate::step) reversal_test: ReversalTest,
    /// Share of the reactions of bodies that may be beyond Coulomb's law at the end.
    pub(in crate::step) settled: f64,
}

/// A step as its stages see it.
#[derive(Clone, Copy)]
pub(in crate::step) struct StepContext<'a> {
    pub(in crate::step) parts: &'a Parts,
    pub(in crate::step) masses: &'a [f64],
    pub(in crate::step) dt: f64,
    pub(in crate::step) stop: Stop,
    pub(in crate::step) recovery_speed: RecoverySpeed,
    pub(in crate::step) held: &'a [u32],
    /// The state at the start of the step.
    pub(in crate::step) start: &'a State,
    pub(in crate::step) wind: &'a WindGrid,
    pub(in crate::step) pins: Option<&'a HardPins>,
    pub(in crate::step) targets: &'a PinTargets,
    /// Cap on the extrapolated displacement of a vertex in a stage [m].
    pub(in crate::step) extrapolated: f64,
}

impl<'a> StepContext<'a> {
    /// Extrapolated change of a velocity in a stage whose positions move with it for this fraction of the step, capped [m/s]. Where layers touch
    /// as much of it is left out as may be an error of the solves.
    fn extrapolated(&self, change: Vec3, fraction: f64, in_layers: bool) -> Vec3 {
        let speed = change.norm();
        let noise = if in_layers { PREDICTION_NOISE * self.stop.tolerance } else { 0.0 };
        let taken = (speed - noise).clamp(0.0, self.extrapolated / (fraction * self.dt));
        if taken < speed { change * (taken / speed) } else { change }
    }

    /// Predicts the velocities `v` of own vertices at the end of a stage whose positions move with them for this fraction of the step: those
    /// of `from` and an extrapolated change [m/s]. `in_layers` are the parts in which layers touch.
    pub(in crate::step) fn predict(
        &self,
        (fraction, in_layers): (f64, &[bool]),
        (v, from): (&mut [Vec3], &[Vec3]),
        change: impl Fn(usize) -> Vec3,
    ) {
        for (range, in_layers) in self.parts.ranges().iter().zip(in_layers) {
            for vertex in range.clone() {
                v[vertex] = from[vertex] + self.extrapolated(change(vertex), fraction, *in_layers);
            }
        }
    }

    pub(in crate::step) fn with(&self, active: &'a ActiveSet) -> Prescription<'a> {
        let Self { parts, pins, targets, recovery_speed, held, .. } = *self;
        Prescription { parts, pins, targets, recovery_speed, held, active }
    }
}

/// A step in its stages: its arrays, and all that they evaluate.
pub(in crate::step) struct StageSolver<'a> {
    pub(in crate::step) at: StepContext<'a>,
    pub(in crate::step) arrays: &'a mut StageArrays,
    /// Vertices that rest on bodies.
    pub(in crate::step) active: &'a mut ActiveSet,
    pub(super) forces: &'a mut PartForces,
    pub(super) volumes: &'a mut Volumes,
    /// Pairs of cloth that repel each other, and edges and faces of cloth that bodies do.
    pub(super) repulsion: Option<&'a mut SelfContact>,
    pub(super) bodies: &'a Bodies,
}

impl<'a> StageSolver<'a> {
    /// The start of a step: velocities that contacts allow, and the forces. `first` is the length of the first stage [s].
    pub(in crate::step) fn begin(&mut self, first: f64) {
        let at = self.at;
        self.arrays.x.copy_from_slice(&at.start.x);
        self.arrays.worked_on.fill(true);
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
        let changed = self.active.expect(at.dt, first, given);
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
        self.evaluate(0.0, None);
    }

    /// The forces and the matrix of a stage where it stands.
    pub(in crate::step) fn linearise(&mut self, stage: &StageEquation) {
        let factors = BlockFactors { damping: stage.weight, stiffness: stage.weight * stage.weight };
        self.evaluate(stage.fraction, Some(factors));
    }

    /// The forces on the parts that are worked on, at a fraction of the step, and the matrix with these factors.
    fn evaluate(&mut self, fraction: f64, matrix_factors: Option<BlockFactors>) {
        let StageArrays { matrix, slots, cg, x, v, f, worked_on, .. } = &mut *self.arrays;
        self.volumes.update(self.at.parts, x);
        let (targets, wind, volumes) = (self.at.targets, self.at.wind, &*self.volumes);
        let time = self.bodies.time_of_motion(self.at.start.time + fraction * self.at.dt);
        let context = ForceContext { time, targets, v, wind, volumes };
        let at = ForceEvaluation { parts: self.at.parts, masses: self.at.masses, worked_on, x, v, fraction, context };
        match matrix_factors {
            Some(factors) => {
                at.linearise(self.forces, f, factors, matrix, slots);
                cg.volumes_mut().set((at.parts, worked_on), self.forces, volumes, x, factors.stiffness);
            }
            None => at.forces(self.forces, f),
        }
    }

    /// The drag of pinching surfaces in a stage, which feels that of its end for all of its length, as it does with pairs.
    pub(super) fn drag(&self, stage: &StageEquation) -> StageDrag<'a> {
        StageDrag { duration: stage.share_of_pairs * stage.weight, masses: self.at.masses }
    }

    /// Sets the residual of a stage where it stands, without the forces of pairs in touch.
    pub(super) fn set_residual(&mut self, stage: &StageEquation) {
        let (weight, parts, drag) = (stage.weight, self.at.parts, self.drag(stage));
        let StageArrays { v_inertial, v, f_start, f, residual, worked_on, .. } = &mut *self.arrays;
        for (part, range) in parts.ranges().iter().enumerate().filter(|(part, _)| worked_on[*part]) {
            let own = range.start - parts.own().start..range.end - parts.own().start;
            let residual = &mut residual[own.clone()];
            let forces = f_start[own.clone()].iter().zip(&f[own.clone()]);
            let masses = &self.at.masses[range.clone()];
            let ends = v_inertial[own].iter().zip(&v[range.clone()]).zip(masses).zip(forces);
            for (residual, (((inertial, v), m), (f_start, f))) in residual.iter_mut().zip(ends) {
                let force = if stage.feels_start { f_start + f } else { *f };
                *residual = (inertial - v) * *m + force * weight;
            }
            self.active.add_friction(part, range.start, residual);
            self.active.add_drag(part, range.start, &drag, v, residual);
        }
    }
}
