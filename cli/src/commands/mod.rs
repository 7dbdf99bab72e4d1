//! One file a command.

pub(crate) mod check;
pub(crate) mod info;
pub(crate) mod materials;
pub(crate) mod plan;
pub(crate) mod run;
pub(crate) mod schema;
pub(crate) mod verify;
