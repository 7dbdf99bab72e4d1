//! Newton's method with active contacts: the rounds of solves of a stage (`docs/theory/tr_bdf2.md#newtons-method-in-contact`).

use super::arrays::StageArrays;
use super::parts::{PairsInTouch, parts_in_layers, parts_moved, parts_touched};
use super::stage::{StageEquation, StageSolver};
use crate::Vec3;
use crate::contact::bodies::active_set::{ActiveContact, StageEnd, Trust};
use crate::contact::repulsion::pair_forces::note_solution;
use crate::long_steps::{CONVERGED, LATE_ITERATIONS, MOST_ROUNDS, MOST_ROUNDS_OF_PAIRS, ROUGH, UNSETTLED_SHARE};
use crate::parallel::simd4::Simd4;
use crate::solve::conjugate_gradient::Outcome;
use crate::solve::preconditioned_cg::{BlockSystem, Forcing};

/// Pairs without a settled force, alike on all ranks.
#[derive(Debug, Clone, Copy, Default)]
struct Unsettled {
    /// Whether some rank has such a pair.
    is_unsettled: bool,
    /// Whether more than [`UNSETTLED_SHARE`] of the vertices of some part belong to such pairs.
    in_large_share: bool,
}

impl StageSolver<'_> {
    /// The forces of pairs in touch where the stage stands, at a fraction of the step.
    pub(super) fn evaluate_pairs(&mut self, fraction: f64) {
        let Some(contact) = &mut self.repulsion else { return };
        let StageArrays { x, v, pairs, .. } = &mut *self.arrays;
        *pairs = contact.pair_forces([x, v], self.bodies, (fraction, self.at.dt), pairs);
    }

    /// Adds the forces of pairs times `duration` [s] to `impulses` of the own vertices that are worked on [N s].
    pub(super) fn add_pair_impulses(&self, duration: f64, impulses: &mut [Vec3]) {
        let Some(contact) = &self.repulsion else { return };
        let StageArrays { pairs, worked_on, .. } = &*self.arrays;
        let (own, parts) = (contact.nodes().own(), self.at.parts);
        for pair in pairs {
            for (node, weight) in pair.nodes.iter().zip(pair.weights) {
                let vertex = (*node as usize).wrapping_sub(own.start);
                if vertex < own.len() && worked_on[parts.part_of(vertex + parts.own().start)] {
                    impulses[vertex] += pair.force * (weight * duration);
                }
            }
        }
    }

    /// Sets the residual with the forces of pairs that the solve before has found, from the residual without pairs.
    fn set_solved_residual(&mut self, stage: &StageEquation) {
        let mut solved = std::mem::take(&mut self.arrays.solved_residual);
        solved.copy_from_slice(&self.arrays.residual);
        self.add_pair_impulses(stage.share_of_pairs * stage.weight, &mut solved);
        self.arrays.solved_residual = solved;
    }

    /// Adds the forces of pairs in touch where the stage stands to its residual.
    fn add_pairs(&mut self, stage: &StageEquation) {
        self.evaluate_pairs(stage.fraction);
        let mut residual = std::mem::take(&mut self.arrays.residual);
        self.add_pair_impulses(stage.share_of_pairs * stage.weight, &mut residual);
        self.arrays.residual = residual;
    }

    /// Takes the pairs into the matrix, if some rank has one.
    fn set_pairs(&mut self, stage: &StageEquation, some_rank_has_one: bool) {
        let StageArrays { cg, pairs, .. } = &mut *self.arrays;
        match self.repulsion.as_deref().filter(|_| some_rank_has_one) {
            Some(contact) => {
                let factors = [stage.share_of_pairs, stage.weight];
                cg.pairs_mut().set(self.at.parts, contact.nodes(), pairs, factors);
            }
            None => cg.pairs_mut().clear(),
        }
    }

    /// Whether some rank has a part to work on. All ranks call it together.
    pub(in crate::step) fn has_work(&self) -> bool {
        self.at.parts.ranks().any(self.arrays.worked_on.contains(&true))
    }

    /// The pairs that were evaluated last, with the changes of velocity of their nodes by a solve where these are known [m/s].
    fn pairs_in_touch<'b>(&'b self, solution: Option<&'b [Simd4]>) -> Option<PairsInTouch<'b>> {
        let contact = self.repulsion.as_deref()?;
        Some(PairsInTouch { pairs: &self.arrays.pairs, nodes: contact.nodes(), solution })
    }

    /// The parts in which the last change of velocities was more than `far` [m/s], by a solve or by something else.
    pub(in crate::step) fn parts_moved(&self, far: f64, was_solved: bool) -> Vec<bool> {
        let StageArrays { matrix, change, cg, .. } = &*self.arrays;
        let touch = self.pairs_in_touch(was_solved.then(|| cg.pairs().velocities()));
        parts_moved(self.at.parts, matrix, touch.as_ref(), (change, far))
    }

    /// The parts in which cloth touches cloth.
    pub(in crate::step) fn parts_in_layers(&self) -> Vec<bool> {
        parts_in_layers(self.at.parts, self.pairs_in_touch(None).as_ref())
    }

    /// The parts that touch something.
    fn parts_touched(&self) -> Vec<bool> {
        parts_touched(self.at.parts, self.active, self.pairs_in_touch(None).as_ref())
    }

    /// Solves a stage for its velocities, `v` and with them `x`, with contacts in modes that fit what they bear and with pairs that
    /// are in touch where the solve comes to.
    pub(in crate::step) fn solve(&mut self, stage: &StageEquation) -> Outcome {
        let (at, weight) = (self.at, stage.weight);
        self.set_residual(stage);
        self.add_pairs(stage);
        let mut total = Outcome::NONE;
        let has_pairs = !self.arrays.pairs.is_empty();
        let [has_pairs, on_bodies] = at.parts.ranks().any_of([has_pairs, !self.active.contacts().is_empty()]);
        let takes_rounds = has_pairs || on_bodies || self.arrays.has_iterated;
        self.set_pairs(stage, has_pairs);
        let rough = ROUGH * at.stop.tolerance;
        let mut forcing = Forcing::new(rough);
        // No round changes which vertices are dragged.
        let masses = self.active.masses_with_drag(&self.drag(stage));
        for round in 1.. {
            let prescription = at.with(self.active);
            let StageArrays { matrix, cg, residual, change, x, v, worked_on, pairs, .. } = &mut *self.arrays;
            let (parts, masses, matrix) = (self.at.parts, &*masses, &*matrix);
            let system = BlockSystem { parts, masses, worked_on, matrix, constraints: &prescription };
            // Coarse levels of the stage's first round serve the others: these solve for a share of the parts, and take up to half as
            // many iterations more than with levels of their own, which would cost more than they do.
            if !stage.positions_given && round == 1 {
                cg.prepare(&system);
            } else {
                cg.prepare_finest(&system);
            }
            let outcome = if takes_rounds {
                let stop = if round > MOST_ROUNDS { at.stop.later(LATE_ITERATIONS) } else { at.stop };
                cg.newton_step(&system, residual, change, stop, &mut forcing)
            } else {
                cg.solve(&system, residual, change, at.stop.later(LATE_ITERATIONS))
            };
            total.solves += outcome.solves;
            total.iterations += outcome.iterations;
            // The next round solves for the rest.
            total.converged = outcome.converged;
            total.finite &= outcome.finite;
            total.worse |= outcome.worse;
            let factors = [stage.share_of_pairs, weight];
            note_solution(pairs, cg.pairs_mut().products(), factors);
            // Where positions are given, forces are linearised at these alone: the step ends at those of B.4.
            for ((v, x), change) in v.iter_mut().zip(x.iter_mut()).zip(&*change) {
                *v += change;
                *x += change * weight;
            }
            if !takes_rounds {
                self.arrays.worked_on.fill(false);
                break;
            }
            let mut moved = self.parts_moved(CONVERGED * at.stop.tolerance, true);
            // A solve that has ended at its limit of iterations is continued.
            let is_short = !outcome.converged && outcome.finite && !outcome.worse;
            if is_short {
                moved.iter_mut().zip(&self.arrays.worked_on).for_each(|(moved, worked_on)| *moved |= worked_on);
            }
            let Unsettled { is_unsettled, in_large_share } =
                if round >= MOST_ROUNDS { self.unsettled() } else { Unsettled::default() };
            let modes_settled = !stage.positions_given || self.active.is_settled();
            let is_last = round >= MOST_ROUNDS && !is_unsettled && !is_short && modes_settled;
            if !total.finite || is_last || round == MOST_ROUNDS_OF_PAIRS {
                self.arrays.has_unsettled_pair |= is_unsettled;
                if in_large_share {
                    self.note_unsettled();
                }
                self.arrays.worked_on = moved;
                break;
            }
            if !self.next_round(stage, moved, (round == 1).then_some(rough)) {
                break;
            }
        }
        total
    }

    /// Stops vertices whose slip has turned round in a stage, and catches those that have come back into the body that had let them go;
    /// none where positions are given.
    fn turn(&mut self, stage: &StageEquation) {
        if stage.positions_given {
            return;
        }
        let (at, StageArrays { x, v, .. }) = (self.at, &mut *self.arrays);
        let StageEquation { fraction, weight: alpha, reversal_test, .. } = *stage;
        let start = &*at.start.x;
        let any = self.active.turn(&StageEnd { start, fraction, dt: at.dt, alpha, reversal_test }, x, v);
        if at.parts.ranks().any(any) {
            // Pins decide where both hold.
            let prescription = at.with(self.active);
            prescription.set_own_velocities(v, |_, _| ());
            prescription.set_positions(fraction, start, [x, v]);
        }
    }

    /// Own nodes of unsettled pairs, ascending.
    fn unsettled_nodes(&self) -> Vec<u32> {
        let Some(contact) = &self.repulsion else { return Vec::new() };
        let of_pairs = self.arrays.unsettled(self.at.dt).flat_map(|pair| pair.nodes);
        let mut nodes: Vec<u32> = of_pairs.filter(|node| contact.nodes().is_own(*node)).collect();
        nodes.sort_unstable();
        nodes.dedup();
        nodes
    }

    /// Looks for unsettled pairs on all ranks, which call it together.
    fn unsettled(&self) -> Unsettled {
        let parts = self.at.parts;
        let nodes = self.unsettled_nodes();
        let first_own = self.repulsion.as_deref().map_or(0, |contact| contact.nodes().own().start);
        let mut counts = vec![0.0; parts.count()];
        for node in &nodes {
            counts[parts.part_of(*node as usize - first_own + parts.own().start)] += 1.0;
        }
        let is_large =
            counts.iter().zip(parts.ranges()).any(|(count, part)| *count > UNSETTLED_SHARE * part.len() as f64);
        let [is_unsettled, in_large_share] = parts.ranks().any_of([!nodes.is_empty(), is_large]);
        Unsettled { is_unsettled, in_large_share }
    }

    /// Notes that a part is unsettled at the end of the stage, and the own vertices of unsettled pairs.
    fn note_unsettled(&mut self) {
        let Some(contact) = &self.repulsion else { return };
        let own = self.unsettled_nodes().into_iter().map(|node| contact.nodes().number(node)).collect();
        self.arrays.unsettled_vertices.get_or_insert_default().append(&mut { own });
    }

    /// Prepares the next round: the forces and the matrix where a solve has come to, and modes of contacts that fit what they bear there.
    /// The round works on the parts that have moved far, and on those whose contacts are not settled; after a first, rough solve, which is
    /// right to `rough` [m/s], on all that touch something. Returns whether there is anything to work on.
    fn next_round(&mut self, stage: &StageEquation, moved: Vec<bool>, rough: Option<f64>) -> bool {
        let (at, own) = (self.at, self.at.parts.own().start);
        let touched = self.parts_touched();
        self.turn(stage);
        // What contacts bear has changed where they were solved for.
        let worked_on = &mut self.arrays.worked_on;
        for ((worked_on, moved), touched) in worked_on.iter_mut().zip(&moved).zip(&touched) {
            *worked_on = *moved || (*worked_on && *touched);
        }
        self.linearise(stage);
        self.set_residual(stage);
        self.set_solved_residual(stage);
        self.add_pairs(stage);
        let StageArrays { residual, solved_residual, v_start, v_inertial, x, worked_on, pairs, .. } = &mut *self.arrays;
        let restart = |contact: &ActiveContact| {
            if !stage.may_restart {
                return Vec3::zeros();
            }
            let start = contact.start_velocity(at.start.v[contact.vertex], &contact.velocity_at(0.0, at.dt));
            let change = start - v_start[contact.vertex];
            v_start[contact.vertex] = start;
            v_inertial[contact.vertex - own] = start;
            if stage.feels_start {
                x[contact.vertex] += change * stage.weight;
            }
            change * at.masses[contact.vertex]
        };
        // Modes that only a rough solve shows to be wrong are looked at again.
        let trust = Trust { tolerance: rough.unwrap_or(0.0), masses: at.masses, settled: stage.settled };
        let unsettled = self.active.update(at.parts, (residual, solved_residual), trust, restart);
        // On its way while ranks agree whether they go on.
        let restarted = (stage.may_restart && stage.feels_start).then(|| at.parts.halo().start(at.parts.ranks(), x));
        let next = moved.into_iter().zip(touched).zip(unsettled);
        for (worked_on, ((moved, touched), unsettled)) in worked_on.iter_mut().zip(next) {
            *worked_on &= moved || (rough.is_some() && touched) || unsettled;
        }
        let [has_work, has_pairs] = at.parts.ranks().any_of([worked_on.contains(&true), !pairs.is_empty()]);
        restarted.into_iter().for_each(|flight| flight.finish(x));
        if has_work {
            self.set_pairs(stage, has_pairs);
        }
        has_work
    }
}
