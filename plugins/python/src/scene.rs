//! Scenes, from files or from memory, and shots: scenes that were checked.

use std::path::PathBuf;
use std::sync::{Arc, Mutex};

use drapery_shot::fault::Fault;
use drapery_shot::rules::Warning;
use drapery_shot::run::{FrameReport, Observer, Outcome, RunOptions};
use drapery_shot::scene_source::SceneSource;
use numpy::{PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::about::{About, counts};
use crate::arrays;
use crate::errors::{in_use, raised, usage};
use crate::on_thread::{Caller, on_thread};
use crate::simulation::Simulation;

/// A scene: where it comes from, and what is set in it. Nothing is simulated before somebody asks.
#[pyclass(module = "drapery._native")]
pub(crate) struct Scene {
    pub(crate) source: SceneSource,
    name: String,
}

#[pymethods]
impl Scene {
    /// A scene of a file; `text` is the text of a scene in memory with its name and folder.
    #[new]
    fn new(
        path: Option<PathBuf>,
        text: Option<(String, String, PathBuf)>,
        settings: Vec<(String, String)>,
        materials: Vec<PathBuf>,
    ) -> PyResult<Self> {
        let mut source = match (path, text) {
            (Some(path), None) => SceneSource::file(path),
            (None, Some((text, name, folder))) => SceneSource::text(text, name, folder),
            _ => return Err(usage("a scene is one of a file or one of a text")),
        };
        source.settings = settings;
        source.search.materials = materials;
        let name = source.read().map_err(raised)?.name().to_owned();
        Ok(Self { source, name })
    }

    #[getter]
    fn name(&self) -> &str {
        &self.name
    }

    #[getter]
    fn path(&self) -> Option<PathBuf> {
        self.source.path().map(PathBuf::from)
    }

    /// Every value of the scene as TOML; the files that it names are opened.
    fn to_toml(&self, py: Python<'_>) -> PyResult<String> {
        on_thread(py, |_| Ok(self.source.read()?.resolve()?.resolved))
    }

    fn set(&mut self, key: String, value: String) -> PyResult<()> {
        let mut changed = self.source.clone();
        changed.settings.push((key, value));
        self.name = changed.read().map_err(raised)?.name().to_owned();
        self.source = changed;
        Ok(())
    }

    fn add_mesh(
        &mut self,
        name: &str,
        positions: PyReadonlyArray2<'_, f64>,
        face_counts: PyReadonlyArray1<'_, u32>,
        corners: PyReadonlyArray1<'_, u32>,
    ) -> PyResult<()> {
        let mesh = arrays::mesh(&positions, &face_counts, &corners)?;
        self.source.meshes.insert(name, mesh).map_err(raised)
    }

    /// Checks all inputs.
    fn shot(&self, py: Python<'_>, frames: Option<(i64, i64)>) -> PyResult<Shot> {
        Shot::new(py, self.source.clone(), frames.map(|(first, last)| [first, last]))
    }
}

/// A scene that was checked with all its inputs.
#[pyclass(module = "drapery._native", frozen)]
pub(crate) struct Shot {
    source: SceneSource,
    frames: Option<[i64; 2]>,
    about: About,
    /// Until somebody runs or steps it; it is prepared again for the next one.
    prepared: Mutex<Option<drapery_shot::Shot>>,
}

impl Shot {
    fn new(py: Python<'_>, source: SceneSource, frames: Option<[i64; 2]>) -> PyResult<Self> {
        let shot = on_thread(py, |_| source.prepare(frames))?;
        Ok(Self { about: About::of(&shot), source, frames, prepared: Mutex::new(Some(shot)) })
    }

    /// The shot that was checked, or another one.
    fn take(&self, py: Python<'_>) -> PyResult<drapery_shot::Shot> {
        let taken = self.prepared.try_lock().map_err(|error| in_use("shot", &error))?.take();
        taken.map_or_else(|| on_thread(py, |_| self.source.prepare(self.frames)), Ok)
    }
}

#[pymethods]
impl Shot {
    #[getter]
    fn name(&self) -> &str {
        &self.about.name
    }

    #[getter]
    fn frames(&self) -> [i64; 3] {
        self.about.frames
    }

    #[getter]
    fn fps(&self) -> f64 {
        self.about.fps
    }

    #[getter]
    fn garments(&self) -> Vec<String> {
        self.about.garments.clone()
    }

    #[getter]
    fn bodies(&self) -> Vec<String> {
        self.about.bodies.clone()
    }

    /// Rule, object, message and line of each.
    #[getter]
    fn warnings(&self) -> Vec<(Option<&str>, String, String, String)> {
        let parts = |warning: &Warning| {
            let Warning { rule, object, message, line } = warning.clone();
            (rule, object, message, line)
        };
        self.about.warnings.iter().map(parts).collect()
    }

    /// The plan as JSON.
    #[getter]
    fn plan(&self) -> &str {
        &self.about.plan
    }

    /// Follows the pins through all frames; what is suspicious of them.
    fn check_pins(&self, py: Python<'_>) -> PyResult<Vec<String>> {
        let mut held = self.prepared.try_lock().map_err(|error| in_use("shot", &error))?;
        let mut shot = match held.take() {
            Some(shot) => shot,
            None => on_thread(py, |_| self.source.prepare(self.frames))?,
        };
        let checked = &mut shot;
        let found = on_thread(py, move |_| Ok::<_, Fault>(checked.check_pins()?));
        *held = Some(shot);
        found
    }

    fn simulate(&self, py: Python<'_>) -> PyResult<Simulation> {
        Ok(Simulation::new(self.take(py)?, self.about.clone()))
    }

    /// Runs it. `hear` is called with the kind of what is heard and its parts.
    fn run<'py>(
        &self,
        py: Python<'py>,
        out: PathBuf,
        overwrite: bool,
        command: String,
        hear: Py<PyAny>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let shot = self.take(py)?;
        let hear = Arc::new(hear);
        let report = on_thread(py, |caller| {
            let threads = rayon::current_num_threads();
            let options = RunOptions { overwrite, threads, command, ..RunOptions::new(out) };
            let asked = caller.clone();
            options.requests.ask_program(Box::new(move || asked.is_cancelled()));
            Ok(shot.run(&options, &mut Listener { caller, hear })?)
        })?;
        let outcome = match report.outcome {
            Outcome::Done => "done",
            Outcome::NothingToDo => "nothing to do",
            Outcome::Stopped(_) => "stopped",
        };
        let found = PyDict::new(py);
        found.set_item("outcome", outcome)?;
        found.set_item("frame", report.frame)?;
        found.set_item("frames", report.frames)?;
        found.set_item("seconds", report.seconds)?;
        found.set_item("files", report.files)?;
        found.set_item("counts", counts(py, report.metrics.counts())?)?;
        let exceeded: Vec<_> = report.exceeded.iter().map(|limit| (limit.name, limit.total)).collect();
        found.set_item("exceeded", exceeded)?;
        Ok(found)
    }
}

/// Hands on what is heard of a run.
struct Listener<'a> {
    caller: &'a Caller,
    hear: Arc<Py<PyAny>>,
}

impl Observer for Listener<'_> {
    fn resumed(&mut self, frame: i64, done: u64) {
        let hear = self.hear.clone();
        self.caller.call(move |py| hear.call1(py, ("resumed", frame, done)).map(drop));
    }

    fn note(&mut self, text: String) {
        let hear = self.hear.clone();
        self.caller.call(move |py| hear.call1(py, ("note", text)).map(drop));
    }

    fn underway(&mut self, frame: i64, states: u64, share: f64) {
        let hear = self.hear.clone();
        self.caller.call(move |py| hear.call1(py, ("underway", frame, states, share)).map(drop));
    }

    fn frame(&mut self, report: &FrameReport<'_>) {
        let &FrameReport { frame, last_frame, is_preroll, done, total, seconds, summary } = report;
        let (hear, steps) = (self.hear.clone(), summary.map_or(0, |summary| summary.steps));
        let parts = ("frame", frame, last_frame, is_preroll, done, total, seconds, steps);
        self.caller.call(move |py| hear.call1(py, parts).map(drop));
    }
}
