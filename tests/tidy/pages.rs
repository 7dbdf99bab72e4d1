//! Reference pages that are written by a program. `DRAPERY_BLESS=1 cargo test -p drapery-tests --test tidy` rewrites them.

use crate::tree::root;

/// Compares a page with what it has to be, or rewrites it.
fn check(name: &str, fresh: &str) {
    let path = root().join(name);
    if std::env::var_os("DRAPERY_BLESS").is_some() {
        std::fs::write(&path, fresh).unwrap_or_else(|e| panic!("{name}: {e}"));
        return;
    }
    let there = std::fs::read_to_string(&path).unwrap_or_default();
    let line = there.lines().zip(fresh.lines()).position(|(a, b)| a != b);
    let line = line.unwrap_or(there.lines().count().min(fresh.lines().count())) + 1;
    assert!(
        there == fresh,
        "{name}, line {line}: it is out of date\n  help: DRAPERY_BLESS=1 cargo test -p drapery-tests --test tidy"
    );
}

#[test]
fn the_page_of_effects_is_fresh() {
    check("docs/reference/effects.md", &crate::effects_page::page());
}

#[test]
fn the_page_of_warnings_is_fresh_and_explains_every_rule() {
    let page = crate::warnings_page::page();
    for rule in drapery_io::rules::RULES {
        assert!(page.contains(&format!("\n## `{}`\n", rule.name)), "{} is not explained", rule.name);
        let says = |text: &str| text.trim_end_matches('.').len() > 10;
        assert!(says(rule.finds) && says(rule.exactly) && !rule.line.is_empty(), "{}", rule.name);
    }
    check("docs/reference/warnings.md", &page);
}

#[test]
fn the_picture_of_materials_is_fresh() {
    check("docs/pictures/materials.svg", &crate::curves_picture::picture());
}

#[test]
fn the_page_of_the_scene_file_is_fresh() {
    check("docs/reference/scene.md", &crate::scene_page::page());
}

#[test]
fn the_index_of_decisions_is_fresh() {
    let folder = root().join("docs/dev/decisions");
    let index = folder.join("README.md");
    let head = std::fs::read_to_string(&index).unwrap_or_default();
    let head = head.split("\n* [").next().unwrap_or_default().trim_end();
    let entries = std::fs::read_dir(&folder).expect("there are decisions").flatten();
    let mut names: Vec<String> = entries.map(|entry| entry.file_name().to_string_lossy().into_owned()).collect();
    names.retain(|name| name.starts_with(|c: char| c.is_ascii_digit()));
    names.sort();
    let mut page = format!("{head}\n\n");
    for name in names {
        let text = std::fs::read_to_string(folder.join(&name)).expect("a decision");
        let title = text.lines().next().unwrap_or_default().trim_start_matches('#').trim();
        page += &format!("* [{title}]({name})\n");
    }
    check("docs/dev/decisions/README.md", &page);
}

/// Headings of a decision, in their order. `## Code` may follow.
const DECISION_HEADINGS: [&str; 3] = ["## Question", "## Options", "## Verdict"];

/// Most words of a decision: a longer page is a log, or two decisions.
const DECISION_WORDS: usize = 600;

/// Faults in the form of a decision page.
fn faults_of_decision(text: &str) -> Vec<String> {
    let mut faults = Vec::new();
    let words = text.split_whitespace().count();
    if words > DECISION_WORDS {
        faults.push(format!("{words} words, at most {DECISION_WORDS}"));
    }
    let date = text.lines().find_map(|line| line.strip_prefix("Date: 20")).and_then(|rest| rest.get(..8));
    if !date.is_some_and(|date| date.chars().zip("00-00-00".chars()).all(|(a, b)| a.is_ascii_digit() == (b == '0'))) {
        faults.push("no line \"Date: YYYY-MM-DD\"".to_owned());
    }
    let headings: Vec<&str> = text.lines().filter(|line| line.starts_with("## ")).collect();
    let (needed, others) = headings.split_at(headings.len().min(DECISION_HEADINGS.len()));
    if needed != DECISION_HEADINGS || !matches!(others, [] | ["## Code"]) {
        faults.push(format!("headings {headings:?}, expected {DECISION_HEADINGS:?} and perhaps \"## Code\""));
    }
    faults
}

#[test]
fn decisions_are_short_and_have_a_date_a_question_options_and_a_verdict() {
    let pages = crate::tree::text_files().into_iter().filter(|file| {
        let name = file.name.strip_prefix("docs/dev/decisions/");
        name.is_some_and(|name| name.starts_with(|c: char| c.is_ascii_digit()))
    });
    let faults = pages.flat_map(|file| {
        faults_of_decision(&file.text).into_iter().map(move |fault| format!("{}: {fault}", file.name))
    });
    crate::tree::report(&faults.collect::<Vec<_>>());
}

#[test]
fn decisions_out_of_form_are_found() {
    let page = "# 1: A\n\nDate: 2026-11-20. Machine: M.\n\n## Question\n\n## Options\n\n## Verdict\n\n## Code\n";
    assert_eq!(faults_of_decision(page), Vec::<String>::new());
    let faulty = [
        page.replace("2026-11-20", "today"),
        page.replace("2026-11-20", "2026"),
        page.replace("## Options\n\n", ""),
        page.replace("## Code", "## The search in heaps"),
        page.replace("## Question", "**Question.**"),
        format!("{page}{}", "word ".repeat(DECISION_WORDS)),
    ];
    for page in faulty {
        assert_eq!(faults_of_decision(&page).len(), 1, "{page}");
    }
}

#[test]
fn every_page_is_in_the_book() {
    let book = std::fs::read_to_string(root().join("mkdocs.yml")).expect("the order of the book");
    let pages = crate::tree::text_files().into_iter().filter_map(|file| {
        let page = file.name.strip_prefix("docs/")?;
        page.ends_with(".md").then(|| page.to_owned())
    });
    let lost = pages.filter(|page| !book.contains(&format!(": {page}\n")));
    crate::tree::report(&lost.map(|page| format!("docs/{page} is not in mkdocs.yml")).collect::<Vec<_>>());
}
