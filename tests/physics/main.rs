//! Physics against closed forms.

mod determinism;
mod free_motion;
mod friction;
mod maps;
mod oscillators;
mod pressure;
mod seams;
mod statics;
mod wind;
