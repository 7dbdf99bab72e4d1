//! Seams of a description.

use crate::scene::FARTHEST;
use crate::scene::described::described;
use crate::scene::seam_pairs::SewnTo;

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
    /// Vertices of the first garment that are sewn to points on faces of the second, after the pairs.
    pub faces: Vec<FacePoint>,
    /// Whether gaps stay as they are at the start, instead of closing.
    pub keeps_gap: bool,
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
    /// Force at which a pair opens for good [N]; `None` holds whatever pulls.
    pub break_force: Option<f64>,
}

impl SeamDescription {
    /// A seam of pairs of this stiffness [N/m] that is closed at once, and stays.
    pub fn new(garments: [usize; 2], pairs: Vec<[u32; 2]>, stiffness: f64) -> Self {
        let (from, until, opens, opened, zip) = (0.0, 0.0, None, None, false);
        let (faces, keeps_gap) = (Vec::new(), false);
        Self {
            garments,
            pairs,
            faces,
            keeps_gap,
            from,
            until,
            opens,
            opened,
            zip,
            rest_gap: None,
            stiffness,
            damping_ratio: 1.0,
            break_force: None,
        }
    }
}

impl SeamDescription {
    /// Number of its stitches.
    pub fn stitches(&self) -> usize {
        self.pairs.len() + self.faces.len()
    }

    /// Takes the stitches: each a vertex of the first garment, and what of the second it is sewn to.
    pub(crate) fn take_stitches(&mut self) -> Vec<(u32, SewnTo)> {
        let pairs = std::mem::take(&mut self.pairs).into_iter();
        let faces = std::mem::take(&mut self.faces).into_iter();
        let to_face = |FacePoint { vertex, corners, weights }| (vertex, SewnTo::Face { corners, weights });
        pairs.map(|[p, q]| (p, SewnTo::Vertex(q))).chain(faces.map(to_face)).collect()
    }
}

/// A vertex of one garment, and the point on a face of another that it is sewn to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FacePoint {
    /// Number of the vertex in its garment.
    pub vertex: u32,
    /// Corners of the face by their numbers in the other garment.
    pub corners: [u32; 3],
    /// Barycentric weights of the corners, adding up to one.
    pub weights: [f64; 3],
}

described! { SeamDescription as seam {
    "strength", seam.stiffness => Stiffness, default Required, range (1e-12, 1e10),
        "stiffness of each pair, for example \"800 N/m\"";
    "damping_ratio", seam.damping_ratio => None, default Number(1.0), range (0.0, 1e3),
        "damping as a fraction of critical";
    "break_force", seam.break_force => Force, default Absent, range (1e-12, 1e12),
        "a pair opens for good at a larger force; left out, it never breaks";
    "rest_gap", seam.rest_gap => Length, default Absent, range (0.0, 1e3),
        "gap of the closed seam; left out, the larger thickness of the garments if cloth touches cloth in this \
         scene, otherwise zero";
    "keep_gap", seam.keeps_gap => None, default Flag(false), range (0.0, 0.0),
        "the gap stays as it is at the start, instead of closing: a patch or a brooch that is fixed where it lies";
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
