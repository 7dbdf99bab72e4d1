//! One time step, line by line as in the paper (`docs/theory/step.md`).
//!
//! ```text
//! A    self-contact: remember the collision-free state, find pairs near it and their sides      (every K steps)
//! B.1  v½  =  v + dt/2 · a(x, v½)                        backward Euler on damping
//! B.2  v½  ←  self-repulsion, strain limit
//! B.3  x'  =  x + dt · v½
//! B.4  x', v*  ←  body collision
//! B.5  v½  =  v* + dt/2 · a((x + x')/2, v½)              contact normals constrained, then the projection is undone
//! B.6  v'  =  2 v½ − v*
//! B.7  v'  ←  body friction with the full load
//! B.8  v'  ←  self-repulsion without springs, B.7 for what it lays on bodies, strain limit
//! C    resolve what collides between the remembered positions and x'                            (every K steps)
//! ```
//!
//! A and C are around the steps: `crate::simulation` calls them.

use rayon::prelude::*;

use crate::Vec3;
use crate::contact::bodies::collision::{BodyCollision, CollisionStep};
use crate::contact::bodies::recovery_speed::CatchUp;
use crate::contact::bodies::{Bodies, Samples};
use crate::contact::self_contact::SelfContact;
use crate::effects::force::Surroundings;
use crate::effects::force::{Purpose, VelocityFilter};
use crate::metrics::Metrics;
use crate::parallel::for_each_part::PerVertex;
use crate::parallel::parts::Parts;
use crate::pins::{BEHIND as PINS_BEHIND, HardPins, PinTargets};
use crate::scene::{BodyFriction, Integrator};
use crate::solve::conjugate_gradient::{ConjugateGradient, Outcome, Stop};
use crate::solve::implicit_velocity::{PartForces, VelocityProblem};
use crate::state::State;
use crate::volumes::Volumes;
use crate::wind_grid::WindGrid;

/// Vertices that one task of a plain vector update works on.
const CHUNK: usize = 4096;

/// Arrays that a step writes and the next one overwrites; never saved.
#[derive(Debug)]
pub struct Scratch {
    v_half: Vec<Vec3>,
    v_star: Vec<Vec3>,
    x_new: Vec<Vec3>,
    x_middle: Vec<Vec3>,
    explicit: Vec<Vec3>,
    /// Velocities that forces see in B.5; empty if none looks.
    v_seen: Vec<Vec3>,
    cg: ConjugateGradient,
}

impl Scratch {
    /// Arrays for the local vertices; `with_v_star` adds what only contact between B.3 and B.5 needs, `with_v_seen` what forces
    /// need that look at velocities.
    pub fn new(parts: &Parts, with_v_star: bool, with_v_seen: bool) -> Self {
        let vertices = vec![Vec3::zeros(); parts.local_count()];
        let only_if = |needed: bool| if needed { vertices.clone() } else { Vec::new() };
        let (v_star, v_seen) = (only_if(with_v_star), only_if(with_v_seen));
        Self {
            v_half: vertices.clone(),
            v_star,
            x_new: vertices.clone(),
            x_middle: vertices.clone(),
            explicit: vertices,
            v_seen,
            cg: ConjugateGradient::new(parts),
        }
    }

    /// Own vertices at which a step that has gone wrong left numbers that are not finite, ascending: those that forces or the
    /// state itself spoil, or, if there are none, those that the solve has spread it to.
    pub(crate) fn not_finite(&self, own: std::ops::Range<usize>, state: &State) -> Vec<usize> {
        let is_finite = |v: &Vec3| v.iter().all(|c| c.is_finite());
        let spoilt = |i: &usize| ![&self.explicit[*i], &state.x[*i], &state.v[*i]].into_iter().all(is_finite);
        let found: Vec<usize> = own.clone().filter(spoilt).collect();
        if found.is_empty() { own.filter(|i| !is_finite(&self.v_half[*i])).collect() } else { found }
    }

    /// Memory held [bytes].
    pub fn bytes(&self) -> usize {
        (4 * self.x_new.len() + self.v_star.len() + self.v_seen.len()) * size_of::<Vec3>() + self.cg.bytes()
    }
}

