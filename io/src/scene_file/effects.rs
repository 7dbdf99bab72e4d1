//! Tables of effects. They are not known to serde: the solver's registry says what they may hold.

use std::collections::BTreeMap;

use drapery_core::effects::{EffectSpec, REGISTRY, Scope, lacking};
use drapery_core::scene::EffectRequest;
use drapery_core::settings::{Default, Field, SettingValue, Settings};

use super::deserialize::{dotted, suggestion};
use super::diagnostics::SceneFileError;
use super::tree::{Node, Origin, Path, Sources, Table, Value};

/// Effects that have a table of this scope.
pub(super) fn with_table(scope: Scope) -> impl Iterator<Item = &'static EffectSpec> {
    REGISTRY.iter().copied().filter(move |spec| spec.scope == scope)
}

/// Names of the effect tables that may stand at a path: the top level, or one garment.
pub(super) fn names_at(path: &Path) -> Vec<&'static str> {
    use super::tree::Segment::{Index, Key};
    match path.0.as_slice() {
        [] => with_table(Scope::Scene).map(|spec| spec.name).chain(["parameters"]).collect(),
        [Key(key), Index(_)] if key == "garment" => with_table(Scope::Garment).map(|spec| spec.name).collect(),
        _ => Vec::new(),
    }
}

/// A copy of the tree without the tables of effects.
pub(super) fn without(root: &Node) -> Node {
    let mut rest = root.clone();
    if let Some(table) = rest.as_table_mut() {
        table.0.retain(|e| with_table(Scope::Scene).all(|spec| spec.name != e.key));
        if let Some(Node { value: Value::Array(garments), .. }) = table.get_mut("garment") {
            for garment in garments.iter_mut().filter_map(Node::as_table_mut) {
                garment.0.retain(|e| with_table(Scope::Garment).all(|spec| spec.name != e.key));
            }
        }
    }
    rest
}

/// All effect tables of the tree with their paths, scene effects first.
fn tables(root: &Node) -> Vec<(&'static EffectSpec, Option<usize>, Path)> {
    let mut found = Vec::new();
    let Some(table) = root.as_table() else {
        return found;
    };
    for spec in with_table(Scope::Scene) {
        if table.get(spec.name).is_some() {
            found.push((spec, None, Path::default().key(spec.name)));
        }
    }
    if let Some(Value::Array(garments)) = table.get("garment").map(|n| &n.value) {
        for (index, garment) in garments.iter().enumerate() {
            for spec in with_table(Scope::Garment) {
                if garment.as_table().is_some_and(|t| t.get(spec.name).is_some()) {
                    found.push((spec, Some(index), Path::default().key("garment").index(index).key(spec.name)));
                }
            }
        }
    }
    found
}

/// Checks every effect table against the fields of its effect and fills in the defaults.
///
/// # Errors
/// The first key or value that does not fit.
pub(super) fn check_and_fill(root: &mut Node, sources: &Sources) -> Result<(), SceneFileError> {
    refuse_lacking(root, sources)?;
    for (spec, _, path) in tables(root) {
        check(path.find(root), spec, &path, sources)?;
        let table = path.find_mut(root).and_then(|node| {
            let place = node.place.clone();
            node.as_table_mut().map(|table| (table, place))
        });
        let Some((table, place)) = table else { continue };
        for field in spec.fields {
            let value = match field.default {
                Default::Number(number) => Value::Float(number),
                Default::Vector(vector) => Value::Array(vector.map(|v| component(v, &place)).to_vec()),
                Default::Flag(flag) => Value::Boolean(flag),
                Default::Required | Default::Absent | Default::Keys | Default::File => continue,
            };
            table.fill(field.name, value, &place, Origin::Default);
        }
    }
    Ok(())
}

/// Refuses tables of effects that this build lacks, at the top level or under a garment, before anyone takes them for
/// misspelt words.
fn refuse_lacking(root: &Node, sources: &Sources) -> Result<(), SceneFileError> {
    let Some(table) = root.as_table() else { return Ok(()) };
    let garments = match table.get("garment").map(|node| &node.value) {
        Some(Value::Array(garments)) => garments.as_slice(),
        _ => &[],
    };
    for entry in std::iter::once(table).chain(garments.iter().filter_map(Node::as_table)).flat_map(|table| &table.0) {
        if let Some((what, advice)) = lacking(&entry.key) {
            return Err(sources.error(&entry.key_place, what, Some(advice)));
        }
    }
    Ok(())
}

fn component(value: f64, place: &super::tree::Place) -> Node {
    Node { value: Value::Float(value), place: place.clone(), origin: Origin::Default }
}

