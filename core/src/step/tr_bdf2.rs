//! The lines of the implicit step that are its own: TR-BDF2, linearised at a prediction (`docs/theory/tr_bdf2.md`).
//!
//! ```text
//! B.1  v₁ = v + α dt (a(x, v) + a(x₁, v₁)),   x₁ = x + α dt (v + v₁)        trapezoid to t + γ dt, γ = 2 − √2, α = γ/2
//!      v₂ = w v₁ − u v + α dt a(x₂, v₂),      x₂ = w x₁ − u x + α dt v₂     BDF2 over the step, w = 1/(γ(2−γ)), u = w − 1
//!      v½ = (x₂ − x)/dt
//! B.5  v₂ once more, with the positions and contacts that B.2 to B.4 have found
//! B.6  v' = v₂
//! ```
//!
//! Each stage is one linear solve about a prediction of second order: of v₁ with the last acceleration, of v₂ with that of the
//! first stage. Vertices that rest on bodies move with them in the solves ([`crate::contact::bodies::active_set`]).

use super::Step;
use crate::Vec3;
use crate::clock::Watch;
use crate::contact::bodies::Bodies;
use crate::contact::bodies::active_set::{ActiveContact, ActiveSet, Judges, StageEnd, StartOfContact, Trust};
use crate::contact::bodies::collision::CollisionStep;
use crate::contact::bodies::recovery_speed::RecoverySpeed;
use crate::contact::repulsion::pair_forces::note_solution;
use crate::contact::self_contact::SelfContact;
use crate::effects::force::{BlockFactors, ForceContext};
use crate::parallel::parts::Parts;
use crate::pins::{HardPins, PinTargets};
use crate::solve::conjugate_gradient::{Outcome, Stop};
use crate::solve::force_evaluation::ForceEvaluation;
use crate::solve::implicit_velocity::PartForces;
use crate::solve::preconditioned_cg::{BlockSystem, Forcing};
use crate::state::State;
use crate::step::prescription::Prescription;
use crate::step::stage_arrays::StageArrays;
use crate::step::unconverged::{PairsInTouch, parts_moved, parts_touched};
use crate::step::{Prescribed, RepulsionPlace};
use crate::volumes::Volumes;
use crate::wind_grid::WindGrid;

/// γ, the end of the first stage as a fraction of the step: the value for which both stages have the same matrix.
const GAMMA: f64 = 2.0 - std::f64::consts::SQRT_2;
/// α, what the forces of each stage weigh in it.
const ALPHA: f64 = 0.5 * GAMMA;
/// w and u, what the first stage and the start weigh in the second one.
const W: f64 = 1.0 / (GAMMA * (2.0 - GAMMA));
const U: f64 = W - 1.0;

/// Solves of a stage, each with the modes that the reactions of the one before have shown to be right. What is wrong after the
/// last is so for this step: it is put right in the next one.
const MOST_ROUNDS: usize = 4;

/// Most solves of a stage in which the last has left a pair unsettled ([`StageArrays::unsettled`]). A step whose stages have not come
/// nearer after all of them has gone wrong, and is taken back.
const MOST_ROUNDS_OF_PAIRS: usize = 8;

/// Share of the reactions of bodies that may be beyond Coulomb's law at the end of the first stage, the second, and B.5. What the
/// earlier ones leave is looked at again in the later.
const SETTLED: [f64; 3] = [0.1, 0.05, 0.01];

/// How far extrapolated accelerations may move a vertex within a stage, over the mean edge of the cloth: what has just been struck
/// does not go on as the blow was, and forces far from where it goes say nothing of it.
const EXTRAPOLATED: f64 = 0.04;

/// A change of velocities below which a solve is the last of its stage, and the residual at contacts that is taken for what the first
/// solve has left rather than for a wrong mode, over the tolerance of solves.
const ROUGH: f64 = 10.0;

/// A step as its stages see it.
#[derive(Clone, Copy)]
struct StageContext<'a> {
    parts: &'a Parts,
    masses: &'a [f64],
    dt: f64,
    stop: Stop,
    recovery_speed: RecoverySpeed,
    held: &'a [u32],
    /// The state at the start of the step.
    start: &'a State,
    wind: &'a WindGrid,
    pins: Option<&'a HardPins>,
    targets: &'a PinTargets,
    /// How far extrapolation may move a vertex [m].
    extrapolated: f64,
}