/// Everything that a step works with.
pub struct StepContext<'a> {
    /// The split of the vertices.
    pub parts: &'a Parts,
    /// Masses of the local vertices [kg].
    pub masses: &'a [f64],
    /// Positions and velocities, changed by the step; ghosts are those of their owners before and after.
    pub state: &'a mut State,
    /// Forces of every part.
    pub forces: &'a mut PartForces,
    /// Hard pins, if the scene has any.
    pub pins: Option<&'a HardPins>,
    /// Where pinned vertices have to be.
    pub targets: &'a mut PinTargets,
    /// How far vertices that are behind their pins, or too deep in bodies, are put right.
    pub catch_up: CatchUp,
    /// Animated positions that pins follow.
    pub tracks: &'a [Samples],
    /// What else changes velocities.
    pub filters: &'a mut [Box<dyn VelocityFilter>],
    /// Body collision, if the scene has bodies.
    pub collision: Option<&'a mut BodyCollision>,
    /// The wind of a file.
    pub wind: &'a WindGrid,
    /// Volumes that forces look at.
    pub volumes: &'a mut Volumes,
    /// Self-contact, if the scene asks for it.
    pub self_contact: Option<&'a mut SelfContact>,
    /// The bodies.
    pub bodies: &'a mut Bodies,
    /// Which own parts need vertices of other ranks.
    pub reaches_ghosts: &'a [bool],
    /// Scratch arrays.
    pub scratch: &'a mut Scratch,
    /// When the damping solves stop.
    pub stop: Stop,
    /// How elastic forces enter both solves.
    pub integrator: Integrator,
    /// Where in the step friction with bodies acts.
    pub body_friction: BodyFriction,
    /// Own vertices that stay where they are in this step, ascending, if any rank has such.
    pub held: Option<&'a [u32]>,
    /// Seconds and counts.
    pub metrics: &'a mut Metrics,
}

/// When and where forces are evaluated in a solve, and what they see there.
struct Moment<'a> {
    /// As a fraction of the step.
    fraction: f64,
    /// Positions and velocities of the local vertices [m], [m/s].
    x: &'a [Vec3],
    v: &'a [Vec3],
    targets: &'a PinTargets,
    volumes: &'a Volumes,
    contacts: Option<&'a BodyCollision>,
}

/// Which vertices B.7 concerns.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Pressed {
    ByAnything,
    /// Those alone that B.8 has pressed against bodies.
    ByRepulsion,
}

/// What a step reports.
#[derive(Debug, Clone, Copy, Default)]
pub struct StepReport {
    /// Iterations of both solves.
    pub cg_iterations: usize,
    /// Stage at which a number stopped being finite; the rest of the step was not made.
    pub not_finite: Option<&'static str>,
    /// Whether a solve ended much farther from its solution than it began.
    pub diverged: bool,
}

/// Advances the state by `dt` [s].
pub fn advance(context: &mut StepContext<'_>, dt: f64) -> StepReport {
    let mut report = StepReport::default();
    let time = context.state.time;
    context.move_prescribed(time, time + dt);
    context.stop_held();
    context.first_half(dt, &mut report); // B.1
    if report.not_finite.is_some() {
        return report;
    }
    context.repel_half_velocities(dt); // B.2
    context.filter_half_velocities(dt); // B.2, after it
    context.end_positions(dt); // B.3, B.4
    context.collide_after_position(dt); // C, in the order of the authors' later code
    context.second_half(dt, &mut report); // B.5, B.6
    if report.not_finite.is_some() {
        return report;
    }
    context.final_velocities(dt, Pressed::ByAnything); // B.7
    context.repel_final_velocities(dt); // B.8
    context.filter_final_velocities(dt); // B.8, after it
    context.parts.halo().refresh(context.parts.ranks(), &mut context.state.v);
    context.state.time = time + dt;
    report
}

