//! Verdicts as a table and as JSON.

use serde_json::{Value, json};

use crate::case::{Bound, Figure};
use crate::suite::Verdict;

/// Head of the table.
pub const HEAD: &str = "| case | | figure | found | bound | | s | degradations |\n|---|---|---|---|---|---|---|---|";

/// The rows of a case: one for each figure.
pub fn rows(verdict: &Verdict) -> Vec<String> {
    let (id, title) = (verdict.id.as_str(), verdict.title.as_str());
    let counts: Vec<String> = verdict.degradations.iter().map(|(name, count)| format!("{name} {count}")).collect();
    let (seconds, counts) = (format!("{:.1}", verdict.seconds), counts.join(", "));
    if let Some(trouble) = &verdict.trouble {
        let first = trouble.lines().next().unwrap_or_default();
        return vec![format!("| {id} | {title} | {first} | | | FAIL | {seconds} | {counts} |")];
    }
    let row = |(i, figure): (usize, &Figure)| {
        let word = if figure.holds() { "pass" } else { "FAIL" };
        let (found, bound) = (number(figure.value), bound(figure.bound));
        let (id, title, seconds, counts) = if i == 0 { (id, title, &*seconds, &*counts) } else { ("", "", "", "") };
        format!("| {id} | {title} | {} | {found} | {bound} | {word} | {seconds} | {counts} |", figure.what)
    };
    verdict.figures.iter().enumerate().map(row).collect()
}

/// A case as JSON.
pub fn value(verdict: &Verdict) -> Value {
    let figure = |figure: &Figure| {
        let (kind, bound) = match figure.bound {
            Bound::AtMost(bound) => ("at_most", bound),
            Bound::AtLeast(bound) => ("at_least", bound),
            Bound::Exactly(bound) => ("exactly", bound),
        };
        json!({"what": figure.what, "value": figure.value, kind: bound, "passed": figure.holds()})
    };
    let counts: serde_json::Map<String, Value> =
        verdict.degradations.iter().map(|(name, count)| (name.clone(), json!(count))).collect();
    json!({
        "case": verdict.id,
        "title": verdict.title,
        "must": verdict.must,
        "passed": verdict.passed(),
        "figures": verdict.figures.iter().map(figure).collect::<Vec<_>>(),
        "trouble": verdict.trouble,
        "degradations": counts,
        "seconds": verdict.seconds,
    })
}

fn bound(bound: Bound) -> String {
    match bound {
        Bound::AtMost(value) => format!("≤ {}", number(value)),
        Bound::AtLeast(value) => format!("≥ {}", number(value)),
        Bound::Exactly(value) => format!("= {}", number(value)),
    }
}

/// A number in as few digits as tell it.
fn number(value: f64) -> String {
    let size = value.abs();
    if value == 0.0 || ((0.01..1e5).contains(&size) && value.fract() == 0.0) {
        format!("{value}")
    } else if (0.01..1e5).contains(&size) {
        format!("{value:.3}")
    } else {
        format!("{value:.2e}")
    }
}
