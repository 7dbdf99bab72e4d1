//! Judged by integer arithmetic and by looking at everything.

use std::collections::BTreeSet;

use super::*;
use crate::geometry::random::SplitMix64;
use crate::geometry::testing::torus;

type Point = [i128; 3];

fn minus(a: Point, b: Point) -> Point {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

fn cross(a: Point, b: Point) -> Point {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn dot(a: Point, b: Point) -> i128 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Conditions `c0 + c1 s >= 0` on a parameter `s` in [0, 1], in whole numbers: an interval between two fractions.
struct Interval {
    low: [i128; 2],
    high: [i128; 2],
    is_empty: bool,
}

impl Interval {
    fn whole() -> Self {
        Self { low: [0, 1], high: [1, 1], is_empty: false }
    }

    fn at_least_zero(&mut self, c0: i128, c1: i128) {
        match c1.signum() {
            0 => self.is_empty |= c0 < 0,
            1 if self.low[0] * c1 < -c0 * self.low[1] => self.low = [-c0, c1],
            -1 if self.high[0] * -c1 > c0 * self.high[1] => self.high = [c0, -c1],
            _ => {}
        }
        self.is_empty |= self.low[0] * self.high[1] > self.high[0] * self.low[1];
    }

    fn zero(&mut self, c0: i128, c1: i128) {
        self.at_least_zero(c0, c1);
        self.at_least_zero(-c0, -c1);
    }
}

/// The judge: the part of the segment that fulfils all conditions of the triangle, or of the segment or point that the
/// triangle really is. No sign of a tetrahedron is looked at.
fn meets_in_integers(segment: &[Point; 2], triangle: &[Point; 3]) -> bool {
    let [a, b, c] = *triangle;
    let (p, d) = (segment[0], minus(segment[1], segment[0]));
    let mut part = Interval::whole();
    let normal = cross(minus(b, a), minus(c, a));
    if normal != [0; 3] {
        part.zero(dot(normal, minus(p, a)), dot(normal, d));
        for (from, to) in [(a, b), (b, c), (c, a)] {
            let inwards = cross(normal, minus(to, from));
            part.at_least_zero(dot(inwards, minus(p, from)), dot(inwards, d));
        }
        return !part.is_empty;
    }
    let length = |&(u, w): &(Point, Point)| dot(minus(w, u), minus(w, u));
    let (u, w) = [(a, b), (b, c), (c, a)].into_iter().max_by_key(length).unwrap();
    let along = minus(w, u);
    let (off, turn) = (cross(along, minus(p, u)), cross(along, d));
    (0..3).for_each(|k| part.zero(off[k], turn[k]));
    part.at_least_zero(dot(along, minus(p, u)), dot(along, d));
    part.at_least_zero(dot(along, minus(w, p)), -dot(along, d));
    if along == [0; 3] {
        (0..3).for_each(|k| part.zero(p[k] - a[k], d[k]));
    }
    !part.is_empty
}

fn whole(random: &mut SplitMix64, size: i128) -> i128 {
    ((random.signed() + 1.0) * 0.5 * (2 * size + 1) as f64) as i128 - size
}

/// Points of a small grid, so that every kind of coincidence is frequent.
fn grid_case(random: &mut SplitMix64, size: i128) -> ([Point; 2], [Point; 3]) {
    let mut point = || [0; 3].map(|_: i128| whole(random, size));
    ([point(), point()], [point(), point(), point()])
}

/// An invertible whole map: what meets before it meets after it, but no determinant fits a double any more.
fn map(random: &mut SplitMix64) -> impl Fn(Point) -> Point + use<> {
    let mut number = |bits: u32| whole(random, 1 << bits);
    let (shift, mut rows) = ([0; 3].map(|_| number(48)), [[0; 3]; 3]);
    while dot(rows[0], cross(rows[1], rows[2])) == 0 {
        rows = [[0; 3]; 3].map(|row: Point| row.map(|_| number(40)));
    }
    move |p| [0, 1, 2].map(|k| dot(rows[k], p) + shift[k])
}

fn floats<const N: usize>(points: [Point; N], scale: f64) -> [Vec3; N] {
    points.map(|p| Vec3::from(p.map(|x| x as f64 * scale)))
}

fn compare_on_grids(count: usize, seed: u64) {
    let mut random = SplitMix64::new(seed);
    let mut met = 0;
    for i in 0..count {
        let (segment, triangle) = grid_case(&mut random, 1 + (i % 4) as i128);
        let expected = meets_in_integers(&segment, &triangle);
        met += usize::from(expected);
        let change = map(&mut random);
        // Powers of two change nothing; at the smallest the product of two determinants is no number any more.
        let scale = [1.0, 2f64.powi(-280), 2f64.powi(250)][i % 3];
        let plain = (floats(segment, scale), floats(triangle, scale));
        let mapped = (floats(segment.map(&change), 1.0), floats(triangle.map(&change), 1.0));
        for (s, t) in [plain, mapped] {
            let answer = segment_meets_triangle(&s, &t);
            assert_eq!(answer, expected, "segment {segment:?}, triangle {triangle:?}");
            let [a, b, c] = t;
            for order in [[b, c, a], [c, a, b], [a, c, b], [c, b, a], [b, a, c]] {
                assert_eq!(segment_meets_triangle(&s, &order), expected, "order of {segment:?}, {triangle:?}");
            }
            assert_eq!(segment_meets_triangle(&[s[1], s[0]], &t), expected);
        }
    }
    assert!(met > count / 20 && met < count * 19 / 20, "{met} of {count} met");
}

#[test]
fn the_answer_is_that_of_integer_arithmetic_in_any_order_of_the_vertices() {
    compare_on_grids(120_000, 1);
}

#[test]
fn touching_is_meeting_and_lying_side_by_side_is_not() {
    let v = |x: f64, y: f64, z: f64| Vec3::new(x, y, z);
    let triangle = [v(0.0, 0.0, 0.0), v(1.0, 0.0, 0.0), v(0.0, 1.0, 0.0)];
    let tiny = f64::MIN_POSITIVE.sqrt();
    for (segment, expected) in [
        ([v(0.2, 0.2, 0.0), v(0.2, 0.2, 1.0)], true),    // an end on the triangle
        ([v(0.2, 0.2, tiny), v(0.2, 0.2, 1.0)], false),  // an end just above
        ([v(0.5, 0.5, -1.0), v(0.5, 0.5, 1.0)], true),   // through an edge
        ([v(1.0, 0.0, -1.0), v(1.0, 0.0, 1.0)], true),   // through a corner
        ([v(2.0, -1.0, 0.0), v(2.0, 1.0, 0.0)], false),  // in the plane, beside
        ([v(0.1, 0.1, 0.0), v(0.2, 0.1, 0.0)], true),    // in the plane, inside
        ([v(-1.0, 0.1, 0.0), v(2.0, 0.1, 0.0)], true),   // in the plane, through
        ([v(0.0, 2.0, 0.0), v(0.0, 1.0, 0.0)], true),    // in the plane, touching a corner along an edge
        ([v(0.2, 0.2, 0.0), v(0.2, 0.2, 0.0)], true),    // a point inside
        ([v(0.2, 0.2, tiny), v(0.2, 0.2, tiny)], false), // a point above
    ] {
        assert_eq!(segment_meets_triangle(&segment, &triangle), expected, "{segment:?}");
    }
}

fn by_looking_at_everything(edges_of: &Surface<'_>, triangles_of: &Surface<'_>, is_same: bool) -> Vec<Crossing> {
    let mut found = BTreeSet::new();
    let edges: BTreeSet<[u32; 2]> = edges_of.triangles.iter().flat_map(|t| [0, 1, 2].map(|k| edge(t, k))).collect();
    for edge in edges {
        for &triangle in triangles_of.triangles {
            let segment = edge.map(|v| edges_of.positions[v as usize]);
            let corners = triangle.map(|v| triangles_of.positions[v as usize]);
            let apart = !is_same || !edge.iter().any(|v| triangle.contains(v));
            if apart && segment_meets_triangle(&segment, &corners) {
                found.insert(Crossing { edge, triangle });
            }
        }
    }
    found.into_iter().collect()
}

/// A sheet of `n` by `n` squares in the plane z = 0, squares of size 1.
fn sheet(n: u32) -> (Vec<[u32; 3]>, Vec<Vec3>) {
    let id = |i: u32, j: u32| i * (n + 1) + j;
    let place = |i: u32, j: u32| Vec3::new(f64::from(i), f64::from(j), 0.0);
    let points = (0..=n).flat_map(|i| (0..=n).map(move |j| place(i, j))).collect();
    let squares = (0..n).flat_map(|i| (0..n).map(move |j| [id(i, j), id(i + 1, j), id(i + 1, j + 1), id(i, j + 1)]));
    (squares.flat_map(|[a, b, c, d]| [[a, b, c], [a, c, d]]).collect(), points)
}

/// Meshes with few, many and degenerate crossings, non-manifold edges and doubled triangles among them.
fn meshes() -> Vec<CrossingSearch> {
    let mut random = SplitMix64::new(77);
    let mut meshes = Vec::new();
    for size in [0.0, 0.5, 2.0] {
        let (triangles, mut x) = sheet(12);
        x.iter_mut().for_each(|p| *p += random.vector() * size);
        meshes.push(CrossingSearch::new(triangles, x));
    }
    let (triangles, mut x) = sheet(9);
    x.iter_mut().for_each(|p| *p = (*p * 0.3 + random.vector() * 2.0).map(f64::round));
    meshes.push(CrossingSearch::new(triangles, x));
    let soup = |random: &mut SplitMix64| [0; 3].map(|_| ((random.signed() + 1.0) * 30.0) as u32);
    let triangles = (0..300).map(|_| soup(&mut random)).collect();
    meshes.push(CrossingSearch::new(triangles, (0..60).map(|_| random.vector()).collect()));
    let (triangles, x) = torus(16, 1.0, 0.3);
    meshes.push(CrossingSearch::new(triangles, x));
    meshes
}

#[test]
fn the_trees_find_every_crossing_that_looking_at_everything_finds() {
    let meshes = meshes();
    let counts = meshes.iter().map(|mesh| {
        let found = find(&mesh.surface());
        assert_eq!(found, by_looking_at_everything(&mesh.surface(), &mesh.surface(), true));
        found.len()
    });
    let counts: Vec<usize> = counts.collect();
    assert!(counts[0] == 0 && counts[5] == 0 && counts[1..5].iter().all(|&count| count > 0), "{counts:?}");
}

#[test]
fn crossings_of_what_moved_are_those_with_a_moved_vertex() {
    for mesh in meshes() {
        let all = find(&mesh.surface());
        for stride in [2, 7, 40] {
            let is_moved = |v: u32| v % stride == 1;
            let moved = |c: &&Crossing| c.edge.iter().chain(&c.triangle).any(|&v| is_moved(v));
            let expected: Vec<Crossing> = all.iter().filter(moved).copied().collect();
            assert_eq!(find_moved(&mesh.surface(), is_moved), expected);
        }
        assert!(find_moved(&mesh.surface(), |_| false).is_empty());
    }
}

#[test]
fn crossings_between_surfaces_are_those_that_looking_at_everything_finds() {
    let meshes = meshes();
    for (a, b) in meshes.iter().zip(meshes.iter().cycle().skip(1)) {
        let (a, b) = (a.surface(), b.surface());
        assert_eq!(find_between(&a, &b), by_looking_at_everything(&a, &b, false));
        assert_eq!(find_between(&b, &a), by_looking_at_everything(&b, &a, false));
    }
}

#[test]
fn a_flat_sheet_does_not_cross_itself_until_it_lies_on_itself() {
    let (triangles, mut x) = sheet(20);
    assert!(find(&CrossingSearch::new(triangles.clone(), x.clone()).surface()).is_empty());
    // Folded flat along the middle: every vertex of one half lies on one of the other half.
    x.iter_mut().for_each(|p| p.x = p.x.min(20.0 - p.x));
    assert!(find(&CrossingSearch::new(triangles, x).surface()).len() > 1000);
}

#[test]
fn the_number_of_threads_does_not_change_the_list() {
    let (triangles, mut x) = sheet(40);
    let mut random = SplitMix64::new(5);
    x.iter_mut().for_each(|p| *p += random.vector());
    let mesh = CrossingSearch::new(triangles, x);
    let lists = [1, 2, 3, 7].map(|threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| find(&mesh.surface()))
    });
    assert!(lists[0].len() > 1000);
    assert!(lists.iter().all(|list| *list == lists[0]));
}

#[test]
fn a_search_that_follows_the_motion_finds_what_a_new_one_finds() {
    let (triangles, mut x) = sheet(15);
    let mut search = CrossingSearch::new(triangles.clone(), x.clone());
    let mut random = SplitMix64::new(9);
    for _ in 0..8 {
        x.iter_mut().for_each(|p| *p += random.vector());
        search.place(x.iter().copied());
        let found = find(&search.surface());
        assert_eq!(found, find(&CrossingSearch::new(triangles.clone(), x.clone()).surface()));
        assert!(!found.is_empty());
    }
}
