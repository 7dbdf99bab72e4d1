//! Analysis: studies, verification of caches, and materials.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use drapery_analysis::study::analysis::{self, Row};
use drapery_analysis::study::record::{Asked, Study};
use drapery_analysis::study::schedule::Observer;
use drapery_analysis::study::space::RunRequest;
use drapery_analysis::study::{self, Options, table};
use drapery_analysis::verify::{self, Verification};
use drapery_io::formats::of_file;
use drapery_io::materials::{self, Material, PRESETS};
use drapery_io::scene_file::{material_files, read_material};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use serde_json::{Value, json};

use crate::errors::raised;
use crate::on_thread::{Caller, on_thread};
use crate::scene::Scene;

/// Facts, warnings and broken rules of caches that belong together.
#[pyfunction(name = "verify")]
pub(crate) fn verify_caches(
    py: Python<'_>,
    paths: Vec<PathBuf>,
    body: Option<PathBuf>,
    record: Option<PathBuf>,
) -> PyResult<(Vec<String>, Vec<String>, Vec<String>)> {
    let found = on_thread(py, |_| {
        let paths: Vec<&Path> = paths.iter().map(AsRef::as_ref).collect();
        // Of caches that no application opens there are no rules but those of the record.
        let is_judged =
            |path: &&Path| record.is_none() || of_file(path).is_none_or(|format| format.opens_in_applications);
        let judged: Vec<&Path> = paths.iter().copied().filter(is_judged).collect();
        let mut found = match judged.as_slice() {
            [] => Verification::default(),
            judged => verify::verify(judged, body.as_deref())?,
        };
        if let Some(folder) = &record {
            let Verification { facts, warnings, failures } = verify::recorded(folder, &paths)?;
            found.facts.extend(facts);
            found.warnings.extend(warnings);
            found.failures.extend(failures);
        }
        Ok(found)
    })?;
    Ok((found.facts, found.warnings, found.failures))
}

/// Request for a study, as Python hands it over.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct Request {
    out: PathBuf,
    vary: Vec<(String, Vec<String>)>,
    grid: bool,
    latin: u32,
    frames: Option<(i64, i64)>,
    max_wall: f64,
    budget: Option<f64>,
    copies: u32,
    repeats: u32,
    overwrite: bool,
    command: String,
}

/// Makes a study, or goes on with the one that the folder holds; returns what follows from it as JSON. `hear` is called with the
/// kind of what is heard and its parts.
#[pyfunction(name = "study")]
pub(crate) fn make_study(py: Python<'_>, scene: &Scene, request: Request, hear: Py<PyAny>) -> PyResult<String> {
    let limit = Duration::try_from_secs_f64(request.max_wall)
        .map_err(|_| crate::errors::usage(format!("`max_wall` is {} s, which is no time", request.max_wall)))?;
    let (source, hear) = (scene.source.clone(), Arc::new(hear));
    on_thread(py, |caller| {
        let options = Options {
            scene: source,
            out: request.out,
            asked: Asked {
                vary: request.vary,
                grid: request.grid,
                latin: request.latin,
                frames: request.frames.map(|(first, last)| [first, last]),
                copies: request.copies,
                repeats: request.repeats,
            },
            limit,
            budget: request.budget,
            overwrite: request.overwrite,
            threads: rayon::current_num_threads(),
            command: request.command,
            cancelled: caller.cancelled(),
        };
        let study = study::run(&options, &mut Listener { caller, hear })?;
        Ok(as_json(&study, &options.out))
    })
}

/// Analyses the record of a study, a file; returns what follows from it as JSON.
#[pyfunction]
pub(crate) fn study_of(py: Python<'_>, record: PathBuf) -> PyResult<String> {
    on_thread(py, |_| Ok(as_json(&Study::read(&record)?, record.parent().unwrap_or(Path::new("")))))
}

/// The record, and what follows from it.
fn as_json(study: &Study, folder: &Path) -> String {
    let analysis = analysis::analyse(study);
    let row = |row: &Row<'_>| {
        json!({
            "label": row.sample.setting.label,
            "settings": row.sample.setting.settings,
            "seconds": row.seconds,
            "spread": row.spread,
            "error": row.error.map(|error| error.rms),
            "largest_error": row.error.map(|error| error.max),
            "validity": row.error.map(|error| format!("{:?}", error.validity)),
            "order": row.order,
            "on_front": row.on_front,
            "is_sound": row.is_sound,
            "steps": row.sample.cost.steps,
            "errors": row.sample.from_reference.iter().map(|distance| distance.rms).collect::<Vec<_>>(),
        })
    };
    let record: Value = serde_json::from_str(&study.text()).unwrap_or_default();
    json!({
        "record": record,
        "folder": folder,
        "rows": analysis.rows.iter().map(row).collect::<Vec<_>>(),
        "recommended": analysis.recommended(study.budget),
        "frames": study.compared,
        "times": study.compared.iter().map(|frame| study.time(*frame)).collect::<Vec<_>>(),
        "own_error": analysis.own_error,
        "window": analysis.window,
        "table": table::table(study, &analysis, study.budget),
    })
    .to_string()
}

/// Hands on what is heard of a study.
struct Listener<'a> {
    caller: &'a Caller,
    hear: Arc<Py<PyAny>>,
}

impl Observer for Listener<'_> {
    fn note(&mut self, text: &str) {
        let (hear, text) = (self.hear.clone(), text.to_owned());
        self.caller.call(move |py| hear.call1(py, ("note", text)).map(drop));
    }

    fn begins(&mut self, wish: &RunRequest, number: usize, all: usize, seconds: Option<f64>) {
        let (hear, label) = (self.hear.clone(), wish.label());
        self.caller.call(move |py| hear.call1(py, ("run", label, number, all, seconds)).map(drop));
    }
}

/// Presets, then materials of files in folders, with the file that each is from.
#[pyfunction(name = "materials")]
pub(crate) fn list_materials<'py>(py: Python<'py>, folders: Vec<PathBuf>) -> PyResult<Vec<Bound<'py, PyDict>>> {
    let mut all: Vec<(Material, Option<PathBuf>)> = PRESETS.iter().map(|preset| (preset.clone(), None)).collect();
    for file in material_files(&folders).map_err(raised)? {
        let material = read_material(&file).map_err(raised)?;
        // A preset of this name goes first, and so does a folder named before.
        if materials::find(&material.name).is_none() && all.iter().all(|(known, _)| known.name != material.name) {
            all.push((material, Some(file)));
        }
    }
    all.into_iter().map(|(material, file)| as_dict(py, material, file)).collect()
}

fn as_dict<'py>(py: Python<'py>, material: Material, file: Option<PathBuf>) -> PyResult<Bound<'py, PyDict>> {
    let [warp, weft, shear] = material.membrane;
    let found = PyDict::new(py);
    found.set_item("name", &*material.name)?;
    found.set_item("summary", &*material.summary)?;
    found.set_item("density", material.density)?;
    found.set_item("thickness", material.thickness)?;
    found.set_item("stretch_stiffness", material.stretch_stiffness)?;
    found.set_item("warp", warp)?;
    found.set_item("weft", weft)?;
    found.set_item("shear", shear)?;
    found.set_item("bending_rigidity", material.bending_rigidity)?;
    found.set_item("strain_limit", material.strain_limit)?;
    found.set_item("load", material.load)?;
    found.set_item("linearity", material.linearity)?;
    found.set_item("damping_ratio", material.damping_ratio)?;
    found.set_item("friction", material.friction)?;
    found.set_item("provenance", &*material.provenance)?;
    found.set_item("path", file)?;
    Ok(found)
}
