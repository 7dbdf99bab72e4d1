//! A scene with its state and effects, advanced frame by frame.

use std::sync::Arc;

use crate::Vec3;
use crate::bodies::{Bodies, Samples};
use crate::contact::self_contact::{Ending, SelfContact};
use crate::effects::body_collision::BodyCollision;
use crate::effects::pins::{HardPins, PinTargets};
use crate::effects::{Force, Need, PlannedEffect, Section, VelocityFilter, build_all};
use crate::error::{Problems, StepError};
use crate::geometry::crossings::Crossing;
use crate::metrics::Metrics;
use crate::parallel::ranks::Sent;
use crate::parallel::split::PerPart;
use crate::scene::{Scene, agree};
use crate::solve::conjugate_gradient::Stop;
use crate::solve::implicit_velocity::PartForces;
use crate::state::State;
use crate::step::{Scratch, StepContext, advance};
use crate::time_step::StepLimit;
use crate::tolerances::CG_GRAVITY_FRACTION;
use crate::volumes::Volumes;
use crate::wind_grid::{WindGrid, WindSample};

mod balance;
mod measure;
pub mod outside;
#[cfg(test)]
mod planted;
mod saved;
mod start;

pub use crate::bodies::Sample;
use balance::Balance;
pub use saved::RestoreError;
use start::{first_tracks, start_outside};

/// Acceleration that the automatic tolerance of the damping solves compares with [m/s²]; the earth's.
const STANDARD_GRAVITY: f64 = 9.81;

/// Largest tolerance of the damping solves when it is chosen automatically [m/s]; the authors' value.
const CG_TOLERANCE: f64 = 1e-2;

/// What the caller pushes for one frame.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct FrameInput {
    /// The frame to reach.
    pub frame: i64,
    /// For each body the samples after the last frame up to this one, ascending in time, the last exactly at this frame; empty
    /// for analytic shapes.
    pub bodies: Vec<Vec<Sample>>,
    /// For each track of pinned positions, likewise.
    pub tracks: Vec<Vec<Sample>>,
    /// The same for the grid of the wind; empty without one.
    pub wind: Vec<WindSample>,
}

impl FrameInput {
    /// Input of a scene without animated meshes.
    pub fn to_frame(frame: i64) -> Self {
        Self { frame, ..Self::default() }
    }
}

/// The most stretched edge of a frame.
#[derive(Debug, Clone, PartialEq)]
pub struct StrainRecord {
    /// Name of the garment.
    pub garment: String,
    /// Its vertices in the garment's own order.
    pub vertices: [u32; 2],
    /// Relative change of its length.
    pub strain: f64,
}

/// What happened in one frame.
#[derive(Debug, Clone, PartialEq)]
pub struct FrameSummary {
    /// The frame reached.
    pub frame: i64,
    /// Time steps.
    pub steps: u64,
    /// Shortest step [s].
    pub dt_min: f64,
    /// Longest step [s].
    pub dt_max: f64,
    /// Iterations of all damping solves.
    pub cg_iterations: u64,
    /// Seconds by stage, and counts.
    pub metrics: Metrics,
    /// The most stretched edge at the end of the frame.
    pub max_strain: Option<StrainRecord>,
    /// Kinetic energy at the end of the frame [J].
    pub kinetic_energy: f64,
    /// Potential energy at the end of the frame [J].
    pub potential_energy: f64,
    /// Pairs of body triangles that cross each other at the frame.
    pub body_self_crossings: u64,
}

impl FrameSummary {
    /// Nothing done yet on the way to a frame.
    pub fn empty(frame: i64) -> Self {
        Self {
            frame,
            steps: 0,
            dt_min: f64::INFINITY,
            dt_max: 0.0,
            cg_iterations: 0,
            metrics: Metrics::default(),
            max_strain: None,
            kinetic_energy: 0.0,
            potential_energy: 0.0,
            body_self_crossings: 0,
        }
    }

