//! Geometry that can touch: the nodes of contact (own vertices of cloth, copies of other ranks', points of bodies),
//! the faces, edges and vertices between them, and the pairs of these.
//!
//! Read in this order: [`pair`] (a point and a triangle, or two edges), [`nodes`] (their numbers on this rank and in the
//! scene), [`faces`], [`cloth_surface`] (what a rank brings in), [`pair_friction`],
//! [`wearing_order`] (which garment is outside), [`surface`] (all of it),
//! [`common_rigid_motion`] (what moves alike brings nothing closer).

pub(crate) mod body_points;
pub(crate) mod cloth_surface;
pub(crate) mod common_rigid_motion;
pub(crate) mod faces;
pub(crate) mod nodes;
pub(crate) mod pair;
pub(crate) mod pair_friction;
pub(crate) mod surface;
pub(crate) mod wearing_order;
