//! `drapery wedge`: every combination of some settings, each run by a process of its own, and a page with all of them.

use std::ffi::OsString;
use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant, SystemTime};

use drapery_analysis::comparison::{self, Comparison};
use drapery_analysis::report;
use drapery_analysis::wedge::{self, WedgeRun};
use drapery_core::parallel::ranks::Ranks;
use drapery_io::error::IoError;
use drapery_io::scene_file;
use drapery_shot::farm::command_line::quoted;
use drapery_shot::farm::stop::{Reason, Request, StopRequests, request_stop};

use crate::args::WedgeArgs;
use crate::config::Environment;
use crate::exit_code::ExitCode;
use crate::failure::Failure;
use crate::signals::Unasked;
use crate::{plan, say, signals};

/// Folder of the logs of the runs, in that of the wedge.
const LOGS: &str = "logs";

/// Time between two looks at the runs.
const LOOK_EVERY: Duration = Duration::from_millis(200);

/// Time between two requests to the runs to stop: one that is still being prepared does not see the first.
const ASK_EVERY: Duration = Duration::from_secs(1);

/// Shortest time limit that is worth a start of a run.
const LEAST_TIME: Duration = Duration::from_secs(1);

/// Runs what is not done yet, and writes the page.
pub(crate) fn wedge(args: &WedgeArgs, ranks: &Ranks, around: &Environment, quiet: bool) -> Result<ExitCode, Failure> {
    if !ranks.is_alone() {
        let text = "a wedge starts its own processes\n  help: start it without mpirun, or run the commands of --list under mpirun";
        return Err(Failure::new(ExitCode::Usage, text));
    }
    let runs = runs(args)?;
    check(args, around, &runs)?;
    let scene = &args.scene.scene;
    let name = scene.file_stem().map_or_else(|| "scene".into(), |stem| stem.to_string_lossy().into_owned());
    let out = args.out.clone().unwrap_or_else(|| PathBuf::from("out").join(format!("{name}_wedge")));
    if args.list {
        // The host that runs them has its own number of cores.
        let threads = args.scene.threads.map(usize::from);
        for run in &runs {
            let words = run_words(args, run, &out, threads);
            let words: Vec<String> = words.iter().map(|word| quoted(word)).collect();
            say::line(format_args!("drapery {}", words.join(" ")));
        }
        return Ok(ExitCode::Done);
    }
    let Some(program) = &args.program else {
        return Err(Failure::new(
            ExitCode::Usage,
            "no file starts this program, so it cannot start runs\n  help: use --list",
        ));
    };
    let logs = out.join(LOGS);
    fs::create_dir_all(&logs).map_err(|error| IoError::writing(&logs, error))?;
    let words: Vec<String> = args.words.iter().skip(1).map(|word| quoted(word)).collect();
    let command = format!("drapery {}", words.join(" "));
    let requests = StopRequests::default();
    let unasked = Unasked { code: ExitCode::Stopped as u8, by_term: false, command: command.clone() };
    signals::listen(&requests, &unasked)?;
    let threads = threads(args, around)?;
    let (failed, refused, stopped) = (0, Vec::new(), None);
    let mut running = Wedge { args, program, out: &out, threads, requests: &requests, quiet, failed, refused, stopped };
    running.all(&runs)?;
    let Wedge { failed, refused, stopped, .. } = running;
    requests.finish();
    let compared = Comparison::of_wedge(&out, &runs, &refused)?;
    let pages = compared.write(&out.join(comparison::PAGE))?;
    if !quiet {
        say::line(compared.table().trim_end());
        pages.iter().for_each(|page| say::line(format_args!("wrote {}", page.display())));
    }
    match (stopped, failed) {
        (Some(reason), _) => {
            say::line(format_args!("stopped ({reason}); continue with: {command}"));
            Ok(ExitCode::Stopped)
        }
        (None, 0) => Ok(ExitCode::Done),
        (None, _) => Ok(ExitCode::Differences),
    }
}

