//! Pins as a scene describes them: vertices whose motion is given.

use super::SurfaceAttachment;
use crate::Vec3;

/// Vertices of a garment that are held.
#[derive(Debug, Clone)]
pub struct PinDescription {
    /// Index of the garment.
    pub garment: usize,
    /// What the vertices follow, and which vertices.
    pub target: PinTarget,
    /// Axes in which a hard pin holds (world x, y, z).
    pub axes: [bool; 3],
    /// Solver time from which it holds [s].
    pub from: f64,
    /// Solver time at which it lets go [s].
    pub until: f64,
    /// Hard, or by a spring.
    pub hold: PinHold,
}

impl PinDescription {
    /// Whether its vertices are where their targets are, and not on springs.
    pub fn is_hard(&self) -> bool {
        self.hold == PinHold::Hard
    }
}

/// What a pinned vertex follows.
#[derive(Debug, Clone)]
pub enum PinTarget {
    /// A place where the vertex was, moved along a path relative to it.
    Path {
        /// When the place is taken.
        anchor: PinAnchor,
        /// Vertex numbers in the garment's own order.
        vertices: Vec<u32>,
        /// Times [s] and offsets [m] from the start position, piecewise linear; empty stays put.
        offsets: Vec<(f64, Vec3)>,
    },
    /// Positions that the caller pushes frame by frame: row `i` of the track belongs to `vertices[i]`.
    Track {
        /// Vertex numbers in the garment's own order.
        vertices: Vec<u32>,
        /// Number of the track in [`crate::simulation::FrameInput::tracks`].
        track: usize,
    },
    /// Places on the surface of a body.
    Body {
        /// Index of the body; it must be a deforming surface.
        body: usize,
        /// One attachment per vertex.
        attachments: Vec<SurfaceAttachment>,
    },
    /// The nearest places on the surface of a body when the simulation starts.
    BodyNearest {
        /// Index of the body; it must be a deforming surface.
        body: usize,
        /// Vertex numbers in the garment's own order.
        vertices: Vec<u32>,
    },
}

impl PinTarget {
    /// Number of vertices that it holds.
    pub fn count(&self) -> usize {
        match self {
            Self::Path { vertices, .. } | Self::Track { vertices, .. } | Self::BodyNearest { vertices, .. } => {
                vertices.len()
            }
            Self::Body { attachments, .. } => attachments.len(),
        }
    }
}

/// When a pin takes the place that it holds its vertices to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PinAnchor {
    /// When the simulation starts.
    Start,
    /// When the pin takes hold.
    WhenHeld,
}

/// How a pin holds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PinHold {
    /// The vertex is where the target is.
    Hard,
    /// A zero-length spring pulls the vertex to the target.
    Spring {
        /// Stiffness [N/m].
        stiffness: f64,
        /// Damping as a fraction of critical damping of the vertex on this spring.
        damping_ratio: f64,
        /// Force at which it breaks and lets go for good [N]; `None` holds whatever pulls.
        break_force: Option<f64>,
    },
}
