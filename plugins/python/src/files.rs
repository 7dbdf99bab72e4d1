//! What the command does with files: conversions, differences, reports, and what a file holds.

use std::path::PathBuf;

use drapery_analysis::{diff, report};
use drapery_io::convert::{Conversion, Converted, convert};
use drapery_io::formats;
use drapery_shot::fault::{Fault, FaultKind};
use pyo3::prelude::*;
use serde::Serialize;

use crate::caches::{axis, axis_of, length_of};
use crate::on_thread::on_thread;

/// First and last frame, number of points, unit and axis of a cache that was written, and what it does not hold.
type Written = ((i64, i64), usize, (&'static str, &'static str), Vec<String>);

/// What is to become of a cache, as Python hands it over.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct Request {
    from: PathBuf,
    to: PathBuf,
    object: Option<String>,
    frames: Option<(i64, i64)>,
    length: Option<String>,
    up: Option<String>,
    fps: Option<(u32, u32)>,
    overwrite: bool,
}

/// Writes a cache in another format, unit or axis, or with other frames.
#[pyfunction(name = "convert")]
pub(crate) fn convert_cache(py: Python<'_>, request: Request) -> PyResult<Written> {
    let conversion = Conversion {
        from: request.from,
        to: request.to,
        object: request.object,
        frames: request.frames.map(|(first, last)| [first, last]),
        length: request.length.as_deref().map(length_of).transpose()?,
        up: request.up.as_deref().map(axis_of).transpose()?,
        fps: request.fps,
        overwrite: request.overwrite,
    };
    let written = on_thread(py, |_| Ok(convert(&conversion, &mut |_| ())?))?;
    let Converted { frames: [first, last], points, units, left_out } = written;
    Ok(((first, last), points, (units.length.word(), axis(units.up)), left_out))
}

/// How far two caches, checkpoints or folders of runs are from each other, as JSON.
#[pyfunction(name = "diff")]
pub(crate) fn diff_results(py: Python<'_>, a: PathBuf, b: PathBuf, tolerance: f64) -> PyResult<String> {
    on_thread(py, |_| as_json(&diff::compare(&a, &b, tolerance)?))
}

/// Writes the page about a run into its folder; its path.
#[pyfunction(name = "report")]
pub(crate) fn write_report(py: Python<'_>, folder: PathBuf) -> PyResult<PathBuf> {
    on_thread(py, |_| Ok(report::write(&folder)?))
}

/// What a mesh or cache file holds, as JSON.
#[pyfunction]
pub(crate) fn info(py: Python<'_>, path: PathBuf) -> PyResult<String> {
    on_thread(py, |_| as_json(&formats::inspect(&path)?))
}

/// Numbers that are none become null.
fn as_json(content: &impl Serialize) -> Result<String, Fault> {
    serde_json::to_string(content).map_err(|error| Fault::new(FaultKind::Internal, error.to_string()))
}
