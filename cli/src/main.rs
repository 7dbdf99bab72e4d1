//! `drapery`, the command: what was typed, what will be done, what came of it.

mod args;
mod commands;
mod config;
mod exit_code;
mod failure;
mod log;
mod plan;
mod progress;
mod say;
mod signals;

use clap::Parser;

use crate::args::{Cli, Command};
use crate::config::Surroundings;
use crate::exit_code::ExitCode;
use crate::failure::Failure;

fn main() -> std::process::ExitCode {
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        Err(message) => {
            // Help and version come here too, and go to standard output.
            let _ = message.print();
            return if message.use_stderr() { ExitCode::Usage } else { ExitCode::Done }.into();
        }
    };
    // A panic is a fault of the program; the farm is to see an exit code that says so.
    let outcome = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| dispatch(&cli)));
    match outcome.unwrap_or_else(|_| Err(Failure::internal())) {
        Ok(code) => code,
        Err(failure) => {
            failure.report();
            failure.code.into()
        }
    }
}

fn dispatch(cli: &Cli) -> Result<std::process::ExitCode, Failure> {
    let logs = log::start(&cli.log)?;
    // Read only where it matters: a broken site file is no reason not to see how a run is.
    let around = || Surroundings::find(cli.config.as_deref());
    let code = match &cli.command {
        Command::Run(args) => return commands::run::run(args, around(), cli.log.quiet, &logs),
        Command::Check(args) => commands::check::check(args, &around()?),
        Command::Plan(args) => commands::plan::plan(args, &around()?),
        Command::Info(args) => commands::info::info(&args.file),
        Command::Verify(args) => commands::verify::verify(args),
        Command::Status(args) => commands::status::status(args),
        Command::Stop(args) => commands::stop::stop(args),
        Command::Diff(args) => commands::diff::diff(args),
        Command::Report(args) => commands::report::report(args),
        Command::Schema => commands::schema::schema(),
        Command::Materials(args) => commands::materials::materials(args, &around()?),
    };
    code.map(Into::into)
}
