//! From the tree to typed structs, by serde; failures carry what a good message needs.

use std::fmt;

use serde::de::value::{MapDeserializer, SeqDeserializer};
use serde::de::{self, DeserializeOwned, IntoDeserializer, Unexpected, Visitor};
use serde_path_to_error::Segment as SerdeSegment;

use drapery_core::settings::nearest;

use super::diagnostics::SceneFileError;
use super::tree::{Node, Path, Place, Segment, Sources, Table, Value};

/// Why a value does not fit its type.
#[derive(Debug)]
enum Misfit {
    Unknown { word: String, expected: &'static [&'static str], is_key: bool },
    Missing(&'static str),
    Other(String),
}

impl fmt::Display for Misfit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unknown { word, is_key: true, .. } => write!(f, "unknown key `{word}`"),
            Self::Unknown { word, is_key: false, .. } => write!(f, "unknown word `{word}`"),
            Self::Missing(key) => write!(f, "`{key}` is missing"),
            Self::Other(text) => f.write_str(text),
        }
    }
}

impl std::error::Error for Misfit {}

impl de::Error for Misfit {
    fn custom<T: fmt::Display>(text: T) -> Self {
        Self::Other(text.to_string())
    }

    fn invalid_type(found: Unexpected<'_>, expected: &dyn de::Expected) -> Self {
        Self::Other(format!("expected {}, found {}", plain(&expected.to_string()), describe(found)))
    }

    fn invalid_value(found: Unexpected<'_>, expected: &dyn de::Expected) -> Self {
        Self::Other(format!("expected {}, found {}", plain(&expected.to_string()), describe(found)))
    }

    fn invalid_length(length: usize, expected: &dyn de::Expected) -> Self {
        Self::Other(format!("expected {}, found a list of {length}", plain(&expected.to_string())))
    }

    fn unknown_field(word: &str, expected: &'static [&'static str]) -> Self {
        Self::Unknown { word: word.to_owned(), expected, is_key: true }
    }

    fn unknown_variant(word: &str, expected: &'static [&'static str]) -> Self {
        Self::Unknown { word: word.to_owned(), expected, is_key: false }
    }

    fn missing_field(field: &'static str) -> Self {
        Self::Missing(field)
    }
}

/// Examples of tables that are usually written on one line.
const EXAMPLES: [(&str, &str); 12] = [
    ("Preroll", "{ settle = 24 }"),
    ("FileUnits", "{ length = \"cm\", up = \"Y\" }"),
    ("Rotation", "{ axis = [0, 1, 0], degrees = 90 }"),
    ("Spin", "{ angular_velocity = [0, 1, 0] }"),
    ("Panel", "{ resolution = 40 }"),
    ("Disc", "{ resolution = 20, radius = 0.5 }"),
    ("Ball", "{ resolution = 20, radius = 0.5 }"),
    ("Tube", "{ resolution = 40, radius = 0.5, length = 1 }"),
    ("Folds", "{ layers = 4, gap = 0.005 }"),
    ("Jitter", "{ axis = \"y\", amplitude = 0.001, seed = 1 }"),
    ("RandomVelocity", "{ speed = \"1 m/s\", seed = 1 }"),
    ("SeamSide", "{ garment = \"left\", vertices = [0, 1] }"),
];

/// Example of a region.
const REGION: &str = "{ box = { min = [-1, 0, -1], max = [1, 2, 1] } }";

/// Returns the words for Rust's types that are used outside of Rust.
fn plain(expected: &str) -> String {
    match expected {
        "u32" | "u64" | "usize" => "a whole number, zero or more".to_owned(),
        "u8" => "a whole number from 0 to 255".to_owned(),
        "a nonzero u16" => "a whole number from 1 to 65535".to_owned(),
        "f64" => "a number".to_owned(),
        "a string" => "text in quotes".to_owned(),
        "a boolean" => "true or false".to_owned(),
        "a sequence" => "a list in brackets".to_owned(),
        "a tuple of size 2" => "a pair [seconds, [x, y, z]]".to_owned(),
        "an array of length 3" => "three numbers".to_owned(),
        "an array of length 2" => "a list of two".to_owned(),
        "struct variant" => format!("a table such as {REGION}"),
        other => match other.strip_prefix("struct ") {
            Some(name) => match EXAMPLES.iter().find(|(table, _)| *table == name) {
                Some((_, example)) => format!("a table such as {example}"),
                None => "a table".to_owned(),
            },
            None => other.to_owned(),
        },
    }
}

