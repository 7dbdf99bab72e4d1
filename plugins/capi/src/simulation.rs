//! Simulations: a scene at some frame, stepped, with bodies that the program moves.

use std::ffi::{CString, c_char, c_void};
use std::sync::Arc;

use drapery_shot::scene_source::SceneSource;
use drapery_shot::session::{Progress, Session};

use crate::arguments::{array, give, place, points, text};
use crate::errors::{drapery_error, guarded};
use crate::handles::{self, Object, freed};
use crate::objects::Simulation;
use crate::scene::drapery_scene;
use crate::{DRAPERY_CANCELLED, DRAPERY_DONE};

/// A scene at some frame. Any thread may use it, one at a time; a call while another is under way is an error.
pub struct drapery_simulation {
    _opaque: [u8; 0],
}

/// Whether to stop. Called at every state free of collisions, from any thread, one at a time: it has to be quick, and may not
/// call a function with the same simulation. `user` is what came with it.
pub type drapery_cancel = Option<unsafe extern "C" fn(user: *mut c_void) -> bool>;

/// Summary of the work done to reach a frame.
#[derive(Clone, Copy, Default)]
#[repr(C)]
pub struct drapery_summary {
    /// Number of the frame.
    pub frame: i64,
    /// Time steps.
    pub steps: u64,
    /// Iterations of all damping solves.
    pub cg_iterations: u64,
    /// Shortest step [s].
    pub dt_min: f64,
    /// Longest step [s].
    pub dt_max: f64,
    /// Kinetic energy at the frame [J].
    pub kinetic_energy: f64,
    /// Potential energy at the frame [J].
    pub potential_energy: f64,
    /// Relative change of the length of the most stretched edge; 0 where there is none.
    pub max_strain: f64,
}

/// Argument with which a callback of C is called, on any thread.
#[derive(Clone, Copy)]
pub(crate) struct User(pub(crate) *mut c_void);

// SAFETY: only callbacks of the caller look through it, and the header says that they are called from any thread.
unsafe impl Send for User {}

/// Asks a callback of C, if there is one.
///
/// # Safety
/// `cancel` may be called with `user`, from any thread, as often as wished.
pub(crate) unsafe fn asks(cancel: drapery_cancel, user: User) -> impl FnMut() -> bool + Send {
    move || {
        // All of it, so that it is sent as one.
        let User(user) = { user };
        // SAFETY: the caller promises it.
        cancel.is_some_and(|cancel| unsafe { cancel(user) })
    }
}

/// A simulation of a scene at its start, with all inputs checked. The scene may be changed or freed afterwards.
///
/// Errors: as drapery_scene_check.
///
/// # Safety
/// `simulation` is the address of a pointer, `error` that of one or null.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn drapery_simulation_new(
    scene: *const drapery_scene,
    simulation: *mut *mut drapery_simulation,
    error: *mut *mut drapery_error,
) -> i32 {
    guarded(error, || {
        let simulation = place(simulation, "simulation")?;
        let source = handles::with(scene, |source: &mut SceneSource| Ok(source.clone()))?;
        let made = Simulation::new(Session::new(source.prepare(None)?))?;
        // SAFETY: it is not null, and the caller promises the rest.
        unsafe { simulation.write(handles::give(Object::Simulation(Arc::new(made.into())))) };
        Ok(DRAPERY_DONE)
    })
}

/// Frees a simulation, and with it all arrays that were looked at. Returns DRAPERY_USAGE for what is no handle of a simulation,
/// was freed before, or is used by a call that has not returned (a callback asks within one), and leaves it alone; null is allowed.
#[unsafe(no_mangle)]
pub extern "C" fn drapery_simulation_free(simulation: *mut drapery_simulation) -> i32 {
    freed(simulation, |object| matches!(object, Object::Simulation(_)))
}

/// Says at which frame the simulation is: that of the start, pre-roll included, at first.
///
/// # Safety
/// `frame` is the address of a number or null, `error` that of a pointer or null.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn drapery_simulation_frame(
    simulation: *const drapery_simulation,
    frame: *mut i64,
    error: *mut *mut drapery_error,
) -> i32 {
    guarded(error, || {
        let here = handles::with(simulation, |s: &mut Simulation| Ok(s.session.frame()?))?;
        // SAFETY: the caller promises it.
        unsafe { give(frame, here) };
        Ok(DRAPERY_DONE)
    })
}

/// Says where the simulation starts, and which the first and the last frame of the shot are; the frames before the first are its
/// pre-roll.
///
/// # Safety
/// `start`, `first` and `last` are addresses of numbers or null, `error` that of a pointer or null.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn drapery_simulation_frames(
    simulation: *const drapery_simulation,
    start: *mut i64,
    first: *mut i64,
    last: *mut i64,
    error: *mut *mut drapery_error,
) -> i32 {
    guarded(error, || {
        let (timeline, frames) = handles::with(simulation, |s: &mut Simulation| {
            let shot = s.session.shot()?;
            Ok((shot.timeline(), shot.frames()))
        })?;
        // SAFETY: the caller promises it.
        unsafe {
            give(start, timeline.start);
            give(first, timeline.origin);
            give(last, frames[1]);
        }
        Ok(DRAPERY_DONE)
    })
}