impl<'a> StageContext<'a> {
    /// What is taken of an extrapolated change of a velocity [m/s].
    fn extrapolated(&self, change: Vec3) -> Vec3 {
        let moved = change.norm() * ALPHA * self.dt;
        if moved > self.extrapolated { change * (self.extrapolated / moved) } else { change }
    }

    fn with(&self, active: &'a ActiveSet) -> Prescription<'a> {
        let Self { parts, pins, targets, recovery_speed, held, .. } = *self;
        Prescription { parts, pins, targets, recovery_speed, held, active }
    }
}

/// What the stages of a step work with.
struct Stages<'a> {
    at: StageContext<'a>,
    arrays: &'a mut StageArrays,
    forces: &'a mut PartForces,
    volumes: &'a mut Volumes,
    /// Pairs of cloth that repel each other, and edges and faces of cloth that deforming bodies do.
    repulsion: Option<&'a mut SelfContact>,
    bodies: &'a Bodies,
}

/// Which solve it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Stage {
    First,
    Second,
    /// The second, in B.5.
    SecondAgain,
}

impl Stage {
    /// Its end, as a fraction of the step.
    fn fraction(self) -> f64 {
        if self == Self::First { GAMMA } else { 1.0 }
    }

    /// What forces of pairs at its end weigh in it, over those of elements.
    fn share_of_pairs(self) -> f64 {
        if self == Self::First { 2.0 } else { 1.0 }
    }
}

