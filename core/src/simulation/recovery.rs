//! What happens when a collision step goes wrong (`docs/hard_cases.md#when-a-step-goes-wrong`): it is taken back to its
//! collision-free state and tried again, each time more carefully, and every attempt is counted and named.
//!
//! A step has gone wrong where a number is not finite, where an edge would change its length several times over in the
//! next step, where a solve has diverged, or where zones of collisions had to be stopped. The rungs are: half the time
//! step, up to six times; tighter solves; more attempts with impulses; zones at once; no repulsion around what is
//! concerned; and at last these vertices stay where they are for this collision step. Finite states are accepted at
//! the end, and counted; a state that is not finite ends the run, at the last good one.
//!
//! All ranks find the same trouble and take the same rung. Without trouble nothing of this runs but one comparison of a
//! number that the choice of the step needs anyway, and, in scenes without `self_collision`, a copy of the state.

use super::Simulation;
use crate::Vec3;
use crate::contact::collisions::collision_loop::Effort;
use crate::contact::self_contact::Ending;
use crate::error::StepError;
use crate::solve::conjugate_gradient::Stop;
use crate::state::State;
use crate::step::{Cloth, Dynamics};

/// Most halvings of the time step.
const HALVINGS: u32 = 6;

/// Of these, how many are tried where zones had to be stopped: shorter steps seldom help there, and are many.
const HALVINGS_FOR_ZONES: u32 = 2;

/// Collision steps without trouble after which the time step is doubled again.
const CALM: u32 = 3;

/// Rate of strain times the length of the step that led to it, over what a step is allowed, from which on the step counts
/// as gone wrong.
const WILD: f64 = 5.0;

/// How much tighter solves become, and how many more iterations they get.
const TIGHTER: f64 = 0.01;
const MORE_ITERATIONS: usize = 10;

/// Vertices that an event names.
const NAMED: usize = 8;

/// Events of a frame that are kept with their names; all are counted.
const KEPT: usize = 16;

/// What went wrong.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Trouble {
    /// A number is not finite after this stage.
    NotFinite(&'static str),
    /// Edges change their lengths too fast.
    Wild,
    /// A solve ended farther from its solution than it began.
    Diverged,
    /// Zones of collisions stayed where they were.
    Stopped,
}

impl Trouble {
    fn word(self) -> &'static str {
        match self {
            Self::NotFinite(_) => "not finite",
            Self::Wild => "rate of strain",
            Self::Diverged => "solve diverged",
            Self::Stopped => "collisions unresolved",
        }
    }
}

/// What is tried.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Rung {
    Shorter,
    Tighter,
    MoreAttempts,
    Zones,
    Thinner,
    Held,
    Accepted,
}

impl Rung {
    /// Name of its count.
    fn count(self) -> &'static str {
        RECOVERY_COUNTS[self as usize]
    }
}

/// Counts of the rungs, in their order.
const RECOVERY_COUNTS: [&str; 7] = [
    "retried_shorter",
    "retried_tighter",
    "retried_more_attempts",
    "retried_zones",
    "retried_thinner",
    "retried_held",
    "steps_accepted",
];

/// A rung that was taken, for whoever looks after the run.
#[derive(Debug, Clone, PartialEq)]
pub struct Recovery {
    /// Frame that is being computed.
    pub frame: i64,
    /// Time of the collision-free state from which it is tried again [s].
    pub time: f64,
    /// What went wrong.
    pub trouble: &'static str,
    /// Name of the count of what was done about it.
    pub rung: &'static str,
    /// Garment of the vertices; empty if none is to blame.
    pub garment: String,
    /// Some of the vertices concerned, in the garment's own order.
    pub vertices: Vec<u32>,
}

