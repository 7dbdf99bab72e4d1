//! Parts of a surface that have passed through one another: a hand in the torso, an armpit in its crease.
//!
//! A *fold* is shallow: cloth lies in it, and comes out when it opens. A part that is *deep* inside another one, or moves through its surface
//! fast, has passed through the cloth between them, or under it. On its way out it would take along all cloth that lies on the other
//! part, which no animator means. So cloth passes through deep parts, and is outside of them once they have come out.
//! Parts that lie in each other from the start on, such as the limbs of a body that is built of closed shells, are one body: cloth stays
//! outside of all.

use std::collections::BTreeMap;

use crate::Vec3;
use crate::geometry::aabb::Aabb;
use crate::geometry::moving_surface::MovingSurface;
use crate::tolerances::{BESIDE_SURFACE, DEEP_PART};

/// Rings of triangles around those that cross each other in which cloth counts as pinched.
const RINGS: usize = 2;

/// Crossings of a surface with itself at a sample.
#[derive(Debug, Clone, Default)]
pub(super) struct PartCrossings {
    /// Box of the triangles that cross and of what is inside another part.
    region: Aabb,
    /// Points around these triangles or inside another part, ascending.
    points: Vec<u32>,
    /// The pairs, and the points inside another part, ascending.
    crossing: Vec<[u32; 2]>,
    covered: Vec<u32>,
}

/// Parts that are deep inside others at a sample.
#[derive(Debug, Clone, Default)]
pub(super) struct DeepParts {
    /// Box of the triangles that cross there and of what is inside another part.
    region: Aabb,
    /// Points around these triangles or inside another part, and those that go with them through the other part's surface, ascending.
    points: Vec<u32>,
    /// Points that go through the other part's surface, ascending.
    passing: Vec<u32>,
}

impl PartCrossings {
    /// Finds those at the later sample of a mesh, where its points are at these `positions` [m].
    pub(super) fn of(mesh: &MovingSurface, positions: &[Vec3]) -> Self {
        let found = mesh.self_crossing(positions);
        let triangles = found.triangles();
        if triangles.is_empty() {
            return Self::default();
        }
        let corners = || triangles.iter().flat_map(|t| mesh.triangles()[*t as usize]);
        let covered = covered_points(mesh, positions, &box_of(positions, corners()));
        Self {
            region: box_of(positions, corners().chain(covered.iter().copied())),
            points: with_surroundings(mesh.triangles(), &triangles, &covered),
            crossing: found.pairs,
            covered,
        }
    }

    /// Number of pairs of triangles that cross.
    pub(super) fn pairs(&self) -> usize {
        self.crossing.len()
    }

    /// Box around everything [m].
    pub(super) fn region(&self) -> &Aabb {
        &self.region
    }

    /// Whether a point is close to a crossing, or inside another part.
    pub(super) fn is_near(&self, point: u32) -> bool {
        self.points.binary_search(&point).is_ok()
    }
}

impl DeepParts {
    /// Finds those among crossings at a sample, where the points are at `x` [m] and move by `moved` [m] until the next sample, or did since
    /// the one before. Parts that lie in each other from the start on, which the points `joined` belong to, are one body, and not among
    /// them.
    pub(super) fn of(
        mesh: &MovingSurface,
        crossings: &PartCrossings,
        x: &[Vec3],
        moved: &impl Fn(u32) -> Vec3,
        joined: &[u32],
    ) -> Self {
        if crossings.crossing.is_empty() {
            return Self::default();
        }
        let triangles = mesh.triangles();
        let mut places = Places::of(triangles, crossings, x);
        places.pass_by_fast(triangles, crossings, moved);
        joined.iter().for_each(|point| places.are_not_deep_at(*point));
        let corners = |t: &u32| triangles[*t as usize];
        let mut deep: Vec<u32> = crossings.crossing.iter().flatten().copied().collect();
        deep.retain(|t| corners(t).iter().any(|point| places.are_deep_at(*point)));
        deep.sort_unstable();
        deep.dedup();
        let covered: Vec<u32> = crossings.covered.iter().copied().filter(|point| places.are_deep_at(*point)).collect();
        let passing = places.passing_points(triangles, crossings, x, moved);
        let others: Vec<u32> = covered.iter().chain(&passing).copied().collect();
        Self { passing, ..Self::with_points(x, with_surroundings(triangles, &deep, &others)) }
    }

