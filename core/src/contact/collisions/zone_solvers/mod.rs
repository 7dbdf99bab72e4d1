//! Impact zones: many contacts of cloth with cloth answered together, where one impulse after another does not end.
//!
//! [`inelastic`] changes the velocities of a zone as little as possible, measured by mass, such that no contact of
//! it closes; nodes still slide along each other. [`rigid`] lets a zone move as one body
//! (`docs/theory/self_contact.md#impact-zones`): its shape is then that of the collision-free state, and nothing inside
//! it can have collided. Both keep linear and angular momentum and never add kinetic energy. [`carried`] lets a zone follow
//! what is prescribed in it. None moves what is prescribed.

mod carried;
mod inelastic;
mod rigid;

pub(crate) use carried::carried;
pub(crate) use inelastic::inelastic;
pub(crate) use rigid::{ZoneNode, rigid};

#[cfg(test)]
mod tests;
