//! `drapery selftest`: what this build has to withstand.

mod drape;
mod hard;

use crate::args::SelftestArgs;
use crate::exit_code::ExitCode;
use crate::failure::Failure;

/// Runs the tests that are asked for.
pub(crate) fn selftest(args: &SelftestArgs) -> Result<ExitCode, Failure> {
    match (args.hard, &args.drape) {
        (Some(tier), _) => hard::run(args, tier),
        (None, Some(materials)) => drape::run(materials, args.json),
        // The arguments ask for one of the suites.
        (None, None) => Ok(ExitCode::Usage),
    }
}
