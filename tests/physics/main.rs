//! Physics against closed forms.

mod amplification_picture;
mod bending;
mod curves;
mod determinism;
mod drag;
mod elastic;
mod fit;
mod free_motion;
mod friction;
mod integrator_choice;
mod listing;
mod long_steps;
mod maps;
mod maps_of_laws;
mod membrane;
mod orders;
mod oscillators;
mod pressure;
mod recovery;
mod seams;
mod shear;
mod statics;
mod stiffening;
mod strain_limit;
mod wind;