impl<'a> StepContext<'a> {
    /// Puts bodies and pin targets at both ends of the step.
    fn move_prescribed(&mut self, t0: f64, t1: f64) {
        let Self {
            parts, bodies, targets, tracks, filters, collision, self_contact, pins, masses, state, metrics, ..
        } = self;
        if bodies.list().is_empty() && pins.is_none() && targets.is_empty() {
            return;
        }
        metrics.stage("bodies and pins", |_| {
            bodies.set_step(t0, t1);
            targets.set_step(bodies, tracks, &state.x, (t0, t1));
            if let (Some(collision), Some(pins)) = (collision, pins.as_ref()) {
                collision.set_held(pins.fully_held().map(|(vertex, target)| (vertex, targets.is_active(target))));
            }
            if let Some(contact) = self_contact {
                contact.set_held(masses, *pins, targets);
            }
            if let Some(pins) = pins {
                filters.iter_mut().for_each(|filter| filter.set_held(parts, masses, pins, targets));
            }
        });
    }

    /// What is held loses its velocity.
    fn stop_held(&mut self) {
        if let Some(held) = self.held {
            held.iter().for_each(|vertex| self.state.v[*vertex as usize] = Vec3::zeros());
            self.parts.halo().refresh(self.parts.ranks(), &mut self.state.v);
        }
    }

