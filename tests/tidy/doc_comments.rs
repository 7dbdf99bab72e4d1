//! Doc comments begin with the noun or the verb.

use crate::tree::rust_files;

/// First words of free relatives, and of phrases that take the noun for granted.
const BEGINNINGS: [&str; 11] = ["What", "How", "Of", "Those", "That", "Who", "Whom", "Whoever", "Where", "Which", "By"];

/// Text of a line of a doc comment.
fn doc_text(line: &str) -> Option<&str> {
    let line = line.trim_start();
    line.strip_prefix("///").or_else(|| line.strip_prefix("//!")).map(str::trim)
}

/// Numbers of the lines on which a paragraph of a doc comment begins with one of [`BEGINNINGS`].
fn beginnings(text: &str) -> Vec<usize> {
    let mut found = Vec::new();
    let mut is_inside = false;
    for (number, line) in (1..).zip(text.lines()) {
        let paragraph = doc_text(line).filter(|text| !text.is_empty());
        let first = paragraph.and_then(|text| text.split(|c: char| !c.is_alphabetic()).next());
        if !is_inside && first.is_some_and(|word| BEGINNINGS.contains(&word)) {
            found.push(number);
        }
        is_inside = paragraph.is_some();
    }
    found
}

#[test]
fn doc_comments_begin_with_the_noun_or_the_verb() {
    let files = rust_files();
    let found: Vec<String> = files
        .iter()
        .flat_map(|file| beginnings(&file.text).into_iter().map(|number| format!("{}:{number}", file.name)))
        .collect();
    assert!(found.is_empty(), "doc comments that begin with {BEGINNINGS:?}:\n{}", found.join("\n"));
}

#[test]
fn paragraphs_that_begin_with_a_free_relative_are_found() {
    let text = "//! What it does.\n//!\n//! Parts:\n//! What comes here goes on.\n\n    /// Number of steps.\n    ///\n    /// How many there are.\nfn f() {}\n/// Whatever.\n";
    assert_eq!(beginnings(text), [1, 8]);
}
