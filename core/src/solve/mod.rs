//! Velocity solves: conjugate gradients without a matrix for half a step, with an assembled matrix for a long one.

mod block_jacobi;
mod block_system;
pub mod conjugate_gradient;
mod constraints;
pub mod force_evaluation;
mod ghost_directions;
pub mod implicit_velocity;
mod multilevel;
pub(crate) mod pair_terms;
pub mod preconditioned_cg;
pub(crate) mod volume_terms;
