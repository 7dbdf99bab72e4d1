//! Body collision: cloth vertices stay outside bodies and feel their friction (`docs/theory/friction.md`).
//!
//! Only vertices are tested: a body's edge sharper than the cloth's triangles can show through between them.
//!
//! Contact is found at the end of a step by signed distance, and along the path of the step where the vertex moved far
//! enough, relative to the body, to have passed through. A vertex between two surfaces that face each other closer than
//! their thicknesses keeps half the gap from each; where the surfaces have passed through one another (a body that
//! crosses itself) there is no outside: the contact is given up, and in a fold the surfaces around the vertex drag it along,
//! until there is an outside again. Both are counted.

mod active;
mod look_ahead;
mod marks;
mod pinch;
mod rules;
mod supports;
pub(crate) mod touch;

use std::ops::Range;

use rayon::prelude::*;

use crate::Vec3;
use crate::contact::bodies::constraints::MAX_BODY_CONTACTS;
use crate::contact::bodies::friction::{SurfaceContact, VertexMotion, respond};
use crate::contact::bodies::recovery_speed::RecoverySpeed;
use crate::contact::bodies::{Bodies, BodyContactProperties, BodyPoint};
use crate::geometry::moving_surface::Neighbourhood;
use crate::metrics::Metrics;
use crate::scene::Scene;
use crate::snapshot::saved_section::{Field, SavedSection, SectionId};

use marks::{CHUNK, Marks, bit, constrained};
use pinch::Pinch;
use rules::BodyRules;

/// Name of the effect.
pub(crate) const EFFECT: &str = "body_collision";

/// Identifier of the saved section with the distances of deforming bodies, which is absent without such bodies.
pub(crate) const SECTION: SectionId = SectionId { name: EFFECT, version: 1 };

/// Distance beyond contact within which surfaces are looked for, in mean edge lengths: vertices farther away are left alone
/// until they can have come closer.
const SEARCH_EDGES: f64 = 1.0;

/// Margin of the neighbourhoods in which vertices find the closest triangle, as a share of the distance of contact. Changes time only,
/// never an answer.
const NEIGHBOURHOOD: f64 = 0.5;

/// A body near a vertex at the end of a step.
#[derive(Debug, Clone, Copy)]
struct BodyContact {
    body: usize,
    at: BodyPoint,
    /// Distance at which this vertex is in contact [m]: the body's, or half a gap that is narrower.
    offset: f64,
    /// Whether the vertex was put there by the contact, and the normal velocity that the second solve keeps [m/s].
    constraint: Option<f64>,
    /// Coefficient of friction of this vertex there.
    friction: f64,
}

/// Bodies near one vertex.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct VertexContact {
    holds: [Option<BodyContact>; MAX_BODY_CONTACTS],
    /// The pinch by surfaces that leave it no room.
    pinching: Option<Pinch>,
}

/// Memory of a surface body near a vertex: it saves searches, and tells how deep the vertex was before.
#[derive(Debug, Clone, Copy)]
struct ClosestCache {
    /// The vertex is at least this far from contact's reference surface [m]; negative inside.
    clearance: f64,
    hint: u32,
    /// Triangles among which the next query looks first.
    around: Neighbourhood,
}

/// Counts of one pass.
#[derive(Debug, Clone, Copy, Default)]
struct Counts {
    contacts: u64,
    squeezed: u64,
    pinched: u64,
    along_path: u64,
    queries: u64,
}

/// The effect: contact state of the rank's own vertices.
#[derive(Debug)]
pub struct BodyCollision {
    /// Contacts of each chunk of vertices, none where no body is near any of them.
    contacts: Vec<Vec<VertexContact>>,
    /// Marks on the contacts that hold something.
    marks: Vec<Marks>,
    /// Surface bodies of each vertex, vertex by vertex.
    memory: Vec<ClosestCache>,
    /// For each body, its place among the surfaces of `memory`.
    memory_slot: Vec<Option<usize>>,
    surfaces: usize,
    /// Whether pins hold the vertex in all directions, so that no body can move it.
    held: Vec<bool>,
    /// Painted friction: what multiplies that of a body, and what is added; empty if none is painted.
    painted: Vec<[f64; 2]>,
    /// Contact by garment; `None` in scenes without rules for bodies.
    rules: Option<BodyRules>,
    /// Local number of the first own vertex.
    first: usize,
    search: f64,
    /// Own vertices that were pinched in the last step.
    pinched: u64,
}

