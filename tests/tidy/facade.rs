//! The facade of the solver: the names at the root of `drapery_core`, few enough to learn, with an example each.

use crate::tree::{SourceFile, report, root, rust_files};

/// Fewest and most names.
const NAMES: std::ops::RangeInclusive<usize> = 35..=45;

/// The file whose public names are the facade.
const FACADE: &str = "core/src/lib.rs";

/// Kinds of items.
const KINDS: [&str; 7] = ["struct", "enum", "trait", "fn", "type", "const", "static"];

/// The last words of the paths that a `pub use` hands on.
fn handed_on(text: &str) -> Vec<String> {
    let lists = text.split("\npub use ").skip(1).filter_map(|rest| rest.split(';').next());
    let is_word = |c: char| c.is_alphanumeric() || "_:".contains(c);
    let paths = lists.flat_map(|list| {
        // What stands before a brace is a module.
        let ends = list.match_indices([',', '}']).map(|(at, _)| at).chain([list.len()]);
        ends.map(|end| list[..end].trim_end().rsplit(|c| !is_word(c)).next().unwrap_or_default().to_owned())
    });
    let names = paths.filter_map(|path| path.rsplit("::").next().map(str::to_owned));
    names.filter(|name| !name.is_empty()).collect()
}

/// The name of the public item that a line defines.
fn defined(line: &str) -> Option<&str> {
    let rest = line.trim_start().strip_prefix("pub ")?;
    let (kind, rest) = rest.split_once(' ')?;
    KINDS.contains(&kind).then(|| rest.split(|c: char| !c.is_alphanumeric() && c != '_').next().unwrap_or_default())
}

/// Lines that stand directly above a line: comments and attributes.
fn above(lines: &[&str], line: usize) -> String {
    let belongs = |text: &&&str| ["///", "#["].iter().any(|start| text.trim_start().starts_with(start));
    lines[..line].iter().rev().take_while(belongs).copied().collect::<Vec<_>>().join("\n")
}

/// Names that the facade defines itself.
fn own(text: &str) -> Vec<String> {
    let lines: Vec<&str> = text.lines().collect();
    let names = lines.iter().enumerate().filter_map(|(at, line)| Some((at, defined(line)?)));
    names.filter(|(at, _)| !above(&lines, *at).contains("#[doc(hidden)]")).map(|(_, name)| name.to_owned()).collect()
}

/// Whether a file defines an item of this name, and if so whether its documentation has an example.
fn has_example(file: &SourceFile, name: &str) -> Option<bool> {
    let lines: Vec<&str> = file.text.lines().collect();
    let at = lines.iter().position(|line| defined(line) == Some(name))?;
    Some(above(&lines, at).contains("/// ```\n"))
}

#[test]
fn the_facade_of_the_solver_is_short_and_every_name_has_an_example() {
    let text = std::fs::read_to_string(root().join(FACADE)).expect("the solver is a library");
    let names = [handed_on(&text), own(&text)].concat();
    let mut complaints = Vec::new();
    if !NAMES.contains(&names.len()) {
        complaints.push(format!("{FACADE} has {} names: {}", names.len(), names.join(", ")));
    }
    let files: Vec<SourceFile> = rust_files().into_iter().filter(|file| file.name.starts_with("core/src/")).collect();
    for name in &names {
        let found: Vec<bool> = files.iter().filter_map(|file| has_example(file, name)).collect();
        if !found.contains(&true) {
            complaints.push(format!("{name}: its documentation has no example"));
        }
    }
    let lines: Vec<&str> = text.lines().collect();
    let rooms = (0..lines.len()).filter(|at| lines[*at].starts_with("pub mod "));
    let shown = rooms.filter(|at| !above(&lines, *at).contains("#[doc(hidden)]"));
    complaints.extend(shown.map(|at| format!("{FACADE}:{}: a room is hidden, or private", at + 1)));
    report(&complaints);
}

#[test]
fn names_and_examples_of_a_facade_are_found() {
    let text = "\npub use crate::{\n    a::b::C,\n    d::{E, f},\n};\npub use g::H;\n/// I.\npub type I = u8;\n#[doc(hidden)]\npub const J: u8 = 0;\n";
    assert_eq!(handed_on(text), ["C", "E", "f", "H"]);
    assert_eq!(own(text), ["I"]);
    let file = |text: &str| SourceFile { name: String::new(), text: text.into() };
    assert_eq!(
        has_example(&file("/// A.\n///\n/// ```\n/// b();\n/// ```\n#[derive(Debug)]\npub struct A;"), "A"),
        Some(true)
    );
    assert_eq!(has_example(&file("/// A.\n#[derive(Debug)]\npub struct A;"), "A"), Some(false));
    assert_eq!(has_example(&file("pub struct AB;"), "A"), None);
}
