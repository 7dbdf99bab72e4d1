//! Files whose samples are several frames apart.

use drapery_io::input_motion::InputMotion;

use super::{Facts, Finding};
use crate::check::rates::other_rate;

/// Steps between samples from which on frames have none of their own [frames].
const SPARSE: f64 = 1.5;

/// Steps that make a pattern: one alone is a straight motion on purpose.
const PATTERN: usize = 2;

pub(super) fn find(facts: &Facts<'_>) -> Vec<Finding> {
    let mut findings: Vec<Finding> = Vec::new();
    for finding in facts.motions().filter_map(|motion| of_motion(facts, motion)) {
        // A track of several pins is named once.
        if !findings.contains(&finding) {
            findings.push(finding);
        }
    }
    findings
}

fn of_motion(facts: &Facts<'_>, motion: &InputMotion) -> Option<Finding> {
    let timeline = facts.inputs.timeline;
    let fps = timeline.fps();
    if other_rate(motion.source.frame_rate(), fps).is_some() {
        return None;
    }
    let [first, last] = [timeline.origin, facts.last_frame].map(|frame| timeline.file_time(frame));
    let pairs = motion.source.sample_times().windows(2).filter(|pair| pair[1] > first && pair[0] < last);
    let mut steps: Vec<f64> = pairs.map(|pair| (pair[1] - pair[0]) * fps).collect();
    steps.sort_by(f64::total_cmp);
    let usual = *steps.get(steps.len() / 2).filter(|usual| **usual >= SPARSE && steps.len() >= PATTERN)?;
    let message = format!(
        "{}: its samples are {} frames apart, and frames between are interpolated on straight lines: export a sample for every \
         frame, or silence this rule if the motion is meant to be so",
        motion.source.path().display(),
        (usual * 1e3).round() / 1e3
    );
    Some(Finding { object: motion.label.clone(), message, line: String::new() })
}