/// The step as body collision sees it, over own vertices.
#[derive(Clone, Copy)]
pub struct CollisionStep<'a> {
    /// Bodies at both ends of the step.
    pub bodies: &'a Bodies,
    /// Length of the step [s].
    pub dt: f64,
    /// Limit on the distance by which cloth that is too deep comes out in the step.
    pub recovery_speed: RecoverySpeed,
    /// Positions at its start [m].
    pub x: &'a [Vec3],
    /// Velocities at its start [m/s].
    pub v: &'a [Vec3],
    /// Velocities of the half step [m/s].
    pub v_half: &'a [Vec3],
    /// True if the solves drag pinched vertices along with the surfaces that pinch them; else B.4 does.
    pub pinched_in_solves: bool,
}

impl BodyCollision {
    /// Contact of the rank's own vertices with the bodies of a scene.
    pub(crate) fn new(scene: &Scene) -> Self {
        let own = scene.parts().own();
        let vertices = own.len();
        let mut surfaces = 0;
        let mut memory_slot = Vec::new();
        for body in &scene.description().bodies {
            let deforming = matches!(body.shape, crate::scene::BodyShape::Surface { .. });
            memory_slot.push(deforming.then_some(surfaces));
            surfaces += usize::from(deforming);
        }
        Self {
            contacts: vec![Vec::new(); vertices.div_ceil(CHUNK)],
            marks: vec![Marks::default(); vertices.div_ceil(CHUNK)],
            memory: vec![
                ClosestCache { clearance: 0.0, hint: u32::MAX, around: Neighbourhood::NONE };
                vertices * surfaces
            ],
            memory_slot,
            surfaces,
            held: vec![false; vertices],
            painted: scene.painted_everywhere("friction").map_or_else(Vec::new, |all| all[own.clone()].to_vec()),
            rules: BodyRules::of(scene),
            first: own.start,
            search: SEARCH_EDGES * scene.mean_edge(),
            pinched: 0,
        }
    }

    /// Memory held [bytes].
    pub(crate) fn bytes(&self) -> usize {
        let contacts: usize = self.contacts.iter().map(Vec::capacity).sum();
        contacts * size_of::<VertexContact>()
            + self.held.len() * (1 + self.surfaces * size_of::<ClosestCache>())
            + self.marks.len() * (size_of::<Marks>() + size_of::<Vec<VertexContact>>())
            + size_of_val(self.painted.as_slice())
            + self.rules.as_ref().map_or(0, BodyRules::bytes)
    }

    /// Contact of an own vertex near a body, counted from the first.
    fn at_vertex(&self, vertex: usize) -> &VertexContact {
        &self.contacts[vertex / CHUNK][vertex % CHUNK]
    }

