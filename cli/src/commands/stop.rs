//! `drapery stop`: ask a run in progress to write a checkpoint and end.

use std::time::SystemTime;

use drapery_shot::farm::stop::request_stop;

use crate::args::StopArgs;
use crate::exit_code::ExitCode;
use crate::failure::Failure;
use crate::say;

/// Writes the request into the folder of the run.
pub(crate) fn stop(args: &StopArgs) -> Result<ExitCode, Failure> {
    let folder = args.folder.display();
    match request_stop(&args.folder, SystemTime::now())? {
        Some(holder) => say::line(format_args!(
            "{folder}: asked {holder} to stop; it writes a checkpoint after the current step and ends with exit code 75"
        )),
        None => say::line(format_args!("{folder}: no run is in progress here; nothing to stop")),
    }
    Ok(ExitCode::Done)
}
