//! Contact of a vertex as a number between 0 and 1, for caches: 1 where it is as close to another surface as contact keeps it, or
//! closer; 0 at twice that distance and beyond; linear in between.
//!
//! It follows from the positions alone, by distances whose greatest number counts: any number of ranks and threads, before and
//! after a stop, gives the same bits.

use super::BodyCollision;
use crate::Vec3;
use crate::contact::bodies::{Bodies, BodyContactProperties};

/// Contact at a distance from a surface that is to be `kept`; both in metres, the distance negative inside of a body.
pub(crate) fn contact_at(distance: f64, kept: f64) -> f64 {
    (2.0 - distance / kept).clamp(0.0, 1.0)
}

impl BodyCollision {
    /// Contact of an own vertex, by its local number, with the bodies where they stand, at the position `x` [m].
    pub(crate) fn contact(&self, bodies: &Bodies, vertex: usize, x: &Vec3) -> f64 {
        let own = vertex - self.first;
        let properties = self.rules.as_ref().map_or(bodies.properties(), |rules| rules.of_vertex(own));
        let of_body = |(body, properties): (usize, &BodyContactProperties)| {
            if properties.is_ignored {
                return None;
            }
            // What is deep inside is found as far as the solver looks.
            let reach = 2.0 * properties.offset + self.search;
            let found = bodies.closest(body, x, x, reach, None)?;
            Some(contact_at(found.phi, properties.offset))
        };
        properties.iter().enumerate().filter_map(of_body).fold(0.0, f64::max)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn contact_is_one_at_the_distance_that_is_kept_and_falls_to_zero_at_twice_that() {
        let at = |distance| contact_at(distance, 0.5);
        assert_eq!([-1.0, 0.0, 0.5, 0.75, 1.0, 9.0].map(at), [1.0, 1.0, 1.0, 0.5, 0.0, 0.0]);
    }
}
