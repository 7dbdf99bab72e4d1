//! `drapery run`: simulate and write the caches; go on where an earlier attempt stopped.

use std::fs::File;
use std::path::Path;
use std::time::SystemTime;

use drapery_core::metrics::Metrics;
use drapery_core::parallel::ranks::Ranks;
use drapery_shot::farm::command_line::quoted;
use drapery_shot::farm::stop::{Reason, Signal, StopRequests};
use drapery_shot::quality::{self, Exceeded, INEXACT, LIMITS};
use drapery_shot::run::{Bundle, DUMPS, FrameReport, Observer, Outcome, RunOptions, RunReport};
use drapery_shot::run_record::reader::in_words;
use drapery_shot::run_record::strains::BeyondFabric;

use crate::args::{OnTerm, ProgressStyle, RunArgs, SceneArgs};
use crate::config::{Environment, RunSettings};
use crate::exit_code::ExitCode;
use crate::failure::Failure;
use crate::log::{self, FolderLogs};
use crate::progress::{Progress, duration};
use crate::ranks::{self, launcher};
use crate::signals::Unasked;
use crate::{Ended, plan, say, signals};

/// Goes on from the last good state of a run that has given up.
fn replay(args: &RunArgs, ranks: &Ranks, around: &Environment) -> Result<Ended, Failure> {
    let bundle = Bundle::read(&args.scene.scene)?;
    let scene = SceneArgs { scene: bundle.scene.clone(), ..args.scene.clone() };
    let (shot, _) = plan::prepare(&scene, around, ranks)?;
    say::line(format_args!("the run ended with: {}", bundle.error));
    let folder = args.settings.out.as_deref().or(args.scene.scene.parent()).unwrap_or(Path::new("")).join(DUMPS);
    let note = &mut |text| say::line(format_args!("{text}"));
    let summary = shot.replay(&bundle, &args.dump, &folder, note)?;
    let mut exceeded = Vec::new();
    quality::watch(&mut exceeded, summary.frame, |name| summary.metrics.counted(name));
    exceeded.iter().map(quality::first_rise).for_each(|text| tracing::warn!("{text}"));
    say::line(format_args!("frame {} reached, in {} steps", summary.frame, summary.steps));
    if args.strict {
        limits_kept("the frame was reached", &exceeded, &[])?;
    }
    Ok(ExitCode::Done.into())
}

/// Runs the shot.
pub(crate) fn run(
    args: &RunArgs,
    ranks: &Ranks,
    around: Result<Environment, Failure>,
    (quiet, verbose): (bool, bool),
    logs: &FolderLogs,
) -> Result<Ended, Failure> {
    if args.replay {
        return replay(args, ranks, &around?);
    }
    let chosen = around.and_then(|around| Ok((RunSettings::choose(&args.settings, &around)?, around)));
    let (settings, around) = chosen.inspect_err(|failure| {
        let style = args.settings.progress.unwrap_or(ProgressStyle::Auto);
        Progress::new(style, quiet, 0).end(failure.code as u8, false, Some(failure));
    })?;
    let (style, requests) = (settings.progress.value, settings.requests());
    let (progress, notice_is_given) = (None, false);
    let mut watcher = Watcher { progress, logs, args, style, requests: &requests, notice_is_given, quiet };
    let outcome = run_shot(args, ranks, (&settings, &around), &mut watcher);
    let mut progress = watcher.progress.unwrap_or_else(|| Progress::new(style, quiet, 0));
    match outcome {
        Ok(report) => {
            let stopped = matches!(report.outcome, Outcome::Stopped(_));
            let verdict = match args.strict && !stopped {
                true => limits_kept("all frames are written", &report.exceeded, &report.uncounted),
                false => Ok(()),
            };
            let by_term = settings.on_term.value == OnTerm::Signal
                && report.outcome == Outcome::Stopped(Reason::Signal(Signal::Terminate));
            let code = match (&verdict, stopped) {
                (Err(failure), _) => failure.code as u8,
                (Ok(()), true) if by_term => signals::ENDED_BY_TERM,
                (Ok(()), true) => settings.resumable_exit_code.value,
                (Ok(()), false) => ExitCode::Done as u8,
            };
            let last = last_line(args, &report, ranks.count());
            if let Err(failure) = &verdict {
                tracing::error!(target: log::OF_FILES, exit_code = code, "{failure}");
            }
            tracing::info!(exit_code = code, "{last}");
            if !quiet && !matches!(style, ProgressStyle::Json | ProgressStyle::None) {
                progress.clear();
                if report.outcome != Outcome::NothingToDo {
                    say::line(end_table(&report, verbose));
                }
                say::line(last);
            }
            progress.end(code, !stopped, verdict.as_ref().err());
            verdict.map(|()| Ended { code, by_term })
        }
        Err(failure) => {
            progress.end(failure.code as u8, false, Some(&failure));
            // The word of standard error comes from the end of the command.
            let (exit_code, text) = (failure.code as u8, failure.to_string());
            tracing::error!(target: log::OF_FILES, exit_code, "{text}");
            let (cause, command) = (text.lines().next().unwrap_or_default(), command(args, ranks.count()));
            tracing::info!(exit_code, "failed: {cause}; once the cause is fixed, continue with: {command}");
            Err(failure)
        }
    }
}