    /// The parts that have these points, which are at `x` [m].
    pub(super) fn with_points(x: &[Vec3], points: Vec<u32>) -> Self {
        Self { region: box_of(x, points.iter().copied()), points, passing: Vec::new() }
    }

    /// These parts on the way to `x` [m] as well.
    pub(super) fn up_to(&mut self, x: &[Vec3]) {
        self.region = self.region.union(&box_of(x, self.points.iter().copied()));
    }

    /// Whether any go through the other part's surface fast.
    pub(super) fn has_passing(&self) -> bool {
        !self.passing.is_empty()
    }

    /// The points of these parts, and those among `others` that go through the other part's surface, where they are at `x` [m].
    pub(super) fn and_passing(&self, others: &Self, x: &[Vec3]) -> Self {
        Self::with_points(x, united(&self.points, &others.passing))
    }

    /// These parts and `others`.
    pub(super) fn and(self, others: &Self) -> Self {
        let points = united(&self.points, &others.points);
        Self { region: self.region.union(&others.region), points, passing: self.passing }
    }

    /// Box around them [m].
    pub(super) fn region(&self) -> &Aabb {
        &self.region
    }

    /// Points that belong to one, or are close to a crossing there, ascending.
    pub(super) fn points(&self) -> &[u32] {
        &self.points
    }

    /// Whether a point is among them.
    pub(super) fn contains(&self, point: u32) -> bool {
        self.points.binary_search(&point).is_ok()
    }

    /// Whether there are none.
    pub(super) fn is_empty(&self) -> bool {
        self.points.is_empty()
    }
}

/// The points that are deep inside another part of the surface at a sample, where the points are at `x` [m], ascending.
pub(super) fn deep_points(mesh: &MovingSurface, crossings: &PartCrossings, x: &[Vec3]) -> Vec<u32> {
    if crossings.crossing.is_empty() { Vec::new() } else { Places::of(mesh.triangles(), crossings, x).deep }
}

/// Mean of a vector over the corners of a triangle.
fn mean_of(corners: [u32; 3], vector: impl Fn(u32) -> Vec3) -> Vec3 {
    corners.map(vector).iter().sum::<Vec3>() / 3.0
}

/// Box of some points [m].
fn box_of(x: &[Vec3], points: impl Iterator<Item = u32>) -> Aabb {
    points.fold(Aabb::EMPTY, |all, point| all.union(&Aabb::of_point(&x[point as usize])))
}

/// The points of some triangles and of the triangles around them, and others, ascending.
fn with_surroundings(triangles: &[[u32; 3]], some: &[u32], others: &[u32]) -> Vec<u32> {
    united(&points_around(triangles, some), others)
}

/// The points of both, ascending.
fn united(a: &[u32], b: &[u32]) -> Vec<u32> {
    let mut points = [a, b].concat();
    points.sort_unstable();
    points.dedup();
    points
}

