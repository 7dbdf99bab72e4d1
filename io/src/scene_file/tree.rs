//! A scene file as a tree of values, each with its place in the text and its origin.

use std::fmt;
use std::ops::Range;
use std::sync::Arc;

use toml::de::{DeTable, DeValue};

use super::diagnostics::{Location, SceneFileError};

/// Origin of a value; shown in `resolved.toml`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Origin {
    /// Written in the scene file.
    Scene,
    /// Written as `$name` in the scene file, with the value declared there.
    Parameter(String),
    /// Given on the command line, directly or through a parameter (then with its name).
    Set(Option<String>),
    /// Default of the format or of an effect.
    Default,
    /// Preset of the solver.
    Preset(String),
    /// Preset material, or one from a file.
    Material(String),
    /// Follows from the meshes.
    Meshes,
    /// A path of the given origin, replaced by a path map.
    PathMap(Box<Origin>),
}

impl fmt::Display for Origin {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Scene => f.write_str("scene"),
            Self::Parameter(name) => write!(f, "scene, parameter {name}"),
            Self::Set(None) => f.write_str("--set"),
            Self::Set(Some(name)) => write!(f, "--set {name}"),
            Self::Default => f.write_str("default"),
            Self::Preset(name) => write!(f, "preset {name}"),
            Self::Material(name) => write!(f, "material {name}"),
            Self::Meshes => f.write_str("from the faces of the body and the garments"),
            Self::PathMap(origin) => write!(f, "{origin}, path map"),
        }
    }
}

/// Text of the scene file and of every `--set` argument.
#[derive(Debug, Clone)]
pub(super) struct Sources(Vec<(String, Arc<str>)>);

impl Sources {
    pub(super) fn new(name: &str, text: &str) -> Self {
        Self(vec![(name.to_owned(), text.into())])
    }

    /// Adds a source and returns its number.
    pub(super) fn add(&mut self, name: String, text: &str) -> usize {
        self.0.push((name, text.into()));
        self.0.len() - 1
    }

    pub(super) fn location(&self, place: &Place) -> Location {
        let (name, text) = &self.0[place.source];
        Location { source_name: name.clone(), source: Arc::clone(text), span: place.span.clone() }
    }

    pub(super) fn error(&self, place: &Place, message: impl Into<String>, help: Option<String>) -> SceneFileError {
        SceneFileError::at(self.location(place), message, help)
    }
}

/// A stretch of one source.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(super) struct Place {
    pub(super) source: usize,
    pub(super) span: Range<usize>,
}

/// A value with its place and origin.
#[derive(Debug, Clone)]
pub(super) struct Node {
    pub(super) value: Value,
    pub(super) place: Place,
    pub(super) origin: Origin,
}

/// Value of a node.
#[derive(Debug, Clone)]
pub(super) enum Value {
    Boolean(bool),
    Integer(i64),
    Float(f64),
    Text(String),
    Array(Vec<Node>),
    Table(Table),
}

/// Entries in the order of the file.
#[derive(Debug, Clone, Default)]
pub(super) struct Table(pub(super) Vec<Entry>);

/// A key and its value.
#[derive(Debug, Clone)]
pub(super) struct Entry {
    pub(super) key: String,
    pub(super) key_place: Place,
    pub(super) node: Node,
}

impl Table {
    pub(super) fn get(&self, key: &str) -> Option<&Node> {
        self.0.iter().find(|e| e.key == key).map(|e| &e.node)
    }

    pub(super) fn get_mut(&mut self, key: &str) -> Option<&mut Node> {
        self.0.iter_mut().find(|e| e.key == key).map(|e| &mut e.node)
    }

    pub(super) fn entry(&self, key: &str) -> Option<&Entry> {
        self.0.iter().find(|e| e.key == key)
    }

    /// Inserts a value unless the key is there already. It takes the place of its table.
    pub(super) fn fill(&mut self, key: &str, value: Value, place: &Place, origin: Origin) {
        if self.get(key).is_none() {
            let node = Node { value, place: place.clone(), origin };
            self.0.push(Entry { key: key.to_owned(), key_place: place.clone(), node });
        }
    }
}

impl Node {
    pub(super) fn as_table(&self) -> Option<&Table> {
        match &self.value {
            Value::Table(table) => Some(table),
            _ => None,
        }
    }

    pub(super) fn as_table_mut(&mut self) -> Option<&mut Table> {
        match &mut self.value {
            Value::Table(table) => Some(table),
            _ => None,
        }
    }

    pub(super) fn as_text(&self) -> Option<&str> {
        match &self.value {
            Value::Text(text) => Some(text),
            _ => None,
        }
    }

    /// Adds everything of `defaults` that is not here, at every depth, with the origin `Default`.
    ///
    /// Arrays are merged element by element when both are equally long: they are then lists of tables.
    pub(super) fn fill_from(&mut self, defaults: &toml::Value) {
        match (&mut self.value, defaults) {
            (Value::Table(table), toml::Value::Table(more)) => {
                for (key, value) in more {
                    match table.get_mut(key) {
                        Some(node) => node.fill_from(value),
                        None => table.fill(key, Value::from_toml(value, &self.place), &self.place, Origin::Default),
                    }
                }
            }
            (Value::Array(items), toml::Value::Array(more)) if items.len() == more.len() => {
                items.iter_mut().zip(more).for_each(|(item, value)| item.fill_from(value));
            }
            _ => {}
        }
    }
}