impl Stages<'_> {
    /// The forces on the parts that are worked on, at the stage, and, `with_matrix`, the matrix there.
    fn evaluate(&mut self, fraction: f64, with_matrix: bool) {
        let (dt, alpha) = (self.at.dt, ALPHA * self.at.dt);
        let StageArrays { matrix, slots, x, v, f, unconverged: solved, .. } = &mut *self.arrays;
        self.volumes.update(self.at.parts, x);
        let (targets, wind, volumes) = (self.at.targets, self.at.wind, &*self.volumes);
        let around = ForceContext { time: self.at.start.time + fraction * dt, targets, v, wind, volumes };
        let at = ForceEvaluation { parts: self.at.parts, masses: self.at.masses, solved, x, v, fraction, around };
        if with_matrix {
            let factors = BlockFactors { damping: alpha, stiffness: alpha * alpha };
            at.linearise(self.forces, f, factors, matrix, slots);
        } else {
            at.forces(self.forces, f);
        }
    }

    /// The forces of pairs in touch where the stage stands, at a fraction of the step, times `duration` [s], are added to `impulses`
    /// of the own vertices that are worked on [N s].
    fn add_pair_impulses(&mut self, fraction: f64, duration: f64, impulses: &mut [Vec3]) {
        let Some(contact) = &mut self.repulsion else { return };
        let StageArrays { x, v, pairs, unconverged, .. } = &mut *self.arrays;
        *pairs = contact.pair_forces([x, v], self.bodies, (fraction, self.at.dt), pairs);
        let (own, parts) = (contact.nodes().own(), self.at.parts);
        for pair in &*pairs {
            for (node, weight) in pair.nodes.iter().zip(pair.weights) {
                let vertex = (*node as usize).wrapping_sub(own.start);
                if vertex < own.len() && unconverged[parts.part_of(vertex + parts.own().start)] {
                    impulses[vertex] += pair.force * (weight * duration);
                }
            }
        }
    }

    /// Adds what pairs in touch give where the stage stands to its residual, and takes them into the matrix.
    ///
    /// A trapezoid that felt half of what pushed at its start would throw what is let go, so each stage feels the pairs of its end
    /// alone, for all of its length.
    fn add_pairs(&mut self, stage: Stage) {
        let (share, alpha) = (stage.share_of_pairs(), ALPHA * self.at.dt);
        let mut residual = std::mem::take(&mut self.arrays.residual);
        self.add_pair_impulses(stage.fraction(), share * alpha, &mut residual);
        self.arrays.residual = residual;
        if let Some(contact) = &self.repulsion {
            let StageArrays { cg, pairs, .. } = &mut *self.arrays;
            cg.pairs_mut().set(self.at.parts, contact.nodes(), pairs, [share, alpha]);
        }
    }

    /// The start: velocities that contacts allow, and the forces.
    fn begin(&mut self) {
        let (at, mut active) = (self.at, std::mem::take(&mut self.arrays.active));
        self.arrays.x.copy_from_slice(&at.start.x);
        self.arrays.unconverged.fill(true);
        self.arrays.pairs.clear();
        self.evaluate_start(&active);
        let mut repelled = vec![Vec3::zeros(); self.arrays.f.len()];
        self.add_pair_impulses(0.0, 1.0, &mut repelled);
        // Newton's second law says what bodies gave at the end of the step before.
        let given = |vertex: usize| {
            let own = vertex - at.parts.own().start;
            let (acceleration, mass) = (at.start.a[vertex], at.masses[vertex]);
            let force = acceleration * mass - self.arrays.f[own] - repelled[own];
            StartOfContact { force, doubt: at.stop.tolerance * mass / at.dt, acceleration }
        };
        let changed = active.expect(at.dt, GAMMA * at.dt, given);
        if at.parts.ranks().any(changed) {
            self.evaluate_start(&active);
        }
        self.arrays.f_start.copy_from_slice(&self.arrays.f);
        self.arrays.active = active;
    }

    /// Velocities and forces at the start, with contacts in these modes.
    fn evaluate_start(&mut self, active: &ActiveSet) {
        let (at, dt) = (self.at, self.at.dt);
        let StageArrays { v_start, v, .. } = &mut *self.arrays;
        v_start.copy_from_slice(&at.start.v);
        let pushed =
            |contact: &ActiveContact, v: &mut Vec3| *v = contact.start_velocity(*v, &contact.velocity_at(0.0, dt));
        at.with(active).set_velocities(v_start, pushed);
        v.copy_from_slice(v_start);
        self.evaluate(0.0, false);
    }

    /// The trapezoid: x₁ and v₁.
    fn first_stage(&mut self) -> Outcome {
        let (dt, alpha) = (self.at.dt, ALPHA * self.at.dt);
        let (at, mut active) = (self.at, std::mem::take(&mut self.arrays.active));
        let StageArrays { v_start, x, v, .. } = &mut *self.arrays;
        for ((v, start), a) in v.iter_mut().zip(&*v_start).zip(&self.at.start.a) {
            *v = start + at.extrapolated(a * (GAMMA * dt));
        }
        let prescription = at.with(&active);
        prescription.set_velocities(v, |contact, v| contact.prescribe(v, &contact.velocity_at(GAMMA, dt)));
        for (((x, start), v_start), v) in x.iter_mut().zip(&self.at.start.x).zip(&*v_start).zip(&*v) {
            *x = start + (v_start + v) * alpha;
        }
        prescription.set_positions(GAMMA, &self.at.start.x, x);
        self.evaluate(GAMMA, true);
        let v_start = &self.arrays.v_start;
        let earlier = |vertex: usize| (v_start[vertex] - self.at.start.v[vertex]) * self.at.masses[vertex];
        active.begin_stage(1.0, earlier);
        self.arrays.active = active;
        let outcome = self.solve(Stage::First);
        let StageArrays { v_start, v_first, x, v, .. } = &mut *self.arrays;
        v_first.copy_from_slice(v);
        // Where contacts changed their modes, the start is another one than ghosts know.
        [v_start, x].into_iter().for_each(|ghosted| at.parts.halo().update(at.parts.ranks(), ghosted));
        outcome
    }

    /// BDF2: x₂ and v₂.
    fn second_stage(&mut self) -> Outcome {
        let alpha = ALPHA * self.at.dt;
        let (at, mut active) = (self.at, std::mem::take(&mut self.arrays.active));
        let StageArrays { v_start, v_first, x, v, unconverged, .. } = &mut *self.arrays;
        unconverged.fill(true);
        for ((v, start), first) in v.iter_mut().zip(&*v_start).zip(&*v_first) {
            *v = first + at.extrapolated((first - start) * ((1.0 - GAMMA) / GAMMA));
        }
        let prescription = at.with(&active);
        prescription.set_velocities(v, |contact, v| contact.prescribe(v, &contact.velocity));
        for ((x, start), v) in x.iter_mut().zip(&self.at.start.x).zip(&*v) {
            // w x₁ − u x, such that what does not move stays where it is to the last bit.
            *x = start + (*x - start) * W + v * alpha;
        }
        prescription.set_positions(1.0, &self.at.start.x, x);
        self.evaluate(1.0, true);
        // Of a constant reaction this stage has half of what the first one had.
        active.begin_stage(0.5, |_| Vec3::zeros());
        self.arrays.active = active;
        let outcome = self.solve(Stage::Second);
        let StageArrays { active, x, .. } = &mut *self.arrays;
        active.stop_reversed(x, |contact| self.at.start.x[contact.vertex] + contact.carried);
        self.at.parts.halo().update(self.at.parts.ranks(), x);
        outcome
    }

    /// v₂ once more, at the positions `x_new` and with the impacts of bodies at the start of the step.
    fn second_stage_again(&mut self, x_new: &[Vec3], v_star: &[Vec3], met: Vec<ActiveContact>) -> Outcome {
        let (at, mut active) = (self.at, std::mem::take(&mut self.arrays.active));
        let StageArrays { v_start, v_first, x, v, change, .. } = &mut *self.arrays;
        for ((change, x_new), x) in change.iter_mut().zip(x_new).zip(&*x) {
            *change = (x_new - x) / at.dt;
        }
        x.copy_from_slice(x_new);
        // What rested on a body has its velocity from the first solve on; others are struck.
        for vertex in if v_star.is_empty() { 0..0 } else { self.at.parts.own() } {
            let impact = v_star[vertex] - self.at.start.v[vertex];
            if impact != Vec3::zeros() && !active.holds(vertex) {
                [&mut *v_start, v_first, v, change].into_iter().for_each(|v| v[vertex] += impact);
            }
        }
        active.add(self.at.parts, met);
        at.parts.halo().update(at.parts.ranks(), change);
        // What only rounding moves was not moved.
        let moved = self.parts_moved(f64::EPSILON.sqrt() * at.stop.tolerance);
        for (part, (unconverged, moved)) in self.arrays.unconverged.iter_mut().zip(moved).enumerate() {
            *unconverged |= moved || !active.of_part(part).is_empty();
        }
        if !self.is_unconverged() {
            self.arrays.active = active;
            return Outcome::NONE;
        }
        let StageArrays { v, .. } = &mut *self.arrays;
        let prescription = at.with(&active);
        prescription.set_velocities(v, |contact, v| contact.prescribe(v, &contact.velocity));
        self.evaluate(1.0, true);
        active.begin_stage(1.0, |_| Vec3::zeros());
        self.arrays.active = active;
        let outcome = self.solve(Stage::SecondAgain);
        let StageArrays { active, v, .. } = &mut *self.arrays;
        active.stop_reversed(v, |contact| contact.velocity);
        outcome
    }

    /// What the solve of a stage is to balance where the stage stands: all but what pairs in touch give.
    fn set_residual(&mut self, stage: Stage, active: &ActiveSet) {
        let (alpha, parts) = (ALPHA * self.at.dt, self.at.parts);
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
            active.add_friction(part, range.start, residual);
        }
    }

    /// Whether some rank has a part to work on. All ranks call it together.
    fn is_unconverged(&self) -> bool {
        self.at.parts.ranks().any(self.arrays.unconverged.contains(&true))
    }

    /// The parts in which the last change of velocities was more than `far` [m/s].
    fn parts_moved(&self, far: f64) -> Vec<bool> {
        let StageArrays { matrix, change, pairs, .. } = &*self.arrays;
        let touch = self.repulsion.as_deref().map(|contact| PairsInTouch { pairs, nodes: contact.nodes() });
        parts_moved(self.at.parts, matrix, touch.as_ref(), (change, far))
    }

    /// The parts that touch something.
    fn parts_touched(&self, active: &ActiveSet) -> Vec<bool> {
        let nodes = self.repulsion.as_deref().map(SelfContact::nodes);
        let touch = nodes.map(|nodes| PairsInTouch { pairs: &self.arrays.pairs, nodes });
        parts_touched(self.at.parts, active, touch.as_ref())
    }

    /// Solves a stage for its velocities, `v` and with them `x`, with contacts in modes that fit what they bear and with pairs that
    /// are in touch where the solve comes to.
    fn solve(&mut self, stage: Stage) -> Outcome {
        let alpha = ALPHA * self.at.dt;
        let (at, mut active) = (self.at, std::mem::take(&mut self.arrays.active));
        self.set_residual(stage, &active);
        self.add_pairs(stage);
        let mut total = Outcome::NONE;
        let is_whole = stage != Stage::SecondAgain;
        let is_touched = !(active.contacts().is_empty() && self.arrays.pairs.is_empty());
        let bears = at.parts.ranks().any(is_touched);
        let rough = ROUGH * at.stop.tolerance;
        let mut forcing = Forcing::new(rough);
        for round in 1.. {
            let prescription = at.with(&active);
            let StageArrays { matrix, cg, residual, change, x, v, unconverged, pairs, .. } = &mut *self.arrays;
            let (parts, masses, matrix) = (self.at.parts, self.at.masses, &*matrix);
            let system = BlockSystem { parts, masses, solved: unconverged, matrix, constraints: &prescription };
            // Coarse levels of the stage's first round serve the others: these solve for a share of the parts, and take up to half as
            // many iterations more than with levels of their own, which would cost more than they do.
            if is_whole && round == 1 {
                cg.prepare(&system);
            } else {
                cg.prepare_finest(&system);
            }
            let outcome = if bears {
                cg.newton_step(&system, residual, change, at.stop, &mut forcing)
            } else {
                cg.solve(&system, residual, change, at.stop)
            };
            total.solves += outcome.solves;
            total.iterations += outcome.iterations;
            // What a round has left is the next one's.
            total.converged = outcome.converged;
            total.finite &= outcome.finite;
            total.worse |= outcome.worse;
            let factors = [stage.share_of_pairs(), alpha];
            note_solution(pairs, cg.pairs_mut().products(), factors);
            for ((v, x), change) in v.iter_mut().zip(x.iter_mut()).zip(&*change) {
                *v += change;
                *x += change * alpha;
            }
            if !bears {
                self.arrays.unconverged.fill(false);
                break;
            }
            let moved = self.parts_moved(rough);
            let is_unsettled = round >= MOST_ROUNDS && parts.ranks().any(self.arrays.unsettled(at.dt).next().is_some());
            let is_exact = stage != Stage::SecondAgain || active.is_settled();
            let is_last = round >= MOST_ROUNDS && !is_unsettled && is_exact;
            if !total.finite || is_last || round == MOST_ROUNDS_OF_PAIRS {
                if is_unsettled {
                    self.note_unsettled();
                }
                self.arrays.unconverged = moved;
                break;
            }
            self.go_on(stage, &mut active, moved, (round == 1).then_some(rough));
            if !self.is_unconverged() {
                break;
            }
        }
        self.arrays.active = active;
        total
    }

    /// Stops vertices whose slip has turned round in a stage of B.1, and catches those that have come back into the body that had let
    /// them go. In B.5 positions are given.
    fn turn(&mut self, stage: Stage, active: &mut ActiveSet) {
        if stage == Stage::SecondAgain {
            return;
        }
        let (at, StageArrays { x, v, .. }) = (self.at, &mut *self.arrays);
        // A vertex that stops within the step may move back at its end. Its displacement says where Coulomb's law leaves it.
        let judges = if stage == Stage::Second { Judges::Positions } else { Judges::Velocities };
        let (start, fraction) = (&*at.start.x, stage.fraction());
        let any = active.turn(&StageEnd { start, fraction, dt: at.dt, alpha: ALPHA * at.dt, judges }, x, v);
        if at.parts.ranks().any(any) {
            // Pins decide where both hold.
            let prescription = at.with(active);
            prescription.set_velocities(v, |_, _| ());
            prescription.set_positions(fraction, start, x);
        }
    }

    /// Notes that pairs of the stage are unsettled, and their own vertices.
    fn note_unsettled(&mut self) {
        let Some(contact) = &self.repulsion else { return };
        let nodes = contact.nodes();
        let of_pairs = self.arrays.unsettled(self.at.dt).flat_map(|pair| pair.nodes);
        let own = of_pairs.filter(|node| nodes.is_own(*node)).map(|node| nodes.number(node)).collect();
        self.arrays.unsettled_vertices.get_or_insert_default().append(&mut { own });
    }

    /// Another step of Newton's method: the forces and the matrix where a solve has come to, and modes of contacts that fit what
    /// they bear there. It is for the parts that have moved far, and for those whose contacts are not settled; after a first, rough
    /// solve, which is right to `rough` [m/s], for all that touch something.
    fn go_on(&mut self, stage: Stage, active: &mut ActiveSet, moved: Vec<bool>, rough: Option<f64>) {
        let (at, alpha) = (self.at, ALPHA * self.at.dt);
        let touched = self.parts_touched(active);
        self.turn(stage, active);
        // What contacts bear has changed where they were solved for.
        let solved = &mut self.arrays.unconverged;
        for ((solved, moved), touched) in solved.iter_mut().zip(&moved).zip(&touched) {
            *solved = *moved || (*solved && *touched);
        }
        self.evaluate(stage.fraction(), true);
        self.set_residual(stage, active);
        self.add_pairs(stage);
        let StageArrays { residual, v_start, x, unconverged, .. } = &mut *self.arrays;
        let restart = |contact: &ActiveContact| {
            if stage != Stage::First {
                return Vec3::zeros();
            }
            let start = contact.start_velocity(at.start.v[contact.vertex], &contact.velocity_at(0.0, at.dt));
            let change = start - v_start[contact.vertex];
            v_start[contact.vertex] = start;
            x[contact.vertex] += change * alpha;
            change * at.masses[contact.vertex]
        };
        // Modes that only a rough solve shows to be wrong are looked at again.
        let trust = Trust { tolerance: rough.unwrap_or(0.0), masses: at.masses, settled: SETTLED[stage as usize] };
        let unsettled = active.update(at.parts, residual, trust, restart);
        at.parts.halo().update(at.parts.ranks(), x);
        let next = moved.into_iter().zip(touched).zip(unsettled);
        for (unconverged, ((moved, touched), unsettled)) in unconverged.iter_mut().zip(next) {
            *unconverged &= moved || (rough.is_some() && touched) || unsettled;
        }
    }
}