    /// Puts what was done before a pause in front of this.
    #[must_use]
    pub fn after(mut self, earlier: &Self) -> Self {
        self.steps += earlier.steps;
        self.dt_min = self.dt_min.min(earlier.dt_min);
        self.dt_max = self.dt_max.max(earlier.dt_max);
        self.cg_iterations += earlier.cg_iterations;
        let later = std::mem::replace(&mut self.metrics, earlier.metrics.clone());
        self.metrics.add(&later);
        self
    }
}

/// How far an advance came.
#[derive(Debug, Clone, PartialEq)]
pub enum Advance {
    /// The frame is reached.
    Done(FrameSummary),
    /// It was asked to pause between two frames, at a state free of collisions; this is what was done since the last frame or
    /// pause. Strain and energies are those of whole frames and not in it.
    Paused(FrameSummary),
}

/// A running simulation.
pub struct Simulation {
    scene: Arc<Scene>,
    state: State,
    frame: i64,
    forces: PartForces,
    pins: Option<HardPins>,
    targets: PinTargets,
    tracks: Vec<Samples>,
    filters: Vec<Box<dyn VelocityFilter>>,
    collision: Option<BodyCollision>,
    self_contact: Option<SelfContact>,
    bodies: Bodies,
    wind: WindGrid,
    volumes: Volumes,
    limit: StepLimit,
    /// Which own parts need vertices of other ranks.
    reaches_ghosts: Vec<bool>,
    /// Section with what has yielded in the cloth, where it can.
    yields: Option<Section>,
    scratch: Scratch,
    metrics: Metrics,
    plan: Vec<PlannedEffect>,
    /// Crossings of the state at the last frame.
    crossings: Vec<Crossing>,
    /// What this rank had sent at the last frame.
    sent: Sent,
    balance: Balance,
}

impl Simulation {
    /// Builds the effects that the scene asks for and puts everything at the start frame.
    ///
    /// `start` holds one sample per deforming body and track, at the start time.
    ///
    /// # Errors
    /// All problems of the effects' settings, of the first samples, and of vertices that start inside a body.
    pub fn new(scene: Scene, start: &FrameInput) -> Result<Self, Problems> {
        let mut simulation = Self::build(Arc::new(scene), start)?;
        if simulation.collision.is_some() {
            let Self { scene, state, bodies, pins, .. } = &simulation;
            start_outside(scene, state, bodies, pins.as_ref())?;
        }
        simulation.pins_take_hold();
        simulation.crossings = simulation.find_crossings();
        Ok(simulation)
    }

    /// The simulation with the cloth as the scene starts it, and bodies and tracks where `start` has them.
    fn build(scene: Arc<Scene>, start: &FrameInput) -> Result<Self, Problems> {
        let state = State::at_start(&scene);
        let bodies = Bodies::new(&scene, &start.bodies, state.time)?;
        let tracks = first_tracks(&scene, start)?;
        let wind = WindGrid::new(scene.description().wind, &start.wind).map_err(|problem| Problems(vec![problem]))?;
        Self::with(scene, state, bodies, (tracks, wind))
    }

