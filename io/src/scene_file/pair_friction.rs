//! Friction of two objects by the materials of the garments, as rules of contact.

use std::borrow::Cow;

use drapery_core::effects::self_repulsion;
use drapery_core::settings::Default;

use crate::materials::Material;

use super::tree::{Node, Origin, Place, Table, Value};

/// A garment and its material.
struct Worn<'a> {
    name: String,
    place: Place,
    material: Option<&'a Material>,
}

/// Friction by pair, as rules of contact: where it differs from that of the body, or from that of `[self_repulsion]`.
pub(super) fn fill(root: &mut Node, used: &[Option<Cow<'static, Material>>]) {
    let Some(table) = root.as_table() else { return };
    let names =
        |key: &str| -> Vec<String> { items(table, key).iter().filter_map(named).map(|(name, _)| name).collect() };
    let (garments, bodies) = (names("garment"), names("body"));
    let qualified = |kind: &str, name: String| {
        let is_of_both = garments.contains(&name) && bodies.contains(&name);
        if is_of_both { format!("{kind}.{name}") } else { name }
    };
    let worn: Vec<Worn<'_>> = items(table, "garment")
        .iter()
        .zip(used)
        .filter_map(|(garment, material)| {
            let (name, place) = named(garment)?;
            Some(Worn { name: qualified("garment", name), place, material: material.as_deref() })
        })
        .collect();
    let is_without_friction = |body: &&Node| body.as_table().is_some_and(|body| body.get("friction").is_none());
    let touched: Vec<(String, Place)> = items(table, "body")
        .iter()
        .filter(is_without_friction)
        .filter_map(named)
        .map(|(name, place)| (qualified("body", name), place))
        .collect();
    fill_friction_on_bodies(root, &worn, &touched);
    fill_friction_on_cloth(root, &worn);
}

/// Friction of each garment on bodies that do not say theirs: that of its own material, where it is not the largest of all, which
/// bodies get.
fn fill_friction_on_bodies(root: &mut Node, worn: &[Worn<'_>], bodies: &[(String, Place)]) {
    let materials = || worn.iter().filter_map(|garment| Some((garment, garment.material?)));
    let Some(largest) = materials().map(|(_, material)| material.friction).max_by(f64::total_cmp) else { return };
    for (garment, material) in materials().filter(|(_, material)| material.friction != largest) {
        for (body, place) in bodies {
            let origin = Origin::Material(material.name.to_string());
            fill_contact(root, [garment.name.clone(), body.clone()], material.friction, (place, origin));
        }
    }
}

/// Friction of cloth on cloth where `[self_repulsion]` does not say it: the mean of both materials. The table gets the largest, and the
/// pairs with another one get rules. A garment without a material has the default of the table.
fn fill_friction_on_cloth(root: &mut Node, worn: &[Worn<'_>]) {
    let Some(table) = root.as_table_mut().and_then(|root| root.get_mut(self_repulsion::SPEC.name)) else { return };
    let place = table.place.clone();
    let Some(table) = table.as_table_mut().filter(|table| table.get("friction").is_none()) else { return };
    let friction = |garment: &Worn<'_>| garment.material.map_or_else(default_friction, |material| material.friction);
    let most = worn.iter().max_by(|a, b| friction(a).total_cmp(&friction(b)));
    let Some(most) = most.filter(|_| worn.iter().any(|garment| garment.material.is_some())) else { return };
    let largest = friction(most);
    let origin = |of: [&Worn<'_>; 2]| {
        // Never a default: a rule has none, and without its number it would have the largest of all.
        let name =
            |garment: &Worn<'_>| garment.material.map_or("none".to_owned(), |material| material.name.to_string());
        let mut names = of.map(name).to_vec();
        names.dedup();
        Origin::Material(names.join(" and "))
    };
    table.fill("friction", Value::Float(largest), &place, origin([most, most]));
    for (g, a) in worn.iter().enumerate() {
        for b in &worn[g..] {
            let mean = 0.5 * (friction(a) + friction(b));
            if mean != largest {
                fill_contact(root, [a.name.clone(), b.name.clone()], mean, (&b.place, origin([a, b])));
            }
        }
    }
}

/// Friction of cloth on cloth without a material.
fn default_friction() -> f64 {
    match self_repulsion::SPEC.fields.iter().find(|field| field.name == "friction").map(|field| &field.default) {
        Some(Default::Number(friction)) => *friction,
        _ => 0.0,
    }
}

/// Fills the friction of two objects into their rule, or adds one.
fn fill_contact(root: &mut Node, names: [String; 2], friction: f64, (place, origin): (&Place, Origin)) {
    let Some(table) = root.as_table_mut() else { return };
    let node = |value: Value| Node { value, place: place.clone(), origin: origin.clone() };
    table.fill("contact", Value::Array(Vec::new()), place, origin.clone());
    let Some(Node { value: Value::Array(rules), .. }) = table.get_mut("contact") else { return };
    let is_theirs = |rule: &&mut Node| {
        let between = rule.as_table().and_then(|rule| rule.get("between"));
        let Some(Node { value: Value::Array(between), .. }) = between else { return false };
        let found: Vec<&str> = between.iter().filter_map(Node::as_text).map(unqualified).collect();
        let wanted = names.each_ref().map(|name| unqualified(name));
        found == wanted || (found.len() == 2 && [found[1], found[0]] == wanted)
    };
    if let Some(rule) = rules.iter_mut().find(is_theirs) {
        let Some(rule) = rule.as_table_mut() else { return };
        let ignores = matches!(rule.get("ignore"), Some(Node { value: Value::Boolean(true), .. }));
        // One that says nothing is refused for that.
        if !ignores && rule.get("thickness").is_some() {
            rule.fill("friction", Value::Float(friction), place, origin);
        }
        return;
    }
    let mut rule = Table::default();
    let between = names.into_iter().map(|name| node(Value::Text(name))).collect();
    rule.fill("between", Value::Array(between), place, origin.clone());
    rule.fill("friction", Value::Float(friction), place, origin.clone());
    rules.push(node(Value::Table(rule)));
}

/// A name without the kind of its object.
fn unqualified(name: &str) -> &str {
    ["garment.", "body."].iter().find_map(|kind| name.strip_prefix(kind)).unwrap_or(name)
}

/// Items of a list of the scene; none if there is no such list.
fn items<'a>(table: &'a Table, key: &str) -> &'a [Node] {
    match table.get(key) {
        Some(Node { value: Value::Array(items), .. }) => items,
        _ => &[],
    }
}

/// Name and place of an item.
fn named(item: &Node) -> Option<(String, Place)> {
    let table = item.as_table()?;
    Some((table.get("name").and_then(Node::as_text)?.to_owned(), item.place.clone()))
}

#[cfg(test)]
mod tests {
    use drapery_core::effects::self_repulsion;
    use drapery_core::scene::ContactSide::{self, Body, Garment};
    use drapery_core::settings::SettingValue;

    use crate::scene_file::parse;
    use crate::shot_description::ShotDescription;

    /// A scene with a garment of each material; none where it is empty.
    fn scene(materials: &[&str], more: &str) -> ShotDescription {
        let mut text = "drapery = 1\nshot.frames = \"1-2\"\n[gravity]\n".to_owned();
        for (name, material) in ["coat", "lining", "scarf"].iter().zip(materials) {
            let mass = if material.is_empty() { "density = 0.2".into() } else { format!("material = \"{material}\"") };
            text += &format!("[[garment]]\nname = \"{name}\"\npanel = {{ resolution = 4 }}\n{mass}\n");
        }
        let scene = parse(&(text + more), "scenes/pairs.toml", std::path::Path::new("scenes"), &[]);
        let scene = scene.unwrap_or_else(|error| panic!("{error}"));
        scene.resolve().unwrap_or_else(|errors| panic!("{}", errors[0]))
    }

    /// Friction of `[self_repulsion]`, and the rules.
    fn friction(shot: &ShotDescription) -> (f64, Vec<([ContactSide; 2], f64)>) {
        let request =
            shot.scene.effects.iter().find(|request| request.effect == self_repulsion::SPEC.name).expect("asked for");
        let rules = shot.scene.contacts.iter().filter_map(|rule| Some((rule.between, rule.friction?))).collect();
        // Only what the scene or a material says is in the request.
        let friction = match request.settings.get("friction") {
            Some(SettingValue::Number(friction)) => *friction,
            Some(other) => panic!("{other:?}"),
            None => super::default_friction(),
        };
        (friction, rules)
    }

    #[test]
    fn cloth_on_cloth_has_the_mean_friction_of_both_materials() {
        // Silk has 0.25, denim 0.5; cloth without a material has the default of 0.4.
        let found = |materials: &[&str], more: &str| friction(&scene(materials, more));
        let contact = "[self_repulsion]\n";
        assert_eq!(found(&["denim_11oz"], contact), (0.5, vec![]));
        assert_eq!(found(&["denim_11oz", "denim_11oz"], contact), (0.5, vec![]));
        assert_eq!(found(&["", ""], contact), (0.4, vec![]));
        let both = vec![([Garment(0), Garment(1)], 0.375), ([Garment(1), Garment(1)], 0.25)];
        assert_eq!(found(&["denim_11oz", "silk_light"], contact), (0.5, both.clone()));
        let third =
            [([Garment(0), Garment(2)], 0.45), ([Garment(1), Garment(2)], 0.325), ([Garment(2), Garment(2)], 0.4)];
        let (base, mut rules) = found(&["denim_11oz", "silk_light", ""], contact);
        let of_three: Vec<_> = both.into_iter().chain(third).collect();
        rules.sort_by(|a, b| a.1.total_cmp(&b.1));
        let mut expected = of_three;
        expected.sort_by(|a, b| a.1.total_cmp(&b.1));
        assert_eq!((base, rules.len()), (0.5, expected.len()));
        for ((between, value), (wanted, friction)) in rules.iter().zip(&expected) {
            assert!(
                between == wanted && (value - friction).abs() < 1e-15,
                "{between:?} {value}, {wanted:?} {friction}"
            );
        }
    }

    #[test]
    fn a_written_friction_stays() {
        let found = |more: &str| friction(&scene(&["denim_11oz", "silk_light"], more));
        assert_eq!(found("[self_repulsion]\nfriction = 0.1\n"), (0.1, vec![]), "of all cloth on cloth");
        let rule = "[self_repulsion]\n[[contact]]\nbetween = [\"lining\", \"coat\"]\n";
        let (one, own) = ([Garment(1), Garment(0)], ([Garment(1), Garment(1)], 0.25));
        assert_eq!(found(&format!("{rule}friction = 0.7\n")), (0.5, vec![(one, 0.7), own]));
        assert_eq!(found(&format!("{rule}thickness = \"1 mm\"\n")), (0.5, vec![(one, 0.375), own]), "filled in");
        assert_eq!(found(&format!("{rule}ignore = true\n")), (0.5, vec![own]), "without friction");
        assert_eq!(found(rule), (0.5, vec![own]), "a rule that says nothing, which the solver refuses");
        let body = "[self_repulsion]\n[[body]]\nname = \"ball\"\nshape = { sphere = { radius = 0.1 } }\n";
        let (_, rules) = found(body);
        assert!(rules.contains(&([Garment(1), Body(0)], 0.25)), "{rules:?}");
    }
}