fn run_shot(
    args: &RunArgs,
    ranks: &Ranks,
    (settings, around): (&RunSettings, &Environment),
    watcher: &mut Watcher<'_>,
) -> Result<RunReport, Failure> {
    // Before anything that takes long: a signal during the checks is a request, too.
    let by_term = settings.on_term.value == OnTerm::Signal;
    let unasked = Unasked { code: settings.resumable_exit_code.value, by_term, command: command(args, ranks.count()) };
    signals::listen(watcher.requests, &unasked)?;
    let (shot, (threads, of_ranks)) = plan::prepare(&args.scene, around, ranks)?;
    let out = args.settings.out.clone().unwrap_or_else(|| plan::default_folder(&shot));
    let [first, last] = shot.frames();
    tracing::info!(
        shot = shot.name(),
        first,
        last,
        threads = threads.value,
        threads_from = threads.source,
        ranks = ranks.count(),
        threads_of_ranks = (!ranks.is_alone()).then(|| tracing::field::debug(of_ranks)),
        out = %out.display(),
        site_file = around.site_path.as_ref().map(|path| tracing::field::display(path.value.display())),
        "run"
    );
    let options = RunOptions {
        out,
        resume: args.resume,
        overwrite: args.overwrite,
        with_changes: args.resume_with_changes,
        steal_lock: args.steal_lock,
        threads: threads.value,
        checkpoint_every: settings.checkpoint_every.value,
        keep: settings.keep.value.into(),
        pinned: args.pin_checkpoint.clone(),
        requests: watcher.requests.clone(),
        command: from_anywhere(&command(args, ranks.count())),
        dump: args.dump.clone(),
    };
    watcher.progress = Some(Progress::new(watcher.style, watcher.quiet, shot.frame_count()));
    ranks::writes_into(&options.out);
    Ok(shot.run(&options, watcher)?)
}

/// The command line that continues this run: without what would start it anew, or was meant for this once.
fn command(args: &RunArgs, ranks: usize) -> String {
    let mut arguments = args.words.iter().skip(1);
    let mut words = vec![launcher(ranks) + "drapery"];
    while let Some(argument) = arguments.next() {
        match argument.to_str() {
            Some("--overwrite" | "--steal-lock" | "--resume-with-changes") => {}
            Some("--resume") => _ = arguments.next(),
            Some(word) if word.starts_with("--resume=") => {}
            _ => words.push(quoted(argument)),
        }
    }
    words.join(" ")
}

/// A command line that does the same in every folder.
fn from_anywhere(command: &str) -> String {
    let here = std::env::current_dir();
    here.map_or_else(|_| command.to_owned(), |folder| format!("cd {} && {command}", quoted(folder.as_os_str())))
}