    /// Own vertices that are constrained or pinched, counted from the first, ascending.
    fn constrained_vertices(&self) -> impl Iterator<Item = usize> + '_ {
        constrained(&self.marks, 0..self.held.len())
    }

    /// Tells which own vertices, by their local numbers, are held in all directions during this step.
    pub(crate) fn set_held(&mut self, held: impl Iterator<Item = (usize, bool)>) {
        held.for_each(|(vertex, holds)| self.held[vertex - self.first] = holds);
    }

    /// Tells that an own vertex, by its local number, was moved by something else [m].
    pub fn moved(&mut self, vertex: usize, displacement: f64) {
        let vertex = vertex - self.first;
        let surfaces = vertex * self.surfaces..(vertex + 1) * self.surfaces;
        for memory in &mut self.memory[surfaces] {
            // What was outside is still taken to be outside, however close it may be now.
            let least = if memory.clearance >= 0.0 { 0.0 } else { f64::NEG_INFINITY };
            memory.clearance = (memory.clearance - displacement).max(least);
        }
    }

    /// The own vertices, by their local numbers, that surfaces pinch at the end of the step, ascending.
    pub(crate) fn pinched_now(&self) -> impl Iterator<Item = usize> + '_ {
        let pinched = self.constrained_vertices().filter(|vertex| self.at_vertex(*vertex).pinching.is_some());
        pinched.map(|vertex| self.first + vertex)
    }

    /// Whether surfaces pinch an own vertex, by its local number.
    pub(crate) fn is_pinched(&self, vertex: usize) -> bool {
        let own = vertex - self.first;
        self.is_constrained(vertex..vertex + 1) && self.at_vertex(own).pinching.is_some()
    }

    /// Own vertices that bodies pinched in the last step.
    pub(crate) fn pinched(&self) -> u64 {
        self.pinched
    }

    /// Returns the memory of deforming bodies near each vertex; `None` without such bodies.
    pub(crate) fn save(&self) -> Option<SavedSection> {
        let clearances = self.memory.iter().map(|memory| memory.clearance).collect();
        let field = Field::vertices(self.surfaces, clearances);
        (self.surfaces > 0).then(|| SavedSection::new(SECTION).with("clearances", field))
    }

    /// Goes on from what was remembered.
    pub(crate) fn restore(&mut self, memory: &SavedSection) {
        for (memory, clearance) in self.memory.iter_mut().zip(memory.values("clearances")) {
            memory.clearance = *clearance;
        }
    }

    /// Forgets where vertices were: the state has been put back.
    pub(crate) fn forget(&mut self) {
        self.memory.iter_mut().for_each(|memory| memory.clearance = 0.0);
    }

    /// B.4: corrects the velocities that the step started with (`v_star`, those of B.3 before) and the positions at its end (`x1`,
    /// likewise).
    ///
    /// First the velocity alone (`v_star`), from where the vertex would go with `v_half`; then the position, from where it
    /// goes with the corrected velocity plus what the half step added.
    pub fn positions(&mut self, step: &CollisionStep<'_>, x1: &mut [Vec3], v_star: &mut [Vec3], metrics: &mut Metrics) {
        let (slots, painted, rules) = (&self.memory_slot, self.painted.as_slice(), self.rules.as_ref());
        let (search, surfaces) = (self.search, self.surfaces);
        let chunks = x1.par_chunks_mut(CHUNK).zip(v_star.par_chunks_mut(CHUNK));
        let contacts = self.contacts.par_iter_mut().zip(&mut self.marks);
        let chunks = chunks.zip(contacts).zip(self.held.par_chunks(CHUNK)).enumerate();
        let work = |(c, (((x1, v_star), (contacts, marks)), held)): Chunk<'_>, memory: &mut [ClosestCache]| {
            let mut counts = Counts::default();
            *marks = Marks::default();
            for i in 0..x1.len() {
                let vertex = c * CHUNK + i;
                if !held[i] {
                    let memory = &mut memory[i * surfaces..(i + 1) * surfaces];
                    let own_way = (step.v[vertex].norm() + step.v_half[vertex].norm()) * step.dt;
                    let known = [QueryCache::NOTHING; CACHED];
                    let counts = &mut counts;
                    let properties = rules.map_or(step.bodies.properties(), |rules| rules.of_vertex(vertex));
                    let mut search =
                        Search { step, slots, painted, properties, search, memory, counts, own_way, known };
                    if search.is_far_from_all(&step.x[vertex], &x1[i]) {
                        search.remember(&step.x[vertex], &x1[i]);
                    } else {
                        let mut contact = VertexContact::default();
                        search.vertex(vertex, &mut x1[i], &mut v_star[i], &mut contact);
                        if marks.note(i, &contact) {
                            contacts.resize(x1.len(), VertexContact::default());
                            contacts[i] = contact;
                        }
                    }
                }
            }
            if marks.are_none() {
                *contacts = Vec::new();
            }
            counts
        };
        let counts = if surfaces == 0 {
            chunks.map(|chunk| work(chunk, &mut [])).reduce(Counts::default, Counts::plus)
        } else {
            let memory = self.memory.par_chunks_mut(CHUNK * surfaces);
            chunks.zip(memory).map(|(chunk, memory)| work(chunk, memory)).reduce(Counts::default, Counts::plus)
        };
        self.pinched = counts.pinched;
        metrics.count("body_contacts", counts.contacts);
        metrics.count("body_squeezed", counts.squeezed);
        metrics.count("body_pinched", counts.pinched);
        metrics.count("body_contacts_along_path", counts.along_path);
        metrics.count("body_queries", counts.queries);
    }

    /// Gives the vertices in contact, from the local number `start` on, their normal velocity: the initial guess of the
    /// second solve.
    pub(crate) fn set_velocities(&self, start: usize, v: &mut [Vec3]) {
        let start = start - self.first;
        for vertex in constrained(&self.marks, start..start + v.len()) {
            let v = &mut v[vertex - start];
            for (normal, target) in self.at_vertex(vertex).constraints() {
                *v += normal * (target - v.dot(&normal));
            }
        }
    }

    /// Removes the contact normals from a residual or search direction.
    pub fn project(&self, start: usize, r: &mut [Vec3]) {
        let start = start - self.first;
        for vertex in constrained(&self.marks, start..start + r.len()) {
            let r = &mut r[vertex - start];
            for (normal, _) in self.at_vertex(vertex).orthogonal_constraints() {
                *r -= normal * r.dot(&normal);
            }
        }
    }

    /// Whether some vertex of this range of local numbers, all own, is constrained by a contact.
    pub(crate) fn is_constrained(&self, vertices: Range<usize>) -> bool {
        let own = vertices.start - self.first..vertices.end - self.first;
        constrained(&self.marks, own).next().is_some()
    }
}

