//! The collision step: from one collision-free state to the next.
//!
//! ```text
//! A        remember the collision-free state, find pairs near it and their sides, choose K
//! K × B    time steps (`crate::step`)
//! C        resolve what collides between the remembered state and this one
//!          rewind: where C gives the state back, it starts again from A with K halved
//! ```
//!
//! A collision step that goes wrong on the way is tried again from A, more carefully each time (`super::recovery`).

use std::sync::Arc;

use super::recovery::FailureKind;
use super::{FrameSummary, Simulation};
use crate::clock::Watch;
use crate::contact::bodies::collision::BodyCollision;
use crate::contact::self_contact::{Ending, SelfContact};
use crate::error::{ShortStep, StepError};
use crate::observe::{Observer, Place, Quantity};
use crate::parallel::for_each_part::PerPart;
use crate::solve::conjugate_gradient::Stop;
use crate::state::State;
use crate::step::{CollisionEnd, Step, StepReport, StepSettings};
use crate::time_step::StepShares;
use crate::tolerances::{CG_GRAVITY_FRACTION, STANDARD_GRAVITY};

/// Largest tolerance of the damping solves when it is chosen automatically [m/s]; the authors' value.
const CG_TOLERANCE: f64 = 1e-2;

/// Outcome of a collision step.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Ended {
    /// At a later collision-free state.
    Accepted,
    /// Return to its start: C gave the state back.
    Rewound,
    /// Return to its start: the step went wrong, and is tried again more carefully.
    Retried,
}

