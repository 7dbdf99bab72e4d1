//! Contacts with bodies inside the solves of the implicit step (`docs/theory/tr_bdf2.md#contact-in-the-solves`).
//!
//! Friction after a solve, vertex by vertex, asks how much a vertex can be stopped by its own mass. In a long step stiff cloth
//! is one piece: what stops a vertex has to hold the cloth that pulls at it as well. So each contact is in one of five modes
//! during a solve, and what it bears, the reaction that the solve leaves, says whether the mode was right:
//!
//! ```text
//! sticks   goes with the body's material                   right while J_n >= 0, |J_t| <= mu J_n
//! slips    goes with the body along its normal alone       right while J_n >= 0 and it slips; feels mu J_n against its slip
//! stops    slid, and has the body's velocity at the end    right while J_n >= 0, |J_t| <= mu J_n
//! free                                                     right while it stays outside
//! dragged  surfaces that leave it no room drag it along    until there is room
//! ```
//!
//! Modes that were wrong are changed and the solve goes on from where it was.

use std::borrow::Cow;
use std::ops::Range;

use crate::Vec3;
use crate::contact::bodies::constraints::MAX_BODY_CONTACTS;
use crate::long_steps::WRONG;
use crate::parallel::parts::Parts;
use crate::tolerances::{NO_DIRECTION, PINCH_DRAG, STANDARD_GRAVITY};

/// Behaviour of a vertex on the bodies that it touches.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum ContactMode {
    /// It goes with the body.
    Sticks,
    /// It slides; the unit direction of the friction that it feels.
    Slips(Vec3),
    /// It has slid in the step, or has come to the body in it, and has the body's velocity at the end of the stage.
    Stops,
    /// It leaves.
    Free,
    /// Surfaces that have passed through one another around it drag it along.
    Dragged,
}

/// A vertex on one body or between two.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ActiveContact {
    /// Local vertex.
    pub vertex: usize,
    /// Unit normals of the bodies, outwards; the second may be missing.
    pub normals: [Option<Vec3>; MAX_BODY_CONTACTS],
    /// Displacement by which the body carries the vertex in the step [m].
    pub carried: Vec3,
    /// Displacement along the normals, besides `carried`, that brings it onto the body at the end of the step [m].
    closing: Vec3,
    /// Whether it begins the step a little off the body: it rests on it only if the body bore it before.
    is_apart: bool,
    /// Velocity of the body there at the end of the step [m/s].
    pub velocity: Vec3,
    /// Coefficient of friction.
    pub friction: f64,
    /// Velocity along the body at the start of the step, relative to it [m/s].
    slip: Vec3,
    /// Mode of the contact.
    pub mode: ContactMode,
    /// Friction that the present solve was given, and what the body gave the vertex before it [N s].
    applied: Vec3,
    earlier: Vec3,
    /// Change of the velocity when the mode was last found to be wrong because of it [m/s], until that is judged.
    turned: Option<Vec3>,
}

/// The contacts of a rank's own vertices, ascending, as they are in the present stage.
#[derive(Debug, Default)]
pub(crate) struct ActiveSet {
    contacts: Vec<ActiveContact>,
    /// First contact of each part, and their number at the end.
    rows: Vec<usize>,
    /// See [`ActiveSet::is_settled`] and [`ActiveSet::is_wrong`].
    unsettled: bool,
    wrong: bool,
}

impl ActiveContact {
    /// A contact of a vertex that moves with `slip` relative to the body, in a step of `dt` [s]. One that friction under the
    /// vertex's own weight stops within the step sticks, as far as is known yet.
    pub(crate) fn new(vertex: usize, [carried, velocity]: [Vec3; 2], friction: f64, slip: Vec3, dt: f64) -> Self {
        let speed = slip.norm();
        let is_stopped = speed <= NO_DIRECTION || speed <= 0.5 * friction * STANDARD_GRAVITY * dt;
        let mode = if is_stopped && friction > 0.0 { ContactMode::Sticks } else { ContactMode::slips(-slip) };
        Self {
            vertex,
            normals: [None; MAX_BODY_CONTACTS],
            carried,
            closing: Vec3::zeros(),
            is_apart: false,
            velocity,
            friction,
            slip,
            mode,
            applied: Vec3::zeros(),
            earlier: Vec3::zeros(),
            turned: None,
        }
    }

