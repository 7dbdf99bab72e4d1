//! Reference pages that are made of the command itself: `docs/reference/cli.md` and `docs/reference/exit_codes.md`.
//! `DRAPERY_BLESS=1 cargo test -p drapery --test reference_pages` rewrites them.

use std::fmt::Write;
use std::path::{Path, PathBuf};

use clap::{Arg, ArgAction, Command};

/// Environment variables that the programs read, who reads them, and what they say.
const VARIABLES: [(&str, &str); 18] = [
    ("DRAPERY_CONFIG", "the [site file](config.md), as `--config` does"),
    ("DRAPERY_MATERIALS", "folders of [material files](config.md), as `--materials` does"),
    ("DRAPERY_PROGRESS", "style of the progress report, as `--progress` does"),
    (
        "DRAPERY_LOG",
        "levels of the log on standard error, in the words of `tracing`: `info`, `debug`, `drapery_core=trace`; counts only \
         without `--verbose` and `--quiet`",
    ),
    ("DRAPERY_STOP_AT", "when the run is to have stopped at a checkpoint, in seconds since 1970"),
    (
        "DRAPERY_RANK_TIMEOUT",
        "silence of another rank after which it counts as lost (machine or network down, process frozen), as in `2m`; 30 s without it, \
         0 for no heartbeats; that of rank 0 counts",
    ),
    ("DRAPERY_THREADS", "threads of each process, as `--threads` does; the first of the four that is set counts"),
    ("OMP_NUM_THREADS", "the same; of a list the first number"),
    ("CUE_THREADS", "the same, set by OpenCue"),
    ("SLURM_CPUS_PER_TASK", "the same, set by Slurm"),
    ("SLURM_JOB_END_TIME", "as `DRAPERY_STOP_AT`, set by Slurm"),
    ("SLURM_NTASKS", "number of processes, set by Slurm: a program without MPI refuses to be one of several"),
    ("OMPI_COMM_WORLD_SIZE", "number of processes, set by Open MPI's `mpirun`"),
    ("PMI_SIZE", "number of processes, set by MPICH and its relatives"),
    ("OMPI_COMM_WORLD_RANK", "number of this process, set by Open MPI's `mpirun`: only process 0 speaks"),
    ("PMIX_RANK", "the same, set by launchers that speak PMIx"),
    ("PMI_RANK", "the same, set by MPICH and its relatives"),
    ("NO_COLOR", "messages have no colours, whatever its value"),
];

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// Compares a page with what it has to be, or rewrites it.
fn check(name: &str, fresh: &str) {
    let path = root().join(name);
    if std::env::var_os("DRAPERY_BLESS").is_some() {
        std::fs::write(&path, fresh).unwrap_or_else(|e| panic!("{name}: {e}"));
    }
    let there = std::fs::read_to_string(&path).unwrap_or_default();
    let help = "DRAPERY_BLESS=1 cargo test -p drapery --test reference_pages";
    assert!(there == fresh, "{name} is out of date\n  help: {help}");
}

/// Text for a cell of a table.
fn cell(text: &str) -> String {
    text.replace('|', "\\|").replace('<', "&lt;").replace('\n', " ")
}

/// Returns the written form of an argument, with its short form and the name of its value.
fn written(arg: &Arg) -> String {
    let names: Vec<&str> = arg.get_value_names().unwrap_or_default().iter().map(|name| name.as_str()).collect();
    let Some(long) = arg.get_long() else { return format!("`{}`", names.join(" ")) };
    let short = arg.get_short().map(|letter| format!("`-{letter}`, ")).unwrap_or_default();
    let takes_value = matches!(arg.get_action(), ArgAction::Set | ArgAction::Append);
    let value = if takes_value { format!(" {}", names.join(" ")) } else { String::new() };
    format!("{short}`--{long}{value}`")
}

/// Returns the meaning of an argument, with its words and its default.
fn meaning(arg: &Arg) -> String {
    let mut text = arg.get_help().map(ToString::to_string).unwrap_or_default();
    let words = arg.get_possible_values();
    if matches!(arg.get_action(), ArgAction::Set | ArgAction::Append) && !words.is_empty() {
        let words: Vec<&str> = words.iter().map(clap::builder::PossibleValue::get_name).collect();
        let _ = write!(text, ". One of: {}", words.join(", "));
    }
    let defaults: Vec<String> = arg.get_default_values().iter().map(|v| v.to_string_lossy().into_owned()).collect();
    if !defaults.is_empty() && arg.get_action().takes_values() {
        let _ = write!(text, " [default: {}]", defaults.join(" "));
    }
    cell(&text)
}

