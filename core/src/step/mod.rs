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
//! [`Step::LISTING`] has a line for each of B.1 to B.8; A and C are around the steps, in `crate::simulation`.

mod groups;
mod prescription;
mod stage_arrays;
mod tr_bdf2;
mod unconverged;

pub use stage_arrays::StageArrays;

pub use groups::{Cloth, CollisionEnd, Contacts, Dynamics, Prescribed, Scratch};

use crate::Vec3;
use crate::clock::Watch;
use crate::contact::bodies::collision::{BodyCollision, CollisionStep};
use crate::contact::bodies::recovery_speed::RecoverySpeed;
use crate::effects::force::{FilterStep, ForceContext, Purpose};
use crate::metrics::Metrics;
use crate::observe::{Observer, Place};
use crate::parallel::for_each_part::PerVertex;
use crate::parallel::parts::Parts;
use crate::pins::BEHIND as PINS_BEHIND;
use crate::scene::{Integrator, RepulsionPlace, Scene};
use crate::solve::conjugate_gradient::{Outcome, Stop};
use crate::solve::implicit_velocity::VelocityProblem;
use crate::volumes::Volumes;
use crate::wind_grid::WindGrid;

/// A step: what it works with, and how.
pub struct Step<'a> {
    /// The split of the vertices.
    pub parts: &'a Parts,
    /// Masses of the local vertices [kg].
    pub masses: &'a [f64],
    /// The cloth, which it moves.
    pub cloth: &'a mut Cloth,
    /// What acts on it.
    pub dynamics: &'a mut Dynamics,
    /// Whose motion is given.
    pub prescribed: &'a mut Prescribed,
    /// What the cloth touches.
    pub contacts: &'a mut Contacts,
    /// Seconds and counts.
    pub metrics: &'a mut Metrics,
    /// Who looks at the cloth after lines, in the scene that they belong to; `None` if nobody does.
    pub observer: Option<(&'a mut Observer, &'a Scene)>,
    /// How it is made.
    pub settings: StepSettings<'a>,
    /// What it has come to so far.
    pub report: StepReport,
}

/// How a step is made.
#[derive(Debug, Clone, Copy)]
pub struct StepSettings<'a> {
    /// Its length [s].
    pub dt: f64,
    /// How far vertices that are behind their pins, or too deep in bodies, are put right.
    pub recovery_speed: RecoverySpeed,
    /// Mean edge of the cloth [m].
    pub mean_edge: f64,
    /// When the damping solves stop.
    pub stop: Stop,
    /// Own vertices that stay where they are, ascending, if any rank has such.
    pub held: Option<&'a [u32]>,
    /// Whether it is made again after something went wrong.
    pub is_retry: bool,
    /// How elastic forces enter both solves.
    pub integrator: Integrator,
}

/// What a step reports.
#[derive(Debug, Clone, Default)]
pub struct StepReport {
    /// Iterations of both solves.
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
pub type Line<'a> = (&'static str, fn(&mut Step<'a>));

/// Which vertices B.7 concerns.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum ContactSubset {
    ByAnything,
    /// Those alone that B.8 has pressed against bodies.
    ByRepulsion,
}

/// What both solves of a step have in common.
#[derive(Clone, Copy)]
struct Solves<'a> {
    parts: &'a Parts,
    masses: &'a [f64],
    settings: StepSettings<'a>,
    /// Start of the step [s].
    time: f64,
}

/// When and where forces are evaluated in a solve, and what they see there.
struct Evaluation<'a> {
    /// As a fraction of the step.
    fraction: f64,
    /// Positions and velocities of the local vertices [m], [m/s].
    x: &'a [Vec3],
    v: &'a [Vec3],
    prescribed: &'a Prescribed,
    volumes: &'a Volumes,
    wind: &'a WindGrid,
    reaches_ghosts: &'a [bool],
    contacts: Option<&'a BodyCollision>,
}

