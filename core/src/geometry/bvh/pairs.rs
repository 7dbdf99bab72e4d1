//! Pairs of primitives whose boxes overlap, in one tree or between two, as pieces that may run in parallel.

use super::{Bvh, INNER, Node, Siblings};

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

/// Groups of primitives, one bit each, below every node of a tree.
#[derive(Clone, Debug)]
pub(crate) struct GroupMasks {
    /// Below both nodes of each pair of siblings.
    below: Vec<u64>,
    /// Group of each place in `Bvh::primitives`.
    primitives: Vec<u64>,
}

/// Groups of two trees, and which may meet: subtrees of which none may are passed over.
#[derive(Clone, Copy)]
pub(crate) struct GroupFilter<'a> {
    /// Groups of the tree that is searched, and of the other.
    pub masks: [&'a GroupMasks; 2],
    /// Whether anything of these groups may meet anything of those.
    pub may_meet: &'a (dyn Fn(u64, u64) -> bool + Sync),
}

impl GroupMasks {
    /// Groups below a node.
    fn of(&self, node: &Node) -> u64 {
        if node.count == INNER {
            return self.below[node.first as usize];
        }
        let run = node.first as usize..(node.first + node.count) as usize;
        self.primitives[run].iter().fold(0, |all, group| all | group)
    }

    /// Memory held [bytes].
    pub(crate) fn bytes(&self) -> usize {
        (self.below.len() + self.primitives.len()) * size_of::<u64>()
    }
}

impl GroupFilter<'_> {
    /// Whether anything below a node may meet anything below another one.
    fn passes(&self, a: &Node, b: &Node) -> bool {
        (self.may_meet)(self.masks[0].of(a), self.masks[1].of(b))
    }

    /// Whether anything below a pair of siblings may meet anything else there.
    fn passes_below(&self, pair: u32) -> bool {
        let mask = self.masks[0].below[pair as usize];
        (self.may_meet)(mask, mask)
    }
}

/// Filter of a search, if it has one.
type Filter<'a> = Option<&'a GroupFilter<'a>>;

impl Bvh {
    /// The groups below every node, with this bit for each primitive.
    pub(crate) fn group_masks(&self, group_of: impl Fn(u32) -> u64) -> GroupMasks {
        let primitives: Vec<u64> = self.primitives.iter().map(|&p| group_of(p)).collect();
        let mut masks = GroupMasks { below: vec![0; self.pairs.len()], primitives };
        // Children come after their parents.
        for (i, Siblings([a, b])) in self.pairs.iter().enumerate().rev() {
            masks.below[i] = masks.of(a) | masks.of(b);
        }
        masks
    }

