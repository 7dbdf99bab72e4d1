//! The course of several runs: a line for each.

use drapery_shot::run_record::folder::RunFolder;
use drapery_shot::run_record::reader::FrameRow;

use crate::page::axis::{Axis, nice_step};
use crate::page::plot::{Plot, Side};
use crate::page::{card, text};

/// Size of a chart.
const SIZE: (f64, f64) = (560.0, 180.0);

/// Lines that can be told apart.
const LINES: usize = 6;

/// Rough distance between two labels of the frame axis.
const FRAME_LABEL: f64 = 80.0;

/// Frame and value of a line's points.
type Line = Vec<(f64, f64)>;

/// A chart of time and one of strain; empty where nothing was simulated.
pub(super) fn charts(runs: &[(String, RunFolder)]) -> String {
    let percent = |value: f64| format!("{} %", text::digits(100.0 * value));
    let largest = |row: &FrameRow| row.strains.iter().map(|strain| strain.p99_9).reduce(f64::max);
    let charts = [
        chart(runs, "Time per frame", &|row| Some(row.seconds), &text::seconds),
        chart(runs, "Strain, 99.9th percentile of the worst garment", &largest, &percent),
    ];
    let charts: String = charts.into_iter().flatten().collect();
    if charts.is_empty() {
        return String::new();
    }
    format!("<section><h2>Frame by frame</h2><div class=\"pairs\">{charts}</div></section>\n")
}

fn chart(
    runs: &[(String, RunFolder)],
    title: &str,
    value: &dyn Fn(&FrameRow) -> Option<f64>,
    label: &dyn Fn(f64) -> String,
) -> Option<String> {
    let line = |run: &RunFolder| -> Line {
        let rows = run.record.frames.iter().filter(|row| row.steps > 0);
        let finite = rows.filter_map(|row| Some((row.frame as f64, value(row)?)));
        finite.filter(|(_, value)| value.is_finite()).collect()
    };
    let lines: Vec<Line> = runs.iter().take(LINES).map(|(_, run)| line(run)).collect();
    let all = || lines.iter().flatten();
    let [first, last] = [f64::min, f64::max].map(|pick| all().map(|point| point.0).reduce(pick));
    let x = frame_axis(first?, last?);
    let y = Side::new(Axis::linear(all().map(|point| point.1), Plot::labels_in(SIZE.1)), "", label);
    let mut plot = Plot::new(SIZE, x, y);
    let mut legend: Vec<(String, &str)> = Vec::new();
    for (index, ((name, _), line)) in runs.iter().zip(&lines).enumerate() {
        let colour = (index + 1) % LINES;
        plot.line(&format!("l{colour}"), line);
        legend.push((format!("f{colour}"), name));
    }
    let note = match runs.len() {
        ..=LINES => String::new(),
        count => format!("The first {LINES} of {count} runs."),
    };
    let legend: Vec<(&str, &str)> = legend.iter().map(|(class, name)| (class.as_str(), *name)).collect();
    Some(card(title, &note, &legend, &plot.finish(title)))
}

/// Round frame numbers between two frames.
fn frame_axis(first: f64, last: f64) -> Side<'static> {
    let step = nice_step(((last - first) * FRAME_LABEL / SIZE.0).max(1.0)).max(1.0);
    let begin = (first / step).ceil() * step;
    let count = ((last - begin) / step).floor().max(0.0) as usize;
    let ticks: Vec<f64> = (0..=count).map(|i| begin + step * i as f64).filter(|tick| *tick <= last).collect();
    // A single frame still has a width.
    let end = if last > first { last } else { first + 1.0 };
    Side::new(Axis::between([first, end], ticks), "", &|frame| format!("{frame:.0}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_of_other_lengths_share_one_axis_and_each_has_a_line() {
        let run = |frames: std::ops::RangeInclusive<i64>| {
            let mut run = RunFolder::default();
            let row = |frame| FrameRow { frame, seconds: 1.0, steps: 8, ..FrameRow::default() };
            run.record.frames = frames.map(row).collect();
            run
        };
        let runs = vec![("long".to_owned(), run(1001..=1100)), ("short".to_owned(), run(1001..=1001))];
        let page = charts(&runs);
        assert!(
            page.contains("class=\"l1\"") && page.contains("class=\"l2\"") && page.contains(">1020</text>"),
            "{page}"
        );
        assert!(charts(&[("none".to_owned(), RunFolder::default())]).is_empty());
    }
}