impl Value {
    /// A default at the place of the table that it completes.
    pub(super) fn from_toml(value: &toml::Value, place: &Place) -> Self {
        let node = |value: &toml::Value| Node {
            value: Self::from_toml(value, place),
            place: place.clone(),
            origin: Origin::Default,
        };
        match value {
            toml::Value::String(text) => Self::Text(text.clone()),
            toml::Value::Integer(number) => Self::Integer(*number),
            toml::Value::Float(number) => Self::Float(*number),
            toml::Value::Boolean(flag) => Self::Boolean(*flag),
            toml::Value::Datetime(time) => Self::Text(time.to_string()),
            toml::Value::Array(items) => Self::Array(items.iter().map(node).collect()),
            toml::Value::Table(table) => {
                let entry = |(key, value): (&String, &toml::Value)| Entry {
                    key: key.clone(),
                    key_place: place.clone(),
                    node: node(value),
                };
                Self::Table(Table(table.iter().map(entry).collect()))
            }
        }
    }
}

/// Reads TOML text that is source number `source` of `sources`.
///
/// # Errors
/// The text is not TOML, or holds a date.
pub(super) fn parse(sources: &Sources, source: usize, origin: &Origin) -> Result<Node, SceneFileError> {
    let text = &sources.0[source].1;
    let reader = Reader { sources, source, origin };
    let parsed = DeTable::parse(text).map_err(|error| {
        let span = error.span().unwrap_or(0..0);
        sources.error(&Place { source, span }, error.message(), Some("this is not valid TOML".to_owned()))
    })?;
    let value = Value::Table(reader.table(parsed.get_ref())?);
    Ok(Node { value, place: Place { source, span: 0..0 }, origin: origin.clone() })
}

struct Reader<'a> {
    sources: &'a Sources,
    source: usize,
    origin: &'a Origin,
}

impl Reader<'_> {
    fn table(&self, table: &DeTable<'_>) -> Result<Table, SceneFileError> {
        let mut entries = Vec::with_capacity(table.len());
        for (key, value) in table {
            let key_place = Place { source: self.source, span: key.span() };
            let node = self.node(value)?;
            entries.push(Entry { key: key.get_ref().to_string(), key_place, node });
        }
        // The parser sorts by name; messages and `resolved.toml` follow the file.
        entries.sort_by_key(|e| e.key_place.span.start);
        Ok(Table(entries))
    }

    fn node(&self, value: &toml::Spanned<DeValue<'_>>) -> Result<Node, SceneFileError> {
        let place = Place { source: self.source, span: value.span() };
        let wrong = |what: &str| self.sources.error(&place, what, None);
        let converted = match value.get_ref() {
            DeValue::String(text) => Value::Text(text.to_string()),
            DeValue::Boolean(flag) => Value::Boolean(*flag),
            DeValue::Integer(number) => Value::Integer(
                i64::from_str_radix(number.as_str(), number.radix())
                    .map_err(|_| wrong("this integer is larger than 64 bits can hold"))?,
            ),
            DeValue::Float(number) => {
                Value::Float(number.as_str().parse().map_err(|_| wrong("this is not a number that f64 can hold"))?)
            }
            DeValue::Datetime(_) => {
                return Err(wrong("dates are not allowed in a scene; write text in quotes or a number"));
            }
            DeValue::Array(items) => Value::Array(items.iter().map(|item| self.node(item)).collect::<Result<_, _>>()?),
            DeValue::Table(table) => Value::Table(self.table(table)?),
        };
        Ok(Node { value: converted, place, origin: self.origin.clone() })
    }
}

/// One step into a tree.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Segment {
    Key(String),
    Index(usize),
}

/// A path into a tree, for messages.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(super) struct Path(pub(super) Vec<Segment>);

impl Path {
    pub(super) fn key(mut self, key: &str) -> Self {
        self.0.push(Segment::Key(key.to_owned()));
        self
    }

    pub(super) fn index(mut self, index: usize) -> Self {
        self.0.push(Segment::Index(index));
        self
    }

    /// The deepest node that exists along the path.
    pub(super) fn find<'a>(&self, root: &'a Node) -> &'a Node {
        let mut node = root;
        for segment in &self.0 {
            let next = match (segment, &node.value) {
                (Segment::Key(key), Value::Table(table)) => table.get(key),
                (Segment::Index(index), Value::Array(items)) => items.get(*index),
                _ => None,
            };
            match next {
                Some(next) => node = next,
                None => break,
            }
        }
        node
    }

    /// The node at the path, if all of it exists.
    pub(super) fn find_mut<'a>(&self, root: &'a mut Node) -> Option<&'a mut Node> {
        self.0.iter().try_fold(root, |node, segment| match (segment, &mut node.value) {
            (Segment::Key(key), Value::Table(table)) => table.get_mut(key),
            (Segment::Index(index), Value::Array(items)) => items.get_mut(*index),
            _ => None,
        })
    }

    /// Place of the value at the path, or of what encloses the place where it should be.
    pub(super) fn place(&self, root: &Node) -> Place {
        self.find(root).place.clone()
    }
}
