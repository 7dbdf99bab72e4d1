//! Physics against closed forms.

mod determinism;
mod drag;
mod free_motion;
mod friction;
mod membrane;
mod oscillators;
mod shear;
mod statics;
mod strain_limit;