    /// A vertex that surfaces with this velocity drag along [m/s].
    pub(crate) fn dragged(vertex: usize, velocity: Vec3) -> Self {
        let of_body = [Vec3::zeros(), velocity];
        Self { mode: ContactMode::Dragged, ..Self::new(vertex, of_body, 0.0, Vec3::zeros(), 0.0) }
    }

    /// Adds the normal of a body.
    pub(crate) fn with_normal(mut self, normal: Vec3) -> Self {
        if let Some(place) = self.normals.iter_mut().find(|n| n.is_none()) {
            *place = Some(normal);
        }
        self
    }

    /// Brings it to a body, along its normal [m]; `is_apart` says that it begins the step off the body.
    pub(crate) fn closing(mut self, normal: &Vec3, distance: f64, is_apart: bool) -> Self {
        self.closing += normal * (distance - self.closing.dot(normal));
        self.is_apart = is_apart;
        self
    }

    /// The normals, orthonormal, and their number.
    fn directions(&self) -> ([Vec3; MAX_BODY_CONTACTS], usize) {
        let mut found = [Vec3::zeros(); MAX_BODY_CONTACTS];
        let mut count = 0;
        for normal in self.normals.iter().flatten() {
            let free = found[..count].iter().fold(*normal, |n, other| n - other * n.dot(other));
            if let Some(free) = free.try_normalize(f64::EPSILON.sqrt()) {
                found[count] = free;
                count += 1;
            }
        }
        (found, count)
    }

    fn prescribe_along_normals(&self, value: &mut Vec3, prescribed: &Vec3) {
        let (directions, count) = self.directions();
        for direction in &directions[..count] {
            *value += direction * (prescribed - *value).dot(direction);
        }
    }

    /// Replaces what the contact prescribes of a velocity.
    pub(crate) fn prescribe(&self, value: &mut Vec3, prescribed: &Vec3) {
        match self.mode {
            ContactMode::Free | ContactMode::Dragged => {}
            ContactMode::Sticks | ContactMode::Stops => *value = *prescribed,
            ContactMode::Slips(_) => self.prescribe_along_normals(value, prescribed),
        }
    }

    /// Replaces what the contact prescribes of a position at a fraction of the step that the vertex begins at `start` [m].
    pub(crate) fn prescribe_position(&self, value: &mut Vec3, start: &Vec3, fraction: f64) {
        match self.mode {
            ContactMode::Free | ContactMode::Dragged => {}
            ContactMode::Sticks => *value = start + self.carried * fraction,
            ContactMode::Slips(_) | ContactMode::Stops => {
                self.prescribe_along_normals(value, &(start + (self.carried + self.closing) * fraction));
            }
        }
    }

    /// Whether a vertex that was let go is inside the body at a fraction of the step, by where that was to hold it.
    fn is_inside(&self, place: &Vec3, start: &Vec3, fraction: f64) -> bool {
        let off = place - (start + (self.carried + self.closing) * fraction);
        self.normals.iter().flatten().any(|normal| off.dot(normal) < 0.0)
    }

    /// Velocity of the body at a fraction of a step of `dt` [s], which its mean and that of the end say [m/s].
    pub(crate) fn velocity_at(&self, fraction: f64, dt: f64) -> Vec3 {
        let mean = self.carried / dt;
        mean + (self.velocity - mean) * (2.0 * fraction - 1.0)
    }

    /// Acceleration of the body in a step of `dt` [s], from its mean velocity and the one at the end [m/s²].
    fn body_acceleration(&self, dt: f64) -> Vec3 {
        (self.velocity - self.carried / dt) * (2.0 / dt)
    }

    /// Returns the velocity `v` at the start of a step as corrected by the body, which moves with `body` [m/s]: the
    /// vertex does not approach, and a vertex that sticks does not slip.
    pub(crate) fn start_velocity(&self, v: Vec3, body: &Vec3) -> Vec3 {
        let mut relative = v - body;
        match self.mode {
            ContactMode::Free | ContactMode::Stops | ContactMode::Dragged => {}
            ContactMode::Sticks => {
                let [first, second] = &self.normals;
                let along = |normal: &Vec3| normal * relative.dot(normal).max(0.0);
                relative =
                    if second.is_some() { Vec3::zeros() } else { first.as_ref().map_or_else(Vec3::zeros, along) };
            }
            ContactMode::Slips(_) => {
                for normal in self.normals.iter().flatten() {
                    relative -= normal * relative.dot(normal).min(0.0);
                }
            }
        }
        body + relative
    }

