use std::sync::Arc;

use super::*;
use crate::contact::broad_phase::swept_search::{Inflation, SweptPairs};
use crate::contact::intersections::exact::crossings;
use crate::contact::testing::{below, on_ranks};
use crate::contact::topology::cloth_surface::LocalClothSurface;
use crate::contact::topology::nodes::NodePaths;
use crate::contact::topology::surface::BodyFaces;
use crate::geometry::crossings::Crossing;
use crate::parallel::ranks::Ranks;

/// Distance that collisions keep [m].
const GAP: f64 = 10.0 * f32::EPSILON as f64;

/// Distance from the paths within which pairs are searched.
const AROUND: Inflation = Inflation { gap: GAP, margin: 0.02 };

/// Vertices along each side of a sheet, and sheets.
const SIDE: usize = 16;
const SHEETS: usize = 3;
const SHEET: usize = SIDE * SIDE;
const CLOTH: usize = SHEETS * SHEET;

/// Triangles of a square sheet, its vertices row by row.
fn sheet() -> Vec<[u32; 3]> {
    let n = SIDE as u32;
    let corners = (0..n * (n - 1)).filter(|k| k % n < n - 1);
    corners.flat_map(|k| [[k, k + n, k + 1], [k + 1, k + n, k + 1 + n]]).collect()
}

/// Sheets that are folded and lie on each other and on a body, all as one array; how they are cut among ranks.
pub(crate) struct Heap {
    triangles: Vec<[u32; 3]>,
    rest: Vec<Vec3>,
    thickness: Vec<f64>,
    edge_length: Vec<f64>,
    mobility: Vec<f64>,
    /// First vertex of each block of sums, and the number of all vertices.
    blocks: Vec<usize>,
    /// Positions of all nodes at four times.
    x: [Vec<Vec3>; 4],
}

impl Heap {
    /// With `mixed`, neighbours on the cloth have numbers far apart.
    pub(crate) fn random(random: &mut SplitMix64, mixed: bool) -> Self {
        let mut order: Vec<u32> = (0..SHEET as u32).collect();
        if mixed {
            (0..SHEET).for_each(|i| order.swap(i, below(random, SHEET)));
        }
        let of_sheet = |s: usize| sheet().into_iter().map(move |t| (s, t));
        let place = |s: usize, v: u32| order[v as usize] + (s * SHEET) as u32;
        let triangles = (0..SHEETS).flat_map(of_sheet).map(|(s, t)| t.map(|v| place(s, v))).collect();
        let mut rest = vec![Vec3::zeros(); CLOTH];
        let mut x = vec![Vec3::zeros(); CLOTH];
        for (s, v) in (0..SHEETS).flat_map(|s| (0..SHEET as u32).map(move |v| (s, v))) {
            let (i, j) = (f64::from(v % SIDE as u32), f64::from(v / SIDE as u32));
            let flat = place(s, v) as usize;
            rest[flat] = Vec3::new(i, 0.0, j) * 0.01;
            // Folded three times along one side.
            let (row, along) = ((i / 5.0).floor(), i % 5.0);
            let across = if (row as usize).is_multiple_of(2) { along } else { 5.0 - along };
            x[flat] = Vec3::new(across, 2.4 * row + 0.8 * s as f64, j) * 0.01;
        }
        // A body under the sheets.
        let point = |v: usize| Vec3::new((v % SIDE) as f64, -0.7, (v / SIDE) as f64) * 0.01;
        x.extend((0..SHEET).map(point));
        let noise = |x: &[Vec3], by: f64, random: &mut SplitMix64| x.iter().map(|x| x + random.vector() * by).collect();
        let first: Vec<Vec3> = noise(&x, 0.001, random);
        let second: Vec<Vec3> = noise(&first, 0.0008, random);
        let third: Vec<Vec3> = noise(&second, 0.004, random);
        let fourth: Vec<Vec3> = noise(&third, 0.006, random);
        let mut blocks = vec![0];
        while blocks[blocks.len() - 1] < CLOTH {
            blocks.push((blocks[blocks.len() - 1] + 1 + below(random, 40)).min(CLOTH));
        }
        Self {
            triangles,
            rest,
            thickness: (0..CLOTH).map(|_| 0.003 + 0.001 * random.signed()).collect(),
            edge_length: (0..CLOTH).map(|_| 0.01 + 0.003 * random.signed()).collect(),
            mobility: (0..CLOTH).map(|_| 2.0 + random.signed()).collect(),
            blocks,
            x: [first, second, third, fourth],
        }
    }

