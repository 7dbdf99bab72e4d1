//! `drapery selftest --bits`: a scene on other numbers of ranks and threads.

use std::path::Path;

use drapery_analysis::bits::BitsCheck;
use drapery_shot::fault::Fault;
use drapery_shot::scene_source::SceneSource;

use crate::args::SelftestArgs;
use crate::exit_code::ExitCode;
use crate::failure::Failure;
use crate::say;

/// Compares the bits of a scene on these ranks, and prints a row for each.
pub(crate) fn run(args: &SelftestArgs, scene: &Path) -> Result<ExitCode, Failure> {
    let mut source = SceneSource::file(scene);
    source.settings.clone_from(&args.settings);
    let failed = |fault: Fault| Failure::new(fault.kind.into(), fault.message);
    let check = BitsCheck::new(&source, args.last).map_err(failed)?;
    say::line(format_args!("{} lines of steps on one rank of one thread", check.lines()));
    let mut code = ExitCode::Done;
    for layout in &args.ranks {
        match check.compare(*layout).map_err(failed)? {
            None => say::line(format_args!("{layout}: the same bits")),
            Some(difference) => {
                say::line(format_args!("{layout}: {difference}"));
                code = ExitCode::Differences;
            }
        }
    }
    Ok(code)
}