fn check(node: &Node, spec: &EffectSpec, path: &Path, sources: &Sources) -> Result<(), SceneFileError> {
    let name = dotted(path);
    let Some(table) = node.as_table() else {
        let help = format!("write [{name}] and its settings below it, or leave it out to do without the effect");
        return Err(sources.error(&node.place, format!("`{name}` has to be a table"), Some(help)));
    };
    for entry in &table.0 {
        let Some(field) = spec.fields.iter().find(|f| f.name == entry.key) else {
            let names: Vec<&str> = spec.fields.iter().map(|f| f.name).collect();
            let text = format!("unknown key `{}` in `{name}`", entry.key);
            return Err(sources.error(&entry.key_place, text, Some(suggestion(&entry.key, &names))));
        };
        check_value(field, &entry.node).map_err(|text| sources.error(&entry.node.place, text, None))?;
    }
    // What is left to go wrong is a setting that has to be there and is not.
    Settings::check(spec.fields, &settings(table))
        .map(drop)
        .map_err(|texts| sources.error(&node.place, format!("in `{name}`: {}", texts.join("; ")), None))
}

fn check_value(field: &Field, node: &Node) -> Result<(), String> {
    let expected = || {
        let form = match field.default {
            Default::Vector(_) => "three numbers",
            Default::Flag(_) => "true or false",
            Default::Keys => "[[seconds, [x, y, z]], …]",
            Default::File => "the name of a file",
            _ => "a number, or text with a unit",
        };
        format!("`{}` has to be {form}: {}", field.name, field.help)
    };
    let value = setting(&node.value).ok_or_else(expected)?;
    let fits = match field.default {
        Default::Vector(_) => matches!(value, SettingValue::Vector(_)),
        Default::Flag(_) => matches!(value, SettingValue::Flag(_)),
        Default::Keys => matches!(value, SettingValue::Keys(_)),
        Default::File => matches!(value, SettingValue::Text(_)),
        Default::Number(_) | Default::Required | Default::Absent => {
            matches!(value, SettingValue::Number(_) | SettingValue::Text(_))
        }
    };
    if !fits {
        return Err(expected());
    }
    Settings::check(std::slice::from_ref(field), &BTreeMap::from([(field.name.to_owned(), value)]))
        .map(drop)
        .map_err(|texts| texts.join("; "))
}

fn setting(value: &Value) -> Option<SettingValue> {
    match value {
        Value::Array(items) if items.iter().any(|item| matches!(item.value, Value::Array(_))) => {
            items.iter().map(|item| key(&item.value)).collect::<Option<_>>().map(SettingValue::Keys)
        }
        Value::Array(items) => vector(items).map(SettingValue::Vector),
        Value::Text(text) => Some(SettingValue::Text(text.clone())),
        Value::Boolean(flag) => Some(SettingValue::Flag(*flag)),
        other => number(other).map(SettingValue::Number),
    }
}

/// Seconds and three numbers.
fn key(value: &Value) -> Option<(f64, [f64; 3])> {
    match value {
        Value::Array(items) => match items.as_slice() {
            [time, Node { value: Value::Array(items), .. }] => Some((number(&time.value)?, vector(items)?)),
            _ => None,
        },
        _ => None,
    }
}

fn vector(items: &[Node]) -> Option<[f64; 3]> {
    let numbers: Option<Vec<f64>> = items.iter().map(|item| number(&item.value)).collect();
    numbers?.try_into().ok()
}

fn number(value: &Value) -> Option<f64> {
    match value {
        Value::Integer(number) => Some(*number as f64),
        Value::Float(number) => Some(*number),
        _ => None,
    }
}

/// What was written; defaults are left to the effect, which then knows them as such.
fn settings(table: &Table) -> BTreeMap<String, SettingValue> {
    let written = table.0.iter().filter(|entry| entry.node.origin != Origin::Default);
    written.filter_map(|e| setting(&e.node.value).map(|value| (e.key.clone(), value))).collect()
}

/// The requests that the tables of a checked tree make.
pub(super) fn requests(root: &Node) -> Vec<EffectRequest> {
    let request = |(spec, garment, path): (&'static EffectSpec, Option<usize>, Path)| {
        let node = path.find(root);
        let because = match &node.origin {
            Origin::Material(material) => format!("material {material} asks for it"),
            _ => format!("the scene has a table [{}]", dotted(&path)),
        };
        let settings = node.as_table().map(settings).unwrap_or_default();
        EffectRequest { effect: spec.name.to_owned(), garment, settings, because }
    };
    tables(root).into_iter().map(request).collect()
}
