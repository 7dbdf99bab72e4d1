//! Recovery from a collision step that goes wrong (`docs/dev/hard_cases.md#when-a-step-goes-wrong`): the step is
//! taken back to its collision-free state and tried again, each time more carefully, and every attempt is counted and
//! named.
//!
//! A step has gone wrong where a number is not finite, where an edge would change its length several times over in the
//! next step or allows only a tiny one, where a solve has diverged or has not converged, where a stage has left pairs of layers unsettled, where collisions have
//! moved a vertex far in a long step, or where zones of collisions had to be stopped. The levels are: half the time step, up to six
//! times; tighter solves; more attempts with impulses; zones at once; no repulsion around the vertices concerned; and at last these
//! vertices keep the positions of the collision-free state, more of them in each of some attempts, then all. A state that is not finite
//! ends the run, at the last collision-free one.
//!
//! Every state that is taken has come through C, and after a step that any level has touched the exact check looks at all cloth
//! ([`crate::contact::self_contact`]), so that no level leads to a new crossing.
//!
//! All ranks find the same failure and take the same level. Without failure nothing of this runs but one comparison of a
//! number that the choice of the step needs anyway, and, in scenes without `self_collision`, a copy of the state.

use super::Simulation;
use crate::Vec3;
use crate::contact::collisions::collision_loop::Strategy;
use crate::contact::self_contact::Ending;
use crate::error::StepError;
use crate::long_steps::LARGEST_CORRECTION;
use crate::parallel::message::codec;
use crate::parallel::parts::Parts;
use crate::solve::conjugate_gradient::Stop;
use crate::state::State;
use crate::step::{Cloth, Dynamics, StepReport};

/// Most halvings of the time step.
const HALVINGS: u32 = 6;

/// Limit on these halvings where zones had to be stopped: shorter steps seldom help there, and are many.
const HALVINGS_FOR_ZONES: u32 = 2;

/// The same where collisions have moved a vertex far, which is accepted then.
const HALVINGS_FOR_BLOWS: u32 = 4;

/// The same where a solve has not converged: more iterations help sooner, and a tolerance that is out of reach may not cost 64 times
/// the steps.
const HALVINGS_FOR_SHORT_SOLVES: u32 = 2;

/// Attempts in which vertices keep their positions; in the last all do.
const HELD_ATTEMPTS: u32 = 4;

/// Collision steps without failure after which the time step is doubled again.
const CALM: u32 = 3;

/// Rate of strain times the length of the step that led to it, over what a step is allowed, from which on the step counts
/// as gone wrong.
const MAX_STRAIN_PER_STEP_FACTOR: f64 = 5.0;

/// Next step that the rate of strain allows, over the longest, below which a step that has doubled this rate has gone wrong: velocities
/// that grow while steps shrink would bring the run to a standstill.
const SHORTEST_NEXT_STEP: f64 = 1.0 / 4096.0;

/// Factors on the tolerance of tighter solves, and on their largest number of iterations.
const TIGHTER: f64 = 0.01;
const MORE_ITERATIONS: usize = 10;

/// Vertices that an event names.
const NAMED: usize = 8;

/// Name of the message about them, for the report of a broken one.
const VERTEX_NAMES: &str = "names of vertices";

/// Events of a frame that are kept with their names; all are counted.
const KEPT: usize = 16;

/// Kind of failure of a collision step.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum FailureKind {
    /// A number is not finite after this stage.
    NotFinite(&'static str),
    /// Edges change their lengths too fast.
    Wild,
    /// A solve ended farther from its solution than it began.
    Diverged,
    /// A solve ended above its tolerance.
    Short,
    /// Newton's method left the distance of pairs of layers unsettled.
    Unsettled,
    /// Collisions moved a vertex far in a long step.
    Struck,
    /// Zones of collisions stayed where they were.
    Stopped,
}

impl FailureKind {
    /// Failure of a state with a rate of strain that allows no further step [1/s].
    pub(super) fn of_rate(rate: f64) -> Self {
        if rate.is_finite() { Self::Wild } else { Self::NotFinite("the end of the step") }
    }

    fn word(self) -> &'static str {
        match self {
            Self::NotFinite(_) => "not finite",
            Self::Wild => "strain rate too high",
            Self::Diverged => "solve diverged",
            Self::Short => "solve did not converge",
            Self::Unsettled => "layers did not settle",
            Self::Struck => "collision moved a vertex too far",
            Self::Stopped => "collisions unresolved",
        }
    }
}

