//! `[[contact]]`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Contact between two garments, between a garment and a body, or between the layers of one garment.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(in crate::scene_file) struct Contact {
    /// Names of the two, as in ["coat", "lining"]; the same garment twice for its own layers. Where a garment and a body have the
    /// same name, write "garment.NAME" or "body.NAME".
    pub(in crate::scene_file) between: [String; 2],
    /// True if the two ignore each other: they pass through one another, at no cost.
    #[serde(default)]
    pub(in crate::scene_file) ignore: bool,
}
