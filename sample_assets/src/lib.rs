//! Generators of Drapery's sample bodies, motions and garments: a mannequin that walks and dances, and clothes that are
//! cut from offset surfaces of its rest pose; a coat as cloth and as what is rendered of it. Everything is made by program, in metres, y up, and the same arguments
//! give the same bytes.
//!
//! ```
//! use drapery_assets::export::{Order, Wardrobe};
//!
//! let wardrobe = Wardrobe::make(&Order { resolution: 0.5, ..Order::default() })?;
//! let body = wardrobe.mannequin.points(1.0); // world positions after one second [m]
//! assert_eq!(body.len(), wardrobe.mannequin.rest.points.len());
//! # Ok::<(), drapery_assets::export::ExportError>(())
//! ```

pub mod sdf;

pub mod skeleton;

pub mod anatomy;

pub mod surface_mesh;

pub mod splines;

pub mod motion;

pub mod skinning;

pub mod mannequin;

pub mod remesh;

pub mod garments;

pub mod pins;

pub mod coat;

pub mod obj;

pub mod export;
