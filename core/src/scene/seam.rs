//! Seams of a description.

use crate::scene::FARTHEST;
use crate::scene::described::described;

/// Vertices of garments that are sewn together, pair by pair: a seam, a button or a zip. The gap of a pair closes evenly from what it is
/// at the start; a zip pulls one pair after the other.
///
/// ```
/// use drapery_core::SeamDescription;
/// let pairs = (0..20).map(|row| [row, 100 + row]).collect();
/// let (from, until) = (0.0, 0.5);
/// let seam = SeamDescription { from, until, rest_gap: Some(0.0), ..SeamDescription::new([0, 1], pairs, 800.0) };
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
    /// Solver time at which the seam starts to open [s]; `None` keeps it closed.
    pub opens: Option<f64>,
    /// Solver time from which it is open for good [s]; `None` opens it at once.
    pub opened: Option<f64>,
    /// Whether pairs close one after the other, and open in the opposite order, instead of all at the same time.
    pub zip: bool,
    /// Gap that is left then [m]; `None` takes the larger thickness of the two garments if cloth touches cloth in this
    /// scene, and nothing otherwise.
    pub rest_gap: Option<f64>,
    /// Stiffness of each pair [N/m].
    pub stiffness: f64,
    /// Damping as a fraction of critical damping of the pair.
    pub damping_ratio: f64,
}

impl SeamDescription {
    /// A seam of pairs of this stiffness [N/m] that is closed at once, and stays.
    pub fn new(garments: [usize; 2], pairs: Vec<[u32; 2]>, stiffness: f64) -> Self {
        let (from, until, opens, opened, zip) = (0.0, 0.0, None, None, false);
        Self { garments, pairs, from, until, opens, opened, zip, rest_gap: None, stiffness, damping_ratio: 1.0 }
    }
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
    "opens", seam.opens => Time, default Absent, range (-FARTHEST, FARTHEST),
        "start of opening, since the first frame; left out, the seam stays closed";
    "opened", seam.opened => Time, default Absent, range (-FARTHEST, FARTHEST),
        "end of opening; left out, the seam opens at once";
    "zip", seam.zip => None, default Flag(false), range (0.0, 0.0),
        "closes one pair after the other and opens them in the opposite order: in the order of the listed vertices of `from`, or \
         along the longest axis of its region, x, y or z, from low to high";
} }
