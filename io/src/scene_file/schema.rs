//! JSON schema of the scene file, for editors: the structs that read it, and the rows of effects and of the solver's descriptions.

use drapery_core::effects::{EffectSpec, Scope};
use drapery_core::geometry::shapes::{Shape, ShapeSpec};
use drapery_core::settings::{Default, Dimension, Field, Word};
use serde_json::{Map, Value, json};

use super::curves;
use super::effects::with_table;
use super::fields::{self, SHAPE, TABLES};
use super::raw::Document;
use crate::materials;

/// Name of the form of a curve.
const CURVE: &str = "curve";

/// The JSON schema of a scene file, as text.
///
/// Editors with a TOML extension use it through a first line `#:schema drapery.schema.json` in the scene file.
pub fn schema() -> String {
    let mut schema = schemars::schema_for!(Document).to_value();
    if let Some(root) = schema.get_mut("properties").and_then(Value::as_object_mut) {
        let description = "Named numbers and texts; a value \"$name\" takes one, --set name=value overrides it.";
        root.insert(
            "parameters".to_owned(),
            json!({
                "description": description,
                "type": "object",
                "additionalProperties": { "type": ["number", "string", "boolean"] },
            }),
        );
        insert_effects(root, Scope::Scene);
    }
    for rows in &TABLES {
        if let Some(table) = schema.pointer_mut(&format!("/$defs/{}", rows.rest)) {
            let changing: Vec<&str> = rows.changing().map(|field| field.name).collect();
            insert_fields(table, rows.fields(), |field| changing.contains(&field.name));
        }
    }
    if let Some(definitions) = schema.get_mut("$defs").and_then(Value::as_object_mut) {
        let key = json!({ "type": "array", "minItems": 2, "maxItems": 2 });
        let description = "A number over time: [[frame, value], …], or a channel of an Alembic or USD file: { file, channel, scale }.";
        let curve = json!({ "title": CURVE, "description": description, "type": ["array", "object"], "items": key });
        definitions.insert(CURVE.to_owned(), curve);
    }
    if let Some(maps) = schema.pointer_mut("/$defs/Maps/properties").and_then(Value::as_object_mut) {
        maps.values_mut().for_each(|form| *form = or_curve(form.take()));
    }
    if let Some(body) = schema.pointer_mut("/$defs/Body/properties") {
        body[SHAPE] = shape();
    }
    if let Some(shot) = schema.pointer_mut("/$defs/Shot/required").and_then(Value::as_array_mut) {
        shot.retain(|key| key != "name");
    }
    if let Some(garment) = schema.pointer_mut("/$defs/Garment/properties").and_then(Value::as_object_mut) {
        insert_effects(garment, Scope::Garment);
        if let Some(material) = garment.get_mut("material").and_then(Value::as_object_mut) {
            let names: Vec<&str> = materials::PRESETS.iter().map(|m| m.name.as_ref()).collect();
            material.insert("examples".to_owned(), json!(names));
        }
    }
    allow_parameters(&mut schema);
    // A value that came from serde_json can always be written by it.
    serde_json::to_string_pretty(&schema).unwrap_or_default()
}

fn insert_effects(properties: &mut Map<String, Value>, scope: Scope) {
    for spec in with_table(scope) {
        properties.insert(spec.name.to_owned(), effect(spec));
    }
}

fn effect(spec: &EffectSpec) -> Value {
    let description = format!("Effect: {}. It runs only if this table is present.", spec.summary);
    let mut table = table(spec.fields, true);
    table["description"] = json!(description);
    table
}

/// A table of which every key has a row; its numbers may be curves.
fn table(fields: &'static [Field], is_curved: bool) -> Value {
    let mut table = json!({ "type": "object", "required": [], "additionalProperties": false });
    insert_fields(&mut table, fields.iter(), |field| is_curved && curves::may_change(field));
    table
}

/// The form of a key of which the number may be a curve.
fn or_curve(mut form: Value) -> Value {
    let mut both = Map::new();
    for key in ["description", "default"] {
        both.extend(form.as_object_mut().and_then(|form| form.remove(key)).map(|value| (key.to_owned(), value)));
    }
    both.insert("anyOf".to_owned(), json!([form, { "$ref": format!("#/$defs/{CURVE}") }]));
    Value::Object(both)
}

