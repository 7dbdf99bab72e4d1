//! The implicit part of a step: backward Euler on the damping forces.

pub mod conjugate_gradient;
pub mod implicit_velocity;
