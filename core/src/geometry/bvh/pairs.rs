//! Pairs of primitives whose boxes overlap, in one tree or between two, as pieces that may run in parallel.

use super::{Bvh, INNER, Node};

/// A piece of the search for pairs. Pieces depend on the tree alone, never on who works on them.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PairTask(Piece);

#[derive(Clone, Copy, Debug)]
enum Piece {
    /// All pairs below this pair of siblings.
    Below(u32),
    /// All pairs of one primitive below each.
    Between(Node, Node),
}

impl Bvh {
    /// Calls `found(a, b)` with a < b once for every pair of primitives whose boxes overlap, and for some that only
    /// come close (primitives in overlapping leaves). The order depends on the tree: sort what you keep.
    pub(crate) fn self_pairs(&self, mut found: impl FnMut(u32, u32)) {
        self.pairs_below(0, &mut |p, q| found(p.min(q), p.max(q)));
    }

    /// At least `wanted` pieces of the search for the pairs of this tree, if it is large enough.
    pub(crate) fn self_tasks(&self, wanted: usize) -> Vec<PairTask> {
        self.split_until(vec![PairTask(Piece::Below(0))], self, wanted)
    }

    /// At least `wanted` pieces of the search for pairs of this tree with `other`, if they are large enough.
    pub(crate) fn tasks_with(&self, other: &Bvh, wanted: usize) -> Vec<PairTask> {
        let roots = |tree: &Bvh| tree.pairs[0].0;
        let all = roots(self).into_iter().flat_map(|a| roots(other).map(|b| PairTask(Piece::Between(a, b)))).collect();
        self.split_until(all, other, wanted)
    }

    /// Works on one piece: `found(a, b)` with `a` of this tree and `b` of `other`, which is this tree again for the pieces
    /// of [`Bvh::self_tasks`].
    pub(crate) fn pairs_of(&self, task: &PairTask, other: &Bvh, found: &mut impl FnMut(u32, u32)) {
        match &task.0 {
            Piece::Below(pair) => self.pairs_below(*pair, found),
            Piece::Between(a, b) => self.pairs_between(other, a, b, found),
        }
    }

    /// Replaces pieces by smaller ones, level by level.
    fn split_until(&self, mut tasks: Vec<PairTask>, other: &Bvh, wanted: usize) -> Vec<PairTask> {
        while tasks.len() < wanted {
            let before = tasks.len();
            tasks = tasks.iter().flat_map(|task| self.split(task, other)).collect();
            if tasks.len() <= before {
                break;
            }
        }
        tasks
    }

    fn split(&self, task: &PairTask, other: &Bvh) -> Vec<PairTask> {
        let between = |a: &Node, b: &Node| PairTask(Piece::Between(*a, *b));
        let children = |tree: &Bvh, node: &Node| tree.pairs[node.first as usize].0;
        match &task.0 {
            Piece::Below(pair) => {
                let [a, b] = self.pairs[*pair as usize].0;
                if a.count != INNER || b.count != INNER {
                    return vec![*task];
                }
                vec![PairTask(Piece::Below(a.first)), PairTask(Piece::Below(b.first)), between(&a, &b)]
            }
            Piece::Between(a, b) if !a.bounds.overlaps(&b.bounds) => Vec::new(),
            Piece::Between(a, b) => match (a.count == INNER, b.count == INNER) {
                (true, _) => children(self, a).iter().map(|c| between(c, b)).collect(),
                (false, true) => children(other, b).iter().map(|c| between(a, c)).collect(),
                (false, false) => vec![*task],
            },
        }
    }

    /// Recursion is at most as deep as the tree, here and in `pairs_between`.
    fn pairs_below(&self, pair: u32, found: &mut impl FnMut(u32, u32)) {
        let [a, b] = self.pairs[pair as usize].0;
        for node in [a, b] {
            if node.count == INNER {
                self.pairs_below(node.first, found);
            } else {
                let run = self.run(&node);
                for (i, &p) in run.iter().enumerate() {
                    run[i + 1..].iter().for_each(|&q| found(p, q));
                }
            }
        }
        self.pairs_between(self, &a, &b, found);
    }

    fn pairs_between(&self, other: &Bvh, a: &Node, b: &Node, found: &mut impl FnMut(u32, u32)) {
        if !a.bounds.overlaps(&b.bounds) {
            return;
        }
        match (a.count == INNER, b.count == INNER) {
            (false, false) => {
                for &p in self.run(a) {
                    other.run(b).iter().for_each(|&q| found(p, q));
                }
            }
            (true, false) => {
                self.pairs[a.first as usize].0.iter().for_each(|c| self.pairs_between(other, c, b, found));
            }
            (false, true) => {
                other.pairs[b.first as usize].0.iter().for_each(|c| self.pairs_between(other, a, c, found));
            }
            (true, true) => {
                for c in &self.pairs[a.first as usize].0 {
                    for d in &other.pairs[b.first as usize].0 {
                        self.pairs_between(other, c, d, found);
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Vec3;
    use crate::geometry::aabb::Aabb;
    use crate::geometry::random::SplitMix64;

    fn boxes(random: &mut SplitMix64, n: usize) -> Vec<Aabb> {
        let mut one = || {
            let p: Vec3 = random.vector();
            Aabb::of_segment(&p, &(p + random.vector() * 0.2))
        };
        (0..n).map(|_| one()).collect()
    }

    #[test]
    fn the_pieces_of_a_search_meet_every_overlapping_pair_once() {
        let mut random = SplitMix64::new(61);
        for (n, m) in [(0, 3), (1, 1), (2, 300), (400, 300)] {
            let (a, b) = (boxes(&mut random, n), boxes(&mut random, m));
            let (tree, other) = (Bvh::build(&a), Bvh::build(&b));
            let mut pairs = Vec::new();
            for task in tree.self_tasks(50) {
                tree.pairs_of(&task, &tree, &mut |p, q| pairs.push((p.min(q), p.max(q))));
            }
            let mut whole = Vec::new();
            tree.self_pairs(|p, q| whole.push((p, q)));
            pairs.sort_unstable();
            whole.sort_unstable();
            assert_eq!(pairs, whole);

            let mut mixed = Vec::new();
            for task in tree.tasks_with(&other, 50) {
                tree.pairs_of(&task, &other, &mut |p, q| mixed.push((p, q)));
            }
            mixed.sort_unstable();
            assert!(mixed.windows(2).all(|w| w[0] < w[1]));
            for p in 0..n as u32 {
                for q in 0..m as u32 {
                    let overlap = a[p as usize].overlaps(&b[q as usize]);
                    assert!(!overlap || mixed.binary_search(&(p, q)).is_ok());
                }
            }
        }
    }
}
