//! Queries with integer coordinates, most of them degenerate in some way. Each kind is a function of random numbers.

use drapery_core::Vec3;
use drapery_core::geometry::random::SplitMix64;

/// A point, and the four points of a query at one time.
type Point = [i64; 3];
type Points = [Point; 4];

/// Makes the points at time 0 and 1; the flag asks for edges, not for point and triangle.
type Make = fn(&mut Random, bool) -> [Points; 2];

/// The kinds by name.
pub(super) const KINDS: [(&str, Make); 13] = [
    ("random", random),
    ("passing", |r, edges| passing(r, edges, 0)),
    ("grazing", |r, edges| passing(r, edges, 1)),
    ("end touch", end_touch),
    ("double root", |r, edges| double_root(r, edges, 0)),
    ("near double", |r, edges| double_root(r, edges, 1)),
    ("parallel", parallel),
    ("coplanar", coplanar),
    ("collinear", collinear),
    ("still", still),
    ("shared", shared),
    ("turning", turning),
    ("flat turning", flat_turning),
];

/// SplitMix64.
pub(super) struct Random(SplitMix64);

impl Random {
    pub(super) fn new(name: &str, edges: bool) -> Self {
        let seed = name.bytes().fold(u64::from(edges), |seed, b| seed.wrapping_mul(31).wrapping_add(u64::from(b)));
        Self(SplitMix64::new(seed))
    }

    /// Uniform in [-1, 1).
    pub(super) fn number(&mut self) -> f64 {
        self.0.signed()
    }

    /// Uniform in the cube [-1, 1)³.
    pub(super) fn vector(&mut self) -> Vec3 {
        Vec3::new(self.number(), self.number(), self.number())
    }

    /// From -size to size.
    fn integer(&mut self, size: i64) -> i64 {
        (self.0.bits() % (2 * size as u64 + 1)) as i64 - size
    }

    fn point(&mut self, size: i64) -> Point {
        [0; 3].map(|_| self.integer(size))
    }

    fn points(&mut self, size: i64) -> Points {
        [[0; 3]; 4].map(|_| self.point(size))
    }

    /// 2 to 2^`most`, small and large alike.
    fn size(&mut self, most: u64) -> i64 {
        1 << (1 + self.0.bits() % most)
    }

    fn chance(&mut self, one_in: u64) -> bool {
        self.0.bits().is_multiple_of(one_in)
    }
}

fn sum(terms: &[(i64, Point)]) -> Point {
    [0, 1, 2].map(|i| terms.iter().map(|(factor, p)| factor * p[i]).sum())
}

/// Corners of the set of differences, as the judge takes them.
pub(super) fn differences(x: &Points, edges: bool) -> Vec<Point> {
    let pairs: &[[usize; 2]] = if edges { &[[0, 2], [0, 3], [1, 2], [1, 3]] } else { &[[0, 1], [0, 2], [0, 3]] };
    pairs.iter().map(|&[a, b]| sum(&[(1, x[a]), (-1, x[b])])).collect()
}

/// Position and size of a query: integers are moved and scaled without rounding.
pub(super) struct Place {
    shift: i64,
    scale: f64,
}

impl Place {
    /// In turn: as it is, 100 km from the origin at a size of 1 m, tiny, huge.
    pub(super) fn of(number: usize) -> Self {
        match number % 8 {
            5 => Self { shift: 100_000 << 20, scale: 2f64.powi(-20) },
            6 => Self { shift: 0, scale: 2f64.powi(-1000) },
            7 => Self { shift: 0, scale: 2f64.powi(1000) },
            _ => Self { shift: 0, scale: 1.0 },
        }
    }

    pub(super) fn put(&self, x: &Points) -> [Vec3; 4] {
        x.map(|p| Vec3::from(p.map(|c| (c + self.shift) as f64 * self.scale)))
    }
}

fn random(r: &mut Random, _: bool) -> [Points; 2] {
    let (size, speed) = (r.size(17), r.size(17));
    let start = r.points(size);
    [start, start.map(|x| sum(&[(1, x), (1, r.point(speed))]))]
}

/// Points that touch inside, on a border or in a corner.
fn touching(r: &mut Random, edges: bool) -> Points {
    let size = r.size(13);
    let [a, b, c, d] = r.points(size).map(|p| sum(&[(4, p)]));
    let quarter = |terms: &[(i64, Point)]| sum(terms).map(|c| c / 4);
    let share = r.integer(2) + 2;
    if edges {
        // The second edge starts at b and has its middle, end or start on the first one.
        let touch = quarter(&[(share, a), (4 - share, b)]);
        let far = match r.0.bits() % 3 {
            0 => sum(&[(2, touch), (-1, c)]),
            1 => touch,
            _ => sum(&[(4, touch), (-3, c)]),
        };
        return [a, b, c, far];
    }
    let rest = r.0.bits() as i64 & 3;
    let point = quarter(&[(share.min(4 - rest), b), (rest, c), (4 - rest - share.min(4 - rest), d)]);
    [point, b, c, d]
}

/// Together at half time, off by `off` units.
fn passing(r: &mut Random, edges: bool, off: i64) -> [Points; 2] {
    let mut middle = touching(r, edges);
    middle[0] = sum(&[(1, middle[0]), (1, r.point(off))]);
    let speed = r.size(14);
    let steps = r.points(speed);
    [-1, 1].map(|sign| [0, 1, 2, 3].map(|q| sum(&[(1, middle[q]), (sign, steps[q])])))
}