    /// The simulation of a scene with these bodies, tracks and wind.
    fn with(
        scene: Arc<Scene>,
        state: State,
        bodies: Bodies,
        (tracks, wind): (Vec<Samples>, WindGrid),
    ) -> Result<Self, Problems> {
        let targets = PinTargets::new(&scene, &state.x, &bodies, &tracks, state.time);
        let parts = scene.parts();
        agree(parts.ranks(), targets.as_ref().err().cloned().into_iter().collect())?;
        let targets = targets.map_err(|p| Problems(vec![p]))?;
        let mut forces: PartForces = (0..parts.count()).map(|_| Vec::new()).collect();
        let (mut pins, mut collision, mut plan) = (None, None, Vec::new());
        let (mut volumes, mut filters) = (Volumes::default(), Vec::new());
        let (mut repulsion, mut self_collision, mut yields, mut sees_velocities) = (None, None, None, false);
        for (planned, effect) in build_all(&scene)? {
            for (part, force) in effect.forces {
                forces[part].push(force);
            }
            pins = pins.or(effect.pins);
            filters.extend(effect.filters);
            collision = collision.or(effect.body_collision);
            repulsion = repulsion.or(effect.self_repulsion);
            self_collision = self_collision.or(effect.self_collision);
            yields = yields.or(effect.yields);
            sees_velocities |= effect.sees_velocities;
            volumes.0.extend(effect.volume);
            plan.push(planned);
        }
        let (solver, frame) = (&scene.description().solver, scene.description().timeline.frame_duration());
        let limit = StepLimit::new(parts, scene.masses(), &forces, solver, frame);
        let is_ghost = |vertex: &u32| !parts.own().contains(&(*vertex as usize));
        let reaches = |forces: &Vec<Box<dyn Force>>| forces.iter().any(|f| f.neighbours().iter().any(is_ghost));
        let reaches_ghosts = forces.iter().map(reaches).collect();
        let needs_contact = repulsion.is_some() || self_collision.is_some();
        let self_contact = needs_contact.then(|| SelfContact::new(&scene, repulsion, self_collision));
        // The structures are shared: the first of the effects that need them carries their memory.
        let first = plan.iter_mut().find(|effect| effect.needs.contains(&Need::ClothSurface));
        if let (Some(effect), Some(contact)) = (first, &self_contact) {
            effect.bytes = contact.bytes();
        }
        for effect in &mut plan {
            let [elements, bytes] = parts.ranks().sum_of([effect.elements as u64, effect.bytes as u64]);
            (effect.elements, effect.bytes) = (elements as usize, bytes as usize);
        }
        let after_position = self_contact.as_ref().is_some_and(SelfContact::collides_after_position);
        let scratch = Scratch::new(parts, collision.is_some() || after_position, sees_velocities);
        let frame = scene.description().timeline.start;
        let metrics = Metrics::default();
        Ok(Self {
            scene,
            state,
            frame,
            forces,
            pins,
            targets,
            tracks,
            filters,
            collision,
            self_contact,
            bodies,
            wind,
            volumes,
            limit,
            reaches_ghosts,
            yields,
            scratch,
            metrics,
            plan,
            crossings: Vec::new(),
            sent: Sent::default(),
            balance: Balance::default(),
        })
    }

    /// Hard pins start where their targets are.
    fn pins_take_hold(&mut self) {
        if let Some(pins) = &self.pins {
            let time = self.state.time;
            self.targets.set_step(&self.bodies, &self.tracks, &self.state.x, (time, time));
            let parts = self.scene.parts();
            for (part, range) in parts.ranges().iter().enumerate() {
                pins.set_positions(part, range.start, &self.targets, &mut self.state.x[range.clone()]);
            }
            parts.halo().refresh(parts.ranks(), &mut self.state.x);
        }
    }

    /// Edges that cross triangles at the frame, by nodes: cloth in solver order, then the points of deforming bodies. Looked
    /// for in scenes with `self_collision` only.
    pub fn crossings(&self) -> &[Crossing] {
        &self.crossings
    }

    fn find_crossings(&mut self) -> Vec<Crossing> {
        let Some(contact) = self.self_contact.as_mut().filter(|contact| contact.keeps_free()) else {
            return Vec::new();
        };
        contact.check_everything(&self.state.x, &self.bodies).to_vec()
    }

    /// The scene, to be shared with another simulation.
    pub fn shared_scene(&self) -> Arc<Scene> {
        Arc::clone(&self.scene)
    }

    /// The scene.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// The frame that the state belongs to.
    pub fn frame(&self) -> i64 {
        self.frame
    }

    /// Positions and velocities of the local vertices, ghosts included.
    pub fn state(&self) -> &State {
        &self.state
    }

    /// The bodies, where they are at the time of the state.
    pub fn bodies(&self) -> &Bodies {
        &self.bodies
    }

    /// The effects that run, in order.
    pub fn plan(&self) -> &[PlannedEffect] {
        &self.plan
    }

    /// Memory of the state and the scratch arrays on this rank [bytes].
    pub fn bytes(&self) -> usize {
        2 * self.state.x.len() * size_of::<Vec3>() + self.scratch.bytes()
    }

