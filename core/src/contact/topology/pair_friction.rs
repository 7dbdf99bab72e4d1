//! Coefficient of friction of a pair of cloth with cloth: of the scene, by rules, and as it is painted.

use crate::scene::contact_matrix::ContactMatrix;

/// Friction of cloth on cloth where it differs from that of the scene.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct PairFriction<'a> {
    /// Factor at each node, and term added; `None` if friction is nowhere painted.
    pub painted: Option<&'a [[f64; 2]]>,
    /// Rules by pair, and the object of each node; `None` without rules.
    pub rules: Option<(&'a ContactMatrix, &'a [u32])>,
}

impl PairFriction<'_> {
    /// Coefficient of a pair with these nodes and weights: a rule's or `base`, times the mean of what is painted on its two sides
    /// where they touch.
    #[inline]
    pub(crate) fn of(&self, base: f64, nodes: [u32; 4], weights: [f64; 4]) -> f64 {
        let by_rule = |(matrix, objects): (&ContactMatrix, &[u32])| {
            // The first node is of the first side, the last one of the second.
            let [a, b] = [nodes[0], nodes[3]].map(|node| objects[node as usize] as usize);
            matrix.between(a, b).friction
        };
        let base = self.rules.and_then(by_rule).unwrap_or(base);
        let Some(painted) = self.painted else { return base };
        // The weights of each side add up to one, or to minus one.
        0.5 * painted_sum(painted, base, nodes.into_iter().zip(weights))
    }
}

/// Sum of the coefficients of nodes by their weights.
pub(crate) fn painted_sum(painted: &[[f64; 2]], base: f64, nodes: impl Iterator<Item = (u32, f64)>) -> f64 {
    let of_node = |(node, weight): (u32, f64)| {
        let [times, more] = painted[node as usize];
        weight.abs() * (times * base + more)
    };
    nodes.map(of_node).sum()
}
