//! Connected components of sets of nodes, joined where they share some.

/// Stands for sets without nodes.
pub(crate) const NO_NODE: u32 = u32::MAX;

/// Sets of nodes, one after the other.
#[derive(Debug, Default)]
pub(crate) struct UnionFind {
    nodes: Vec<u32>,
    /// End of each set in `nodes`.
    ends: Vec<usize>,
}

impl UnionFind {
    /// Adds a set.
    pub(crate) fn push(&mut self, nodes: impl IntoIterator<Item = u32>) {
        self.nodes.extend(nodes);
        self.ends.push(self.nodes.len());
    }

    /// The smallest node of all that each set hangs together with, by way of common nodes; [`NO_NODE`] for an empty
    /// set.
    pub(crate) fn representatives(&self) -> Vec<u32> {
        let mut all = self.nodes.clone();
        all.sort_unstable();
        all.dedup();
        let mut parent: Vec<u32> = (0..all.len() as u32).collect();
        let place = |node: u32| all.partition_point(|n| *n < node) as u32;
        let starts = || std::iter::once(&0).chain(&self.ends);
        for (start, end) in starts().zip(&self.ends) {
            let [first, others @ ..] = &self.nodes[*start..*end] else { continue };
            others.iter().for_each(|other| join(&mut parent, place(*first), place(*other)));
        }
        let smallest = |(start, end): (&usize, &usize)| match self.nodes[*start..*end].first() {
            Some(first) => all[root(&mut parent, place(*first)) as usize],
            None => NO_NODE,
        };
        starts().zip(&self.ends).map(smallest).collect()
    }
}

/// The smallest of what a place hangs together with.
fn root(parent: &mut [u32], mut place: u32) -> u32 {
    while parent[place as usize] != place {
        let above = parent[parent[place as usize] as usize];
        parent[place as usize] = above;
        place = above;
    }
    place
}

fn join(parent: &mut [u32], a: u32, b: u32) {
    let (a, b) = (root(parent, a), root(parent, b));
    parent[a.max(b) as usize] = a.min(b);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sets_hang_together_through_others() {
        let mut sets = UnionFind::default();
        for set in [vec![7, 9], vec![3, 4], vec![], vec![9, 12], vec![20], vec![4, 12], vec![21, 22]] {
            sets.push(set);
        }
        assert_eq!(sets.representatives(), [3, 3, NO_NODE, 3, 20, 3, 21]);
    }
}