    /// Takes what the body gave the vertex at the start of a step of `dt` [s] for what it gives in it: the mode, and the friction of
    /// a stage of the length `duration` [s]. A body that gave nothing is still to be met, by what is apart from it.
    fn expect(&mut self, before: &StartOfContact, dt: f64, duration: f64) {
        if self.mode == ContactMode::Dragged {
            return;
        }
        let (push, _) = self.split(&before.force);
        if push <= if self.is_apart { before.doubt } else { 0.0 } {
            self.mode = if self.is_apart { ContactMode::Free } else { self.mode };
            return;
        }
        let (most, speed) = (self.friction * push, self.slip.norm());
        if most <= 0.0 {
            return;
        }
        // What slows down so fast that it comes to rest within half the step. How far one vertex could be stopped by its own
        // friction says nothing of cloth that is one piece.
        let slower = -(before.acceleration - self.body_acceleration(dt)).dot(&self.slip) / speed;
        self.mode = if speed <= NO_DIRECTION || speed <= 0.5 * slower * dt {
            ContactMode::Sticks
        } else {
            ContactMode::slips(-self.slip)
        };
        if let ContactMode::Slips(against) = self.mode {
            self.applied = against * (most * duration);
        }
    }

    /// Gives a vertex at `x` with `v`, where a solve of a stage has come to, another mode if it has turned round, or has come back into
    /// the body.
    fn turn(&mut self, at: &StageEnd<'_>, (start, x, v): (&Vec3, &mut Vec3, &mut Vec3)) -> bool {
        let body = self.velocity_at(at.fraction, at.dt);
        let mode = match self.mode {
            ContactMode::Slips(against) if at.reversal_test == ReversalTest::Positions => {
                let slid = *x - (start + self.carried * at.fraction);
                (slid.dot(&against) > 0.0).then_some(ContactMode::Sticks)
            }
            ContactMode::Slips(against) => ((*v - body).dot(&against) > 0.0).then_some(ContactMode::Stops),
            ContactMode::Free => self.is_inside(x, start, at.fraction).then_some(ContactMode::Stops),
            ContactMode::Sticks | ContactMode::Stops | ContactMode::Dragged => None,
        };
        let Some(mode) = mode else { return false };
        let change = body - *v;
        (self.mode, self.applied, self.turned) = (mode, Vec3::zeros(), Some(change));
        *v = body;
        *x += change * at.alpha;
        self.prescribe_position(x, start, at.fraction);
        true
    }

    /// The mode and the friction [N s] that fit a residual [N s], known to within `doubt` [N s]; the difference between the impulse of the
    /// body and the closest one that it can give, and the size of the impulse, both squared.
    fn judge(&self, residual: &Residual, doubt: f64) -> Judgement {
        if self.mode == ContactMode::Dragged {
            // A solve leaves nothing there that a body would have to give.
            return Judgement { mode: self.mode, applied: Vec3::zeros(), difference: 0.0, size: 0.0 };
        }
        // What slides has its friction in the residual; the body bears both.
        let reaction = self.earlier + self.applied - residual.evaluated;
        let (push, rest) = self.split(&reaction);
        let most = self.friction * push.max(0.0);
        let mode = match self.mode {
            _ if push < -doubt => ContactMode::Free,
            ContactMode::Sticks if rest.norm() > most + doubt => ContactMode::slips(rest),
            ContactMode::Stops if rest.norm() > most + doubt => ContactMode::slips(rest),
            mode => mode,
        };
        let (applied, difference) = match mode {
            ContactMode::Free => (Vec3::zeros(), reaction),
            ContactMode::Sticks | ContactMode::Stops | ContactMode::Dragged => (Vec3::zeros(), Vec3::zeros()),
            ContactMode::Slips(against) => {
                let (solved_push, _) = self.split(&(self.earlier + self.applied - residual.solved));
                let applied = against * most.min(self.friction * solved_push.max(0.0));
                (applied, applied - if mode == self.mode { self.applied } else { rest })
            }
        };
        Judgement { mode, applied, difference: difference.norm_squared(), size: reaction.norm_squared() }
    }