    /// Calls `found(a, b)` with a < b once for every pair of primitives whose boxes overlap, and for some that only
    /// come close (primitives in overlapping leaves). The order depends on the tree: sort what you keep.
    pub(crate) fn self_pairs(&self, mut found: impl FnMut(u32, u32)) {
        self.pairs_below(0, None, &mut |p, q| found(p.min(q), p.max(q)));
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
    /// of [`Bvh::self_tasks`]. With a filter, pairs in leaves that hold several groups are found too.
    pub(crate) fn pairs_of(
        &self,
        task: &PairTask,
        other: &Bvh,
        filter: Option<&GroupFilter<'_>>,
        found: &mut impl FnMut(u32, u32),
    ) {
        match &task.0 {
            Piece::Below(pair) => self.pairs_below(*pair, filter, found),
            Piece::Between(a, b) => self.pairs_between(other, [a, b], filter, found),
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
    fn pairs_below(&self, pair: u32, filter: Filter<'_>, found: &mut impl FnMut(u32, u32)) {
        if filter.is_some_and(|filter| !filter.passes_below(pair)) {
            return;
        }
        let [a, b] = self.pairs[pair as usize].0;
        for node in [a, b] {
            if node.count == INNER {
                self.pairs_below(node.first, filter, found);
            } else {
                let run = self.run(&node);
                for (i, &p) in run.iter().enumerate() {
                    run[i + 1..].iter().for_each(|&q| found(p, q));
                }
            }
        }
        self.pairs_between(self, [&a, &b], filter, found);
    }

    fn pairs_between(&self, other: &Bvh, [a, b]: [&Node; 2], filter: Filter<'_>, found: &mut impl FnMut(u32, u32)) {
        if !a.bounds.overlaps(&b.bounds) || filter.is_some_and(|filter| !filter.passes(a, b)) {
            return;
        }
        match (a.count == INNER, b.count == INNER) {
            (false, false) => {
                for &p in self.run(a) {
                    other.run(b).iter().for_each(|&q| found(p, q));
                }
            }
            (true, false) => {
                self.pairs[a.first as usize].0.iter().for_each(|c| self.pairs_between(other, [c, b], filter, found));
            }
            (false, true) => {
                other.pairs[b.first as usize].0.iter().for_each(|c| self.pairs_between(other, [a, c], filter, found));
            }
            (true, true) => {
                for c in &self.pairs[a.first as usize].0 {
                    for d in &other.pairs[b.first as usize].0 {
                        self.pairs_between(other, [c, d], filter, found);
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
                tree.pairs_of(&task, &tree, None, &mut |p, q| pairs.push((p.min(q), p.max(q))));
            }
            let mut whole = Vec::new();
            tree.self_pairs(|p, q| whole.push((p, q)));
            pairs.sort_unstable();
            whole.sort_unstable();
            assert_eq!(pairs, whole);

            let mut mixed = Vec::new();
            for task in tree.tasks_with(&other, 50) {
                tree.pairs_of(&task, &other, None, &mut |p, q| mixed.push((p, q)));
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

    #[test]
    fn a_filter_passes_over_groups_that_do_not_meet_and_loses_no_others() {
        let mut random = SplitMix64::new(62);
        let (a, b) = (boxes(&mut random, 400), boxes(&mut random, 300));
        let (tree, other) = (Bvh::build(&a), Bvh::build(&b));
        let groups: Vec<u64> = a.iter().map(|bounds| 1 << u32::from(bounds.min[0] > 0.0)).collect();
        let masks = [tree.group_masks(|p| groups[p as usize]), other.group_masks(|_| 1)];
        // Those on the left meet nothing of their own, and nothing of the other tree.
        let may_meet = |these: u64, those: u64| (these & 2 != 0) || (those & 2 != 0);
        let collect = |tasks: Vec<PairTask>, with: &Bvh, masks: Option<[&GroupMasks; 2]>| {
            let mut found = Vec::new();
            let filter = masks.map(|masks| GroupFilter { masks, may_meet: &may_meet });
            tasks.iter().for_each(|task| tree.pairs_of(task, with, filter.as_ref(), &mut |p, q| found.push((p, q))));
            found.sort_unstable();
            found
        };
        let own = || tree.self_tasks(50);
        let (all, some) = (collect(own(), &tree, None), collect(own(), &tree, Some([&masks[0]; 2])));
        let meets = |&(p, q): &(u32, u32)| may_meet(groups[p as usize], groups[q as usize]);
        let kept: Vec<_> = some.iter().copied().filter(meets).collect();
        assert_eq!(kept, all.iter().copied().filter(meets).collect::<Vec<_>>());
        assert!(some.len() < all.len() * 9 / 10, "{} of {}", some.len(), all.len());
        let between = || tree.tasks_with(&other, 50);
        let [all, some] = [None, Some([&masks[0], &masks[1]])].map(|masks| collect(between(), &other, masks));
        let meets = |&(p, _): &(u32, u32)| groups[p as usize] == 2;
        let [kept, wanted] = [&some, &all].map(|found| found.iter().copied().filter(meets).collect::<Vec<_>>());
        assert!(kept == wanted && some.len() < all.len() * 9 / 10, "{} of {}", some.len(), all.len());
    }
}
