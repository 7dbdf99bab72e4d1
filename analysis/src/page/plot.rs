//! Charts of values over values, and bars, as SVG. Colours come from the page's style.

use std::fmt::Write;

use super::axis::{Axis, coordinate as p};
use super::text::escape;

/// Room at the left, at the right, above and below the field.
const ROOM: [f64; 4] = [72.0, 18.0, 22.0, 40.0];

/// Radius of a mark that holds a number.
const MARK: f64 = 9.0;

/// Height of a bar, and of its row.
const BAR: (f64, f64) = (16.0, 24.0);

/// Rough width of a letter of the labels.
const LETTER: f64 = 6.2;

/// An axis, its title, and how its labels are written.
pub(crate) struct Side<'a> {
    pub(crate) axis: Axis,
    pub(crate) title: &'a str,
    pub(crate) label: &'a dyn Fn(f64) -> String,
}

/// A chart being drawn.
#[derive(Debug)]
pub(crate) struct Plot {
    size: (f64, f64),
    axes: [Axis; 2],
    body: String,
}

impl Plot {
    /// Draws axes and grid.
    pub(crate) fn new(size: (f64, f64), x: Side<'_>, y: Side<'_>) -> Self {
        let [left, right, top, bottom] = ROOM;
        let (end, ground) = (size.0 - right, size.1 - bottom);
        let mut plot = Self { size, axes: [x.axis, y.axis], body: String::new() };
        for tick in plot.axes[1].ticks.clone() {
            let (at, text) = (plot.y(tick), escape(&(y.label)(tick)));
            plot.push(format_args!("<path class=\"grid\" d=\"M{} {}H{}\"/>", p(left), p(at), p(end)));
            plot.push(format_args!("<text class=\"yl\" x=\"{}\" y=\"{}\">{text}</text>", p(left - 6.0), p(at + 3.5)));
        }
        for tick in plot.axes[0].ticks.clone() {
            let (at, text) = (plot.x(tick), escape(&(x.label)(tick)));
            plot.push(format_args!("<path class=\"grid\" d=\"M{} {}V{}\"/>", p(at), p(top), p(ground)));
            plot.push(format_args!("<text class=\"xl\" x=\"{}\" y=\"{}\">{text}</text>", p(at), p(ground + 15.0)));
        }
        plot.push(format_args!("<path class=\"axis\" d=\"M{} {}V{}H{}\"/>", p(left), p(top), p(ground), p(end)));
        let (x_title, y_title) = (escape(x.title), escape(y.title));
        plot.push(format_args!(
            "<text class=\"yl\" x=\"{}\" y=\"{}\">{x_title}</text>\
             <text class=\"at\" x=\"{}\" y=\"{}\">{y_title}</text>",
            p(end),
            p(size.1 - 6.0),
            p(4.0),
            p(top - 9.0)
        ));
        plot
    }

    /// Number of labels that fit upon each other.
    pub(crate) fn labels_in(height: f64) -> usize {
        ((height - ROOM[2] - ROOM[3]) / 30.0).max(2.0) as usize
    }

    fn push(&mut self, text: std::fmt::Arguments<'_>) {
        // Writing into a text cannot fail.
        let _ = self.body.write_fmt(text);
    }

    fn x(&self, value: f64) -> f64 {
        ROOM[0] + (self.size.0 - ROOM[0] - ROOM[1]) * self.axes[0].share(value)
    }

    fn y(&self, value: f64) -> f64 {
        ROOM[2] + (self.size.1 - ROOM[2] - ROOM[3]) * (1.0 - self.axes[1].share(value))
    }

    /// A line through points.
    pub(crate) fn line(&mut self, class: &str, points: &[(f64, f64)]) {
        let places: Vec<String> = points.iter().map(|(x, y)| format!("{} {}", p(self.x(*x)), p(self.y(*y)))).collect();
        if places.len() > 1 {
            self.push(format_args!("<path class=\"{class}\" d=\"M{}\"/>", places.join("L")));
        }
    }