fn describe(found: Unexpected<'_>) -> String {
    match found {
        Unexpected::Bool(flag) => flag.to_string(),
        Unexpected::Signed(number) => number.to_string(),
        Unexpected::Unsigned(number) => number.to_string(),
        Unexpected::Float(number) => number.to_string(),
        Unexpected::Str(text) => format!("the text \"{text}\""),
        Unexpected::Seq => "a list".to_owned(),
        Unexpected::Map => "a table".to_owned(),
        Unexpected::UnitVariant => "a word alone".to_owned(),
        other => other.to_string(),
    }
}

/// Reads `root` as a `T`. `also` are keys that are allowed beside those of a struct, by the path of the struct: the
/// tables of effects, which were taken out before.
///
/// # Errors
/// The first value that does not fit, at its place. If it is an unknown key, those behind it follow.
pub(super) fn read<T: DeserializeOwned>(
    root: &Node,
    sources: &Sources,
    also: impl Fn(&Path) -> Vec<&'static str>,
) -> Result<T, SceneFileError> {
    let Refusal { mut error, mut key } = match attempt(root, sources, &also) {
        Ok(read) => return Ok(read),
        Err(refusal) => *refusal,
    };
    let mut rest = root.clone();
    while key.take().is_some_and(|key| key.mend(&mut rest)) {
        if let Err(refusal) = attempt::<T>(&rest, sources, &also)
            && refusal.key.is_some()
        {
            error = error.and(refusal.error);
            key = refusal.key;
        }
    }
    Err(error)
}

/// Why a tree does not fit its type.
struct Refusal {
    error: SceneFileError,
    /// The key that is unknown, if it is one.
    key: Option<UnknownKey>,
}

/// An unknown key.
struct UnknownKey {
    table: Path,
    word: String,
    /// The key that it may be meant for.
    meant: Option<String>,
}

impl UnknownKey {
    /// Takes it for the key that it may be meant for, unless that is there too; else it goes. Returns whether it was there.
    fn mend(self, root: &mut Node) -> bool {
        let Some(table) = self.table.find_mut(root).and_then(Node::as_table_mut) else { return false };
        let Some(index) = table.0.iter().position(|entry| entry.key == self.word) else { return false };
        match self.meant.filter(|meant| table.get(meant).is_none()) {
            Some(meant) => table.0[index].key = meant,
            None => drop(table.0.remove(index)),
        }
        true
    }
}

/// Reads `root` as a `T` up to the first value that does not fit.
fn attempt<T: DeserializeOwned>(
    root: &Node,
    sources: &Sources,
    also: &impl Fn(&Path) -> Vec<&'static str>,
) -> Result<T, Box<Refusal>> {
    serde_path_to_error::deserialize(Reader(root)).map_err(|error| {
        let mut path = Path(error.path().iter().filter_map(segment).collect());
        let misfit = error.into_inner();
        let Misfit::Unknown { word, expected, is_key } = &misfit else {
            let error = sources.error(&path.place(root), format!("{}{misfit}", label(&path)), None);
            return Box::new(Refusal { error, key: None });
        };
        if path.0.last() == Some(&Segment::Key(word.clone())) {
            path.0.pop();
        }
        let mut words: Vec<&str> = expected.to_vec();
        words.extend(also(&path));
        let place = key_place(path.find(root), word);
        let owner =
            if *is_key { format!("{misfit} {}", table_name(&path)) } else { format!("{}{misfit}", label(&path)) };
        let error = sources.error(&place, owner, Some(suggestion(word, &words)));
        // What another table may hold is no key of this one.
        let meant = meant(word, &words).filter(|meant| expected.contains(meant)).map(str::to_owned);
        let key = is_key.then(|| UnknownKey { table: path, word: word.clone(), meant });
        Box::new(Refusal { error, key })
    })
}

/// Words of other programs for keys of ours.
const ELSEWHERE: [(&str, &str); 4] = [
    ("substeps", "steps_per_frame"),
    ("sub_steps", "steps_per_frame"),
    ("subframes", "samples"),
    ("quality", "preset"),
];

