//! Stages of implicit steps: Newton's method with active contacts (`docs/theory/tr_bdf2.md#newtons-method-in-contact`).
//!
//! A scheme says by a [`StageEquation`] what a stage balances and predicts its end; [`StageSolver`] solves it.
//!
//! One linear solve is enough where nothing touches. Vertices that rest on bodies move with them in the solves
//! ([`crate::contact::bodies::active_set`]), and pairs of cloth repel each other there.

mod arrays;
mod newton;
mod parts;
mod prescription;
mod stage;

pub(crate) use arrays::StageArrays;
pub(super) use stage::{StageEquation, StageSolver};

use super::{Prescribed, Scratch, Step};
use crate::contact::bodies::active_set::ActiveContact;
use crate::contact::bodies::collision::CollisionStep;
use crate::long_steps::EXTRAPOLATED;
use crate::solve::conjugate_gradient::Outcome;
use stage::StepContext;

impl Step<'_> {
    /// Solver of the stages of this step.
    pub(super) fn stage_solver(&mut self) -> StageSolver<'_> {
        let Self { parts, masses, cloth, dynamics, prescribed, contacts, settings, .. } = self;
        let Prescribed { pins, targets, bodies, .. } = &**prescribed;
        let Scratch { stages: Some(arrays), active, .. } = &mut cloth.scratch else {
            unreachable!("a scene with an implicit integrator has its arrays")
        };
        let at = StepContext {
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
        let repulsion = contacts.cloth.as_mut().filter(|contact| contact.repels());
        StageSolver { at, arrays, active, forces, volumes, repulsion, bodies }
    }

    /// Takes the outcome of the solves of a stage of a line into the report.
    pub(super) fn report_stage(&mut self, outcome: Outcome, line: &'static str) {
        let Self { parts, cloth, metrics, report, settings, .. } = self;
        if let Some(arrays) = &mut cloth.scratch.stages {
            report.add(outcome, line, (parts, metrics), || arrays.cg.unsolved(parts, settings.stop));
            arrays.report_unsettled(report);
        }
    }

    /// The vertices that rest on bodies, by where the last acceleration takes them.
    pub(super) fn find_resting(&mut self) -> Vec<ActiveContact> {
        let Self { parts, cloth, prescribed, contacts, settings, .. } = self;
        let Some(collision) = &mut contacts.bodies else { return Vec::new() };
        // Velocities predicted for the middle of the step, in the array of v½, which B.1 overwrites.
        let (state, v_half) = (&cloth.state, &mut cloth.scratch.v_half);
        for ((v_half, v), a) in v_half.iter_mut().zip(&state.v).zip(&state.a) {
            *v_half = v + a * (0.5 * settings.dt);
        }
        let own = parts.own();
        let (bodies, dt, recovery_speed) = (&prescribed.bodies, settings.dt, settings.recovery_speed);
        let (x, v, v_half) = (&state.x[own.clone()], &state.v[own.clone()], &v_half[own]);
        let pinched_in_solves = settings.integrator.spec().pinched_in_solves;
        let layers = contacts.cloth.as_ref().and_then(|contact| contact.layer_thickness());
        collision.resting(&CollisionStep { bodies, dt, recovery_speed, x, v, v_half, pinched_in_solves }, layers)
    }
}