/// Frame, time, warnings and what to do next.
fn last_line(args: &RunArgs, report: &RunReport, ranks: usize) -> String {
    let warnings = match log::warnings() {
        0 => "no warnings".to_owned(),
        1 => "1 warning".to_owned(),
        many => format!("{many} warnings"),
    };
    let (frame, time) = (report.frame, duration(report.seconds));
    match report.outcome {
        Outcome::Done => format!("done: frame {frame}, {time}, {warnings}"),
        Outcome::NothingToDo => format!("nothing to do, all frames up to {frame} exist already; {warnings}"),
        Outcome::Stopped(reason) => {
            format!("stopped ({reason}): frame {frame}, {time}, {warnings}; continue with: {}", command(args, ranks))
        }
    }
}

/// Hears of everything while the run goes on.
struct Watcher<'a> {
    progress: Option<Progress>,
    logs: &'a FolderLogs,
    args: &'a RunArgs,
    style: ProgressStyle,
    requests: &'a StopRequests,
    /// Whether it was said how much notice checkpoints need.
    notice_is_given: bool,
    quiet: bool,
}

impl Watcher<'_> {
    /// Says how much time there is before the run has to end: at the start, and once a checkpoint was measured.
    fn report_notice(&mut self, at_start: bool) {
        let notice = self.requests.notice(SystemTime::now());
        let Some(notice) = notice.filter(|notice| at_start || (notice.knows_checkpoints && !self.notice_is_given))
        else {
            return;
        };
        self.notice_is_given = !at_start;
        let (reason, needed, left) = (notice.reason.word(), notice.needed.ceil(), notice.left.floor());
        let how = if notice.knows_checkpoints { "measured" } else { "estimated" };
        tracing::info!(limit = reason, "a stop needs about {needed} s ({how}), {left} s are left");
    }
}

