//! Citations: the pages that code and pages cite are in the repository, with the headings that they are cited by.

use std::path::Path;

use crate::tree::{SourceFile, report, root, text_files};

/// Returns the name of a heading in a link: small letters, digits and hyphens.
fn anchor(heading: &str) -> String {
    let kept = heading.trim().chars().filter(|c| c.is_alphanumeric() || " -_".contains(*c));
    kept.flat_map(char::to_lowercase).map(|c| if c == ' ' { '-' } else { c }).collect()
}

/// The anchors of a page.
fn anchors(page: &str) -> Vec<String> {
    let mut fenced = false;
    let mut found = Vec::new();
    for line in page.lines() {
        fenced ^= line.trim_start().starts_with("```");
        if !fenced && line.starts_with('#') {
            found.push(anchor(line.trim_start_matches('#')));
        }
    }
    found
}

fn is_of_path(c: char) -> bool {
    c.is_ascii_alphanumeric() || "_-./".contains(c)
}

/// Pages cited with an anchor, as `page.md#anchor`, with their line. `page` is empty for the page itself.
fn cited(text: &str) -> Vec<(usize, String, String)> {
    let mut found = Vec::new();
    for (number, line) in text.lines().enumerate() {
        for (at, _) in line.match_indices('#') {
            let before = &line[..at];
            let page = &before[before.trim_end_matches(is_of_path).len()..];
            let anchor: String =
                line[at + 1..].chars().take_while(|c| c.is_alphanumeric() || "-_".contains(*c)).collect();
            let is_in_page = page.is_empty() && before.ends_with("](");
            if !anchor.is_empty() && (page.ends_with(".md") || is_in_page) {
                found.push((number + 1, page.to_owned(), anchor));
            }
        }
    }
    found
}

/// Returns the faults in the citations of a file. Code names pages from the root, a page also from its own folder.
fn complaints(file: &SourceFile) -> Vec<String> {
    let own = root().join(&file.name);
    let complaint = |(line, page, anchor): (usize, String, String)| {
        let beside = own.parent().unwrap_or(Path::new("")).join(&page);
        let path = match page.as_str() {
            "" => own.clone(),
            _ if file.name.ends_with(".md") && beside.is_file() => beside,
            _ => root().join(&page),
        };
        let text = std::fs::read_to_string(path).ok();
        let wrong = match text.map(|text| anchors(&text).contains(&anchor)) {
            Some(true) => return None,
            Some(false) => "has no such heading",
            None => "does not exist",
        };
        Some(format!("{}:{line}: {page}#{anchor}: {wrong}", file.name))
    };
    cited(&file.text).into_iter().filter_map(complaint).collect()
}

#[test]
fn headings_that_code_and_pages_cite_exist() {
    // The tests of these rules hold made-up pages.
    let files = text_files().into_iter().filter(|file| !file.name.starts_with("tests/tidy/"));
    report(&files.flat_map(|file| complaints(&file)).collect::<Vec<_>>());
}

#[test]
fn no_file_cites_a_book_that_is_not_here() {
    // In two halves, so that this file does not hold it itself.
    let book = ["meth", "od"].concat();
    let cites = |line: &str| {
        // A field of this name cites nothing.
        let named = line.match_indices(&book).filter(|(at, _)| !line[..*at].ends_with('.'));
        let mut after = named.map(|(at, _)| line[at + book.len()..].trim_start_matches([',', ' ']));
        after.any(|next| {
            next.starts_with(|c: char| c.is_ascii_digit())
                || next.starts_with("section")
                || next.starts_with("Appendix")
        })
    };
    let of_file = |file: SourceFile| {
        let lines: Vec<usize> =
            file.text.lines().enumerate().filter(|(_, line)| cites(line)).map(|(n, _)| n + 1).collect();
        lines.into_iter().map(move |line| format!("{}:{line}: cite a page of docs/theory, or the paper", file.name))
    };
    report(&text_files().into_iter().flat_map(of_file).collect::<Vec<_>>());
}

#[test]
fn citations_are_recognised() {
    assert_eq!(anchor("3. One time step"), "3-one-time-step");
    assert_eq!(anchors("# A\n```\n# no\n```\n## The choice of dt\n"), ["a", "the-choice-of-dt"]);
    let text = "see `docs/a.md#b-c`, [d](e.md#f) and [g](#h); 3 # 4";
    let found = [(1, "docs/a.md", "b-c"), (1, "e.md", "f"), (1, "", "h")];
    assert_eq!(cited(text), found.map(|(line, page, anchor)| (line, page.to_owned(), anchor.to_owned())));
}

/// Words of small letters that a line of a module's head names in brackets, as the module or function where something is.
fn named_in_brackets(line: &str) -> impl Iterator<Item = &str> {
    let heads = line.trim_start().strip_prefix("//!").unwrap_or_default().split("(`").skip(1);
    let words = heads.filter_map(|rest| rest.split_once("`)").map(|(word, _)| word));
    words.filter(|word| !word.is_empty() && word.chars().all(|c| c.is_ascii_lowercase() || c == '_'))
}

/// Whether code defines a word, or has it as a text: the name of a count, a word of a file.
fn defines(text: &str, word: &str) -> bool {
    let is_word = |c: char| c.is_alphanumeric() || c == '_';
    let is_whole = |at: usize| {
        let (before, after) = (&text[..at], &text[at + word.len()..]);
        let is_defined = ["fn ", "mod ", "const ", "macro_rules! "].iter().any(|kind| before.ends_with(kind));
        let is_field = after.starts_with(": ") && before.ends_with([' ', '(', '{']);
        let is_text = before.ends_with('"') && after.starts_with('"');
        !after.starts_with(is_word) && (is_defined || is_field || is_text)
    };
    text.match_indices(word).any(|(at, _)| is_whole(at))
}

#[test]
fn heads_of_modules_name_what_is_there() {
    let files: Vec<SourceFile> = text_files().into_iter().filter(|file| file.name.ends_with(".rs")).collect();
    let is_there = |word: &str| {
        let is_module =
            |file: &SourceFile| file.name.ends_with(&format!("/{word}.rs")) || file.name.contains(&format!("/{word}/"));
        files.iter().any(|file| is_module(file) || defines(&file.text, word))
    };
    let mut complaints = Vec::new();
    for file in &files {
        for (number, line) in (1..).zip(file.text.lines()) {
            let gone = named_in_brackets(line).filter(|word| !is_there(word));
            complaints.extend(gone.map(|word| format!("{}:{number}: there is no `{word}`", file.name)));
        }
    }
    report(&complaints);
}

#[test]
fn links_to_decisions_give_their_number() {
    let mut complaints = Vec::new();
    for file in text_files().into_iter().filter(|file| file.name.ends_with(".md")) {
        for (number, line) in (1..).zip(file.text.lines()) {
            for (before, after) in line.match_indices("](").map(|(at, link)| (&line[..at], &line[at + link.len()..])) {
                let Some((_, said)) = before.rsplit_once("[decision ") else { continue };
                let file_number = after.rsplit_once("decisions/").map_or(after, |(_, name)| name).get(..4);
                if said.parse::<u32>().is_ok_and(|said| file_number.and_then(|n| n.parse().ok()) != Some(said)) {
                    complaints.push(format!("{}:{number}: decision {said} is not {after}", file.name));
                }
            }
        }
    }
    report(&complaints);
}
