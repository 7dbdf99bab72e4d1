//! A frame rate other than that of the files.

use std::path::Path;

use drapery_io::input_motion::InputMotion;
use drapery_io::mesh_source::FrameRate;
use drapery_io::shot_description::ChannelRate;

use super::{Facts, Finding};
use crate::check::rates::{other_rate, shown};

pub(super) fn find(facts: &Facts<'_>) -> Vec<Finding> {
    let fps = facts.inputs.timeline.fps();
    let mut findings: Vec<Finding> = Vec::new();
    let of_motion =
        |motion: &InputMotion| of_file(&motion.label, motion.source.path(), motion.source.frame_rate(), fps);
    let of_channel = |channel: &ChannelRate| of_file(&channel.object, &channel.path, Some(channel.rate), fps);
    for finding in facts.motions().filter_map(of_motion).chain(facts.check.channels.iter().filter_map(of_channel)) {
        // A track of several pins is named once.
        if !findings.contains(&finding) {
            findings.push(finding);
        }
    }
    findings
}

fn of_file(object: &str, path: &Path, rate: Option<FrameRate>, fps: f64) -> Option<Finding> {
    let (how, line) = other_rate(rate, fps)?;
    let message = format!(
        "{}: {how} frames per second, but the shot has {}: their frames do not line up",
        path.display(),
        shown(fps)
    );
    Some(Finding { object: object.to_owned(), message, line })
}