    /// First blocks of `ranks` ranks, and the number of all; some ranks may have none.
    pub(crate) fn cut(&self, random: &mut SplitMix64, ranks: usize) -> Vec<usize> {
        let count = self.blocks.len() - 1;
        let mut starts: Vec<usize> = (1..ranks).map(|_| below(random, count + 1)).collect();
        starts.extend([0, count]);
        starts.sort_unstable();
        starts
    }

    pub(crate) fn surface(&self, ranks: &Ranks, starts: &[usize]) -> ContactSurface {
        let mine = starts[ranks.rank()]..starts[ranks.rank() + 1];
        let own = self.blocks[mine.start]..self.blocks[mine.end];
        let has_own = |t: &&[u32; 3]| t.iter().any(|v| own.contains(&(*v as usize)));
        let block = |b: usize| self.blocks[b] - own.start..self.blocks[b + 1] - own.start;
        let share = LocalClothSurface {
            ranks: ranks.clone(),
            rank_starts: starts.iter().map(|b| self.blocks[*b] as u32).collect(),
            block_starts: starts.to_vec(),
            blocks: mine.map(block).collect(),
            place: 0..own.len(),
            triangles: self.triangles.iter().filter(has_own).copied().collect(),
            rest: self.rest[own.clone()].to_vec(),
            thickness: self.thickness[own.clone()].to_vec(),
            friction: None,
            body_friction: None,
            largest_thickness: None,
            matrix: None,
            wearing_order: None,
            edge_length: self.edge_length[own.clone()].to_vec(),
            object: own.clone().map(|v| (v / SHEET) as u32).collect(),
            mobility: self.mobility[own].to_vec(),
            mean_edge: 0.01,
        };
        ContactSurface::of_share(share, &[BodyFaces { body: 0, triangles: &sheet(), points: SHEET }])
    }

    /// Positions at a time, as a rank has them.
    pub(crate) fn at(&self, surface: &ContactSurface, time: usize) -> Vec<Vec3> {
        let nodes = surface.nodes();
        // Ghosts come from their owners.
        let own = |node: u32| nodes.is_own(node) || nodes.is_body(node);
        let place =
            |node: u32| if own(node) { self.x[time][nodes.number(node) as usize] } else { Vec3::repeat(f64::NAN) };
        let mut x: Vec<Vec3> = (0..nodes.count() as u32).map(place).collect();
        nodes.update(&mut x);
        x
    }

    /// Whether what a rank knows of its nodes is what their owners know.
    fn agrees(&self, surface: &ContactSurface) -> bool {
        let nodes = surface.nodes();
        (0..nodes.cloth()).all(|node| {
            let number = nodes.number(node as u32) as usize;
            surface.thickness()[node] == self.thickness[number]
                && surface.edge_length()[node] == self.edge_length[number]
                && surface.rest()[node] == self.rest[number]
                && surface.mobility()[node] == Vec3::repeat(self.mobility[number])
        })
    }
}

/// An entry of the list in numbers of the scene: the pair, and the bits of its distance, thickness and present bound.
type Entry = (Pair, u32, u32, u64);

/// Search results of a rank.
#[derive(Debug, Clone, PartialEq)]
struct Found {
    /// First own vertex, and the first that is not.
    own: [u32; 2],
    /// Pairs held after three searches, ascending.
    held: Vec<Vec<Entry>>,
    /// Longest ways, after each.
    used: Vec<u64>,
    /// Ways of own nodes.
    displacements: Vec<u64>,
    /// Pairs that may meet, from the list and along paths.
    close: Vec<Pair>,
    swept: Vec<Pair>,
    /// After some nodes have left what was searched, and after more have.
    renewed: [Vec<Pair>; 2],
    crossings: [Vec<Crossing>; 3],
}

