//! Charts over frames as SVG: an axis of frames below, an axis of values at the left, and steps, lines or bands between
//! them. Colours come from the page's style, so that one drawing serves light and dark.

use std::fmt::Write;

use super::thin::Column;
use crate::page::axis::{Axis, coordinate as p, nice_step};
use crate::page::text::escape;

/// Room for the labels at the left.
const LEFT: f64 = 68.0;

/// Room at the right.
const RIGHT: f64 = 16.0;

/// Room above.
const TOP: f64 = 8.0;

/// Room for the frame numbers below.
const BOTTOM: f64 = 20.0;

/// Height of a row of marks.
const LANE: f64 = 14.0;

/// Rough distance between two labels of the frame axis.
const FRAME_LABEL: f64 = 80.0;

/// Rough distance between two labels of the value axis.
const VALUE_LABEL: f64 = 36.0;

/// Marks in a row below the frames.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Lane {
    /// What they are.
    pub(super) name: &'static str,
    /// Class of the marks in the style.
    pub(super) class: &'static str,
    /// Column of each mark, and what it says.
    pub(super) marks: Vec<(usize, String)>,
}

/// A chart being drawn.
#[derive(Debug)]
pub(super) struct Chart<'a> {
    width: f64,
    height: f64,
    columns: &'a [Column],
    axis: Axis,
    body: String,
}

impl<'a> Chart<'a> {
    /// Draws axes and grid; `label` writes the values of the axis. There is at least one column.
    pub(super) fn new(
        (width, height): (f64, f64),
        columns: &'a [Column],
        axis: Axis,
        label: impl Fn(f64) -> String,
    ) -> Self {
        let mut chart = Self { width, height, columns, axis, body: String::new() };
        for tick in chart.axis.ticks.clone() {
            let (y, right) = (chart.y(tick), width - RIGHT);
            let class = if tick == 0.0 { "axis" } else { "grid" };
            chart.push(format_args!("<path class=\"{class}\" d=\"M{} {}H{}\"/>", p(LEFT), p(y), p(right)));
            let text = escape(&label(tick));
            chart.push(format_args!("<text class=\"yl\" x=\"{}\" y=\"{}\">{text}</text>", p(LEFT - 6.0), p(y + 3.5)));
        }
        chart.frame_labels();
        chart
    }

    /// Number of value labels that fit into a chart of this height.
    pub(super) fn labels_in(height: f64) -> usize {
        ((height - TOP - BOTTOM) / VALUE_LABEL).max(2.0) as usize
    }

    fn frame_labels(&mut self) {
        let (first, last) = (self.columns[0].first, self.columns[self.columns.len() - 1].last);
        let wanted = ((self.width - LEFT - RIGHT) / FRAME_LABEL).max(1.0);
        let step = (nice_step(((last - first) as f64 / wanted).max(1.0)) as i64).max(1);
        let mut frame = first + (step - first.rem_euclid(step)) % step;
        let mut free_from = 0.0;
        while frame <= last {
            let column = self.columns.partition_point(|column| column.last < frame);
            let (x, y) = (self.centre(column), self.height - 5.0);
            frame += step;
            // Where frames are missing, labels come closer.
            if x < free_from {
                continue;
            }
            free_from = x + FRAME_LABEL / 2.0;
            let frame = frame - step;
            self.push(format_args!("<text class=\"xl\" x=\"{}\" y=\"{}\">{frame}</text>", p(x), p(y)));
            let below = self.height - BOTTOM;
            self.push(format_args!("<path class=\"axis\" d=\"M{} {}v4\"/>", p(x), p(below)));
        }
    }

    fn push(&mut self, text: std::fmt::Arguments<'_>) {
        // Writing into a text cannot fail.
        let _ = self.body.write_fmt(text);
    }

    fn y(&self, value: f64) -> f64 {
        let height = self.height - TOP - BOTTOM;
        TOP + height * (1.0 - self.axis.share(value))
    }

    /// Left edge of a column; that of the one after the last is the right edge of the chart.
    fn edge(&self, column: usize) -> f64 {
        LEFT + (self.width - LEFT - RIGHT) * column as f64 / self.columns.len() as f64
    }

    fn centre(&self, column: usize) -> f64 {
        (self.edge(column) + self.edge(column + 1)) / 2.0
    }

    /// Steps between two values a column, filled.
    pub(super) fn steps(&mut self, class: &str, low: &[f64], high: &[f64]) {
        let mut path = String::new();
        for (column, value) in high.iter().enumerate() {
            let (x, next, y) = (self.edge(column), self.edge(column + 1), self.y(*value));
            let _ = write!(path, "{}{} {}H{}", if column == 0 { "M" } else { "L" }, p(x), p(y), p(next));
        }
        for (column, value) in low.iter().enumerate().rev() {
            let (x, next, y) = (self.edge(column), self.edge(column + 1), self.y(*value));
            let _ = write!(path, "L{} {}H{}", p(next), p(y), p(x));
        }
        self.push(format_args!("<path class=\"{class}\" d=\"{path}Z\"/>"));
    }

