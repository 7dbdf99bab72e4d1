//! Physics against closed forms.

mod free_motion;
mod friction;
mod oscillators;
mod statics;
