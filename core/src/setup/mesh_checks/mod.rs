//! Meshes as they were read: faces without area, vertices at one point, faces that are turned.

pub(crate) mod coincident;
pub(crate) mod degenerate;
pub(crate) mod winding;
