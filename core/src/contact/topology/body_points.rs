//! Bodies and their points by the numbers that nodes have in the scene.

use crate::contact::bodies::Bodies;
use crate::contact::topology::pair::Pair;

/// The bodies that cloth meets and the first point of each; points of bodies come after the vertices of cloth in the scene's numbering.
#[derive(Debug, Clone)]
pub(crate) struct BodyPoints {
    cloth: u32,
    first: Vec<(usize, u32)>,
}

impl BodyPoints {
    /// Points behind `cloth` vertices; `first` has the bodies with the first point of each, ascending.
    pub(super) fn new(cloth: u32, first: &[(usize, u32)]) -> Self {
        Self { cloth, first: first.to_vec() }
    }

    /// The body of a number of the scene and its point there; `None` for cloth.
    pub(crate) fn get(&self, number: u32) -> Option<(usize, u32)> {
        let point = number.checked_sub(self.cloth)?;
        let last = self.first.partition_point(|(_, first)| *first <= point) - 1;
        let (body, first) = self.first[last];
        Some((body, point - first))
    }

    /// Whether a pair has a point of a part of a body that is deep inside another one, or comes out of it.
    pub(crate) fn are_deep(&self, pair: &Pair, bodies: &Bodies) -> bool {
        pair.nodes.iter().any(|number| self.get(*number).is_some_and(|(body, point)| bodies.is_deep(body, point)))
    }
}