/// The runs, if they are not too many.
fn runs(args: &WedgeArgs) -> Result<Vec<WedgeRun>, Failure> {
    let count = wedge::count(&args.vary);
    if count > args.most {
        let text = format!(
            "this wedge has {count} runs, more than {}\n  help: vary less, or allow them with --most {count}",
            args.most
        );
        return Err(Failure::new(ExitCode::Usage, text));
    }
    let set = args.scene.settings.iter().map(|(key, _)| key);
    if let Some(key) = set.into_iter().find(|key| args.vary.iter().any(|(varied, _)| varied == *key)) {
        let text =
            format!("{key}: set with --set and varied with --vary\n  help: leave one out; --vary has all its values");
        return Err(Failure::new(ExitCode::Usage, text));
    }
    wedge::runs(&args.vary).map_err(|text| Failure::new(ExitCode::Usage, text))
}

/// Reads the scene with the settings of each run, so that a value, a setting that its integrator does not have, or a range of frames is
/// named before anything runs.
fn check(args: &WedgeArgs, around: &Environment, runs: &[WedgeRun]) -> Result<(), Failure> {
    let (common, search) = (plan::settings(&args.scene)?, around.search(&args.scene.materials).value);
    for run in runs {
        let settings = [&common[..], &run.settings].concat();
        let in_run = |failure: Failure| failure.in_run(&run.name);
        let scene =
            scene_file::load_with(&args.scene.scene, &settings, &search).map_err(|error| in_run(error.into()))?;
        let shot = scene.resolve().map_err(|errors| in_run(errors.into()))?;
        let frames = args.scene.frames.map(|frames| [frames.first, frames.last]);
        drapery_shot::check_description(&shot).map_err(|error| in_run(error.into()))?;
        drapery_shot::last_frame(shot.frames, frames).map_err(|error| in_run(error.into()))?;
    }
    Ok(())
}

/// Threads of each run: those that are asked for, or a share of all.
fn threads(args: &WedgeArgs, around: &Environment) -> Result<usize, Failure> {
    let all = match around.threads(args.scene.threads) {
        Some(asked) => asked.value,
        None => std::thread::available_parallelism()
            .map_err(|error| Failure::refused("cores cannot be counted", &error))?
            .get(),
    };
    Ok((all / usize::from(args.jobs)).max(1))
}

/// Words of the command of a run behind the name of the program; without threads it takes those of its host.
fn run_words(args: &WedgeArgs, run: &WedgeRun, out: &Path, threads: Option<usize>) -> Vec<OsString> {
    let scene = &args.scene;
    let mut words: Vec<OsString> = Vec::new();
    let mut add = |name: &str, value: OsString| words.extend([name.into(), value]);
    if let Some(config) = &args.config {
        add("--config", config.into());
    }
    add("run", scene.scene.clone().into());
    if let Some(frames) = scene.frames {
        add("--frames", format!("{}-{}", frames.first, frames.last).into());
    }
    if let Some(preset) = &scene.preset {
        add("--preset", preset.into());
    }
    for (key, value) in scene.settings.iter().chain(&run.settings) {
        add("--set", format!("{key}={value}").into());
    }
    for (name, effects) in [("--without", &scene.without), ("--only", &scene.only)] {
        if !effects.is_empty() {
            add(name, effects.join(",").into());
        }
    }
    if let Some(folders) = &scene.materials.materials {
        add("--materials", folders.clone());
    }
    if let Some(threads) = threads {
        add("--threads", threads.to_string().into());
    }
    add("--out", out.join(&run.name).into());
    words
}

/// Runs in progress.
struct Wedge<'a> {
    args: &'a WedgeArgs,
    program: &'a Path,
    out: &'a Path,
    threads: usize,
    requests: &'a StopRequests,
    quiet: bool,
    /// Number of runs that ended with an error.
    failed: usize,
    /// Names of those whose folders hold something else, such as a run of another scene.
    refused: Vec<String>,
    /// Why not all was run.
    stopped: Option<Reason>,
}

/// A run in progress.
struct Job<'a> {
    run: &'a WedgeRun,
    number: usize,
    child: Child,
    began: Instant,
}

