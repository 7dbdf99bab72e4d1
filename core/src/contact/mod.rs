//! Contact: friction on bodies, and everything that keeps cloth from passing through cloth.
//!
//! The rooms are the pipeline of contact, in the order in which they are used, and each imports only those above it:
//! `topology` (what can touch), [`ccd`] (when two primitives meet), `broad_phase` (which may), `colouring` (pairs that can be
//! answered at once), [`bodies`] (what cloth rests on), `repulsion` (impulses in every time step), `collisions` (what is
//! stopped at the end of a collision step), `intersections` (what crosses although nothing should), `self_contact` (one
//! collision step of all this).

pub mod bodies;
pub(crate) mod broad_phase;
pub mod ccd;
pub(crate) mod collisions;
pub(crate) mod colouring;
pub(crate) mod intersections;
pub(crate) mod repulsion;
pub(crate) mod self_contact;
pub(crate) mod tolerances;
pub(crate) mod topology;

#[cfg(test)]
pub(crate) mod testing;
