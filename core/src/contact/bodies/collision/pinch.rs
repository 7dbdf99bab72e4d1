//! Vertices that two surfaces leave no room: in a narrow gap, or where the surfaces have passed through one another.
//!
//! In a fold between surfaces that have passed through one another a vertex is dragged along with their mean velocity until there is room
//! again.
//! D. Baraff, A. Witkin and M. Kass, "Untangling Cloth", SIGGRAPH 2003, section 5, prescribe that motion; a drag leaves cloth that is
//! half pinched unstretched. Where a part passes through another one fast, the cloth around the vertex holds it alone.

use super::{BodyContact, CollisionStep, LastContact, Search, VertexContact};
use crate::Vec3;
use crate::contact::bodies::BodyPoint;
use crate::tolerances::{FACING, PINCH_DRAG};

/// A vertex that surfaces leave no room: it passes through them.
#[derive(Debug, Clone, Copy)]
pub(super) struct Pinch {
    /// Velocity of the surfaces that drag it along [m/s]; `None` where a part that is deep inside another one leaves it to the cloth around.
    pub drag: Option<Vec3>,
}

/// The room between two surfaces that face each other.
struct Gap {
    /// Distance that the vertex is to keep from the first surface [m].
    room: f64,
    /// Distance between the surfaces [m]; negative where they have passed through one another.
    width: f64,
    /// The place at that distance.
    between: Vec3,
}

impl LastContact {
    /// Whether the surface at another place faces this one.
    fn faces(&self, other: &BodyPoint) -> bool {
        other.normal.dot(&self.at.normal) < FACING
    }
}

