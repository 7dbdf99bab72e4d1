//! Building the tree: binned splits by the surface-area rule.

use std::cmp::Ordering;
use std::ops::Range;

use super::{Bvh, INNER, LEAF_SIZE, NO_NODE, Node, Siblings};
use crate::geometry::aabb::Aabb;

/// Bins a node's centres are sorted into when the split is chosen.
const BINS: usize = 16;
/// From this depth on nodes are halved by count, which bounds the depth by this plus 32 for any `u32` count.
const SPLIT_BY_COUNT_DEPTH: usize = 30;

/// Data needed only while the tree is built.
pub(super) struct Builder<'a> {
    boxes: &'a [Aabb],
    centres: Vec<[f32; 3]>,
    primitives: Vec<u32>,
    pairs: Vec<Siblings>,
}

/// A split of a run of primitives: those whose bin along `axis` is at most `bin` go left.
#[derive(Clone, Copy)]
struct Split {
    axis: usize,
    bin: usize,
    cost: f64,
}

impl<'a> Builder<'a> {
    pub(super) fn new(boxes: &'a [Aabb]) -> Self {
        assert!(boxes.len() < INNER as usize, "a tree holds at most 2^32 - 2 primitives");
        let centres = boxes.iter().map(|b| [0, 1, 2].map(|k| 0.5 * b.min[k] + 0.5 * b.max[k])).collect();
        Builder {
            boxes,
            centres,
            primitives: (0..boxes.len() as u32).collect(),
            pairs: Vec::with_capacity(boxes.len()),
        }
    }

    pub(super) fn build(mut self) -> Bvh {
        self.pairs.push(Siblings([NO_NODE; 2]));
        let all = 0..self.primitives.len();
        if all.len() <= LEAF_SIZE {
            self.pairs[0].0[0] = self.node(all, 0);
        } else {
            self.split_into(0, all, 0);
        }
        self.pairs.shrink_to_fit();
        Bvh { pairs: self.pairs, primitives: self.primitives }
    }

    /// Splits the run in two and writes both halves into the pair.
    fn split_into(&mut self, pair: usize, run: Range<usize>, depth: usize) {
        let middle = self.partition(run.clone(), depth);
        let halves = [self.node(run.start..middle, depth), self.node(middle..run.end, depth)];
        self.pairs[pair].0 = halves;
    }

    fn node(&mut self, run: Range<usize>, depth: usize) -> Node {
        let bounds = self.primitives[run.clone()].iter().fold(Aabb::EMPTY, |b, &p| b.union(&self.boxes[p as usize]));
        if run.len() <= LEAF_SIZE {
            return Node { bounds, first: run.start as u32, count: run.len() as u32 };
        }
        let pair = self.pairs.len();
        self.pairs.push(Siblings([NO_NODE; 2]));
        self.split_into(pair, run, depth + 1);
        Node { bounds, first: pair as u32, count: INNER }
    }

    /// Orders the run so that its two halves come one after the other; returns where the second starts.
    fn partition(&mut self, run: Range<usize>, depth: usize) -> usize {
        let extent = self.primitives[run.clone()].iter().fold(Aabb::EMPTY, |b, &p| {
            let centre = self.centres[p as usize];
            b.union(&Aabb { min: centre, max: centre })
        });
        let split = if depth < SPLIT_BY_COUNT_DEPTH { self.best_split(&run, &extent) } else { None };
        let Some(split) = split else {
            return self.halve(run, &extent);
        };
        let centres = &self.centres;
        let goes_left = |p: u32| bin_of(&centres[p as usize], split.axis, &extent) <= split.bin;
        let items = &mut self.primitives[run.clone()];
        let mut left = 0;
        for i in 0..items.len() {
            if goes_left(items[i]) {
                items.swap(left, i);
                left += 1;
            }
        }
        run.start + left
    }

    /// Cheapest split by the surface-area rule; none if all centres coincide.
    fn best_split(&self, run: &Range<usize>, extent: &Aabb) -> Option<Split> {
        let mut best: Option<Split> = None;
        for axis in 0..3 {
            if extent.max[axis].partial_cmp(&extent.min[axis]) != Some(Ordering::Greater) {
                continue;
            }
            let mut bins = [(Aabb::EMPTY, 0u32); BINS];
            for &p in &self.primitives[run.clone()] {
                let bin = &mut bins[bin_of(&self.centres[p as usize], axis, extent)];
                *bin = (bin.0.union(&self.boxes[p as usize]), bin.1 + 1);
            }
            let mut right_cost = [0.0; BINS];
            let mut sum = (Aabb::EMPTY, 0u32);
            for i in (1..BINS).rev() {
                sum = (sum.0.union(&bins[i].0), sum.1 + bins[i].1);
                right_cost[i] = sum.0.half_area() * f64::from(sum.1);
            }
            let (mut sum, total) = ((Aabb::EMPTY, 0u32), run.len() as u32);
            for bin in 0..BINS - 1 {
                sum = (sum.0.union(&bins[bin].0), sum.1 + bins[bin].1);
                let cost = sum.0.half_area() * f64::from(sum.1) + right_cost[bin + 1];
                let proper = sum.1 > 0 && sum.1 < total;
                if proper && best.is_none_or(|b| cost < b.cost) {
                    best = Some(Split { axis, bin, cost });
                }
            }
        }
        best
    }

    /// Half and half by centre along the longest axis, ties by index.
    fn halve(&mut self, run: Range<usize>, extent: &Aabb) -> usize {
        let length = |k: usize| extent.max[k] - extent.min[k];
        let axis = (1..3).fold(0, |a, k| if length(k) > length(a) { k } else { a });
        let centres = &self.centres;
        let key = |p: &u32| (centres[*p as usize][axis], *p);
        let half = run.len() / 2;
        self.primitives[run.clone()].select_nth_unstable_by(half, |a, b| {
            let (a, b) = (key(a), key(b));
            a.0.total_cmp(&b.0).then(a.1.cmp(&b.1))
        });
        run.start + half
    }
}

#[inline]
fn bin_of(centre: &[f32; 3], axis: usize, extent: &Aabb) -> usize {
    let share = (centre[axis] - extent.min[axis]) / (extent.max[axis] - extent.min[axis]);
    ((share * BINS as f32) as usize).min(BINS - 1) // a float that is no index becomes 0 or the last bin
}
