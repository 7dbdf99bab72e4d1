//! `docs/reference/counts.md` explains every count of the program, and says which are limits.

use drapery_core::effects::REGISTRY;
use drapery_shot::quality::LIMITS;

use crate::tree::{SourceFile, report, root, rust_files};
use drapery_tests::source_text::without_tests;

/// First line of the page's tables of counts.
const HEAD: &str = "| count | limit | meaning |";

/// Folders of the code that counts.
const COUNTING: [&str; 3] = ["core/src/", "io/src/", "shot/src/"];

/// Names in the tables of counts, with whether they are called limits.
fn explained(page: &str) -> Vec<(&str, bool)> {
    let tables = page.split(HEAD).skip(1).map(|rest| rest.split("\n\n").next().unwrap_or_default());
    tables.flat_map(str::lines).filter_map(row).collect()
}

/// A row of a table: the name, and whether the second column says yes.
fn row(line: &str) -> Option<(&str, bool)> {
    let (name, rest) = line.strip_prefix("| `")?.split_once("` | ")?;
    Some((name, rest.starts_with("yes ")))
}

/// Names of the counts in the program's text, each once.
fn counted() -> Vec<String> {
    let mut names: Vec<String> = LIMITS.iter().map(|(name, _)| (*name).to_owned()).collect();
    let counts = |file: &&SourceFile| COUNTING.iter().any(|folder| file.name.starts_with(folder));
    for file in rust_files().iter().filter(counts) {
        // Of texts only what stands between the quotes matters, so comments may stay.
        let text = without_tests(&file.text);
        let calls = text.split(".count(\"").skip(1).map(|call| call.split('"').next().unwrap_or_default());
        let once = text.split(".count_once(").skip(1).filter_map(|call| call.split('"').nth(1));
        let tables = text.split("_COUNTS: [&str").skip(1).map(|rest| rest.split_once("];").unwrap_or_default().0);
        names.extend(
            calls.chain(once).chain(tables.flat_map(|table| table.split('"').skip(1).step_by(2))).map(str::to_owned),
        );
    }
    // Forces count under the names that their effect owns.
    names.extend(REGISTRY.iter().flat_map(|spec| spec.report.counts).map(|name| (*name).to_owned()));
    names.sort_unstable();
    names.dedup();
    names
}

#[test]
fn every_counter_is_explained_in_the_reference() {
    let page = std::fs::read_to_string(root().join("docs/reference/counts.md")).expect("the page is there");
    let (explained, counted) = (explained(&page), counted());
    let mut complaints = Vec::new();
    for name in &counted {
        match explained.iter().find(|(known, _)| known == name) {
            Some((_, said)) if *said != LIMITS.iter().any(|(limit, _)| limit == name) => {
                complaints.push(format!("docs/reference/counts.md is wrong about {name}: limit or not?"));
            }
            Some(_) => {}
            None => complaints.push(format!("docs/reference/counts.md does not explain {name}")),
        }
    }
    let gone = explained.iter().filter(|(known, _)| !counted.iter().any(|name| name == known));
    complaints.extend(gone.map(|(known, _)| format!("docs/reference/counts.md: nothing counts {known}")));
    report(&complaints);
}

#[test]
fn counts_are_read_from_tables_of_counts_only() {
    let page = format!("| `a` | b |\n\n{HEAD}\n|---|---|---|\n| `c` | yes | d |\n| `e` | | f |\n\n| `g` | | h |\n");
    assert_eq!(explained(&page), [("c", true), ("e", false)]);
}
