//! A scene with its state and effects, advanced frame by frame.

use std::mem::take;
use std::ops::Range;
use std::sync::Arc;

use crate::Vec3;
use crate::contact::bodies::{Bodies, Samples};
use crate::contact::self_contact::SelfContact;
use crate::effects::registry::{PlannedEffect, build_all};
use crate::effects::spec::{Effect, Need};
use crate::error::{Problems, StepError};
use crate::geometry::crossings::Crossing;
use crate::metrics::Metrics;
use crate::observe::Observer;
use crate::parallel::problems::agree;
use crate::parallel::ranks::Sent;
use crate::pins::{Mobility, PinTargets};
use crate::scene::Scene;
use crate::snapshot::saved_section::SectionId;
use crate::solve::implicit_velocity::by_part;
use crate::state::State;
use crate::step::{Cloth, Contacts, Dynamics, Prescribed, Scratch, StageArrays, VelocityNeeds};
use crate::time_step::StepLimit;
use crate::volumes::Volumes;
use crate::wind_grid::{WindGrid, WindSample};

mod between_pins;
mod checkpoint;
mod collision_step;
mod cost;
mod estimate;
mod frame_cost;
pub(crate) mod frame_io;
mod frame_summary;
mod integrator_change;
mod integrator_choice;
mod load_balance;
mod lowered_thickness;
mod numbers;
mod overstretched;
mod pins_in_bodies;
#[cfg(test)]
mod planted_errors;
mod rebuild_error;
mod recovery;
mod start;
mod start_state;
mod touch;
mod untangling;

pub use crate::contact::bodies::Sample;
pub use checkpoint::RestoreError;
pub use cost::PlannedSteps;
pub use estimate::{FrameEstimate, PARTS_OF_A_FRAME};
pub use frame_summary::{BrokenHold, FrameSummary, GarmentStrains, HoldOwner};
use integrator_change::IntegratorChange;
pub(crate) use integrator_choice::CHOICE_VERSION;
use integrator_choice::choose_integrator;
use load_balance::Balance;
pub use lowered_thickness::LoweredThickness;
use lowered_thickness::lowered_thickness;
use numbers::check_curves_of_effects;
pub use overstretched::Overstretched;
pub use pins_in_bodies::PinInBody;
pub use recovery::Recovery;
use recovery::RetryState;
use start::{find_inside, first_tracks};
pub use start_state::{StartCrossings, StartInside, StartLayers, StartLengths};

/// Input of one frame: the caller pushes it, the solver asks for nothing.
///
/// ```
/// use drapery_core::FrameInput;
/// let half_way = FrameInput { output_times: vec![0.5 / 24.0], ..FrameInput::to_frame(1) };
/// assert!(half_way.bodies.is_empty() && FrameInput::default() == FrameInput::to_frame(0));
/// ```
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
    /// Times between the last frame and this one at which the state is wanted too [s], ascending: a step ends at each, and
    /// [`Simulation::advance_or_pause`] pauses there.
    pub output_times: Vec<f64>,
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

/// Outcome of an advance: the frame is reached, or the simulation pauses before it.
///
/// ```
/// # use drapery_core::{EffectRequest, GarmentDescription, PolygonMesh, SceneDescription, Vec3};
/// # let mesh = PolygonMesh::from_triangles(vec![Vec3::zeros(), Vec3::x(), Vec3::z()], &[[0, 2, 1]]);
/// # let mut description = SceneDescription::new("fall");
/// # description.garments.push(GarmentDescription::new("cloth", mesh, 0.2));
/// # description.effects.push(EffectRequest::of_scene("gravity"));
/// use drapery_core::{Advance, FrameInput, Scene, Simulation};
/// let scene = Scene::validate(description).expect("a valid scene");
/// let mut simulation = Simulation::new(scene, &FrameInput::to_frame(0)).expect("a valid start");
/// let input = FrameInput { output_times: vec![0.5 / 24.0], ..FrameInput::to_frame(1) };
/// let paused = simulation.advance_or_pause(&input, &mut |_| false);
/// assert!(matches!(paused, Ok(Advance::Paused(_))) && simulation.state().time == 0.5 / 24.0);
/// assert!(matches!(simulation.advance_or_pause(&input, &mut |_| false), Ok(Advance::Done(_))));
/// ```
#[derive(Debug, Clone, PartialEq)]
pub enum Advance {
    /// The frame is reached.
    Done(FrameSummary),
    /// It was asked to pause between two frames, at a state free of collisions; this is what was done since the last frame or
    /// pause. Strain and energies are those of whole frames and not in it.
    Paused(FrameSummary),
}

