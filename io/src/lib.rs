//! Drapery's files: scenes, meshes, caches, checkpoints.
//!
//! Everything inside the program is in metres, seconds and kilograms with Y up and faces counter-clockwise; files may
//! differ, and are converted where they are read or written. The library never prints.
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
//! assert_eq!(description.scene.garments[0].name, "sheet");
//! ```

pub mod atomic_file;
pub mod attributes;
mod belt;
pub mod cache;
pub mod cache_frames;
pub mod checkpoint;
pub mod convert;
pub mod dump_file;
pub mod duration;
pub mod error;
pub mod file_summary;
pub mod formats;
pub mod garment_mesh;
mod hdf5_file;
pub mod input_file;
pub mod input_motion;
pub mod materials;
pub mod memory;
pub mod memory_mesh;
mod mesh_cut;
pub mod mesh_data;
pub mod mesh_source;
pub mod normals;
pub mod platform;
pub mod rules;
pub mod scene_file;
pub mod sha256;
pub mod shot_description;
pub mod site_file;
pub mod units;
pub mod wind_file;
pub mod written_file;
