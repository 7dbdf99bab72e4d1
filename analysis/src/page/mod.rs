//! What the pages that Drapery writes are made of: one file each that needs nothing else, no script, no font, no picture
//! from elsewhere. Charts are SVG whose colours follow the reader's light or dark style.

pub(crate) mod axis;
pub(crate) mod plot;
pub(crate) mod table;
pub(crate) mod text;

use text::escape;

/// How pages look, light and dark.
const STYLE: &str = include_str!("style.css");

/// A whole page. Title and footer are texts, the body is markup.
pub(crate) fn document(title: &str, body: &str, made: &str) -> String {
    format!(
        "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">\
         <meta name=\"viewport\" content=\"width=device-width,initial-scale=1\">\
         <title>{}</title><style>\n{STYLE}</style></head>\n<body><main>\n{body}\
         <footer>{}</footer></main></body></html>\n",
        escape(title),
        escape(made),
    )
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
