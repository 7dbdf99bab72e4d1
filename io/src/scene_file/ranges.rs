//! The ranges of a scene's numbers that have no rows (`fields`). They are declared beside the keys (`raw`), the JSON schema
//! shows them, and what was written is held against that schema before anything is built: a number that would keep the program
//! busy for hours, or overflow on the way, is a slip of the hand.

use std::sync::LazyLock;

use drapery_core::settings::short;
use serde_json::Value as Json;

use super::deserialize::dotted;
use super::diagnostics::SceneFileError;
use super::raw::Document;
use super::tree::{Node, Path, Segment, Sources, Value};

static SCHEMA: LazyLock<Json> = LazyLock::new(|| schemars::schema_for!(Document).to_value());

/// Smallest and largest number at a key, as far as there are such.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Range {
    least: Option<f64>,
    most: Option<f64>,
}

impl Range {
    /// Refuses a number outside, with what is expected.
    pub(super) fn check(self, value: f64) -> Result<(), String> {
        let Self { least, most } = self;
        if least.is_none_or(|least| value >= least) && most.is_none_or(|most| value <= most) {
            return Ok(());
        }
        let expected = match (least, most) {
            (Some(least), Some(most)) => format!("a number from {} to {}", short(least), short(most)),
            (Some(least), None) => format!("{} or more", short(least)),
            (None, Some(most)) => format!("at most {}", short(most)),
            (None, None) => return Ok(()),
        };
        Err(format!("{} is out of range; expected {expected}", short(value)))
    }
}

/// Holds every number of a tree without effects against its range.
///
/// # Errors
/// The first number that is outside, at its place.
pub(super) fn check(root: &Node, sources: &Sources) -> Result<(), SceneFileError> {
    look(root, &[&SCHEMA], &Path::default(), sources)
}

/// The range of the number at a path, if it has one.
pub(super) fn at(path: &Path) -> Option<Range> {
    let forms = path.0.iter().fold(vec![&*SCHEMA], |forms, segment| step(&forms, segment));
    forms.iter().find_map(|form| of_form(form))
}

fn look(node: &Node, forms: &[&Json], path: &Path, sources: &Sources) -> Result<(), SceneFileError> {
    let number = match &node.value {
        Value::Integer(number) => *number as f64,
        Value::Float(number) => *number,
        Value::Array(items) => {
            let next = |(index, item)| (path.clone().index(index), Segment::Index(index), item);
            return look_into(items.iter().enumerate().map(next), forms, sources);
        }
        Value::Table(table) => {
            let entries = table.0.iter();
            let next = entries.map(|e| (path.clone().key(&e.key), Segment::Key(e.key.clone()), &e.node));
            return look_into(next, forms, sources);
        }
        Value::Boolean(_) | Value::Text(_) => return Ok(()),
    };
    let forms = expanded(forms);
    let Some(range) = forms.iter().find_map(|form| of_form(form)) else { return Ok(()) };
    range.check(number).map_err(|what| sources.error(&node.place, format!("`{}`: {what}", dotted(path)), None))
}

fn look_into<'a>(
    mut inner: impl Iterator<Item = (Path, Segment, &'a Node)>,
    forms: &[&Json],
    sources: &Sources,
) -> Result<(), SceneFileError> {
    inner.try_for_each(|(path, segment, node)| look(node, &step(forms, &segment), &path, sources))
}

/// Returns the schemas of a key or an element.
fn step<'a>(forms: &[&'a Json], segment: &Segment) -> Vec<&'a Json> {
    let inner = |form: &&'a Json| match segment {
        Segment::Key(key) => form["properties"].get(key),
        Segment::Index(index) => form["prefixItems"].get(index).or_else(|| form.get("items")),
    };
    expanded(&expanded(forms).iter().filter_map(inner).collect::<Vec<_>>())
}

/// Schemas with what they refer to, and the alternatives that they allow.
fn expanded<'a>(forms: &[&'a Json]) -> Vec<&'a Json> {
    let mut found = Vec::new();
    for form in forms {
        found.push(*form);
        let referred = form["$ref"].as_str().and_then(|name| SCHEMA.pointer(name.trim_start_matches('#')));
        let choices = ["anyOf", "oneOf"].into_iter().filter_map(|key| form[key].as_array()).flatten();
        found.extend(expanded(&referred.into_iter().chain(choices).collect::<Vec<_>>()));
    }
    found
}

fn of_form(form: &Json) -> Option<Range> {
    let [least, most] = ["minimum", "maximum"].map(|key| form[key].as_f64());
    (least.is_some() || most.is_some()).then_some(Range { least, most })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_range_says_what_it_expects() {
        let both = Range { least: Some(1.0), most: Some(1e9) };
        assert_eq!(both.check(1.0).and(both.check(1e9)), Ok(()));
        assert_eq!(both.check(0.5).unwrap_err(), "0.5 is out of range; expected a number from 1 to 1e9");
        assert_eq!(both.check(f64::NAN).unwrap_err(), "NaN is out of range; expected a number from 1 to 1e9");
        let below = Range { least: Some(0.0), most: None };
        assert_eq!(below.check(f64::INFINITY), Ok(()));
        assert_eq!(below.check(-1e-300).unwrap_err(), "-1e-300 is out of range; expected 0 or more");
    }

    #[test]
    fn ranges_are_found_through_lists_tables_and_alternatives() {
        let panel = Path::default().key("garment").index(0).key("panel").key("resolution");
        assert_eq!(at(&panel), Some(Range { least: Some(1.0), most: Some(20_000.0) }));
        let spin = Path::default().key("body").index(2).key("spin").key("angular_velocity").index(1);
        assert!(at(&spin).is_some_and(|range| range.check(-1e6).is_err()));
        let path = Path::default().key("body").index(0).key("path").index(3).index(1).index(2);
        assert!(at(&path).is_some_and(|range| range.check(1e10).is_err() && range.check(1e9).is_ok()));
        assert_eq!(at(&Path::default().key("garment").index(0).key("name")), None);
    }
}