    /// Splits a reaction into its push along the normals, negative where a body would have to pull, and the rest.
    fn split(&self, reaction: &Vec3) -> (f64, Vec3) {
        let mut rest = *reaction;
        let mut push = f64::INFINITY;
        let mut sum = 0.0;
        for normal in self.normals.iter().flatten() {
            let along = rest.dot(normal);
            rest -= normal * along;
            push = push.min(along);
            sum += along;
        }
        (if push < 0.0 { push } else { sum }, rest)
    }
}

/// Accuracy to which the reactions of a solve are trusted.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Trust<'a> {
    /// Residual that the solve may have left at a vertex, over its mass [m/s], as far as modes stay as they are.
    pub tolerance: f64,
    /// Masses of the local vertices [kg].
    pub masses: &'a [f64],
    /// Fraction of all that bodies give by which it may be wrong.
    pub settled: f64,
}

/// Force and acceleration of a vertex in contact at the start of a step.
#[derive(Debug, Clone, Copy)]
pub(crate) struct StartOfContact {
    /// Force of the body on the vertex [N].
    pub force: Vec3,
    /// Error of `force` [N].
    pub doubt: f64,
    /// Acceleration of the vertex [m/s²].
    pub acceleration: Vec3,
}

/// Quantity that shows that a slip has turned round.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum ReversalTest {
    /// The velocity at the end of the stage.
    Velocities,
    /// The displacement since the start of the step.
    Positions,
}

/// The end of a stage, as contacts see it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct StageEnd<'a> {
    /// Positions of the local vertices at the start of the step [m].
    pub start: &'a [Vec3],
    /// Its time, as a fraction of the step.
    pub fraction: f64,
    /// Length of the step [s].
    pub dt: f64,
    /// Weight of velocities in positions [s].
    pub alpha: f64,
    /// Quantity that shows that a slip has turned round.
    pub reversal_test: ReversalTest,
}

/// Duration and masses from which the drag of surfaces in a stage follows.
#[derive(Debug, Clone, Copy)]
pub(crate) struct StageDrag<'a> {
    /// Time for which the drag acts in the stage [s].
    pub duration: f64,
    /// Masses of the local vertices [kg].
    pub masses: &'a [f64],
}

/// Residual of a vertex in contact: minus the reaction of its body [N s].
///
/// Pairs of a guess overlap by what the next solve takes back, and press the vertex up to a hundred times as hard as in the end. Those of the
/// solve before are as wrong where that has not come to its end. Friction of the smaller push throws no vertex sideways.
struct Residual {
    /// With the forces of pairs where the solve has come to.
    evaluated: Vec3,
    /// With the forces of pairs that the solve has found.
    solved: Vec3,
}

/// Assessment of a contact by its reaction.
struct Judgement {
    mode: ContactMode,
    /// Friction [N s].
    applied: Vec3,
    /// Difference of the reaction from one that the body can give, and size of the reaction, both squared.
    difference: f64,
    size: f64,
}

impl ContactMode {
    /// Sliding, with friction in this direction; none without one.
    fn slips(against: Vec3) -> Self {
        Self::Slips(against.try_normalize(NO_DIRECTION).unwrap_or_default())
    }
}

impl ActiveSet {
    /// Replaces the contacts: ascending by vertex, of own vertices.
    pub(crate) fn set(&mut self, parts: &Parts, contacts: Vec<ActiveContact>) {
        let row = |range: &Range<usize>| contacts.partition_point(|contact| contact.vertex < range.start);
        self.rows.clear();
        self.rows.extend(parts.ranges().iter().map(row));
        self.rows.push(contacts.len());
        self.contacts = contacts;
    }

    /// The contacts, ascending by vertex.
    pub(crate) fn contacts(&self) -> &[ActiveContact] {
        &self.contacts
    }

    /// The contacts of a part.
    pub(crate) fn of_part(&self, part: usize) -> &[ActiveContact] {
        self.rows.get(part).map_or(&[], |first| &self.contacts[*first..self.rows[part + 1]])
    }

