//! States to go back to, in memory and in files.

use std::ffi::c_char;
use std::path::Path;
use std::sync::Arc;

use drapery_shot::session::SavedState;

use crate::DRAPERY_DONE;
use crate::arguments::{place, text};
use crate::errors::{drapery_error, guarded};
use crate::handles::{self, Object, freed};
use crate::objects::Simulation;
use crate::simulation::drapery_simulation;

/// A state of a simulation. It belongs to that simulation; others of the same scene take it from a file.
pub struct drapery_state {
    _opaque: [u8; 0],
}

/// Saves the present state in memory.
///
/// # Safety
/// `state` is the address of a pointer, `error` that of one or null.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn drapery_simulation_save(
    simulation: *const drapery_simulation,
    state: *mut *mut drapery_state,
    error: *mut *mut drapery_error,
) -> i32 {
    guarded(error, || {
        let state = place(state, "state")?;
        let saved = handles::with(simulation, |s: &mut Simulation| Ok(s.session.save()?))?;
        // SAFETY: it is not null, and the caller promises the rest.
        unsafe { state.write(handles::give(Object::State(Arc::new(saved.into())))) };
        Ok(DRAPERY_DONE)
    })
}

/// Goes back to a state, or forward; from there the frames have the same bits as before. Arrays that were looked at are gone.
///
/// Errors: the state belongs to another simulation.
///
/// # Safety
/// `error` is the address of a pointer or null.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn drapery_simulation_restore(
    simulation: *mut drapery_simulation,
    state: *const drapery_state,
    error: *mut *mut drapery_error,
) -> i32 {
    guarded(error, || {
        handles::with(state, |state: &mut SavedState| {
            handles::with(simulation, |s: &mut Simulation| {
                s.session.restore(state)?;
                s.count();
                Ok(DRAPERY_DONE)
            })
        })
    })
}

/// Frees a state. Returns DRAPERY_USAGE for what is no handle of a state, was freed before, or is used by a call that has not
/// returned, and leaves it alone; null is allowed.
#[unsafe(no_mangle)]
pub extern "C" fn drapery_state_free(state: *mut drapery_state) -> i32 {
    freed(state, |object| matches!(object, Object::State(_)))
}

/// Saves the present state in a file, which appears as a whole or not at all.
///
/// Errors: the file cannot be written; an input of the scene can no longer be read.
///
/// # Safety
/// `path` ends with a zero; `error` is the address of a pointer or null.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn drapery_simulation_save_file(
    simulation: *const drapery_simulation,
    path: *const c_char,
    error: *mut *mut drapery_error,
) -> i32 {
    guarded(error, || {
        // SAFETY: the caller promises it.
        let path = unsafe { text(path, "path") }?;
        handles::with(simulation, |s: &mut Simulation| {
            s.session.save_file(Path::new(path))?;
            Ok(DRAPERY_DONE)
        })
    })
}

/// Resumes from the state in a file, which a simulation of the same scene with the same inputs has saved, or a run of it as its
/// checkpoint: in any process, on any number of threads, with the same bits. Arrays that were looked at are gone.
///
/// Errors: the file is missing, damaged or of another shot.
///
/// # Safety
/// `path` ends with a zero; `error` is the address of a pointer or null.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn drapery_simulation_restore_file(
    simulation: *mut drapery_simulation,
    path: *const c_char,
    error: *mut *mut drapery_error,
) -> i32 {
    guarded(error, || {
        // SAFETY: the caller promises it.
        let path = unsafe { text(path, "path") }?;
        handles::with(simulation, |s: &mut Simulation| {
            s.session.restore_file(Path::new(path))?;
            s.count();
            Ok(DRAPERY_DONE)
        })
    })
}
