//! Seams of a description.

use crate::scene::FARTHEST;
use crate::scene::described::described;

/// Vertices of garments that are sewn together, pair by pair. The gap of a pair closes evenly from what it is at the start.
///
/// ```
/// use drapery_core::SeamDescription;
/// let pairs = (0..20).map(|row| [row, 100 + row]).collect();
/// let (from, until) = (0.0, 0.5);
/// let seam = SeamDescription { garments: [0, 1], pairs, from, until, rest_gap: Some(0.0), stiffness: 800.0, damping_ratio: 1.0 };
/// assert_eq!(seam.pairs[19], [19, 119]);
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct SeamDescription {
    /// Garment of either side.
    pub garments: [usize; 2],
    /// Pairs of vertices, each by its number in the garment of its side.
    pub pairs: Vec<[u32; 2]>,
    /// Solver time at which the gaps start to close [s].
    pub from: f64,
    /// Solver time from which they are closed [s]; not after `from` closes them at once.
    pub until: f64,
    /// Gap that is left then [m]; `None` takes the larger thickness of the two garments if cloth touches cloth in this
    /// scene, and nothing otherwise.
    pub rest_gap: Option<f64>,
    /// Stiffness of each pair [N/m].
    pub stiffness: f64,
    /// Damping as a fraction of critical damping of the pair.
    pub damping_ratio: f64,
}

described! { SeamDescription as seam {
    "strength", seam.stiffness => Stiffness, default Required, range (1e-12, 1e10),
        "stiffness of each pair, for example \"800 N/m\"";
    "damping_ratio", seam.damping_ratio => None, default Number(1.0), range (0.0, 1e3),
        "damping as a fraction of critical";
    "rest_gap", seam.rest_gap => Length, default Absent, range (0.0, 1e3),
        "gap of the closed seam; left out, the larger thickness of the garments if cloth touches cloth in this \
         scene, otherwise zero";
    "start", seam.from => Time, default Absent, range (-FARTHEST, FARTHEST),
        "start of closing, since the first frame; left out, the start of the simulation";
    "closed", seam.until => Time, default Absent, range (-FARTHEST, FARTHEST),
        "end of closing, since the first frame; left out, the end of the pre-roll, or a second after the start without one";
} }
