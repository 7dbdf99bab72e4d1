//! The catalogue, in the order of its numbers.

mod contact;
mod geometry;
mod inputs;
mod numbers;
mod running;
mod stiffness;

use crate::case::Case;
pub(crate) use contact::add_mesh_body;

/// All hard cases.
pub static CATALOGUE: &[Case] = &[
    stiffness::H1,
    stiffness::H2,
    stiffness::H3,
    stiffness::H4,
    stiffness::H5,
    stiffness::H6,
    stiffness::H7,
    stiffness::H8,
    stiffness::H9,
    stiffness::H10,
    geometry::H11,
    geometry::H12,
    geometry::H13,
    geometry::H14,
    geometry::H15,
    geometry::H16,
    inputs::H17,
    geometry::H18,
    geometry::H19,
    geometry::H20,
    geometry::H21,
    geometry::H22,
    contact::H23,
    contact::H24,
    contact::H25,
    contact::H26,
    contact::H27,
    contact::H28,
    contact::H29,
    contact::H30,
    contact::H31,
    contact::H32,
    contact::H33,
    contact::H34,
    contact::H35,
    contact::H36,
    contact::H37,
    numbers::H38,
    numbers::H39,
    numbers::H40,
    numbers::H41,
    inputs::H42,
    inputs::H43,
    inputs::H44,
    inputs::H45,
    inputs::H46,
    running::H47,
    running::H48,
    running::H49,
    running::H50,
    running::H51,
    running::H52,
];