/// Level that is tried against a failure.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum RetryLevel {
    Shorter,
    Tighter,
    MoreAttempts,
    Zones,
    Thinner,
    Held,
}

impl RetryLevel {
    /// Name of its count.
    fn count(self) -> &'static str {
        RECOVERY_COUNTS[self as usize]
    }
}

/// Counts of the levels, in their order.
const RECOVERY_COUNTS: [&str; 6] =
    ["retried_shorter", "retried_tighter", "retried_more_attempts", "retried_zones", "retried_thinner", "retried_held"];

/// A level that was taken, for the summary of the frame.
#[derive(Debug, Clone, PartialEq)]
pub struct Recovery {
    /// Frame that is being computed.
    pub frame: i64,
    /// Time of the collision-free state from which it is tried again [s].
    pub time: f64,
    /// Failure against which the level was taken.
    pub failure: &'static str,
    /// Name of the count of what was done about it.
    pub level: &'static str,
    /// Garment of the vertices; empty if none is to blame.
    pub garment: String,
    /// Some of the vertices concerned, in the garment's own order.
    pub vertices: Vec<u32>,
}

/// Caution with which steps are made.
#[derive(Debug, Default)]
pub(super) struct RetryState {
    /// Halvings of the time step.
    halvings: u32,
    /// Collision steps since the last failure, up to [`CALM`].
    calm: u32,
    /// The last level taken in the present collision step.
    level: Option<RetryLevel>,
    /// Halvings in the present collision step.
    halved: u32,
    /// Attempts of the present collision step in which vertices kept their positions.
    held_attempts: u32,
    /// Own vertices that the last time step named, and its solves that ended above their tolerance.
    of_step: (Vec<u32>, u64),
    /// Vertices concerned in the present collision step, by their numbers in the scene, ascending: alike on all ranks.
    concerned: Vec<u32>,
    /// The same among this rank's own, by local number, if they are held.
    held: Option<Vec<u32>>,
    /// Length of the last step [s].
    dt: f64,
    /// Largest rate of strain at its start [1/s].
    rate_before: f64,
    /// The state at the start of the collision step, where self-contact does not keep it.
    start: Option<State>,
    /// The accelerations there, which self-contact does not keep.
    pub(super) a_start: Vec<Vec3>,
    /// Levels taken since the last frame.
    pub(super) events: Vec<Recovery>,
}

impl RetryState {
    /// Returns the numbers that have to be saved: halvings and calm collision steps.
    pub(super) fn saved(&self) -> [u64; 2] {
        [self.halvings.into(), self.calm.into()]
    }

    /// Goes on from what was saved.
    pub(super) fn restore(&mut self, [halvings, calm]: [u64; 2]) {
        // What was saved is not larger than the limits.
        (self.halvings, self.calm) = (halvings.min(HALVINGS.into()) as u32, calm.min(CALM.into()) as u32);
    }

    /// Part of the time step that may be taken.
    pub(super) fn part(&self) -> f64 {
        0.5_f64.powi(self.halvings as i32)
    }

    /// Whether collision steps are of one time step.
    pub(super) fn is_cautious(&self) -> bool {
        self.halvings > 0 || self.level.is_some()
    }

    /// When solves stop.
    pub(super) fn stop(&self, usual: Stop) -> Stop {
        if self.level.is_some_and(|level| level as usize >= RetryLevel::Tighter as usize) {
            let (tolerance, max_iterations) = (TIGHTER * usual.tolerance, MORE_ITERATIONS * usual.max_iterations);
            Stop { tolerance, max_iterations }
        } else {
            usual
        }
    }

    /// Own vertices that are held, if any rank holds some.
    pub(super) fn held(&self) -> Option<&[u32]> {
        self.held.as_deref()
    }

    /// A step of this length was made [s], from a state with this largest rate of strain [1/s]. Solves that ended above their tolerance
    /// count once the step is taken.
    pub(super) fn note_step(&mut self, dt: f64, rate: f64, report: &StepReport) {
        (self.dt, self.rate_before) = (dt, rate);
        self.of_step = (report.concerned.clone(), self.of_step.1 + report.short_solves);
    }

