//! Checks of rules of contact.

use std::collections::BTreeMap;

use super::check_values;
use crate::effects::{self_collision, self_repulsion};
use crate::error::Problem;
use crate::scene::contact_matrix::{named_parts, pairs_of_objects};
use crate::scene::{ContactRule, ContactSide, SceneDescription};

/// Objects, contradictions and numbers of rules of contact, and rules that change nothing.
pub(crate) fn check_contacts(description: &SceneDescription, problems: &mut Vec<Problem>) {
    for (r, rule) in description.contacts.iter().enumerate() {
        let place = place(description, r, rule);
        let mut refuse = |what: String, advice: &str| problems.push(Problem::scene(&place, what, advice));
        let exists = |side: &ContactSide| match *side {
            ContactSide::Garment(garment) => garment < description.garments.len(),
            ContactSide::Body(body) => body < description.bodies.len(),
            ContactSide::Part(garment, part) => {
                description.garments.get(garment).is_some_and(|garment| part < garment.parts.len())
            }
        };
        if !rule.between.iter().all(exists) {
            refuse("it names an object that does not exist".into(), "correct `between`");
            continue;
        }
        if rule.between.iter().all(|side| matches!(side, ContactSide::Body(_))) {
            refuse("bodies do not collide with each other".into(), "name a garment, or leave the rule out");
            continue;
        }
        let same = |other: &&ContactRule| other.ordered() == rule.ordered();
        if description.contacts[..r].iter().any(|other| same(&other)) {
            refuse("there is another rule for these two".into(), "write one rule for each pair of objects");
        }
        let speaks_of = |other: &&ContactRule| {
            let is_as_close = named_parts(other) == named_parts(rule) && other.ordered() != rule.ordered();
            let (these, those) = (pairs_of_objects(description, rule), pairs_of_objects(description, other));
            is_as_close && these.iter().any(|pair| those.contains(pair))
        };
        let exist = |other: &&ContactRule| other.between.iter().all(exists);
        if let Some(other) = description.contacts[..r].iter().filter(exist).find(speaks_of) {
            let [a, b] = other.between.map(|side| description.contact_side(side));
            let what = format!("it speaks of the same cloth as the rule for {a} and {b}");
            refuse(what, "name both parts in a rule of their own");
        }
        check_settings(description, rule, &mut refuse);
        check_values(&place, rule, problems);
    }
}

/// Vertices of parts of garments.
pub(crate) fn check_parts(description: &SceneDescription, problems: &mut Vec<Problem>) {
    for garment in &description.garments {
        let mut part_of: BTreeMap<u32, &str> = BTreeMap::new();
        for (name, vertices) in &garment.parts {
            let place = format!("garment \"{}\", part \"{name}\"", garment.name);
            let mut refuse = |what: String, advice: &str| problems.push(Problem::scene(&place, what, advice));
            if let Some(vertex) = vertices.iter().find(|vertex| **vertex as usize >= garment.point_count()) {
                refuse(format!("there is no vertex {vertex}"), "correct its vertices");
            }
            if vertices.is_empty() {
                refuse("it has no vertices".into(), "choose some, or leave it out");
            }
            let other = vertices.iter().find_map(|vertex| Some((vertex, part_of.insert(*vertex, name)?)));
            if let Some((vertex, other)) = other.filter(|(_, other)| *other != name) {
                refuse(format!("vertex {vertex} is of part \"{other}\" too"), "choose vertices of one part for each");
            }
        }
    }
}

/// Returns the place of a rule, by its number and its objects.
fn place(description: &SceneDescription, r: usize, rule: &ContactRule) -> String {
    let [a, b] = rule.between.map(|side| description.contact_side(side));
    format!("contact {r}, {a} and {b}")
}

/// Settings that contradict each other, or that have no effect in this scene.
fn check_settings(description: &SceneDescription, rule: &ContactRule, refuse: &mut dyn FnMut(String, &str)) {
    let has = |effect: &str| description.effects.iter().any(|request| request.effect == effect);
    let numbers = [("friction", rule.friction), ("thickness", rule.thickness)];
    let written = numbers.into_iter().find(|(_, value)| value.is_some()).map(|(key, _)| key);
    match (rule.ignore, written) {
        (true, Some(key)) => refuse(
            format!("objects that ignore each other have no `{key}`"),
            "leave out `ignore`, or leave out the number",
        ),
        (false, None) => refuse(
            "it changes nothing".into(),
            "write `ignore = true`, a `friction` or a `thickness`, or leave the rule out",
        ),
        _ => {}
    }
    if rule.body().is_some() {
        return;
    }
    if let Some(key) = written.filter(|_| !has(self_repulsion::SPEC.name)) {
        refuse(format!("`{key}` has no effect without [self_repulsion]"), "ask for [self_repulsion], or leave it out");
    }
    if rule.ignore && !has(self_repulsion::SPEC.name) && !has(self_collision::SPEC.name) {
        refuse(
            "cloth passes through cloth in this scene anyway".into(),
            "ask for [self_collision], or leave the rule out",
        );
    }
    let garments =
        rule.ordered().map(|side| if let ContactSide::Garment(garment) = side { Some(garment) } else { None });
    let is_sewn = |sewn: [usize; 2]| [sewn[0].min(sewn[1]), sewn[0].max(sewn[1])].map(Some) == garments;
    if let Some(s) = description.seams.iter().position(|seam| is_sewn(seam.garments)).filter(|_| rule.ignore) {
        refuse(
            format!("seam {s} draws these two together, and they pass through each other"),
            "leave out `ignore`: what is sewn together lies on one another",
        );
    }
}