/// Number of a chunk; its positions, velocities, contacts with marks, and which of its vertices are held.
type Chunk<'a> = (usize, (((&'a mut [Vec3], &'a mut [Vec3]), (&'a mut Vec<VertexContact>, &'a mut Marks)), &'a [bool]));

impl Counts {
    fn plus(self, other: Self) -> Self {
        Self {
            contacts: self.contacts + other.contacts,
            squeezed: self.squeezed + other.squeezed,
            pinched: self.pinched + other.pinched,
            along_path: self.along_path + other.along_path,
            queries: self.queries + other.queries,
        }
    }
}

impl Marks {
    /// Marks the contact of vertex i of the chunk. Returns whether it holds something.
    fn note(&mut self, i: usize, contact: &VertexContact) -> bool {
        let is_near = contact.holds[0].is_some();
        self.near |= if is_near { bit(i) } else { 0 };
        let is_constrained = contact.pinching.is_some() || contact.constraints().next().is_some();
        self.constrained |= if is_constrained { bit(i) } else { 0 };
        is_near || is_constrained
    }
}

impl VertexContact {
    /// Normals and the normal velocities they are to have.
    fn constraints(&self) -> impl Iterator<Item = (Vec3, f64)> + '_ {
        self.holds.iter().flatten().filter_map(|hold| hold.constraint.map(|target| (hold.at.normal, target)))
    }

    /// The same directions made orthogonal, so that removing one does not bring back another.
    fn orthogonal_constraints(&self) -> impl Iterator<Item = (Vec3, f64)> + '_ {
        let mut before: Option<Vec3> = None;
        self.constraints().filter_map(move |(normal, target)| {
            let free = before.map_or(normal, |b| normal - b * normal.dot(&b));
            let free = free.try_normalize(f64::EPSILON.sqrt())?;
            before = Some(free);
            Some((free, target))
        })
    }

    fn add(&mut self, hold: BodyContact) {
        // A body that holds the vertex already is replaced: the later answer is the better one.
        let same = self.holds.iter().position(|h| h.is_some_and(|h| h.body == hold.body));
        let free = same.or_else(|| self.holds.iter().position(Option::is_none));
        if let Some(place) = free {
            self.holds[place] = Some(hold);
        }
    }
}

/// Bodies of which something is kept while one vertex is worked on.
const CACHED: usize = 4;

/// Answers kept for a body and one vertex, so that no query is made twice.
#[derive(Clone, Copy)]
struct QueryCache {
    body: usize,
    /// Distance that the vertex can move in this step without a contact or a hold of the body [m]; for rigid bodies.
    room: f64,
    /// Distance of the body at the start of the step [m]; for rigid bodies.
    at_start: Option<f64>,
    /// The last place asked for, and the answer.
    answer: Option<(Vec3, Option<BodyPoint>)>,
}

impl QueryCache {
    const NOTHING: Self = Self { body: usize::MAX, room: 0.0, at_start: None, answer: None };
}

/// The last contact that corrected a vertex, and the place just outside that surface.
#[derive(Clone, Copy)]
struct LastContact {
    body: usize,
    at: BodyPoint,
    outside: Vec3,
}

/// The search for contacts of one vertex.
struct Search<'a> {
    step: &'a CollisionStep<'a>,
    slots: &'a [Option<usize>],
    painted: &'a [[f64; 2]],
    /// Contact of the vertex with each body.
    properties: &'a [BodyContactProperties],
    search: f64,
    memory: &'a mut [ClosestCache],
    counts: &'a mut Counts,
    /// Farthest that the vertex itself can get in this step, bodies apart [m].
    own_way: f64,
    known: [QueryCache; CACHED],
}

