//! `[[seam]]`.

use drapery_core::settings::{Default, Dimension, Field, choice};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::garment::{Corner, Region};
use super::place_schemas::fractions;

/// Vertices that are drawn together, of one garment or of two: a seam, a button, a zip (docs/howto/closures.md).
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(in crate::scene_file) struct Seam {
    /// The vertices of one side.
    pub(in crate::scene_file) from: SeamSide,
    /// The vertices of the other side.
    pub(in crate::scene_file) to: SeamSide,
}

choice! {
    /// Pairing of the two sides of a seam.
    pub(in crate::scene_file) enum Pairing {
        /// In order where both sides list their `vertices`, otherwise to the nearest.
        Auto = "auto",
        /// The first with the first and so on.
        Order = "order",
        /// Every vertex of `from` with the one of `to` that is nearest at the start.
        Nearest = "nearest",
        /// Every vertex of `from` with the point of the faces of the garment of `to` that is nearest at the start; `to` names no
        /// vertices then.
        Surface = "surface",
    }
}

/// The row of `pairing`, which becomes the pairs of a seam.
pub(in crate::scene_file) const PAIRING: Field = Field {
    name: "pairing",
    dimension: Dimension::None,
    default: Default::Choice("auto", Pairing::WORDS),
    range: (0.0, 0.0),
    help: "how the sides are paired",
};

/// Vertices of one side of a seam. One of `vertices`, `corners`, `nodes` and `where` selects them; none in `to` with
/// `pairing = "surface"`.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(in crate::scene_file) struct SeamSide {
    /// Name of the garment.
    pub(in crate::scene_file) garment: String,
    /// Vertex numbers, from 0, in the order of the garment's file.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(in crate::scene_file) vertices: Option<Vec<u32>>,
    /// Corners of a panel: "i0j0", "inj0", "i0jn", "injn" (i along x, j along z).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(in crate::scene_file) corners: Option<Vec<Corner>>,
    /// Nodes of a panel nearest to fractions of its length along x and z: [[0.5, 0], …].
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(transform = fractions)]
    pub(in crate::scene_file) nodes: Option<Vec<[f64; 2]>>,
    /// A region: vertices that start inside are sewn.
    #[serde(rename = "where", skip_serializing_if = "Option::is_none")]
    pub(in crate::scene_file) region: Option<Region>,
}
