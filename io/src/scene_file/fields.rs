//! Values that have rows: their checks, their defaults, and what was said. They are not known to serde: tables of effects and of
//! the solver's descriptions say what they may be.

use std::collections::BTreeMap;

use drapery_core::scene::number_curves::ChangingNumbers;
use drapery_core::scene::{
    BodyDescription, ContactRule, Described, ElasticDescription, GarmentDescription, PRESET, PinDescription,
    SeamDescription, SolverSettings,
};
use drapery_core::settings::{Default, Field, SettingValue, Settings, Written};

use super::deserialize::{dotted, suggestion};
use super::diagnostics::SceneFileError;
use super::raw::{BIND, PAIRING};
use super::resolved::origin;
use super::tree::{Node, Origin, Path, Segment, Sources, Value};

/// A table with values that have rows. Its other keys are those of a struct in [`super::raw`].
pub(super) struct Rows {
    /// Keys that lead to it.
    pub(super) path: &'static [&'static str],
    /// Name of the struct.
    pub(super) rest: &'static str,
    /// Rows of the solver's description, and those that become other members of it.
    parts: [&'static [Field]; 2],
    /// Names of the rows whose numbers may change over time.
    changing: &'static [&'static str],
}

/// Every element of a list, in a path.
pub(super) const EACH: &str = "*";

/// The key of an ideal shape, whose words have rows of their own ([`super::shape`]).
pub(super) const SHAPE: &str = "shape";

/// Path of the bodies.
const BODIES: &[&str] = &["body", EACH];

pub(super) const TABLES: [Rows; 7] = [
    Rows { path: &["solver"], rest: "Solver", parts: [SolverSettings::FIELDS, &[PRESET]], changing: &[] },
    Rows::of::<BodyDescription>(BODIES, "Body", &[]),
    Rows::of::<GarmentDescription>(&["garment", EACH], "Garment", &[]),
    Rows::of::<PinDescription>(&["garment", EACH, "pin", EACH], "Pin", &[BIND]),
    Rows::of::<ElasticDescription>(&["garment", EACH, "elastic", EACH], "Elastic", &[]),
    Rows::of::<SeamDescription>(&["seam", EACH], "Seam", &[PAIRING]),
    Rows::of::<ContactRule>(&["contact", EACH], "Contact", &[]),
];

impl Rows {
    /// The rows of a description, and those that become other members of it.
    const fn of<T: ChangingNumbers>(
        path: &'static [&'static str],
        rest: &'static str,
        others: &'static [Field],
    ) -> Self {
        Self { path, rest, parts: [T::FIELDS, others], changing: T::CHANGING }
    }

    /// Rows whose numbers may change over time.
    pub(super) fn changing(&self) -> impl Iterator<Item = &'static Field> {
        self.fields().filter(|field| self.changing.contains(&field.name))
    }

    /// All rows.
    pub(super) fn fields(&self) -> impl Iterator<Item = &'static Field> {
        self.parts.into_iter().flatten()
    }

    /// Keys of the table that serde does not know.
    fn keys(&self) -> impl Iterator<Item = &'static str> {
        self.fields().map(|field| field.name).chain((self.path == BODIES).then_some(SHAPE))
    }

    fn is_at(&self, path: &Path) -> bool {
        let is_step = |(segment, key): (&Segment, &&str)| match segment {
            Segment::Key(word) => word == key,
            Segment::Index(_) => *key == EACH,
        };
        path.0.len() == self.path.len() && path.0.iter().zip(self.path).all(is_step)
    }
}

/// Paths of what stands at these keys.
pub(super) fn found(root: &Node, keys: &[&str]) -> Vec<Path> {
    let step = |path: Path, key: &str| match &path.find(root).value {
        Value::Array(items) if key == EACH => (0..items.len()).map(|index| path.clone().index(index)).collect(),
        Value::Table(table) if table.get(key).is_some() => vec![path.key(key)],
        _ => Vec::new(),
    };
    keys.iter().fold(vec![Path::default()], |paths, key| paths.into_iter().flat_map(|path| step(path, key)).collect())
}

/// Paths of the shapes of bodies.
pub(super) fn shapes(root: &Node) -> Vec<Path> {
    found(root, &[BODIES, &[SHAPE]].concat())
}

/// Keys with rows of the table at a path.
pub(super) fn names_at(path: &Path) -> Vec<&'static str> {
    TABLES.iter().filter(|rows| rows.is_at(path)).flat_map(Rows::keys).collect()
}

/// The tree without values that have rows, shapes, and what stands at `other` paths.
pub(super) fn without(mut root: Node, other: impl Iterator<Item = Path>) -> Node {
    let keys = TABLES.iter().flat_map(|rows| rows.keys().map(move |key| (rows, key)));
    let own = keys.flat_map(|(rows, key)| found(&root, &[rows.path, &[key]].concat()));
    for mut path in own.chain(other).collect::<Vec<_>>() {
        let (Some(Segment::Key(key)), table) = (path.0.pop(), path.find_mut(&mut root)) else { continue };
        table.and_then(Node::as_table_mut).into_iter().for_each(|table| table.0.retain(|entry| entry.key != key));
    }
    root
}

