//! Drapery for programs in C and C++: `drapery.h`, which is made of this crate, and what stands behind it.
//!
//! Handles are numbers in the form of pointers, looked up at every call ([`handles`]): one that was freed, or is of another
//! kind, is an error. No panic crosses the border: it becomes an error, and the handle is of no more use. What the functions do
//! is that of `drapery_shot::session`; how to use them is described in `docs/reference/c_api.md`.
//!
//! ```c
//! drapery_simulation_new(scene, &simulation, &error);
//! while (frame < last) {
//!     drapery_simulation_move_body(simulation, body, positions, point_count, &error);
//!     drapery_simulation_advance(simulation, cancel, user, &error);
//!     drapery_simulation_positions(simulation, garment, &points, &count, &error);
//! }
//! ```
//!
//! Doc tests are in Rust, so this one is not run; whole programs of it are, in C and C++, by `tests/c_programs.rs`.

// The names that C programs see.
#![allow(non_camel_case_types)]

mod arguments;
mod errors;
mod handles;
mod objects;
mod run;
mod scene;
mod simulation;
mod state;
mod views;

use std::ffi::c_char;

use drapery_shot::fault::{Fault, FaultKind};

pub use errors::*;
pub use run::*;
pub use scene::*;
pub use simulation::*;
pub use state::*;
pub use views::*;

/// Version of the interface that this header is of. Functions are added to a version and never taken away or changed; a program
/// that was built with an older header of the same version keeps working.
pub const DRAPERY_ABI_VERSION: u32 = 1;

/// Everything is as it was asked for.
pub const DRAPERY_DONE: i32 = 0;

/// The request is not possible: a handle of another kind, a null pointer, a frame that the shot does not have.
pub const DRAPERY_USAGE: i32 = 2;

/// An input holds data that cannot be used.
pub const DRAPERY_BAD_INPUT: i32 = 65;

/// An input file is missing.
pub const DRAPERY_MISSING_INPUT: i32 = 66;

/// A bug in Drapery itself. The handle that was used can only be freed.
pub const DRAPERY_INTERNAL: i32 = 70;

/// The machine has too little memory for the shot.
pub const DRAPERY_NO_MEMORY: i32 = 71;

/// An output could not be created, or holds another run.
pub const DRAPERY_CANNOT_CREATE: i32 = 73;

/// Reading or writing failed.
pub const DRAPERY_IO: i32 = 74;

/// A callback has cancelled it; called again, it resumes there.
pub const DRAPERY_CANCELLED: i32 = 75;

/// The scene is wrong.
pub const DRAPERY_SCENE: i32 = 78;

/// The solver gave up.
pub const DRAPERY_SOLVER_GAVE_UP: i32 = 80;

/// Version of the interface of the library that is loaded: a program compares it with DRAPERY_ABI_VERSION of its header.
#[unsafe(no_mangle)]
pub extern "C" fn drapery_abi_version() -> u32 {
    DRAPERY_ABI_VERSION
}

/// Name and version of the library, for messages; never null, never to be freed.
#[unsafe(no_mangle)]
pub extern "C" fn drapery_version() -> *const c_char {
    concat!("Drapery ", env!("CARGO_PKG_VERSION"), "\0").as_ptr().cast()
}

/// Sets the number of threads of all simulations of this process; 0 takes one for each processor. To be called once, before
/// anything is simulated; without it there is one for each processor. The number of threads changes no bit of a result.
///
/// Errors: threads run already.
#[unsafe(no_mangle)]
pub extern "C" fn drapery_set_threads(count: usize, error: *mut *mut drapery_error) -> i32 {
    errors::guarded(error, || {
        rayon::ThreadPoolBuilder::new().num_threads(count).build_global().map_err(|e| {
            Fault::new(FaultKind::Usage, format!("{count} threads: {e}\n  help: set them before anything else, once"))
        })?;
        Ok(DRAPERY_DONE)
    })
}
