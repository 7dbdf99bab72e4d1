//! The command from outside: a folder, a command line, the expected text and exit code.

mod bad_input;
mod effects;
mod farm;
mod files;
#[cfg(feature = "usd")]
mod from_usd;
mod full_disk;
mod inspection;
mod replay;
mod resume;
mod run;
mod site;
mod stop;
mod study;
mod view;
mod wedge;

use std::path::Path;
use std::process::{Command, Output, Stdio};

use drapery_selftest::bench::VARIABLES;
use drapery_selftest::files::SHEET;

/// Output and exit code of a command.
pub(crate) struct Outcome {
    pub(crate) code: Option<i32>,
    pub(crate) stdout: String,
    pub(crate) stderr: String,
}

impl From<Output> for Outcome {
    fn from(output: Output) -> Self {
        Self {
            code: output.status.code(),
            stdout: String::from_utf8_lossy(&output.stdout).into_owned(),
            stderr: String::from_utf8_lossy(&output.stderr).into_owned(),
        }
    }
}

/// `drapery` in a folder, without anything in the environment that could change what it does.
pub(crate) fn command(folder: &Path, arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_drapery"));
    command.current_dir(folder).args(arguments).stdin(Stdio::null());
    for name in VARIABLES {
        command.env_remove(name);
    }
    command
}

/// Runs `drapery` in a folder and waits.
pub(crate) fn drapery(folder: &Path, arguments: &[&str]) -> Outcome {
    command(folder, arguments).output().expect("the command can be started").into()
}

/// A folder with a scene in it.
pub(crate) fn folder_with(scene: &str) -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a temporary folder");
    std::fs::write(folder.path().join("scene.toml"), scene).expect("it can be written to");
    folder
}

/// Two sheets that pass through one another from the start; crossings are counted.
pub(crate) fn crossing() -> String {
    let second = r#"[[garment]]
name = "second"
density = 1.0
[garment.panel]
resolution = 2
side = 0.4
center = [0.31, 0.52, 0.47]
rotation = { axis = [1, 0, 0], degrees = 90 }
[self_collision]
[output]"#;
    SHEET.replace("[output]", second)
}
