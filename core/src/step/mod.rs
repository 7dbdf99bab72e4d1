//! One time step, line by line as in the paper (`docs/theory/step.md`).
//!
//! ```text
//! A    self-contact: remember the collision-free state, find pairs near it and their sides      (every K steps)
//! B.1  v½  =  v + dt/2 · a(x, v½)                        backward Euler on damping
//! B.2  v½  ←  self-repulsion, strain limit
//! B.3  x'  =  x + dt · v½,  v* = v
//! B.4  x', v*  ←  body collision, pins
//! B.5  v½  =  v* + dt/2 · a((x + x')/2, v½)              contact normals constrained, then the projection is undone
//! B.6  v'  =  2 v½ − v*
//! B.7  v'  ←  body friction with the full load
//! B.8  v'  ←  self-repulsion without springs, B.7 for what it lays on bodies, strain limit
//! C    resolve what collides between the remembered positions and x'                            (every K steps)
//! ```
//!
//! [`Step::LISTING`] has a line for each of B.1 to B.8. Long steps have a listing of their own, [`Step::TR_BDF2_LISTING`]
//! (`docs/theory/tr_bdf2.md`). A and C are around the steps, in `crate::simulation`.

mod groups;
mod implicit;
mod semi_implicit;
mod solve_arrays;
mod tr_bdf2;

pub(crate) use implicit::StageArrays;

pub(crate) use groups::{Cloth, CollisionEnd, Contacts, Dynamics, Prescribed, Scratch, VelocityNeeds};

use crate::Vec3;
use crate::contact::bodies::collision::CollisionStep;
use crate::contact::bodies::recovery_speed::RecoverySpeed;
use crate::effects::force::{FilterStep, Purpose};
use crate::metrics::Metrics;
use crate::observe::{Observer, Place};
use crate::parallel::for_each_part::PerVertex;
use crate::parallel::parts::Parts;
use crate::pins::BEHIND as PINS_BEHIND;
use crate::scene::{Integrator, Scene};
use crate::solve::conjugate_gradient::{Outcome, Stop};

/// A step: what it works with, and how.
pub(crate) struct Step<'a> {
    /// The split of the vertices.
    pub parts: &'a Parts,
    /// Masses of the local vertices [kg].
    pub masses: &'a [f64],
    /// The cloth, which it moves.
    pub cloth: &'a mut Cloth,
    /// Forces and velocity filters that act on the cloth.
    pub dynamics: &'a mut Dynamics,
    /// Whose motion is given.
    pub prescribed: &'a mut Prescribed,
    /// Contacts of the cloth.
    pub contacts: &'a mut Contacts,
    /// Seconds and counts.
    pub metrics: &'a mut Metrics,
    /// Observer that looks at the cloth after lines, in the scene that they belong to; `None` if nobody does.
    pub observer: Option<(&'a mut Observer, &'a Scene)>,
    /// Settings of the step.
    pub settings: StepSettings<'a>,
    /// Report of the step so far.
    pub report: StepReport,
}

/// Settings of a step.
#[derive(Debug, Clone, Copy)]
pub(crate) struct StepSettings<'a> {
    /// Its length [s].
    pub dt: f64,
    /// Limit on the correction of vertices that are behind their pins or too deep in bodies.
    pub recovery_speed: RecoverySpeed,
    /// Mean edge of the cloth [m].
    pub mean_edge: f64,
    /// Stopping criterion of the solves.
    pub stop: Stop,
    /// Own vertices that stay where they are, ascending, if any rank has such.
    pub held: Option<&'a [u32]>,
    /// The integrator of the scene.
    pub integrator: Integrator,
    /// True if a step that has diverged or has not settled is taken back, so that its rest need not be made.
    pub retries: bool,
}

/// Report of a step.
#[derive(Debug, Clone, Default)]
pub(crate) struct StepReport {
    /// Iterations of all solves.
    pub cg_iterations: usize,
    /// Line at which a number stopped being finite; the rest of the step was not made.
    pub not_finite: Option<&'static str>,
    /// Solves that ended above their tolerance.
    pub short_solves: u64,
    /// Whether a solve ended much farther from its solution than it began.
    pub diverged: bool,
    /// Whether Newton's method left the distance of some pair of cloth unsettled.
    pub unsettled: bool,
    /// Own vertices at which solves or pairs are to blame for that, by their numbers in the scene.
    pub concerned: Vec<u32>,
}

/// A line of the listing: its label in the paper, and what it does to a step.
pub(crate) type Line<'a> = (&'static str, fn(&mut Step<'a>));

/// Vertices that B.7 concerns.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum ContactSubset {
    ByAnything,
    /// Only vertices that B.8 has pressed against bodies.
    ByRepulsion,
}