/// "did you mean", or the list of what is allowed, if anything is.
pub(super) fn suggestion(word: &str, words: &[&str]) -> String {
    match meant(word, words) {
        Some(best) => format!("did you mean `{best}`?"),
        None if words.is_empty() => "leave it out: no key is allowed here".to_owned(),
        None => format!("allowed here: {}", words.join(", ")),
    }
}

/// The word that another may be meant for.
fn meant<'a>(word: &str, words: &[&'a str]) -> Option<&'a str> {
    let ours = ELSEWHERE.iter().find(|(theirs, ours)| *theirs == word && words.contains(ours)).map(|(_, ours)| *ours);
    ours.or_else(|| nearest(word, words.iter().copied()))
}

fn segment(segment: &SerdeSegment) -> Option<Segment> {
    match segment {
        SerdeSegment::Seq { index } => Some(Segment::Index(*index)),
        SerdeSegment::Map { key } => Some(Segment::Key(key.clone())),
        SerdeSegment::Enum { variant } => Some(Segment::Key(variant.clone())),
        SerdeSegment::Unknown => None,
    }
}

/// Place of the key `word` in a table; of the node itself when it is something else.
fn key_place(node: &Node, word: &str) -> Place {
    node.as_table().and_then(|t| t.entry(word)).map_or_else(|| node.place.clone(), |e| e.key_place.clone())
}

/// Names the place of a key, for use in a sentence.
fn table_name(path: &Path) -> String {
    if path.0.is_empty() { "at the top level".to_owned() } else { format!("in `{}`", dotted(path)) }
}

fn label(path: &Path) -> String {
    if path.0.is_empty() { String::new() } else { format!("`{}`: ", dotted(path)) }
}

/// `garment.0.pin.1`: the form that `--set` takes.
pub(super) fn dotted(path: &Path) -> String {
    let words: Vec<String> = path
        .0
        .iter()
        .map(|segment| match segment {
            Segment::Key(key) => key.clone(),
            Segment::Index(index) => index.to_string(),
        })
        .collect();
    words.join(".")
}

/// Serde's view of a node.
#[derive(Clone, Copy)]
struct Reader<'a>(&'a Node);

impl<'de> IntoDeserializer<'de, Misfit> for Reader<'de> {
    type Deserializer = Self;

    fn into_deserializer(self) -> Self {
        self
    }
}

fn entries(table: &Table) -> impl Iterator<Item = (&str, Reader<'_>)> {
    table.0.iter().map(|e| (e.key.as_str(), Reader(&e.node)))
}

impl<'de> de::Deserializer<'de> for Reader<'de> {
    type Error = Misfit;

    fn deserialize_any<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Misfit> {
        match &self.0.value {
            Value::Boolean(flag) => visitor.visit_bool(*flag),
            Value::Integer(number) => visitor.visit_i64(*number),
            Value::Float(number) => visitor.visit_f64(*number),
            Value::Text(text) => visitor.visit_str(text),
            Value::Array(items) => {
                let mut rest = SeqDeserializer::new(items.iter().map(Reader));
                let read = visitor.visit_seq(&mut rest)?;
                // A fixed-size list reads what it needs; one number too many is a mistake all the same.
                rest.end()?;
                Ok(read)
            }
            Value::Table(table) => visitor.visit_map(MapDeserializer::new(entries(table))),
        }
    }

    fn deserialize_option<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Misfit> {
        visitor.visit_some(self)
    }

    fn deserialize_newtype_struct<V: Visitor<'de>>(self, _: &'static str, visitor: V) -> Result<V::Value, Misfit> {
        visitor.visit_newtype_struct(self)
    }

    fn deserialize_enum<V: Visitor<'de>>(
        self,
        _: &'static str,
        variants: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Misfit> {
        match &self.0.value {
            Value::Text(text) => visitor.visit_enum(text.as_str().into_deserializer()),
            Value::Table(table) if table.0.len() == 1 => {
                visitor.visit_enum(de::value::MapAccessDeserializer::new(MapDeserializer::new(entries(table))))
            }
            Value::Table(_) => Err(Misfit::Other(format!("expected exactly one of {}", variants.join(", ")))),
            _ => Err(Misfit::Other(format!("expected one of {}", variants.join(", ")))),
        }
    }

    serde::forward_to_deserialize_any! {
        bool i8 i16 i32 i64 i128 u8 u16 u32 u64 u128 f32 f64 char str string bytes byte_buf unit unit_struct seq tuple
        tuple_struct map struct identifier ignored_any
    }
}
