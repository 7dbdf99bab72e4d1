//! A frame rate other than that of the files.

use drapery_io::input_motion::InputMotion;

use super::{Facts, Finding};
use crate::check::rates::{other_rate, shown};

pub(super) fn find(facts: &Facts<'_>) -> Vec<Finding> {
    let fps = facts.inputs.timeline.fps();
    let mut findings: Vec<Finding> = Vec::new();
    for finding in facts.motions().filter_map(|motion| of_motion(motion, fps)) {
        // A track of several pins is named once.
        if !findings.contains(&finding) {
            findings.push(finding);
        }
    }
    findings
}

fn of_motion(motion: &InputMotion, fps: f64) -> Option<Finding> {
    let (how, line) = other_rate(motion, fps)?;
    let message = format!(
        "{}: {how} frames per second, but the shot has {}: their frames do not line up",
        motion.source.path().display(),
        shown(fps)
    );
    Some(Finding { object: motion.label.clone(), message, line })
}