impl Simulation {
    /// Goes on until `end` [s], one collision step after the other, or until it is to pause: then returns true.
    pub(super) fn run_until(
        &mut self,
        end: f64,
        summary: &mut FrameSummary,
        pause: &mut dyn FnMut(f64) -> bool,
    ) -> Result<bool, StepError> {
        while self.cloth.state.time < end {
            if self.collision_step(end, summary)? != Ended::Retried && pause(self.cloth.state.time) {
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// One collision step towards `end` [s].
    pub(super) fn collision_step(&mut self, end: f64, summary: &mut FrameSummary) -> Result<Ended, StepError> {
        self.keep_collision_free_state(); // A
        let steps = self.find_close_pairs(); // A
        self.show("A");
        let steps = self.time_steps(steps, end, summary)?; // K × B
        if let Some(failure) = steps.failure
            && self.recover(failure, summary.frame)?
        {
            return Ok(Ended::Retried);
        }
        let ending = self.resolve_collisions(&steps); // C
        if let Some(failure) = self.find_failure(ending)
            && self.recover(failure, summary.frame)?
        {
            return Ok(Ended::Retried);
        }
        if ending == Ending::Rewound {
            self.rewind();
            return Ok(Ended::Rewound);
        }
        self.accept();
        Ok(Ended::Accepted)
    }

    /// A: finds the pairs near the collision-free state, and their sides; returns K, the number of time steps until C.
    fn find_close_pairs(&mut self) -> u32 {
        let Self { contacts, cloth, prescribed, limit, metrics, retry, .. } = self;
        let Some(contact) = &mut contacts.cloth else { return 1 };
        let steps = metrics
            .stage("A neighbours", |m| contact.begin_collision_step(&cloth.state, &prescribed.bodies, limit.last(), m));
        if retry.is_cautious() { steps.min(1) } else { steps }
    }

    /// K × B: up to `most` time steps, fewer where `end` [s] is reached or something goes wrong.
    fn time_steps(&mut self, most: u32, end: f64, summary: &mut FrameSummary) -> Result<TimeSteps, StepError> {
        let mut steps = TimeSteps { start: self.cloth.state.time, made: 0, failure: None };
        while steps.failure.is_none() && self.cloth.state.time < end && steps.made < most {
            steps.failure = self.time_step(steps.made > 0, end, summary)?;
            steps.made += 1;
        }
        Ok(steps)
    }

    /// C; returns how it ended.
    fn resolve_collisions(&mut self, steps: &TimeSteps) -> Ending {
        let ending = self.end_collision_step(self.cloth.state.time - steps.start, steps.made > 1);
        self.show("C");
        ending
    }

    fn end_collision_step(&mut self, duration: f64, may_rewind: bool) -> Ending {
        let Self { scene, contacts, cloth, prescribed, metrics, retry, .. } = self;
        let State { x, v, .. } = &mut cloth.state;
        let Some(contact) = &contacts.cloth else { return Ending::Resolved };
        // Repulsions alone only note how far the neighbours have come.
        let stage = if contact.keeps_free() { "C collisions" } else { "A neighbours" };
        let end = CollisionEnd { x, v, duration, may_rewind, checks_all: retry.is_retrying() };
        metrics.stage(stage, |m| contacts.resolve_collisions(end, &prescribed.bodies, scene.parts(), m))
    }

    /// Shows the cloth after A or C to the observer.
    fn show(&mut self, line: &'static str) {
        let Self { observer: Some(observer), scene, cloth, .. } = self else { return };
        let State { x, v, time, .. } = &cloth.state;
        let quantities = [Quantity { name: "x", values: x }, Quantity { name: "v", values: v }];
        observer.after(Place { line, time: *time, dt: 0.0 }, scene, &quantities);
    }

    /// Takes the state as the next collision-free one, and does what may be done only where nothing is taken back any more.
    fn accept(&mut self) {
        self.relax();
        if self.prescribed.bodies.stands_still() {
            return;
        }
        if self.yields.is_some() {
            self.update_plasticity();
        }
        self.break_attachments();
        self.break_seams();
    }

    /// Keeps what is bent or stretched too far to spring back.
    fn update_plasticity(&mut self) {
        let Self { scene, dynamics, cloth, metrics, .. } = self;
        metrics.stage("yield", |_| {
            scene.parts().for_each(PerPart(&mut dynamics.forces), &|_, forces| {
                let plastic = forces.0[0].iter_mut().filter_map(|force| force.plastic_mut());
                plastic.for_each(|force| force.update_plasticity(&cloth.state.x));
            });
        });
    }

    /// Opens stitches that are pulled too hard.
    fn break_seams(&mut self) {
        if self.breaks.is_none() {
            return;
        }
        let State { x, time, .. } = &self.cloth.state;
        let forces = self.dynamics.forces.iter_mut().flatten().filter_map(|force| force.breakable_mut());
        let broken: u64 = forces.map(|force| force.break_overloaded(x, *time)).sum();
        if broken > 0 {
            self.metrics.count("stitches_broken", broken);
        }
    }

    /// Lets go what is pulled too hard.
    fn break_attachments(&mut self) {
        let broken = self.prescribed.targets.break_overloaded(&self.cloth.state.x, self.cloth.state.time);
        if broken > 0 {
            self.metrics.count("attachments_broken", broken);
        }
    }

    /// Puts everything back to the last collision-free state.
    pub(super) fn rewind(&mut self) {
        let Self { scene, contacts, cloth, retry, .. } = self;
        let state = &mut cloth.state;
        if let Some(contact) = &contacts.cloth {
            contact.rewind(state);
        }
        state.a.clone_from(&retry.a_start);
        retry.forget_steps();
        let parts = scene.parts();
        parts.halo().update_all(parts.ranks(), &mut [&mut state.x, &mut state.v]);
        self.hold_still();
    }

    /// Time of the shot at which the state is [s]; the clock of cloth that is untangled runs beside it.
    pub(super) fn time_of_shot(&self) -> f64 {
        self.prescribed.bodies.time_of_motion(self.cloth.state.time)
    }

    /// Puts bodies and pins where they are at the time of the state, at rest.
    pub(super) fn hold_still(&mut self) {
        let Self { contacts, cloth, prescribed, .. } = self;
        let time = cloth.state.time;
        prescribed.bodies.set_step(time, time);
        prescribed.targets.set_step(&prescribed.bodies, &prescribed.tracks, &cloth.state.x, (time, time));
        contacts.bodies.iter_mut().for_each(BodyCollision::forget);
    }

    /// B: one time step towards `end` [s], the first of a collision step or one that `follows` others; what went wrong in it.
    pub(super) fn time_step(
        &mut self,
        follows: bool,
        end: f64,
        summary: &mut FrameSummary,
    ) -> Result<Option<FailureKind>, StepError> {
        let scene = Arc::clone(&self.scene);
        let settings = &scene.description().solver;
        let parts = scene.parts();
        let watch = Watch::start();
        let retries = self.retries(FailureKind::Unsettled);
        let rate = self.rate_of_strain();
        let of_longest = self.contacts.cloth.as_ref().map_or(1.0, SelfContact::step_share);
        let shares = StepShares { of_longest, of_allowed: self.retry.part() };
        let choice = self.limit.choose(settings, rate, self.cloth.state.time..end, shares);
        self.metrics.add_time("dt".into(), watch.seconds(), 1);
        if choice.limit < settings.min_dt {
            let because = if choice.by_strain { ShortStep::StrainRate } else { ShortStep::Stiffness };
            if follows && choice.by_strain {
                return Ok(Some(FailureKind::of_rate(rate)));
            }
            let (dt, min_dt, time) = (choice.limit, settings.min_dt, self.time_of_shot());
            self.roll_back();
            return Err(StepError::StepTooSmall { frame: summary.frame, time, dt, min_dt, because });
        }
        let automatic = CG_TOLERANCE.min(CG_GRAVITY_FRACTION * choice.dt * STANDARD_GRAVITY);
        let tolerance = settings.cg_tolerance.unwrap_or(automatic);
        let stop = self.retry.stop(Stop { tolerance, max_iterations: settings.cg_max_iterations });
        self.observer.iter_mut().for_each(Observer::begin_step);
        let step = Step {
            parts,
            masses: scene.masses(),
            cloth: &mut self.cloth,
            dynamics: &mut self.dynamics,
            prescribed: &mut self.prescribed,
            contacts: &mut self.contacts,
            metrics: &mut self.metrics,
            observer: self.observer.as_mut().map(|observer| (observer, &*scene)),
            settings: StepSettings {
                dt: choice.dt,
                recovery_speed: self.limit.recovery_speed(settings, scene.mean_edge(), choice.dt),
                mean_edge: scene.mean_edge(),
                stop,
                held: self.retry.held().or(scene.isolated()),
                integrator: settings.integrator,
                retries,
            },
            report: StepReport::default(),
        };
        let report = step.advance();
        self.retry.note_step(choice.dt, rate, &report);
        self.limit.forget_rate();
        if let Some(stage) = report.not_finite {
            return Ok(Some(FailureKind::NotFinite(stage)));
        }
        summary.steps += 1;
        summary.cg_iterations += report.cg_iterations as u64;
        summary.dt_min = summary.dt_min.min(choice.dt);
        summary.dt_max = summary.dt_max.max(choice.dt);
        if choice.ends_interval {
            // The time of a frame comes from integers, not from a sum of steps.
            self.cloth.state.time = end;
        }
        Ok(match report {
            StepReport { diverged: true, .. } => Some(FailureKind::Diverged),
            StepReport { unsettled: true, .. } => Some(FailureKind::Unsettled),
            StepReport { short_solves: 1.., .. } => Some(FailureKind::Short),
            _ => None,
        })
    }
}

/// Outcome of the time steps of a collision step.
struct TimeSteps {
    /// When they began [s].
    start: f64,
    made: u32,
    failure: Option<FailureKind>,
}
