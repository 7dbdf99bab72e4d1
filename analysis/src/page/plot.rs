//! Charts of values over values, and bars, as SVG. Colours come from the page's style, so that one drawing serves light and
//! dark.

use std::fmt::Write;

use super::axis::{Axis, coordinate as p};
use super::text::escape;

/// Room at the left and at the right of the field.
const SIDES: [f64; 2] = [72.0, 18.0];

/// Room above and below the field, without and with the title of an axis.
const ABOVE: [f64; 2] = [8.0, 22.0];
const BELOW: [f64; 2] = [20.0, 40.0];

/// Radius of a mark that holds a number.
const MARK: f64 = 9.0;

/// Height of a bar, and of its row.
const BAR: (f64, f64) = (16.0, 24.0);

/// Height of a mark in a lane, and of the lane.
const LANE: (f64, f64) = (9.0, 14.0);

/// Rough width of a letter of the labels.
const LETTER: f64 = 6.2;

/// An axis, its title, which may be empty, and the label of each of its ticks.
pub(crate) struct Side<'a> {
    pub(crate) axis: Axis,
    pub(crate) title: &'a str,
    pub(crate) labels: Vec<String>,
}

impl<'a> Side<'a> {
    /// An axis whose values are written by `label`.
    pub(crate) fn new(axis: Axis, title: &'a str, label: &dyn Fn(f64) -> String) -> Self {
        let labels = axis.ticks.iter().map(|tick| label(*tick)).collect();
        Self { axis, title, labels }
    }
}

/// A chart being drawn.
#[derive(Debug)]
pub(crate) struct Plot {
    size: (f64, f64),
    left: f64,
    right: f64,
    top: f64,
    ground: f64,
    axes: [Axis; 2],
    body: String,
}

impl Plot {
    /// Draws axes and grid.
    pub(crate) fn new(size: (f64, f64), x: Side<'_>, y: Side<'_>) -> Self {
        let room = |of: [f64; 2], title: &str| of[usize::from(!title.is_empty())];
        let (top, ground) = (room(ABOVE, y.title), size.1 - room(BELOW, x.title));
        let (left, right) = (SIDES[0], size.0 - SIDES[1]);
        let mut plot = Self { size, left, right, top, ground, axes: [x.axis, y.axis], body: String::new() };
        for (tick, label) in plot.axes[1].ticks.clone().into_iter().zip(y.labels) {
            let at = plot.y(tick);
            plot.path(line_class(tick), &format!("M{} {}H{}", p(left), p(at), p(right)));
            plot.text("yl", (left - 6.0, at + 3.5), &label);
        }
        for (tick, label) in plot.axes[0].ticks.clone().into_iter().zip(x.labels) {
            let at = plot.x(tick);
            plot.path(line_class(tick), &format!("M{} {}V{}", p(at), p(top), p(ground)));
            plot.text("xl", (at, ground + 15.0), &label);
        }
        plot.path("axis", &format!("M{} {}V{}H{}", p(left), p(top), p(ground), p(right)));
        plot.text("yl", (right, size.1 - 6.0), x.title);
        plot.text("at", (4.0, top - 9.0), y.title);
        plot
    }

    /// Number of labels that fit upon each other beside a chart of this height.
    pub(crate) fn labels_in(height: f64) -> usize {
        ((height - 40.0) / 32.0).max(2.0) as usize
    }

    fn path(&mut self, class: &str, path: &str) {
        // Writing into a text cannot fail.
        let _ = write!(self.body, "<path class=\"{class}\" d=\"{path}\"/>");
    }

    fn text(&mut self, class: &str, at: (f64, f64), words: &str) {
        if !words.is_empty() {
            self.body += &text(class, at, words);
        }
    }

    fn x(&self, value: f64) -> f64 {
        self.left + (self.right - self.left) * self.axes[0].share(value)
    }

    fn y(&self, value: f64) -> f64 {
        self.top + (self.ground - self.top) * (1.0 - self.axes[1].share(value))
    }

