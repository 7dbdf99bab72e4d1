//! `drapery verify`: would other applications load this cache?

use std::path::Path;

use drapery_io::error::IoErrorKind;
use drapery_io::verify;

use crate::exit_code::ExitCode;
use crate::failure::Failure;
use crate::say;

/// Checks every frame of a cache.
pub(crate) fn verify(path: &Path) -> Result<ExitCode, Failure> {
    let found = verify::verify(path).map_err(|error| match error.kind() {
        // What cannot be understood cannot be loaded either; a file that is not there is another matter.
        IoErrorKind::BadInput => Failure::new(ExitCode::VerificationFailed, error.to_string()),
        _ => Failure::from(error),
    })?;
    found.facts.iter().for_each(say::line);
    found.warnings.iter().for_each(|warning| say::line(format_args!("warning: {warning}")));
    if found.failures.is_empty() {
        say::line(format_args!("{}: every rule is kept", path.display()));
        return Ok(ExitCode::Done);
    }
    let text = format!("{}: {} rules are broken\n{}", path.display(), found.failures.len(), found.failures.join("\n"));
    Err(Failure::new(ExitCode::VerificationFailed, text))
}
