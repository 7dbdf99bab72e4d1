//! Caches that no application opens.

use drapery_io::formats::by_extension;

use super::{Facts, Finding};

pub(super) fn find(facts: &Facts<'_>) -> Vec<Finding> {
    let formats = &facts.output.formats;
    let opens = |word: &String| by_extension(word).is_some_and(|format| format.opens_in_applications);
    if formats.iter().any(opens) {
        return Vec::new();
    }
    if formats.is_empty() {
        let message = "no caches are written: `format` is an empty list".to_owned();
        return vec![Finding { object: "output".to_owned(), message, line: "format = [\"abc\"]".to_owned() }];
    }
    let words: Vec<String> = formats.iter().map(|word| format!("\"{word}\"")).collect();
    let message = format!("caches are written only as {}, which no application opens", words.join(", "));
    let all = [&["\"abc\"".to_owned()], words.as_slice()].concat().join(", ");
    vec![Finding { object: "output".to_owned(), message, line: format!("format = [{all}]") }]
}
