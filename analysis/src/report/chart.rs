//! Charts over frames: columns of one frame or several from left to right, and marks of what happened below them.

use super::thin::Column;
use crate::page::axis::{Axis, nice_step};
use crate::page::plot::{Plot, Side};

/// Rough distance between two labels of the frame axis.
const FRAME_LABEL: f64 = 80.0;

/// Widths that a mark below the frames may have.
const MARK: [f64; 2] = [3.0, 8.0];

/// Marks in a row below the frames.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Lane {
    /// Name of the marks.
    pub(super) name: &'static str,
    /// Class of the marks in the style.
    pub(super) class: &'static str,
    /// Column of each mark, and what it says.
    pub(super) marks: Vec<(usize, String)>,
}

/// A chart being drawn; each column is one wide.
#[derive(Debug)]
pub(super) struct Chart<'a> {
    width: f64,
    columns: &'a [Column],
    plot: Plot,
}

impl<'a> Chart<'a> {
    /// Draws axes and grid; `label` writes the values of the axis. There is at least one column.
    pub(super) fn new(size: (f64, f64), columns: &'a [Column], axis: Axis, label: impl Fn(f64) -> String) -> Self {
        let plot = Plot::new(size, frame_axis(size.0, columns), Side::new(axis, "", &label));
        Self { width: size.0, columns, plot }
    }

    /// Steps between two values a column, filled.
    pub(super) fn steps(&mut self, class: &str, low: &[f64], high: &[f64]) {
        let corners = |values: &[f64]| -> Vec<(f64, f64)> {
            let ends = |(column, value): (usize, &f64)| [(column as f64, *value), (column as f64 + 1.0, *value)];
            values.iter().enumerate().flat_map(ends).collect()
        };
        self.plot.area(class, &corners(low), &corners(high));
    }

    /// Filled from the lowest to the highest value of each column, where both are there.
    pub(super) fn band(&mut self, class: &str, low: &[Option<f64>], high: &[Option<f64>]) {
        let both = low.iter().zip(high).enumerate();
        let both =
            both.filter_map(|(column, (low, high))| Some(((centre(column), (*low)?), (centre(column), (*high)?))));
        let (low, high): (Vec<_>, Vec<_>) = both.unzip();
        self.plot.area(class, &low, &high);
    }

    /// A line through the columns that have a value; values that stand alone are dots.
    pub(super) fn line(&mut self, class: &str, values: &[Option<f64>]) {
        let columns: Vec<(usize, &Option<f64>)> = values.iter().enumerate().collect();
        for run in columns.chunk_by(|(_, a), (_, b)| a.is_some() == b.is_some()) {
            let points: Vec<_> = run.iter().filter_map(|(column, value)| Some((centre(*column), (**value)?))).collect();
            self.plot.line(class, &points);
        }
    }

    /// Adds the tooltip of each column.
    pub(super) fn tips(&mut self, tip: impl Fn(&Column) -> String) {
        for (index, column) in self.columns.iter().enumerate() {
            self.plot.tip([index as f64, index as f64 + 1.0], &tip(column));
        }
    }

    /// The drawing, with rows of marks below it; `name` is read out by screen readers.
    pub(super) fn finish(mut self, name: &str, lanes: &[Lane]) -> String {
        let width = (self.width / self.columns.len() as f64).clamp(MARK[0], MARK[1]);
        for lane in lanes {
            let marks = lane.marks.iter().map(|(column, words)| (centre(*column), words.clone()));
            self.plot.lane((lane.name, lane.class), width, marks);
        }
        self.plot.finish(name)
    }
}

/// The middle of a column.
fn centre(column: usize) -> f64 {
    column as f64 + 0.5
}

/// Round frame numbers at their columns, in a chart of this width.
fn frame_axis(width: f64, columns: &[Column]) -> Side<'static> {
    let (first, last) = (columns[0].first, columns[columns.len() - 1].last);
    let step = (nice_step(((last - first) as f64 * FRAME_LABEL / width).max(1.0)) as i64).max(1);
    let begin = first + (step - first.rem_euclid(step)) % step;
    // Where frames are missing, labels come closer: half the distance has to stay.
    let apart = columns.len() as f64 * FRAME_LABEL / width / 2.0;
    let (mut ticks, mut labels): (Vec<f64>, Vec<String>) = (Vec::new(), Vec::new());
    for frame in (begin..=last).step_by(step as usize) {
        let at = centre(columns.partition_point(|column| column.last < frame));
        if ticks.last().is_none_or(|before| at - before >= apart) {
            ticks.push(at);
            labels.push(frame.to_string());
        }
    }
    Side { axis: Axis::between([0.0, columns.len() as f64], ticks), title: "", labels }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_stand_at_their_height_and_frames_at_their_column() {
        let column = |i: i64| Column { first: 1001 + i, last: 1001 + i, rows: i as usize..i as usize + 1 };
        let columns: Vec<Column> = (0..4).map(column).collect();
        // The room that a chart without titles leaves around its field.
        let (size, left, top) = ((490.0, 128.0), 72.0, 8.0);
        let mut chart = Chart::new(size, &columns, Axis::linear([10.0].into_iter(), 2), |v| v.to_string());
        chart.line("l1", &[Some(0.0), Some(10.0), None, Some(5.0)]);
        let svg = chart.finish("test", &[Lane { name: "lane", class: "bad", marks: vec![(2, "a < b".into())] }]);
        // Columns are 100 wide; zero lies at the bottom, ten at the top, five in the middle.
        let at = |x: f64, y: f64| format!("{} {}", left + x, top + y);
        assert!(svg.contains(&format!("d=\"M{}L{}\"", at(50.0, 100.0), at(150.0, 0.0))), "{svg}");
        assert!(svg.contains(&format!("d=\"M{}h0\"", at(350.0, 50.0))), "{svg}");
        for frame in 1001..=1004 {
            assert!(svg.contains(&format!(">{frame}</text>")), "{svg}");
        }
        assert!(svg.contains("<title>a &lt; b</title>"), "{svg}");
    }
}
