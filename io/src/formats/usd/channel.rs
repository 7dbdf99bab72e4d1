//! Channels of a stage: attributes that hold numbers.

use std::path::Path;

use drapery_usd::read::Stage;

use super::read::frame_rate;
use crate::error::IoError;
use crate::formats::ChannelSamples;
use crate::units::UpAxis;

/// Samples of an attribute of a prim, at their times [s].
///
/// # Errors
/// The stage is missing or damaged, or has no such attribute; it holds no numbers.
pub(super) fn read(path: &Path, prim: &str, attribute: &str) -> Result<ChannelSamples, IoError> {
    let stage = Stage::open(path)?;
    let about = stage.about();
    let (fps, codes_per_frame) = frame_rate(path, about)?;
    let samples = stage.numbers(prim, attribute)?;
    let values = samples.into_iter().map(|(code, value)| (code / (codes_per_frame * fps), value)).collect();
    let up = about.up_axis.as_deref().map(|axis| if axis == "Z" { UpAxis::Z } else { UpAxis::Y });
    Ok(ChannelSamples { up, stated_rate: Some(fps), values })
}
