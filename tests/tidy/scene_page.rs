//! `docs/reference/scene.md`, from the JSON schema of the scene file.

use std::collections::VecDeque;
use std::fmt::Write;

use drapery_core::effects::REGISTRY;
use drapery_io::materials::PRESETS;
use serde_json::Value;

/// The page.
pub(crate) fn page() -> String {
    let schema: Value = serde_json::from_str(&drapery_io::scene_file::schema()).expect("the schema is JSON");
    let mut page = String::from(HEAD);
    // Tables in the order in which they are met; one that is met twice is printed once.
    let mut tables = VecDeque::from([(String::new(), schema.clone())]);
    let mut printed: Vec<String> = Vec::new();
    while let Some((path, table)) = tables.pop_front() {
        if printed.contains(&path) {
            continue;
        }
        page += &section(&schema, &path, &table);
        for (key, property) in sorted_properties(&table) {
            if is_effect(&key) {
                continue;
            }
            for inner in tables_of(&schema, property) {
                let inner_path = if path.is_empty() { key.clone() } else { format!("{path}.{key}") };
                tables.push_back((inner_path, inner));
            }
        }
        printed.push(path);
    }
    page + &materials() + BODIES + NOTE
}

/// For developers, and for nobody who reads the page.
const NOTE: &str = "
<!-- Written by a test from the JSON schema (`drapery schema`), which comes from the rows of values (`core/src/scene/`) and from
the structs that read the rest (`io/src/scene_file/raw/mod.rs`); change it there. -->
";

const HEAD: &str = "# The scene file

The file is TOML. Bold keys are required. Unknown keys are errors, all at once, each with its line and the right word.
Positions, velocities and times are in metres, metres per second and seconds with Y up; `[units]` applies to the mesh files.
A value of the kind \"number or text\" is a number, or a text with its unit (\"2 mm\", \"150 g/m²\"). Ranges are in the key's SI unit, both
ends included. A number outside is an error that names the line. Any value may be \"$name\", which takes the parameter `name`. Paths of
files are relative to the folder of the scene file.

## Numbers over time

A number of an effect, a garment, an elastic band, a spring pin, a seam, a body or a `[[contact]]` may be a curve: `[[frame, value], …]`,
with frames that increase, or a channel of an Alembic or USD file: `{ file = \"props.abc\", channel = \"/object.property\" }`. Values are
numbers, texts with a unit, or lists of three where the key takes three. The value is straight between keys, and constant before
the first and after the last. In the steps that lead to a frame it is the value of that frame.

```toml
[gravity]
acceleration = [[1001, [0, -9.81, 0]], [1024, [0, -1.6, 0]]]

[garment.stretch]
stiffness = [[1001, \"400 N/m\"], [1048, \"40 N/m\"]]
```

`plan` lists the curves. Checkpoints hold none of them, because they follow from the scene.
";

const BODIES: &str = "
## Thickness of bodies

Contact keeps the vertices of cloth off a body. Between them a face of cloth cuts into a curved body, and the body's own faces lie
below its vertices. If the scene sets no `thickness`, a body from a file, a `sphere` and a `capsule` get one that hides both, along either
diagonal of the faces:

```text
(h² + b²) κ / 8     at an edge between two faces of the body; h sin θ / 2 where h < b and that is less; at most 0.1 / κ
```

* `h`: diameter of the smallest circle around a face of cloth; 95 % of the garment's area have a smaller one. The coarsest garment counts.
* `b`: the same diameter for the larger of the body's two faces.
* `θ`, `κ`: angle between these faces; curvature, θ over the distance of their centres. Edges sharper than 60° do not count. A sphere and a
  capsule have κ = 1/radius and b = 0 everywhere.
* The thickness is the value that 95 % of the body's area do not exceed, in its first frame, in steps of 0.01 mm. It is at least the
  largest thickness of the garments' materials.

The maximum is a tenth of the radius of curvature. Cloth that needs more, as on a finger, wraps around the body instead of lying on
it; only a finer mesh helps. `drapery plan` shows both numbers, `check` warns of thinner bodies ([`thin_body`](warnings.md)), and
`resolved.toml` holds the number. Other shapes have the thickness of the materials: edges and faces of cloth meet boxes and cylinders
themselves if the scene asks for `[self_collision]`.
";

fn is_effect(key: &str) -> bool {
    REGISTRY.iter().any(|spec| spec.name == key)
}

/// Keys of a table, the required ones first, then by name.
fn sorted_properties(table: &Value) -> Vec<(String, &Value)> {
    let mut properties: Vec<(String, &Value)> =
        table["properties"].as_object().into_iter().flatten().map(|(k, v)| (k.clone(), v)).collect();
    properties.sort_by_key(|(key, _)| (!is_required(table, key), key.clone()));
    properties
}

