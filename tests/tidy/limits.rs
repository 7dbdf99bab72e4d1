//! README and the page of limits against the program: what they name is there.

use std::collections::BTreeSet;

use drapery_core::effects::REGISTRY;
use drapery_io::materials::{EFFECTS, PRESETS, TakesPart};
use serde_json::Value;

use crate::tree::{report, root};

const LIMITS: &str = "docs/guide/limits.md";

fn page(name: &str) -> String {
    std::fs::read_to_string(root().join(name)).unwrap_or_else(|e| panic!("{name}: {e}"))
}

/// The text below a heading, up to the next of its level.
fn section<'a>(page: &'a str, heading: &str) -> &'a str {
    let text = page.split_once(&format!("\n## {heading}\n")).unwrap_or_else(|| panic!("no section {heading}")).1;
    text.split_once("\n## ").map_or(text, |(text, _)| text)
}

/// Names of effects, their settings and their maps, keys of scene files and their words, long options of commands.
fn names() -> BTreeSet<String> {
    let mut names = BTreeSet::new();
    for spec in REGISTRY {
        names.insert(spec.name.to_owned());
        names.extend(spec.fields.iter().map(|field| field.name.to_owned()));
    }
    let schema: Value = serde_json::from_str(&drapery_io::scene_file::schema()).expect("the schema is JSON");
    keys_and_words(&schema, &mut names);
    names.extend(options(&page("docs/reference/cli.md")).into_iter().map(|option| option.replace('-', "_")));
    names
}

fn keys_and_words(value: &Value, names: &mut BTreeSet<String>) {
    match value {
        Value::Object(map) => {
            names
                .extend(map.get("properties").and_then(Value::as_object).into_iter().flatten().map(|(k, _)| k.clone()));
            names.extend(map.get("const").and_then(Value::as_str).map(str::to_owned));
            let words = map.get("enum").and_then(Value::as_array).into_iter().flatten();
            names.extend(words.filter_map(Value::as_str).map(str::to_owned));
            map.values().for_each(|inner| keys_and_words(inner, names));
        }
        Value::Array(list) => list.iter().for_each(|inner| keys_and_words(inner, names)),
        _ => {}
    }
}

/// Long options in a text, without their dashes.
fn options(text: &str) -> BTreeSet<&str> {
    let is_of_option = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-';
    let starts = text.match_indices("--").filter(|(at, _)| text[..*at].ends_with([' ', '`', '[', '(']));
    let rest = starts.map(|(at, dashes)| &text[at + dashes.len()..]);
    let found = rest.map(|rest| rest.split(|c| !is_of_option(c)).next().unwrap_or_default());
    found.filter(|option| option.starts_with(|c: char| c.is_ascii_lowercase())).collect()
}

/// Marks of code in a text, without fenced blocks.
fn marks(text: &str) -> Vec<&str> {
    let outside = text.split("```").step_by(2);
    outside.flat_map(|text| text.split('`').skip(1).step_by(2)).collect()
}

#[test]
fn materials_ask_for_the_effects_that_the_limits_say() {
    let limits = page(LIMITS).replace('\n', " ");
    let mut before: Vec<&str> = limits.split(", which materials ask for").collect();
    before.pop();
    let marks = before.iter().filter_map(|text| text.rsplit('`').nth(1));
    let said: BTreeSet<&str> = marks.map(|mark| mark.trim_matches(['[', ']']).trim_start_matches("garment.")).collect();
    let asked = EFFECTS.iter().filter(|of| matches!(of.takes_part, TakesPart::Unless(_))).map(|of| of.effect);
    assert_eq!(said, asked.collect());
}

#[test]
fn what_readme_and_limits_name_is_there() {
    let (names, codes, makefile) = (names(), page("docs/reference/exit_codes.md"), page("Makefile"));
    let (commands, script) = (page("docs/reference/cli.md"), page("tests/oracle/render_contact_sheet.py"));
    let known = options(&commands);
    let mut complaints = Vec::new();
    for file in [LIMITS, "README.md"] {
        let text = page(file);
        for mark in marks(&text).into_iter().filter(|mark| !mark.contains(['/', ' ', '"'])) {
            let name = mark.trim_matches(['[', ']']).trim_start_matches("garment.");
            let is_name = name.contains('_') || mark.starts_with('[');
            if is_name && !names.contains(name) && !PRESETS.iter().any(|preset| preset.name == name) {
                complaints.push(format!("{file}: there is no `{mark}`"));
            }
        }
        for option in options(&text).into_iter().filter(|option| !script.contains(&format!("\"--{option}\""))) {
            if !known.contains(option) {
                complaints.push(format!("{file}: no command has --{option}"));
            }
        }
        for rest in text.split("exit code ").skip(1) {
            let code = rest.split(|c: char| !c.is_ascii_digit()).next().unwrap_or_default();
            if !codes.contains(&format!("\n| {code} | ")) {
                complaints.push(format!("{file}: there is no exit code {code}"));
            }
        }
        let lines = text.lines().filter_map(|line| line.strip_prefix("make "));
        let targets = marks(&text).into_iter().filter_map(|mark| mark.strip_prefix("make ")).chain(lines);
        for target in targets.filter_map(|words| words.split(' ').next()) {
            if !makefile.contains(&format!("\n{target}:")) {
                complaints.push(format!("{file}: make has no target {target}"));
            }
        }
    }
    report(&complaints);
}

#[test]
fn the_readme_lists_the_materials_and_the_farm_page_the_exit_codes() {
    let (readme, farm, codes) = (page("README.md"), page("docs/guide/farm.md"), page("docs/reference/exit_codes.md"));
    let listed: Vec<&str> =
        marks(&readme).into_iter().filter(|mark| PRESETS.iter().any(|preset| preset.name == *mark)).collect();
    assert_eq!(listed, PRESETS.iter().map(|preset| &*preset.name).collect::<Vec<_>>());
    let table = |text: &str| -> Vec<String> {
        let rows = section(text, "Exit codes").lines().filter_map(|line| line.strip_prefix("| "));
        let first = rows.filter_map(|row| row.split(" |").next()).map(|cell| cell.trim_matches('*').to_owned());
        first.filter(|cell| cell.parse::<u8>().is_ok()).collect()
    };
    assert_eq!(table(&farm), table(&codes));
}

#[test]
fn options_are_recognised() {
    assert_eq!(options("`run --strict` and a - b --out DIR a--b"), BTreeSet::from(["strict", "out"]));
}
