//! A bounding volume hierarchy over boxes of primitives, built once for a topology and refitted as points move.
//!
//! Binary, built with binned surface-area splits, about two primitives a leaf, the two children of a node side by side
//! in one cache line. Boxes are `f32`, rounded outwards from `f64` points, so they never lose anything. A refit changes
//! boxes only; the order of its minima and maxima does not matter to the bits. Answers of [`Bvh::nearest`] do not
//! depend on the shape of the tree: of equally close primitives the one with the lower index wins.

use rayon::prelude::*;

use crate::Vec3;
use crate::geometry::aabb::Aabb;
use crate::geometry::tolerances;

mod build;
mod pairs;

pub(crate) use pairs::{GroupFilter, GroupMasks, PairTask};

/// Primitives in a leaf at most.
const LEAF_SIZE: usize = 2;
/// Entries of the traversal stack: one for each level and one more.
const STACK: usize = 64;
/// `Node::count` of a node that has children instead of primitives.
const INNER: u32 = u32::MAX;
/// Pairs of children that one task refits; below it a second thread costs more than it brings.
const REFIT_CHUNK: usize = 4096;

#[derive(Clone, Copy, Debug)]
struct Node {
    bounds: Aabb,
    /// Inner node: index of the pair of its children. Leaf: start of its run in `primitives`.
    first: u32,
    /// Length of the leaf's run, or `INNER`.
    count: u32,
}

const NO_NODE: Node = Node { bounds: Aabb::EMPTY, first: 0, count: 0 };

/// Two siblings in one cache line.
#[derive(Clone, Copy, Debug)]
#[repr(align(64))]
struct Siblings([Node; 2]);

/// The hierarchy. Primitives are the indices 0..n of the boxes it was built from.
#[derive(Clone, Debug)]
pub struct Bvh {
    /// Children come after their parents.
    pairs: Vec<Siblings>,
    primitives: Vec<u32>,
}

impl Bvh {
    /// Builds the tree over `boxes`; at most 2³² − 2 of them.
    pub fn build(boxes: &[Aabb]) -> Bvh {
        build::Builder::new(boxes).build()
    }

    /// Number of primitives.
    pub fn len(&self) -> usize {
        self.primitives.len()
    }

    /// Whether there are no primitives.
    pub fn is_empty(&self) -> bool {
        self.primitives.is_empty()
    }

    /// Box of everything.
    pub fn bounds(&self) -> Aabb {
        let [a, b] = &self.pairs[0].0;
        a.bounds.union(&b.bounds)
    }

    /// Recomputes all boxes from those of the primitives; allocates nothing. Parallel over leaves, same bits on any
    /// number of threads.
    pub(crate) fn refit(&mut self, box_of: impl Fn(u32) -> Aabb + Sync) {
        let primitives = &self.primitives;
        let refit_leaves = |pairs: &mut [Siblings]| {
            for node in pairs.iter_mut().flat_map(|pair| pair.0.iter_mut()).filter(|node| node.count != INNER) {
                let run = &primitives[node.first as usize..(node.first + node.count) as usize];
                node.bounds = run.iter().fold(Aabb::EMPTY, |bounds, &p| bounds.union(&box_of(p)));
            }
        };
        if self.pairs.len() > REFIT_CHUNK {
            self.pairs.par_chunks_mut(REFIT_CHUNK).for_each(refit_leaves);
        } else {
            refit_leaves(&mut self.pairs);
        }
        for i in (0..self.pairs.len()).rev() {
            for side in 0..2 {
                let node = self.pairs[i].0[side];
                if node.count == INNER {
                    let [a, b] = &self.pairs[node.first as usize].0;
                    self.pairs[i].0[side].bounds = a.bounds.union(&b.bounds);
                }
            }
        }
    }

    /// Expected work of a query that meets the root: boxes and primitives visited, by the surface-area rule. Grows when
    /// refitting has spoiled the tree; compare with the value after [`Bvh::build`].
    pub fn cost(&self) -> f64 {
        let total = self.bounds().half_area();
        if total == 0.0 {
            return 0.0;
        }
        let visits =
            |node: &Node| node.bounds.half_area() * if node.count == INNER { 2.0 } else { f64::from(node.count) };
        self.pairs.iter().flat_map(|pair| pair.0.iter()).map(visits).sum::<f64>() / total
    }

    /// Primitive closest to `point` within `max_distance` \[m\], with its squared distance \[m²\].
    ///
    /// `distance_squared` gives the exact value for a primitive; on equal values the lower index wins. `start` is a
    /// primitive to look at first: a good guess makes the search shorter and never changes its answer.
    #[inline]
    pub fn nearest(
        &self,
        point: &Vec3,
        max_distance: f64,
        start: Option<u32>,
        distance_squared: impl FnMut(u32) -> f64,
    ) -> Option<(u32, f64)> {
        self.nearest_around(point, max_distance, start, 0.0, distance_squared)
    }