/// A running simulation: a scene with its state, advanced frame by frame.
///
/// ```
/// # use drapery_core::{EffectRequest, GarmentDescription, PolygonMesh, SceneDescription, Vec3};
/// # let mesh = PolygonMesh::from_triangles(vec![Vec3::zeros(), Vec3::x(), Vec3::z()], &[[0, 2, 1]]);
/// # let mut description = SceneDescription::new("fall");
/// # description.garments.push(GarmentDescription::new("cloth", mesh, 0.2));
/// # description.effects.push(EffectRequest::of_scene("gravity"));
/// use drapery_core::{FrameInput, Scene, Simulation};
/// let scene = Scene::validate(description).expect("a valid scene");
/// let mut simulation = Simulation::new(scene, &FrameInput::to_frame(0)).expect("a valid start");
/// (1..=24).for_each(|frame| drop(simulation.advance(&FrameInput::to_frame(frame)).expect("a step of free fall")));
/// let mut positions = Vec::new();
/// simulation.garment_positions(0, &mut positions);
/// assert!((positions[0].y + 9.81 / 2.0).abs() < 1e-9, "½ g t² after a second");
/// ```
pub struct Simulation {
    scene: Arc<Scene>,
    frame: i64,
    cloth: Cloth,
    dynamics: Dynamics,
    prescribed: Prescribed,
    contacts: Contacts,
    limit: StepLimit,
    /// Section with what has yielded in the cloth, where it can.
    yields: Option<SectionId>,
    /// Section of elements that have broken, if any can break.
    breaks: Option<SectionId>,
    metrics: Metrics,
    plan: Vec<PlannedEffect>,
    /// Crossings of the state at the last frame.
    crossings: Vec<Crossing>,
    /// Amount that this rank had sent at the last frame.
    sent: Sent,
    balance: Balance,
    retry: RetryState,
    /// Costs of frames with both integrators, where the scene may change to the other one.
    integrator_change: Option<IntegratorChange>,
    /// Warnings about how pins hold the cloth at the start; on rank 0.
    warnings: Vec<String>,
    /// Garments that keep less than their thickness.
    lowered: Vec<LoweredThickness>,
    /// Objects that cross at the start, and garments with edges that are far from their length at rest there.
    start_crossings: Vec<StartCrossings>,
    start_inside: Vec<StartInside>,
    start_layers: Vec<StartLayers>,
    start_lengths: Vec<StartLengths>,
    /// Observer of the cloth after lines of the listings.
    observer: Option<Observer>,
}

impl Simulation {
    /// Builds the effects that the scene asks for and puts everything at the start frame.
    ///
    /// `start` holds one sample per deforming body and track, at the start time.
    ///
    /// # Errors
    /// All problems of the effects' settings, of the first samples, and of garments that start inside a body for the larger part.
    pub fn new(scene: Scene, start: &FrameInput) -> Result<Self, Problems> {
        let mut scene = Arc::new(scene);
        choose_integrator(&mut scene)?;
        let mut simulation = Self::build(scene, start)?;
        if simulation.contacts.bodies.is_some() {
            let Self { scene, cloth, prescribed, .. } = &simulation;
            simulation.start_inside = find_inside(scene, &cloth.state, &prescribed.bodies, prescribed.pins.as_ref())?;
        }
        simulation.warn_of_far_bound();
        simulation.pins_take_hold();
        simulation.crossings = simulation.find_crossings();
        simulation.look_at_start();
        Ok(simulation)
    }

