//! Elastic bands of a description.

use crate::scene::described::described;

/// An elastic band along edges of a garment.
///
/// ```
/// use drapery_core::scene::ElasticDescription;
/// let waist = ElasticDescription { rest_scale: 0.7, ..ElasticDescription::new(0, vec![0, 1, 2, 3], 30.0) };
/// assert_eq!(waist.vertices.len(), 4);
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct ElasticDescription {
    /// Index of the garment.
    pub garment: usize,
    /// Vertices by their numbers in the garment; edges with both ends among them are elastic.
    pub vertices: Vec<u32>,
    /// Force per unit strain [N].
    pub stiffness: f64,
    /// Relaxed length over that in the rest shape of the garment.
    pub rest_scale: f64,
    /// Damping of each spring as a fraction of critical.
    pub damping_ratio: f64,
}

impl ElasticDescription {
    /// A band of this stiffness [N] that is relaxed in the rest shape.
    pub fn new(garment: usize, vertices: Vec<u32>, stiffness: f64) -> Self {
        Self { garment, vertices, stiffness, rest_scale: 1.0, damping_ratio: 1.0 }
    }

    /// Name of the map of its garment by which ranks are handed the vertices of the band with this number.
    pub(crate) fn map(number: usize) -> String {
        format!("elastic {number}")
    }
}

described! { ElasticDescription as elastic {
    "stiffness", elastic.stiffness => Force, default Required, range (0.0, 1e8),
        "force of the band per unit strain, for example \"30 N\"";
    "rest_scale", elastic.rest_scale => None, default Number(1.0), range (0.01, 10.0),
        "relaxed length over that in the rest shape of the garment: 0.7 gathers the cloth to 70 %";
    "damping_ratio", elastic.damping_ratio => None, default Number(1.0), range (0.0, 1e3),
        "damping of each spring as a fraction of critical";
} }