    fn point(&self, (x, y): (f64, f64)) -> String {
        format!("{} {}", p(self.x(x)), p(self.y(y)))
    }

    /// A line through points; one that stands alone is a dot.
    pub(crate) fn line(&mut self, class: &str, points: &[(f64, f64)]) {
        let places: Vec<String> = points.iter().map(|point| self.point(*point)).collect();
        match places.as_slice() {
            [] => {}
            // A line of no length with round ends.
            [alone] => self.path(class, &format!("M{alone}h0")),
            places => self.path(class, &format!("M{}", places.join("L"))),
        }
    }

    /// Filled between two lines of points.
    pub(crate) fn area(&mut self, class: &str, low: &[(f64, f64)], high: &[(f64, f64)]) {
        let places: Vec<String> = high.iter().chain(low.iter().rev()).map(|point| self.point(*point)).collect();
        if !places.is_empty() {
            self.path(class, &format!("M{}Z", places.join("L")));
        }
    }

    /// Steps that hold each value until the next one: what is the best for any time. Points ascend in x.
    pub(crate) fn staircase(&mut self, class: &str, points: &[(f64, f64)]) {
        let Some(((x, y), rest)) = points.split_first() else { return };
        let mut path = format!("M{} {}V{}", p(self.x(*x)), p(self.top), p(self.y(*y)));
        for (x, y) in rest {
            let _ = write!(path, "H{}V{}", p(self.x(*x)), p(self.y(*y)));
        }
        let _ = write!(path, "H{}", p(self.right));
        self.path(class, &path);
    }

    /// A line across at x, with a word at its top.
    pub(crate) fn at_x(&mut self, class: &str, x: f64, word: &str) {
        let at = self.x(x);
        // Towards the right edge the word stands at the left of its line.
        let is_left = at + 6.0 + LETTER * word.chars().count() as f64 > self.right;
        let (anchor, place) = if is_left { ("yl", at - 5.0) } else { ("at", at + 5.0) };
        self.path(class, &format!("M{} {}V{}", p(at), p(self.top), p(self.ground)));
        self.text(anchor, (place, self.top + 11.0), word);
    }

    /// A line across at y, with a word at its right end.
    pub(crate) fn at_y(&mut self, class: &str, y: f64, word: &str) {
        let at = self.y(y);
        self.path(class, &format!("M{} {}H{}", p(self.left), p(at), p(self.right)));
        self.text("yl", (self.right - 4.0, at - 4.0), word);
    }

    /// Greys everything from x to the right edge.
    pub(crate) fn beyond(&mut self, x: f64) {
        let from = self.x(x);
        self.body += &rect("beyond", [from, self.top, (self.right - from).max(0.0), self.ground - self.top], "");
    }

    /// Adds the tooltip of the field between two values of x.
    pub(crate) fn tip(&mut self, [from, to]: [f64; 2], tip: &str) {
        let (from, to) = (self.x(from), self.x(to));
        self.body += &rect("tip", [from, self.top, to - from, self.ground - self.top], tip);
    }

    /// A round mark with a short word in it, and what a pointer over it tells.
    pub(crate) fn mark(&mut self, class: &str, (x, y): (f64, f64), word: &str, tip: &str) {
        let (x, y, radius) = (self.x(x), self.y(y), if word.is_empty() { 3.5 } else { MARK });
        let (word, tip) = (text("xl", (x, y + 3.8), word), escape(tip));
        let _ = write!(
            self.body,
            "<g class=\"mark {class}\"><circle cx=\"{}\" cy=\"{}\" r=\"{}\"/>{word}<title>{tip}</title></g>",
            p(x),
            p(y),
            p(radius)
        );
    }

