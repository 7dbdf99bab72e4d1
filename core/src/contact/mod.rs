//! Contact: friction on bodies, and everything that keeps cloth from passing through cloth.
//!
//! Read in this order: `pair`, `nodes` and `surface` (what can touch), `search` and `neighbours` (what is close), `repulsion`
//! (impulses in every time step), `ccd`, `geometric`, `zones` (what is stopped at the end of a collision step),
//! `self_contact` (one collision step).

pub mod ccd;
mod colouring;
pub mod common_motion;
mod components;
pub mod exact_check;
pub mod faces;
pub mod friction;
pub mod geometric;
pub mod holders;
pub mod impact_zone;
pub mod impulse;
pub mod neighbours;
pub mod nodes;
pub mod ordering;
mod packing;
pub mod pair;
pub mod repulsion;
pub mod search;
pub mod self_contact;
pub mod share;
pub mod shared;
mod step_control;
pub mod supports;
pub mod surface;
#[cfg(test)]
pub(crate) mod testing;
pub mod tolerances;
pub mod untangle;
pub mod visitors;
pub mod zones;