    /// Steps that hold each value until the next one: what is the best for any time. Points ascend in x.
    pub(crate) fn staircase(&mut self, class: &str, points: &[(f64, f64)]) {
        let Some(((x, y), rest)) = points.split_first() else { return };
        let mut path = format!("M{} {}V{}", p(self.x(*x)), p(ROOM[2]), p(self.y(*y)));
        for (x, y) in rest {
            let _ = write!(path, "H{}V{}", p(self.x(*x)), p(self.y(*y)));
        }
        let _ = write!(path, "H{}", p(self.size.0 - ROOM[1]));
        self.push(format_args!("<path class=\"{class}\" d=\"{path}\"/>"));
    }

    /// A line across at x, with a word at its top.
    pub(crate) fn at_x(&mut self, class: &str, x: f64, word: &str) {
        let (at, word) = (self.x(x), escape(word));
        let (ground, end) = (self.size.1 - ROOM[3], self.size.0 - ROOM[1]);
        // Towards the right edge the word stands at the left of its line.
        let is_left = at + 6.0 + LETTER * word.chars().count() as f64 > end;
        let (anchor, place) = if is_left { ("yl", at - 5.0) } else { ("at", at + 5.0) };
        self.push(format_args!(
            "<path class=\"{class}\" d=\"M{} {}V{}\"/><text class=\"{anchor}\" x=\"{}\" y=\"{}\">{word}</text>",
            p(at),
            p(ROOM[2]),
            p(ground),
            p(place),
            p(ROOM[2] + 11.0)
        ));
    }

    /// A line across at y, with a word at its right end.
    pub(crate) fn at_y(&mut self, class: &str, y: f64, word: &str) {
        let (at, end, word) = (self.y(y), self.size.0 - ROOM[1], escape(word));
        self.push(format_args!(
            "<path class=\"{class}\" d=\"M{} {}H{}\"/><text class=\"yl\" x=\"{}\" y=\"{}\">{word}</text>",
            p(ROOM[0]),
            p(at),
            p(end),
            p(end - 4.0),
            p(at - 4.0)
        ));
    }

    /// Greys everything from x to the right edge.
    pub(crate) fn beyond(&mut self, x: f64) {
        let (from, end, ground) = (self.x(x), self.size.0 - ROOM[1], self.size.1 - ROOM[3]);
        self.push(format_args!(
            "<rect class=\"beyond\" x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\"/>",
            p(from),
            p(ROOM[2]),
            p((end - from).max(0.0)),
            p(ground - ROOM[2])
        ));
    }

    /// A round mark with a short word in it, and what a pointer over it tells.
    pub(crate) fn mark(&mut self, class: &str, (x, y): (f64, f64), word: &str, tip: &str) {
        let (x, y, word, tip) = (self.x(x), self.y(y), escape(word), escape(tip));
        self.push(format_args!(
            "<g class=\"mark {class}\"><circle cx=\"{}\" cy=\"{}\" r=\"{}\"/>\
             <text class=\"xl\" x=\"{}\" y=\"{}\">{word}</text><title>{tip}</title></g>",
            p(x),
            p(y),
            p(if word.is_empty() { 3.5 } else { MARK }),
            p(x),
            p(y + 3.8)
        ));
    }

    /// A triangle that shows a slope on two logarithmic axes: it spans a factor of `span` in x from `corner` on.
    pub(crate) fn slope(&mut self, corner: (f64, f64), span: f64, order: f64) {
        let (a, b) = ((span * corner.0, corner.1), (span * corner.0, corner.1 * span.powf(order)));
        let at = |plot: &Self, (x, y): (f64, f64)| [plot.x(x), plot.y(y)];
        let [[x, y], [x_a, _], [_, y_b]] = [corner, a, b].map(|point| at(self, point));
        self.push(format_args!(
            "<path class=\"slope\" d=\"M{} {}H{}V{}Z\"/><text class=\"at\" x=\"{}\" y=\"{}\">{order:.2}</text>\
             <text class=\"xl\" x=\"{}\" y=\"{}\">1</text>",
            p(x),
            p(y),
            p(x_a),
            p(y_b),
            p(x_a + 4.0),
            p((y + y_b) / 2.0 + 3.5),
            p((x + x_a) / 2.0),
            p(y + 12.0)
        ));
    }

