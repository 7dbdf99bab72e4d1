//! Building blocks of the pages that Drapery writes: each page is one file that needs nothing else, no script, no
//! font, no picture from elsewhere. Charts are SVG whose colours follow the reader's light or dark style.

pub(crate) mod axis;
pub(crate) mod base64;
pub(crate) mod plot;
pub(crate) mod table;
pub(crate) mod text;

use std::path::Path;

use drapery_io::atomic_file;
use drapery_io::error::IoError;

use text::escape;

/// Mark in the head of every page that Drapery writes: such a page may be replaced by another.
pub(crate) const MARK: &str = "<meta name=\"generator\" content=\"drapery\">";

/// Style of pages, light and dark.
const STYLE: &str = include_str!("style.css");

/// Stages that get a colour of their own.
const STAGES: usize = 7;

/// Names of the stages that took longest in all, in the order in which they came: those that get a colour of their own.
pub(crate) fn longest_stages<'a>(stages: impl Iterator<Item = (&'a str, f64)>) -> Vec<&'a str> {
    let mut totals: Vec<(&str, f64)> = Vec::new();
    for (name, seconds) in stages {
        match totals.iter_mut().find(|(known, _)| *known == name) {
            Some((_, total)) => *total += seconds,
            None => totals.push((name, seconds)),
        }
    }
    let mut by_time: Vec<f64> = totals.iter().map(|(_, seconds)| *seconds).collect();
    by_time.sort_by(|a, b| b.total_cmp(a));
    let least = by_time.get(STAGES - 1).copied().unwrap_or(0.0);
    let long = totals.into_iter().filter(|(_, seconds)| *seconds >= least && *seconds > 0.0);
    long.map(|(name, _)| name).take(STAGES).collect()
}

/// A whole page. Title and footer are texts, the body is markup.
pub(crate) fn document(title: &str, body: &str, made: &str) -> String {
    format!(
        "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">{MARK}\
         <meta name=\"viewport\" content=\"width=device-width,initial-scale=1\">\
         <title>{}</title><style>\n{STYLE}</style></head>\n<body><main>\n{body}\
         <footer>{}</footer></main></body></html>\n",
        escape(title),
        escape(made),
    )
}

/// Writes a page, in the place of an earlier one if there is one.
///
/// # Errors
/// The file is there and is no page of Drapery, or cannot be written.
pub(crate) fn write(path: &Path, page: &str) -> Result<(), IoError> {
    check(path)?;
    atomic_file::replace(path, page.as_bytes())
}

/// Makes sure that [`write`] would not replace anything but a page of Drapery.
///
/// # Errors
/// The file is there and is no page of Drapery, or cannot be looked at.
pub(crate) fn check(path: &Path) -> Result<(), IoError> {
    atomic_file::check_own(path, "page", |start| String::from_utf8_lossy(start).contains(MARK))
}

/// A figure that matters, large, with words below it.
pub(crate) fn tile(class: &str, value: &str, words: &str) -> String {
    format!("<div class=\"tile {class}\"><b>{}</b><span>{}</span></div>", escape(value), escape(words))
}

/// A chart with its title, a line of explanation, and its legend: class and name of each colour.
pub(crate) fn card(title: &str, note: &str, legend: &[(&str, &str)], drawing: &str) -> String {
    let item = |(class, name): &(&str, &str)| format!("<li><i class=\"{class}\"></i>{}</li>", escape(name));
    let items: String = legend.iter().map(item).collect();
    let legend = if items.is_empty() { String::new() } else { format!("<ul class=\"legend\">{items}</ul>") };
    let note = if note.is_empty() { String::new() } else { format!("<p>{}</p>", escape(note)) };
    format!(
        "<figure class=\"card\"><figcaption><h3>{}</h3>{note}{legend}</figcaption>\
         <div class=\"plot\">{drawing}</div></figure>",
        escape(title)
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_longest_stages_are_named_in_the_order_of_execution() {
        let names = ["a", "b", "c", "d", "e", "f", "g", "h", "i", "a"];
        let seconds = [4.0, 0.1, 4.0, 3.0, 9.0, 2.0, 1.5, 1.0, 0.2, 1.0];
        assert_eq!(longest_stages(names.into_iter().zip(seconds)), ["a", "c", "d", "e", "f", "g", "h"]);
    }
}
