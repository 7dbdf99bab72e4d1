//! `drapery diff`: how far two caches, checkpoints or runs are from each other.

use std::fmt::Write;

use drapery_analysis::diff::{self, Comparison, PartComparison, Verdict};

use crate::args::DiffArgs;
use crate::exit_code::ExitCode;
use crate::failure::Failure;
use crate::say;

/// Frames that are listed; the others are summed up.
const LISTED: usize = 20;

/// Compares two results.
pub(crate) fn diff(args: &DiffArgs) -> Result<ExitCode, Failure> {
    let comparison = diff::compare(&args.a, &args.b, args.tolerance)?;
    if args.json {
        // A struct of texts and numbers always has a JSON form; what is not a number becomes null.
        say::line(serde_json::to_string_pretty(&comparison).unwrap_or_default());
    } else {
        say::line(text(&comparison).trim_end());
    }
    Ok(if comparison.verdict == Verdict::Differs { ExitCode::Differences } else { ExitCode::Done })
}

fn text(comparison: &Comparison) -> String {
    let mut text: String = comparison.parts.iter().map(|part| part_text(part, comparison.tolerance)).collect();
    match comparison.parts.len() {
        0 => text += "neither run has a cache\n",
        1 => {}
        count => {
            let _ = writeln!(text, "{count} pairs compared: {}", comparison.verdict.word());
        }
    }
    text
}

fn part_text(part: &PartComparison, tolerance: f64) -> String {
    let mut text = format!("{}\n{}: {}\n", part.a, part.b, part.verdict.word());
    let mut line = |words: String| {
        // Writing into a text cannot fail.
        let _ = writeln!(text, "  {words}");
    };
    part.notes.iter().for_each(|note| line(note.clone()));
    if let Some(worst) = &part.worst {
        let (mesh, vertex, distance) = (&worst.mesh, worst.vertex, worst.distance);
        let frame = at(worst.frame, worst.behind);
        line(format!("largest difference: vertex {vertex} of {mesh} in frame {frame}, {distance:.3e} m"));
        if tolerance > 0.0 {
            line(format!("tolerance: {tolerance:e} m"));
        }
    }
    let differing: Vec<_> = part.frames.iter().filter(|frame| frame.max > 0.0).collect();
    if let Some(first) = differing.first() {
        let (count, all, frame) = (differing.len(), part.frames.len(), at(first.frame, first.behind));
        line(format!("{count} of {all} frames differ, first {frame}"));
        line(format!("{:>8} {:>12} {:>12} {:>9}  mesh", "frame", "max [m]", "rms [m]", "vertex"));
    }
    for frame in differing.iter().take(LISTED) {
        let (max, rms, vertex, mesh) = (frame.max, frame.rms, frame.vertex, &frame.mesh);
        let number = at(frame.frame, frame.behind);
        line(format!("{number:>8} {max:>12.3e} {rms:>12.3e} {vertex:>9}  {mesh}"));
    }
    if differing.len() > LISTED {
        line(format!("and {} more (--json lists all)", differing.len() - LISTED));
    }
    for found in &part.datasets {
        let (name, count, values, max, first) = (&found.name, found.count, found.values, found.max, found.first);
        line(format!("{name}: {count} of {values} values differ, first at {first}, by up to {max:.3e}"));
    }
    text
}

/// A frame, or a sample behind it.
fn at(frame: i64, behind: f64) -> String {
    // As many digits as tell samples apart.
    (((frame as f64 + behind) * 1e6).round() / 1e6).to_string()
}
