//! Vertices whose motion is prescribed: [`hard`] pins replace the motion of their vertices, the `attachments` effect holds by
//! springs instead. Both follow the same [`targets`].

pub(crate) mod hard;
pub(crate) mod mobility;
pub(crate) mod targets;

pub use hard::HardPins;
pub(crate) use hard::{BEHIND, STRETCHED};
pub(crate) use mobility::Mobility;
pub use targets::PinTargets;
pub(crate) use targets::SECTION;
