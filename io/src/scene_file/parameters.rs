//! Named parameters, `$name` in values, and `--set`.
//!
//! `[parameters]` declares numbers and texts. A text that is `"$name"`, `"$name * 2"` or `"$name / 2"` becomes the
//! number; within longer text, `$name` or `${name}` is replaced by the parameter's text (`"skirt$quality.obj"`); `$$`
//! is a `$`.

use drapery_core::settings::nearest;

use super::deserialize::suggestion;
use super::diagnostics::SceneFileError;
use super::fields;
use super::tree::{self, Entry, Node, Origin, Path, Place, Sources, Table, Value};

/// Table of the parameters.
const PARAMETERS: &str = "parameters";

/// The most parts that a dotted key has: far more than any key of a scene.
const MOST_PARTS: usize = 64;

/// Applies `--set` arguments to the tree: parameters by name, everything else by its dotted key.
///
/// # Errors
/// A parameter that is not declared, a parameter of another kind, a path through something that is not a table.
pub(super) fn override_values(
    root: &mut Node,
    sources: &mut Sources,
    overrides: &[(String, String)],
) -> Result<(), SceneFileError> {
    for (key, text) in overrides {
        let argument = format!("{key}={text}");
        let source = sources.add("--set".to_owned(), &argument);
        let key_place = Place { source, span: 0..key.len() };
        let value_place = Place { source, span: key.len() + 1..argument.len() };
        let mut node = Node { value: set_value(text), place: value_place.clone(), origin: Origin::Set(None) };
        relocate(&mut node, &value_place);
        if !key.contains('.') {
            set_parameter(root, sources, key, node, &key_place)?;
            continue;
        }
        let words: Vec<&str> = key.split('.').collect();
        if let [PARAMETERS, name] = words[..] {
            set_parameter(root, sources, name, node, &key_place)?;
            continue;
        }
        if words.len() > MOST_PARTS {
            let text = format!("this key has {} parts, and no key of a scene has more than {MOST_PARTS}", words.len());
            let help = "give the dotted key of a value, for example solver.cfl=2".to_owned();
            return Err(sources.error(&key_place, text, Some(help)));
        }
        set_dotted(root, sources, &words, node, &key_place)?;
    }
    Ok(())
}

/// The value of a `--set`: TOML if it is TOML, else the bare text.
fn set_value(text: &str) -> Value {
    let sources = Sources::new("--set", &format!("value = {text}"));
    match tree::parse(&sources, 0, &Origin::Set(None)) {
        Ok(Node { value: Value::Table(Table(mut entries)), .. }) if entries.len() == 1 => entries.remove(0).node.value,
        _ => Value::Text(text.to_owned()),
    }
}

/// Puts everything inside a `--set` value at the place of the whole value.
fn relocate(node: &mut Node, place: &Place) {
    node.place = place.clone();
    match &mut node.value {
        Value::Array(items) => items.iter_mut().for_each(|item| relocate(item, place)),
        Value::Table(table) => {
            for entry in &mut table.0 {
                entry.key_place = place.clone();
                relocate(&mut entry.node, place);
            }
        }
        _ => {}
    }
}

fn set_parameter(
    root: &mut Node,
    sources: &Sources,
    name: &str,
    mut node: Node,
    key_place: &Place,
) -> Result<(), SceneFileError> {
    let keys = keys_ending_in(root, name);
    let parameters = root.as_table_mut().and_then(|t| t.get_mut(PARAMETERS)).and_then(Node::as_table_mut);
    let names: Vec<String> = parameters.iter().flat_map(|t| t.0.iter().map(|e| e.key.clone())).collect();
    let Some(declared) = parameters.and_then(|t| t.get_mut(name)) else {
        let names: Vec<&str> = names.iter().map(String::as_str).collect();
        let help = match keys.first() {
            Some(key) if nearest(name, names.iter().copied()).is_none() => format!("did you mean `{key}`?"),
            _ if names.is_empty() => {
                "it declares none; other values are set by their dotted key, for example solver.cfl=2".to_owned()
            }
            _ => suggestion(name, &names),
        };
        return Err(sources.error(key_place, format!("the scene has no parameter `{name}`"), Some(help)));
    };
    match (&declared.value, &node.value) {
        (Value::Text(_), Value::Text(_)) => {}
        // A text parameter may be set to something that looks like a number: `--set take=12`.
        (Value::Text(_), _) => {
            let location = sources.location(&node.place);
            node.value = Value::Text(location.source[location.span].to_owned());
        }
        (_, Value::Integer(_) | Value::Float(_)) => {}
        _ => {
            let text = format!("parameter `{name}` is a number in the scene; this is not one");
            return Err(sources.error(&node.place, text, None));
        }
    }
    node.origin = Origin::Set(Some(name.to_owned()));
    *declared = node;
    Ok(())
}