    /// The drawing; `name` is read out by screen readers.
    pub(crate) fn finish(self, name: &str) -> String {
        svg(self.size, name, &self.body)
    }
}

fn svg((width, height): (f64, f64), name: &str, body: &str) -> String {
    format!("<svg viewBox=\"0 0 {} {}\" role=\"img\" aria-label=\"{}\">{body}</svg>", p(width), p(height), escape(name))
}

/// A bar in parts: class, length, and what a pointer over it tells.
pub(crate) struct Bar {
    pub(crate) name: String,
    pub(crate) parts: Vec<(String, f64, String)>,
    /// Word behind its end.
    pub(crate) end: String,
}

/// Bars below each other, each in parts one after the other; the longest fills the width.
pub(crate) fn bars(width: f64, name: &str, rows: &[Bar]) -> String {
    let letters =
        |words: &dyn Fn(&Bar) -> &String| rows.iter().map(|bar| words(bar).chars().count()).max().unwrap_or(0);
    let left = (10.0 + LETTER * letters(&|bar| &bar.name) as f64).min(width / 2.0);
    let right = 10.0 + LETTER * letters(&|bar| &bar.end) as f64;
    let length = |bar: &Bar| bar.parts.iter().map(|(_, part, _)| part).sum::<f64>();
    let longest = rows.iter().map(length).fold(f64::MIN_POSITIVE, f64::max);
    let scale = (width - left - right) / longest;
    let mut body = String::new();
    for (row, bar) in rows.iter().enumerate() {
        let y = BAR.1 * row as f64 + (BAR.1 - BAR.0) / 2.0;
        let (mut x, words) = (left, escape(&bar.name));
        let _ = write!(body, "<text class=\"yl\" x=\"{}\" y=\"{}\">{words}</text>", p(left - 6.0), p(y + 12.0));
        for (class, part, tip) in &bar.parts {
            let _ = write!(
                body,
                "<rect class=\"{class}\" x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\"><title>{}</title></rect>",
                p(x),
                p(y),
                p(part * scale),
                p(BAR.0),
                escape(tip)
            );
            x += part * scale;
        }
        let _ =
            write!(body, "<text class=\"at\" x=\"{}\" y=\"{}\">{}</text>", p(x + 6.0), p(y + 12.0), escape(&bar.end));
    }
    svg((width, BAR.1 * rows.len() as f64), name, &body)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plot() -> Plot {
        let size = (ROOM[0] + ROOM[1] + 100.0, ROOM[2] + ROOM[3] + 100.0);
        let label = |value: f64| value.to_string();
        let side = |title| Side { axis: Axis::linear([10.0].into_iter(), 2), title, label: &label };
        Plot::new(size, side("x"), side("y"))
    }

    #[test]
    fn points_stand_at_their_values() {
        let mut drawn = plot();
        drawn.line("l1", &[(0.0, 0.0), (10.0, 5.0)]);
        let [left, _, top, _] = ROOM;
        let expected = format!("M{} {}L{} {}", p(left), p(top + 100.0), p(left + 100.0), p(top + 50.0));
        assert!(drawn.finish("test").contains(&expected), "{expected}");
    }

    #[test]
    fn a_staircase_comes_from_above_and_holds_each_value() {
        let mut drawn = plot();
        drawn.staircase("l1", &[(2.0, 8.0), (5.0, 4.0)]);
        let [left, _, top, _] = ROOM;
        let expected =
            format!("M{} {}V{}H{}V{}H", p(left + 20.0), p(top), p(top + 20.0), p(left + 50.0), p(top + 60.0));
        assert!(drawn.finish("test").contains(&expected), "{expected}");
    }

    #[test]
    fn parts_of_a_bar_follow_each_other_and_words_cannot_leave_their_place() {
        let part = |class: &str, length| (class.to_owned(), length, "<tip>".to_owned());
        let bar = Bar { name: "a".into(), parts: vec![part("f1", 1.0), part("f2", 3.0)], end: "4 s".into() };
        let drawing = bars(200.0, "test", &[bar]);
        assert!(drawing.contains("&lt;tip&gt;") && drawing.contains("class=\"f2\""), "{drawing}");
    }
}