impl SceneDescription {
    /// Takes out what rules say of contact of cloth with cloth as far as nothing in the scene asks for that any more.
    pub(crate) fn drop_rules_without_effect(&mut self) {
        let has = |effect: &str| self.effects.iter().any(|request| request.effect == effect);
        let (repels, collides) = (has(self_repulsion::SPEC.name), has(self_collision::SPEC.name));
        self.retain_contacts(|rule| {
            if rule.body().is_some() {
                return true;
            }
            if !repels {
                (rule.friction, rule.thickness) = (None, None);
            }
            if rule.ignore { repels || collides } else { rule.friction.is_some() || rule.thickness.is_some() }
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Vec3;
    use crate::geometry::shapes::Shape;
    use crate::mesh::PolygonMesh;
    use crate::scene::{BodyDescription, BodyShape, EffectRequest, GarmentDescription, RigidMotion, SeamDescription};

    fn scene(effects: &[&str]) -> SceneDescription {
        let mut description = SceneDescription::new("rules");
        for name in ["coat", "lining"] {
            let mesh = PolygonMesh::from_triangles(vec![Vec3::x(), Vec3::y(), Vec3::z()], &[[0, 1, 2]]);
            description.garments.push(GarmentDescription::new(name, mesh, 0.2));
        }
        for name in ["hero", "chair"] {
            let ball = BodyShape::Rigid(Shape::Sphere { radius: 0.1 });
            description.bodies.push(BodyDescription::new(name, ball, RigidMotion::at(Vec3::zeros())));
        }
        description.effects = effects.iter().map(|effect| EffectRequest::of_scene(effect)).collect();
        description
    }

    fn problems(description: &SceneDescription) -> String {
        let mut problems = Vec::new();
        check_contacts(description, &mut problems);
        problems.iter().map(|problem| problem.to_string()).collect::<Vec<_>>().join("\n")
    }

    const BOTH: [&str; 2] = [self_repulsion::SPEC.name, self_collision::SPEC.name];

    #[test]
    fn rules_that_contradict_or_change_nothing_are_named_with_their_objects() {
        use ContactSide::{Body, Garment};
        let cloth = [Garment(0), Garment(1)];
        let ignore = |between| ContactRule { ignore: true, ..ContactRule::new(between) };
        let rough = |between| ContactRule { friction: Some(0.5), ..ContactRule::new(between) };
        let cases = [
            (vec![ignore([Garment(0), Garment(7)])], "garment 7: it names an object that does not exist"),
            (vec![ignore([Body(0), Body(1)])], "body \"hero\" and body \"chair\": bodies do not collide"),
            (
                vec![ignore(cloth), rough([Garment(1), Garment(0)])],
                "contact 1, garment \"lining\" and garment \"coat\": there is another",
            ),
            (
                vec![ContactRule { friction: Some(0.1), ..ignore(cloth) }],
                "objects that ignore each other have no `friction`",
            ),
            (vec![ContactRule::new(cloth)], "it changes nothing"),
            (vec![ContactRule { thickness: Some(-1.0), ..ContactRule::new(cloth) }], "thickness"),
        ];
        for (rules, expected) in cases {
            let mut description = scene(&BOTH);
            description.contacts = rules;
            assert!(problems(&description).contains(expected), "{}", problems(&description));
        }
        let mut description = scene(&BOTH[..1]);
        description.contacts = vec![ignore(cloth), rough([Garment(0), Body(1)]), rough([Garment(1), Garment(1)])];
        assert_eq!(problems(&description), "");
        description.seams.push(SeamDescription { until: 1.0, ..SeamDescription::new([1, 0], vec![[0, 0]], 1.0) });
        assert!(problems(&description).contains("seam 0 draws these two together"), "{}", problems(&description));
        description.seams.clear();
        description.effects.clear();
        let found = problems(&description);
        assert!(found.contains("cloth passes through cloth") && found.contains("has no effect without"), "{found}");
    }

    #[test]
    fn rules_go_with_the_effects_that_they_are_for() {
        use ContactSide::{Body, Garment};
        let mut description = scene(&BOTH);
        let ignore = ContactRule { ignore: true, ..ContactRule::new([Garment(0), Garment(1)]) };
        let rough = ContactRule { friction: Some(0.5), ..ContactRule::new([Garment(0), Garment(0)]) };
        let on_body = ContactRule { thickness: Some(0.01), ..ContactRule::new([Garment(0), Body(0)]) };
        description.contacts = vec![ignore, rough, on_body];
        let mut left = |effect: &str| {
            description.leave_out(&[effect.to_owned()]).expect("the scene asks for it");
            assert_eq!(problems(&description), "");
            description.contacts.clone()
        };
        assert_eq!(left(BOTH[0]), [ignore, on_body]);
        assert_eq!(left(BOTH[1]), [on_body]);
    }
}
