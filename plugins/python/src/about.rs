//! Constant properties of a shot, and counts.

use drapery_shot::rules::Warning;
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// Constant properties of a shot.
#[derive(Clone)]
pub(crate) struct About {
    pub(crate) name: String,
    /// First frame of the simulation, first frame of the scene, and last frame.
    pub(crate) frames: [i64; 3],
    pub(crate) fps: f64,
    pub(crate) garments: Vec<String>,
    pub(crate) bodies: Vec<String>,
    pub(crate) warnings: Vec<Warning>,
    /// As JSON.
    pub(crate) plan: String,
}

impl About {
    pub(crate) fn of(shot: &drapery_shot::Shot) -> Self {
        let timeline = shot.timeline();
        let description = shot.simulation().scene().description();
        Self {
            name: shot.name().to_owned(),
            frames: [timeline.start, timeline.origin, shot.frames()[1]],
            fps: timeline.fps(),
            garments: description.garments.iter().map(|garment| garment.name.clone()).collect(),
            bodies: description.bodies.iter().map(|body| body.name.clone()).collect(),
            warnings: shot.warnings().to_vec(),
            plan: drapery_command::plan_json(shot).to_string(),
        }
    }
}

/// Counts by their names.
pub(crate) fn counts<'py, N: AsRef<str>>(py: Python<'py>, counts: &[(N, u64)]) -> PyResult<Bound<'py, PyDict>> {
    let found = PyDict::new(py);
    counts.iter().try_for_each(|(name, amount)| found.set_item(name.as_ref(), amount))?;
    Ok(found)
}
