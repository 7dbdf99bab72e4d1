//! Tables of pages.

use super::text::escape;

/// A cell, and whether it is a number.
pub(crate) type Cell = (String, bool);

/// A cell of words.
pub(crate) fn words(text: impl AsRef<str>) -> Cell {
    (escape(text.as_ref()), false)
}

/// A cell of a number.
pub(crate) fn number(text: impl AsRef<str>) -> Cell {
    (escape(text.as_ref()), true)
}

/// A table in a section of its own; nothing without rows.
pub(crate) fn section(title: &str, note: &str, heads: &[Cell], rows: &[Vec<Cell>]) -> String {
    if rows.is_empty() {
        return String::new();
    }
    format!("<section><h2>{title}</h2><div class=\"card\">{note}{}</div></section>\n", table(heads, rows))
}

/// A table; without a head when that is empty.
pub(crate) fn table(heads: &[Cell], rows: &[Vec<Cell>]) -> String {
    let cell = |tag: &str, (text, is_number): &Cell| {
        let class = if *is_number { " class=\"n\"" } else { "" };
        format!("<{tag}{class}>{text}</{tag}>")
    };
    let head: String = heads.iter().map(|head| cell("th", head)).collect();
    // A list of names and values needs no head.
    let is_list = heads.iter().all(|(text, _)| text.is_empty());
    let head = if is_list { String::new() } else { format!("<thead><tr>{head}</tr></thead>") };
    let row = |row: &Vec<Cell>| format!("<tr>{}</tr>", row.iter().map(|c| cell("td", c)).collect::<String>());
    let body: String = rows.iter().map(row).collect();
    format!("<div class=\"scroll\"><table>{head}<tbody>{body}</tbody></table></div>")
}
