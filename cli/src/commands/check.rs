//! `drapery check`: every problem at once, nothing simulated.

use drapery_core::parallel::ranks::Ranks;

use crate::args::CheckArgs;
use crate::config::Environment;
use crate::exit_code::ExitCode;
use crate::failure::Failure;
use crate::plan;
use crate::say;

/// Checks the scene and every frame of its inputs.
pub(crate) fn check(args: &CheckArgs, around: &Environment) -> Result<ExitCode, Failure> {
    let (shot, _) = plan::prepare(&args.scene, around, &Ranks::default())?;
    if let Some(warning) = shot.check_pins()? {
        tracing::warn!("{warning}");
    }
    let [first, last] = shot.frames();
    say::line(format_args!("{}: frames {first}-{last} can be simulated", shot.name()));
    Ok(ExitCode::Done)
}
