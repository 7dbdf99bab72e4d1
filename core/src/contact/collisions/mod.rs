//! Geometric collisions and impact zones: what would pass through something on the way from one collision-free state to the
//! next is stopped (`docs/theory/self_contact.md`).
//!
//! Read in this order: [`collision_loop`] (until nothing collides), [`response`] (to the collisions of one pass), [`impulse`]
//! (of one collision), [`impact_zones`] and [`zone_solvers`] (many together).

pub(crate) mod collision_loop;
pub(crate) mod first_contact;
pub(crate) mod impact_zones;
pub(crate) mod impulse;
pub(crate) mod messages;
pub(crate) mod response;
pub(crate) mod union_find;
pub(crate) mod zone_solvers;