/// How carefully steps are made.
#[derive(Debug, Default)]
pub(super) struct Care {
    /// Halvings of the time step.
    halvings: u32,
    /// Collision steps since the last trouble, up to [`CALM`].
    calm: u32,
    /// The last rung taken in the present collision step.
    rung: Option<Rung>,
    /// Halvings in the present collision step.
    halved: u32,
    /// Vertices concerned in the present collision step, by their numbers in the scene, ascending: alike on all ranks.
    concerned: Vec<u32>,
    /// The same among this rank's own, by local number, if they are held.
    held: Option<Vec<u32>>,
    /// Length of the last step [s].
    dt: f64,
    /// The state at the start of the collision step, where self-contact does not keep it.
    start: Option<State>,
    /// What was done since the last frame.
    pub(super) events: Vec<Recovery>,
}

impl Care {
    /// What has to be saved: halvings and calm collision steps.
    pub(super) fn saved(&self) -> [u64; 2] {
        [self.halvings.into(), self.calm.into()]
    }

    /// Goes on from what was saved.
    pub(super) fn go_on(&mut self, [halvings, calm]: [u64; 2]) {
        // What was saved is not larger than the limits.
        (self.halvings, self.calm) = (halvings.min(HALVINGS.into()) as u32, calm.min(CALM.into()) as u32);
    }

    /// Part of the time step that may be taken.
    pub(super) fn part(&self) -> f64 {
        0.5_f64.powi(self.halvings as i32)
    }

    /// Whether collision steps are of one time step.
    pub(super) fn is_cautious(&self) -> bool {
        self.halvings > 0 || self.rung.is_some()
    }