impl Wedge<'_> {
    /// Starts the runs one after the other, some at a time, and waits for all.
    fn all(&mut self, runs: &[WedgeRun]) -> Result<(), Failure> {
        let limit = self.args.max_wall.map(|time| Instant::now() + time);
        let mut waiting = runs.iter().enumerate().peekable();
        let mut jobs: Vec<Job<'_>> = Vec::new();
        let mut asked: Option<Instant> = None;
        loop {
            while jobs.len() < self.args.jobs.into() && self.stopped.is_none() {
                let left = limit.map(|limit| limit.saturating_duration_since(Instant::now()));
                if waiting.peek().is_some() && left.is_some_and(|left| left < LEAST_TIME) {
                    self.stopped = Some(Reason::MaxWall);
                    break;
                }
                let Some((index, run)) = waiting.next() else { break };
                self.say(format_args!("run {} of {}: {}", index + 1, runs.len(), run.name));
                jobs.push(Job { run, number: index + 1, child: self.start(run, left)?, began: Instant::now() });
            }
            if jobs.is_empty() {
                return Ok(());
            }
            std::thread::sleep(LOOK_EVERY);
            match self.requests.poll(SystemTime::now()) {
                Some(Request::Stop(reason)) => {
                    self.stopped = Some(reason);
                    if asked.is_none_or(|asked| asked.elapsed() > ASK_EVERY) {
                        asked = Some(Instant::now());
                        for job in &jobs {
                            // One that has no folder yet is asked again.
                            let _ = request_stop(&self.out.join(&job.run.name), SystemTime::now());
                        }
                    }
                }
                Some(Request::StopAtOnce(reason)) => {
                    self.stopped = Some(reason);
                    // Files stay as they were at the last checkpoint. One that has just ended cannot be killed.
                    jobs.iter_mut().for_each(|job| drop(job.child.kill()));
                }
                _ => {}
            }
            let mut still = Vec::new();
            for mut job in jobs {
                match job.child.try_wait().map_err(|error| Failure::refused("a run cannot be waited for", &error))? {
                    Some(status) => self.ended(&job, status, runs.len()),
                    None => still.push(job),
                }
            }
            jobs = still;
        }
    }

    /// Starts a run, with what it prints in a file.
    fn start(&self, run: &WedgeRun, left: Option<Duration>) -> Result<Child, Failure> {
        let path = self.log(run);
        let log = File::create(&path).map_err(|error| IoError::writing(&path, error))?;
        let errors = log.try_clone().map_err(|error| IoError::writing(&path, error))?;
        let mut command = Command::new(self.program);
        command.args(run_words(self.args, run, self.out, Some(self.threads)));
        if let Some(left) = left {
            command.arg("--max-wall").arg(format!("{}s", left.as_secs().max(1)));
        }
        command.stdin(Stdio::null()).stdout(log).stderr(errors);
        command.spawn().map_err(|error| Failure::refused("a run cannot be started", &error))
    }

    fn log(&self, run: &WedgeRun) -> PathBuf {
        self.out.join(LOGS).join(format!("{}.txt", run.name))
    }

    fn ended(&mut self, job: &Job<'_>, status: ExitStatus, count: usize) {
        let Job { run, number, began, .. } = job;
        let time = crate::progress::duration(began.elapsed().as_secs_f64());
        match status.code() {
            Some(0) => self.say(format_args!("run {number} of {count}: done in {time}")),
            Some(code) if code == i32::from(ExitCode::Stopped as u8) => {
                self.stopped.get_or_insert(Reason::MaxWall);
                self.say(format_args!("run {number} of {count}: stopped at a checkpoint"));
            }
            _ if self.stopped.is_some() => {}
            code => {
                self.failed += 1;
                if code == Some(i32::from(ExitCode::CannotCreate as u8)) {
                    self.refused.push(run.name.clone());
                }
                let log = self.log(run);
                say::complaint(format_args!(
                    "run {number} of {count}: {} failed ({status}); see {}",
                    run.name,
                    log.display()
                ));
            }
        }
        // A run that has written nothing has no page.
        let _ = report::write(&self.out.join(&run.name));
    }

    fn say(&self, text: std::fmt::Arguments<'_>) {
        if !self.quiet {
            say::line(text);
            say::warn_of_loss();
        }
    }
}
