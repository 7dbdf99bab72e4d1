//! Pins of a description: which vertices are held, to what, and how.

use crate::Vec3;
use crate::geometry::attachment::SurfaceAttachment;
use crate::scene::described::described;
use crate::settings::{Member, Settings, choice};

/// Vertices of a garment that are held.
///
/// ```
/// use drapery_core::{PinAnchor, PinDescription, PinHold, PinTarget};
/// let target = PinTarget::Path { anchor: PinAnchor::Start, vertices: vec![0, 9], offsets: Vec::new() };
/// let pin = PinDescription { garment: 0, target, axes: [true; 3], from: 0.0, until: 2.0, hold: PinHold::Hard };
/// assert_eq!(pin.target.count(), 2);
/// ```
#[derive(Debug, Clone)]
pub struct PinDescription {
    /// Index of the garment.
    pub garment: usize,
    /// Target, with the vertices that follow it.
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
    pub(crate) fn is_hard(&self) -> bool {
        self.hold == PinHold::Hard
    }
}

/// Target of a pin: it names the vertices and what they follow.
///
/// ```
/// use drapery_core::{PinAnchor, PinTarget, Vec3};
/// let offsets = vec![(0.0, Vec3::zeros()), (2.0, Vec3::new(0.0, 0.1, 0.0))];
/// let lifted = PinTarget::Path { anchor: PinAnchor::Start, vertices: vec![0, 1, 2], offsets };
/// let followed = PinTarget::BodyNearest { body: 0, vertices: vec![4] };
/// assert_eq!((lifted.count(), followed.count()), (3, 1));
/// ```
#[derive(Debug, Clone)]
pub enum PinTarget {
    /// A place where the vertex was, moved along a path relative to it.
    Path {
        /// Moment at which the place is taken.
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

/// Moment at which a pin takes the place that it holds its vertices to.
///
/// ```
/// use drapery_core::{PinAnchor, PinTarget};
/// let hand = PinTarget::Path { anchor: PinAnchor::WhenHeld, vertices: vec![7], offsets: Vec::new() };
/// assert!(matches!(hand, PinTarget::Path { anchor: PinAnchor::WhenHeld, .. }));
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PinAnchor {
    /// At the start of the simulation.
    Start,
    /// At the time from which the pin is active.
    WhenHeld,
}

/// Hold of a pin: rigid, or by a spring.
///
/// ```
/// use drapery_core::PinHold;
/// let button = PinHold::Spring { stiffness: 400.0, damping_ratio: 1.0, break_force: Some(20.0) };
/// // Where the spring breaks, the vertex is this far from its target.
/// let PinHold::Spring { stiffness, break_force: Some(force), .. } = button else { unreachable!() };
/// assert_eq!(force / stiffness, 0.05);
/// ```
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

impl PinHold {
    /// Hold that the table of a pin says; `None` for a spring without stiffness.
    pub fn of(settings: &Settings) -> Option<Self> {
        Some(match PinMode::of(settings, "mode") {
            PinMode::Hard => Self::Hard,
            PinMode::Spring => Self::Spring {
                stiffness: settings.optional("stiffness")?,
                damping_ratio: settings.number("damping_ratio"),
                break_force: settings.optional("break_force"),
            },
        })
    }

    fn mode(&self) -> PinMode {
        self.spring().map_or(PinMode::Hard, |_| PinMode::Spring)
    }

    /// Stiffness [N/m] and damping ratio.
    fn spring(&self) -> Option<[f64; 2]> {
        match *self {
            Self::Spring { stiffness, damping_ratio, .. } => Some([stiffness, damping_ratio]),
            Self::Hard => None,
        }
    }

    /// The force at which it breaks [N]; `None` if it never does.
    pub(crate) fn break_force(&self) -> Option<f64> {
        match self {
            Self::Spring { break_force, .. } => *break_force,
            Self::Hard => None,
        }
    }
}

choice! {
    /// The words for how a pin holds.
    pub enum PinMode {
        /// The vertex is where its target is.
        Hard = "hard",
        /// A spring pulls it there.
        Spring = "spring",
    }
}

described! { PinDescription as pin {
    "from", pin.from => Time, default Number(f64::NEG_INFINITY), range (f64::NEG_INFINITY, f64::INFINITY),
        "active from this time on, since the first frame";
    "until", pin.until => Time, default Number(f64::INFINITY), range (f64::NEG_INFINITY, f64::INFINITY),
        "active until this time, since the first frame";
    "mode", pin.hold.mode() => None, default Choice("hard", PinMode::WORDS), range (0.0, 0.0),
        "kind of hold";
    "stiffness", pin.hold.spring().map(|[stiffness, _]| stiffness) => Stiffness, default Absent, range (1e-12, 1e10),
        "with `mode = \"spring\"`: stiffness, for example \"200 N/m\"";
    "damping_ratio", pin.hold.spring().map(|[_, damping_ratio]| damping_ratio) => None, default Conditional(1.0), range (0.0, 1e3),
        "with `mode = \"spring\"`: damping as a fraction of critical";
    "break_force", pin.hold.break_force() => Force, default Absent, range (1e-12, 1e12),
        "with `mode = \"spring\"`: the spring of a vertex breaks for good at a larger force; left out, it never breaks";
} }
