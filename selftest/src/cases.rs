//! The catalogue, in the order of its numbers.

mod contact;
mod geometry;
mod inputs;
mod numbers;
mod running;
mod stiffness;

use crate::case::Case;

/// All hard cases.
pub static CATALOGUE: &[Case] = &[
    stiffness::H1,
    stiffness::H2,
    stiffness::H3,
    stiffness::H4,
    stiffness::H5,
    stiffness::H7,
    stiffness::H8,
    stiffness::H10,
    geometry::H13,
    geometry::H18,
    geometry::H19,
    geometry::H22,
    contact::H23,
    contact::H33,
    numbers::H38,
    numbers::H39,
    numbers::H40,
    numbers::H41,
    inputs::H17,
    running::H47,
    running::H50,
];