/// The pairs of the list, ascending.
fn entries(proximity: &ProximityList, surface: &ContactSurface) -> Vec<Entry> {
    let entry = |n: CandidatePair| {
        let pair = surface.nodes().numbered(&n.pair);
        (pair, n.distance.to_bits(), n.thickness.to_bits(), proximity.distance_bound(&n).to_bits())
    };
    let mut entries: Vec<Entry> = KINDS.iter().flat_map(|kind| proximity.list(*kind)).map(entry).collect();
    entries.sort_unstable();
    entries
}

fn search(heap: &Heap, ranks: &Ranks, starts: &[usize]) -> Found {
    let mut surface = heap.surface(ranks, starts);
    let corners = surface.nodes().ghosts().len();
    let mut search = PairSearch::new();
    let mut proximity = ProximityList::new(&surface);
    let (mut held, mut used) = (Vec::new(), Vec::new());
    for (time, reach, is_predicted) in [(0, 0.3, false), (0, 0.05, true), (1, 0.1, false)] {
        let mut x = heap.at(&surface, time);
        let predicted = is_predicted.then(|| PredictedPaths { ends: heap.at(&surface, 1), duration: 2.0 });
        proximity.rebuild(&mut surface, &mut search, &mut x, reach, GAP, predicted);
        assert_eq!(x, heap.at(&surface, time), "positions follow the ghosts");
        assert!(heap.agrees(&surface));
        let end = heap.at(&surface, 2);
        used.push(proximity.update_displacements(&surface, [&x; 2].map(Vec::as_slice), [0.0; 2]).to_bits());
        used.push(proximity.update_displacements(&surface, [&x, &end].map(Vec::as_slice), [0.0, 1.0]).to_bits());
        held.push(entries(&proximity, &surface));
    }
    let nodes = surface.nodes().clone();
    let displacements = nodes.own().map(|node| proximity.displacements[node].to_bits()).collect();
    let numbered = |pairs: &[Vec<Pair>], surface: &ContactSurface| {
        let mut pairs: Vec<Pair> = pairs.iter().flatten().map(|pair| surface.nodes().numbered(pair)).collect();
        pairs.sort_unstable();
        pairs
    };
    let mut pairs = Vec::new();
    proximity.close_pairs(GAP, 0.02, &mut pairs);
    let close = numbered(&pairs, &surface);
    let mut paths = NodePaths { start: heap.at(&surface, 2), end: heap.at(&surface, 3) };
    search.swept_pairs(&mut surface, &mut proximity, &mut paths, AROUND, &mut pairs);
    let swept = numbered(&pairs, &surface);
    assert_eq!(paths.end, heap.at(&surface, 3));
    let renewed = [7, 3].map(|every| {
        renew(every, heap, (&mut surface, &mut proximity), (&mut search, &mut paths, &mut pairs));
        numbered(&pairs, &surface)
    });
    assert!(heap.agrees(&surface));
    let wide = surface.set_nodes(nodes);
    proximity.renumber(&wide, &surface);
    paths.renumber(&wide);
    assert_eq!(paths.start, heap.at(&surface, 2), "ghosts that visitors brought are gone again");
    assert_eq!(Some(&entries(&proximity, &surface)), held.last());
    let mut check = |time: usize, moved: Option<u32>| {
        let x = heap.at(&surface, time);
        search.refit(&surface, |i| Aabb::of_point(&x[i]));
        let of_third = |third: u32| (0..x.len() as u32).map(move |node| (node, third));
        let moved = moved.map(|third| -> Vec<u8> {
            of_third(third).map(|(node, third)| u8::from(surface.nodes().number(node) % 3 == third)).collect()
        });
        crossings(&surface, &search, &x, moved.as_deref())
    };
    let crossings = [check(0, None), check(2, None), check(2, Some(1))];
    assert!(ranks.is_alone() || surface.nodes().ghosts().len() >= corners);
    let own = [nodes_own(&surface, 0), nodes_own(&surface, 1)];
    Found { own, held, used, displacements, close, swept, renewed, crossings }
}

