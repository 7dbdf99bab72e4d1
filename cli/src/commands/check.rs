//! `drapery check`: every problem at once, nothing simulated.

use drapery_core::parallel::ranks::Ranks;
use serde_json::{Value, json};

use crate::args::CheckArgs;
use crate::config::Environment;
use crate::exit_code::ExitCode;
use crate::failure::Failure;
use crate::patience;
use crate::plan;
use crate::say;

/// Checks the scene and every frame of its inputs.
pub(crate) fn check(args: &CheckArgs, around: &Environment) -> Result<ExitCode, Failure> {
    let (shot, _) = plan::prepare(&args.scene, around, &Ranks::default())?;
    for file in shot.referred_files() {
        tracing::info!("reads {}, referenced by a file of the scene", file.display());
    }
    patience::at(format!("{}: checking the pins in all frames", args.scene.scene.display()));
    let of_pins = shot.check_pins()?;
    for warning in &of_pins {
        tracing::warn!("{warning}");
    }
    let [first, last] = shot.frames();
    if args.json {
        let mut warnings = plan::warnings_json(&shot);
        if let Value::Array(warnings) = &mut warnings {
            let of_pins =
                of_pins.iter().map(|message| json!({"rule": null, "object": "", "message": message, "line": ""}));
            warnings.extend(of_pins);
        }
        let all = json!({"shot": shot.name(), "frames": [first, last], "warnings": warnings});
        say::line(format_args!("{all:#}"));
    } else {
        say::line(format_args!("{}: frames {first}-{last} can be simulated", shot.name()));
    }
    Ok(ExitCode::Done)
}