/// Points of a closed surface that lie inside another part of it: those in `region`, which holds the triangles that cross, and all that the
/// surface joins to them inside, ascending.
fn covered_points(mesh: &MovingSurface, x: &[Vec3], region: &Aabb) -> Vec<u32> {
    if !mesh.is_closed() {
        return Vec::new();
    }
    // A little outside of the surface around the point: inside only if another part of the body is there.
    let mut outwards = vec![Vec3::zeros(); x.len()];
    let mut edges = Vec::with_capacity(3 * mesh.triangles().len());
    for corners in mesh.triangles() {
        let [a, b, c] = corners.map(|point| x[point as usize]);
        let normal = (b - a).cross(&(c - a));
        corners.iter().for_each(|&point| outwards[point as usize] += normal);
        // Each edge of a closed surface is an edge of another triangle, the other way round.
        edges.extend((0..3).map(|corner| [corners[corner], corners[(corner + 1) % 3]]));
    }
    edges.sort_unstable();
    let is_covered = |point: u32| {
        let (place, across) = (x[point as usize], outwards[point as usize]);
        let length = across.norm().sqrt();
        let outside = across.try_normalize(0.0).map(|n| place + n * (BESIDE_SURFACE * length));
        outside.is_some_and(|p| mesh.winding_number(&p) > 0)
    };
    let mut is_asked: Vec<bool> = x.iter().map(|place| region.overlaps(&Aabb::of_point(place))).collect();
    let mut next: Vec<u32> = (0..x.len() as u32).filter(|point| is_asked[*point as usize]).collect();
    let mut found = Vec::new();
    while let Some(point) = next.pop() {
        if !is_covered(point) {
            continue;
        }
        found.push(point);
        let first = edges.partition_point(|[from, _]| *from < point);
        for [_, to] in edges[first..].iter().take_while(|[from, _]| *from == point) {
            if !std::mem::replace(&mut is_asked[*to as usize], true) {
                next.push(*to);
            }
        }
    }
    found.sort_unstable();
    found
}

/// Points by the places where the surface crosses itself; of each place, whether a part is deep inside another one there.
struct Places {
    place_of: BTreeMap<u32, u32>,
    is_deep: BTreeMap<u32, bool>,
    /// Covered points that are deep themselves, ascending.
    deep: Vec<u32>,
    /// Distance from the surface of the other part from which on a point is deep [m].
    least_depth: f64,
}

impl Places {
    /// A place is deep with a covered point farther from the surface of the other part than a share of the surface's size.
    fn of(triangles: &[[u32; 3]], crossings: &PartCrossings, x: &[Vec3]) -> Self {
        let PartCrossings { crossing: pairs, covered, .. } = crossings;
        let bounds = x.iter().fold([x[0]; 2], |[low, high], place| [low.inf(place), high.sup(place)]);
        let least_depth = DEEP_PART * (bounds[1] - bounds[0]).norm();
        let is_covered = |point: &u32| covered.binary_search(point).is_ok();
        // What the surface joins inside is one side of a place.
        let mut sides = Joined::default();
        for corners in triangles {
            let inside: Vec<u32> = corners.iter().copied().filter(is_covered).collect();
            inside.iter().for_each(|point| sides.join(inside[0], *point));
        }
        let mut places = sides.clone();
        let mut at_crossings = Vec::new();
        for pair in pairs {
            let corners: Vec<u32> = pair.iter().flat_map(|t| triangles[*t as usize]).collect();
            corners.iter().for_each(|point| places.join(corners[0], *point));
            at_crossings.extend(corners);
        }
        let place_of: BTreeMap<u32, u32> =
            at_crossings.iter().chain(covered).map(|point| (*point, places.first_of(*point))).collect();
        let mut is_deep: BTreeMap<u32, bool> = place_of.values().map(|place| (*place, false)).collect();
        // Covered points by cells; the corners of crossing triangles lie on both sides.
        let cell = |point: u32| (x[point as usize] / least_depth).map(|coordinate| coordinate.floor() as i64).into();
        let mut cells: BTreeMap<[i64; 3], Vec<(u32, u32)>> = BTreeMap::new();
        let by_side = covered.iter().map(|point| (*point, sides.first_of(*point)));
        for (point, side) in by_side.clone().chain(at_crossings.iter().map(|point| (*point, u32::MAX))) {
            cells.entry(cell(point)).or_default().push((point, side));
        }
        let mut deep = Vec::new();
        for (point, side) in by_side {
            let [i, j, k] = cell(point);
            let mut around =
                (-1..=1).flat_map(|a| (-1..=1).flat_map(move |b| (-1..=1).map(move |c| [i + a, j + b, k + c])));
            let is_near = |&(other, of): &(u32, u32)| {
                of != side && (x[other as usize] - x[point as usize]).norm_squared() < least_depth * least_depth
            };
            if !around.any(|cell| cells.get(&cell).is_some_and(|points| points.iter().any(is_near))) {
                is_deep.insert(place_of[&point], true);
                deep.push(point);
            }
        }
        Self { place_of, is_deep, deep, least_depth }
    }