    /// The time steps since the collision-free state are not taken.
    pub(super) fn forget_steps(&mut self) {
        self.of_step.1 = 0;
    }

    /// Whether the present collision step is tried again.
    pub(super) fn is_retrying(&self) -> bool {
        self.level.is_some()
    }

    /// The next level against a failure; `None` when there is none left.
    fn next(&self, failure: FailureKind, [collides, repels]: [bool; 2]) -> Option<RetryLevel> {
        let most = if failure == FailureKind::Stopped { HALVINGS_FOR_ZONES } else { HALVINGS };
        let in_all = match failure {
            FailureKind::Struck => HALVINGS_FOR_BLOWS,
            FailureKind::Short => HALVINGS_FOR_SHORT_SOLVES,
            _ => HALVINGS,
        };
        let after = self.level.map_or(0, |level| level as usize);
        if after <= RetryLevel::Shorter as usize && self.halved < most && self.halvings < in_all {
            return Some(RetryLevel::Shorter);
        }
        if failure == FailureKind::Struck {
            return None;
        }
        if self.level == Some(RetryLevel::Held) {
            return (self.held_attempts < HELD_ATTEMPTS).then_some(RetryLevel::Held);
        }
        let by_contact = collides && matches!(failure, FailureKind::Stopped | FailureKind::NotFinite(_));
        let levels = [
            (RetryLevel::Tighter, failure != FailureKind::Stopped),
            (RetryLevel::MoreAttempts, by_contact),
            (RetryLevel::Zones, by_contact),
            (RetryLevel::Thinner, repels && failure != FailureKind::Short),
            (RetryLevel::Held, failure != FailureKind::Short),
        ];
        let mut left = levels.into_iter().filter(|(level, is_of_use)| *is_of_use && *level as usize > after);
        left.next().map(|(level, _)| level)
    }
}

impl Simulation {
    /// Returns the levels taken since the last frame against steps that went wrong.
    pub fn recoveries(&self) -> &[Recovery] {
        &self.retry.events
    }

    /// Before a collision step: keeps the state, unless self-contact does.
    pub(super) fn keep_collision_free_state(&mut self) {
        let Self { retry, cloth: Cloth { state, .. }, contacts, .. } = self;
        retry.a_start.clone_from(&state.a);
        if contacts.cloth.as_ref().is_some_and(|contact| contact.keeps_free()) {
            return;
        }
        let kept = retry.start.get_or_insert_with(|| State { x: Vec::new(), v: Vec::new(), a: Vec::new(), time: 0.0 });
        kept.x.clone_from(&state.x);
        kept.v.clone_from(&state.v);
        kept.time = state.time;
    }

    /// The largest rate of strain of the state [1/s].
    pub(super) fn rate_of_strain(&mut self) -> f64 {
        let Self { scene, limit, dynamics: Dynamics { forces, .. }, cloth: Cloth { state, .. }, contacts, .. } = self;
        let share = contacts.cloth.as_ref().map_or(1.0, |contact| contact.step_share());
        limit.rate(&scene.description().solver, scene.parts(), forces, state, share)
    }

    /// Finds the failure of the state at the end of a collision step, if there is one.
    pub(super) fn find_failure(&mut self, ending: Ending) -> Option<FailureKind> {
        self.limit.forget_rate();
        if ending == Ending::Rewound {
            return None;
        }
        let rate = self.rate_of_strain();
        if !rate.is_finite() || rate > self.largest_rate_of_strain() {
            Some(FailureKind::of_rate(rate))
        } else if ending == Ending::Resolved && self.was_struck() {
            Some(FailureKind::Struck)
        } else {
            (ending == Ending::Stopped).then_some(FailureKind::Stopped)
        }
    }

    /// Rate of strain above which a step counts as gone wrong [1/s].
    fn largest_rate_of_strain(&self) -> f64 {
        let description = self.scene.description();
        let strain = description.solver.largest_strain_per_step();
        let longest = self.limit.longest(&description.solver, 1.0).min(description.timeline.frame_duration());
        let runs_away = (strain / (SHORTEST_NEXT_STEP * longest)).max(2.0 * self.retry.rate_before);
        runs_away.min(MAX_STRAIN_PER_STEP_FACTOR * strain / self.retry.dt)
    }

