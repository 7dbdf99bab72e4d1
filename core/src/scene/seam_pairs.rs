//! Sewn vertices while a scene is handed out. A rank that owns one of a stitch has the others among its ghosts.

use std::ops::Range;

/// A stitch: a vertex, and what it is sewn to, by their numbers in the scene.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sewn {
    /// Number among the stitches of all seams.
    pub number: u32,
    /// Number of the seam.
    pub seam: usize,
    /// The vertex.
    pub vertex: u32,
    /// Another vertex, or a point of a face.
    pub to: SewnTo,
    /// Distance between the two at the start [m].
    pub gap: f64,
    /// The part of the seam's time in which a zip closes the stitch: from and to, 0 to 1.
    pub share: [f64; 2],
}

/// The far end of a stitch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum SewnTo {
    /// A vertex.
    Vertex(u32),
    /// A point of a face, by its corners and their barycentric weights.
    Face {
        /// The corners.
        corners: [u32; 3],
        /// Their weights, adding up to one.
        weights: [f64; 3],
    },
}

impl SewnTo {
    /// Its vertices.
    pub(crate) fn vertices(&self) -> &[u32] {
        match self {
            Self::Vertex(vertex) => std::slice::from_ref(vertex),
            Self::Face { corners, .. } => corners,
        }
    }

    /// Weights of its vertices.
    pub(crate) fn weights(&self) -> &[f64] {
        match self {
            Self::Vertex(_) => &[1.0],
            Self::Face { weights, .. } => weights,
        }
    }

    /// The same with other numbers of its vertices, which `next` gives one after the other.
    pub(crate) fn renumbered(self, mut next: impl FnMut(u32) -> u32) -> Self {
        match self {
            Self::Vertex(vertex) => Self::Vertex(next(vertex)),
            Self::Face { corners, weights } => Self::Face { corners: corners.map(next), weights },
        }
    }
}

impl Sewn {
    /// The vertex, and those that it is sewn to.
    pub(crate) fn vertices(&self) -> impl Iterator<Item = u32> + '_ {
        std::iter::once(self.vertex).chain(self.to.vertices().iter().copied())
    }

    fn has_one_in(&self, range: &Range<usize>) -> bool {
        self.vertices().any(|vertex| range.contains(&(vertex as usize)))
    }
}

/// The stitches with a vertex among `own`, which are numbers of the scene.
pub(crate) fn sewn_to(sewn: &[Sewn], own: &Range<usize>) -> Vec<Sewn> {
    sewn.iter().copied().filter(|stitch| stitch.has_one_in(own)).collect()
}

/// The vertices of stitches with one among `own`, as far as they are in `garment`.
pub(crate) fn partners(sewn: &[Sewn], own: &Range<usize>, garment: &Range<usize>) -> Vec<u32> {
    let stitches = sewn.iter().filter(|stitch| stitch.has_one_in(own));
    stitches.flat_map(Sewn::vertices).filter(|vertex| garment.contains(&(*vertex as usize))).collect()
}