/// Says the frames per second, as a fraction.
///
/// # Safety
/// `numerator` and `denominator` are addresses of numbers or null, `error` that of a pointer or null.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn drapery_simulation_fps(
    simulation: *const drapery_simulation,
    numerator: *mut u32,
    denominator: *mut u32,
    error: *mut *mut drapery_error,
) -> i32 {
    guarded(error, || {
        let timeline = handles::with(simulation, |s: &mut Simulation| Ok(s.session.shot()?.timeline()))?;
        // SAFETY: the caller promises it.
        unsafe {
            give(numerator, timeline.fps_numerator);
            give(denominator, timeline.fps_denominator);
        }
        Ok(DRAPERY_DONE)
    })
}

/// Puts a body that is a mesh where it is to be at the next frame: `point_count` points of three numbers each, in metres with Y
/// up, as many as the mesh has. All is copied. The body moves there on straight lines and stays until it is put elsewhere: the
/// scene no longer moves it.
///
/// Errors: there is no such body (DRAPERY_USAGE), or it is an analytic shape; points are missing, or are no place, with the vertex;
/// a frame was cancelled on the way and is not finished.
///
/// # Safety
/// The array is as long as it says; `error` is the address of a pointer or null.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn drapery_simulation_move_body(
    simulation: *mut drapery_simulation,
    body: usize,
    positions: *const f64,
    point_count: usize,
    error: *mut *mut drapery_error,
) -> i32 {
    guarded(error, || {
        // SAFETY: the caller promises it.
        let positions = unsafe { points(positions, point_count, "positions") }?;
        handles::with(simulation, |s: &mut Simulation| {
            s.session.move_body(body, &positions)?;
            Ok(DRAPERY_DONE)
        })
    })
}

/// Gives a number of the scene another value from the next frame on, by its path, as in `garment.skirt.stretch.stiffness`,
/// `body.hero.friction` or `gravity.acceleration`: one number, or the three of a vector, in SI units. States do not hold it.
///
/// Errors: the scene has no such number, the value does not fit it, or a curve of the scene changes it; a frame was cancelled on
/// the way and is not finished.
///
/// # Safety
/// The path ends with a zero, the array is as long as it says; `error` is the address of a pointer or null.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn drapery_simulation_set(
    simulation: *mut drapery_simulation,
    path: *const c_char,
    value: *const f64,
    count: usize,
    error: *mut *mut drapery_error,
) -> i32 {
    guarded(error, || {
        // SAFETY: the caller promises it.
        let (path, value) = unsafe { (text(path, "path")?, array(value, count, "value")?) };
        handles::with(simulation, |s: &mut Simulation| {
            s.session.set_number(path, value)?;
            Ok(DRAPERY_DONE)
        })
    })
}

/// Simulates up to the next frame, or until `cancel` says so; null never does. Arrays that were looked at before are gone. Returns
/// DRAPERY_CANCELLED, without an error, where it was cancelled: called again, it resumes, and the result equals that of a frame that
/// was never cancelled, bit for bit.
///
/// Errors: the last frame of the shot is reached; an input breaks; the solver gives up, which leaves the last good state.
///
/// # Safety
/// `cancel` may be called with `user`; `error` is the address of a pointer or null.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn drapery_simulation_advance(
    simulation: *mut drapery_simulation,
    cancel: drapery_cancel,
    user: *mut c_void,
    error: *mut *mut drapery_error,
) -> i32 {
    guarded(error, || {
        handles::with(simulation, |s: &mut Simulation| {
            // SAFETY: the caller promises it.
            let mut cancelled = unsafe { asks(cancel, User(user)) };
            let progress = s.session.next_frame(&mut cancelled)?;
            s.count();
            Ok(if progress == Progress::Cancelled { DRAPERY_CANCELLED } else { DRAPERY_DONE })
        })
    })
}

/// Says what was done to reach the present frame; zeros at the start.
///
/// # Safety
/// `summary` is the address of one or null, `error` that of a pointer or null.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn drapery_simulation_summary(
    simulation: *const drapery_simulation,
    summary: *mut drapery_summary,
    error: *mut *mut drapery_error,
) -> i32 {
    guarded(error, || {
        let found = handles::with(simulation, |s: &mut Simulation| {
            let frame = s.session.frame()?;
            let Some(done) = s.session.summary() else { return Ok(drapery_summary { frame, ..Default::default() }) };
            Ok(drapery_summary {
                frame,
                steps: done.steps,
                cg_iterations: done.cg_iterations,
                dt_min: done.dt_min,
                dt_max: done.dt_max,
                kinetic_energy: done.kinetic_energy,
                potential_energy: done.potential_energy,
                max_strain: done.max_strain.as_ref().map_or(0.0, |strain| strain.strain),
            })
        })?;
        // SAFETY: the caller promises it.
        unsafe { give(summary, found) };
        Ok(DRAPERY_DONE)
    })
}

/// The name of a thing in a list, for as long as the simulation lives.
pub(crate) fn name_in(
    simulation: *const drapery_simulation,
    list: fn(&Simulation) -> &[CString],
    index: usize,
) -> *const c_char {
    let found = handles::with(simulation, |s: &mut Simulation| Ok(list(s).get(index).map(|name| name.as_ptr())));
    found.ok().flatten().unwrap_or(std::ptr::null())
}

/// Length of a list; 0 without a simulation.
pub(crate) fn count_in(simulation: *const drapery_simulation, list: fn(&Simulation) -> &[CString]) -> usize {
    handles::with(simulation, |s: &mut Simulation| Ok(list(s).len())).unwrap_or(0)
}