    /// A place is deep, too, with triangles that move past one another by as much.
    fn pass_by_fast(&mut self, triangles: &[[u32; 3]], crossings: &PartCrossings, moved: &impl Fn(u32) -> Vec3) {
        for [a, b] in &crossings.crossing {
            let moved = |t: u32| mean_of(triangles[t as usize], moved);
            if (moved(*a) - moved(*b)).norm() > self.least_depth {
                self.is_deep.insert(self.place_of[&triangles[*a as usize][0]], true);
            }
        }
    }

    /// Points of parts that pass by fast at a deep place: those that move with the faster side, and that its motion brings to the crossing. The
    /// side is faster that moves more against the body as a whole.
    fn passing_points(
        &self,
        triangles: &[[u32; 3]],
        crossings: &PartCrossings,
        x: &[Vec3],
        moved: &impl Fn(u32) -> Vec3,
    ) -> Vec<u32> {
        let (mut of_body, mut whole) = (Vec3::zeros(), 0.0);
        for corners in triangles {
            let [a, b, c] = corners.map(|point| x[point as usize]);
            let area = (b - a).cross(&(c - a)).norm();
            of_body += mean_of(*corners, moved) * area;
            whole += area;
        }
        of_body /= whole;
        let points = || 0..x.len() as u32;
        let mut is_passing = vec![false; x.len()];
        let mut done = None;
        for [a, b] in &crossings.crossing {
            if !self.are_deep_at(triangles[*a as usize][0]) {
                continue;
            }
            let [mut fast, mut slow] = [*a, *b].map(|t| (mean_of(triangles[t as usize], moved), t));
            if (fast.0 - of_body).norm() < (slow.0 - of_body).norm() {
                std::mem::swap(&mut fast, &mut slow);
            }
            let relative = fast.0 - slow.0;
            let reach = relative.norm();
            // Of the triangles that it crosses, one says as much as the others.
            if reach <= self.least_depth || done == Some(fast.1) {
                continue;
            }
            done = Some(fast.1);
            let crossing = mean_of(triangles[fast.1 as usize], |point| x[point as usize]);
            for point in points().filter(|point| (x[*point as usize] - crossing).norm() < reach) {
                is_passing[point as usize] |= (moved(point) - slow.0).dot(&relative) > 0.5 * reach * reach;
            }
        }
        points().filter(|point| is_passing[*point as usize]).collect()
    }

    fn are_deep_at(&self, point: u32) -> bool {
        self.place_of.get(&point).is_some_and(|place| self.is_deep[place])
    }

    fn are_not_deep_at(&mut self, point: u32) {
        if let Some(place) = self.place_of.get(&point) {
            self.is_deep.insert(*place, false);
        }
    }
}

/// Points that are joined, by the smallest of them.
#[derive(Clone, Default)]
struct Joined(BTreeMap<u32, u32>);

impl Joined {
    fn first_of(&self, mut point: u32) -> u32 {
        while let Some(next) = self.0.get(&point) {
            point = *next;
        }
        point
    }

    fn join(&mut self, a: u32, b: u32) {
        let [a, b] = [a, b].map(|point| self.first_of(point));
        if a != b {
            self.0.insert(a.max(b), a.min(b));
        }
    }
}

/// The points of some triangles and of their neighbours, ascending.
fn points_around(triangles: &[[u32; 3]], some: &[u32]) -> Vec<u32> {
    let mut points: Vec<u32> = some.iter().flat_map(|&t| triangles[t as usize]).collect();
    for _ in 0..RINGS {
        points.sort_unstable();
        points.dedup();
        let touches = |t: &&[u32; 3]| t.iter().any(|point| points.binary_search(point).is_ok());
        let more: Vec<u32> =
            if points.is_empty() { Vec::new() } else { triangles.iter().filter(touches).flatten().copied().collect() };
        points.extend(more);
    }
    points.sort_unstable();
    points.dedup();
    points
}
