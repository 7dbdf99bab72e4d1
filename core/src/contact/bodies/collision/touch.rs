//! Contact of vertices with bodies, for caches.

use super::BodyCollision;
use crate::Vec3;
use crate::contact::bodies::Bodies;
use crate::contact::touch::contact_at;

impl BodyCollision {
    /// Contact of an own vertex, by its local number, with the bodies where they stand, at the position `x` [m].
    pub(crate) fn contact(&self, bodies: &Bodies, vertex: usize, x: &Vec3) -> f64 {
        let own = vertex - self.first;
        let properties = self.rules.as_ref().map_or(bodies.properties(), |rules| rules.of_vertex(own));
        let touching = properties.iter().enumerate().filter(|(_, properties)| !properties.is_ignored);
        let of_body = |(body, properties): (usize, &crate::contact::bodies::BodyContactProperties)| {
            // What is deep inside is found as far as the solver looks.
            let reach = 2.0 * properties.offset + self.search;
            let found = bodies.closest(body, x, x, reach, None)?;
            Some(contact_at(found.phi, properties.offset))
        };
        touching.filter_map(of_body).fold(0.0, f64::max)
    }
}