/// Together at the end or at the start, or off by a unit then.
fn end_touch(r: &mut Random, edges: bool) -> [Points; 2] {
    let mut touch = touching(r, edges);
    touch[0] = if r.chance(2) { sum(&[(1, touch[0]), (1, r.point(1))]) } else { touch[0] };
    let speed = r.size(14);
    let other = touch.map(|x| sum(&[(1, x), (1, r.point(speed))]));
    if r.chance(4) { [touch, other] } else { [other, touch] }
}

/// Touch at half time without approach along the normal: the volume has a double root. Off by `off` units.
fn double_root(r: &mut Random, edges: bool, off: i64) -> [Points; 2] {
    let size = r.size(12);
    let ([u, v], [du, dv]) = ([r.point(size), r.point(size)], [r.point(size), r.point(size)]);
    // The relative motion of the points that touch lies in their common plane.
    let slide = sum(&[(r.integer(2), u), (r.integer(2), v)]);
    let offset = r.point(off);
    [-1, 1].map(|sign| {
        let [u, v] = [sum(&[(1, u), (sign, du)]), sum(&[(1, v), (sign, dv)])];
        let centre = sum(&[(sign, slide), (1, offset)]);
        if edges {
            [sum(&[(1, centre), (-1, u)]), sum(&[(1, centre), (1, u)]), sum(&[(-1, v)]), v]
        } else {
            [centre, u, v, sum(&[(-1, u), (-1, v)])]
        }
    })
}

/// Edges nearly or exactly parallel, triangles nearly or exactly without area, close to each other.
fn parallel(r: &mut Random, edges: bool) -> [Points; 2] {
    let (size, wobble, speed) = (r.size(13), r.size(3) - 2, r.size(8));
    let (a, u) = (r.point(size), r.point(size));
    let along = |r: &mut Random| {
        let place = r.integer(4);
        sum(&[(1, a), (place, u), (1, r.point(wobble))])
    };
    let start =
        if edges { [along(r), along(r), along(r), along(r)] } else { [r.point(size), along(r), along(r), along(r)] };
    let drift = r.point(size);
    [start, [0, 1, 2, 3].map(|q| sum(&[(1, start[q]), (i64::from(q < 2), drift), (1, r.point(speed))]))]
}

/// Everything moves in one plane.
fn coplanar(r: &mut Random, _: bool) -> [Points; 2] {
    let (size, speed) = (r.size(12), r.size(12));
    let (u, v) = (r.point(4), r.point(4));
    let start = r.points(size);
    let end = start.map(|x| sum(&[(1, x), (1, r.point(speed))]));
    [start, end].map(|x| x.map(|[a, b, _]| sum(&[(a, u), (b, v)])))
}

/// Everything moves along one line.
fn collinear(r: &mut Random, _: bool) -> [Points; 2] {
    let (size, speed) = (r.size(12), r.size(12));
    let u = r.point(4);
    let start = r.points(size);
    let end = start.map(|x| sum(&[(1, x), (1, r.point(speed))]));
    [start, end].map(|x| x.map(|[a, _, _]| sum(&[(a, u)])))
}

/// Nothing moves, or everything by the same.
fn still(r: &mut Random, edges: bool) -> [Points; 2] {
    let size = r.size(15);
    let mut start = if r.chance(2) { touching(r, edges) } else { r.points(size) };
    start[0] = if r.chance(2) { sum(&[(1, start[0]), (1, r.point(1))]) } else { start[0] };
    let drift = if r.chance(2) { r.point(size) } else { [0; 3] };
    [start, start.map(|x| sum(&[(1, x), (1, drift)]))]
}

/// Points of a tiny lattice, some of them shared: edges without length, triangles without area, common corners.
fn shared(r: &mut Random, _: bool) -> [Points; 2] {
    let size = r.size(2);
    let [mut start, mut end] = [r.points(size), r.points(size)];
    for x in [&mut start, &mut end] {
        if r.chance(2) {
            let [from, to] = [r.0.bits() as usize % 4, r.0.bits() as usize % 4];
            x[to] = x[from];
        }
    }
    [start, end]
}

/// Everything turns about one axis, close to each other, and hardly drifts.
fn turning(r: &mut Random, edges: bool) -> [Points; 2] {
    let start = touching(r, edges).map(|x| sum(&[(8, x)]));
    let axis = r.point(8);
    turned(r, start, axis, 3)
}

/// The same in a plane.
fn flat_turning(r: &mut Random, edges: bool) -> [Points; 2] {
    let start = touching(r, edges).map(|[a, b, _]| [8 * a, 8 * b, 0]);
    turned(r, start, [0, 0, 1], 2)
}

/// Turns points that touch about an axis and moves the first of them a little, in a number of dimensions.
fn turned(r: &mut Random, mut start: Points, axis: Point, dimensions: usize) -> [Points; 2] {
    let near = r.size(6);
    let [offset, drift] = [r.point(near), r.point(near)];
    let turn = nalgebra::Rotation3::new(unit(axis) * r.number());
    let mut end: Points = start.map(|x| (turn * Vec3::from(x.map(|c| c as f64))).map(|c| c.round() as i64).into());
    for i in 0..dimensions {
        start[0][i] += offset[i];
        end[0][i] += offset[i] + drift[i];
    }
    [start, end]
}

fn unit(axis: Point) -> Vec3 {
    Vec3::from(axis.map(|c| c as f64)).try_normalize(0.0).unwrap_or(Vec3::y())
}
