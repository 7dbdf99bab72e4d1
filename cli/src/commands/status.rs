//! `drapery status`: how far runs are.

use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use drapery_analysis::report::status::{Process, Status};
use drapery_shot::farm::stale;
use drapery_shot::run_record::folder::with_runs_in;
use drapery_shot::run_record::reader::in_words;
use serde_json::json;

use crate::args::StatusArgs;
use crate::exit_code::ExitCode;
use crate::failure::Failure;
use crate::progress::duration;
use crate::say;

/// Prints how far runs are, without disturbing them. One that cannot be read does not hide the others.
pub(crate) fn status(args: &StatusArgs) -> Result<ExitCode, Failure> {
    let now = SystemTime::now();
    let mut unreadable: Option<Failure> = None;
    let folders: Vec<PathBuf> = args.folders.iter().flat_map(|folder| with_runs_in(folder)).collect();
    for (number, folder) in folders.iter().enumerate() {
        match Status::of(folder, now) {
            // A struct of texts and numbers always has a JSON form.
            Ok(status) if args.json => say::line(serde_json::to_string(&status).unwrap_or_default()),
            Ok(status) => {
                let gap = if number > 0 { "\n" } else { "" };
                say::line(format_args!("{gap}{}", text(&status, folder, folders.len() > 1).trim_end()));
            }
            Err(error) => {
                if args.json {
                    let (folder, error) = (folder.display().to_string(), error.to_string());
                    say::line(json!({ "folder": folder, "state": "unreadable", "error": error }));
                }
                if let Some(earlier) = unreadable.replace(error.into()) {
                    earlier.report();
                }
            }
        }
    }
    unreadable.map_or(Ok(ExitCode::Done), Err)
}

/// The lines about a run; `named` adds its folder, since runs of one scene have the same name.
fn text(status: &Status, folder: &Path, named: bool) -> String {
    let mut text = format!("{}: {}\n", status.shot, state(status));
    let mut line = |name: &str, value: String| {
        // Writing into a text cannot fail.
        let _ = writeln!(text, "  {name:<12} {value}");
    };
    if named {
        line("folder", status.folder.clone());
    }
    line("frames", frames(status));
    if let Some(rate) = status.seconds_per_frame {
        line("rate", format!("{} per frame (median of the last 10)", seconds(rate)));
    }
    if let (Some(left), true) = (status.seconds_left, status.state != "done") {
        let eta = status.eta.as_ref().map(|eta| format!(", until {eta}")).unwrap_or_default();
        line("time left", format!("{} at this rate{eta}", duration(left)));
    }
    if let Some(checkpoint) = &status.checkpoint {
        let steps = if checkpoint.sub_step == 0 { String::new() } else { format!(" + {} steps", checkpoint.sub_step) };
        line("checkpoint", format!("frame {}{steps}, {}", checkpoint.frame, checkpoint.file));
    }
    if let Some(process) = &status.process {
        let ranks = if status.ranks > 1 { format!(", rank 0 of {}", status.ranks) } else { String::new() };
        line("process", process_text(process) + &ranks);
    }
    let total = status.degradations.iter().fold(0, |sum: u64, found| sum.saturating_add(found.total));
    line("degradations", if total == 0 { "none".to_owned() } else { total.to_string() });
    for found in &status.degradations {
        let (name, meaning) = (found.name, found.meaning);
        let (count, first, worst) = (found.total, found.first_frame, found.worst_frame);
        line("", format!("{name} {count}, first in frame {first}, worst in frame {worst}: {meaning}"));
    }
    if status.steps_tried_again > 0 {
        line("retries", format!("{} of failed collision steps", status.steps_tried_again));
    }
    if !status.uncounted.is_empty() {
        line("", format!("{}: counts unknown, run.jsonl is incomplete", in_words(&status.uncounted)));
    }
    if let Some(stale) = &status.stale {
        let attempts =
            if stale.attempts == 1 { "1 attempt".to_owned() } else { format!("{} attempts", stale.attempts) };
        let folder = folder.join(stale::FOLDER);
        let size = stale.bytes as f64 / 1e6;
        line("stale", format!("{attempts}, {size:.1} MB; delete {} when the shot is accepted", folder.display()));
    }
    if let Some(error) = &status.error {
        line("error", error.replace('\n', "\n               "));
    }
    if let (Some(command), true) = (&status.command, status.state != "done") {
        line("continue", command.clone());
    }
    text
}

fn state(status: &Status) -> String {
    match (status.state.as_str(), &status.end) {
        ("killed", _) => {
            "killed (its process ended without a message); run the same command again to resume".to_owned()
        }
        ("silent", _) => "running, or dead: no heartbeat for minutes".to_owned(),
        ("stopped", Some(reason)) => format!("stopped ({reason})"),
        (state, _) => state.to_owned(),
    }
}

fn frames(status: &Status) -> String {
    let Status { frames_done, frames_total, first_frame, last_frame, .. } = status;
    let percent = 100 * frames_done / (*frames_total).max(1);
    let last = match (status.last_complete_frame, status.reached_frame) {
        (Some(frame), _) => format!("last complete {frame}"),
        (None, Some(reached)) if reached < *first_frame => format!("in the pre-roll at frame {reached}"),
        (None, _) => "none yet".to_owned(),
    };
    format!("{frames_done} of {frames_total} ({percent} %), {last}, range {first_frame}-{last_frame}")
}

fn process_text(process: &Process) -> String {
    let host = process.host.as_deref().unwrap_or("unknown");
    let pid = process.pid.map_or("unknown".to_owned(), |pid| pid.to_string());
    format!("{pid} on {host}, {}, last heartbeat {} ago", process.presence, duration(process.heartbeat_seconds as f64))
}

/// Seconds with three digits.
fn seconds(value: f64) -> String {
    match value {
        v if v < 0.1 => format!("{:.1} ms", v * 1e3),
        v if v < 100.0 => format!("{v:.2} s"),
        v => duration(v),
    }
}
