//! `drapery schema`: the JSON schema of scene files.

use drapery_io::scene_file;

use crate::exit_code::ExitCode;
use crate::failure::Failure;
use crate::say;

/// Prints the schema.
pub(crate) fn schema() -> Result<ExitCode, Failure> {
    say::line(scene_file::schema());
    Ok(ExitCode::Done)
}
