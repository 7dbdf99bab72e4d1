//! `drapery verify`: would other applications load these caches, does cloth pass through cloth, and do they still hold what the
//! run has written?

use std::path::Path;

use drapery_analysis::verify::{self, Verification};
use drapery_io::error::{IoError, IoErrorKind};
use drapery_io::formats::of_file;

use crate::args::VerifyArgs;
use crate::exit_code::ExitCode;
use crate::failure::Failure;
use crate::say;

/// Checks every frame of caches that belong together.
pub(crate) fn verify(args: &VerifyArgs) -> Result<ExitCode, Failure> {
    let paths: Vec<&Path> = args.files.iter().map(AsRef::as_ref).collect();
    if let Some(folder) = paths.iter().find(|path| path.is_dir()) {
        let text = format!(
            "{0}: this is a folder\n  help: give caches, as in {0}/*.abc; --record {0} compares those of a run with its record",
            folder.display()
        );
        return Err(Failure::new(ExitCode::BadInput, text));
    }
    let mut found = Verification::default();
    // Of caches that no application opens there are no rules but those of the record.
    let is_judged = |path: &Path| of_file(path).is_none_or(|format| format.opens_in_applications);
    if let Some(path) = paths.iter().find(|path| args.record.is_none() && !is_judged(path)) {
        let text = format!(
            "{}: no application opens such a cache, so there are no rules for it\n  \
             help: compare it with the record of its run: --record, and the folder of the run",
            path.display()
        );
        return Err(Failure::new(ExitCode::Usage, text));
    }
    let judged: Vec<&Path> = paths.iter().copied().filter(|path| is_judged(path)).collect();
    if !judged.is_empty() {
        found = verify::verify(&judged, args.body.as_deref()).map_err(unusable)?;
    }
    if let Some(folder) = &args.record {
        let of_record = verify::recorded(folder, &paths)?;
        found.facts.extend(of_record.facts);
        found.warnings.extend(of_record.warnings);
        found.failures.extend(of_record.failures);
    }
    found.facts.iter().for_each(say::line);
    found.warnings.iter().for_each(|warning| say::line(format_args!("warning: {warning}")));
    let shown = if args.files.is_empty() { args.record.as_slice() } else { &args.files };
    let names = shown.iter().map(|path| path.display().to_string()).collect::<Vec<_>>().join(", ");
    if found.failures.is_empty() {
        say::line(format_args!("{names}: all rules are met"));
        return Ok(ExitCode::Done);
    }
    let broken = match found.failures.len() {
        1 => "a rule is broken".to_owned(),
        many => format!("{many} rules are broken"),
    };
    let text = format!("{names}: {broken}\n{}", found.failures.join("\n"));
    Err(Failure::new(ExitCode::VerificationFailed, text))
}

/// Returns a failed verification for an input that cannot be understood, because it cannot be loaded either. Other errors, such
/// as a missing file, keep their exit codes.
fn unusable(error: IoError) -> Failure {
    match error.kind() {
        IoErrorKind::BadInput if !matches!(error, IoError::NotAFile { .. }) => {
            Failure::new(ExitCode::VerificationFailed, error.to_string())
        }
        _ => Failure::from(error),
    }
}