    /// What both solves of a step of length `dt` [s] have in common; the rest is the moment.
    fn solves<'b>(&self, dt: f64) -> impl FnOnce(Moment<'b>) -> VelocityProblem<'b> + use<'a, 'b>
    where
        'a: 'b,
    {
        let &Self { parts, masses, pins, wind, reaches_ghosts, stop, held, .. } = self;
        let start = self.state.time;
        let implicit_over = match self.integrator {
            Integrator::SemiImplicit => None,
            Integrator::Implicit => Some(dt),
        };
        move |Moment { fraction, x, v, targets, volumes, contacts }| VelocityProblem {
            parts,
            masses,
            around: Surroundings { time: start + fraction * dt, targets, v, wind, volumes },
            pins,
            contacts,
            half_step: 0.5 * dt,
            x,
            fraction,
            reaches_ghosts,
            stop,
            implicit_over,
            held: held.unwrap_or_default(),
        }
    }

    /// B.1: v½ from x and v.
    fn first_half(&mut self, dt: f64, report: &mut StepReport) {
        let problem = self.solves(dt);
        let Self { parts, state, forces, targets, volumes, scratch, metrics, .. } = self;
        let Scratch { v_half, explicit, cg, .. } = &mut **scratch;
        metrics.stage("B.1 velocity", |m| {
            volumes.update(parts, &state.x);
            let problem = problem(Moment { fraction: 0.0, x: &state.x, v: &state.v, targets, volumes, contacts: None });
            let outcome = problem.solve(forces, cg, &state.v, explicit, v_half);
            note(outcome, "B.1", parts, m, report);
        });
    }

    /// B.2.
    fn repel_half_velocities(&mut self, dt: f64) {
        let Self { state, self_contact, scratch, metrics, .. } = self;
        if let Some(contact) = self_contact.as_mut().filter(|contact| contact.repels()) {
            metrics.stage("B.2 self-repulsion", |m| contact.half_velocity(dt, &state.x, &mut scratch.v_half, m));
            impose(self.parts, self.pins, self.targets, &mut self.scratch.v_half);
        }
    }

    /// B.2, after self-repulsion: the end positions keep the limit.
    fn filter_half_velocities(&mut self, dt: f64) {
        let Self { parts, state, filters, scratch, metrics, .. } = self;
        for filter in &mut **filters {
            let motion = (&state.x[..], &mut scratch.v_half[..]);
            metrics.stage(filter.stages()[0], |m| filter.apply(parts, motion, dt, Purpose::Positions, m));
        }
    }

    /// B.8, after self-repulsion: edges at their limit do not go on stretching.
    fn filter_final_velocities(&mut self, dt: f64) {
        let Self { parts, state, filters, metrics, .. } = self;
        for filter in &mut **filters {
            let motion = (&state.x[..], &mut state.v[..]);
            metrics.stage(filter.stages()[1], |m| filter.apply(parts, motion, dt, Purpose::Motion, m));
        }
    }

    /// B.8, and B.7 once more: bodies stop, and rub, what repulsion has laid on them.
    fn repel_final_velocities(&mut self, dt: f64) {
        let Self { state, self_contact, collision, metrics, .. } = self;
        if let Some(contact) = self_contact.as_mut().filter(|contact| contact.repels()) {
            let collision = collision.as_deref();
            metrics.stage("B.8 self-repulsion", |m| {
                contact.final_velocity(dt, &state.x, &mut state.v, collision, m);
            });
            self.final_velocities(dt, Pressed::ByRepulsion);
        }
    }

    /// C between B.4 and B.5: the positions are corrected before the second solve sees them.
    fn collide_after_position(&mut self, dt: f64) {
        let Self { parts, self_contact, collision, scratch, bodies, metrics, .. } = self;
        let Some(contact) = self_contact.as_mut().filter(|contact| contact.collides_after_position()) else { return };
        let Scratch { v_star, x_new, .. } = &mut **scratch;
        metrics.stage("C collisions", |m| {
            let mut moved = |vertex, way| {
                if let Some(collision) = collision {
                    collision.moved(vertex, way);
                }
            };
            if contact.repels_per_collision_step() {
                contact.repel_interval((&mut x_new[..], &mut v_star[..]), dt, m, &mut moved);
            }
            contact.end_interval((&mut x_new[..], &mut v_star[..]), bodies, dt, false, m, &mut moved);
            parts.halo().refresh(parts.ranks(), x_new);
            parts.halo().refresh(parts.ranks(), v_star);
        });
    }

    /// B.3 and B.4: x' and, with bodies, v*.
    fn end_positions(&mut self, dt: f64) {
        let Self { parts, state, pins, targets, catch_up, collision, bodies, scratch, metrics, .. } = self;
        let Scratch { v_half, v_star, x_new, .. } = &mut **scratch;
        if let Some(collision) = collision {
            metrics.stage("B.4 body collision", |m| {
                let own = parts.own();
                let (x, v, v_half) = (&state.x[own.clone()], &state.v[own.clone()], &v_half[own.clone()]);
                let step = CollisionStep { bodies, dt, catch_up: *catch_up, x, v, v_half };
                collision.positions(&step, &mut x_new[own.clone()], &mut v_star[own], m);
            });
        } else {
            metrics.stage("B.3 positions", |_| {
                v_star.iter_mut().zip(&state.v).for_each(|(v_star, v)| *v_star = *v);
                let chunks = x_new.par_chunks_mut(CHUNK).zip(state.x.par_chunks(CHUNK)).zip(v_half.par_chunks(CHUNK));
                chunks.for_each(|((x_new, x), v)| {
                    for ((x_new, x), v) in x_new.iter_mut().zip(x).zip(v) {
                        *x_new = x + v * dt;
                    }
                });
            });
        }
        if let Some(pins) = pins {
            metrics.count(PINS_BEHIND, pins.behind(targets, *catch_up, &state.x));
            parts.for_each(PerVertex(&mut x_new[parts.own()]), &|part, x_new| {
                let range = parts.ranges()[part].clone();
                pins.set_positions(part, range.start, targets, *catch_up, (&state.x[range], x_new.0));
            });
        }
        parts.halo().refresh(parts.ranks(), x_new);
    }

    /// B.5 and B.6: the velocity at the end, from the forces at the middle.
    fn second_half(&mut self, dt: f64, report: &mut StepReport) {
        let problem = self.solves(dt);
        let Self { parts, state, forces, targets, volumes, collision, scratch, metrics, .. } = self;
        let Scratch { v_half, v_star, x_new, x_middle, explicit, v_seen, cg } = &mut **scratch;
        metrics.stage("B.5 velocity", |m| {
            let chunks = x_middle.par_chunks_mut(CHUNK).zip(state.x.par_chunks(CHUNK)).zip(x_new.par_chunks(CHUNK));
            chunks.for_each(|((middle, x), x_new)| {
                for ((middle, x), x_new) in middle.iter_mut().zip(x).zip(x_new) {
                    *middle = (x + x_new) * 0.5;
                }
            });
            let contacts = collision.as_deref();
            let v_start: &[Vec3] = if v_star.is_empty() { &state.v } else { v_star };
            volumes.update(parts, x_middle);
            if !v_seen.is_empty() {
                foresee(v_seen, v_half, &state.v, v_star);
                parts.halo().refresh(parts.ranks(), v_seen);
            }
            let problem = problem(Moment { fraction: 0.5, x: x_middle, v: v_seen, targets, volumes, contacts });
            let outcome = problem.solve(forces, cg, v_start, explicit, v_half);
            note(outcome, "B.5", parts, m, report);
            if let Some(contacts) = contacts {
                problem.undo_projection(contacts, forces, explicit, v_half, &mut state.v);
                extrapolate(&mut state.v, None, v_star);
            } else if !v_star.is_empty() {
                extrapolate(&mut state.v, Some(v_half), v_star);
            } else {
                extrapolate_in_place(&mut state.v, v_half);
            }
        });
        std::mem::swap(&mut state.x, x_new);
    }

    /// B.7, and the prescribed velocities; of all vertices, or of those that repulsion has pressed against bodies.
    fn final_velocities(&mut self, dt: f64, which: Pressed) {
        // Friction may not spend itself on a direction in which a pin holds the vertex anyway.
        impose(self.parts, self.pins, self.targets, &mut self.state.v);
        let Self { state, collision, self_contact, bodies, body_friction, metrics, .. } = self;
        if let Some(collision) = collision {
            let own = self.parts.own();
            let rubs = *body_friction == BodyFriction::WholeStep;
            let contact = self_contact.as_deref().filter(|_| which == Pressed::ByRepulsion);
            let concerns = |vertex| contact.is_none_or(|contact| contact.is_pressed(vertex));
            metrics.stage("B.7 body friction", |_| {
                collision.final_velocity((bodies, dt, rubs), &concerns, &mut state.v[own]);
            });
            impose(self.parts, self.pins, self.targets, &mut self.state.v);
        }
    }
}

