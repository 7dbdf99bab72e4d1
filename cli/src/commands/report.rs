//! `drapery report`: a page about a run, or about several side by side.

use std::path::{Path, PathBuf};

use drapery_analysis::comparison::{self, Comparison};
use drapery_analysis::report;
use drapery_shot::run_record::folder::with_runs_in;

use crate::args::ReportArgs;
use crate::exit_code::ExitCode;
use crate::failure::Failure;
use crate::say;

/// Writes `report.html` into the folder of a run, or the page that compares several.
pub(crate) fn report(args: &ReportArgs) -> Result<ExitCode, Failure> {
    let folders: Vec<PathBuf> = args.folders.iter().flat_map(|folder| with_runs_in(folder)).collect();
    match (&folders[..], &args.out) {
        ([folder], None) => say::line(format_args!("wrote {}", report::write(folder)?.display())),
        ([_], Some(_)) => {
            let text = "--out names the page of several runs\n  help: give more folders, or leave it out";
            return Err(Failure::new(ExitCode::Usage, text));
        }
        (folders, out) => {
            let compared = Comparison::of(folders)?;
            say::line(compared.table().trim_end());
            let pages = compared.write(out.as_deref().unwrap_or(Path::new(comparison::PAGE)))?;
            pages.iter().for_each(|page| say::line(format_args!("wrote {}", page.display())));
        }
    }
    Ok(ExitCode::Done)
}