/// Dotted keys of the solver and of the scene's tables that end in a word.
fn keys_ending_in(root: &Node, word: &str) -> Vec<String> {
    let of_solver = fields::names_at(&Path::default().key("solver")).into_iter().filter(|name| *name == word);
    let of_solver = of_solver.map(|name| format!("solver.{name}"));
    let tables = root.as_table().into_iter().flat_map(|table| &table.0).filter(|entry| entry.key != PARAMETERS);
    let has = |entry: &&Entry| entry.node.as_table().is_some_and(|table| table.get(word).is_some());
    of_solver.chain(tables.filter(has).map(|entry| format!("{}.{word}", entry.key))).collect()
}

fn set_dotted(
    at: &mut Node,
    sources: &Sources,
    words: &[&str],
    node: Node,
    key_place: &Place,
) -> Result<(), SceneFileError> {
    let Some((word, rest)) = words.split_first() else {
        *at = node;
        return Ok(());
    };
    match &mut at.value {
        Value::Table(table) => {
            if table.get(word).is_none() {
                // A misspelt word ends up as an unknown key, which is reported with its place in this argument.
                let value = Value::Table(Table::default());
                let created = Node { value, place: key_place.clone(), origin: Origin::Set(None) };
                table.0.push(Entry { key: (*word).to_owned(), key_place: key_place.clone(), node: created });
            }
            match table.get_mut(word) {
                Some(next) => set_dotted(next, sources, rest, node, key_place),
                None => Ok(()),
            }
        }
        Value::Array(items) => {
            let names: Vec<String> = items.iter().map(name_of).collect();
            let found = word.parse().ok().filter(|i| *i < items.len()).or_else(|| names.iter().position(|n| n == word));
            match found {
                Some(index) => set_dotted(&mut items[index], sources, rest, node, key_place),
                None => {
                    let text = format!("there is no `{word}` in this list of {}", items.len());
                    let named: Vec<&str> = names.iter().map(String::as_str).filter(|name| !name.is_empty()).collect();
                    let help = match named.as_slice() {
                        [] => "use a number from 0".to_owned(),
                        named => format!("use a number from 0, or one of the names {}", named.join(", ")),
                    };
                    Err(sources.error(key_place, text, Some(help)))
                }
            }
        }
        _ => Err(sources.error(key_place, format!("`{word}` is inside a value that is not a table"), None)),
    }
}

fn name_of(item: &Node) -> String {
    item.as_table().and_then(|t| t.get("name")).and_then(Node::as_text).unwrap_or_default().to_owned()
}

/// Takes `[parameters]` out of the tree.
///
/// # Errors
/// Something other than numbers, texts and booleans is declared.
pub(super) fn take(root: &mut Node, sources: &Sources) -> Result<Table, SceneFileError> {
    let Some(table) = root.as_table_mut() else {
        return Ok(Table::default());
    };
    let Some(position) = table.0.iter().position(|e| e.key == PARAMETERS) else {
        return Ok(Table::default());
    };
    let node = table.0.remove(position).node;
    let Value::Table(parameters) = node.value else {
        return Err(sources.error(&node.place, "`parameters` has to be a table of numbers and texts", None));
    };
    for entry in &parameters.0 {
        let help = match &entry.node.value {
            Value::Array(_) | Value::Table(_) => "write the list where it is used, with `$name` for single numbers",
            Value::Text(text) if text.contains('$') => "a parameter cannot depend on other parameters",
            _ => continue,
        };
        let text = format!("parameter `{}` has to be a number or a text", entry.key);
        return Err(sources.error(&entry.node.place, text, Some(help.to_owned())));
    }
    Ok(parameters)
}

/// Replaces every `$name` in the tree.
///
/// # Errors
/// A name that is not declared, arithmetic on a text, a division by zero.
pub(super) fn substitute(node: &mut Node, parameters: &Table, sources: &Sources) -> Result<(), SceneFileError> {
    match &mut node.value {
        Value::Array(items) => items.iter_mut().try_for_each(|item| substitute(item, parameters, sources)),
        Value::Table(table) => {
            table.0.iter_mut().try_for_each(|entry| substitute(&mut entry.node, parameters, sources))
        }
        Value::Text(text) if text.contains('$') => {
            let replaced =
                replace(text, parameters).map_err(|(message, help)| sources.error(&node.place, message, Some(help)))?;
            node.value = replaced.value;
            if let (Some(name), Origin::Scene) = (replaced.parameter, &node.origin) {
                let set = parameters.get(&name).is_some_and(|p| matches!(p.origin, Origin::Set(_)));
                node.origin = if set { Origin::Set(Some(name)) } else { Origin::Parameter(name) };
            }
            Ok(())
        }
        _ => Ok(()),
    }
}