/// Sends every so manieth node elsewhere, and renews the search; a new one has to find the same.
fn renew(
    every: u32,
    heap: &Heap,
    (surface, proximity): (&mut ContactSurface, &mut ProximityList),
    (search, paths, pairs): (&mut PairSearch, &mut NodePaths, &mut Vec<Vec<Pair>>),
) {
    let elsewhere = heap.at(surface, 1);
    let goes: Vec<bool> = (0..elsewhere.len() as u32).map(|n| surface.nodes().number(n) % every == 0).collect();
    let nodes = surface.nodes().clone();
    let mut left = vec![0; goes.len()];
    for node in (0..nodes.cloth()).filter(|node| goes[*node]) {
        paths.end[node] = elsewhere[node];
        left[node] = u8::from(nodes.own().contains(&node));
    }
    search.update_swept_pairs(surface, proximity, paths, AROUND, SweptPairs { left: &mut left, found: pairs });
    let (mut anew, mut others) = (PairSearch::new(), Vec::new());
    // Another tree may import more.
    if let Some(renumber) = anew.swept_pairs(surface, proximity, paths, AROUND, &mut others) {
        renumber.renumber(pairs.iter_mut().flatten().flat_map(|pair| &mut pair.nodes));
    }
    let [pairs, others] = [pairs.concat(), others.concat()].map(|mut pairs| {
        pairs.sort_unstable();
        pairs
    });
    assert!(pairs == others, "{} pairs of {}", pairs.len(), others.len());
    *search = anew;
}

/// Number in the scene of the first own vertex (0), or of the first behind (1).
fn nodes_own(surface: &ContactSurface, end: usize) -> u32 {
    let own = surface.nodes().own();
    let first = if own.is_empty() { 0 } else { surface.nodes().number(own.start as u32) };
    first + (end * own.len()) as u32
}

#[test]
fn any_number_of_ranks_finds_the_pairs_the_ways_and_the_crossings_of_one() {
    let mut random = SplitMix64::new(93);
    for mixed in [false, true] {
        let heap = Arc::new(Heap::random(&mut random, mixed));
        let alone = {
            let (heap, starts) = (heap.clone(), heap.cut(&mut random, 1));
            on_ranks(1, move |ranks| search(&heap, &ranks, &starts)).remove(0)
        };
        assert!(
            alone.held.iter().all(|list| list.len() > 300),
            "{:?} are close",
            alone.held.iter().map(Vec::len).collect::<Vec<_>>()
        );
        assert!(alone.crossings.iter().skip(1).all(|list| list.len() > 20) && alone.close.len() > 20);
        assert!(alone.crossings[1].len() > alone.crossings[2].len());
        for count in [2, 3, 5] {
            let (shared, starts) = (heap.clone(), heap.cut(&mut random, count));
            let found = on_ranks(count, move |ranks| search(&shared, &ranks, &starts));
            compare(&alone, &found);
        }
    }
}

fn compare(alone: &Found, found: &[Found]) {
    for rank in found {
        assert_eq!(rank.used, alone.used);
        assert_eq!(rank.crossings, alone.crossings);
        let own = rank.own[0]..rank.own[1];
        for (held, all) in rank.held.iter().zip(&alone.held) {
            let holds = |entry: &&Entry| entry.0.nodes.iter().any(|node| own.contains(node));
            let expected: Vec<Entry> = all.iter().filter(holds).copied().collect();
            assert!(*held == expected, "{} pairs of {}", held.len(), expected.len());
        }
    }
    let displacements: Vec<u64> = found.iter().flat_map(|rank| &rank.displacements).copied().collect();
    assert_eq!(displacements, alone.displacements);
    let lists: [fn(&Found) -> &Vec<Pair>; 4] =
        [|found| &found.close, |found| &found.swept, |found| &found.renewed[0], |found| &found.renewed[1]];
    for list in lists {
        let mut all: Vec<Pair> = found.iter().flat_map(list).copied().collect();
        all.sort_unstable();
        assert!(all == *list(alone), "{} pairs of {}", all.len(), list(alone).len());
    }
}
