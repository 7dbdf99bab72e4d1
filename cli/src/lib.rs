//! `drapery`, the command: what was typed, what will be done, what came of it. A library, so that whatever starts the command, the
//! program `drapery` or `python -m drapery`, does the same.
//!
//! ```
//! // What `drapery materials` prints; the process would end with this code.
//! let words = ["drapery", "materials"].map(Into::into).to_vec();
//! assert_eq!(drapery_command::command(&drapery_command::Invocation { words, program: None }), 0);
//! ```

mod args;
mod commands;
mod config;
mod exit_code;
mod failure;
mod log;
#[cfg(feature = "mpi")]
mod lost_rank;
mod memory;
mod patience;
mod plan;
mod progress;
mod ranks;
mod say;
mod signals;

use std::ffi::OsString;
use std::io::Write;
use std::path::PathBuf;

use clap::error::ErrorKind;
use drapery_core::parallel::ranks::Ranks;
use drapery_shot::Shot;
use drapery_shot::farm::command_line::quoted;
use drapery_shot::remote_simulation;
use serde_json::{Value, json};

use crate::args::{Cli, Command};
use crate::config::Environment;
use crate::exit_code::ExitCode;
use crate::failure::Failure;
use crate::patience::Patience;

/// Exit of the program.
struct Ended {
    code: u8,
    /// True if SIGTERM ends the program, once everything is done.
    by_term: bool,
}

impl From<ExitCode> for Ended {
    fn from(code: ExitCode) -> Self {
        Self { code: code as u8, by_term: false }
    }
}

/// Invocation of the command.
#[derive(Debug, Clone)]
pub struct Invocation {
    /// Words of the command line, beginning with the name of the program.
    pub words: Vec<OsString>,
    /// A file that starts the command again, which `drapery selftest` does; `None` where none is found.
    pub program: Option<PathBuf>,
}

/// Does what a command line says; returns the exit code. To be called once in a process, which ends with this code: signals,
/// the log and the threads are the command's from then on.
pub fn command(invocation: &Invocation) -> u8 {
    let code = started(invocation);
    // The last line may have no end; a loss of it was reported where it was printed.
    let _ = std::io::stdout().flush();
    code
}

fn started(invocation: &Invocation) -> u8 {
    memory::return_large_blocks();
    if let Err(failure) = memory::watch().and_then(|()| signals::outlive_limits_of_files()) {
        failure.report();
        return failure.code as u8;
    }
    let parsed = args::parse(invocation);
    let ranks = match ranks::join(parsed.as_ref().ok().map(|cli| &cli.command)) {
        Ok(ranks) => ranks,
        Err(failure) => {
            if ranks::is_spokesman() {
                failure.report();
            }
            return failure.code as u8;
        }
    };
    pass_answers();
    let cli = match parsed {
        Ok(cli) => cli,
        Err(message) => {
            if ranks.is_first() {
                explain(&message, &invocation.words);
            }
            let code = if message.use_stderr() { ExitCode::Usage } else { ExitCode::Done };
            return printed(code.into()).code;
        }
    };
    // From here on a rank that is lost ends this one.
    let (heartbeat, refused) = ranks::Heartbeat::start(&ranks);
    if !ranks.is_first() {
        let code = ranks::follow(&cli.command, &ranks);
        heartbeat.bye(code);
        // Waits for the others, whose heartbeats go on until then.
        drop(ranks);
        return code;
    }
    // A panic is a fault of the program; the farm is to see an exit code that says so. One of several ranks ends them all.
    let outcome =
        std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| refused.and_then(|()| dispatch(&cli, &ranks))));
    let ended = printed(outcome.unwrap_or_else(|_| Err(Failure::internal())).unwrap_or_else(|failure| {
        failure.report();
        failure.code.into()
    }));
    remote_simulation::shut_down(&ranks, ended.code);
    heartbeat.bye(ended.code);
    // Waits for the others.
    drop(ranks);
    if ended.by_term {
        signals::end_by_term();
    }
    ended.code
}

/// The command line as it is understood, for man pages and completions of shells.
pub fn command_line() -> clap::Command {
    <Cli as clap::CommandFactory>::command()
}

