//! `drapery run`: simulate and write the caches.

use drapery_core::metrics::Metrics;
use drapery_io::shot::quality::{Exceeded, LIMITS};
use drapery_io::shot::{FrameReport, RunOptions, RunReport};

use crate::args::{ProgressStyle, RunArgs};
use crate::exit_code::ExitCode;
use crate::failure::Failure;
use crate::plan;
use crate::progress::{Progress, duration};
use crate::say;

/// Runs the shot.
pub(crate) fn run(args: &RunArgs, quiet: bool) -> Result<ExitCode, Failure> {
    let mut progress = None;
    let outcome = run_shot(args, quiet, &mut progress);
    let mut progress = progress.unwrap_or_else(|| Progress::new(args.progress, quiet, 0));
    match outcome {
        Ok(report) => {
            let words = !quiet && !matches!(args.progress, ProgressStyle::Json | ProgressStyle::None);
            if words {
                progress.clear();
                say::line(end_table(&report));
            }
            let verdict = if args.strict { limits_kept(&report) } else { Ok(()) };
            progress.end(verdict.as_ref().map_or_else(|failure| failure.code, |()| ExitCode::Done) as u8);
            verdict.map(|()| ExitCode::Done)
        }
        Err(failure) => {
            progress.end(failure.code as u8);
            Err(failure)
        }
    }
}

fn run_shot(args: &RunArgs, quiet: bool, progress: &mut Option<Progress>) -> Result<RunReport, Failure> {
    let (shot, threads) = plan::prepare(&args.scene)?;
    let out = args.out.clone().unwrap_or_else(|| plan::default_folder(&shot));
    let [first, last] = shot.frames();
    tracing::info!(
        shot = shot.name(),
        first,
        last,
        threads = threads.count,
        threads_from = threads.source,
        out = %out.display(),
        "run"
    );
    let options = RunOptions { out, overwrite: args.overwrite, threads: threads.count };
    let progress = progress.insert(Progress::new(args.progress, quiet, shot.frame_count()));
    let report = shot.run(&options, &mut |frame| {
        log_frame(frame);
        progress.frame(frame);
    })?;
    Ok(report)
}

fn log_frame(report: &FrameReport<'_>) {
    let Some(summary) = report.summary else { return };
    let strain = summary.max_strain.as_ref().map(|strain| strain.strain);
    tracing::debug!(
        frame = report.frame,
        seconds = report.seconds,
        steps = summary.steps,
        cg_iterations = summary.cg_iterations,
        max_strain = strain,
        "frame"
    );
}

/// Refuses a run in which a count rose that should stay zero. The caches are complete all the same.
fn limits_kept(report: &RunReport) -> Result<(), Failure> {
    if report.exceeded.is_empty() {
        return Ok(());
    }
    let line = |limit: &Exceeded| {
        let Exceeded { name, meaning, total, first_frame } = limit;
        format!("\n  {name} {total}, first in frame {first_frame}: {meaning}")
    };
    let lines: String = report.exceeded.iter().map(line).collect();
    let text = format!(
        "all frames are written, but quality limits are exceeded{lines}\n  \
         help: look at these frames; without --strict such a run counts as done"
    );
    Err(Failure::new(ExitCode::QualityLimits, text))
}

/// Where the time went, what was counted, and where the caches are.
fn end_table(report: &RunReport) -> String {
    let mut text = format!("{:<28} {:>10} {:>7} {:>9}\n", "stage", "seconds", "share", "calls");
    for stage in report.metrics.stages() {
        let share = 100.0 * stage.seconds / report.seconds.max(f64::MIN_POSITIVE);
        text += &format!("{:<28} {:>10.3} {share:>6.1}% {:>9}\n", stage.name, stage.seconds, stage.calls);
    }
    text += &counts(&report.metrics);
    text += &format!("{} frames in {}\n", report.frames, duration(report.seconds));
    let files: Vec<String> = report.files.iter().map(|file| format!("wrote {}", file.display())).collect();
    text + &files.join("\n")
}

fn counts(metrics: &Metrics) -> String {
    // That limits were watched and kept is worth a line; other counts without events are not.
    let is_limit = |name: &str| LIMITS.iter().any(|(limit, _)| *limit == name);
    let counted = metrics.counts().iter().filter(|(name, amount)| *amount > 0 || is_limit(name));
    counted.map(|(name, amount)| format!("{name:<28} {amount:>10}\n")).collect()
}
