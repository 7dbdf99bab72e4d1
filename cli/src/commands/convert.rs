//! `drapery convert`: a cache of one format as one of another.

use drapery_io::convert::{Conversion, Converted, convert as convert_cache};

use crate::args::ConvertArgs;
use crate::exit_code::ExitCode;
use crate::failure::Failure;
use crate::say;

/// Writes a cache anew and says what is in it.
pub(crate) fn convert(args: &ConvertArgs) -> Result<ExitCode, Failure> {
    let conversion = Conversion {
        from: args.from.clone(),
        to: args.to.clone(),
        object: args.object.clone(),
        frames: args.frames.map(|frames| [frames.first, frames.last]),
        from_length: args.from_length,
        from_up: args.from_up,
        length: args.length,
        up: args.up,
        fps: args.fps,
        triangles: args.triangles,
        overwrite: args.overwrite,
    };
    let mut frames = 0_u64;
    let converted = convert_cache(&conversion, &mut |_| frames += 1)?;
    let Converted { frames: [first, last], points, units, left_out, doubts } = converted;
    doubts.iter().chain(&left_out).for_each(|what| tracing::warn!("{what}"));
    say::line(format_args!("{}: {frames} frames, {first}-{last}, of {points} points in {units}", args.to.display()));
    Ok(ExitCode::Done)
}