fn is_required(table: &Value, key: &str) -> bool {
    table["required"].as_array().is_some_and(|required| required.iter().any(|r| r == key))
}

/// The definition that a schema refers to, or itself.
fn resolved<'a>(root: &'a Value, schema: &'a Value) -> &'a Value {
    match schema["$ref"].as_str() {
        Some(reference) => root.pointer(reference.trim_start_matches('#')).unwrap_or(schema),
        None => schema,
    }
}

/// Returns the alternatives of a schema but `null`, or the schema itself if it has none.
fn alternatives<'a>(root: &'a Value, schema: &'a Value) -> Vec<&'a Value> {
    let schema = resolved(root, schema);
    let choices = schema["anyOf"].as_array().or(schema["oneOf"].as_array());
    match choices {
        Some(choices) => {
            let shown = choices.iter().flat_map(|c| alternatives(root, c));
            // The head of the page says where curves may stand.
            shown.filter(|c| c["type"] != "null" && c["title"] != "curve").collect()
        }
        None => vec![schema],
    }
}

/// The tables that a value may hold: of itself, or of its items.
fn tables_of(root: &Value, schema: &Value) -> Vec<Value> {
    let mut tables = Vec::new();
    for choice in alternatives(root, schema) {
        if choice["properties"].is_object() {
            tables.push(with_described_key(choice.clone()));
        } else if choice["items"].is_object() {
            tables.extend(tables_of(root, &choice["items"]));
        }
    }
    tables.into_iter().reduce(merged).into_iter().collect()
}

/// A form of a table that has one key says there what the form itself says.
fn with_described_key(mut table: Value) -> Value {
    let description = table["description"].clone();
    let properties = table["properties"].as_object_mut();
    if let Some(only) =
        properties.filter(|p| p.len() == 1).and_then(|p| p.values_mut().next()).and_then(Value::as_object_mut)
    {
        only.entry("description").or_insert(description);
    }
    table
}

/// One of several forms of a table: the keys of all of them, required only if there is just one form.
fn merged(mut a: Value, b: Value) -> Value {
    if let (Some(into), Some(from)) = (a["properties"].as_object_mut(), b["properties"].as_object()) {
        into.extend(from.iter().map(|(k, v)| (k.clone(), v.clone())));
    }
    a["required"] = Value::Null;
    a["description"] = Value::from("One of these keys.");
    a
}

fn section(root: &Value, path: &str, table: &Value) -> String {
    let title = if path.is_empty() { "Top level".to_owned() } else { format!("`{path}`") };
    let mut text = format!("\n## {title}\n");
    if let Some(description) = table["description"].as_str() {
        let _ = write!(text, "\n{}\n", one_line(description));
    }
    if table["properties"].as_object().is_none_or(serde_json::Map::is_empty) {
        return text + "\nIt has no keys: write `{}`.\n";
    }
    text += "\n| key | value | default | |\n|---|---|---|---|\n";
    let is_table_of_effect = |key: &str| is_effect(key) && path != "garment.maps";
    let (effects, keys): (Vec<_>, Vec<_>) =
        sorted_properties(table).into_iter().partition(|(key, _)| is_table_of_effect(key));
    for (key, property) in keys {
        let name = if is_required(table, &key) { format!("**`{key}`**") } else { format!("`{key}`") };
        let described = property["description"].as_str().or(resolved(root, property)["description"].as_str());
        let (kind, default, help) = (kind(root, property), default(property), one_line(described.unwrap_or("")));
        // Writing to a String cannot fail.
        let _ = writeln!(text, "| {name} | {kind} | {default} | {help} |");
    }
    if !effects.is_empty() {
        text += "| name of an effect | table |  | asks for the effect, with its [settings](effects.md) |\n";
    }
    text
}

/// Returns the kinds of value that may be written, in words.
fn kind(root: &Value, property: &Value) -> String {
    let mut words: Vec<String> = Vec::new();
    for choice in alternatives(root, property) {
        let word = kind_of_choice(root, choice);
        if !words.contains(&word) {
            words.push(word);
        }
    }
    words.join(" or ")
}

