//! Drapery for Python: the module `drapery._native`, of which the package `drapery` in `python/` is made. What it does is that of
//! `drapery_shot`, `drapery_io` and `drapery_analysis`; how it is used is described in `docs/reference/python.md`.
//!
//! ```python
//! simulation = scene.simulate()
//! while simulation.frame < simulation.last_frame:
//!     frame = simulation.advance()
//! ```
//!
//! Doc tests are in Rust, so this one is not run; the examples of the page are, by `plugins/python/tests/test_analysis.py`.

mod about;
mod analysis;
mod arrays;
mod caches;
mod errors;
mod files;
mod on_thread;
mod scene;
mod simulation;
mod values;

use std::ffi::OsString;
use std::path::PathBuf;

use drapery_command::Invocation;
use drapery_shot::fault::{Fault, FaultKind};
use pyo3::prelude::*;

/// Sets the number of threads of all simulations of this process; 0 takes one for each processor.
#[pyfunction]
fn set_threads(count: usize) -> PyResult<()> {
    rayon::ThreadPoolBuilder::new().num_threads(count).build_global().map_err(|error| {
        let text = format!("{count} threads: {error}\n  help: set their number once, before anything else");
        errors::raised(Fault::new(FaultKind::Usage, text))
    })
}

/// Does what a command line says, its first word being the name of the program; returns the exit code, with which the process
/// has to end.
#[pyfunction]
fn command(py: Python<'_>, words: Vec<OsString>, program: Option<PathBuf>) -> u8 {
    py.detach(|| drapery_command::command(&Invocation { words, program }))
}

/// The module.
#[pymodule]
fn _native(module: &Bound<'_, PyModule>) -> PyResult<()> {
    drapery_command::pass_answers();
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add_function(wrap_pyfunction!(set_threads, module)?)?;
    module.add_function(wrap_pyfunction!(command, module)?)?;
    module.add_function(wrap_pyfunction!(values::toml_of, module)?)?;
    module.add_function(wrap_pyfunction!(values::content_of, module)?)?;
    module.add_function(wrap_pyfunction!(analysis::verify_caches, module)?)?;
    module.add_function(wrap_pyfunction!(analysis::make_study, module)?)?;
    module.add_function(wrap_pyfunction!(analysis::study_of, module)?)?;
    module.add_function(wrap_pyfunction!(analysis::list_materials, module)?)?;
    module.add_function(wrap_pyfunction!(files::convert_cache, module)?)?;
    module.add_function(wrap_pyfunction!(files::diff_results, module)?)?;
    module.add_function(wrap_pyfunction!(files::write_report, module)?)?;
    module.add_function(wrap_pyfunction!(files::compare, module)?)?;
    module.add_function(wrap_pyfunction!(files::write_view, module)?)?;
    module.add_function(wrap_pyfunction!(files::info, module)?)?;
    module.add_class::<scene::Scene>()?;
    module.add_class::<scene::Shot>()?;
    module.add_class::<simulation::Simulation>()?;
    module.add_class::<simulation::State>()?;
    module.add_class::<caches::Cache>()?;
    module.add_class::<caches::CacheWriter>()
}
