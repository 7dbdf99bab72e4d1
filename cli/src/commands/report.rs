//! `drapery report`: a page about a run.

use drapery_analysis::report;

use crate::args::ReportArgs;
use crate::exit_code::ExitCode;
use crate::failure::Failure;
use crate::say;

/// Writes `report.html` into the folder of a run.
pub(crate) fn report(args: &ReportArgs) -> Result<ExitCode, Failure> {
    let path = report::write(&args.folder)?;
    say::line(format_args!("wrote {}", path.display()));
    Ok(ExitCode::Done)
}
