//! `drapery materials`.
use crate::exit_code::ExitCode;
use crate::failure::Failure;
/// Prints it.
pub(crate) fn materials() -> Result<ExitCode, Failure> {
    Ok(ExitCode::Done)
}