    /// Filled from the lowest to the highest value of each column, where both are there.
    pub(super) fn band(&mut self, class: &str, low: &[Option<f64>], high: &[Option<f64>]) {
        let at = |chart: &Self, column: usize, value: f64| format!("{} {}", p(chart.centre(column)), p(chart.y(value)));
        let there: Vec<(usize, f64, f64)> =
            low.iter().zip(high).enumerate().filter_map(|(i, (l, h))| Some((i, (*l)?, (*h)?))).collect();
        let upper = there.iter().map(|(i, _, high)| at(self, *i, *high));
        let lower = there.iter().rev().map(|(i, low, _)| at(self, *i, *low));
        let path: Vec<String> = upper.chain(lower).collect();
        if !path.is_empty() {
            self.push(format_args!("<path class=\"{class}\" d=\"M{}Z\"/>", path.join("L")));
        }
    }

    /// A line through the columns that have a value; alone-standing values are dots.
    pub(super) fn line(&mut self, class: &str, values: &[Option<f64>]) {
        let mut path = String::new();
        let is_there = |column: usize| values.get(column).copied().flatten().is_some();
        for (column, value) in values.iter().enumerate() {
            let Some(value) = value else { continue };
            let goes_on = column > 0 && is_there(column - 1);
            let _ = write!(path, "{}{} {}", if goes_on { "L" } else { "M" }, p(self.centre(column)), p(self.y(*value)));
            if !goes_on && !is_there(column + 1) {
                // A line of no length with round ends.
                path.push_str("h0");
            }
        }
        self.push(format_args!("<path class=\"{class}\" d=\"{path}\"/>"));
    }

    /// What a pointer over each column tells.
    pub(super) fn tips(&mut self, tip: impl Fn(&Column) -> String) {
        let columns = self.columns;
        let height = self.height - TOP - BOTTOM;
        for (index, column) in columns.iter().enumerate() {
            let (x, width) = (self.edge(index), self.edge(index + 1) - self.edge(index));
            let text = escape(&tip(column));
            self.push(format_args!(
                "<rect class=\"tip\" x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\"><title>{text}</title></rect>",
                p(x),
                p(TOP),
                p(width),
                p(height)
            ));
        }
    }

    /// The drawing, with rows of marks below it; `name` is read out by screen readers.
    pub(super) fn finish(mut self, name: &str, lanes: &[Lane]) -> String {
        let plot = self.height;
        for (row, lane) in lanes.iter().enumerate() {
            let y = plot + LANE * (row as f64 + 0.5);
            let label = escape(lane.name);
            self.push(format_args!("<text class=\"yl\" x=\"{}\" y=\"{}\">{label}</text>", p(LEFT - 6.0), p(y + 3.5)));
            self.push(format_args!("<path class=\"grid\" d=\"M{} {}H{}\"/>", p(LEFT), p(y), p(self.width - RIGHT)));
            for (column, words) in &lane.marks {
                let width = (self.edge(1) - self.edge(0)).clamp(3.0, 8.0);
                let (x, words) = (self.centre(*column) - width / 2.0, escape(words));
                self.push(format_args!(
                    "<rect class=\"{}\" x=\"{}\" y=\"{}\" width=\"{}\" height=\"9\" rx=\"1.5\">\
                     <title>{words}</title></rect>",
                    lane.class,
                    p(x),
                    p(y - 4.5),
                    p(width)
                ));
            }
        }
        let height = plot + LANE * lanes.len() as f64;
        format!(
            "<svg viewBox=\"0 0 {} {}\" role=\"img\" aria-label=\"{}\">{}</svg>",
            p(self.width),
            p(height),
            escape(name),
            self.body
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn columns(count: i64) -> Vec<Column> {
        (0..count).map(|i| Column { first: 1001 + i, last: 1001 + i, rows: i as usize..i as usize + 1 }).collect()
    }

    #[test]
    fn values_stand_at_their_height_and_frames_at_their_column() {
        let columns = columns(4);
        let size = (LEFT + RIGHT + 400.0, TOP + BOTTOM + 100.0);
        let mut chart = Chart::new(size, &columns, Axis::linear([10.0].into_iter(), 2), |v| v.to_string());
        chart.line("l1", &[Some(0.0), Some(10.0), None, Some(5.0)]);
        // Columns are 100 wide; zero lies at the bottom, ten at the top, five in the middle.
        assert!(chart.body.contains("d=\"M118 108L218 8M418 58h0\""), "{}", chart.body);
        let svg = chart.finish("test", &[Lane { name: "lane", class: "bad", marks: vec![(2, "a < b".into())] }]);
        for frame in 1001..=1004 {
            assert!(svg.contains(&format!(">{frame}</text>")), "{svg}");
        }
        assert!(svg.contains("<title>a &lt; b</title>"), "{svg}");
    }
}
