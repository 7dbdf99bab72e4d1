//! `drapery selftest`: what this build has to withstand.

mod hard;

use crate::args::SelftestArgs;
use crate::exit_code::ExitCode;
use crate::failure::Failure;

/// Runs the tests that are asked for.
pub(crate) fn selftest(args: &SelftestArgs) -> Result<ExitCode, Failure> {
    match args.hard {
        Some(tier) => hard::run(args, tier),
        // The arguments ask for one of the suites.
        None => Ok(ExitCode::Usage),
    }
}
