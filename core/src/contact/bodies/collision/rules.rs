//! Contact of each garment, or part of one, with each body, where rules make a difference.

use crate::contact::bodies::BodyContactProperties;
use crate::scene::Scene;
use crate::scene::contact_matrix::{ContactMatrix, objects_of_vertices};
use crate::tolerances;

/// Contact by object of cloth and body.
#[derive(Debug)]
pub(super) struct BodyRules {
    /// Object of each own vertex.
    object: Vec<u32>,
    bodies: usize,
    /// Contact of each object with all bodies, object by object.
    properties: Vec<BodyContactProperties>,
}

impl BodyRules {
    /// The rules of a scene for its garments and bodies; `None` if it has none.
    pub(super) fn of(scene: &Scene) -> Option<Self> {
        let description = scene.description();
        let matrix =
            ContactMatrix::of(description).filter(|_| description.contacts.iter().any(|rule| rule.body().is_some()))?;
        let gap = tolerances::CONTACT_GAP * scene.mean_edge();
        let bodies = description.bodies.len();
        let of_body: Vec<BodyContactProperties> =
            description.bodies.iter().map(|body| BodyContactProperties::of(body, gap)).collect();
        let mut properties = of_body.repeat(matrix.count());
        for (k, of_pair) in properties.iter_mut().enumerate().filter(|(k, _)| matrix.is_cloth(k / bodies)) {
            let rule = matrix.on_body(k / bodies, k % bodies);
            of_pair.is_ignored = rule.is_ignored;
            of_pair.friction = rule.friction.unwrap_or(of_pair.friction);
            of_pair.thickness = rule.thickness.unwrap_or(of_pair.thickness);
            of_pair.offset = of_pair.thickness + gap;
        }
        Some(Self { object: objects_of_vertices(scene), bodies, properties })
    }

    /// Contact of an own vertex, by its place among these, with each body.
    #[inline]
    pub(super) fn of_vertex(&self, vertex: usize) -> &[BodyContactProperties] {
        let first = self.object[vertex] as usize * self.bodies;
        &self.properties[first..first + self.bodies]
    }

    /// Memory held [bytes].
    pub(super) fn bytes(&self) -> usize {
        size_of_val(self.object.as_slice()) + size_of_val(self.properties.as_slice())
    }
}