impl Observer for Watcher<'_> {
    fn logs(&mut self, files: [File; 2]) {
        self.logs.open(files);
        tracing::info!(scene = %self.args.scene.scene.display(), version = env!("CARGO_PKG_VERSION"), "attempt begins");
        self.report_notice(true);
    }

    fn resumed(&mut self, frame: i64, done: u64) {
        tracing::info!(frame, done, "resumes from a checkpoint");
        if !self.quiet && self.style == ProgressStyle::Auto {
            say::line(format_args!("resuming after frame {frame}"));
        }
    }

    fn note(&mut self, text: String) {
        tracing::warn!("{text}");
    }

    fn accepted(&mut self, text: String) {
        tracing::info!("{text}");
        if !self.quiet && self.style == ProgressStyle::Auto {
            say::line(text);
        }
    }

    fn dumped(&mut self, text: String) {
        tracing::info!("{text}");
        if !self.quiet && !matches!(self.style, ProgressStyle::Json | ProgressStyle::None) {
            self.progress.iter_mut().for_each(Progress::clear);
            say::line(text);
        }
    }

    fn underway(&mut self, frame: i64, states: u64, share: f64) {
        tracing::info!(frame, states, share, "underway");
        if let Some(progress) = &mut self.progress {
            progress.underway(frame, states, share);
        }
    }

    fn frame(&mut self, report: &FrameReport<'_>) {
        log_frame(report);
        self.report_notice(false);
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

/// Refuses a run in which a count rose that should stay zero, or in which nobody knows. The caches are complete all the same.
fn limits_kept(done: &str, exceeded: &[Exceeded], uncounted: &[[i64; 2]]) -> Result<(), Failure> {
    if exceeded.is_empty() && uncounted.is_empty() {
        return Ok(());
    }
    let line = |limit: &Exceeded| {
        let Exceeded { name, meaning, total, first_frame } = limit;
        format!("\n  {name} {total}, first in frame {first_frame}: {meaning}")
    };
    let mut lines: String = exceeded.iter().map(line).collect();
    if !uncounted.is_empty() {
        lines += &format!("\n  {}: counts unknown", in_words(uncounted));
    }
    let what = if exceeded.is_empty() {
        "it is unknown whether quality limits are exceeded"
    } else {
        "quality limits are exceeded"
    };
    let text =
        format!("{done}, but {what}{lines}\n  help: check these frames; without --strict this run would end with 0");
    Err(Failure::new(ExitCode::QualityLimits, text))
}

/// Summary of a run: limits, caches, and the file to open; with `is_long` also the seconds of stages and all counts.
fn end_table(report: &RunReport, is_long: bool) -> String {
    let mut text = if is_long { stages_and_counts(report) } else { limits(&report.metrics) };
    text += &report.beyond_fabric.iter().map(beyond_fabric).collect::<String>();
    let on = if report.ranks > 1 { format!(" on {} ranks", report.ranks) } else { String::new() };
    text += &format!("{} frames in {}{on}\n", report.frames, duration(report.seconds));
    let files = report.files.iter().map(|file| format!("wrote {}", file.display()));
    let layers =
        report.layers.iter().map(|file| format!("wrote {} (open this file: it has all garments)", file.display()));
    text + &files.chain(layers).collect::<Vec<_>>().join("\n")
}

/// A garment that was stretched more than its fabric takes.
fn beyond_fabric(BeyondFabric { garment, fabric, p99_9 }: &BeyondFabric) -> String {
    let percent = |strain: f64| format!("{:.1} %", 100.0 * strain);
    let (most, limit) = (percent(p99_9.strain), percent(fabric.strain_limit));
    let edges = format!("of the edges of \"{garment}\", in frame {}", p99_9.frame);
    format!("{:<28} {most:>10}  99.9th percentile {edges}; {} takes {limit}\n", "strain beyond the fabric", fabric.name)
}

/// Counts that should stay zero: in a line those that did, and each that did not. Then what is not exact.
fn limits(metrics: &Metrics) -> String {
    let counted = |name: &str| metrics.counts().iter().find(|(known, _)| known == name).map(|(_, amount)| *amount);
    let watched = LIMITS.iter().filter_map(|(name, _)| Some((*name, counted(name)?)));
    let (kept, exceeded): (Vec<_>, Vec<_>) = watched.partition(|(_, amount)| *amount == 0);
    let mut text: String = exceeded.iter().map(|(name, amount)| format!("{name:<28} {amount:>10}\n")).collect();
    if !kept.is_empty() {
        let names: Vec<&str> = kept.iter().map(|(name, _)| *name).collect();
        text += &format!("{:<28} {:>10}\n", names.join(", "), 0);
    }
    let inexact = INEXACT.iter().filter_map(|(name, meaning)| Some((name, counted(name)?, meaning)));
    let lines = inexact.filter(|(_, amount, _)| *amount > 0);
    text + &lines.map(|(name, amount, meaning)| format!("{name:<28} {amount:>10}  {meaning}\n")).collect::<String>()
}

/// Seconds of stages (mean, least and most over ranks), and all counts.
fn stages_and_counts(report: &RunReport) -> String {
    let mut text = format!("{:<28} {:>10} {:>7} {:>9}", "stage", "seconds", "share", "calls");
    if report.ranks > 1 {
        text += &format!(" {:>10} {:>10}", "min", "max");
    }
    text += "\n";
    for stage in report.metrics.stages() {
        let share = 100.0 * stage.seconds / report.seconds.max(f64::MIN_POSITIVE);
        text += &format!("{:<28} {:>10.3} {share:>6.1}% {:>9}", stage.name, stage.seconds, stage.calls);
        if let Some([least, most]) = stage.spread {
            text += &format!(" {least:>10.3} {most:>10.3}");
        }
        text += "\n";
    }
    text + &counts(&report.metrics)
}

fn counts(metrics: &Metrics) -> String {
    // That limits were watched and kept is worth a line; other counts without events are not.
    let is_limit = |name: &str| LIMITS.iter().any(|(limit, _)| *limit == name);
    let counted = metrics.counts().iter().filter(|(name, amount)| *amount > 0 || is_limit(name));
    counted.map(|(name, amount)| format!("{name:<28} {amount:>10}\n")).collect()
}
