//! Running a shot: inputs in, frames through the solver, caches out, with checkpoints to go on from and a record of what was
//! measured. The command, and any other door to the solver, runs this.
//!
//! [`Shot::prepare`] checks a scene with its files, [`Shot::run`] simulates and writes it ([`run`]). On many ranks all this
//! happens on rank 0; the others run a [worker loop](remote_simulation::worker_loop). The library never prints.
//!
//! ```
//! let text = r#"
//! drapery = 1
//! [shot]
//! frames = "1-24"
//! [gravity]
//! [[garment]]
//! name = "sheet"
//! material = "cotton_shirting"
//! panel = { resolution = 4 }
//! "#;
//! let scene = drapery_io::scene_file::parse(text, "scene.toml", "".as_ref(), &[]).unwrap_or_else(|e| panic!("{e}"));
//! let description = scene.resolve().unwrap_or_else(|errors| panic!("{}", errors[0]));
//! let shot = drapery_shot::Shot::prepare(description, None).unwrap_or_else(|problem| panic!("{problem}"));
//! assert!(shot.warnings().is_empty());
//! ```

mod check;
mod checkpoints;
mod error;
pub mod farm;
pub mod fault;
mod frame_digest;
mod inputs;
mod long_frames;
mod loose_points;
mod overstretched;
mod pinned;
mod point_attributes;
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
mod written_faces;

pub use error::ShotError;
pub use shot::{RenderMeshSize, Shot, check_description, last_frame};
