//! Vertices whose motion is prescribed: [`hard`] pins replace the motion of their vertices, the `attachments` effect holds by
//! springs instead. Both follow the same [`targets`].

pub mod hard;
pub mod mobility;
pub mod targets;

pub use hard::HardPins;
pub(crate) use hard::{BEHIND, STRETCHED};
pub use mobility::Mobility;
pub use targets::PinTargets;
pub(crate) use targets::SECTION;
