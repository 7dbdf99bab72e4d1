//! Choice of the contacts that take part in the solves of an implicit step.

use rayon::prelude::*;

use super::marks::CHUNK;
use super::{BodyCollision, CACHED, CollisionStep, Counts, LastContact, QueryCache, SEARCH_EDGES, Search};
use crate::Vec3;
use crate::contact::bodies::active_set::ActiveContact;
use crate::contact::bodies::constraints::MAX_BODY_CONTACTS;
use crate::long_steps::{LEAVING, RESTING_GAP, SLID_OFF, SLID_OFF_LAYER};

/// Gap of a vertex that a body bears [m]; `search` is the radius of the search, `layer` the thickness that layers keep there, if they do.
fn slid_off(search: f64, layer: Option<f64>) -> f64 {
    let of_edges = SLID_OFF * search / SEARCH_EDGES;
    layer.map_or(of_edges, |thickness| of_edges.min(SLID_OFF_LAYER * thickness))
}

impl BodyCollision {
    /// The vertices that rest on bodies at the start of the step and do not leave them at once, ascending. `step.v_half` are the
    /// velocities that they are expected to go with, `layers` the thickness that layers keep at each own vertex, if they do [m].
    pub(crate) fn resting(&mut self, step: &CollisionStep<'_>, layers: Option<&[f64]>) -> Vec<ActiveContact> {
        let (slots, painted, rules) = (&self.memory_slot, self.painted.as_slice(), self.rules.as_ref());
        let (search, surfaces, first) = (self.search, self.surfaces, self.first);
        let of_vertex = |vertex: usize, memory: &mut [super::ClosestCache]| {
            let (x, v_half) = (&step.x[vertex], &step.v_half[vertex]);
            // A vertex at rest has no displacement, and a body within this gap is not far from it.
            let slid_off = slid_off(search, layers.map(|layers| layers[vertex]));
            let own_way = (step.v[vertex].norm() + v_half.norm()) * step.dt + slid_off;
            let known = [QueryCache::NOTHING; CACHED];
            let mut counts = Counts::default();
            let properties = rules.map_or(step.bodies.properties(), |rules| rules.of_vertex(vertex));
            let counts = &mut counts;
            let mut search = Search { step, slots, painted, properties, search, memory, counts, own_way, known };
            let end = x + v_half * step.dt;
            if search.is_far_from_all(x, &end) { None } else { search.resting([first, vertex], &end, slid_off) }
        };
        let chunks = self.held.par_chunks(CHUNK).enumerate();
        let of_chunk = |c: usize, held: &[bool], memory: &mut [super::ClosestCache]| -> Vec<ActiveContact> {
            let free = held.iter().enumerate().filter(|(_, held)| !**held);
            free.filter_map(|(i, _)| of_vertex(c * CHUNK + i, &mut memory[i * surfaces..(i + 1) * surfaces])).collect()
        };
        let found: Vec<Vec<ActiveContact>> = if surfaces == 0 {
            chunks.map(|(c, held)| of_chunk(c, held, &mut [])).collect()
        } else {
            let memory = self.memory.par_chunks_mut(CHUNK * surfaces);
            chunks.zip(memory).map(|((c, held), memory)| of_chunk(c, held, memory)).collect()
        };
        found.concat()
    }

    /// The vertices that B.4 has put outside of bodies or finds pinched, ascending, as contacts of the second solve; `v` are the velocities that
    /// B.4 has left own vertices, in a step of `dt` [s].
    pub(crate) fn met(&self, v: &[Vec3], dt: f64) -> Vec<ActiveContact> {
        let of_vertex = |vertex: usize| {
            if let Some(pinch) = self.at_vertex(vertex).pinching {
                return pinch.drag.map(|velocity| ActiveContact::dragged(self.first + vertex, velocity));
            }
            let mut holds = self.at_vertex(vertex).holds.iter().flatten().filter(|hold| hold.constraint.is_some());
            let first = holds.next()?;
            let motion = [first.at.displacement, first.at.velocity];
            let relative = v[vertex] - first.at.velocity;
            let slip = relative - first.at.normal * relative.dot(&first.at.normal);
            let contact = ActiveContact::new(self.first + vertex, motion, first.friction, slip, dt);
            Some(holds.fold(contact.with_normal(first.at.normal), |contact, hold| contact.with_normal(hold.at.normal)))
        };
        self.constrained_vertices().filter_map(of_vertex).collect()
    }
}

impl Search<'_> {
    /// The bodies that a vertex rests on, if it goes to `end`, or the surfaces that drag it along. A body bears it up to a gap of `slid_off` [m].
    fn resting(&mut self, [first, vertex]: [usize; 2], end: &Vec3, slid_off: f64) -> Option<ActiveContact> {
        let step = *self.step;
        let (x, v, dt) = (&step.x[vertex], &step.v[vertex], step.dt);
        let mut found: Option<ActiveContact> = None;
        let (mut count, mut touched) = (0, None);
        for body in 0..self.properties.len() {
            let properties = &self.properties[body];
            let (offset, gap) = (properties.offset, properties.offset - properties.thickness);
            let resting = offset + gap.max(RESTING_GAP * offset);
            let farthest = resting.max(offset + slid_off);
            let at_start = self.distance_at_start(body, x);
            if count == MAX_BODY_CONTACTS || at_start > farthest {
                continue;
            }
            let Some(at) = self.nearest(body, x, end) else { continue };
            let closing = (end - x - at.displacement).dot(&at.normal) - (at.phi - offset);
            // The distance of a surface may be a bound from before the vertex came near. The tangent plane shows where it is.
            let is_farther = offset - closing > farthest;
            let at_start = if is_farther { self.measured_at_start(body, x, &at, at_start) } else { at_start };
            if at_start > farthest {
                continue;
            }
            if at.phi < properties.thickness {
                let touch = LastContact { body, at, outside: end + at.normal * (gap - at.phi) };
                if let Some(pinch) = self.pinching(vertex, &touch, touched.as_ref(), end) {
                    return pinch.drag.map(|velocity| ActiveContact::dragged(first + vertex, velocity));
                }
                touched = Some(touch);
            }
            let relative = v - at.displacement / dt;
            let leaves = relative.dot(&at.normal);
            if at.phi > resting + (LEAVING * offset).max(slid_off) || leaves * dt > (LEAVING * offset).max(slid_off) {
                continue;
            }
            // The plane of the place where it is expected; what is too deep is for B.4.
            let closing = if closing < -gap { closing } else { 0.0 };
            let contact = found.unwrap_or_else(|| {
                let friction = properties.friction_on(self.painted.get(vertex));
                let slip = relative - at.normal * leaves;
                ActiveContact::new(first + vertex, [at.displacement, at.velocity], friction, slip, dt)
            });
            let is_apart = at_start > resting || leaves * dt > LEAVING * offset || at.phi > resting + LEAVING * offset;
            found = Some(contact.with_normal(at.normal).closing(&at.normal, closing, is_apart));
            count += 1;
        }
        found
    }
}