    /// The same; `distance_squared` is asked at least for all primitives that are up to `margin` \[m\] farther from the point than
    /// the closest one, or than `max_distance` if nothing is closer.
    #[inline]
    pub(crate) fn nearest_around(
        &self,
        point: &Vec3,
        max_distance: f64,
        start: Option<u32>,
        margin: f64,
        mut distance_squared: impl FnMut(u32) -> f64,
    ) -> Option<(u32, f64)> {
        let target = Aabb::of_point(point);
        if max_distance < 0.0 {
            return None;
        }
        let mut best = (u32::MAX, max_distance * max_distance);
        let reach_of = |best: f64| {
            let farthest = if margin > 0.0 { (best.sqrt() + margin).powi(2) } else { best };
            (farthest * (1.0 + tolerances::BOX_DISTANCE)) as f32 + f32::MIN_POSITIVE
        };
        let mut reach = reach_of(best.1);
        let mut visit = |primitive: u32, best: &mut (u32, f64), reach: &mut f32| {
            let d = distance_squared(primitive);
            if d < best.1 || (d == best.1 && primitive < best.0) {
                *best = (primitive, d);
                *reach = reach_of(d);
            }
        };
        if let Some(primitive) = start {
            visit(primitive, &mut best, &mut reach);
        }
        let mut stack = [(0u32, 0f32); STACK];
        let mut height = 1; // the root pair is on the stack
        while height > 0 {
            height -= 1;
            let (pair, lower_bound) = stack[height];
            if lower_bound > reach {
                continue;
            }
            let children = &self.pairs[pair as usize].0;
            let d = [children[0].bounds.distance_squared(&target), children[1].bounds.distance_squared(&target)];
            let near = usize::from(d[1] < d[0]);
            // Leaves are looked at now, the nearer first; of inner nodes the nearer is pushed last, to be popped first.
            for side in [near, 1 - near] {
                let child = &children[side];
                if child.count != INNER && d[side] <= reach {
                    for &primitive in &self.primitives[child.first as usize..(child.first + child.count) as usize] {
                        visit(primitive, &mut best, &mut reach);
                    }
                }
            }
            for side in [1 - near, near] {
                let child = &children[side];
                if child.count == INNER && d[side] <= reach {
                    stack[height] = (child.first, d[side]);
                    height += 1;
                }
            }
        }
        (best.0 != u32::MAX).then_some(best)
    }

    /// Calls `found` for every primitive whose box overlaps `region`, and for some whose box only comes close (leaves
    /// are not looked into). The order depends on the tree: sort, or take a minimum.
    #[inline]
    pub(crate) fn for_each_overlap(&self, region: &Aabb, found: impl FnMut(u32)) {
        self.for_each_where(|bounds| bounds.overlaps(region), found);
    }

    /// Calls `found` for every primitive in a leaf for which `inside` holds, as it must for all boxes above it.
    #[inline]
    pub(crate) fn for_each_where(&self, inside: impl Fn(&Aabb) -> bool, mut found: impl FnMut(u32)) {
        let mut stack = [0u32; STACK];
        let mut height = 1;
        while height > 0 {
            height -= 1;
            for child in &self.pairs[stack[height] as usize].0 {
                if !inside(&child.bounds) {
                    continue;
                }
                if child.count == INNER {
                    stack[height] = child.first;
                    height += 1;
                } else {
                    let run = &self.primitives[child.first as usize..(child.first + child.count) as usize];
                    run.iter().for_each(|&primitive| found(primitive));
                }
            }
        }
    }

    /// Boxes of at most `wanted` nodes that together hold all primitives: of the largest box its children are taken
    /// instead, again and again.
    pub(crate) fn cover(&self, wanted: usize) -> Vec<Aabb> {
        let mut nodes = self.pairs[0].0.to_vec();
        while nodes.len() < wanted {
            let inner = (0..nodes.len()).filter(|&n| nodes[n].count == INNER);
            let area = |n: usize| nodes[n].bounds.half_area();
            let Some(largest) = inner.max_by(|&a, &b| area(a).total_cmp(&area(b))) else { break };
            let [a, b] = self.pairs[nodes[largest].first as usize].0;
            nodes[largest] = a;
            nodes.push(b);
        }
        nodes.retain(|node| node.bounds.min[0] <= node.bounds.max[0]);
        nodes.into_iter().map(|node| node.bounds).collect()
    }

