//! Ranks and threads: that they can speak with each other, and that their number changes nothing.

mod bits;
mod communicators;
mod contact_bits;
mod handing_out;
mod odd_meshes;
