//! A scene over its ranks: rank 0 reads the meshes piece by piece, no rank ever has all of one.
//!
//! Read in this order: `description_message` (what every rank has to know), `block_rows` and `even_blocks` (even blocks of
//! what was read), `bisection` (the order of the vertices), `one_ring` (what lies around them), `scatter` (to the ranks),
//! `submesh` (what a rank has then, and hands on when work is balanced).

pub(crate) mod bisection;
pub(crate) mod block_rows;
pub(crate) mod description_message;
pub(crate) mod even_blocks;
pub(crate) mod one_ring;
pub(crate) mod scatter;
pub(crate) mod submesh;