    /// Largest step that the elastic forces allow [s].
    pub fn elastic_step(&self) -> f64 {
        self.limit.elastic
    }

    /// Goes on to the frame of `input`, the one after the current frame.
    ///
    /// # Errors
    /// Samples that do not cover the frame; a number that is no longer finite; a step below the scene's shortest.
    pub fn advance(&mut self, input: &FrameInput) -> Result<FrameSummary, StepError> {
        match self.advance_or_pause(input, &mut |_| false)? {
            Advance::Done(summary) | Advance::Paused(summary) => Ok(summary),
        }
    }

    /// Goes on to the frame of `input`; asks at every state free of collisions on the way, given its time [s], whether to pause
    /// there. After a pause the same input goes on, and comes to the same bits as without one.
    ///
    /// # Errors
    /// As [`Simulation::advance`].
    pub fn advance_or_pause(
        &mut self,
        input: &FrameInput,
        pause: &mut (dyn FnMut(f64) -> bool + Send),
    ) -> Result<Advance, StepError> {
        // Enters the pool once a frame: entering it for every loop would queue, wake and allocate each time.
        rayon::scope(|_| self.advance_in_pool(input, pause))
    }

    fn advance_in_pool(
        &mut self,
        input: &FrameInput,
        pause: &mut (dyn FnMut(f64) -> bool + Send),
    ) -> Result<Advance, StepError> {
        if input.frame != self.frame + 1 {
            return Err(self.input_error(input, format!("the next frame is {}, not {}", self.frame + 1, input.frame)));
        }
        let timeline = self.scene.description().timeline;
        let (from, to) = (timeline.time(self.frame), timeline.time(input.frame));
        let mut stops: Vec<f64> = input.bodies.iter().chain(&input.tracks).flatten().map(|s| s.time).collect();
        stops.extend(input.wind.iter().map(|sample| sample.time));
        stops.extend(self.targets.window_times());
        stops.retain(|t| *t > from && *t < to);
        stops.push(to);
        stops.sort_unstable_by(f64::total_cmp);
        stops.dedup();
        let mut summary = FrameSummary::empty(input.frame);
        let mut start = from;
        for stop in stops {
            self.push_samples(input, (start, stop), to)?;
            start = stop;
            if self.state.time >= stop {
                // Behind a pause.
                continue;
            }
            // New samples leave the bodies at their times; self-contact starts from where they are now.
            self.bodies.set_step(self.state.time, self.state.time);
            let mut pause = |time| time < to && pause(time);
            if self.run_to(stop, input.frame, &mut summary, &mut pause)? {
                self.take_counts();
                summary.metrics = self.metrics.take().over_ranks(self.ranks());
                return Ok(Advance::Paused(summary));
            }
        }
        self.frame = input.frame;
        self.measure(&mut summary)?;
        self.rebalance();
        Ok(Advance::Done(summary))
    }