    /// Whether the collisions of a long step have moved a vertex far, on any rank.
    fn was_struck(&self) -> bool {
        let is_implicit = self.scene.description().solver.integrator.spec().is_implicit;
        let contact = self.contacts.cloth.as_ref().filter(|contact| is_implicit && contact.keeps_free());
        contact.is_some_and(|contact| self.ranks().any(contact.largest_correction().0 > LARGEST_CORRECTION))
    }

    /// After a collision step without failure, or one that is accepted.
    pub(super) fn relax(&mut self) {
        let (ranks, short) = (self.scene.parts().ranks(), std::mem::take(&mut self.retry.of_step.1));
        self.metrics.count_once(ranks, "cg_short", short);
        let was_retrying = self.end_recovery();
        let retry = &mut self.retry;
        if retry.halvings > 0 {
            retry.calm = if was_retrying { 0 } else { retry.calm + 1 };
            if retry.calm >= CALM {
                (retry.halvings, retry.calm) = (retry.halvings - 1, 0);
            }
        }
    }

    /// Leaves the levels of the present collision step; returns whether there was one.
    pub(super) fn end_recovery(&mut self) -> bool {
        let retry = &mut self.retry;
        let was_retrying = retry.level.take().is_some();
        if was_retrying {
            (retry.halved, retry.held_attempts) = (0, 0);
            retry.concerned.clear();
            retry.held = None;
            if let Some(contact) = &mut self.contacts.cloth {
                contact.set_strategy(Strategy::Usual, Vec::new());
            }
        }
        was_retrying
    }

    /// The next level against a failure; `None` when there is none left.
    fn next_level(&self, failure: FailureKind) -> Option<RetryLevel> {
        let contact = self.contacts.cloth.as_ref();
        let [collides, repels] = [contact.is_some_and(|c| c.keeps_free()), contact.is_some_and(|c| c.repels())];
        self.retry.next(failure, [collides, repels])
    }

    /// Whether a step with this failure would be taken back.
    pub(super) fn retries(&self, failure: FailureKind) -> bool {
        self.next_level(failure).is_some()
    }

    /// Takes the collision step back to be tried again; false where no level is left and the state is finite, so that C makes it
    /// free of collisions.
    ///
    /// # Errors
    /// Nothing is left to try; the state is the last good one.
    pub(super) fn recover(&mut self, failure: FailureKind, frame: i64) -> Result<bool, StepError> {
        let next = self.next_level(failure);
        let (garment, vertices) = self.attribute(failure);
        let Some(level) = next else {
            let FailureKind::NotFinite(stage) = failure else { return Ok(false) };
            let vertex = vertices.first().map_or(0, |vertex| *vertex as usize);
            let (time, dt) = (self.time_of_shot(), self.retry.dt);
            self.roll_back();
            return Err(StepError::NotFinite { garment, vertex, frame, time, stage, dt });
        };
        let ranks = self.ranks().clone();
        self.metrics.count_once(&ranks, level.count(), 1);
        self.roll_back();
        if self.retry.events.len() < KEPT {
            let (time, failure, level) = (self.time_of_shot(), failure.word(), level.count());
            self.retry.events.push(Recovery { frame, time, failure, level, garment, vertices });
        }
        self.escalate(level);
        Ok(true)
    }

    /// Makes the next attempt as the level says.
    fn escalate(&mut self, level: RetryLevel) {
        let Self { scene, retry, contacts, .. } = self;
        retry.level = Some(level);
        if level == RetryLevel::Shorter {
            (retry.halvings, retry.halved, retry.calm) = (retry.halvings + 1, retry.halved + 1, 0);
        }
        if level == RetryLevel::Held {
            let parts = scene.parts();
            retry.held_attempts += 1;
            let holds_all = retry.held_attempts == HELD_ATTEMPTS;
            let is_held = |i: &usize| holds_all || retry.concerned.binary_search(&parts.number(*i)).is_ok();
            let takes_no_part =
                |i: &usize| scene.isolated().is_some_and(|isolated| isolated.binary_search(&(*i as u32)).is_ok());
            retry.held = Some(parts.own().filter(|i| is_held(i) || takes_no_part(i)).map(|i| i as u32).collect());
        }
        if let Some(contact) = &mut contacts.cloth {
            let strategy = match level {
                RetryLevel::Shorter | RetryLevel::Tighter => Strategy::Usual,
                RetryLevel::MoreAttempts => Strategy::MoreAttempts,
                RetryLevel::Zones | RetryLevel::Thinner | RetryLevel::Held => Strategy::Zones,
            };
            let is_thin = level as usize >= RetryLevel::Thinner as usize;
            contact.set_strategy(strategy, if is_thin { retry.concerned.clone() } else { Vec::new() });
        }
    }

