//! From one collision-free state to the next: A, some time steps, C, and what follows if something went wrong.

use std::sync::Arc;

use super::recovery::Trouble;
use super::{FrameSummary, Simulation};
use crate::clock::Watch;
use crate::contact::self_contact::{Ending, SelfContact};
use crate::error::{ShortStep, StepError};
use crate::parallel::for_each_part::PerPart;
use crate::solve::conjugate_gradient::Stop;
use crate::step::{StepContext, advance};
use crate::tolerances::CG_GRAVITY_FRACTION;

/// Acceleration that the automatic tolerance of the damping solves compares with [m/s²]; the earth's.
const STANDARD_GRAVITY: f64 = 9.81;

/// Largest tolerance of the damping solves when it is chosen automatically [m/s]; the authors' value.
const CG_TOLERANCE: f64 = 1e-2;

impl Simulation {
    /// Steps until `end` [s], one collision step after the other, or until it is to pause: then returns true.
    pub(super) fn run_to(
        &mut self,
        end: f64,
        frame: i64,
        summary: &mut FrameSummary,
        pause: &mut dyn FnMut(f64) -> bool,
    ) -> Result<bool, StepError> {
        while self.state.time < end {
            let start = self.state.time;
            self.keep_state();
            let steps = if self.care.is_cautious() { self.begin_interval().min(1) } else { self.begin_interval() };
            let (mut done, mut trouble) = (0, None);
            while trouble.is_none() && self.state.time < end && done < steps {
                trouble = self.one_step(end, frame, summary)?;
                done += 1;
            }
            let mut ending = Ending::Resolved;
            if trouble.is_none() {
                ending = self.end_interval(self.state.time - start, done > 1);
                trouble = self.find_trouble(ending);
            }
            if let Some(trouble) = trouble
                && self.recover(trouble, frame)?
            {
                continue;
            }
            if ending == Ending::Rewound {
                self.rewind();
            } else {
                self.calm_down();
                if self.yields.is_some() {
                    self.give_way();
                }
                self.break_attachments();
            }
            if pause(self.state.time) {
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// Lets go what is pulled too hard. Only here, where nothing is taken back any more.
    fn break_attachments(&mut self) {
        let broken = self.targets.break_overloaded(&self.state.x, self.state.time);
        if broken > 0 {
            self.metrics.count("attachments_broken", broken);
        }
    }

    /// A: returns how many time steps may follow until C.
    fn begin_interval(&mut self) -> u32 {
        let Self { self_contact, state, bodies, limit, metrics, .. } = self;
        let Some(contact) = self_contact else { return 1 };
        metrics.stage("A neighbours", |m| contact.begin_interval(state, bodies, limit.last(), m))
    }

    /// C.
    fn end_interval(&mut self, duration: f64, may_rewind: bool) -> Ending {
        let Self { scene, self_contact, collision, state, bodies, metrics, .. } = self;
        let parts = scene.parts();
        let Some(contact) = self_contact.as_mut().filter(|c| !c.collides_after_position()) else {
            return Ending::Resolved;
        };
        let mut moved = |vertex, way| {
            if let Some(collision) = collision {
                collision.moved(vertex, way);
            }
        };
        if contact.repels_per_collision_step() {
            metrics.stage("C self-repulsion", |m| {
                contact.repel_interval((&mut state.x[..], &mut state.v[..]), duration, m, &mut moved);
            });
        }
        // Repulsions alone only note how far the neighbours have come.
        let stage = if contact.keeps_free() { "C collisions" } else { "A neighbours" };
        metrics.stage(stage, |m| {
            let ends = (&mut state.x[..], &mut state.v[..]);
            let ending = contact.end_interval(ends, bodies, duration, may_rewind, m, &mut moved);
            parts.halo().refresh(parts.ranks(), &mut state.x);
            parts.halo().refresh(parts.ranks(), &mut state.v);
            ending
        })
    }

    /// Keeps what is bent or stretched too far to spring back.
    fn give_way(&mut self) {
        let Self { scene, forces, state, metrics, .. } = self;
        metrics.stage("yield", |_| {
            scene.parts().for_each(PerPart(forces), &|_, forces| {
                forces.0[0].iter_mut().for_each(|force| force.yield_to(&state.x));
            });
        });
    }

    /// Puts everything back to the last collision-free state.
    pub(super) fn rewind(&mut self) {
        let Self { scene, self_contact, collision, state, bodies, targets, tracks, .. } = self;
        if let Some(contact) = self_contact {
            contact.rewind(state);
        }
        let parts = scene.parts();
        parts.halo().refresh(parts.ranks(), &mut state.x);
        parts.halo().refresh(parts.ranks(), &mut state.v);
        let time = state.time;
        bodies.set_step(time, time);
        targets.set_step(bodies, tracks, &state.x, (time, time));
        if let Some(collision) = collision {
            collision.forget();
        }
    }

    /// One time step towards `end` [s]; what went wrong in it.
    fn one_step(&mut self, end: f64, frame: i64, summary: &mut FrameSummary) -> Result<Option<Trouble>, StepError> {
        let scene = Arc::clone(&self.scene);
        let settings = &scene.description().solver;
        let parts = scene.parts();
        let watch = Watch::start();
        let rate = self.rate_of_strain();
        let (share, part) = (self.self_contact.as_ref().map_or(1.0, SelfContact::step_share), self.care.part());
        let choice = self.limit.choose(settings, rate, (self.state.time, end), (share, part));
        self.metrics.add_time("dt".into(), watch.seconds(), 1);
        if choice.limit < settings.min_dt {
            let because = if choice.by_strain { ShortStep::StrainRate } else { ShortStep::Stiffness };
            let (dt, min_dt, time) = (choice.limit, settings.min_dt, self.state.time);
            self.take_back();
            return Err(StepError::StepTooSmall { frame, time, dt, min_dt, because });
        }
        let automatic = CG_TOLERANCE.min(CG_GRAVITY_FRACTION * choice.dt * STANDARD_GRAVITY);
        let tolerance = settings.cg_tolerance.unwrap_or(automatic);
        let stop = self.care.stop(Stop { tolerance, max_iterations: settings.cg_max_iterations });
        let mut context = StepContext {
            parts,
            masses: scene.masses(),
            state: &mut self.state,
            forces: &mut self.forces,
            pins: self.pins.as_ref(),
            targets: &mut self.targets,
            catch_up: self.limit.catch_up(settings, scene.mean_edge(), choice.dt),
            tracks: &self.tracks,
            filters: &mut self.filters,
            collision: self.collision.as_mut(),
            wind: &self.wind,
            volumes: &mut self.volumes,
            self_contact: self.self_contact.as_mut(),
            bodies: &mut self.bodies,
            reaches_ghosts: &self.reaches_ghosts,
            scratch: &mut self.scratch,
            stop,
            integrator: settings.integrator,
            body_friction: settings.body_friction,
            held: self.care.held().or(scene.inert()),
            metrics: &mut self.metrics,
        };
        let report = advance(&mut context, choice.dt);
        self.care.note_step(choice.dt);
        self.limit.forget_rate();
        if let Some(stage) = report.not_finite {
            return Ok(Some(Trouble::NotFinite(stage)));
        }
        summary.steps += 1;
        summary.cg_iterations += report.cg_iterations as u64;
        summary.dt_min = summary.dt_min.min(choice.dt);
        summary.dt_max = summary.dt_max.max(choice.dt);
        if choice.ends_interval {
            // The time of a frame comes from integers, not from a sum of steps.
            self.state.time = end;
        }
        Ok(report.diverged.then_some(Trouble::Diverged))
    }
}