impl Step<'_> {
    /// B.1: both stages. v½ is the mean velocity of the step that they lead to.
    pub(super) fn implicit_half_velocity(&mut self) {
        let watch = Watch::start();
        let resting = self.find_resting();
        let (parts, dt) = (self.parts, self.settings.dt);
        let mut stages = self.stages();
        stages.arrays.active.set(parts, resting);
        stages.begin();
        let outcomes = [stages.first_stage(), stages.second_stage()];
        let Self { cloth, metrics, report, .. } = self;
        let (x, scratch) = (&cloth.state.x, &mut cloth.scratch);
        let ends = scratch.stages.iter().flat_map(|arrays| &arrays.x);
        for ((v_half, end), x) in scratch.v_half.iter_mut().zip(ends).zip(x) {
            *v_half = (end - x) / dt;
        }
        let stop = self.settings.stop;
        if let Some(arrays) = &mut scratch.stages {
            for outcome in outcomes {
                report.add(outcome, "B.1", (parts, metrics), || arrays.cg.unsolved(parts, stop));
            }
            arrays.report_unsettled(report);
        }
        metrics.add_time("B.1 velocity".into(), watch.seconds(), 1);
    }

    /// B.5: v₂ once more where B.2 to B.4 may have changed positions, velocities or contacts.
    pub(super) fn implicit_end_velocity(&mut self) {
        if self.contacts.bodies.is_none() && self.contacts.cloth.is_none() && self.dynamics.filters.is_empty() {
            return;
        }
        let watch = Watch::start();
        let (parts, own, dt) = (self.parts, self.parts.own(), self.settings.dt);
        let met = self
            .contacts
            .bodies
            .as_ref()
            .map_or_else(Vec::new, |collision| collision.met(&self.cloth.scratch.v_star[own], dt));
        let [x_new, v_star] = [&mut self.cloth.scratch.x_new, &mut self.cloth.scratch.v_star].map(std::mem::take);
        let outcome = self.stages().second_stage_again(&x_new, &v_star, met);
        (self.cloth.scratch.x_new, self.cloth.scratch.v_star) = (x_new, v_star);
        let Self { cloth, metrics, report, settings, .. } = self;
        if let Some(arrays) = &mut cloth.scratch.stages {
            report.add(outcome, "B.5", (parts, metrics), || arrays.cg.unsolved(parts, settings.stop));
            arrays.report_unsettled(report);
        }
        if self.contacts.bodies.is_some() {
            let is_wrong = self.cloth.scratch.stages.as_ref().is_some_and(|stages| stages.active.is_wrong());
            self.metrics.count_once(parts.ranks(), "friction_unsettled", u64::from(is_wrong));
        }
        if let Some(contact) =
            self.contacts.cloth.as_ref().filter(|_| self.settings.variants.self_repulsion == RepulsionPlace::Solves)
        {
            contact.count_pair_forces(self.metrics);
        }
        self.metrics.add_time("B.5 velocity".into(), watch.seconds(), 1);
    }

    /// B.6: the state is at its end.
    pub(super) fn take_end(&mut self) {
        let State { x, v, .. } = &mut self.cloth.state;
        std::mem::swap(x, &mut self.cloth.scratch.x_new);
        if let Some(arrays) = &self.cloth.scratch.stages {
            v.copy_from_slice(&arrays.v);
        }
    }

    /// The acceleration at the end, with which the next step foresees: that between the stages.
    pub(super) fn keep_acceleration(&mut self) {
        let a = &mut self.cloth.state.a;
        let over = 1.0 / ((1.0 - GAMMA) * self.settings.dt);
        if let Some(arrays) = &self.cloth.scratch.stages {
            let stages = arrays.v.iter().zip(&arrays.v_first);
            a.iter_mut().zip(stages).for_each(|(a, (end, first))| *a = (end - first) * over);
            // A vertex that B.4 has caught has fallen freely in the first stage. Its change between the stages is an impact.
            arrays.active.prescribe_accelerations(a, self.settings.dt);
        }
        self.parts.halo().update(self.parts.ranks(), a);
    }

    /// The vertices that rest on bodies, by where the last acceleration takes them.
    fn find_resting(&mut self) -> Vec<ActiveContact> {
        let Self { parts, cloth, prescribed, contacts, settings, .. } = self;
        let Some(collision) = &mut contacts.bodies else { return Vec::new() };
        let (state, v_half) = (&cloth.state, &mut cloth.scratch.v_half);
        for ((v_half, v), a) in v_half.iter_mut().zip(&state.v).zip(&state.a) {
            *v_half = v + a * (0.5 * settings.dt);
        }
        let own = parts.own();
        let (bodies, dt, recovery_speed) = (&prescribed.bodies, settings.dt, settings.recovery_speed);
        let (x, v, v_half) = (&state.x[own.clone()], &state.v[own.clone()], &v_half[own]);
        collision.resting(&CollisionStep { bodies, dt, recovery_speed, x, v, v_half })
    }

    fn stages(&mut self) -> Stages<'_> {
        let Self { parts, masses, cloth, dynamics, prescribed, contacts, settings, .. } = self;
        let Prescribed { pins, targets, bodies, .. } = &**prescribed;
        let repels = settings.variants.self_repulsion == RepulsionPlace::Solves;
        let arrays = cloth.scratch.stages.as_mut().expect("a scene with this integrator has its arrays");
        let at = StageContext {
            parts,
            masses,
            dt: settings.dt,
            stop: settings.stop,
            recovery_speed: settings.recovery_speed,
            held: settings.held.unwrap_or_default(),
            start: &cloth.state,
            wind: &dynamics.wind,
            pins: pins.as_ref(),
            targets,
            extrapolated: EXTRAPOLATED * settings.mean_edge,
        };
        let (forces, volumes) = (&mut dynamics.forces, &mut dynamics.volumes);
        let repulsion = contacts.cloth.as_mut().filter(|_| repels);
        Stages { at, arrays, forces, volumes, repulsion, bodies }
    }
}