    /// Puts everything back to the start of the collision step.
    pub(super) fn roll_back(&mut self) {
        if let Some(start) = self.retry.start.as_ref() {
            self.cloth.state.x.clone_from(&start.x);
            self.cloth.state.v.clone_from(&start.v);
            self.cloth.state.time = start.time;
        }
        self.rewind();
        self.limit.forget_rate();
    }

    /// Finds the vertices concerned, on all ranks; returns some of those of the first garment among them.
    fn attribute(&mut self, failure: FailureKind) -> (String, Vec<u32>) {
        let (scene, ranks) = (std::sync::Arc::clone(&self.scene), self.ranks().clone());
        let parts = scene.parts();
        let own: Vec<u32> = match failure {
            FailureKind::NotFinite(_) => {
                let found = self.cloth.scratch.not_finite(parts.own(), &self.cloth.state);
                found.into_iter().map(|i| parts.number(i)).collect()
            }
            FailureKind::Stopped => {
                self.contacts.cloth.as_ref().map_or_else(Vec::new, |c| c.frozen_vertices().to_vec())
            }
            FailureKind::Struck => {
                let own = self.contacts.cloth.as_ref().map_or((0.0, 0), |contact| contact.largest_correction());
                let largest = ranks.max(own.0);
                if own.0 == largest { vec![own.1] } else { Vec::new() }
            }
            FailureKind::Wild => {
                let rate = self.largest_rate_of_strain();
                let ranges = self.limit.parts_faster_than(rate).map(|part| parts.ranges()[part].clone());
                ranges.flatten().map(|vertex| parts.number(vertex)).collect()
            }
            FailureKind::Diverged | FailureKind::Short | FailureKind::Unsettled => {
                std::mem::take(&mut self.retry.of_step.0)
            }
        };
        // Vertices that are held already stay so.
        let held = if self.retry.held_attempts > 0 { std::mem::take(&mut self.retry.concerned) } else { Vec::new() };
        let mut all = [held, ranks.all_gather_v(&own).concat()].concat();
        all.sort_unstable();
        all.dedup();
        self.retry.concerned = all;
        if let (FailureKind::Wild, Some(record)) = (failure, self.largest_strain()) {
            return (record.garment, record.vertices.to_vec());
        }
        let mut named = ranks.all_gather_encoded(VERTEX_NAMES, own_names(&self.retry.concerned, parts));
        named.sort_unstable();
        let Some(VertexName { garment, .. }) = named.first().copied() else { return (String::new(), Vec::new()) };
        let vertices = named.iter().filter(|name| name.garment == garment).map(|name| name.vertex);
        (scene.description().garments[garment].name.clone(), vertices.take(NAMED).collect())
    }
}

/// A vertex by its garment and its number in that.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct VertexName {
    garment: usize,
    vertex: u32,
}

codec!(struct VertexName { garment, vertex });

/// The first of these vertices that this rank has.
fn own_names(numbers: &[u32], parts: &Parts) -> Vec<VertexName> {
    let own = parts.own().filter(|i| numbers.binary_search(&parts.number(*i)).is_ok());
    let name = |(garment, vertex)| VertexName { garment, vertex };
    let mut names: Vec<VertexName> = own.map(|i| name(parts.own_vertex(i))).collect();
    names.sort_unstable();
    names.truncate(NAMED);
    names
}

