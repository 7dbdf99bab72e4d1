//! The broad phase: pairs that are close, or that may meet on their paths.
//!
//! Read in this order: [`bvh_search`] (trees over triangles, around points or paths), [`ghost_triangles`] (those of other
//! ranks), [`proximity_list`] (pairs within a cutoff, kept until they may be out of date), [`pair_replication`] (to all
//! ranks that own a node), [`skin`] (how long the cutoff is), [`common_rigid_motion`] (what moves alike brings nothing closer).

pub(crate) mod bvh_search;
pub(crate) mod common_rigid_motion;
pub(crate) mod ghost_triangles;
pub(crate) mod pair_replication;
pub(crate) mod proximity_list;
pub(crate) mod skin;