    /// When solves stop.
    pub(super) fn stop(&self, usual: Stop) -> Stop {
        if self.rung.is_some_and(|rung| rung as usize >= Rung::Tighter as usize) {
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

    /// A step of this length was made [s].
    pub(super) fn note_step(&mut self, dt: f64) {
        self.dt = dt;
    }

    /// The next rung against a trouble; `None` when there is none left.
    fn next(&self, trouble: Trouble, [collides, repels]: [bool; 2]) -> Option<Rung> {
        let most = if trouble == Trouble::Stopped { HALVINGS_FOR_ZONES } else { HALVINGS };
        let after = self.rung.map_or(0, |rung| rung as usize);
        if after <= Rung::Shorter as usize && self.halved < most && self.halvings < HALVINGS {
            return Some(Rung::Shorter);
        }
        let is_finite = !matches!(trouble, Trouble::NotFinite(_));
        let by_contact = collides && matches!(trouble, Trouble::Stopped | Trouble::NotFinite(_));
        let rungs = [
            (Rung::Tighter, trouble != Trouble::Stopped),
            (Rung::MoreAttempts, by_contact),
            (Rung::Zones, by_contact),
            (Rung::Thinner, repels),
            (Rung::Held, !is_finite),
            (Rung::Accepted, is_finite),
        ];
        let mut left = rungs.into_iter().filter(|(rung, is_of_use)| *is_of_use && *rung as usize > after);
        left.next().map(|(rung, _)| rung)
    }
}

impl Simulation {
    /// What was done since the last frame about steps that went wrong.
    pub fn recoveries(&self) -> &[Recovery] {
        &self.care.events
    }

    /// Before a collision step: keeps the state, unless self-contact does.
    pub(super) fn keep_collision_free_state(&mut self) {
        let Self { care, cloth: Cloth { state, .. }, contacts, .. } = self;
        if contacts.cloth.as_ref().is_some_and(|contact| contact.keeps_free()) {
            return;
        }
        let kept = care.start.get_or_insert_with(|| State { x: Vec::new(), v: Vec::new(), time: 0.0 });
        kept.x.clone_from(&state.x);
        kept.v.clone_from(&state.v);
        kept.time = state.time;
    }

    /// The largest rate of strain of the state [1/s].
    pub(super) fn rate_of_strain(&mut self) -> f64 {
        let Self { scene, limit, dynamics: Dynamics { forces, .. }, cloth: Cloth { state, .. }, contacts, .. } = self;
        let share = contacts.cloth.as_ref().map_or(1.0, |contact| contact.step_share());
        limit.rate(&scene.description().solver, scene.parts(), forces, (&state.x, &state.v), share)
    }

    /// What is wrong with the state at the end of a collision step.
    pub(super) fn find_trouble(&mut self, ending: Ending) -> Option<Trouble> {
        self.limit.forget_rate();
        if ending == Ending::Rewound {
            return None;
        }
        let rate = self.rate_of_strain();
        let allowed = self.scene.description().solver.strain_per_step;
        if !rate.is_finite() {
            Some(Trouble::NotFinite("of the step"))
        } else if rate * self.care.dt > WILD * allowed {
            Some(Trouble::Wild)
        } else {
            (ending == Ending::Stopped).then_some(Trouble::Stopped)
        }
    }

    /// After a collision step without trouble, or one that is accepted.
    pub(super) fn calm_down(&mut self) {
        let care = &mut self.care;
        let was_retrying = care.rung.take().is_some();
        if was_retrying {
            care.halved = 0;
            care.concerned.clear();
            care.held = None;
            if let Some(contact) = &mut self.contacts.cloth {
                contact.set_effort(Effort::Usual, Vec::new());
            }
        }
        if care.halvings > 0 {
            care.calm = if was_retrying { 0 } else { care.calm + 1 };
            if care.calm == CALM {
                (care.halvings, care.calm) = (care.halvings - 1, 0);
            }
        }
    }

    /// Takes the collision step back to be tried again; false if the state is accepted as it is.
    ///
    /// # Errors
    /// Nothing is left to try; the state is the last good one.
    pub(super) fn recover(&mut self, trouble: Trouble, frame: i64) -> Result<bool, StepError> {
        let contact = self.contacts.cloth.as_ref();
        let [collides, repels] = [contact.is_some_and(|c| c.keeps_free()), contact.is_some_and(|c| c.repels())];
        let next = self.care.next(trouble, [collides, repels]);
        let (garment, vertices) = self.blame(trouble);
        let Some(rung) = next else {
            let Trouble::NotFinite(stage) = trouble else { return Ok(false) };
            let vertex = vertices.first().map_or(0, |vertex| *vertex as usize);
            let (time, dt) = (self.cloth.state.time, self.care.dt);
            self.take_back();
            return Err(StepError::NotFinite { garment, vertex, frame, time, stage, dt });
        };
        let ranks = self.ranks().clone();
        self.metrics.count_once(&ranks, rung.count(), 1);
        if rung != Rung::Accepted {
            self.take_back();
        }
        if self.care.events.len() < KEPT {
            let (time, trouble, rung) = (self.cloth.state.time, trouble.word(), rung.count());
            self.care.events.push(Recovery { frame, time, trouble, rung, garment, vertices });
        }
        if rung == Rung::Accepted {
            return Ok(false);
        }
        self.climb(rung);
        Ok(true)
    }

    /// Makes the next attempt as the rung says.
    fn climb(&mut self, rung: Rung) {
        let Self { scene, care, contacts, .. } = self;
        care.rung = Some(rung);
        if rung == Rung::Shorter {
            (care.halvings, care.halved, care.calm) = (care.halvings + 1, care.halved + 1, 0);
        }
        if rung == Rung::Held {
            let parts = scene.parts();
            let is_held = |i: &usize| care.concerned.binary_search(&parts.number(*i)).is_ok();
            let takes_no_part =
                |i: &usize| scene.inert().is_some_and(|inert| inert.binary_search(&(*i as u32)).is_ok());
            care.held = Some(parts.own().filter(|i| is_held(i) || takes_no_part(i)).map(|i| i as u32).collect());
        }
        if let Some(contact) = &mut contacts.cloth {
            let effort = match rung {
                Rung::Shorter | Rung::Tighter => Effort::Usual,
                Rung::MoreAttempts => Effort::MoreAttempts,
                Rung::Zones | Rung::Thinner | Rung::Held | Rung::Accepted => Effort::Zones,
            };
            let is_thin = rung as usize >= Rung::Thinner as usize;
            contact.set_effort(effort, if is_thin { care.concerned.clone() } else { Vec::new() });
        }
    }

    /// Puts everything back to the start of the collision step.
    pub(super) fn take_back(&mut self) {
        if let Some(start) = self.care.start.as_ref() {
            self.cloth.state.x.clone_from(&start.x);
            self.cloth.state.v.clone_from(&start.v);
            self.cloth.state.time = start.time;
        }
        self.rewind();
        self.limit.forget_rate();
    }

    /// Finds the vertices concerned, on all ranks; returns some of those of the first garment among them.
    fn blame(&mut self, trouble: Trouble) -> (String, Vec<u32>) {
        let (scene, ranks) = (std::sync::Arc::clone(&self.scene), self.ranks().clone());
        let parts = scene.parts();
        let own: Vec<u32> = match trouble {
            Trouble::NotFinite(_) => {
                let found = self.cloth.scratch.not_finite(parts.own(), &self.cloth.state);
                found.into_iter().map(|i| parts.number(i)).collect()
            }
            Trouble::Stopped => self.contacts.cloth.as_ref().map_or_else(Vec::new, |c| c.stopped_vertices().to_vec()),
            Trouble::Wild | Trouble::Diverged => Vec::new(),
        };
        let mut all = ranks.all_gather_each(&own).concat();
        all.sort_unstable();
        all.dedup();
        self.care.concerned = all;
        if let (Trouble::Wild, Some(record)) = (trouble, self.largest_strain()) {
            return (record.garment, record.vertices.to_vec());
        }
        let mut named: Vec<[u32; 2]> = own_names(&self.care.concerned, parts);
        named = ranks.all_gather_each(&named).concat();
        named.sort_unstable();
        let Some([garment, _]) = named.first().copied() else { return (String::new(), Vec::new()) };
        let vertices = named.iter().filter(|[of, _]| *of == garment).map(|[_, vertex]| *vertex).take(NAMED).collect();
        (scene.description().garments[garment as usize].name.clone(), vertices)
    }
}

/// Garment and own number of the first of these vertices that this rank has.
fn own_names(numbers: &[u32], parts: &crate::parallel::parts::Parts) -> Vec<[u32; 2]> {
    let own = parts.own().filter(|i| numbers.binary_search(&parts.number(*i)).is_ok());
    let mut names: Vec<[u32; 2]> = own
        .map(|i| {
            let (garment, vertex) = parts.own_vertex(i);
            [garment as u32, vertex]
        })
        .collect();
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

    /// The rungs taken until none is left or the state is accepted.
    fn rungs(trouble: Trouble, scene: [bool; 2]) -> Vec<Rung> {
        let mut care = Care::default();
        let mut taken = Vec::new();
        while let Some(rung) = care.next(trouble, scene) {
            taken.push(rung);
            care.rung = Some(rung);
            if rung == Rung::Shorter {
                (care.halvings, care.halved) = (care.halvings + 1, care.halved + 1);
            }
        }
        taken
    }

    #[test]
    fn every_ladder_ends_and_only_what_is_not_finite_holds_vertices_or_gives_up() {
        use Rung::{Accepted, Held, MoreAttempts, Shorter, Thinner, Tighter, Zones};
        let broken = Trouble::NotFinite("B.1");
        assert_eq!(rungs(broken, [false; 2]), [vec![Shorter; 6], vec![Tighter, Held]].concat());
        let all = vec![Tighter, MoreAttempts, Zones, Thinner, Held];
        assert_eq!(rungs(broken, [true; 2]), [vec![Shorter; 6], all].concat());
        let contact = vec![MoreAttempts, Zones, Thinner, Accepted];
        assert_eq!(rungs(Trouble::Stopped, [true; 2]), [vec![Shorter; 2], contact].concat());
        assert_eq!(rungs(Trouble::Wild, [false; 2]), [vec![Shorter; 6], vec![Tighter, Accepted]].concat());
    }

    #[test]
    fn the_step_is_doubled_again_after_calm_collision_steps() {
        let mut care = Care::default();
        care.go_on([2, 0]);
        assert_eq!(care.part(), 0.25);
        care.go_on([u64::MAX, u64::MAX]);
        assert_eq!((care.saved(), care.part()), ([6, 3], 1.0 / 64.0));
    }
}
