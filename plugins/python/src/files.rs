//! Operations on files, as in the command: conversions, differences, reports, and contents of a file.

use std::path::PathBuf;

use drapery_analysis::comparison::Comparison;
use drapery_analysis::{diff, report, view};
use drapery_io::convert::{Conversion, Converted, convert};
use drapery_io::formats;
use pyo3::prelude::*;
use serde_json::json;

use crate::caches::{axis, axis_of, length_of};
use crate::on_thread::on_thread;

/// First and last frame, number of points, unit and axis of a cache that was written, what it does not hold, and what is odd about
/// the units of the old one.
type Written = ((i64, i64), usize, (&'static str, &'static str), Vec<String>, Vec<String>);

/// Request for a conversion of a cache, as Python hands it over.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct Request {
    from: PathBuf,
    to: PathBuf,
    object: Option<String>,
    frames: Option<(i64, i64)>,
    from_length: Option<String>,
    from_up: Option<String>,
    length: Option<String>,
    up: Option<String>,
    fps: Option<(u32, u32)>,
    triangles: bool,
    overwrite: bool,
}

/// Writes a cache in another format, unit or axis, or with other frames.
#[pyfunction(name = "convert")]
pub(crate) fn convert_cache(py: Python<'_>, request: Request) -> PyResult<Written> {
    let length = |name, word: Option<String>| word.map(|word| length_of(name, &word)).transpose();
    let up = |name, letter: Option<String>| letter.map(|letter| axis_of(name, &letter)).transpose();
    let conversion = Conversion {
        from: request.from,
        to: request.to,
        object: request.object,
        frames: request.frames.map(|(first, last)| [first, last]),
        from_length: length("from_length", request.from_length)?,
        from_up: up("from_up", request.from_up)?,
        length: length("length", request.length)?,
        up: up("up", request.up)?,
        fps: request.fps,
        triangles: request.triangles,
        overwrite: request.overwrite,
    };
    let converted = on_thread(py, |_| Ok(convert(&conversion, &mut |_| ())?))?;
    let Converted { frames: [first, last], points, units, left_out, doubts } = converted;
    Ok(((first, last), points, (units.length.word(), axis(units.up)), left_out, doubts))
}

/// Distances between two caches, checkpoints or folders of runs, as JSON; an infinite distance is null.
#[pyfunction(name = "diff")]
pub(crate) fn diff_results(py: Python<'_>, a: PathBuf, b: PathBuf, tolerance: f64) -> PyResult<String> {
    on_thread(py, |_| Ok(json!(diff::compare(&a, &b, tolerance)?).to_string()))
}

/// Writes the page about a run into its folder; its path.
#[pyfunction(name = "report")]
pub(crate) fn write_report(py: Python<'_>, folder: PathBuf) -> PyResult<PathBuf> {
    on_thread(py, |_| Ok(report::write(&folder)?))
}

/// Writes the page that compares runs, and its table beside it; the path of the page.
#[pyfunction]
pub(crate) fn compare(py: Python<'_>, folders: Vec<PathBuf>, page: PathBuf) -> PyResult<PathBuf> {
    on_thread(py, |_| {
        let [page, _] = Comparison::of(&folders)?.write(&page)?;
        Ok(page)
    })
}

/// Writes a page with the frames of a run; the number of frames in it, and in the run.
#[pyfunction(name = "view")]
pub(crate) fn write_view(py: Python<'_>, folder: PathBuf, page: PathBuf) -> PyResult<(usize, usize)> {
    on_thread(py, |_| {
        let written = view::write_page(&folder, &page)?;
        Ok((written.frames, written.of))
    })
}

/// Content of a mesh or cache file, as JSON.
#[pyfunction]
pub(crate) fn info(py: Python<'_>, path: PathBuf) -> PyResult<String> {
    on_thread(py, |_| Ok(json!(formats::inspect(&path)?).to_string()))
}
