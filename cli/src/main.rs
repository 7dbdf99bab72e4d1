//! The program `drapery`: the command and nothing else.

use drapery_command::Invocation;

fn main() -> std::process::ExitCode {
    let invocation = Invocation { words: std::env::args_os().collect(), program: std::env::current_exe().ok() };
    drapery_command::command(&invocation).into()
}