/// Gives pinned components their prescribed velocity.
fn impose(parts: &Parts, pins: Option<&HardPins>, targets: &PinTargets, v: &mut [Vec3]) {
    if let Some(pins) = pins {
        parts.for_each(PerVertex(&mut v[parts.own()]), &|part, v| {
            pins.set_velocities(part, parts.ranges()[part].start, targets, v.0);
        });
    }
}

/// Counts a solve.
fn note(outcome: Outcome, stage: &'static str, parts: &Parts, metrics: &mut Metrics, report: &mut StepReport) {
    report.cg_iterations += outcome.iterations;
    metrics.count_once(parts.ranks(), "cg_iterations", outcome.iterations as u64);
    metrics.count_once(parts.ranks(), "cg_short", u64::from(!outcome.converged));
    report.diverged |= outcome.worse;
    if !outcome.finite {
        report.not_finite = report.not_finite.or(Some(stage));
    }
}

/// The velocity at the middle as B.1 to B.4 foresee it: v½, and what bodies changed at the start.
fn foresee(v_seen: &mut [Vec3], v_half: &[Vec3], v: &[Vec3], v_star: &[Vec3]) {
    v_seen.copy_from_slice(v_half);
    v_seen.iter_mut().zip(v_star.iter().zip(v)).for_each(|(seen, (v_star, v))| *seen += v_star - v);
}

/// B.6: `v ← 2 v½ − v*`; v½ is what `v` holds if it is not given.
fn extrapolate(v: &mut [Vec3], v_half: Option<&[Vec3]>, v_star: &[Vec3]) {
    v.par_chunks_mut(CHUNK).zip(v_star.par_chunks(CHUNK)).enumerate().for_each(|(c, (v, v_star))| {
        let half = v_half.map(|h| &h[c * CHUNK..c * CHUNK + v.len()]);
        for i in 0..v.len() {
            v[i] = half.map_or(v[i], |h| h[i]) * 2.0 - v_star[i];
        }
    });
}

/// B.6 without bodies, where v* is v itself.
fn extrapolate_in_place(v: &mut [Vec3], v_half: &[Vec3]) {
    v.par_chunks_mut(CHUNK).zip(v_half.par_chunks(CHUNK)).for_each(|(v, half)| {
        for (v, half) in v.iter_mut().zip(half) {
            *v = half * 2.0 - *v;
        }
    });
}