/// Returns the JSON of `drapery plan --json` for a shot, without threads and settings of the run.
pub fn plan_json(shot: &Shot) -> Value {
    commands::plan::of_shot(shot, None)
}

/// Lets panics pass that are the answer of a reader to a damaged file: the error that comes of them is reported.
pub fn pass_answers() {
    let tells = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |panic| {
        if !drapery_io::formats::answers_panics() {
            tells(panic);
        }
    }));
}

/// Prints what is wrong with the command line; help and version come here too, and go to standard output.
fn explain(message: &clap::Error, words: &[OsString]) {
    let printed = message.print();
    if !message.use_stderr() {
        say::note_loss(say::STANDARD_OUTPUT, printed);
    }
    if message.kind() == ErrorKind::InvalidUtf8 {
        let wrong = words.iter().filter(|word| word.to_str().is_none());
        wrong.for_each(|word| say::complaint(format_args!("not UTF-8: {}", quoted(word))));
    }
    let measured = words.windows(2).filter(|pair| pair[0] == "--measure");
    let number = measured.filter_map(|pair| pair[1].to_str()?.parse::<u32>().ok()).next();
    if let (Some(number), ErrorKind::UnknownArgument) = (number, message.kind()) {
        say::complaint(format_args!("help: the number of frames follows `=`: write --measure={number}"));
    }
}

/// Returns the exit of the program with its output taken into account: a command that has done its work and could not print the
/// result has failed. Other exits stay, because a run that stopped has to be continued all the same.
fn printed(ended: Ended) -> Ended {
    let done = [ExitCode::Done, ExitCode::Differences].map(|code| code as u8);
    match say::loss() {
        Some(text) if done.contains(&ended.code) => {
            let failure = Failure::new(ExitCode::Io, text);
            failure.report();
            failure.code.into()
        }
        _ => ended,
    }
}

/// Does what the command says; an error is an object too where JSON is printed.
fn dispatch(cli: &Cli, ranks: &Ranks) -> Result<Ended, Failure> {
    let prints_json = match &cli.command {
        Command::Check(args) => args.json,
        Command::Plan(args) => args.json,
        Command::Diff(args) => args.json,
        _ => false,
    };
    done(cli, ranks).inspect_err(|failure| {
        if prints_json {
            say::line(format_args!("{:#}", json!({"error": failure.to_string(), "exit_code": failure.code as u8})));
        }
    })
}

fn done(cli: &Cli, ranks: &Ranks) -> Result<Ended, Failure> {
    let logs = log::start(&cli.log)?;
    // Read only where it matters: a broken site file is no reason not to see how a run is.
    let around = || Environment::find(cli.config.as_deref());
    // A run has its own lines.
    let prepares = matches!(cli.command, Command::Check(_) | Command::Plan(_));
    let _patience = (prepares && !cli.log.quiet).then(Patience::start);
    let loudness = (cli.log.quiet, cli.log.verbose > 0);
    let code = match &cli.command {
        Command::Run(args) => return commands::run::run(args, ranks, around(), loudness, &logs),
        Command::Check(args) => commands::check::check(args, &around()?),
        Command::Plan(args) => commands::plan::plan(args, &around()?),
        Command::Info(args) => commands::info::info(&args.file),
        Command::Convert(args) => commands::convert::convert(args),
        Command::Verify(args) => commands::verify::verify(args),
        Command::Status(args) => commands::status::status(args),
        Command::Stop(args) => commands::stop::stop(args),
        Command::Diff(args) => commands::diff::diff(args),
        Command::Report(args) => commands::report::report(args),
        Command::View(args) => commands::view::view(args),
        Command::Study(args) => commands::study::study(args, ranks, &around()?, cli.log.quiet),
        Command::Wedge(args) => commands::wedge::wedge(args, ranks, &around()?, cli.log.quiet),
        Command::Schema => commands::schema::schema(),
        Command::Materials(args) => commands::materials::materials(args, &around()?),
        Command::Selftest(args) => commands::selftest::selftest(args),
    };
    code.map(Into::into)
}