impl StepReport {
    /// Counts a solve. `unsolved` are the own vertices above its tolerance, asked for where it has not come to that.
    fn add(
        &mut self,
        outcome: Outcome,
        line: &'static str,
        (parts, metrics): (&Parts, &mut Metrics),
        unsolved: impl FnOnce() -> Vec<u32>,
    ) {
        self.cg_iterations += outcome.iterations;
        metrics.count_once(parts.ranks(), "cg_solves", outcome.solves as u64);
        metrics.count_once(parts.ranks(), "cg_iterations", outcome.iterations as u64);
        if !outcome.converged {
            self.short_solves += 1;
            self.concerned.extend(unsolved());
        }
        self.diverged |= outcome.worse;
        if !outcome.finite {
            self.not_finite = self.not_finite.or(Some(line));
        }
    }
}

impl<'a> Step<'a> {
    /// The lines of a step with this integrator.
    pub(crate) fn listing(integrator: Integrator) -> &'a [Line<'a>] {
        match integrator {
            Integrator::TrBdf2 => &Self::TR_BDF2_LISTING,
            Integrator::SemiImplicit => &Self::LISTING,
            Integrator::Auto => unreachable!("a simulation chooses its integrator when it is made"),
        }
    }

    /// Makes the step: the state goes on by its length.
    pub(crate) fn advance(mut self) -> StepReport {
        self.prescribe();
        for (at, (_, line)) in Self::listing(self.settings.integrator).iter().enumerate() {
            line(&mut self);
            if self.observer.is_some() {
                self.show(at);
            }
            let is_taken_back = self.settings.retries && (self.report.unsettled || self.report.diverged);
            if self.report.not_finite.is_some() || is_taken_back {
                break;
            }
        }
        self.report
    }

    /// Shows what there is after a line, the last of its label.
    fn show(&mut self, at: usize) {
        let lines = Self::listing(self.settings.integrator);
        let line = lines[at].0;
        let continues = lines.get(at + 1).is_some_and(|(next, _)| *next == line);
        let Some((observer, scene)) = &mut self.observer else { return };
        if !continues {
            let place = Place { line, time: self.cloth.state.time, dt: self.settings.dt };
            observer.after(place, scene, &self.cloth.quantities(line));
        }
    }

    /// Puts bodies and pin targets at both ends of the step, and stops what is held.
    fn prescribe(&mut self) {
        let Self { parts, masses, cloth, dynamics, prescribed, contacts, metrics, settings, .. } = self;
        let (x, v, time) = (&cloth.state.x, &mut cloth.state.v, cloth.state.time);
        let Prescribed { bodies, tracks, pins, targets, mobility } = &mut **prescribed;
        if !(bodies.count() == 0 && pins.is_none() && targets.is_empty()) {
            metrics.stage("bodies and pins", |_| {
                bodies.set_step(time, time + settings.dt);
                targets.set_step(bodies, tracks, x, (time, time + settings.dt));
                let Some(pins) = pins else { return };
                if let Some(collision) = &mut contacts.bodies {
                    collision.set_held(pins.fully_held().map(|(vertex, target)| (vertex, targets.is_active(target))));
                }
                mobility.set_step(masses, pins, targets);
                if let Some(contact) = &mut contacts.cloth {
                    contact.set_mobility(pins.vertices(), mobility.of_vertices());
                }
                if !dynamics.filters.is_empty() {
                    mobility.update_ghosts(parts);
                }
            });
        }
        if let Some(held) = settings.held {
            held.iter().for_each(|vertex| v[*vertex as usize] = Vec3::zeros());
            parts.halo().update(parts.ranks(), v);
        }
    }

    /// B.2: self-repulsion.
    fn repel_half_velocity(&mut self) {
        let Self { parts, cloth, prescribed, contacts, metrics, settings, .. } = self;
        let (x, v_half) = (&cloth.state.x, &mut cloth.scratch.v_half);
        if let Some(contact) = contacts.cloth.as_mut().filter(|contact| contact.repels()) {
            metrics.stage("B.2 self-repulsion", |m| contact.half_velocity(settings.dt, x, v_half, m));
            prescribed.apply_prescribed(parts, v_half);
        }
    }

    /// B.2, after self-repulsion: the end positions keep the limit.
    fn limit_half_strain(&mut self) {
        let Self { parts, cloth, dynamics, prescribed, metrics, settings, .. } = self;
        let (mobility, purpose) = (prescribed.mobility.of_vertices(), Purpose::Positions);
        let step = FilterStep { parts, mobility, x: &cloth.state.x, dt: settings.dt, purpose };
        for filter in &mut dynamics.filters {
            metrics.stage(filter.stages()[0], |m| filter.apply(&step, &mut cloth.scratch.v_half, m));
        }
    }

    /// B.3: x' from x and v½, and v* = v.
    fn positions(&mut self) {
        let Self { cloth, metrics, settings, .. } = self;
        metrics.stage("B.3 positions", |_| cloth.scratch.set_positions(&cloth.state, settings.dt));
    }

    /// B.4: x' and v* outside the bodies, and x' where pins prescribe it.
    fn collide_with_bodies(&mut self) {
        let Self { parts, cloth, prescribed, contacts, metrics, settings, .. } = self;
        let (state, Scratch { v_half, v_star, x_new, .. }) = (&cloth.state, &mut cloth.scratch);
        let Prescribed { bodies, pins, targets, .. } = &**prescribed;
        let recovery_speed = settings.recovery_speed;
        if let Some(collision) = &mut contacts.bodies {
            metrics.stage("B.4 body collision", |m| {
                let own = parts.own();
                let (x, v, v_half) = (&state.x[own.clone()], &state.v[own.clone()], &v_half[own.clone()]);
                let (dt, pinched_in_solves) = (settings.dt, settings.integrator.spec().pinched_in_solves);
                let step = CollisionStep { bodies, dt, recovery_speed, x, v, v_half, pinched_in_solves };
                collision.positions(&step, &mut x_new[own.clone()], &mut v_star[own], m);
            });
        }
        if let Some(pins) = pins {
            metrics.count(PINS_BEHIND, pins.behind(targets, recovery_speed, &state.x));
            parts.for_each(PerVertex(&mut x_new[parts.own()]), &|part, x_new| {
                let range = parts.ranges()[part].clone();
                pins.set_positions(part, range.start, targets, recovery_speed, (&state.x[range], x_new.0));
            });
        }
        parts.halo().update(parts.ranks(), x_new);
    }

    /// B.7, and the prescribed velocities.
    fn rub_on_bodies(&mut self) {
        self.rub(ContactSubset::ByAnything);
    }

    /// B.8: self-repulsion without springs, and B.7 for the vertices that it has pressed against bodies.
    fn repel_final_velocity(&mut self) {
        let Self { cloth, contacts, metrics, settings, .. } = self;
        let Contacts { bodies, cloth: contact } = &mut **contacts;
        if let Some(contact) = contact.as_mut().filter(|contact| contact.repels()) {
            let state = &mut cloth.state;
            metrics.stage("B.8 self-repulsion", |m| {
                contact.final_velocity(settings.dt, &state.x, &mut state.v, bodies.as_ref(), m);
            });
            self.rub(ContactSubset::ByRepulsion);
        }
    }

    /// B.8, after self-repulsion: edges at their limit do not go on stretching.
    fn limit_final_strain(&mut self) {
        let Self { parts, cloth, dynamics, prescribed, metrics, settings, .. } = self;
        let (mobility, purpose) = (prescribed.mobility.of_vertices(), Purpose::Motion);
        let step = FilterStep { parts, mobility, x: &cloth.state.x, dt: settings.dt, purpose };
        for filter in &mut dynamics.filters {
            metrics.stage(filter.stages()[1], |m| filter.apply(&step, &mut cloth.state.v, m));
        }
    }

    /// The state at the end of the step, ghosts included.
    fn end(&mut self) {
        let state = &mut self.cloth.state;
        self.parts.halo().update(self.parts.ranks(), &mut state.v);
        state.time += self.settings.dt;
    }

    /// Friction with bodies, with the full load, of all vertices or of those that repulsion has pressed against bodies.
    fn rub(&mut self, which: ContactSubset) {
        let Self { parts, cloth, prescribed, contacts, metrics, settings, .. } = self;
        let (x, v) = (&cloth.state.x, &mut cloth.state.v);
        // Friction may not spend itself on a direction in which a pin holds the vertex anyway.
        prescribed.apply_prescribed(parts, v);
        if let Some(collision) = &contacts.bodies {
            let contact = contacts.cloth.as_ref().filter(|_| which == ContactSubset::ByRepulsion);
            let concerns = |vertex| contact.is_none_or(|contact| contact.is_pressed(vertex));
            metrics.stage("B.7 body friction", |_| {
                let moving = (&x[parts.own()], &mut v[parts.own()]);
                collision.final_velocity((&prescribed.bodies, settings.dt), &concerns, moving);
            });
            prescribed.apply_prescribed(parts, v);
        }
    }
}
