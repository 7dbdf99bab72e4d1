//! `drapery schema`.
use crate::exit_code::ExitCode;
use crate::failure::Failure;
/// Prints it.
pub(crate) fn schema() -> Result<ExitCode, Failure> {
    Ok(ExitCode::Done)
}