    /// Memory held [bytes].
    pub(crate) fn bytes(&self) -> usize {
        size_of_val(self.contacts.as_slice()) + size_of_val(self.rows.as_slice())
    }

    /// Removes what contacts prescribe from a residual or direction of a part that begins at `start`.
    pub(crate) fn project(&self, part: usize, start: usize, r: &mut [Vec3]) {
        for contact in self.of_part(part) {
            contact.prescribe(&mut r[contact.vertex - start], &Vec3::zeros());
        }
    }

    /// The first guess of a step of `dt` [s], from what `before` says of the vertices of contacts at its start, and for the friction of
    /// a stage of the length `duration` [s]. Returns whether a mode has changed.
    pub(crate) fn expect(&mut self, dt: f64, duration: f64, before: impl Fn(usize) -> StartOfContact) -> bool {
        let mut changed = false;
        for contact in &mut self.contacts {
            let mode = contact.mode;
            contact.expect(&before(contact.vertex), dt, duration);
            changed |= contact.mode != mode;
        }
        changed
    }

    /// Changes the modes that positions and velocities of a stage show to be wrong, and puts what has stopped to rest on its body.
    /// Returns whether there was any.
    pub(crate) fn turn(&mut self, at: &StageEnd<'_>, x: &mut [Vec3], v: &mut [Vec3]) -> bool {
        let mut any = false;
        for contact in &mut self.contacts {
            let vertex = contact.vertex;
            any |= contact.turn(at, (&at.start[vertex], &mut x[vertex], &mut v[vertex]));
        }
        any
    }

    /// Replaces the accelerations at the end of a step of `dt` [s] along the normals of bodies by those of the bodies.
    pub(crate) fn prescribe_accelerations(&self, a: &mut [Vec3], dt: f64) {
        for contact in self.contacts.iter().filter(|contact| contact.mode != ContactMode::Free) {
            contact.prescribe_along_normals(&mut a[contact.vertex], &contact.body_acceleration(dt));
        }
    }

    /// Whether the last update found reactions of which more than [`WRONG`] is beyond Coulomb's law; the same on all ranks.
    pub(crate) fn is_wrong(&self) -> bool {
        self.wrong
    }

    /// Whether the last update found what bodies give to be what they can give; the same on all ranks.
    pub(crate) fn is_settled(&self) -> bool {
        !self.unsettled
    }

    /// Changes the modes that the reactions of a solve show to be wrong, and the friction of what slides.
    ///
    /// `residual` is what the next solve is to balance at each own vertex [N s]: minus the reaction. `solved` is the same with the forces of
    /// pairs that the solve before has found. The friction that comes or goes is added to `residual`, and what `restart` says of a contact
    /// whose mode has changed: by how much less the body gave its vertex before the solve. Returns the own parts in which the solve has to
    /// go on. All ranks call it together.
    pub(crate) fn update(
        &mut self,
        parts: &Parts,
        (residual, solved): (&mut [Vec3], &[Vec3]),
        trust: Trust<'_>,
        mut restart: impl FnMut(&ActiveContact) -> Vec3,
    ) -> Vec<bool> {
        let first = parts.own().start;
        // By part, so that their sums are the same on any number of ranks.
        let [mut differences, mut sizes] = [0, 1].map(|_| vec![0.0; parts.count()]);
        let mut part = 0;
        for contact in self.contacts.iter_mut().filter(|contact| contact.mode != ContactMode::Free) {
            while parts.ranges()[part].end <= contact.vertex {
                part += 1;
            }
            let (residual, solved) = (&mut residual[contact.vertex - first], solved[contact.vertex - first]);
            if let Some(change) = contact.turned.take() {
                // What the body gives here is not known before it was solved for.
                differences[part] += (change * trust.masses[contact.vertex]).norm_squared();
                continue;
            }
            let judgement = contact
                .judge(&Residual { evaluated: *residual, solved }, trust.tolerance * trust.masses[contact.vertex]);
            differences[part] += judgement.difference;
            sizes[part] += judgement.size;
            if judgement.mode != contact.mode {
                contact.mode = judgement.mode;
                let given_back = restart(contact);
                contact.earlier += given_back;
                *residual += given_back;
            }
            *residual += judgement.applied - contact.applied;
            contact.applied = judgement.applied;
        }
        let [difference, size] = parts.join_parts(&[&differences, &sizes]);
        let most = trust.settled * trust.settled;
        let is_settled = difference <= most * size;
        self.unsettled = !is_settled;
        self.wrong = difference > WRONG * WRONG * size;
        let of_parts = differences.iter().zip(&sizes);
        of_parts.map(|(difference, size)| !is_settled && *difference > most * size).collect()
    }