    /// The simulation of a scene with its integrator chosen: the cloth as the scene starts it, bodies and tracks where `start` has them.
    fn build(scene: Arc<Scene>, start: &FrameInput) -> Result<Self, Problems> {
        let state = State::at_start(&scene);
        let bodies = Bodies::new(&scene, &start.bodies, state.time)?;
        let tracks = first_tracks(&scene, start)?;
        let wind = WindGrid::new(scene.description().wind, &start.wind).map_err(|problem| Problems(vec![problem]))?;
        let effects = build_all(&scene)?;
        check_curves_of_effects(&scene)?;
        Self::with(scene, effects, state, (bodies, tracks, wind))
    }

    /// The simulation of a scene with these effects, bodies, tracks and wind.
    fn with(
        scene: Arc<Scene>,
        mut effects: Vec<(PlannedEffect, Effect)>,
        state: State,
        (bodies, tracks, wind): (Bodies, Vec<Samples>, WindGrid),
    ) -> Result<Self, Problems> {
        let targets = PinTargets::new(&scene, &state.x, &bodies, &tracks, state.time);
        let parts = scene.parts();
        agree(parts.ranks(), targets.as_ref().err().cloned().into_iter().collect())?;
        let targets = targets.map_err(|p| Problems(vec![p]))?;
        let forces = by_part(parts, effects.iter_mut().flat_map(|(_, effect)| take(&mut effect.forces)));
        let (mut pins, mut collision, mut plan) = (None, None, Vec::new());
        let (mut volumes, mut filters) = (Volumes::default(), Vec::new());
        let (mut repulsion, mut self_collision, mut sees_velocities) = (None, None, false);
        let (mut yields, mut breaks) = (None, None);
        for (planned, effect) in effects {
            pins = pins.or(effect.pins);
            filters.extend(effect.filters);
            collision = collision.or(effect.body_collision);
            repulsion = repulsion.or(effect.self_repulsion);
            self_collision = self_collision.or(effect.self_collision);
            yields = yields.or(effect.yields);
            breaks = breaks.or(effect.breaks);
            sees_velocities |= effect.sees_velocities;
            volumes.0.extend(effect.volume);
            plan.push(planned);
        }
        if let (Some(collision), Some(isolated)) = (&mut collision, scene.isolated()) {
            collision.set_held(isolated.iter().map(|vertex| (*vertex as usize, true)));
        }
        let (solver, frame) = (&scene.description().solver, scene.description().timeline.frame_duration());
        let limit = StepLimit::new(parts, scene.masses(), &forces, solver, frame);
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
            effect.longest_step = -parts.ranks().max(-effect.longest_step);
        }
        let lowered = repulsion.map_or_else(Vec::new, |(_, clamp)| lowered_thickness(&scene, clamp, &mut plan));
        let contacts = Contacts { bodies: collision, cloth: self_contact };
        let needs = VelocityNeeds { v_star: contacts.bodies.is_some(), seen: sees_velocities };
        let stages = solver.integrator.spec().is_implicit.then(|| StageArrays::new(parts, &forces));
        let scratch = Scratch::new(&scene, &forces, needs, stages);
        let is_mobility_read = !filters.is_empty() || (pins.is_some() && contacts.cloth.is_some());
        let mobility = if is_mobility_read { Mobility::new(scene.masses()) } else { Mobility::default() };
        let integrator_change = IntegratorChange::new(&scene);
        Ok(Self {
            frame: scene.description().timeline.start,
            cloth: Cloth { state, scratch },
            dynamics: Dynamics { forces, filters, volumes, wind },
            prescribed: Prescribed { bodies, tracks, pins, targets, mobility },
            contacts,
            limit,
            yields,
            breaks,
            metrics: Metrics::default(),
            scene,
            plan,
            crossings: Vec::new(),
            sent: Sent::default(),
            balance: Balance::default(),
            retry: RetryState::default(),
            integrator_change,
            warnings: Vec::new(),
            lowered,
            start_crossings: Vec::new(),
            start_inside: Vec::new(),
            start_layers: Vec::new(),
            start_lengths: Vec::new(),
            observer: None,
        })
    }

    /// Garments of which short edges lower the thickness that repulsions keep; none without these.
    pub fn lowered_thickness(&self) -> &[LoweredThickness] {
        &self.lowered
    }

    /// Hard pins start where their targets are.
    fn pins_take_hold(&mut self) {
        if let Some(pins) = &self.prescribed.pins {
            let time = self.cloth.state.time;
            self.prescribed.targets.set_step(
                &self.prescribed.bodies,
                &self.prescribed.tracks,
                &self.cloth.state.x,
                (time, time),
            );
            let parts = self.scene.parts();
            for (part, range) in parts.ranges().iter().enumerate() {
                pins.start_at(part, range.start, &self.prescribed.targets, &mut self.cloth.state.x[range.clone()]);
            }
            parts.halo().update(parts.ranks(), &mut self.cloth.state.x);
        }
    }

    /// Edges that cross triangles at the frame, by nodes: cloth in solver order, then the points of bodies. Looked
    /// for in scenes with `self_collision` only.
    pub fn crossings(&self) -> &[Crossing] {
        &self.crossings
    }

    fn find_crossings(&mut self) -> Vec<Crossing> {
        let Some(contact) = self.contacts.cloth.as_mut().filter(|contact| contact.keeps_free()) else {
            return Vec::new();
        };
        contact.check_everything(&self.cloth.state.x, &self.prescribed.bodies).to_vec()
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
        &self.cloth.state
    }

    /// The bodies, where they are at the time of the state.
    pub fn bodies(&self) -> &Bodies {
        &self.prescribed.bodies
    }

    /// The effects that run, in order.
    pub fn plan(&self) -> &[PlannedEffect] {
        &self.plan
    }

    /// Memory of the state and the scratch arrays on this rank [bytes].
    pub fn bytes(&self) -> usize {
        (2 * self.cloth.state.x.len() + self.cloth.state.a.len()) * size_of::<Vec3>() + self.cloth.scratch.bytes()
    }

    /// Memory of the list of close pairs of cloth where layers lie on each other, which is found only in a step, on this rank [bytes]; zero
    /// without self-contact.
    pub fn pair_list_bytes(&self) -> usize {
        self.contacts.cloth.as_ref().map_or(0, SelfContact::bytes_in_heap)
    }

    /// Largest step that the elastic forces allow [s].
    pub fn elastic_step(&self) -> f64 {
        self.limit.elastic
    }

    /// Lets somebody look at the cloth after lines of the listings, which changes nothing; `None` ends that. All ranks call it
    /// together.
    pub fn observe(&mut self, observer: Option<Observer>) {
        self.observer = observer;
    }

    /// Goes on to the frame of `input`, the one after the current frame.
    ///
    /// # Errors
    /// Samples that do not cover the frame; a number that is no longer finite; a step below the scene's shortest.
    pub fn advance(&mut self, input: &FrameInput) -> Result<FrameSummary, StepError> {
        let mut earlier: Option<FrameSummary> = None;
        loop {
            let advance = self.advance_or_pause(input, &mut |_| false)?;
            let so_far = |summary: FrameSummary| match &earlier {
                Some(earlier) => summary.after(earlier),
                None => summary,
            };
            match advance {
                Advance::Done(summary) => return Ok(so_far(summary)),
                Advance::Paused(summary) => earlier = Some(so_far(summary)),
            }
        }
    }

    /// Goes on to the frame of `input`; asks at every state free of collisions on the way, given its time [s], whether to pause
    /// there, and pauses at its output times. After a pause the same input goes on, and comes to the same bits as without one.
    ///
    /// # Errors
    /// The same as of [`Simulation::advance`].
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
        self.follow_curves(input)?;
        let timeline = self.scene.description().timeline;
        let (from, to) = (timeline.time(self.frame), timeline.time(input.frame));
        self.prescribed.bodies.begin_frame(from);
        let mut stops: Vec<f64> = input.bodies.iter().chain(&input.tracks).flatten().map(|s| s.time).collect();
        stops.extend(input.wind.iter().map(|sample| sample.time));
        stops.extend(self.prescribed.targets.window_times());
        stops.extend(&input.output_times);
        stops.retain(|t| *t > from && *t < to);
        stops.push(to);
        stops.sort_unstable_by(f64::total_cmp);
        stops.dedup();
        let mut summary = FrameSummary::empty(input.frame);
        self.observer.iter_mut().for_each(|observer| observer.begin_frame(input.frame));
        let mut start = from;
        for stop in stops {
            self.push_samples(input, start..stop, to)?;
            start = stop;
            if self.cloth.state.time >= stop {
                // Behind a pause.
                continue;
            }
            // New samples leave the bodies at their times; self-contact starts from where they are now.
            self.prescribed.bodies.set_step(self.cloth.state.time, self.cloth.state.time);
            self.untangle(from, &mut summary);
            let mut pause = |time| time < to && pause(time);
            let is_output = stop < to && input.output_times.contains(&stop);
            if self.run_until(stop, &mut summary, &mut pause)? || is_output {
                self.take_counts();
                self.note_cost();
                summary.metrics = self.metrics.take().over_ranks(self.ranks());
                summary.recoveries = std::mem::take(&mut self.retry.events);
                return Ok(Advance::Paused(summary));
            }
        }
        self.frame = input.frame;
        self.note_cost();
        self.measure(&mut summary)?;
        self.rebalance();
        summary.next_integrator = self.reconsider_integrator()?;
        Ok(Advance::Done(summary))
    }

    /// Hands bodies and tracks the samples that an interval [s] needs.
    fn push_samples(&mut self, input: &FrameInput, interval: Range<f64>, frame_end: f64) -> Result<(), StepError> {
        let Range { start, end: stop } = interval;
        // The next sample of each mesh is the first one at or after the end of the interval; take it once.
        let needed = |samples: &[Sample]| samples.iter().find(|s| s.time >= stop).cloned();
        for body in 0..self.prescribed.bodies.count() {
            if !self.prescribed.bodies.is_surface(body) {
                continue;
            }
            let samples = input.bodies.get(body).map_or(&[][..], Vec::as_slice);
            if samples.last().is_none_or(|s| s.time != frame_end) {
                let name = &self.scene.description().bodies[body].name;
                return Err(self.input_error(input, format!("body \"{name}\" has no sample at the frame's time")));
            }
            let next = needed(samples);
            if let Some(sample) = next.filter(|s| s.time > self.prescribed.bodies.sampled_until(body)) {
                self.prescribed.bodies.push_sample(body, sample).map_err(|e| self.input_error(input, e))?;
            }
        }
        for track in 0..self.prescribed.tracks.len() {
            let samples = input.tracks.get(track).map_or(&[][..], Vec::as_slice);
            let Some(sample) = needed(samples) else {
                return Err(self.input_error(input, format!("track {track} has no sample at the frame's time")));
            };
            if sample.positions.len() != self.prescribed.tracks[track].b.positions.len() {
                return Err(self.input_error(input, format!("track {track} changes its number of points")));
            }
            if sample.time > self.prescribed.tracks[track].b.time.max(start) {
                self.prescribed.tracks[track].push(sample);
            }
        }
        if self.dynamics.wind.exists() {
            let Some(sample) = input.wind.iter().find(|sample| sample.time >= stop).cloned() else {
                return Err(self.input_error(input, "the wind has no sample at the frame's time".into()));
            };
            if sample.time > self.dynamics.wind.sampled_until().max(start) {
                self.dynamics.wind.push(sample).map_err(|e| self.input_error(input, e))?;
            }
        }
        Ok(())
    }

    fn input_error(&self, input: &FrameInput, what: String) -> StepError {
        StepError::Input { frame: input.frame, what }
    }
}
