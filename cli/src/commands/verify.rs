//! `drapery verify`: would other applications load these caches, and does cloth pass through cloth?

use std::path::Path;

use drapery_io::error::IoErrorKind;
use drapery_io::verify;

use crate::args::VerifyArgs;
use crate::exit_code::ExitCode;
use crate::failure::Failure;
use crate::say;

/// Checks every frame of caches that belong together.
pub(crate) fn verify(args: &VerifyArgs) -> Result<ExitCode, Failure> {
    let paths: Vec<&Path> = args.files.iter().map(AsRef::as_ref).collect();
    let found = verify::verify(&paths, args.body.as_deref()).map_err(|error| match error.kind() {
        // What cannot be understood cannot be loaded either; a file that is not there is another matter.
        IoErrorKind::BadInput => Failure::new(ExitCode::VerificationFailed, error.to_string()),
        _ => Failure::from(error),
    })?;
    found.facts.iter().for_each(say::line);
    found.warnings.iter().for_each(|warning| say::line(format_args!("warning: {warning}")));
    let names = args.files.iter().map(|path| path.display().to_string()).collect::<Vec<_>>().join(", ");
    if found.failures.is_empty() {
        say::line(format_args!("{names}: every rule is kept"));
        return Ok(ExitCode::Done);
    }
    let text = format!("{names}: {} rules are broken\n{}", found.failures.len(), found.failures.join("\n"));
    Err(Failure::new(ExitCode::VerificationFailed, text))
}
