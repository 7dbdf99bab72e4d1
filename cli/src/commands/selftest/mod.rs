//! `drapery selftest`: what this build has to withstand.

mod bits;
mod drape;
mod hard;

use crate::args::SelftestArgs;
use crate::exit_code::ExitCode;
use crate::failure::Failure;

/// Runs the tests that are asked for.
pub(crate) fn selftest(args: &SelftestArgs) -> Result<ExitCode, Failure> {
    if args.tangles {
        return hard::run_tangles(args);
    }
    match (args.hard, &args.drape, &args.bits) {
        (Some(tier), ..) => hard::run(args, tier),
        (None, Some(materials), _) => drape::run(materials, args.json),
        (None, None, Some(scene)) => bits::run(args, scene),
        // The arguments ask for one of the suites.
        (None, None, None) => Ok(ExitCode::Usage),
    }
}