impl Search<'_> {
    /// After the corrections: narrows contacts in a pinch, and notes which bodies are near for B.7. Where the surfaces have
    /// passed through one another the contacts are given up.
    pub(super) fn resolve_pinch(
        &mut self,
        vertex: usize,
        x: &Vec3,
        x1: &mut Vec3,
        contact: &mut VertexContact,
        touched: Option<LastContact>,
    ) -> Option<Pinch> {
        if let Some(touch) = &touched
            && let Some(pinch) = self.by_parts(vertex, touch, x1)
        {
            return Some(pinch);
        }
        let mut squeezed = None;
        for body in 0..self.properties.len() {
            let properties = &self.properties[body];
            let constraint = contact.holds.iter().flatten().find(|h| h.body == body).and_then(|h| h.constraint);
            let Some(mut at) = self.nearest(body, x, x1) else { continue };
            let mut offset = squeezed.unwrap_or(properties.offset).min(properties.offset);
            let facing = touched.filter(|touch| at.phi < properties.thickness && touch.faces(&at));
            if let Some(touch) = facing {
                let (first_at, gap) = (touch.at, self.gap(&touch, &at, x1));
                if let Some(velocity) = self.between_bodies(&touch, (body, &at), &gap) {
                    return Some(Pinch { drag: Some(velocity) });
                }
                let Gap { room, between, .. } = gap;
                self.counts.squeezed += 1;
                // Other layers may stand in its way, and would be struck with distance/dt.
                let carried = x + (first_at.displacement + at.displacement) * 0.5;
                let distance = (between - carried).dot(&first_at.normal);
                let made_up = self.step.recovery_speed.of(distance.abs()).copysign(distance);
                *x1 = between - first_at.normal * (distance - made_up);
                (offset, squeezed) = (room, Some(room));
                let Some(found) = self.nearest(body, x, x1) else { continue };
                at = found;
            } else if squeezed.is_none() && constraint.is_some() && at.phi < properties.thickness {
                // The surface is curved: what the tangent plane left too deep is moved straight out.
                let CollisionStep { dt, recovery_speed, .. } = *self.step;
                let deep = properties.depenetration(properties.offset - at.phi, dt, recovery_speed);
                *x1 += at.normal * deep;
                at.phi += deep;
            }
            // B.7 looks ahead, and would give the vertex the velocity of a part that is about to pass through it.
            let is_ahead = || {
                at.phi < offset + 2.0 * (self.own_way + at.displacement.norm())
                    && !self.is_passed_through(vertex, (body, &at), x1)
            };
            if constraint.is_some() || is_ahead() {
                let friction = properties.friction_on(self.painted.get(vertex));
                contact.add(BodyContact { body, at, offset, constraint, friction });
            }
        }
        None
    }

    /// Gives up the contacts of a vertex, which goes to `free` if nothing drags it.
    pub(super) fn release(
        &mut self,
        vertex: usize,
        pinch: Pinch,
        free: &Vec3,
        (x1, v_star, contact): (&mut Vec3, &mut Vec3, &mut VertexContact),
    ) {
        let (x, v, v_half) = (&self.step.x[vertex], &self.step.v[vertex], &self.step.v_half[vertex]);
        self.counts.pinched += 1;
        *contact = VertexContact { pinching: Some(pinch), ..VertexContact::default() };
        (*v_star, *x1) = (*v, *free);
        if let Some(surroundings) = pinch.drag.filter(|_| !self.step.pinched_in_solves) {
            // Springs move it freely, its weight does not carry it away.
            let kept = libm::exp(-PINCH_DRAG * self.step.dt);
            *v_star = surroundings + (v - surroundings) * kept;
            *x1 = x + (*v_star + (v_half - v)) * self.step.dt;
        }
    }

    /// The gap between the surface that a vertex at `x` has touched and one that faces it.
    fn gap(&self, touch: &LastContact, facing: &BodyPoint, x: &Vec3) -> Gap {
        let LastContact { body: first, at, outside } = touch;
        let first = &self.properties[*first];
        // Less than contact asks for where what was too deep before comes out at a limited speed.
        let away = first.offset - first.thickness + (x - outside).dot(&at.normal);
        let width = away + facing.phi;
        // In the apex of a crease there is no room for half a gap, but the surface itself is still outside.
        let room = if width > 0.0 { 0.5 * width } else { first.offset - first.thickness };
        Gap { room, width, between: x - at.normal * (away - room) }
    }

    /// Whether a vertex at `x` that is near this place of a body is in the way of a part that goes fast into another one or comes out of it.
    /// It must not take the velocity of that part. In short steps slow parts drag cloth along as those of a fold do.
    pub(super) fn is_passed_through(&self, vertex: usize, (body, at): (usize, &BodyPoint), x: &Vec3) -> bool {
        let carried = self.step.x[vertex] + at.displacement;
        let bodies = self.step.bodies;
        let is_passing = self.step.pinched_in_solves || bodies.has_passing_part(body);
        is_passing && bodies.is_in_deep_part(body, at.triangle, [x, &carried], self.search)
    }

    /// Mean velocity of the surfaces around a vertex at `x` [m/s], if it lies inside one part of the body that it has touched wherever it
    /// is outside of another.
    fn between_parts(&self, touch: &LastContact, x: &Vec3) -> Option<Vec3> {
        let bodies = self.step.bodies;
        if !(bodies.may_cross_itself(touch.body, x, self.search) && bodies.contains(touch.body, &touch.outside)) {
            return None;
        }
        // The other part begins behind the vertex, as seen from the surface that it has touched.
        let behind = x - touch.at.normal * (2.0 * self.search);
        let other = if self.step.pinched_in_solves {
            bodies.entry(touch.body, &behind, x, self.properties[touch.body].thickness)
        } else {
            None
        };
        Some((touch.at.velocity + other.map_or(touch.at.velocity, |at| at.velocity)) * 0.5)
    }

    /// The same, if the body that it has touched and one that faces it across this gap have passed through one another.
    fn between_bodies(&self, touch: &LastContact, (body, at): (usize, &BodyPoint), gap: &Gap) -> Option<Vec3> {
        (gap.width <= 0.0 && self.step.bodies.contains(body, &gap.between))
            .then(|| (touch.at.velocity + at.velocity) * 0.5)
    }

    /// The pinch of a vertex at `x` by parts of the body that it has touched.
    fn by_parts(&self, vertex: usize, touch: &LastContact, x: &Vec3) -> Option<Pinch> {
        if self.is_passed_through(vertex, (touch.body, &touch.at), x) {
            return Some(Pinch { drag: None });
        }
        self.between_parts(touch, x).map(|velocity| Pinch { drag: Some(velocity) })
    }

    /// The pinch of a vertex at `end` that has touched one body and perhaps another one before.
    pub(super) fn pinching(
        &self,
        vertex: usize,
        touch: &LastContact,
        before: Option<&LastContact>,
        end: &Vec3,
    ) -> Option<Pinch> {
        let by_bodies = || {
            let before = before.filter(|before| before.faces(&touch.at))?;
            let velocity = self.between_bodies(before, (touch.body, &touch.at), &self.gap(before, &touch.at, end))?;
            Some(Pinch { drag: Some(velocity) })
        };
        self.by_parts(vertex, touch, end).or_else(by_bodies)
    }
}
