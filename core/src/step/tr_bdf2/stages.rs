//! The stages of the scheme: their predictions, and what each balances.

use super::{ALPHA, GAMMA, U, W};
use crate::Vec3;
use crate::contact::bodies::active_set::{ActiveContact, ReversalTest};
use crate::long_steps::SETTLED;
use crate::solve::conjugate_gradient::Outcome;
use crate::step::implicit::{StageArrays, StageEquation, StageSolver};

/// The trapezoid, in a step of `dt` [s].
fn trapezoid(dt: f64) -> StageEquation {
    StageEquation {
        fraction: GAMMA,
        weight: ALPHA * dt,
        // Half of the pairs' forces at the start would accelerate nodes whose pair opens, so each stage has the forces of its end alone,
        // for all of its length.
        share_of_pairs: 2.0,
        feels_start: true,
        may_restart: true,
        positions_given: false,
        reversal_test: ReversalTest::Velocities,
        settled: SETTLED[0],
    }
}

/// BDF2 over the step.
fn bdf2(dt: f64) -> StageEquation {
    // A vertex that stops within the step may move back at its end. Its displacement says where Coulomb's law leaves it.
    let (reversal_test, settled) = (ReversalTest::Positions, SETTLED[1]);
    StageEquation {
        fraction: 1.0,
        share_of_pairs: 1.0,
        feels_start: false,
        may_restart: false,
        reversal_test,
        settled,
        ..trapezoid(dt)
    }
}

/// BDF2 at given positions.
fn bdf2_again(dt: f64) -> StageEquation {
    StageEquation { positions_given: true, settled: SETTLED[2], ..bdf2(dt) }
}

/// The trapezoid: x₁ and v₁.
pub(super) fn first_stage(solver: &mut StageSolver<'_>) -> Outcome {
    let (at, stage) = (solver.at, trapezoid(solver.at.dt));
    solver.begin(GAMMA * at.dt);
    let in_layers = solver.parts_in_layers();
    let StageArrays { v_start, v_inertial, x, v, .. } = &mut *solver.arrays;
    v_inertial.copy_from_slice(&v_start[at.parts.own()]);
    at.predict((ALPHA, &in_layers), (v, v_start), |vertex| at.start.a[vertex] * (GAMMA * at.dt));
    let prescription = at.with(solver.active);
    prescription.set_own_velocities(v, |contact, v| contact.prescribe(v, &contact.velocity_at(GAMMA, at.dt)));
    for (((x, start), v_start), v) in x.iter_mut().zip(&at.start.x).zip(&*v_start).zip(&*v) {
        *x = start + (v_start + v) * stage.weight;
    }
    prescription.set_positions(GAMMA, &at.start.x, [x, v]);
    solver.linearise(&stage);
    let v_start = &solver.arrays.v_start;
    let earlier = |vertex: usize| (v_start[vertex] - at.start.v[vertex]) * at.masses[vertex];
    solver.active.begin_stage(1.0, earlier);
    let outcome = solver.solve(&stage);
    let StageArrays { v_start, v_first, x, v, .. } = &mut *solver.arrays;
    v_first.copy_from_slice(v);
    // Where contacts changed their modes, the start is another one than ghosts know.
    at.parts.halo().update_all(at.parts.ranks(), &mut [v_start, x]);
    outcome
}

/// BDF2: x₂ and v₂.
pub(super) fn second_stage(solver: &mut StageSolver<'_>) -> Outcome {
    let (at, stage) = (solver.at, bdf2(solver.at.dt));
    set_inertial(solver);
    let in_layers = solver.parts_in_layers();
    let StageArrays { v_start, v_first, x, v, worked_on, .. } = &mut *solver.arrays;
    worked_on.fill(true);
    let change = |vertex: usize| (v_first[vertex] - v_start[vertex]) * ((1.0 - GAMMA) / GAMMA);
    at.predict((ALPHA, &in_layers), (v, v_first), change);
    let prescription = at.with(solver.active);
    prescription.set_own_velocities(v, |contact, v| contact.prescribe(v, &contact.velocity));
    for ((x, start), v) in x.iter_mut().zip(&at.start.x).zip(&*v) {
        // w x₁ − u x, such that what does not move stays where it is to the last bit.
        *x = start + (*x - start) * W + v * stage.weight;
    }
    prescription.set_positions(1.0, &at.start.x, [x, v]);
    solver.linearise(&stage);
    // Of a constant reaction this stage has half of what the first one had.
    solver.active.begin_stage(0.5, |_| Vec3::zeros());
    let outcome = solver.solve(&stage);
    let StageArrays { x, .. } = &mut *solver.arrays;
    solver.active.stop_reversed(x, |contact| at.start.x[contact.vertex] + contact.carried);
    at.parts.halo().update(at.parts.ranks(), x);
    outcome
}

/// v₂ once more, at the positions `x_new` and with the impacts of bodies at the start of the step.
pub(super) fn second_stage_again(
    solver: &mut StageSolver<'_>,
    x_new: &[Vec3],
    v_star: &[Vec3],
    met: Vec<ActiveContact>,
) -> Outcome {
    let (at, stage) = (solver.at, bdf2_again(solver.at.dt));
    let StageArrays { v_start, v_first, x, v, change, .. } = &mut *solver.arrays;
    for ((change, x_new), x) in change.iter_mut().zip(x_new).zip(&*x) {
        *change = (x_new - x) / at.dt;
    }
    x.copy_from_slice(x_new);
    // What rested on a body has its velocity from the first solve on; others are struck.
    for vertex in if v_star.is_empty() { 0..0 } else { at.parts.own() } {
        let impact = v_star[vertex] - at.start.v[vertex];
        if impact != Vec3::zeros() && !solver.active.holds(vertex) {
            [&mut *v_start, v_first, v, change].into_iter().for_each(|v| v[vertex] += impact);
        }
    }
    set_inertial(solver);
    solver.active.add(at.parts, met);
    at.parts.halo().update(at.parts.ranks(), &mut solver.arrays.change);
    // What only rounding moves was not moved.
    let moved = solver.parts_moved(f64::EPSILON.sqrt() * at.stop.tolerance, false);
    for (part, (worked_on, moved)) in solver.arrays.worked_on.iter_mut().zip(moved).enumerate() {
        *worked_on |= moved || !solver.active.of_part(part).is_empty();
    }
    if !solver.has_work() {
        return Outcome::NONE;
    }
    let prescription = at.with(solver.active);
    prescription.set_velocities(&mut solver.arrays.v, |contact, v| contact.prescribe(v, &contact.velocity));
    solver.linearise(&stage);
    solver.active.begin_stage(1.0, |_| Vec3::zeros());
    let outcome = solver.solve(&stage);
    solver.active.stop_reversed(&mut solver.arrays.v, |contact| contact.velocity);
    outcome
}

/// Sets the velocities that BDF2 leads to without forces.
fn set_inertial(solver: &mut StageSolver<'_>) {
    let own = solver.at.parts.own();
    let StageArrays { v_start, v_first, v_inertial, .. } = &mut *solver.arrays;
    for ((inertial, first), start) in v_inertial.iter_mut().zip(&v_first[own.clone()]).zip(&v_start[own]) {
        *inertial = first + (first - start) * U;
    }
}
