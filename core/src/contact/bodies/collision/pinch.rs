//! Vertices that two surfaces leave no room: in a narrow gap, or where the surfaces have passed through one another.
//!
//! Between surfaces that have passed through one another a vertex is dragged along with their mean velocity until there is room again.
//! D. Baraff, A. Witkin and M. Kass, "Untangling Cloth", SIGGRAPH 2003, section 5, prescribe that motion; a drag leaves cloth that is
//! half pinched unstretched.

use super::{BodyContact, CollisionStep, LastContact, Search, VertexContact};
use crate::Vec3;
use crate::contact::bodies::BodyPoint;
use crate::tolerances::FACING;

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
    /// passed through one another the contacts are given up: the answer is the velocity of the surfaces around [m/s].
    pub(super) fn resolve_pinch(
        &mut self,
        vertex: usize,
        x: &Vec3,
        x1: &mut Vec3,
        contact: &mut VertexContact,
        touched: Option<LastContact>,
    ) -> Option<Vec3> {
        if let Some(touch) = &touched
            && let Some(velocity) = self.between_parts(vertex, touch, x1)
        {
            return Some(velocity);
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
                    return Some(velocity);
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
            if constraint.is_some() || at.phi < offset + 2.0 * (self.own_way + at.displacement.norm()) {
                let friction = properties.friction_on(self.painted.get(vertex));
                contact.add(BodyContact { body, at, offset, constraint, friction });
            }
        }
        None
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

    /// Velocity of the surfaces around a vertex at `x` [m/s] where the body that it has touched crosses itself: their mean, if it lies
    /// inside one part of the body wherever it is outside of another; its own, if the part comes out of another one through the vertex.
    fn between_parts(&self, vertex: usize, touch: &LastContact, x: &Vec3) -> Option<Vec3> {
        let bodies = self.step.bodies;
        if !bodies.may_cross_itself(touch.body, x, self.search) {
            return None;
        }
        if !bodies.contains(touch.body, &touch.outside) {
            return self.emerges(vertex, touch).then_some(self.step.v[vertex]);
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

    /// Whether the part of the body that a vertex has touched comes out of another part, or passes by a vertex inside of it, so fast that
    /// it would carry the vertex an edge away within a frame.
    fn emerges(&self, vertex: usize, touch: &LastContact) -> bool {
        let (bodies, at) = (self.step.bodies, &touch.at);
        let fast = self.search / bodies.sample_span(touch.body);
        let relative = at.velocity - self.step.v[vertex];
        let comes_out = relative.dot(&at.normal) > fast && bodies.was_deep_at(touch.body, at.triangle);
        let passes_by = || relative.norm() > fast || at.phi < -self.search;
        comes_out || (passes_by() && bodies.contains(touch.body, &(self.step.x[vertex] + at.displacement)))
    }

    /// The same, if the body that it has touched and one that faces it across this gap have passed through one another.
    fn between_bodies(&self, touch: &LastContact, (body, at): (usize, &BodyPoint), gap: &Gap) -> Option<Vec3> {
        (gap.width <= 0.0 && self.step.bodies.contains(body, &gap.between))
            .then(|| (touch.at.velocity + at.velocity) * 0.5)
    }

    /// The same, of a vertex at `end` that has touched one body and perhaps another one before.
    pub(super) fn pinching(
        &self,
        vertex: usize,
        touch: &LastContact,
        before: Option<&LastContact>,
        end: &Vec3,
    ) -> Option<Vec3> {
        let by_bodies = || {
            let before = before.filter(|before| before.faces(&touch.at))?;
            self.between_bodies(before, (touch.body, &touch.at), &self.gap(before, &touch.at, end))
        };
        self.between_parts(vertex, touch, end).or_else(by_bodies)
    }
}
