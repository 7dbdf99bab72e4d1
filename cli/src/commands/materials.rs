//! `drapery materials`: the presets and where their numbers come from.

use drapery_io::materials::PRESETS;

use crate::exit_code::ExitCode;
use crate::failure::Failure;
use crate::say;

/// Lists the presets.
pub(crate) fn materials() -> Result<ExitCode, Failure> {
    for material in PRESETS {
        say::line(format_args!("{}: {}", material.name, material.summary));
        say::line(format_args!(
            "  density {} kg/m², thickness {} mm, stretch {} N/m, bending {} N/m, damping {}, friction {}",
            material.density,
            1e3 * material.thickness,
            material.stretch_stiffness,
            material.bending_stiffness,
            material.damping_ratio,
            material.friction
        ));
        say::line(format_args!("  {}", material.provenance));
    }
    Ok(ExitCode::Done)
}
