//! `drapery run`: simulate and write the caches; go on where an earlier attempt stopped.

use std::fs::File;
use std::time::SystemTime;

use drapery_core::metrics::Metrics;
use drapery_io::farm::duration::parse_epoch;
use drapery_io::farm::stop::{Reason, StopRequests};
use drapery_io::shot::quality::{Exceeded, LIMITS};
use drapery_io::shot::run::{FrameReport, Observer, Outcome, RunOptions, RunReport};

use crate::args::{ProgressStyle, RunArgs};
use crate::exit_code::ExitCode;
use crate::failure::Failure;
use crate::log::FolderLogs;
use crate::progress::{Progress, duration};
use crate::{plan, say, signals};

/// Points of time at which a run is to have stopped, from the environment: the variable, and what a stop is then called.
const STOP_TIMES: [(&str, Reason); 2] = [("DRAPERY_STOP_AT", Reason::StopAt), ("SLURM_JOB_END_TIME", Reason::JobEnd)];

/// Runs the shot.
pub(crate) fn run(args: &RunArgs, quiet: bool, logs: &FolderLogs) -> Result<std::process::ExitCode, Failure> {
    let mut watcher = Watcher { progress: None, logs, args, quiet, notes: 0 };
    let outcome = run_shot(args, &mut watcher);
    let Watcher { progress, notes, .. } = watcher;
    let mut progress = progress.unwrap_or_else(|| Progress::new(args.progress, quiet, 0));
    match outcome {
        Ok(report) => {
            let stopped = matches!(report.outcome, Outcome::Stopped(_));
            let verdict = if args.strict && !stopped { limits_kept(&report) } else { Ok(()) };
            let code = match (&verdict, stopped) {
                (Err(failure), _) => failure.code as u8,
                (Ok(()), true) => args.resumable_exit_code,
                (Ok(()), false) => ExitCode::Done as u8,
            };
            let last = last_line(&report, notes);
            tracing::info!(exit_code = code, "{last}");
            if !quiet && !matches!(args.progress, ProgressStyle::Json | ProgressStyle::None) {
                progress.clear();
                if report.outcome != Outcome::NothingToDo {
                    say::line(end_table(&report));
                }
                say::line(last);
            }
            progress.end(code, !stopped);
            verdict.map(|()| code.into())
        }
        Err(failure) => {
            progress.end(failure.code as u8, false);
            tracing::info!(exit_code = failure.code as u8, "failed; when that is mended, continue with: {}", command());
            Err(failure)
        }
    }
}

fn run_shot(args: &RunArgs, watcher: &mut Watcher<'_>) -> Result<RunReport, Failure> {
    // Before anything that takes long: a signal during the checks is a request, too.
    let requests = requests(args)?;
    signals::listen(&requests)?;
    let (shot, threads) = plan::prepare(&args.scene)?;
    watcher.notes += shot.warnings().len();
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
    let options = RunOptions {
        out,
        resume: args.resume,
        overwrite: args.overwrite,
        with_changes: args.resume_with_changes,
        steal_lock: args.steal_lock,
        threads: threads.count,
        checkpoint_every: args.checkpoint_every,
        keep: args.keep.into(),
        pinned: args.pin_checkpoint.clone(),
        requests,
        command: command(),
    };
    watcher.progress = Some(Progress::new(args.progress, watcher.quiet, shot.frame_count()));
    Ok(shot.run(&options, watcher)?)
}

/// The requests to stop that are known from the start.
fn requests(args: &RunArgs) -> Result<StopRequests, Failure> {
    let (requests, now) = (StopRequests::default(), SystemTime::now());
    if let Some(time) = args.max_wall {
        requests.deadline(Reason::MaxWall, now + time, now);
    }
    for (variable, reason) in STOP_TIMES {
        if let Ok(text) = std::env::var(variable) {
            let at =
                parse_epoch(&text).map_err(|e| Failure::new(ExitCode::Usage, format!("{variable}={text}: {e}")))?;
            requests.deadline(reason, at, now);
        }
    }
    Ok(requests)
}

/// The command line that continues this run: without what would start it anew, or was meant for this once.
fn command() -> String {
    let mut arguments = std::env::args().skip(1);
    let mut words = vec!["drapery".to_owned()];
    while let Some(argument) = arguments.next() {
        match argument.as_str() {
            "--overwrite" | "--steal-lock" | "--resume-with-changes" => {}
            "--resume" => drop(arguments.next()),
            _ if argument.starts_with("--resume=") => {}
            _ => words.push(quoted(argument)),
        }
    }
    words.join(" ")
}

/// A word as a shell wants it.
fn quoted(word: String) -> String {
    let plain = |c: char| c.is_alphanumeric() || "-_./=,:+@%".contains(c);
    if !word.is_empty() && word.chars().all(plain) { word } else { format!("'{}'", word.replace('\'', "'\\''")) }
}

/// Frame, time, warnings and what to do next.
fn last_line(report: &RunReport, notes: usize) -> String {
    let warnings = match notes + report.exceeded.len() {
        0 => "no warnings".to_owned(),
        1 => "1 warning".to_owned(),
        many => format!("{many} warnings"),
    };
    let (frame, time) = (report.frame, duration(report.seconds));
    match report.outcome {
        Outcome::Done => format!("done: frame {frame}, {time}, {warnings}"),
        Outcome::NothingToDo => format!("all frames up to {frame} are there already; nothing was done"),
        Outcome::Stopped(reason) => {
            format!("stopped ({reason}): frame {frame}, {time}, {warnings}; continue with: {}", command())
        }
    }
}

/// Hears of everything while the run goes on.
struct Watcher<'a> {
    progress: Option<Progress>,
    logs: &'a FolderLogs,
    args: &'a RunArgs,
    quiet: bool,
    /// Number of warnings.
    notes: usize,
}

impl Observer for Watcher<'_> {
    fn logs(&mut self, files: [File; 2]) {
        self.logs.open(files);
        tracing::info!(scene = %self.args.scene.scene.display(), version = env!("CARGO_PKG_VERSION"), "attempt begins");
    }

    fn resumed(&mut self, frame: i64, done: u64) {
        tracing::info!(frame, done, "goes on from a checkpoint");
        if !self.quiet && self.args.progress == ProgressStyle::Auto {
            say::line(format_args!("going on after frame {frame}"));
        }
    }

    fn note(&mut self, text: String) {
        self.notes += 1;
        tracing::warn!("{text}");
    }

    fn frame(&mut self, report: &FrameReport<'_>) {
        log_frame(report);
        if let Some(progress) = &mut self.progress {
            progress.frame(report);
        }
    }
}

fn log_frame(report: &FrameReport<'_>) {
    let Some(summary) = report.summary else { return };
    let strain = summary.max_strain.as_ref().map(|strain| strain.strain);
    tracing::info!(
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
