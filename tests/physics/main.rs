//! Physics against closed forms.

mod bending;
mod determinism;
mod fit;
mod free_motion;
mod friction;
mod orders;
mod oscillators;
mod pressure;
mod seams;
mod statics;
mod wind;