/// Whether no component is infinite or not a number.
pub(super) fn is_finite(v: &Vec3) -> bool {
    v.iter().all(|c| c.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::PolygonMesh;
    use crate::scene::{EffectRequest, GarmentDescription, Scene, SceneDescription};
    use crate::simulation::{FrameInput, FrameSummary};

    /// The levels taken until none is left or the state is accepted.
    fn levels(failure: FailureKind, scene: [bool; 2]) -> Vec<RetryLevel> {
        let mut retry = RetryState::default();
        let mut taken = Vec::new();
        while let Some(level) = retry.next(failure, scene) {
            taken.push(level);
            retry.level = Some(level);
            if level == RetryLevel::Shorter {
                (retry.halvings, retry.halved) = (retry.halvings + 1, retry.halved + 1);
            }
            retry.held_attempts += u32::from(level == RetryLevel::Held);
        }
        taken
    }

    #[test]
    fn every_ladder_ends_with_vertices_that_keep_their_positions() {
        use RetryLevel::{Held, MoreAttempts, Shorter, Thinner, Tighter, Zones};
        let held = vec![Held; HELD_ATTEMPTS as usize];
        let ladder = |shorter, rest: Vec<RetryLevel>| [vec![Shorter; shorter], rest, held.clone()].concat();
        let broken = FailureKind::NotFinite("B.1");
        assert_eq!(levels(broken, [false; 2]), ladder(6, vec![Tighter]));
        assert_eq!(levels(broken, [true; 2]), ladder(6, vec![Tighter, MoreAttempts, Zones, Thinner]));
        assert_eq!(levels(FailureKind::Stopped, [true; 2]), ladder(2, vec![MoreAttempts, Zones, Thinner]));
        for failure in [FailureKind::Wild, FailureKind::Diverged, FailureKind::Unsettled] {
            assert_eq!(levels(failure, [false; 2]), ladder(6, vec![Tighter]));
            assert_eq!(levels(failure, [true; 2]), ladder(6, vec![Tighter, Thinner]));
        }
        // What C has moved far is free of collisions, and the best that a solve comes to is taken and counted.
        assert_eq!(levels(FailureKind::Struck, [true; 2]), [Shorter; 4]);
        assert_eq!(levels(FailureKind::Short, [true; 2]), [Shorter, Shorter, Tighter]);
    }

    /// A triangle of springs, of which a corner flies away at 1e5 m/s.
    fn fast_triangle() -> Simulation {
        let corners = [[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.0, 0.1]].map(Vec3::from);
        let mesh = PolygonMesh::from_triangles(corners.to_vec(), &[[0, 1, 2]]);
        let mut description = SceneDescription::new("fast");
        description.garments.push(GarmentDescription::new("triangle", mesh, 0.2));
        description.effects.push(EffectRequest::of_garment("stretch", 0).with("stiffness", 100.0));
        let scene = Scene::validate(description).unwrap_or_else(|problems| panic!("{problems}"));
        let start = FrameInput::to_frame(scene.description().timeline.start);
        let mut simulation = Simulation::new(scene, &start).unwrap_or_else(|problems| panic!("{problems}"));
        simulation.cloth.state.v[1] = Vec3::x() * 1e5;
        simulation
    }

    #[test]
    fn velocities_that_grow_while_steps_shrink_have_gone_wrong_and_fast_ones_have_not() {
        let mut simulation = fast_triangle();
        let rate = simulation.rate_of_strain();
        // Each step is as long as the rate of strain allows.
        let dt = simulation.scene.description().solver.largest_strain_per_step() / rate;
        for (growth, failure) in [(1.5, None), (3.0, Some(FailureKind::Wild))] {
            simulation.retry.note_step(dt, rate / growth, &StepReport::default());
            assert_eq!(simulation.find_failure(Ending::Resolved), failure, "{growth}");
        }
    }

    #[test]
    fn a_rate_of_strain_that_allows_no_step_ends_the_run_where_the_state_was_accepted_and_not_before() {
        let mut simulation = fast_triangle();
        simulation.keep_collision_free_state();
        let mut summary = FrameSummary::empty(1);
        let end = simulation.scene.description().timeline.frame_duration();
        for (speed, failure) in
            [(1e12, FailureKind::Wild), (f64::INFINITY, FailureKind::NotFinite("the end of the step"))]
        {
            simulation.cloth.state.v[1] = Vec3::x() * speed;
            simulation.limit.forget_rate();
            assert_eq!(simulation.time_step(true, end, &mut summary), Ok(Some(failure)));
        }
        let ended = simulation.time_step(false, end, &mut summary);
        assert!(matches!(ended, Err(StepError::StepTooSmall { .. })), "{ended:?}");
    }

    #[test]
    fn the_step_is_doubled_again_after_calm_collision_steps() {
        let mut retry = RetryState::default();
        retry.restore([2, 0]);
        assert_eq!(retry.part(), 0.25);
        retry.restore([u64::MAX, u64::MAX]);
        assert_eq!((retry.saved(), retry.part()), ([6, 3], 1.0 / 64.0));
    }
}
