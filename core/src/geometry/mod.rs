//! Geometry that contact is built on: distances, a bounding volume hierarchy, moving triangle surfaces, analytic shapes.
//!
//! Read in this order: [`distance`] (points, segments, triangles), [`aabb`] and [`bvh`] (boxes over primitives), [`path`] (a point
//! crossing a moving triangle), [`moving_surface`] (an animated triangle body between two samples), [`self_crossing`]
//! (where such a body passes through itself), [`crossings`] (where edges meet triangles, decided exactly), [`shapes`]
//! (half-space, sphere, capsule, cylinder, box), [`surface_binding`] (points that follow a surface), [`face_cuts`] (crossings however
//! faces are cut into triangles), [`coarseness`] (how far coarse cloth has to stand off a coarse body). Lengths are in metres, times in
//! seconds. Queries take `&self`, allocate nothing and may run on any number of threads.

pub mod aabb;
pub(crate) mod attachment;
pub mod bvh;
pub mod coarseness;
pub mod crossings;
pub mod distance;
pub mod face_cuts;
pub mod moving_surface;
pub(crate) mod path;
pub mod random;
pub mod rotation;
pub(crate) mod self_crossing;
pub(crate) mod shape_mesh;
pub mod shapes;
pub mod surface_binding;
pub(crate) mod tolerances;

#[cfg(test)]
pub(crate) mod testing;
