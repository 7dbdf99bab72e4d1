//! Simulations: a shot at some frame, stepped, with bodies that the program moves.

use std::path::PathBuf;
use std::sync::{Mutex, MutexGuard};

use drapery_core::scene::Integrator;
use drapery_core::scene::gather::VertexField;
use drapery_core::simulation::FrameSummary;
use drapery_io::mesh_data::Connectivity;
use drapery_shot::session::{SavedState, Session};
use numpy::{PyArray2, PyReadonlyArray2};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::about::{About, counts};
use crate::arrays::{self, Faces};
use crate::errors::{in_use, raised, usage};
use crate::on_thread::on_thread;

/// A shot at some frame.
#[pyclass(module = "drapery._native", frozen)]
pub(crate) struct Simulation {
    session: Mutex<Session>,
    about: About,
}

/// A state of a simulation, to go back to.
#[pyclass(module = "drapery._native", frozen)]
pub(crate) struct State(SavedState);

#[pymethods]
impl State {
    #[getter]
    fn frame(&self) -> i64 {
        self.0.frame()
    }

    fn __repr__(&self) -> String {
        format!("<drapery.State at frame {}>", self.0.frame())
    }
}

impl Simulation {
    /// A checked shot at its start.
    pub(crate) fn new(shot: drapery_shot::Shot, about: About) -> Self {
        Self { session: Session::new(shot).into(), about }
    }

    /// The session, if no other call uses it. It is not waited for: a signal handler that calls back would wait for itself.
    fn session(&self) -> PyResult<MutexGuard<'_, Session>> {
        self.session.try_lock().map_err(|error| in_use("simulation", &error))
    }

    fn field<'py>(&self, py: Python<'py>, garment: &str, field: VertexField) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let garment = number(&self.about.garments, garment, "garment")?;
        let values = self.session()?.take_field(garment, field).map_err(raised)?;
        arrays::vectors(py, values)
    }
}

/// The number of a name in a list.
fn number(names: &[String], name: &str, what: &str) -> PyResult<usize> {
    let found = names.iter().position(|known| known == name);
    found.ok_or_else(|| {
        let known =
            if names.is_empty() { "there is none".to_owned() } else { format!("there are {}", names.join(", ")) };
        usage(format!("there is no {what} {name:?}\n  help: {known}"))
    })
}

/// Returns the summary of a frame as a dictionary.
fn summary_of<'py>(py: Python<'py>, summary: &FrameSummary) -> PyResult<Bound<'py, PyDict>> {
    let found = PyDict::new(py);
    found.set_item("frame", summary.frame)?;
    found.set_item("steps", summary.steps)?;
    found.set_item("cg_iterations", summary.cg_iterations)?;
    found.set_item("dt_min", summary.dt_min)?;
    found.set_item("dt_max", summary.dt_max)?;
    found.set_item("kinetic_energy", summary.kinetic_energy)?;
    found.set_item("potential_energy", summary.potential_energy)?;
    found.set_item("max_strain", summary.max_strain.as_ref().map_or(0.0, |strain| strain.strain))?;
    found.set_item("next_integrator", summary.next_integrator.map(Integrator::word))?;
    found.set_item("counts", counts(py, summary.metrics.counts())?)?;
    Ok(found)
}

#[pymethods]
impl Simulation {
    #[getter]
    fn name(&self) -> &str {
        &self.about.name
    }

    #[getter]
    fn garments(&self) -> Vec<String> {
        self.about.garments.clone()
    }

    #[getter]
    fn bodies(&self) -> Vec<String> {
        self.about.bodies.clone()
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
    fn frame(&self) -> PyResult<i64> {
        self.session()?.frame().map_err(raised)
    }

    #[getter]
    fn summary<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyDict>>> {
        self.session()?.summary().map(|summary| summary_of(py, summary)).transpose()
    }

    fn move_body(&self, body: &str, positions: PyReadonlyArray2<'_, f64>) -> PyResult<()> {
        let (body, positions) = (number(&self.about.bodies, body, "body")?, arrays::points(&positions, "positions")?);
        self.session()?.move_body(body, &positions).map_err(raised)
    }

    fn set(&self, path: &str, value: Vec<f64>) -> PyResult<()> {
        self.session()?.set_number(path, &value).map_err(raised)
    }

    /// Simulates up to the next frame.
    fn advance(&self, py: Python<'_>) -> PyResult<()> {
        let mut session = self.session()?;
        let session = &mut *session;
        // A session that is cancelled is so by a signal, which is raised in its place.
        on_thread(py, |caller| Ok(session.next_frame(&mut || caller.is_cancelled()).map(drop)?))
    }

    fn positions<'py>(&self, py: Python<'py>, garment: &str) -> PyResult<Bound<'py, PyArray2<f64>>> {
        self.field(py, garment, VertexField::Positions)
    }

    fn velocities<'py>(&self, py: Python<'py>, garment: &str) -> PyResult<Bound<'py, PyArray2<f64>>> {
        self.field(py, garment, VertexField::Velocities)
    }

    fn faces<'py>(&self, py: Python<'py>, garment: &str) -> PyResult<Faces<'py>> {
        let garment = number(&self.about.garments, garment, "garment")?;
        let mesh = self.session()?.shot().map_err(raised)?.garment_mesh(garment).map_err(raised)?.mesh;
        Ok(arrays::faces(py, Connectivity { face_counts: mesh.face_counts, face_indices: mesh.face_indices }))
    }

    fn save(&self) -> PyResult<State> {
        Ok(State(self.session()?.save().map_err(raised)?))
    }

    fn restore(&self, py: Python<'_>, state: &State) -> PyResult<()> {
        let mut session = self.session()?;
        let session = &mut *session;
        on_thread(py, |_| Ok(session.restore(&state.0)?))
    }

    fn save_file(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        let mut session = self.session()?;
        let session = &mut *session;
        on_thread(py, move |_| Ok(session.save_file(&path)?))
    }

    fn restore_file(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        let mut session = self.session()?;
        let session = &mut *session;
        on_thread(py, |_| Ok(session.restore_file(&path)?))
    }
}
