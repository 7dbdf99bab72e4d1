//! Progress display while frames are computed: a bar on a terminal, a line a frame elsewhere, or the words that a farm's software
//! looks for.

use std::io::IsTerminal;

use drapery_io::memory::resident_bytes;
use drapery_shot::run::FrameReport;
use indicatif::{ProgressBar, ProgressStyle as BarStyle};
use serde_json::json;

use crate::args::ProgressStyle;
use crate::failure::Failure;
use crate::say;

/// Number of frames from which the time left is estimated.
const ETA_FRAMES: usize = 10;

/// Progress of a run.
pub(crate) struct Progress {
    style: ProgressStyle,
    bar: Option<ProgressBar>,
    /// Seconds of the last frames.
    recent: Vec<f64>,
    percent: Option<u64>,
}

impl Progress {
    /// Progress over `total` frames, pre-roll included.
    pub(crate) fn new(style: ProgressStyle, quiet: bool, total: u64) -> Self {
        let style = if quiet && style == ProgressStyle::Auto { ProgressStyle::None } else { style };
        let on_terminal = style == ProgressStyle::Auto && std::io::stderr().is_terminal();
        let bar = on_terminal.then(|| {
            let template = BarStyle::with_template("{bar:20} {pos}/{len} {wide_msg}");
            ProgressBar::new(total).with_style(template.unwrap_or_else(|_| BarStyle::default_bar()))
        });
        Self { style, bar, recent: Vec::new(), percent: None }
    }

    /// Reports one frame.
    pub(crate) fn frame(&mut self, report: &FrameReport<'_>) {
        self.recent.push(report.seconds);
        let left = (report.total - report.done) as f64 * median(&self.recent);
        if self.recent.len() >= ETA_FRAMES {
            self.recent.remove(0);
        }
        let text = frame_line(report, left, resident_bytes());
        if let Some(bar) = &self.bar {
            bar.set_position(report.done);
            bar.set_message(text);
            return;
        }
        match self.style {
            ProgressStyle::None => return,
            ProgressStyle::Json => say::line(frame_json(report, left, resident_bytes())),
            _ => say::line(text),
        }
        say::warn_of_loss();
        // A full 100 is for the end, when everything is on the disk.
        self.percent(report.done * 99 / report.total.max(1));
    }

    /// Reports a frame that takes long: its collision-free states so far, and the share of its time that is done.
    pub(crate) fn underway(&mut self, frame: i64, states: u64, share: f64) {
        let text = format!("frame {frame}: {:.1} % complete after {states} steps", 100.0 * share);
        match (&self.bar, self.style) {
            (Some(bar), _) => bar.set_message(text),
            (None, ProgressStyle::None) => {}
            (None, ProgressStyle::Json) => {
                say::line(json!({"record": "underway", "frame": frame, "steps": states, "share": share}));
            }
            (None, _) => say::line(text),
        }
    }

    /// Takes the bar off the terminal.
    pub(crate) fn clear(&mut self) {
        if let Some(bar) = self.bar.take() {
            bar.finish_and_clear();
        }
    }

    /// Reports the end: whether all frames are there, and the error that ended the run.
    pub(crate) fn end(&mut self, exit_code: u8, is_done: bool, error: Option<&Failure>) {
        self.clear();
        if self.style == ProgressStyle::Json {
            let mut record = json!({"record": "end", "exit_code": exit_code});
            if let Some(error) = error {
                record["error"] = error.to_string().into();
            }
            say::line(record);
        } else if is_done {
            self.percent(100);
        }
    }

    /// The line that the farm's software looks for, once for each value.
    fn percent(&mut self, percent: u64) {
        if self.percent == Some(percent) {
            return;
        }
        self.percent = Some(percent);
        match self.style {
            ProgressStyle::Alf => say::line(format_args!("ALF_PROGRESS {percent}%")),
            ProgressStyle::Tr => say::line(format_args!("TR_PROGRESS {percent}")),
            ProgressStyle::Openjd => say::line(format_args!("openjd_progress: {percent}")),
            ProgressStyle::Deadline => say::line(format_args!("Progress: {percent}%")),
            ProgressStyle::Auto | ProgressStyle::Json | ProgressStyle::None => {}
        }
    }
}

/// `frame 1043/1100 steps 62 cg 1180 wall 41.2s eta 39m rss 18.4G`: stable words, one line a frame.
fn frame_line(report: &FrameReport<'_>, left: f64, resident: Option<u64>) -> String {
    let steps = report.summary.map_or(0, |s| s.steps);
    let iterations = report.summary.map_or(0, |s| s.cg_iterations);
    let memory = resident.map_or(String::new(), |bytes| format!(" rss {}", memory(bytes)));
    let stage = if report.is_preroll { " pre-roll" } else { "" };
    format!(
        "frame {}/{} steps {steps} cg {iterations} wall {:.1}s eta {}{memory}{stage}",
        report.frame,
        report.last_frame,
        report.seconds,
        duration(left)
    )
}

fn frame_json(report: &FrameReport<'_>, left: f64, resident: Option<u64>) -> serde_json::Value {
    json!({
        "record": "frame",
        "frame": report.frame,
        "last_frame": report.last_frame,
        "preroll": report.is_preroll,
        "percent": report.done * 99 / report.total.max(1),
        "steps": report.summary.map(|s| s.steps),
        "cg_iterations": report.summary.map(|s| s.cg_iterations),
        "seconds": report.seconds,
        "seconds_left": left,
        "resident_bytes": resident,
    })
}

/// `42s`, `1m39s`, `39m`, `2h05m`: one form for each length.
pub(crate) fn duration(seconds: f64) -> String {
    let whole = seconds.max(0.0).round() as u64;
    match whole {
        0..60 => format!("{whole}s"),
        60..600 => format!("{}m{:02}s", whole / 60, whole % 60),
        600..3600 => format!("{}m", whole / 60),
        _ => format!("{}h{:02}m", whole / 3600, whole % 3600 / 60),
    }
}

/// `18.4G`, `230M`.
fn memory(bytes: u64) -> String {
    match bytes >> 30 {
        0 => format!("{}M", bytes >> 20),
        _ => format!("{:.1}G", bytes as f64 / f64::from(1 << 30)),
    }
}

fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted.get(sorted.len() / 2).copied().unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_frame_is_one_line_of_stable_words() {
        let report = FrameReport {
            frame: 1043,
            last_frame: 1100,
            is_preroll: false,
            done: 43,
            total: 100,
            seconds: 41.24,
            summary: None,
        };
        let line = frame_line(&report, 2340.0, Some(18_841 << 20));
        assert_eq!(line, "frame 1043/1100 steps 0 cg 0 wall 41.2s eta 39m rss 18.4G");
        // Tractor reads lines that begin with `Frame N (i of n)` as progress; ours must not.
        assert!(!line.starts_with("Frame"));
    }

    #[test]
    fn durations_are_short() {
        assert_eq!([59.6, 99.0, 100.0, 599.0].map(duration), ["1m00s", "1m39s", "1m40s", "9m59s"]);
        assert_eq!([3599.0, 3600.0, 5940.0].map(duration), ["59m", "1h00m", "1h39m"]);
        assert_eq!(duration(42.4), "42s");
        assert_eq!(duration(2340.0), "39m");
        assert_eq!(duration(7500.0), "2h05m");
    }
}