fn kind_of_choice(root: &Value, choice: &Value) -> String {
    if let Some(value) = choice.get("const") {
        return format!("`{value}`");
    }
    if let Some(values) = choice["enum"].as_array() {
        return values.iter().map(|v| format!("`{v}`")).collect::<Vec<_>>().join(" or ");
    }
    let kinds: Vec<&str> = match &choice["type"] {
        Value::String(kind) => vec![kind],
        Value::Array(kinds) => kinds.iter().filter_map(Value::as_str).filter(|kind| *kind != "null").collect(),
        _ => vec!["value"],
    };
    // A text is allowed for every number because of "$name"; only quantities, which have no format, take units.
    let is_plain = choice["format"].is_string() || kinds.contains(&"boolean");
    let word = |kind: &&str| match *kind {
        "array" => array_word(root, choice),
        "integer" => "whole number".to_owned(),
        "object" => "table".to_owned(),
        "string" => "text".to_owned(),
        "boolean" => "true or false".to_owned(),
        other => other.to_owned(),
    };
    let shown = kinds.iter().filter(|kind| !(is_plain && **kind == "string"));
    shown.map(word).collect::<Vec<_>>().join(" or ") + &range(root, choice)
}

/// The numbers that are possible, where both ends are declared; those of a list are of its items.
fn range(root: &Value, choice: &Value) -> String {
    let of = |part: &Value| Some((part["minimum"].as_f64()?, part["maximum"].as_f64()?));
    match (of(choice), of(resolved(root, &choice["items"]))) {
        (Some((least, most)), _) => format!(", {} to {}", short(least), short(most)),
        (None, Some((least, most))) => format!(", each {} to {}", short(least), short(most)),
        (None, None) => String::new(),
    }
}

/// A number with as few digits as it has.
fn short(value: f64) -> String {
    let is_long = value != 0.0 && !(1e-3..1e6).contains(&value.abs());
    if is_long { format!("{value:e}") } else { value.to_string() }
}

fn array_word(root: &Value, array: &Value) -> String {
    match array["maxItems"].as_u64() {
        Some(count) => format!("list of {count}"),
        None if array["items"].is_object() && !tables_of(root, &array["items"]).is_empty() => "tables".to_owned(),
        None => "list".to_owned(),
    }
}

fn default(property: &Value) -> String {
    match &property["default"] {
        // JSON has no word for infinity.
        Value::Null if property.get("default").is_some() => "no limit".to_owned(),
        Value::Null => String::new(),
        Value::Object(_) => "the defaults of its keys".to_owned(),
        value => format!("`{value}`"),
    }
}

fn one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ").replace('|', "\\|")
}

fn materials() -> String {
    let mut text = String::from(
        "\n## Materials\n\nWords for `garment.material`, which asks for `stretch` and `dihedral_bending`. `drapery materials` prints \
         the source of each\nnumber; [materials](../guide/materials.md) has their drape tests. `[garment.membrane]` \
         takes warp, weft and shear instead of stretch, and\n`[garment.strain_limit]` the largest strain. A garment with \
         `[garment.bending]` has springs instead of `dihedral_bending`.\n[Material files](config.md) add other \
         words.\n\n| word | | kg/m² | thickness | stretch | warp | weft | shear \
         | bending | largest strain | damping ratio | friction |\n|---|---|---|---|---|---|---|---|---|---|---|---|\n",
    );
    for m in PRESETS {
        let _ = writeln!(
            text,
            "| `{}` | {} | {} | {} mm | {} N/m | {} N/m | {} N/m | {} N/m | {} µN·m | {} % | {} | {} |",
            m.name,
            m.summary,
            m.density,
            (m.thickness * 1e6).round() / 1e3,
            m.stretch_stiffness,
            m.membrane[0],
            m.membrane[1],
            m.membrane[2],
            (m.bending_rigidity * 1e7).round() / 10.0,
            (m.strain_limit * 1e3).round() / 10.0,
            m.damping_ratio,
            m.friction
        );
    }
    text + &curves()
}

/// Force by strain of the presets at shares of their largest strain.
fn curves() -> String {
    let mut text = String::from(
        "\n### Force by strain\n\nIn long steps (`integrator = \"tr_bdf2\"`) garments with an `extension` stiffen as they are pulled, here as springs: force \
         per width at shares of the\nlargest strain ([source](../guide/materials.md#force-by-strain)).\n\n| word | largest \
         strain | at a quarter of it | at half | at three quarters | there | linearity |\n|---|---|---|---|---|---|---|\n",
    );
    for m in PRESETS {
        let Ok(Some(curve)) = m.curve() else { continue };
        let at = |share: f64| {
            let strain = share * m.strain_limit;
            (m.stretch_stiffness * strain * curve.factor(strain) * 10.0).round() / 10.0
        };
        let [quarter, half, most, there] = [0.25, 0.5, 0.75, 1.0].map(at);
        let percent = (m.strain_limit * 1e3).round() / 10.0;
        let _ = writeln!(
            text,
            "| `{}` | {percent} % | {quarter} N/m | {half} N/m | {most} N/m | {there} N/m | {} |",
            m.name, m.linearity
        );
    }
    text
}