struct Replaced {
    value: Value,
    /// The last parameter used; one given by `--set` is preferred.
    parameter: Option<String>,
}

type Message = (String, String);

fn replace(text: &str, parameters: &Table) -> Result<Replaced, Message> {
    if let Some((name, operation)) = whole(text) {
        let parameter = Some(name.to_owned());
        let value = &lookup(name, parameters)?.value;
        match operation {
            None => return Ok(Replaced { value: value.clone(), parameter }),
            Some((times, factor)) => return Ok(Replaced { value: scale(name, value, times, factor)?, parameter }),
        }
    }
    let mut result = String::new();
    let mut used: Option<(String, bool)> = None;
    let mut rest = text;
    while let Some(start) = rest.find('$') {
        result.push_str(&rest[..start]);
        rest = &rest[start + 1..];
        if let Some(after) = rest.strip_prefix('$') {
            result.push('$');
            rest = after;
            continue;
        }
        let (name, after) = leading_name(rest).ok_or_else(|| {
            (format!("`$` in \"{text}\" is not followed by a name"), "write $$ for a dollar sign".to_owned())
        })?;
        let node = lookup(name, parameters)?;
        result.push_str(&plain(&node.value));
        let set = matches!(node.origin, Origin::Set(_));
        if set || used.as_ref().is_none_or(|(_, before)| !before) {
            used = Some((name.to_owned(), set));
        }
        rest = after;
    }
    result.push_str(rest);
    Ok(Replaced { value: Value::Text(result), parameter: used.map(|(name, _)| name) })
}

/// Splits `"$name"`, `"$name * 2"` and `"$name / 2"`; `Some(name, Some(is_multiplication, number))`.
fn whole(text: &str) -> Option<(&str, Option<(bool, f64)>)> {
    let (name, rest) = leading_name(text.strip_prefix('$')?)?;
    let rest = rest.trim();
    if rest.is_empty() {
        return Some((name, None));
    }
    let (times, number) = match rest.strip_prefix('*') {
        Some(number) => (true, number),
        None => (false, rest.strip_prefix('/')?),
    };
    Some((name, Some((times, number.trim().parse().ok()?))))
}

/// The name at the start of `text`, bare or in braces, and what follows.
fn leading_name(text: &str) -> Option<(&str, &str)> {
    let (inner, braced) = text.strip_prefix('{').map_or((text, false), |inner| (inner, true));
    let end = inner.find(|c: char| !(c.is_ascii_alphanumeric() || c == '_')).unwrap_or(inner.len());
    let (name, rest) = inner.split_at(end);
    if name.is_empty() || name.starts_with(|c: char| c.is_ascii_digit()) {
        return None;
    }
    if braced { rest.strip_prefix('}').map(|rest| (name, rest)) } else { Some((name, rest)) }
}

fn lookup<'a>(name: &str, parameters: &'a Table) -> Result<&'a Node, Message> {
    parameters.get(name).ok_or_else(|| {
        let names: Vec<&str> = parameters.0.iter().map(|e| e.key.as_str()).collect();
        let help =
            if names.is_empty() { format!("declare it: [parameters] {name} = …") } else { suggestion(name, &names) };
        (format!("there is no parameter `{name}`"), help)
    })
}

/// A number times or divided by another; stays an integer when the result is one.
fn scale(name: &str, value: &Value, times: bool, factor: f64) -> Result<Value, Message> {
    let apply = |number: f64| if times { number * factor } else { number / factor };
    let wrong = |help: &str| (format!("cannot compute with parameter `{name}`"), help.to_owned());
    match value {
        _ if !times && factor == 0.0 => Err(wrong("a number cannot be divided by zero")),
        Value::Float(number) => Ok(Value::Float(apply(*number))),
        Value::Integer(number) => {
            let result = apply(*number as f64);
            // Beyond 2^53 an integer would lose digits on the way through f64.
            let exact = result.fract() == 0.0 && result.abs() < 9.0e15 && factor.fract() == 0.0;
            Ok(if exact { Value::Integer(result as i64) } else { Value::Float(result) })
        }
        _ => Err(wrong("only numbers can be multiplied and divided")),
    }
}

/// A value as it reads inside a text.
fn plain(value: &Value) -> String {
    match value {
        Value::Text(text) => text.clone(),
        Value::Integer(number) => number.to_string(),
        Value::Float(number) => number.to_string(),
        Value::Boolean(flag) => flag.to_string(),
        Value::Array(_) | Value::Table(_) => String::new(),
    }
}
