//! `[[seam]]`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::garment::{Corner, Region};
use super::values::Quantity;
use crate::scene_file::ranges::fractions;

/// Vertices that are drawn together and stay together, of one garment or of two.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(in crate::scene_file) struct Seam {
    /// The vertices of one side.
    pub(in crate::scene_file) from: SeamSide,
    /// The vertices of the other side.
    pub(in crate::scene_file) to: SeamSide,
    /// How the sides are paired: "order" takes the first with the first and so on, "nearest" sews every vertex of `from` to
    /// the one of `to` that is nearest at the start. Left out: "order" where both sides list their `vertices`.
    #[serde(default)]
    pub(in crate::scene_file) pairing: Pairing,
    /// Stiffness of each pair, in N/m or as "800 N/m".
    #[schemars(range(min = 1e-12, max = 1e10))]
    pub(in crate::scene_file) strength: Quantity,
    /// Damping as a fraction of critical.
    #[serde(default = "one")]
    #[schemars(range(min = 0.0, max = 1e3))]
    pub(in crate::scene_file) damping_ratio: f64,
    /// What is left of the gap, in metres or as "0 mm". Left out: the larger thickness of the garments if cloth touches cloth
    /// in this scene, otherwise nothing.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.0, max = 1e3))]
    pub(in crate::scene_file) rest_gap: Option<Quantity>,
    /// When it starts to close, in seconds since the first frame. Left out: when the simulation starts.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = -1e9, max = 1e9))]
    pub(in crate::scene_file) start: Option<f64>,
    /// When it is closed, in seconds since the first frame. Left out: at the end of the pre-roll, or a second after the start
    /// if there is none.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = -1e9, max = 1e9))]
    pub(in crate::scene_file) closed: Option<f64>,
}

fn one() -> f64 {
    1.0
}

/// How the two sides of a seam are paired.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub(in crate::scene_file) enum Pairing {
    /// In order where both sides list their vertices, otherwise to the nearest.
    #[default]
    Auto,
    /// The first with the first.
    Order,
    /// Each of `from` with the nearest of `to`.
    Nearest,
}

/// Vertices of one side of a seam. Say which by one of `vertices`, `corners`, `nodes` and `where`.
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