impl Search<'_> {
    fn vertex(&mut self, vertex: usize, x1: &mut Vec3, v_star: &mut Vec3, contact: &mut VertexContact) {
        let step = *self.step;
        let (x, dt) = (&step.x[vertex], step.dt);
        let before = *x1;
        // Velocity pass.
        let mut met = false;
        for body in 0..self.properties.len() {
            if let Some(at) = self.contact(body, x, &before) {
                if self.is_passed_through(vertex, (body, &at), &before) {
                    self.counts.contacts += 1;
                    self.release(vertex, Pinch { drag: None }, &before, (x1, v_star, contact));
                    self.remember(x, x1);
                    return;
                }
                let properties = &self.properties[body];
                let friction = properties.friction_on(self.painted.get(vertex));
                let contact = SurfaceContact { body: properties, at: &at, friction };
                let motion = VertexMotion { x_old: x, x: &before, velocity: v_star, dt };
                *v_star = respond(&contact, &motion, step.recovery_speed).velocity;
                met = true;
            }
        }
        // Position pass.
        let tentative = if met { x + (*v_star + (step.v_half[vertex] - step.v[vertex])) * dt } else { before };
        *x1 = tentative;
        let mut touched = None;
        for body in 0..self.properties.len() {
            if let Some(at) = self.contact(body, x, x1) {
                let properties = &self.properties[body];
                let outside = *x1 + at.normal * (properties.offset - properties.thickness - at.phi);
                let friction = properties.friction_on(self.painted.get(vertex));
                let surface = SurfaceContact { body: properties, at: &at, friction };
                let motion = VertexMotion { x_old: x, x: x1, velocity: v_star, dt };
                let response = respond(&surface, &motion, step.recovery_speed);
                *x1 = response.position;
                touched = Some(LastContact { body, at, outside });
                let constraint = Some(response.normal_velocity);
                contact.add(BodyContact { body, at, offset: 0.0, constraint, friction });
            }
        }
        self.counts.contacts += u64::from(touched.is_some());
        if let Some(pinch) = self.resolve_pinch(vertex, x, x1, contact, touched) {
            self.release(vertex, pinch, &before, (x1, v_star, contact));
        }
        self.remember(x, x1);
    }

    /// Farthest that the vertex and a surface can approach in this step [m].
    fn relative_displacement(&self, body: usize) -> f64 {
        self.own_way + self.step.bodies.fastest(body) * self.step.dt
    }

    /// Returns the radius of the search for a surface [m]; `None` where the vertex cannot touch it in this step.
    fn reach(&self, body: usize, slot: usize) -> Option<f64> {
        let (offset, displacement) = (self.properties[body].offset, self.relative_displacement(body));
        let clearance = self.memory[slot].clearance;
        let reach = offset + self.search + 2.0 * displacement + (-clearance).max(0.0);
        (clearance <= offset + 2.0 * displacement).then_some(reach)
    }

    /// Returns the kept answers for a body; `x` is the position of the vertex at the start of the step.
    fn known(&mut self, body: usize, x: &Vec3) -> &mut QueryCache {
        let known = &mut self.known[body % CACHED];
        if known.body != body {
            let (bounds, offset) = (self.step.bodies.bounds(body, x), self.properties[body].offset);
            let room = bounds.map_or(0.0, |b| {
                // At the end the distance is less by at most the way relative to the body; there it has to exceed that
                // of contact and of a hold (`resolve_pinch`).
                b.distance - b.displacement - offset - 2.0 * (self.own_way + b.displacement)
            });
            *known = QueryCache { body, room, ..QueryCache::NOTHING };
        }
        known
    }

    /// Whether a body provably has nothing to do with the vertex in this step, which goes from `x` to `to`: no contact
    /// at the end or along the path, and no hold.
    fn is_far(&mut self, body: usize, x: &Vec3, to: &Vec3) -> bool {
        if self.properties[body].is_ignored {
            return true;
        }
        match self.slots[body] {
            Some(slot) => self.reach(body, slot).is_none(),
            None => {
                let room = self.known(body, x).room;
                room > 0.0 && (to - x).norm_squared() < room * room
            }
        }
    }

    fn is_far_from_all(&mut self, x: &Vec3, to: &Vec3) -> bool {
        (0..self.slots.len()).all(|body| self.is_far(body, x, to))
    }

    /// The nearest place of a body to `place`, if the vertex can touch the body in this step.
    fn nearest(&mut self, body: usize, from: &Vec3, place: &Vec3) -> Option<BodyPoint> {
        if self.is_far(body, from, place) {
            return None;
        }
        if let Some((_, found)) = self.known(body, from).answer.filter(|(asked, _)| asked == place) {
            return found;
        }
        let bodies = self.step.bodies;
        let found = match self.slots[body] {
            Some(slot) => {
                let reach = self.reach(body, slot)?;
                self.closest_on_surface((body, slot), place, reach)
            }
            None => bodies.closest(body, from, place, f64::INFINITY, None),
        };
        self.known(body, from).answer = Some((*place, found));
        if let (Some(slot), Some(at)) = (self.slots[body], found) {
            self.memory[slot].hint = at.triangle;
        }
        found
    }

    /// Distance of a body at the start of the step [m], where the vertex was at `x`.
    fn distance_at_start(&mut self, body: usize, x: &Vec3) -> f64 {
        let bodies = self.step.bodies;
        match self.slots[body] {
            Some(slot) => self.memory[slot].clearance,
            None => *self.known(body, x).at_start.get_or_insert_with(|| bodies.distance_at_start(body, x)),
        }
    }

    /// Distance of a surface at the start of the step [m], where the vertex was at `x`, instead of the lower `bound` known of it. The
    /// surface stands at its end, so the vertex is moved along with its closest point `at`. The distance of other bodies is known.
    fn measured_at_start(&mut self, body: usize, x: &Vec3, at: &BodyPoint, bound: f64) -> f64 {
        let Some(slot) = self.slots[body] else { return bound };
        let Some(reach) = self.reach(body, slot) else { return bound };
        self.closest_on_surface((body, slot), &(x + at.displacement), reach).map_or(reach, |found| found.phi)
    }

    /// The closest place of a surface to `place` within `reach` [m].
    fn closest_on_surface(&mut self, (body, slot): (usize, usize), place: &Vec3, reach: f64) -> Option<BodyPoint> {
        // Also where a neighbourhood answers: a resumed run has others.
        self.counts.queries += 1;
        let margin = NEIGHBOURHOOD * self.properties[body].offset;
        let ClosestCache { hint, around, .. } = &mut self.memory[slot];
        self.step.bodies.closest_near(body, place, (reach, margin), Some(*hint), around)
    }

    /// Finds the place where a vertex that goes from `x` to `to` touches a body, if it does.
    fn contact(&mut self, body: usize, x: &Vec3, to: &Vec3) -> Option<BodyPoint> {
        if self.is_far(body, x, to) {
            return None;
        }
        let (bodies, properties) = (self.step.bodies, &self.properties[body]);
        let at_end = self.nearest(body, x, to);
        let at_start = self.distance_at_start(body, x);
        // Having passed through takes a way longer than the distance to the surface at the start; a short way behind it
        // is seen by the signed distance at the end.
        let travelled = at_end.map_or(self.relative_displacement(body), |at| (to - x - at.displacement).norm());
        let may_have_passed = at_start >= 0.0 && travelled > at_start + 0.5 * properties.thickness;
        let at_entry = if may_have_passed { bodies.entry(body, x, to, properties.thickness) } else { None };
        let found = match (at_end, at_entry) {
            (Some(end), Some(entry)) if end.phi >= properties.offset || end.normal.dot(&entry.normal) < 0.5 => {
                self.counts.along_path += 1;
                entry
            }
            (None, Some(entry)) => {
                self.counts.along_path += 1;
                entry
            }
            (Some(end), _) => end,
            (None, None) => return None,
        };
        (found.phi < properties.offset).then_some(found)
    }

    /// Notes how far the vertex is from the surfaces now.
    fn remember(&mut self, x: &Vec3, x1: &Vec3) {
        for body in 0..self.slots.len() {
            let Some(slot) = self.slots[body] else { continue };
            self.memory[slot].clearance = match self.reach(body, slot) {
                Some(reach) => self.nearest(body, x, x1).map_or(reach, |at| at.phi),
                None => self.memory[slot].clearance - self.relative_displacement(body),
            };
        }
    }
}