    /// Steps until `end` [s], one collision step after the other, or until it is to pause: then returns true.
    fn run_to(
        &mut self,
        end: f64,
        frame: i64,
        summary: &mut FrameSummary,
        pause: &mut dyn FnMut(f64) -> bool,
    ) -> Result<bool, StepError> {
        while self.state.time < end {
            let start = self.state.time;
            let steps = self.begin_interval();
            let mut done = 0;
            while self.state.time < end && done < steps {
                self.one_step(end, frame, summary)?;
                done += 1;
            }
            if self.end_interval(self.state.time - start, done > 1) == Ending::Rewound {
                self.rewind();
            } else if self.yields.is_some() {
                self.give_way();
            }
            if pause(self.state.time) {
                return Ok(true);
            }
        }
        Ok(false)
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
    fn rewind(&mut self) {
        let Self { scene, self_contact, collision, state, bodies, targets, tracks, .. } = self;
        let Some(contact) = self_contact else { return };
        contact.rewind(state);
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

    /// One time step towards `end` [s].
    fn one_step(&mut self, end: f64, frame: i64, summary: &mut FrameSummary) -> Result<(), StepError> {
        let scene = Arc::clone(&self.scene);
        let settings = &scene.description().solver;
        let parts = scene.parts();
        let state = &self.state;
        let (limit, forces, metrics) = (&mut self.limit, &self.forces, &mut self.metrics);
        let share = self.self_contact.as_ref().map_or(1.0, SelfContact::step_share);
        let choice = metrics
            .stage("dt", |_| limit.choose(settings, parts, forces, (&state.x, &state.v), (state.time, end), share));
        if choice.limit < settings.min_dt {
            let because = if choice.by_strain { "the rate of strain" } else { "the stiffness of the springs" };
            let (dt, min_dt, time) = (choice.limit, settings.min_dt, state.time);
            return Err(StepError::StepTooSmall { frame, time, dt, min_dt, because });
        }
        let automatic = CG_TOLERANCE.min(CG_GRAVITY_FRACTION * choice.dt * STANDARD_GRAVITY);
        let stop =
            Stop { tolerance: settings.cg_tolerance.unwrap_or(automatic), max_iterations: settings.cg_max_iterations };
        let mut context = StepContext {
            parts,
            masses: scene.masses(),
            state: &mut self.state,
            forces: &mut self.forces,
            pins: self.pins.as_ref(),
            targets: &mut self.targets,
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
            metrics: &mut self.metrics,
        };
        let report = advance(&mut context, choice.dt);
        if let Some(stage) = report.not_finite {
            return Err(self.not_finite(stage, frame, choice.dt));
        }
        summary.steps += 1;
        summary.cg_iterations += report.cg_iterations as u64;
        summary.dt_min = summary.dt_min.min(choice.dt);
        summary.dt_max = summary.dt_max.max(choice.dt);
        if choice.ends_interval {
            // The time of a frame comes from integers, not from a sum of steps.
            self.state.time = end;
        }
        Ok(())
    }

    /// Hands bodies and tracks the samples that the interval from `start` to `stop` [s] needs.
    fn push_samples(&mut self, input: &FrameInput, (start, stop): (f64, f64), frame_end: f64) -> Result<(), StepError> {
        // The next sample of each mesh is the first one at or after the end of the interval; take it once.
        let needed = |samples: &[Sample]| samples.iter().find(|s| s.time >= stop).cloned();
        for body in 0..self.bodies.list().len() {
            if !self.bodies.list()[body].is_surface() {
                continue;
            }
            let samples = input.bodies.get(body).map_or(&[][..], Vec::as_slice);
            if samples.last().is_none_or(|s| s.time != frame_end) {
                let name = &self.scene.description().bodies[body].name;
                return Err(self.input_error(input, format!("body \"{name}\" has no sample at the frame's time")));
            }
            let next = needed(samples);
            if let Some(sample) = next.filter(|s| s.time > self.bodies.sampled_until(body)) {
                self.bodies.push_sample(body, sample).map_err(|e| self.input_error(input, e))?;
            }
        }
        for track in 0..self.tracks.len() {
            let samples = input.tracks.get(track).map_or(&[][..], Vec::as_slice);
            let Some(sample) = needed(samples) else {
                return Err(self.input_error(input, format!("track {track} has no sample at the frame's time")));
            };
            if sample.positions.len() != self.tracks[track].b.positions.len() {
                return Err(self.input_error(input, format!("track {track} changes its number of points")));
            }
            if sample.time > self.tracks[track].b.time.max(start) {
                self.tracks[track].push(sample);
            }
        }
        if self.wind.exists() {
            let Some(sample) = input.wind.iter().find(|sample| sample.time >= stop).cloned() else {
                return Err(self.input_error(input, "the wind has no sample at the frame's time".into()));
            };
            if sample.time > self.wind.sampled_until().max(start) {
                self.wind.push(sample).map_err(|e| self.input_error(input, e))?;
            }
        }
        Ok(())
    }

    fn input_error(&self, input: &FrameInput, what: String) -> StepError {
        StepError::Input { frame: input.frame, what }
    }
}