    /// A triangle that shows a slope on two logarithmic axes: it spans a factor of `span` in x from `corner` on.
    pub(crate) fn slope(&mut self, corner: (f64, f64), span: f64, order: f64) {
        let [x, x_end] = [corner.0, span * corner.0].map(|x| self.x(x));
        let [y, y_end] = [corner.1, corner.1 * span.powf(order)].map(|y| self.y(y));
        self.path("slope", &format!("M{} {}H{}V{}Z", p(x), p(y), p(x_end), p(y_end)));
        self.text("at", (x_end + 4.0, (y + y_end) / 2.0 + 3.5), &format!("{order:.2}"));
        self.text("xl", ((x + x_end) / 2.0, y + 12.0), "1");
    }

    /// A row of marks below everything so far: the value of x that each stands at, and what a pointer over it tells.
    pub(crate) fn lane(&mut self, (name, class): (&str, &str), width: f64, marks: impl Iterator<Item = (f64, String)>) {
        let y = self.size.1 + LANE.1 / 2.0;
        self.size.1 += LANE.1;
        self.text("yl", (self.left - 6.0, y + 3.5), name);
        self.path("grid", &format!("M{} {}H{}", p(self.left), p(y), p(self.right)));
        for (at, tip) in marks {
            self.body += &rect(class, [self.x(at) - width / 2.0, y - LANE.0 / 2.0, width, LANE.0], &tip);
        }
    }

    /// The drawing; `name` is read out by screen readers.
    pub(crate) fn finish(self, name: &str) -> String {
        svg(self.size, name, &self.body)
    }
}

/// Class of the line at a tick: zero is an axis.
fn line_class(tick: f64) -> &'static str {
    if tick == 0.0 { "axis" } else { "grid" }
}

fn text(class: &str, (x, y): (f64, f64), words: &str) -> String {
    format!("<text class=\"{class}\" x=\"{}\" y=\"{}\">{}</text>", p(x), p(y), escape(words))
}

/// A rectangle from its left upper corner, and what a pointer over it tells.
fn rect(class: &str, [x, y, width, height]: [f64; 4], tip: &str) -> String {
    let tip = if tip.is_empty() { String::new() } else { format!("<title>{}</title>", escape(tip)) };
    let (x, y, width, height) = (p(x), p(y), p(width), p(height));
    format!("<rect class=\"{class}\" x=\"{x}\" y=\"{y}\" width=\"{width}\" height=\"{height}\">{tip}</rect>")
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
        let mut x = left;
        body += &text("yl", (left - 6.0, y + 12.0), &bar.name);
        for (class, part, tip) in &bar.parts {
            body += &rect(class, [x, y, part * scale, BAR.0], tip);
            x += part * scale;
        }
        body += &text("at", (x + 6.0, y + 12.0), &bar.end);
    }
    svg((width, BAR.1 * rows.len() as f64), name, &body)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plot() -> Plot {
        let size = (SIDES[0] + SIDES[1] + 100.0, ABOVE[1] + BELOW[1] + 100.0);
        let side = |title| Side::new(Axis::linear([10.0].into_iter(), 2), title, &|value| value.to_string());
        Plot::new(size, side("x"), side("y"))
    }

    #[test]
    fn points_stand_at_their_values() {
        let mut drawn = plot();
        drawn.line("l1", &[(0.0, 0.0), (10.0, 5.0)]);
        drawn.line("l2", &[(5.0, 10.0)]);
        let (left, top) = (SIDES[0], ABOVE[1]);
        let line = format!("M{} {}L{} {}", p(left), p(top + 100.0), p(left + 100.0), p(top + 50.0));
        let dot = format!("M{} {}h0", p(left + 50.0), p(top));
        let drawing = drawn.finish("test");
        assert!(drawing.contains(&line) && drawing.contains(&dot), "{line} {dot}\n{drawing}");
    }

    #[test]
    fn a_staircase_comes_from_above_and_holds_each_value() {
        let mut drawn = plot();
        drawn.staircase("l1", &[(2.0, 8.0), (5.0, 4.0)]);
        let (left, top) = (SIDES[0], ABOVE[1]);
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