    /// Begins a stage with a share of the friction of the one before. `earlier` is what bodies have given vertices in it already
    /// [N s].
    pub(crate) fn begin_stage(&mut self, share: f64, earlier: impl Fn(usize) -> Vec3) {
        (self.unsettled, self.wrong) = (false, false);
        for contact in &mut self.contacts {
            contact.applied *= share;
            contact.turned = None;
            contact.earlier = earlier(contact.vertex);
        }
    }

    /// Adds the friction that the stage begins with to what its solve is to balance at the vertices of a part [N s], from the local
    /// number `first` on.
    pub(crate) fn add_friction(&self, part: usize, first: usize, residual: &mut [Vec3]) {
        self.of_part(part).iter().for_each(|contact| residual[contact.vertex - first] += contact.applied);
    }

    /// Adds the drag of surfaces to what a solve of a stage of the length `duration` [s] is to balance at the vertices of a part [N s], at
    /// their velocities `v` [m/s]; `first` is the local number of its first vertex.
    pub(crate) fn add_drag(&self, part: usize, first: usize, at: &StageDrag<'_>, v: &[Vec3], residual: &mut [Vec3]) {
        for contact in self.of_part(part).iter().filter(|contact| contact.mode == ContactMode::Dragged) {
            let vertex = contact.vertex;
            residual[vertex - first] += (contact.velocity - v[vertex]) * (PINCH_DRAG * at.duration * at.masses[vertex]);
        }
    }

    /// Masses of the local vertices with the drag of surfaces in the same stage: what a solve finds heavier by it [kg].
    pub(crate) fn masses_with_drag<'a>(&self, at: &StageDrag<'a>) -> Cow<'a, [f64]> {
        let mut masses = Cow::Borrowed(at.masses);
        for contact in self.contacts.iter().filter(|contact| contact.mode == ContactMode::Dragged) {
            masses.to_mut()[contact.vertex] *= 1.0 + PINCH_DRAG * at.duration;
        }
        masses
    }

    /// Whether a vertex goes with a body.
    pub(crate) fn holds(&self, vertex: usize) -> bool {
        let found = self.contacts.binary_search_by_key(&vertex, |contact| contact.vertex);
        found.is_ok_and(|at| self.contacts[at].mode != ContactMode::Free)
    }

    /// Adds contacts of vertices that do not go with a body yet or that surfaces drag from now on, ascending, and drops those that are
    /// free. Every rank calls it, also without new contacts, since parts with a contact are solved again.
    pub(crate) fn add(&mut self, parts: &Parts, met: Vec<ActiveContact>) {
        let is_dragged = |contact: &ActiveContact| contact.mode == ContactMode::Dragged;
        let is_new = |contact: &ActiveContact| is_dragged(contact) || !self.holds(contact.vertex);
        let mut all: Vec<ActiveContact> = met.into_iter().filter(is_new).collect();
        let is_replaced = |vertex: usize| all.binary_search_by_key(&vertex, |contact| contact.vertex).is_ok();
        let stays = |c: &&ActiveContact| c.mode != ContactMode::Free && !is_replaced(c.vertex);
        let kept: Vec<ActiveContact> = self.contacts.iter().filter(stays).copied().collect();
        all.extend(kept);
        all.sort_by_key(|contact| contact.vertex);
        self.set(parts, all);
    }

    /// Puts what friction has turned round in the step to rest on its body.
    pub(crate) fn stop_reversed(&self, value: &mut [Vec3], prescribed: impl Fn(&ActiveContact) -> Vec3) {
        for contact in &self.contacts {
            if let ContactMode::Slips(against) = contact.mode {
                let (value, body) = (&mut value[contact.vertex], prescribed(contact));
                let back = (*value - body).dot(&against);
                *value -= against * back.max(0.0);
            }
        }
    }
}

#[cfg(test)]
mod tests;
