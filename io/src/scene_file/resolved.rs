//! `resolved.toml`: the scene with every value that was used, and where it came from.

use std::path::PathBuf;

use crate::memory_mesh::MEMORY;

use super::SceneFile;
use super::raw::FILE;
use super::tree::{Node, Origin, Table, Value};

/// Sections in the order in which a reader looks for them; tables of effects come before the bodies.
const ORDER: [&str; 11] =
    ["drapery", "shot", "units", "solver", "effects", "body", "garment", "seam", "contact", "output", "check"];

/// Place of the tables of effects in that order.
const TABLES: usize = 5;

/// Keys that name files relative to the scene file.
const FILES: [&str; 4] = ["file", "rest", "start", "track"];

/// Table in which such a key does not: a seam starts at a time.
const TIMES: &str = "seam";

/// Keys that name a map or hold maps, which may be files.
pub(super) const MAP: &str = "map";
pub(super) const MAPS: &str = ".maps";

/// Column of the comments.
const COMMENT_COLUMN: usize = 44;

/// Whether a text under this key names a file relative to the scene file; `table` is the table that the key stands in, as in
/// `garment.render_mesh` or `seam[0]`.
pub fn names_file(table: &str, key: &str) -> bool {
    FILES.contains(&key) && table.split('[').next() != Some(TIMES)
}

/// Writes a scene whose values are these, with all defaults, one value a line, each with its origin. The loader reads it to the same
/// scene.
pub(super) fn write(scene: &SceneFile, root: &Node) -> String {
    let mut out = String::from(
        "# The scene as it was run: every value, and where it came from. Numbers without a unit are in metres,\n\
         # seconds, kilograms and newtons. This file can be run again.\n",
    );
    for entry in &scene.parameters.0 {
        let origin = if matches!(entry.node.origin, Origin::Set(_)) { "--set" } else { "scene" };
        let text = format!("# parameter {} = {} ({origin})", entry.key, inline(&entry.node.value));
        out.push_str(&(on_one_line(&text) + "\n"));
    }
    for file in &scene.material_files {
        let name = file.file_stem().unwrap_or_default().to_string_lossy();
        let text = format!("# material {name} = {}", std::path::absolute(file).unwrap_or(file.clone()).display());
        out.push_str(&(on_one_line(&text) + "\n"));
    }
    let Value::Table(root) = &root.value else {
        return out;
    };
    let mut root = root.clone();
    let rank = |key: &str| match ORDER.iter().position(|word| *word == key) {
        Some(position) if position >= TABLES => position + 1,
        Some(position) => position,
        None => TABLES,
    };
    root.0.sort_by_key(|e| rank(&e.key));
    section(&mut out, scene, &root, "");
    out
}

/// Writes the values of a table, then the tables in it.
fn section(out: &mut String, scene: &SceneFile, table: &Table, path: &str) {
    for entry in table.0.iter().filter(|e| !is_section(&e.node.value)) {
        let value = match &entry.node.value {
            Value::Text(text) if !path.is_empty() && names_file(path, &entry.key) => {
                Value::Text(absolute(scene, text).to_string_lossy().into_owned())
            }
            value if entry.key == MAP || path.ends_with(MAPS) => with_absolute_maps(scene, value),
            other => other.clone(),
        };
        let line = format!("{} = {}", entry.key, inline(&value));
        let comment = on_one_line(&origin(&entry.node).to_string());
        out.push_str(&format!("{line:<COMMENT_COLUMN$} # {comment}\n"));
    }
    for entry in table.0.iter().filter(|e| is_section(&e.node.value)) {
        let name = if path.is_empty() { entry.key.clone() } else { format!("{path}.{}", entry.key) };
        match &entry.node.value {
            Value::Table(inner) => {
                out.push_str(&format!("\n[{name}]\n"));
                section(out, scene, inner, &name);
            }
            Value::Array(items) => {
                for inner in items.iter().filter_map(Node::as_table) {
                    out.push_str(&format!("\n[[{name}]]\n"));
                    section(out, scene, inner, &name);
                }
            }
            _ => {}
        }
    }
}

/// The name of a map, or the keys of maps that change over time, with files as they are used.
fn with_absolute_maps(scene: &SceneFile, value: &Value) -> Value {
    match value {
        Value::Text(text) => match text.strip_prefix(FILE) {
            Some(file) => Value::Text(format!("{FILE}{}", absolute(scene, file).to_string_lossy())),
            None => value.clone(),
        },
        Value::Array(items) => {
            let of = |item: &Node| Node { value: with_absolute_maps(scene, &item.value), ..item.clone() };
            Value::Array(items.iter().map(of).collect())
        }
        other => other.clone(),
    }
}

/// A comment: names of parameters and files may hold ends of lines, and what comes behind one would no longer be a comment.
fn on_one_line(text: &str) -> String {
    let visible = |c: char| if c.is_control() { c.escape_default().to_string() } else { c.to_string() };
    text.chars().map(visible).collect()
}

/// Whether a value is written as tables of its own.
fn is_section(value: &Value) -> bool {
    match value {
        Value::Table(_) => true,
        Value::Array(items) => !items.is_empty() && items.iter().all(|item| item.as_table().is_some()),
        _ => false,
    }
}

/// Origin of a value; that of a list is the strongest of its elements.
pub(super) fn origin(node: &Node) -> Origin {
    fn visit<'a>(node: &'a Node, strongest: &mut &'a Origin) {
        let strength = |origin: &Origin| match origin {
            Origin::Set(_) => 2,
            Origin::Parameter(_) => 1,
            _ => 0,
        };
        if strength(&node.origin) > strength(strongest) {
            *strongest = &node.origin;
        }
        if let Value::Array(items) = &node.value {
            items.iter().for_each(|item| visit(item, strongest));
        }
    }
    let mut strongest = &node.origin;
    visit(node, &mut strongest);
    strongest.clone()
}

/// A value on one line of TOML.
fn inline(value: &Value) -> String {
    match value {
        Value::Boolean(flag) => flag.to_string(),
        Value::Integer(number) => number.to_string(),
        // The shortest text that reads back to the same bits.
        Value::Float(number) => format!("{number:?}").replace("NaN", "nan"),
        // A dollar sign would be taken for a parameter when the file is read again.
        Value::Text(text) => toml::Value::String(text.replace('$', "$$")).to_string(),
        Value::Array(items) => {
            let items: Vec<String> = items.iter().map(|item| inline(&item.value)).collect();
            format!("[{}]", items.join(", "))
        }
        Value::Table(table) => {
            let entries: Vec<String> =
                table.0.iter().map(|e| format!("{} = {}", e.key, inline(&e.node.value))).collect();
            format!("{{ {} }}", entries.join(", "))
        }
    }
}

/// A file name of the scene as it is used; that of a mesh in memory as it is written.
fn absolute(scene: &SceneFile, file: &str) -> PathBuf {
    if file.starts_with(MEMORY) {
        return PathBuf::from(file);
    }
    let path = scene.folder.join(file);
    std::path::absolute(&path).unwrap_or(path)
}
