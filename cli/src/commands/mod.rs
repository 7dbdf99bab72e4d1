//! One file a command.

pub(crate) mod check;
pub(crate) mod convert;
pub(crate) mod diff;
pub(crate) mod info;
pub(crate) mod materials;
pub(crate) mod plan;
pub(crate) mod report;
pub(crate) mod run;
pub(crate) mod schema;
pub(crate) mod selftest;
pub(crate) mod status;
pub(crate) mod stop;
pub(crate) mod study;
pub(crate) mod verify;
pub(crate) mod view;
pub(crate) mod wedge;
