//! The broad phase: pairs that are close, or that may meet on their paths.
//!
//! Read in this order: [`ghost_triangles`] (those of other ranks), [`bvh_search`] (trees over triangles), [`candidate_pair`] (and
//! the ranks that know it), [`proximity_list`] (pairs within
//! a cutoff, kept until they may be out of date), [`skin`] (how far beyond contact the cutoff is), [`swept_search`] (around
//! paths).

pub(crate) mod bvh_search;
pub(crate) mod candidate_pair;
pub(crate) mod ghost_triangles;
pub(crate) mod proximity_list;
pub(crate) mod skin;
pub(crate) mod swept_search;
