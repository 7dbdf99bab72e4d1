//! The quick tier of the hard cases, under both integrators: exactly those fail that `docs/dev/hard_cases.md` knows.

use std::path::Path;
use std::sync::Mutex;

use drapery_core::scene::Integrator;
use drapery_selftest::CATALOGUE;
use drapery_selftest::bench::Conditions;
use drapery_selftest::case::Tier;
use drapery_selftest::report::{HEAD, rows};
use drapery_selftest::suite::{Verdict, judge};

/// Headings of the lists of known failures on the page, of the paper's step and of long ones.
const KNOWN: &str = "\n## Known failures\n";
const KNOWN_IN_LONG_STEPS: &str = "\n## Known failures in long steps\n";

/// Heading of the table of results on the page, which ends it.
const RESULTS: &str = "\n## Results of the quick tier\n";

/// Cases that run at the same time.
const WORKERS: usize = 2;

/// Numbers of the cases that the page lists as failing under a heading.
fn known<'a>(page: &'a str, heading: &str) -> Vec<&'a str> {
    let list = page.split(heading).nth(1).unwrap_or_default().split("\n## ").next().unwrap_or_default();
    let first = |line: &'_ str| line.strip_prefix("* **").map(str::len);
    list.lines().filter(|line| first(line).is_some()).filter_map(|line| line[4..].split("**").next()).collect()
}

fn all_verdicts(integrator: Integrator) -> Vec<Verdict> {
    let (queue, done) = (Mutex::new(CATALOGUE.iter()), Mutex::new(Vec::new()));
    let drapery = Path::new(env!("CARGO_BIN_EXE_drapery"));
    std::thread::scope(|scope| {
        for _ in 0..WORKERS {
            scope.spawn(|| {
                loop {
                    let next = queue.lock().expect("no worker panics").next();
                    let Some(case) = next else { return };
                    let verdict = judge(case, Conditions { tier: Tier::Quick, integrator, drapery });
                    done.lock().expect("no worker panics").push(verdict);
                }
            });
        }
    });
    let mut all = done.into_inner().expect("no worker panics");
    all.sort_by_key(|verdict| CATALOGUE.iter().position(|case| case.id == verdict.id));
    all
}

#[test]
fn exactly_the_known_hard_cases_fail() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/dev/hard_cases.md");
    let page = std::fs::read_to_string(&path).expect("the page of hard cases is there");
    let verdicts = all_verdicts(Integrator::SemiImplicit);
    let table: Vec<String> = [HEAD.to_owned()].into_iter().chain(verdicts.iter().flat_map(rows)).collect();
    println!("{}", table.join("\n"));
    if std::env::var_os("DRAPERY_BLESS").is_some() {
        std::fs::write(&path, with_results(&page, &table)).expect("the page can be written");
    }
    let failed: Vec<&str> = verdicts.iter().filter(|v| !v.passed()).map(|v| v.id.as_str()).collect();
    assert_eq!(failed, known(&page, KNOWN), "what fails, and what docs/dev/hard_cases.md says");
}

#[test]
fn exactly_the_known_hard_cases_fail_in_long_steps() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/dev/hard_cases.md");
    let page = std::fs::read_to_string(&path).expect("the page of hard cases is there");
    let verdicts = all_verdicts(Integrator::TrBdf2);
    verdicts.iter().filter(|verdict| !verdict.passed()).flat_map(rows).for_each(|row| println!("{row}"));
    let failed: Vec<&str> = verdicts.iter().filter(|v| !v.passed()).map(|v| v.id.as_str()).collect();
    assert_eq!(failed, known(&page, KNOWN_IN_LONG_STEPS), "what fails, and what docs/dev/hard_cases.md says");
}

/// The page with this table in the place of the one that it has.
fn with_results(page: &str, table: &[String]) -> String {
    let (before, after) = page.split_once(RESULTS).expect("the page has a table of results");
    let what = after.split("\n| case").next().unwrap_or_default();
    format!("{before}{RESULTS}{what}\n{}\n", table.join("\n"))
}

#[test]
fn the_table_of_results_is_replaced_and_nothing_else() {
    let page = format!("# a\n* b\n{RESULTS}\nThe command.\n\n| case |\n|---|\n| old |\n");
    let table = ["| case |", "|---|", "| new |"].map(str::to_owned);
    assert_eq!(with_results(&page, &table), page.replace("old", "new"));
}

#[test]
fn known_failures_are_read_from_the_page() {
    let page =
        "# a\n* **H1**: no\n\n## Known failures\n\n* **H4**: because\n  of it\n* **H12**: so\n\n## b\n* **H5**: no\n";
    assert_eq!(known(page, KNOWN), ["H4", "H12"]);
}

#[test]
fn numbers_of_cases_are_used_once() {
    let mut ids: Vec<&str> = CATALOGUE.iter().map(|case| case.id).collect();
    ids.sort_unstable();
    ids.dedup();
    assert_eq!(ids.len(), CATALOGUE.len());
}