    fn run(&self, leaf: &Node) -> &[u32] {
        &self.primitives[leaf.first as usize..(leaf.first + leaf.count) as usize]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::distance::closest_on_segment;
    use crate::geometry::random::SplitMix64;

    fn segments(random: &mut SplitMix64, n: usize, length: f64) -> Vec<[Vec3; 2]> {
        let mut end = |p: Vec3| [p, p + random.vector() * length];
        let mut starts = SplitMix64::new(n as u64);
        (0..n).map(|_| end(starts.vector())).collect()
    }

    fn boxes(segments: &[[Vec3; 2]]) -> Vec<Aabb> {
        segments.iter().map(|s| Aabb::of_segment(&s[0], &s[1])).collect()
    }

    fn distance_squared(p: &Vec3, s: &[Vec3; 2]) -> f64 {
        (p - s[0] - (s[1] - s[0]) * closest_on_segment(p, &s[0], &s[1])).norm_squared()
    }

    #[test]
    fn nearest_is_what_looking_at_every_primitive_finds() {
        let mut random = SplitMix64::new(4);
        for n in [0, 1, 2, 3, 17, 400] {
            let segments = segments(&mut random, n, 0.2);
            let tree = Bvh::build(&boxes(&segments));
            for _ in 0..300 {
                let p = random.vector() * 1.5;
                let reach = 0.3 + 0.3 * random.signed();
                let all = segments.iter().enumerate().map(|(i, s)| (distance_squared(&p, s), i as u32));
                let expected = all.filter(|(d, _)| *d <= reach * reach).min_by(|a, b| a.partial_cmp(b).unwrap());
                let expected = expected.map(|(d, i)| (i, d));
                let distance = |i: u32| distance_squared(&p, &segments[i as usize]);
                assert_eq!(tree.nearest(&p, reach, None, distance), expected);
                let guess = (n > 0).then(|| (random.signed().abs() * n as f64) as u32);
                assert_eq!(tree.nearest(&p, reach, guess, distance), expected);
            }
        }
    }

    #[test]
    fn equally_close_primitives_are_decided_by_their_index() {
        // Many copies of two segments: whatever the tree looks like, the lowest index of a copy must win.
        let s = [[Vec3::x(), Vec3::y()], [Vec3::z(), Vec3::x() * 3.0]];
        let segments: Vec<_> = (0..100).map(|i| s[(i / 7 + 1) % 2]).collect();
        let tree = Bvh::build(&boxes(&segments));
        let mut random = SplitMix64::new(5);
        for _ in 0..100 {
            let p = random.vector() * 2.0;
            let found = tree.nearest(&p, f64::INFINITY, Some(93), |i| distance_squared(&p, &segments[i as usize]));
            let first_is_closer = distance_squared(&p, &s[0]) < distance_squared(&p, &s[1]);
            assert_eq!(found.map(|f| f.0), Some(if first_is_closer { 7 } else { 0 }));
        }
    }

    #[test]
    fn overlaps_and_self_pairs_miss_nothing_and_repeat_nothing() {
        let mut random = SplitMix64::new(6);
        for n in [0, 1, 2, 5, 300] {
            let boxes = boxes(&segments(&mut random, n, 0.3));
            let tree = Bvh::build(&boxes);
            for _ in 0..50 {
                let p = random.vector();
                let region = Aabb::of_segment(&p, &(p + random.vector() * 0.3));
                let mut found = Vec::new();
                tree.for_each_overlap(&region, |i| found.push(i));
                found.sort_unstable();
                assert!(found.windows(2).all(|w| w[0] < w[1]));
                for i in 0..n as u32 {
                    assert!(!boxes[i as usize].overlaps(&region) || found.binary_search(&i).is_ok());
                }
            }
            let mut pairs = Vec::new();
            tree.self_pairs(|a, b| pairs.push((a, b)));
            pairs.sort_unstable();
            assert!(pairs.windows(2).all(|w| w[0] < w[1]) && pairs.iter().all(|p| p.0 < p.1));
            for a in 0..n as u32 {
                for b in a + 1..n as u32 {
                    let overlap = boxes[a as usize].overlaps(&boxes[b as usize]);
                    assert!(!overlap || pairs.binary_search(&(a, b)).is_ok());
                }
            }
            // Only pairs of neighbouring leaves come on top.
            assert!(pairs.len() <= n * n / 4 + n);
        }
    }

    #[test]
    fn a_refit_tree_answers_like_a_new_one_on_any_number_of_threads() {
        let mut random = SplitMix64::new(7);
        let before = segments(&mut random, 20_000, 0.02);
        let after: Vec<_> = before.iter().map(|s| s.map(|p| p + Vec3::new(p.y, p.z * p.x, 0.3))).collect();
        let moved = boxes(&after);
        let refit = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let mut tree = Bvh::build(&boxes(&before));
            pool.install(|| tree.refit(|i| moved[i as usize]));
            tree
        };
        let (one, three, new) = (refit(1), refit(3), Bvh::build(&moved));
        assert_eq!(format!("{one:?}"), format!("{three:?}"));
        assert_eq!(one.bounds(), new.bounds());
        for _ in 0..200 {
            let p = random.vector();
            let distance = |i: u32| distance_squared(&p, &after[i as usize]);
            assert_eq!(one.nearest(&p, 1.0, None, distance), new.nearest(&p, 1.0, None, distance));
        }
        assert!(one.cost() > new.cost());
    }

    #[test]
    fn coinciding_and_geometrically_spread_boxes_stay_within_the_stack() {
        let same = vec![Aabb::of_point(&Vec3::x()); 5000];
        let spread: Vec<_> = (0..5000).map(|i| Aabb::of_point(&(Vec3::x() * 0.99f64.powi(i)))).collect();
        for boxes in [same, spread] {
            let mut count = 0;
            Bvh::build(&boxes).for_each_overlap(&Aabb::of_segment(&Vec3::zeros(), &Vec3::x()), |_| count += 1);
            assert_eq!(count, 5000);
        }
    }
}