/// Checks every value that has a row.
///
/// # Errors
/// The first that does not fit.
pub(super) fn check(root: &Node, sources: &Sources) -> Result<(), SceneFileError> {
    for rows in &TABLES {
        for path in found(root, rows.path) {
            // What is no table is reported with the other keys.
            let node = path.find(root);
            for part in rows.parts.into_iter().filter(|_| node.as_table().is_some()) {
                check_values(node, part, &path, sources)?;
            }
        }
    }
    Ok(())
}

/// Checks a table of which every key has a row, and gives what it says; `help` is for something else in its place.
///
/// # Errors
/// All keys that have no row, else the first value that does not fit.
pub(super) fn check_table(
    node: &Node,
    fields: &[Field],
    path: &Path,
    sources: &Sources,
    help: String,
) -> Result<Settings, SceneFileError> {
    let Some(table) = node.as_table() else {
        return Err(sources.error(&node.place, format!("`{}` has to be a table", dotted(path)), Some(help)));
    };
    let names: Vec<&str> = fields.iter().map(|field| field.name).collect();
    let unknown = table.0.iter().filter(|entry| !names.contains(&entry.key.as_str())).map(|entry| {
        let text = format!("unknown key `{}` in `{}`", entry.key, dotted(path));
        sources.error(&entry.key_place, text, Some(suggestion(&entry.key, &names)))
    });
    if let Some(error) = unknown.reduce(SceneFileError::and) {
        return Err(error);
    }
    check_values(node, fields, path, sources)
}

/// Checks the values of a table that have these rows.
fn check_values(node: &Node, fields: &[Field], path: &Path, sources: &Sources) -> Result<Settings, SceneFileError> {
    let value_of = |field: &Field| node.as_table().and_then(|table| table.get(field.name));
    for (field, node) in fields.iter().filter_map(|field| Some((field, value_of(field)?))) {
        let value = setting(&node.value).ok_or_else(|| field.expected());
        let is_file = field.name == PRESET.name && node.as_text().is_some_and(|text| text.contains(['.', '/']));
        let help = is_file.then(|| "a file of settings is given on the command line, with --preset FILE".to_owned());
        value.and_then(|value| field.check(&value)).map_err(|text| sources.error(&node.place, text, help))?;
    }
    // What is left to go wrong is a setting that has to be there and is not.
    let missing = |texts: Vec<String>| format!("in `{}`: {}", dotted(path), texts.join("; "));
    Settings::check(fields, &written(node, fields)).map_err(|texts| sources.error(&node.place, missing(texts), None))
}

/// Returns the settings that a table of a checked scene states by these rows, with their defaults.
pub(super) fn settings(node: &Node, fields: &[Field]) -> Settings {
    let checked = Settings::check(fields, &written(node, fields));
    checked.unwrap_or_else(|texts| panic!("checked when it was read: {}", texts.join("; ")))
}

/// Returns the values that were written; defaults are left to the rows, which then know them as such.
pub(super) fn written(node: &Node, fields: &[Field]) -> Written {
    let of = |field: &Field| {
        let node = node.as_table()?.get(field.name).filter(|node| node.origin != Origin::Default)?;
        Some((field.name.to_owned(), setting(&node.value)?))
    };
    fields.iter().filter_map(of).collect()
}

/// Returns the origin of each value that was written, in the words of `resolved.toml`.
pub(super) fn sources(node: &Node, fields: &[Field]) -> BTreeMap<String, String> {
    let of = |field: &Field| {
        let node = node.as_table()?.get(field.name).filter(|node| node.origin != Origin::Default)?;
        Some((field.name.to_owned(), origin(node).to_string()))
    };
    fields.iter().filter_map(of).collect()
}

/// Adds the defaults of rows to those of the structs.
pub(super) fn add_defaults(document: &mut toml::Value) {
    for rows in &TABLES {
        at_each(document, rows.path, &|table| {
            for (name, value) in rows.fields().filter_map(|field| Some((field.name, default(field)?))) {
                table.insert(name.to_owned(), value);
            }
        });
    }
}

fn at_each(value: &mut toml::Value, path: &[&str], fill: &dyn Fn(&mut toml::Table)) {
    match (value, path.split_first()) {
        (toml::Value::Table(table), None) => fill(table),
        (toml::Value::Table(table), Some((key, rest))) => {
            table.get_mut(*key).into_iter().for_each(|inner| at_each(inner, rest, fill));
        }
        (toml::Value::Array(items), Some((_, rest))) => items.iter_mut().for_each(|item| at_each(item, rest, fill)),
        _ => {}
    }
}

/// The default of a row as it is written out, if it is.
pub(super) fn default(field: &Field) -> Option<toml::Value> {
    match field.default {
        Default::Conditional(_) => None,
        Default::Count(count) => Some(count.into()),
        default => match default.value()? {
            SettingValue::Number(number) => Some(number.into()),
            SettingValue::Text(text) => Some(text.into()),
            SettingValue::Vector(vector) => Some(vector.to_vec().into()),
            SettingValue::Flag(flag) => Some(flag.into()),
            SettingValue::Keys(_) => None,
        },
    }
}

/// The setting that a value of the tree is.
pub(super) fn setting(value: &Value) -> Option<SettingValue> {
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
