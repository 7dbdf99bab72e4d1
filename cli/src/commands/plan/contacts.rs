//! Contact by pair in a plan: which objects ignore each other, and friction and thickness of all others.

use drapery_core::effects::{body_collision, self_repulsion};
use drapery_core::scene::{ContactRule, ContactSide, GarmentDescription, SceneDescription};
use drapery_core::settings::Settings;
use serde_json::{Value, json};

/// Contact of two objects.
struct PairOfObjects {
    between: [ContactSide; 2],
    rule: Option<ContactRule>,
    friction: f64,
    thickness: f64,
}

/// All pairs that can touch in a scene with rules, in the order of the objects, then those of parts that rules name; none without rules.
fn pairs(scene: &SceneDescription) -> Vec<PairOfObjects> {
    if scene.contacts.is_empty() {
        return Vec::new();
    }
    let request = |name: &str| scene.effects.iter().find(|request| request.effect == name);
    let of_cloth = request(self_repulsion::SPEC.name)
        .and_then(|request| Settings::check(self_repulsion::SPEC.fields, &request.settings).ok())
        .map(|settings| settings.number("friction"));
    let garments = || 0..scene.garments.len();
    let mut pairs = Vec::new();
    for garment in garments() {
        for other in garments().skip(garment) {
            let between = [ContactSide::Garment(garment), ContactSide::Garment(other)];
            let thickness = scene.garments[garment].thickness.max(scene.garments[other].thickness);
            pairs.extend(of_cloth.map(|friction| (between, friction, thickness)));
        }
        if request(body_collision::SPEC.name).is_some() {
            pairs.extend(scene.bodies.iter().enumerate().map(|(number, body)| {
                ([ContactSide::Garment(garment), ContactSide::Body(number)], body.friction, body.thickness)
            }));
        }
    }
    for rule in scene.contacts.iter().filter(|rule| rule.between.iter().any(is_part)) {
        let [a, b] = rule.between;
        let thickness = |side: ContactSide| match side {
            ContactSide::Garment(garment) | ContactSide::Part(garment, _) => scene.garments[garment].thickness,
            ContactSide::Body(body) => scene.bodies[body].thickness,
        };
        match (a, b) {
            (ContactSide::Body(body), _) | (_, ContactSide::Body(body)) => {
                pairs.push(([a, b], scene.bodies[body].friction, scene.bodies[body].thickness));
            }
            _ => pairs.extend(of_cloth.map(|friction| ([a, b], friction, thickness(a).max(thickness(b))))),
        }
    }
    let with_rule = |(between, friction, thickness): ([ContactSide; 2], f64, f64)| {
        let rule = scene.contact_rule(between[0], between[1]).copied();
        let [friction, thickness] = [
            rule.and_then(|rule| rule.friction).unwrap_or(friction),
            rule.and_then(|rule| rule.thickness).unwrap_or(thickness),
        ];
        PairOfObjects { between, rule, friction, thickness }
    };
    pairs.into_iter().map(with_rule).collect()
}

fn is_part(side: &ContactSide) -> bool {
    matches!(side, ContactSide::Part(..))
}

/// The order in which garments are worn, and the table of a scene with rules; empty without both.
pub(super) fn text(scene: &SceneDescription) -> String {
    let mut text = order_text(scene);
    let pairs = pairs(scene);
    if pairs.is_empty() {
        return text;
    }
    text += "\ncontact by pair\n";
    for PairOfObjects { between: [a, b], rule, friction, thickness } in &pairs {
        let objects = match a == b {
            true => format!("layers of {}", scene.contact_side(*a)),
            false => format!("{} and {}", scene.contact_side(*a), scene.contact_side(*b)),
        };
        let by_rule = |is_said: bool| if is_said { " (rule)" } else { "" };
        text += &match rule {
            Some(ContactRule { ignore: true, .. }) => format!("  {objects}: ignore each other\n"),
            _ => {
                let said = |number: fn(&ContactRule) -> Option<f64>| by_rule(rule.as_ref().and_then(number).is_some());
                let (of_friction, of_thickness) = (said(|rule| rule.friction), said(|rule| rule.thickness));
                let millimetres = 1e3 * thickness;
                format!("  {objects}: friction {friction}{of_friction}, thickness {millimetres:.3} mm{of_thickness}\n")
            }
        };
    }
    text
}

/// Garments with a layer, the innermost first; empty if none has one.
fn order_text(scene: &SceneDescription) -> String {
    let layer = |garment: &GarmentDescription| garment.layer.map(|layer| (layer, garment.name.clone()));
    let mut layers: Vec<(u32, String)> = scene.garments.iter().filter_map(layer).collect();
    layers.sort();
    let names: Vec<String> = layers.iter().map(|(layer, name)| format!("{name} ({layer})")).collect();
    if names.is_empty() { String::new() } else { format!("worn from the inside out: {}\n", names.join(", ")) }
}

/// The table for programs.
pub(super) fn as_json(scene: &SceneDescription) -> Value {
    let side = |side: ContactSide| match side {
        ContactSide::Garment(garment) => json!({"garment": scene.garments[garment].name}),
        ContactSide::Body(body) => json!({"body": scene.bodies[body].name}),
        ContactSide::Part(garment, part) => {
            json!({"garment": scene.garments[garment].name, "part": scene.garments[garment].parts.keys().nth(part)})
        }
    };
    let of_pair = |pair: &PairOfObjects| {
        let ignore = pair.rule.is_some_and(|rule| rule.ignore);
        let number = |number: f64| if ignore { Value::Null } else { json!(number) };
        json!({
            "between": pair.between.map(side),
            "ignore": ignore,
            "friction": number(pair.friction),
            "thickness": number(pair.thickness),
            "has_rule": pair.rule.is_some(),
        })
    };
    pairs(scene).iter().map(of_pair).collect()
}