impl<'a> Solves<'a> {
    fn at<'b>(&self, at: Evaluation<'b>) -> VelocityProblem<'b>
    where
        'a: 'b,
    {
        let Evaluation { fraction, x, v, prescribed, volumes, wind, reaches_ghosts, contacts } = at;
        let StepSettings { dt, stop, held, .. } = self.settings;
        VelocityProblem {
            parts: self.parts,
            masses: self.masses,
            around: ForceContext { time: self.time + fraction * dt, targets: &prescribed.targets, v, wind, volumes },
            pins: prescribed.pins.as_ref(),
            contacts,
            half_step: 0.5 * dt,
            x,
            fraction,
            reaches_ghosts,
            stop,
            held: held.unwrap_or_default(),
        }
    }
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
    /// The step as in the paper: a line, and what it does.
    pub const LISTING: [Line<'a>; 11] = [
        ("B.1", Self::half_velocity),
        ("B.2", Self::repel_half_velocity),
        ("B.2", Self::limit_half_strain),
        ("B.3", Self::positions),
        ("B.4", Self::collide_with_bodies),
        ("B.5", Self::middle_velocity),
        ("B.6", Self::extrapolate),
        ("B.7", Self::rub_on_bodies),
        ("B.8", Self::repel_final_velocity),
        ("B.8", Self::limit_final_strain),
        ("end", Self::end),
    ];

    /// The implicit step, TR-BDF2: B.1 has both of its stages, and B.5 the second one again.
    pub const IMPLICIT_LISTING: [Line<'a>; 12] = [
        ("B.1", Self::implicit_half_velocity),
        ("B.2", Self::repel_half_velocity),
        ("B.2", Self::limit_half_strain),
        ("B.3", Self::positions),
        ("B.4", Self::collide_with_bodies),
        ("B.5", Self::implicit_end_velocity),
        ("B.6", Self::take_end),
        ("B.7", Self::rub_on_bodies),
        ("B.8", Self::repel_final_velocity),
        ("B.8", Self::limit_final_strain),
        ("end", Self::keep_acceleration),
        ("end", Self::end),
    ];

    /// The lines of a step with this integrator.
    pub fn listing(integrator: Integrator) -> &'a [Line<'a>] {
        match integrator {
            Integrator::TrBdf2 => &Self::IMPLICIT_LISTING,
            Integrator::SemiImplicit => &Self::LISTING,
        }
    }

    /// Makes the step: the state goes on by its length.
    pub fn advance(mut self) -> StepReport {
        self.prescribe();
        for (at, (_, line)) in Self::listing(self.settings.integrator).iter().enumerate() {
            line(&mut self);
            if self.observer.is_some() {
                self.show(at);
            }
            if self.report.not_finite.is_some() {
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

    fn solves(&self) -> Solves<'a> {
        Solves { parts: self.parts, masses: self.masses, settings: self.settings, time: self.cloth.state.time }
    }

    /// Puts bodies and pin targets at both ends of the step, and stops what is held.
    fn prescribe(&mut self) {
        let Self { parts, masses, cloth, dynamics, prescribed, contacts, metrics, settings, .. } = self;
        let (x, v, time) = (&cloth.state.x, &mut cloth.state.v, cloth.state.time);
        let Prescribed { bodies, tracks, pins, targets, mobility } = &mut **prescribed;
        if !(bodies.list().is_empty() && pins.is_none() && targets.is_empty()) {
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

    /// B.1: v½ from x and v.
    fn half_velocity(&mut self) {
        let solves = self.solves();
        let Self { parts, cloth, dynamics, prescribed, metrics, report, .. } = self;
        let (state, Scratch { v_half, explicit, cg, .. }) = (&cloth.state, &mut cloth.scratch);
        let Dynamics { forces, volumes, wind, reaches_ghosts, .. } = &mut **dynamics;
        metrics.stage("B.1 velocity", |m| {
            volumes.update(parts, &state.x);
            let (x, v) = (&state.x[..], &state.v[..]);
            let at = Evaluation { fraction: 0.0, x, v, prescribed, volumes, wind, reaches_ghosts, contacts: None };
            let problem = solves.at(at);
            let outcome = problem.solve(forces, cg, &state.v, explicit, v_half);
            report.add(outcome, "B.1", (parts, m), || cg.unsolved(parts, solves.settings.stop));
        });
    }

    /// B.2: self-repulsion.
    fn repel_half_velocity(&mut self) {
        let Self { parts, cloth, prescribed, contacts, metrics, settings, .. } = self;
        let (x, v_half) = (&cloth.state.x, &mut cloth.scratch.v_half);
        if let Some(contact) = contacts.cloth.as_mut().filter(|contact| contact.repels_in(RepulsionPlace::Impulses)) {
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
                let step = CollisionStep { bodies, dt: settings.dt, recovery_speed, x, v, v_half };
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

    /// B.5: v½ from v* and the forces at the middle.
    fn middle_velocity(&mut self) {
        let solves = self.solves();
        let Self { parts, cloth, dynamics, prescribed, contacts, metrics, report, .. } = self;
        let (state, scratch) = (&mut cloth.state, &mut cloth.scratch);
        let Dynamics { forces, volumes, wind, reaches_ghosts, .. } = &mut **dynamics;
        metrics.stage("B.5 velocity", |m| {
            scratch.set_middle(state);
            volumes.update(parts, &scratch.x_middle);
            scratch.predict_velocity(parts, &state.v);
            let Scratch { v_half, v_star, x_middle, explicit, v_seen, cg, .. } = scratch;
            let v_start: &[Vec3] = if v_star.is_empty() { &state.v } else { v_star };
            let (contacts, x) = (contacts.bodies.as_ref(), &x_middle[..]);
            let at = Evaluation { fraction: 0.5, x, v: v_seen, prescribed, volumes, wind, reaches_ghosts, contacts };
            let problem = solves.at(at);
            let outcome = problem.solve(forces, cg, v_start, explicit, v_half);
            report.add(outcome, "B.5", (parts, m), || cg.unsolved(parts, solves.settings.stop));
            if let Some(contacts) = contacts {
                // v is not needed any more: B.6 goes on from v*.
                problem.undo_projection(contacts, forces, explicit, v_half, &mut state.v);
                std::mem::swap(&mut state.v, v_half);
            }
        });
    }

    /// B.6: v' from v½ and v*; the state is at its end.
    fn extrapolate(&mut self) {
        let Cloth { state, scratch } = &mut *self.cloth;
        let watch = Watch::start();
        scratch.extrapolate(&mut state.v);
        std::mem::swap(&mut state.x, &mut scratch.x_new);
        // One call of the stage that B.5 has begun.
        self.metrics.add_time("B.5 velocity".into(), watch.seconds(), 0);
    }

    /// B.7, and the prescribed velocities.
    fn rub_on_bodies(&mut self) {
        self.rub(ContactSubset::ByAnything);
    }

    /// B.8: self-repulsion without springs, and B.7 for the vertices that it has pressed against bodies.
    fn repel_final_velocity(&mut self) {
        let Self { cloth, contacts, metrics, settings, .. } = self;
        let Contacts { bodies, cloth: contact } = &mut **contacts;
        if let Some(contact) = contact.as_mut().filter(|contact| contact.repels_in(RepulsionPlace::Impulses)) {
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
