//! Doc comments and docstrings begin with the noun or the verb.

use crate::tree::text_files;

/// First words of free relatives, and of phrases that take the noun for granted.
const BEGINNINGS: [&str; 11] = ["What", "How", "Of", "Those", "That", "Who", "Whom", "Whoever", "Where", "Which", "By"];

/// Text of a line of a doc comment.
fn doc_text(line: &str) -> Option<&str> {
    let line = line.trim_start();
    line.strip_prefix("///").or_else(|| line.strip_prefix("//!")).map(str::trim)
}

/// Whether a text begins with one of [`BEGINNINGS`].
fn is_free_relative(text: &str) -> bool {
    text.split(|c: char| !c.is_alphabetic()).next().is_some_and(|word| BEGINNINGS.contains(&word))
}

/// Numbers of the lines on which a docstring of Python begins with one of [`BEGINNINGS`].
fn docstrings(text: &str) -> Vec<usize> {
    let opened = |line: &str| line.trim_start().strip_prefix("\"\"\"").is_some_and(is_free_relative);
    (1..).zip(text.lines()).filter(|(_, line)| opened(line)).map(|(number, _)| number).collect()
}

/// Numbers of the lines on which a paragraph of a doc comment begins with one of [`BEGINNINGS`].
fn beginnings(text: &str) -> Vec<usize> {
    let mut found = Vec::new();
    let mut is_inside = false;
    for (number, line) in (1..).zip(text.lines()) {
        let paragraph = doc_text(line).filter(|text| !text.is_empty());
        if !is_inside && paragraph.is_some_and(is_free_relative) {
            found.push(number);
        }
        is_inside = paragraph.is_some();
    }
    found
}

#[test]
fn doc_comments_begin_with_the_noun_or_the_verb() {
    let mut found = Vec::new();
    for file in text_files() {
        let lines = match file.name.rsplit_once('.') {
            Some((_, "rs")) => beginnings(&file.text),
            Some((_, "py")) => docstrings(&file.text),
            _ => continue,
        };
        found.extend(lines.into_iter().map(|number| format!("{}:{number}", file.name)));
    }
    assert!(found.is_empty(), "doc comments that begin with {BEGINNINGS:?}:\n{}", found.join("\n"));
}

#[test]
fn paragraphs_that_begin_with_a_free_relative_are_found() {
    let text = "//! What it does.\n//!\n//! Parts:\n//! What comes here goes on.\n\n    /// Number of steps.\n    ///\n    /// How many there are.\nfn f() {}\n/// Whatever.\n";
    assert_eq!(beginnings(text), [1, 8]);
    let text = "\"\"\"Runs.\"\"\"\n\ndef f():\n    \"\"\"What it does.\n\n    How it does it.\n    \"\"\"\n";
    assert_eq!(docstrings(text), [4]);
}
