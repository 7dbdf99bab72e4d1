//! Running a shot: inputs in, frames through the solver, caches out, with checkpoints to go on from and a record of what was
//! measured. The command, and any other door to the solver, runs this.
//!
//! [`Shot::prepare`] checks a scene with its files, [`Shot::run`] simulates and writes it ([`run`]). On many ranks all this
//! happens on rank 0; the others run a [worker loop](remote_simulation::worker_loop). The library never prints.

mod check;
mod checkpoints;
mod error;
pub mod farm;
pub mod fault;
mod frame_digest;
mod inputs;
mod long_frames;
mod pinned;
pub mod quality;
pub mod recorded_frames;
pub mod remote_simulation;
mod render_mesh;
pub mod rules;
pub mod run;
pub mod run_record;
pub mod scene_source;
pub mod session;
mod shot;
mod single_layer;
pub mod steps;
mod towards_frame;

pub use error::ShotError;
pub use shot::{RenderMeshSize, Shot};
