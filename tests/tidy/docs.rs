//! Documentation that names what exists: paths, items in files, links and tests.

use std::path::Path;

use crate::tree::{SourceFile, report, root, text_files};

/// Folders of the project whose paths are checked wherever they stand in code marks.
const FOLDERS: [&str; 13] = [
    "core/",
    "io/",
    "shot/",
    "analysis/",
    "cli/",
    "tests/",
    "sample_assets/",
    "docs/",
    "plugins/",
    "measure/",
    "packaging/",
    "tools/",
    ".ci/",
];

/// Files that runs make; the pages may name them, the repository does not hold them.
const MADE: [&str; 1] = ["docs/dev/measurements/test-full.md"];

fn pages() -> Vec<SourceFile> {
    text_files().into_iter().filter(|f| f.name.ends_with(".md")).collect()
}

/// Texts between single back quotes, outside fenced blocks, with their line.
fn code_marks(page: &str) -> Vec<(usize, String)> {
    let mut fenced = false;
    let mut marks = Vec::new();
    for (number, line) in page.lines().enumerate() {
        if line.trim_start().starts_with("```") {
            fenced = !fenced;
        } else if !fenced {
            marks.extend(line.split('`').skip(1).step_by(2).map(|mark| (number + 1, mark.to_owned())));
        }
    }
    marks
}

/// Targets of links to files, with their line.
fn links(page: &str) -> Vec<(usize, String)> {
    let target =
        |text: &str| text.split(')').next().unwrap_or_default().split('#').next().unwrap_or_default().to_owned();
    let in_line = |(number, line): (usize, &str)| -> Vec<(usize, String)> {
        line.split("](").skip(1).map(|rest| (number + 1, target(rest))).collect()
    };
    let all = page.lines().enumerate().flat_map(in_line);
    all.filter(|(_, link)| !link.is_empty() && !link.contains("://")).collect()
}

/// Whether a mark is a path of the project, and if so the path and the item named after `::`.
fn as_path(mark: &str) -> Option<(&str, Option<&str>)> {
    let written_like_a_path = mark.chars().all(|c| c.is_ascii_alphanumeric() || "_-./:".contains(c));
    if !written_like_a_path || !FOLDERS.iter().any(|folder| mark.starts_with(folder)) {
        return None;
    }
    let (path, item) = match mark.split_once("::") {
        Some((path, item)) => (path, item.rsplit("::").next()),
        None => (mark, None),
    };
    Some((path, item))
}

/// Returns the fault of a path in a page, if there is one.
fn complaint_about_path(path: &str, item: Option<&str>) -> Option<String> {
    if MADE.contains(&path) {
        return None;
    }
    let file = root().join(path);
    if !file.exists() {
        return Some(format!("{path} does not exist"));
    }
    let item = item?;
    let text = std::fs::read_to_string(&file).unwrap_or_default();
    let defines = |kind: &str| {
        let words = format!("{kind} {item}");
        let after = |(i, found): (usize, &str)| text[i + found.len()..].chars().next();
        text.match_indices(&words).filter_map(after).any(|next| !next.is_alphanumeric() && next != '_')
    };
    let kinds = ["fn", "struct", "enum", "trait", "const", "static", "type", "def"];
    (!kinds.into_iter().any(defines)).then(|| format!("{path} defines no {item}"))
}

#[test]
fn paths_and_items_in_the_pages_exist() {
    let mut complaints = Vec::new();
    for page in pages() {
        for (line, mark) in code_marks(&page.text) {
            let wrong = as_path(&mark).and_then(|(path, item)| complaint_about_path(path, item));
            complaints.extend(wrong.map(|wrong| format!("{}:{line}: {wrong}", page.name)));
        }
    }
    report(&complaints);
}

#[test]
fn links_between_the_pages_lead_somewhere() {
    let mut complaints = Vec::new();
    for page in pages() {
        let path = root().join(&page.name);
        let folder = path.parent().map_or_else(root, Path::to_owned);
        let broken = links(&page.text)
            .into_iter()
            .filter(|(_, link)| !folder.join(link).exists() && !MADE.iter().any(|made| made.ends_with(link.as_str())));
        complaints.extend(broken.map(|(line, link)| format!("{}:{line}: {link} does not exist", page.name)));
    }
    report(&complaints);
}

#[test]
fn tests_named_in_the_pages_exist() {
    let sources: String = text_files()
        .into_iter()
        .filter(|f| f.name.ends_with(".rs") || f.name.ends_with(".py"))
        .map(|f| f.text)
        .collect();
    let is_sentence = |mark: &str| {
        mark.matches('_').count() >= 3 && mark.chars().all(|c| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_')
    };
    let mut complaints = Vec::new();
    for page in pages() {
        for (line, mark) in code_marks(&page.text).into_iter().filter(|(_, mark)| is_sentence(mark)) {
            let is_there = ["fn", "def"].iter().any(|word| sources.contains(&format!("{word} {mark}(")));
            // Long snake-case words that are no tests: environment of the solver's settings and counts.
            let is_a_word_of_the_code =
                sources.contains(&format!("{mark}:")) || sources.contains(&format!("\"{mark}\""));
            if !is_there && !is_a_word_of_the_code {
                complaints.push(format!("{}:{line}: no test is called {mark}", page.name));
            }
        }
    }
    report(&complaints);
}

#[test]
fn paths_items_and_links_are_recognised() {
    assert_eq!(as_path("core/src/step.rs"), Some(("core/src/step.rs", None)));
    assert_eq!(as_path("core/src/step/mod.rs::advance"), Some(("core/src/step/mod.rs", Some("advance"))));
    assert_eq!(as_path("docs/*.md"), None);
    assert_eq!(as_path("kg/m²"), None);
    assert_eq!(links("see [a](b.md#c) and [d](https://e.f)"), [(1, "b.md".to_owned())]);
    assert_eq!(code_marks("`a` b `c`\n```sh\n`d`\n```\n`e`").len(), 3);
    assert!(complaint_about_path("core/src/step/mod.rs", Some("advance")).is_none());
    assert!(complaint_about_path("core/src/step.rs", Some("retreat")).is_some());
    assert!(complaint_about_path("core/src/stop.rs", None).is_some());
}

#[test]
fn the_changelog_names_the_version_of_the_solver() {
    let log = std::fs::read_to_string(root().join("CHANGELOG.md")).expect("the changelog");
    let log = log.to_lowercase();
    let named = log.match_indices("solver version ").filter_map(|(at, words)| {
        let digits: String = log[at + words.len()..].chars().take_while(char::is_ascii_digit).collect();
        digits.parse::<u32>().ok()
    });
    assert_eq!(named.max(), Some(drapery_core::SOLVER_VERSION), "CHANGELOG.md says what each solver version changed");
}

/// Most words of the changelog: what users notice, by subject. The list of commits has the rest.
const CHANGELOG_WORDS: usize = 1200;

#[test]
fn the_changelog_is_a_page() {
    let log = std::fs::read_to_string(root().join("CHANGELOG.md")).expect("the changelog");
    let words = log.split_whitespace().count();
    assert!(words <= CHANGELOG_WORDS, "CHANGELOG.md has {words} words, at most {CHANGELOG_WORDS}");
}
