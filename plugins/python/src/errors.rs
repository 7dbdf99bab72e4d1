//! Exceptions with the parts of a fault: the classes of `drapery._errors`.

use std::sync::TryLockError;

use drapery_shot::fault::{Fault, FaultKind};
use pyo3::prelude::*;
use pyo3::types::PyType;

/// Name of the exception for a kind of fault.
fn class_of(kind: FaultKind) -> &'static str {
    match kind {
        FaultKind::Usage => "UsageError",
        FaultKind::Scene => "SceneError",
        FaultKind::BadInput | FaultKind::MissingInput => "InputError",
        FaultKind::SolverGaveUp => "SolverError",
        FaultKind::CannotCreate | FaultKind::Io => "OutputError",
        FaultKind::NoMemory => "NoMemoryError",
        FaultKind::Internal => "InternalError",
    }
}

/// A fault as an exception.
pub(crate) fn raised(fault: impl Into<Fault>) -> PyErr {
    let Fault { kind, message, object, frame, element } = fault.into();
    Python::attach(|py| {
        let class = py.import("drapery._errors").and_then(|module| module.getattr(class_of(kind)));
        match class.and_then(|class| Ok(class.cast_into::<PyType>()?)) {
            Ok(class) => PyErr::from_type(class, (message, kind as u8, object, frame, element)),
            // The package is broken, which is worse than the fault.
            Err(error) => error,
        }
    })
}

/// An exception for what is not possible.
pub(crate) fn usage(text: impl Into<String>) -> PyErr {
    raised(Fault::new(FaultKind::Usage, text))
}

/// An exception for something that another call uses, or that a bug has broken.
pub(crate) fn in_use<T>(what: &str, error: &TryLockError<T>) -> PyErr {
    match error {
        TryLockError::WouldBlock => {
            usage(format!("another call uses this {what}\n  help: wait for it to return; one thread at a time"))
        }
        TryLockError::Poisoned(_) => {
            let text = format!("a bug in Drapery has broken this {what}\n  help: make another");
            raised(Fault::new(FaultKind::Internal, text))
        }
    }
}