/// Adds keys that have rows to a table.
fn insert_fields(table: &mut Value, fields: impl Iterator<Item = &'static Field>, may_change: impl Fn(&Field) -> bool) {
    for row in fields {
        let form = field(row);
        table["properties"][row.name] = if may_change(row) { or_curve(form) } else { form };
        if row.default.is_required()
            && let Some(required) = table["required"].as_array_mut()
        {
            required.push(json!(row.name));
        }
    }
}

/// An ideal shape: one word, and a table of its sizes.
fn shape() -> Value {
    let form = |spec: &ShapeSpec| {
        json!({
            "description": sentence(spec.summary), "type": "object", "properties": { spec.name: table(spec.fields, false) },
            "required": [spec.name], "additionalProperties": false,
        })
    };
    json!({ "description": "An analytic shape.", "oneOf": Shape::SPECS.iter().map(form).collect::<Vec<_>>() })
}

/// A help as a sentence.
fn sentence(help: &str) -> String {
    let mut letters = help.chars();
    let first = letters.next().into_iter().flat_map(char::to_uppercase);
    first.chain(letters).chain(['.']).collect()
}

fn field(field: &Field) -> Value {
    let units: Vec<&str> = field.dimension.units().iter().map(|u| u.0).filter(|u| !u.is_empty()).collect();
    // Lists take numbers alone, in the SI unit.
    let unit = match field.dimension {
        Dimension::None => String::new(),
        _ if field.default.is_number() => format!(" Units: {}.", units.join(", ")),
        _ => format!(" In {}.", units[0]),
    };
    let number = json!({ "type": ["number", "string"] });
    let mut form = match field.default {
        Default::Vector(_) | Default::RequiredVector => {
            json!({ "type": "array", "minItems": 3, "maxItems": 3, "items": ranged(json!({ "type": "number" }), field) })
        }
        Default::Flag(_) => json!({ "type": "boolean" }),
        Default::Keys => json!({ "type": "array", "items": { "type": "array", "minItems": 2, "maxItems": 2 } }),
        Default::File => json!({ "type": "string" }),
        Default::Choice(_, words) | Default::Word(words) => {
            json!({ "oneOf": words.iter().map(word).collect::<Vec<_>>() })
        }
        Default::Count(_) => ranged(json!({ "type": "integer", "format": "uint" }), field),
        _ => ranged(number, field),
    };
    let words = match field.default {
        Default::Choice(_, words) | Default::Word(words) => {
            words.iter().map(|word| format!(" \"{}\": {}", word.name, word.help)).collect()
        }
        _ => String::new(),
    };
    form["description"] = json!(sentence(field.help) + &unit + &words);
    let default = match field.default {
        Default::Conditional(number) => Some(number.into()),
        _ => fields::default(field),
    };
    if let Some(default) = default {
        form["default"] = json!(default);
    }
    form
}

fn word(word: &Word) -> Value {
    json!({ "description": word.help, "type": "string", "const": word.name })
}

/// A number with its range, as far as it has ends.
fn ranged(mut number: Value, field: &Field) -> Value {
    for (key, end) in [("minimum", field.range.0), ("maximum", field.range.1)] {
        if end.is_finite() {
            number[key] = json!(end);
        }
    }
    number
}

/// Lets every number and flag also be a text, because it may be `"$name"`.
fn allow_parameters(schema: &mut Value) {
    match schema {
        Value::Array(items) => items.iter_mut().for_each(allow_parameters),
        Value::Object(object) => {
            if let Some(Value::String(kind)) = object.get("type")
                && ["number", "integer", "boolean"].contains(&kind.as_str())
            {
                let kinds = json!([kind, "string"]);
                object.insert("type".to_owned(), kinds);
            }
            if let Some(Value::Array(kinds)) = object.get_mut("type") {
                let holds = |word: &str| kinds.iter().any(|k| k == word);
                if (holds("number") || holds("integer")) && !holds("string") {
                    kinds.push(json!("string"));
                }
            }
            object.values_mut().for_each(allow_parameters);
        }
        _ => {}
    }
}
