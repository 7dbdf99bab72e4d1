//! Velocity solves: conjugate gradients without a matrix for half a step, with an assembled matrix for a long one.

pub mod conjugate_gradient;
pub mod implicit_velocity;
pub mod preconditioned_cg;
mod preconditioner;
