//! Contact of each garment with each body, where rules make a difference.

use crate::contact::bodies::BodyContactProperties;
use crate::scene::{ContactRule, ContactSide, Scene};
use crate::tolerances;

/// Contact by garment and body.
#[derive(Debug)]
pub(super) struct BodyRules {
    /// Garment of each own vertex.
    garment: Vec<u32>,
    bodies: usize,
    /// Contact of each garment with all bodies, garment by garment.
    properties: Vec<BodyContactProperties>,
}

impl BodyRules {
    /// The rules of a scene for its garments and bodies; `None` if it has none.
    pub(super) fn of(scene: &Scene) -> Option<Self> {
        let description = scene.description();
        let rules: Vec<(&ContactRule, usize, usize)> = description.contacts.iter().filter_map(parts).collect();
        if rules.is_empty() {
            return None;
        }
        let gap = tolerances::CONTACT_GAP * scene.mean_edge();
        let (parts, bodies) = (scene.parts(), description.bodies.len());
        let of_body = description.bodies.iter().map(|body| BodyContactProperties::of(body, gap));
        let mut properties: Vec<BodyContactProperties> = of_body.collect::<Vec<_>>().repeat(description.garments.len());
        for (rule, garment, body) in rules {
            let of_pair = &mut properties[garment * bodies + body];
            of_pair.is_ignored = rule.ignore;
            of_pair.friction = rule.friction.unwrap_or(of_pair.friction);
            of_pair.thickness = rule.thickness.unwrap_or(of_pair.thickness);
            of_pair.offset = of_pair.thickness + gap;
        }
        let garment = parts.own().map(|vertex| parts.garment_of(vertex) as u32).collect();
        Some(Self { garment, bodies, properties })
    }

    /// Contact of an own vertex, by its place among these, with each body.
    #[inline]
    pub(super) fn of_vertex(&self, vertex: usize) -> &[BodyContactProperties] {
        let first = self.garment[vertex] as usize * self.bodies;
        &self.properties[first..first + self.bodies]
    }

    /// Memory held [bytes].
    pub(super) fn bytes(&self) -> usize {
        size_of_val(self.garment.as_slice()) + size_of_val(self.properties.as_slice())
    }
}

/// A rule with its garment and its body; `None` if it is about garments alone.
fn parts(rule: &ContactRule) -> Option<(&ContactRule, usize, usize)> {
    match rule.between {
        [ContactSide::Garment(garment), ContactSide::Body(body)]
        | [ContactSide::Body(body), ContactSide::Garment(garment)] => Some((rule, garment, body)),
        _ => None,
    }
}
