//! The targets: each reads one input as far as Drapery would, and asserts what has to hold on the way.

pub mod alembic;
pub mod checkpoint;
pub mod hdf5_cache;
pub mod obj;
pub mod run_folder;
pub mod scene;
pub mod usd;
pub mod usd_cache;

/// A target takes the bytes of one input.
pub type Target = fn(&[u8]);

/// All targets, by the names of their folders in `corpus/`.
pub const TARGETS: [(&str, Target); 8] = [
    ("alembic", alembic::run),
    ("usd", usd::run),
    ("usd_cache", usd_cache::run),
    ("obj", obj::run),
    ("scene", scene::run),
    ("checkpoint", checkpoint::run),
    ("hdf5_cache", hdf5_cache::run),
    ("run_folder", run_folder::run),
];
