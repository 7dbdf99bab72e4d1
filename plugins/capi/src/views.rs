//! Views without a copy: arrays that live in a simulation.

use std::ffi::{CString, c_char};
use std::ptr;

use drapery_core::scene::gather::VertexField;
use drapery_shot::fault::{Fault, FaultKind};

use crate::DRAPERY_DONE;
use crate::arguments::give;
use crate::errors::{drapery_error, guarded};
use crate::handles;
use crate::objects::Simulation;
use crate::simulation::{count_in, drapery_simulation, name_in};

fn garments(simulation: &Simulation) -> &[CString] {
    &simulation.garments
}

fn bodies(simulation: &Simulation) -> &[CString] {
    &simulation.bodies
}

fn warnings(simulation: &Simulation) -> &[CString] {
    &simulation.warnings
}

/// Number of garments; 0 for what is no simulation.
#[unsafe(no_mangle)]
pub extern "C" fn drapery_simulation_garment_count(simulation: *const drapery_simulation) -> usize {
    count_in(simulation, garments)
}

/// Name of a garment, counted from 0; null where there is none. Lives as long as the simulation.
#[unsafe(no_mangle)]
pub extern "C" fn drapery_simulation_garment_name(
    simulation: *const drapery_simulation,
    garment: usize,
) -> *const c_char {
    name_in(simulation, garments, garment)
}

/// Number of bodies; 0 for what is no simulation.
#[unsafe(no_mangle)]
pub extern "C" fn drapery_simulation_body_count(simulation: *const drapery_simulation) -> usize {
    count_in(simulation, bodies)
}

/// Name of a body, counted from 0; null where there is none. Lives as long as the simulation.
#[unsafe(no_mangle)]
pub extern "C" fn drapery_simulation_body_name(simulation: *const drapery_simulation, body: usize) -> *const c_char {
    name_in(simulation, bodies, body)
}

/// Number of warnings of the scene: what is suspicious but was accepted; 0 for what is no simulation.
#[unsafe(no_mangle)]
pub extern "C" fn drapery_simulation_warning_count(simulation: *const drapery_simulation) -> usize {
    count_in(simulation, warnings)
}

/// A warning, counted from 0; null where there is none. Lives as long as the simulation.
#[unsafe(no_mangle)]
pub extern "C" fn drapery_simulation_warning(simulation: *const drapery_simulation, warning: usize) -> *const c_char {
    name_in(simulation, warnings, warning)
}

/// Gives the positions of a garment at the present state: three numbers for each point in the order of its mesh, in metres with
/// Y up. The array lives until the simulation advances, is restored or is freed; `point_count` counts points, not numbers.
///
/// # Safety
/// `positions` and `point_count` are addresses or null, `error` is that of a pointer or null.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn drapery_simulation_positions(
    simulation: *const drapery_simulation,
    garment: usize,
    positions: *mut *const f64,
    point_count: *mut usize,
    error: *mut *mut drapery_error,
) -> i32 {
    let (found, code) = field(simulation, garment, VertexField::Positions, error);
    // SAFETY: the caller promises it.
    unsafe { give_array(found, positions, point_count) };
    code
}

/// Gives the velocities of a garment at the present state in metres per second, as drapery_simulation_positions gives its
/// positions.
///
/// # Safety
/// `velocities` and `point_count` are addresses or null, `error` is that of a pointer or null.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn drapery_simulation_velocities(
    simulation: *const drapery_simulation,
    garment: usize,
    velocities: *mut *const f64,
    point_count: *mut usize,
    error: *mut *mut drapery_error,
) -> i32 {
    let (found, code) = field(simulation, garment, VertexField::Velocities, error);
    // SAFETY: the caller promises it.
    unsafe { give_array(found, velocities, point_count) };
    code
}

/// The address of an array and its length; null and 0 after an error.
type Array<T> = (*const T, usize);

fn field(
    simulation: *const drapery_simulation,
    garment: usize,
    field: VertexField,
    error: *mut *mut drapery_error,
) -> (Array<f64>, i32) {
    let mut found = (ptr::null(), 0);
    let code = guarded(error, || {
        found = handles::with(simulation, |s: &mut Simulation| {
            let values = s.session.field(garment, field)?;
            Ok((bytemuck::cast_slice::<_, f64>(values).as_ptr(), values.len()))
        })?;
        Ok(DRAPERY_DONE)
    });
    (found, code)
}

/// # Safety
/// `place` and `count` are addresses or null.
unsafe fn give_array<T>((array, length): Array<T>, place: *mut *const T, count: *mut usize) {
    // SAFETY: the caller promises it.
    unsafe {
        give(place, array);
        give(count, length);
    }
}

/// Gives the faces of a garment: the number of corners of each, and the point of each corner, counter-clockwise seen from
/// outside. The arrays live as long as the simulation.
///
/// # Safety
/// The places are addresses or null, `error` is that of a pointer or null.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn drapery_simulation_faces(
    simulation: *const drapery_simulation,
    garment: usize,
    face_counts: *mut *const u32,
    face_count: *mut usize,
    corners: *mut *const u32,
    corner_count: *mut usize,
    error: *mut *mut drapery_error,
) -> i32 {
    let mut found = [(ptr::null(), 0); 2];
    let code = guarded(error, || {
        found = handles::with(simulation, |s: &mut Simulation| {
            let (count, shot) = (s.meshes.len(), s.session.shot()?);
            let Some(kept) = s.meshes.get_mut(garment) else {
                let text = format!("garment {garment}: the scene has {count} garments, counted from 0");
                return Err(Fault::new(FaultKind::Usage, text));
            };
            let data = match kept {
                Some(data) => data,
                None => kept.insert(shot.garment_mesh(garment)?),
            };
            Ok([&data.mesh.face_counts, &data.mesh.face_indices].map(|array| (array.as_ptr(), array.len())))
        })?;
        Ok(DRAPERY_DONE)
    });
    let [counts, indices] = found;
    // SAFETY: the caller promises it.
    unsafe {
        give_array(counts, face_counts, face_count);
        give_array(indices, corners, corner_count);
    }
    code
}

/// Number of things that were counted on the way to the present frame, such as steps that were tried again; 0 at the start.
#[unsafe(no_mangle)]
pub extern "C" fn drapery_simulation_metric_count(simulation: *const drapery_simulation) -> usize {
    handles::with(simulation, |s: &mut Simulation| Ok(s.counts.len())).unwrap_or(0)
}

/// Gives what was counted, numbered from 0: its name, which lives until the simulation advances, is restored or is freed, and
/// how many there were. Returns false where there is none. The names are explained in docs/reference/counts.md.
///
/// # Safety
/// `name` and `value` are addresses or null.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn drapery_simulation_metric(
    simulation: *const drapery_simulation,
    metric: usize,
    name: *mut *const c_char,
    value: *mut u64,
) -> bool {
    let found = handles::with(simulation, |s: &mut Simulation| {
        Ok(s.counts.get(metric).map(|(name, amount)| (name.as_ptr(), *amount)))
    });
    let Some((text, amount)) = found.ok().flatten() else { return false };
    // SAFETY: the caller promises it.
    unsafe {
        give(name, text);
        give(value, amount);
    }
    true
}
