//! JSON schema of the scene file, for editors: the structs that read it, and the tables of effects from the registry.

use drapery_core::effects::{EffectSpec, Scope};
use drapery_core::settings::{Default, Field};
use serde_json::{Map, Value, json};

use super::effects::with_table;
use super::raw::Document;
use crate::materials;

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
    let fields: Map<String, Value> = spec.fields.iter().map(|f| (f.name.to_owned(), field(f))).collect();
    let required: Vec<&str> =
        spec.fields.iter().filter(|f| matches!(f.default, Default::Required)).map(|f| f.name).collect();
    json!({
        "description": format!("Effect: {}. Without this table it does not exist.", spec.summary),
        "type": "object",
        "properties": fields,
        "required": required,
        "additionalProperties": false,
    })
}

fn field(field: &Field) -> Value {
    let units: Vec<&str> = field.dimension.units().iter().map(|u| u.0).filter(|u| !u.is_empty()).collect();
    let unit = if units.is_empty() { String::new() } else { format!(" Units: {}.", units.join(", ")) };
    let description = format!("{}.{unit}", field.help);
    let (least, most) = field.range;
    match field.default {
        Default::Vector(default) => json!({
            "description": description, "type": "array", "minItems": 3, "maxItems": 3, "default": default,
            "items": { "type": "number", "minimum": least, "maximum": most },
        }),
        Default::Number(default) => json!({
            "description": description, "type": ["number", "string"], "minimum": least, "maximum": most,
            "default": default,
        }),
        Default::Flag(default) => json!({ "description": description, "type": "boolean", "default": default }),
        Default::Keys => json!({
            "description": description, "type": "array",
            "items": { "type": "array", "minItems": 2, "maxItems": 2 },
        }),
        Default::File => json!({ "description": description, "type": "string" }),
        Default::Required | Default::Absent => json!({
            "description": description, "type": ["number", "string"], "minimum": least, "maximum": most,
        }),
    }
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