/// A table of arguments.
fn table<'a>(arguments: impl Iterator<Item = &'a Arg>) -> String {
    let rows = arguments.filter(|arg| !["help", "version"].contains(&arg.get_id().as_str()) && !arg.is_hide_set());
    let rows: String = rows.map(|arg| format!("| {} | {} |\n", cell(&written(arg)), meaning(arg))).collect();
    if rows.is_empty() { rows } else { format!("\n| argument | |\n|---|---|\n{rows}") }
}

fn section(command: &mut Command) -> String {
    let about = command.get_about().map(ToString::to_string).unwrap_or_default();
    let usage = command.render_usage().to_string();
    let usage = usage.trim_start_matches("Usage: ");
    let own = table(command.get_arguments().filter(|arg| !arg.is_global_set()));
    format!("\n## {}\n\n{}.\n\n```text\ndrapery {usage}\n```\n{own}", command.get_name(), cell(&about))
}

#[test]
fn the_page_of_the_command_line_is_fresh() {
    let mut command = drapery_command::command_line();
    let mut page = String::from(
        "# The command line\n\n`drapery COMMAND --help` prints the same,\nand `make dist` makes man pages and completions of it. \
         How it ends: [exit codes](exit_codes.md).\n\n\
         | command | does |\n|---|---|\n",
    );
    for sub in command.get_subcommands() {
        let about = sub.get_about().map(ToString::to_string).unwrap_or_default();
        let _ = writeln!(page, "| [`{0}`](#{0}) | {1} |", sub.get_name(), cell(&about));
    }
    page += "\n## For all commands\n";
    page += &table(command.get_arguments());
    for sub in command.get_subcommands_mut() {
        page += &section(sub);
    }
    page += "\n<!-- Written by a test from the program (`cli/src/args.rs`); change it there. -->\n";
    check("docs/reference/cli.md", &page);
}

#[test]
fn the_page_of_exit_codes_and_environment_is_fresh() {
    let help = drapery_command::command_line().get_after_help().expect("exit codes").to_string();
    let rows = help.lines().skip(1).filter_map(|line| line.trim().split_once("  "));
    let mut page = String::from(
        "# Exit codes and environment\n\n## Exit codes\n\nWhat a scheduler should do about each is \
         [in a table](../guide/farm.md) of the farm page.\n\n| code | meaning |\n|---|---|\n",
    );
    for (code, meaning) in rows {
        let _ = writeln!(page, "| {code} | {} |", cell(meaning));
    }
    page += "\n## Environment\n\nA flag overrides a variable, a variable the site file. A variable that is empty \
             counts as not \
             set.\n\n| variable | says |\n|---|---|\n";
    for (name, says) in VARIABLES {
        let _ = writeln!(page, "| `{name}` | {says} |");
    }
    page += "\n<!-- Written by a test from the program (`cli/src/exit_code.rs`, `cli/tests/reference_pages.rs`); \
             change it there. -->\n";
    check("docs/reference/exit_codes.md", &page);
}

/// Texts of the form `"ABC_DEF"` in the Rust files of a folder, without those of tests and of the build.
fn names_of_variables(folder: &Path, found: &mut Vec<String>) {
    for path in std::fs::read_dir(folder).expect("sources").flatten().map(|entry| entry.path()) {
        if path.is_dir() {
            names_of_variables(&path, found);
        } else if path.extension().is_some_and(|ending| ending == "rs") && !path.ends_with("tests.rs") {
            let text = std::fs::read_to_string(&path).expect("a source");
            let code = text.split("#[cfg(test)]").next().unwrap_or_default();
            let begins = ["DRAPERY_", "SLURM_", "OMP_", "CUE_", "OMPI_", "PMI_", "PMIX_", "NO_COLOR"];
            let words = code.split('"').skip(1).step_by(2).filter(|word| begins.iter().any(|b| word.starts_with(b)));
            found.extend(words.filter(|w| w.bytes().all(|b| b.is_ascii_uppercase() || b == b'_')).map(str::to_owned));
        }
    }
}

#[test]
fn every_variable_that_is_read_is_on_the_page() {
    let mut read = Vec::new();
    for folder in ["cli/src", "core/mpi/src", "shot/src", "io/src", "analysis/src"] {
        names_of_variables(&root().join(folder), &mut read);
    }
    read.sort();
    read.dedup();
    let mut known = VARIABLES.map(|(name, _)| name.to_owned()).to_vec();
    known.sort();
    assert_eq!(read, known);
}
