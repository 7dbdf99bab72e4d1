//! Physics against closed forms.

mod bending;
mod determinism;
mod free_motion;
mod friction;
mod oscillators;
mod statics;
