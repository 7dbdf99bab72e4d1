//! `docs/reference/effects.md`, from the registry of effects.

use std::fmt::Write;

use drapery_core::effects::{EffectSpec, REGISTRY, Scope};
use drapery_core::settings::{AUTO, Default, Dimension, Field};
use drapery_io::materials::{EFFECTS, MaterialEffect, TakesPart};

/// The page.
pub(crate) fn page() -> String {
    let mut page = String::from(HEAD);
    for spec in REGISTRY {
        page += &section(spec);
    }
    page + NOTE
}

/// For developers, and for nobody who reads the page.
const NOTE: &str = "
<!-- Written by a test from the registry in `core/src/effects/mod.rs`; change it there. -->
";

const HEAD: &str = "# Effects

An effect exists only if the scene asks for it; what is not asked for allocates nothing and runs nothing. They run in the
order of this page. A number without a unit is in the unit of the column; a text may carry another one, as in \"2 mm\", and a
number that has none may be a percentage, as in \"5 %\".
The settings of a garment's `material` are those of its effects; what its own tables say overrides them.
";

fn section(spec: &EffectSpec) -> String {
    let mut text = format!("\n## {}\n\n{}.\n\nAsked for {}.\n", spec.name, sentence(spec.summary), asked_for(spec));
    for other in spec.requires {
        let _ = writeln!(text, "\nIt needs [`{other}`](#{other}): without it a scene is refused.");
    }
    if !spec.example.is_empty() {
        let _ = write!(text, "\n```toml\n{}\n```\n", spec.example);
    }
    if spec.fields.is_empty() {
        // Writing to a String cannot fail.
        let _ = writeln!(text, "\nIts settings are the keys of {}.", links(tables_of(spec.name)));
        return text;
    }
    text += "\n| setting | unit | default | range | |\n|---|---|---|---|---|\n";
    for field in spec.fields {
        let (unit, range) = (unit(field.dimension), range(field));
        let default = match (default(field), brought_by_materials(spec.name, field.name)) {
            (default, true) => format!("{default}, or the material's"),
            (default, false) => default,
        };
        // Writing to a String cannot fail.
        let _ = writeln!(text, "| `{}` | {unit} | {default} | {range} | {} |", field.name, field.help);
    }
    // Lists take numbers alone.
    for field in spec.fields.iter().filter(|field| field.default.is_number()) {
        let others = field.dimension.units()[1..].iter().map(|(name, _)| *name);
        let names: Vec<&str> = others.filter(|name| *name != "%").collect();
        if !names.is_empty() {
            let _ = write!(text, "\nOther units of `{}`: {}.", field.name, names.join(", "));
        }
    }
    text.trim_end().to_owned() + "\n"
}

fn asked_for(spec: &EffectSpec) -> String {
    match (spec.scope, spec.name) {
        (Scope::Scene, name) => format!("by the table `[{name}]` of the scene"),
        (Scope::Garment, name) => {
            let table = format!("by the table `[garment.{name}]` under a `[[garment]]`");
            match of_material(name).map(|effect| &effect.takes_part) {
                None => format!("{table}; no material asks for it"),
                Some(TakesPart::IfAskedFor) => {
                    format!("{table}; a `material` has numbers for it, so that the table may be empty")
                }
                Some(TakesPart::Unless(other)) => {
                    format!("{table}, or by its `material` where it has no `[garment.{other}]`")
                }
            }
        }
        (Scope::Implied, "pins") => "by any `[[garment.pin]]` with `mode = \"hard\"`, which is the default".to_owned(),
        (Scope::Implied, "attachments") => "by any `[[garment.pin]]` with `mode = \"spring\"`".to_owned(),
        (Scope::Implied, "elastic_bands") => "by any `[[garment.elastic]]`".to_owned(),
        (Scope::Implied, "seams") => "by any `[[seam]]`".to_owned(),
        (Scope::Implied, "body_collision") => "by any `[[body]]`".to_owned(),
        (Scope::Implied, name) => panic!("say here what asks for {name}"),
    }
}

/// Tables of the scene with the settings of an effect that has no table of its own.
fn tables_of(name: &str) -> &'static [&'static str] {
    match name {
        "pins" | "attachments" => &["garment.pin"],
        "elastic_bands" => &["garment.elastic"],
        "seams" => &["seam"],
        "body_collision" => &["body", "contact"],
        _ => panic!("say here where {name} is set"),
    }
}

/// Links to tables in the reference of the scene file.
fn links(tables: &[&str]) -> String {
    let link = |table: &&str| format!("[`[[{table}]]`](scene.md#{})", table.replace('.', ""));
    tables.iter().map(link).collect::<Vec<_>>().join(" and ")
}

/// Returns the settings that materials bring for an effect, if there are any.
fn of_material(effect: &str) -> Option<&'static MaterialEffect> {
    EFFECTS.iter().find(|brought| brought.effect == effect)
}

/// Whether materials say a number of an effect.
fn brought_by_materials(effect: &str, field: &str) -> bool {
    of_material(effect).is_some_and(|brought| brought.settings.iter().any(|setting| setting.key == field))
}

/// The summary with a capital letter.
fn sentence(summary: &str) -> String {
    let mut letters = summary.chars();
    letters.next().map_or_else(String::new, |first| first.to_uppercase().chain(letters).collect())
}

fn unit(dimension: Dimension) -> &'static str {
    match dimension.si_unit() {
        "" => "–",
        unit => unit,
    }
}

fn default(field: &Field) -> String {
    match field.default {
        Default::Required | Default::RequiredVector => "has to be given".to_owned(),
        Default::Number(value) | Default::Conditional(value) => format!("{value}"),
        Default::Count(value) => format!("{value}"),
        Default::Quantity(text) | Default::Choice(text, _) => text.to_owned(),
        Default::Auto => AUTO.to_owned(),
        Default::Vector(value) => format!("{value:?}"),
        Default::Flag(value) => format!("{value}"),
        Default::Absent | Default::Word(_) | Default::Keys | Default::File => "none".to_owned(),
    }
}

fn range(field: &Field) -> String {
    match field.default {
        Default::Flag(_) => return "true or false".to_owned(),
        Default::File => return "a file name".to_owned(),
        Default::Choice(_, words) | Default::Word(words) => {
            return words.iter().map(|word| word.name).collect::<Vec<_>>().join(", ");
        }
        _ => {}
    }
    let (low, high) = field.range;
    format!("{low} to {high}")
}
