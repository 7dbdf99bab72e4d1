//! Getting out of crossings that were there at the start, or that a body has pinched into the cloth: the edge and the
//! triangle that cross are pushed, gently, the way that shortens the line along which the surfaces meet.
//!
//! The side that cloth belongs on cannot be told where it crosses; the direction that shortens the line of
//! intersection can (P. Volino, N. Magnenat-Thalmann, "Resolving surface collisions through intersection contour
//! minimization", SIGGRAPH 2006). With e the direction of the edge, N the normal of the triangle, and R_i the unit
//! directions of the line of intersection from the edge into the triangles that have it, a shift d of the edge moves
//! the point where it crosses by d − (d·N)/(e·N) e, so the line gets shorter by d · Σ_i (R_i − (R_i·e)/(e·N) N). A
//! line that ends at a border is drawn out along itself (`contours`).

mod contours;

use std::collections::{BTreeMap, BTreeSet};

use crate::Vec3;
use crate::contact::tolerances::ALONG_TRIANGLE;
use crate::contact::topology::surface::ContactSurface;
use crate::geometry::crossings::Crossing;
use crate::parallel::message::codec;
use contours::along_lines;

/// Edge lengths per second at which cloth that crosses cloth is pushed apart [1/s].
const PUSH_RATE: f64 = 10.0;

/// The same where the wearing order says to which side [1/s].
const DRAW_RATE: f64 = 40.0;

/// Rings of triangles around it that are drawn along: without them cloth that hangs on the far side would hold it back.
const RINGS_DRAWN: usize = 8;

/// The same for cloth that crosses a body: it was pinched, and has to be out soon after the body lets go [1/s].
const RELEASE_RATE: f64 = 60.0;

/// Largest change of the velocity of a node, over that of the relative velocity that is asked for: where pins hold the nodes that
/// matter, those that are left have next to no weight and would be thrown, so nothing is pushed there. Nodes that are all free, with
/// masses of one mesh, change by at most twice as much.
const MOST_LEVERAGE: f64 = 10.0;

/// Gives every crossing a relative velocity out of itself, at least [m/s]; positions `x` [m] of all nodes, `velocity`
/// of the bodies' nodes [m/s], velocities `v` of own vertices in the order of the scene [m/s].
///
/// The crossings are those of all ranks, which call it together: each tells what it knows of their nodes, and all push
/// alike.
pub(crate) fn push_apart(
    surface: &ContactSurface,
    crossings: &[Crossing],
    x: &[Vec3],
    velocity: impl Fn(u32) -> Vec3,
    v: &mut [Vec3],
) {
    if crossings.is_empty() {
        return;
    }
    let nodes = surface.nodes();
    let mut known = Known::of_all(surface, crossings, x, velocity, v);
    let (cloth, others): (Vec<Crossing>, Vec<Crossing>) = crossings.iter().partition(|c| surface.is_cloth(c));
    let place = |crossing: &Crossing| Place::new(&known, crossing);
    let places: Vec<Option<Place>> = cloth.iter().map(place).collect();
    let mut draws: Vec<(Push, f64)> = Vec::new();
    let mut pushes: Vec<(Push, f64)> = Vec::new();
    let speed = |crossing: &Crossing, rate: f64| rate * known.edges[&crossing.edge].length;
    for ((crossing, place), along) in cloth.iter().zip(&places).zip(along_lines(&known, &cloth, &places)) {
        let Some(place) = place else { continue };
        if let Some(order) =
            surface.wearing_order().and_then(|order| order.compare(crossing.edge[0], crossing.triangle[0]))
        {
            // The surface with a border in the line pierces the other one, and is drawn out along the normals of that.
            if along.is_none_or(|on_line| on_line.is_drawn) {
                let outwards = if order.is_gt() { place.normal } else { -place.normal };
                draws.push((place.pushed(outwards), speed(crossing, DRAW_RATE)));
            }
            continue;
        }
        let Some(direction) = along.and_then(|on_line| on_line.direction).or_else(|| place.shortening()) else {
            continue;
        };
        pushes.push((place.pushed(direction), speed(crossing, PUSH_RATE)));
    }
    for crossing in &others {
        let Some(place) = place(crossing) else { continue };
        let Some(direction) = place.shortening() else { continue };
        pushes.push((place.pushed(direction), speed(crossing, RELEASE_RATE)));
    }
    draws.iter().for_each(|(push, speed)| push.apply(&mut known, *speed));
    if !draws.is_empty() {
        draw_along(surface, &known, v);
    }
    pushes.iter().for_each(|(push, speed)| push.apply(&mut known, *speed));
    for (number, point) in known.points.range(nodes.owned()) {
        v[(number - nodes.owned().start) as usize] = point.v;
    }
}

/// Gives the cloth around what was drawn the same change of velocity, ring by ring of its triangles, each node the mean of those that
/// draw it. `v` are the velocities of own vertices before [m/s].
fn draw_along(surface: &ContactSurface, known: &Known, v: &mut [Vec3]) {
    let nodes = surface.nodes();
    let mut changes = vec![Vec3::zeros(); nodes.count()];
    let mut drawn = vec![0_u8; nodes.count()];
    for (number, point) in known.points.range(nodes.owned()) {
        let change = point.v - v[(number - nodes.owned().start) as usize];
        let node = nodes.local(*number).expect("own nodes are known") as usize;
        (changes[node], drawn[node]) = (change, u8::from(change != Vec3::zeros()));
    }
    let first = nodes.own().start;
    for _ in 0..RINGS_DRAWN {
        nodes.update_all(&mut [&mut changes, &mut drawn]);
        let mut means: BTreeMap<usize, (Vec3, f64)> = BTreeMap::new();
        for corners in surface.cloth().triangles() {
            let drawing = || corners.iter().map(|&node| node as usize).filter(|&node| drawn[node] != 0);
            if drawing().next().is_none() {
                continue;
            }
            let (sum, count) =
                drawing().fold((Vec3::zeros(), 0.0), |(sum, count), node| (sum + changes[node], count + 1.0));
            for node in corners
                .iter()
                .map(|&node| node as usize)
                .filter(|&node| drawn[node] == 0 && nodes.own().contains(&node))
            {
                let mean = means.entry(node).or_insert((Vec3::zeros(), 0.0));
                *mean = (mean.0 + sum, mean.1 + count);
            }
        }
        for (node, (sum, count)) in means {
            changes[node] = (sum / count).component_mul(&surface.free_axes(node));
            drawn[node] = 1;
            v[node - first] += changes[node];
        }
    }
}

/// A node of a crossing.
struct Point {
    /// Position [m].
    x: Vec3,
    /// Velocity [m/s].
    v: Vec3,
    /// Inverse mass per axis [1/kg].
    mobility: Vec3,
}

/// An edge that crosses.
struct Edge {
    /// Mean rest length of the edges around its first node [m].
    length: f64,
    /// Third corners of the triangles that have it: numbers, positions [m].
    corners: Vec<(u32, Vec3)>,
}

/// Data on the crossings, by the scene's numbers of the nodes; alike on all ranks.
struct Known {
    points: BTreeMap<u32, Point>,
    edges: BTreeMap<[u32; 2], Edge>,
}

codec!(struct Point { x, v, mobility });
codec!(struct Edge { length, corners });
codec!(struct Known { points, edges });

impl Known {
    fn of_all(
        surface: &ContactSurface,
        crossings: &[Crossing],
        x: &[Vec3],
        velocity: impl Fn(u32) -> Vec3,
        v: &[Vec3],
    ) -> Self {
        let own = Self::of_own(surface, crossings, x, velocity, v);
        let mut known = Self { points: BTreeMap::new(), edges: BTreeMap::new() };
        for Self { points, edges } in surface.ranks().all_gather_encoded("what is known of intersections", vec![own]) {
            known.points.extend(points);
            known.edges.extend(edges);
        }
        known
    }

    /// Returns the data that this rank contributes.
    fn of_own(
        surface: &ContactSurface,
        crossings: &[Crossing],
        x: &[Vec3],
        velocity: impl Fn(u32) -> Vec3,
        v: &[Vec3],
    ) -> Self {
        let nodes = surface.nodes();
        // What bodies do is known everywhere: one rank tells it.
        let tells =
            |number: &u32| nodes.owns(*number) || (*number >= nodes.global_cloth_count() && nodes.ranks().is_first());
        let numbers = crossings.iter().flat_map(|c| c.edge.into_iter().chain(c.triangle)).filter(tells);
        let edges = crossings.iter().map(|crossing| crossing.edge).filter(|[first, _]| tells(first));
        let local = |number: u32| nodes.local(number).expect("own nodes, their edges' other ends and bodies are known");
        let point = |number: u32| {
            let node = local(number);
            let v = if nodes.owns(number) { v[(number - nodes.owned().start) as usize] } else { velocity(node) };
            Point { x: x[node as usize], v, mobility: surface.mobility()[node as usize] }
        };
        let edge = |ends: [u32; 2]| {
            let ends = ends.map(local);
            let opposite = |triangle: [u32; 3]| triangle.into_iter().find(|node| !ends.contains(node));
            let corners = surface.triangles_of_edge(ends).filter_map(opposite);
            let corners = corners.map(|node| (nodes.number(node), x[node as usize])).collect();
            Edge { length: surface.edge_length()[ends[0] as usize], corners }
        };
        // Each once, however many crossings name it.
        let (numbers, edges): (BTreeSet<u32>, BTreeSet<[u32; 2]>) = (numbers.collect(), edges.collect());
        Self {
            points: numbers.into_iter().map(|number| (number, point(number))).collect(),
            edges: edges.into_iter().map(|ends| (ends, edge(ends))).collect(),
        }
    }
}

/// Crossing point of an edge and a triangle.
struct Place {
    nodes: [u32; 5],
    /// Weights of the relative displacement: of the edge at the point where it crosses, less that of the triangle.
    weights: [f64; 5],
    /// The point [m].
    point: Vec3,
    /// Unit normal of the triangle.
    normal: Vec3,
    /// A unit direction of the line of intersection.
    line: Vec3,
    /// The direction in which the edge has to go for the line to get shorter, not normalised; zero inside a straight line.
    gradient: Vec3,
}

impl Place {
    fn new(known: &Known, crossing: &Crossing) -> Option<Self> {
        let Crossing { edge: [p, q], triangle: [a, b, c] } = *crossing;
        let at = |number: u32| known.points[&number].x;
        let across = (at(b) - at(a)).cross(&(at(c) - at(a)));
        let normal = across.try_normalize(0.0)?;
        let along = at(q) - at(p);
        let e = along.try_normalize(0.0)?;
        let steep = e.dot(&normal);
        if steep.abs() < ALONG_TRIANGLE {
            return None;
        }
        let share = ((at(a) - at(p)).dot(&normal) / along.dot(&normal)).clamp(0.0, 1.0);
        let point = at(p) + along * share;
        let area = across.norm_squared();
        let wb = (point - at(a)).cross(&(at(c) - at(a))).dot(&across) / area;
        let wc = (at(b) - at(a)).cross(&(point - at(a))).dot(&across) / area;
        let (mut gradient, mut last) = (Vec3::zeros(), Vec3::zeros());
        for (_, corner) in &known.edges[&crossing.edge].corners {
            let inwards = corner - point;
            let own_normal = along.cross(&inwards);
            let Some(line) = own_normal.cross(&normal).try_normalize(0.0) else { continue };
            // From the edge into the triangle that has it.
            let into = inwards - e * inwards.dot(&e);
            last = if line.dot(&into) < 0.0 { -line } else { line };
            gradient += last - normal * (last.dot(&e) / steep);
        }
        let weights = [1.0 - share, share, wb + wc - 1.0, -wb, -wc];
        Some(Self { nodes: [p, q, a, b, c], weights, point, normal, line: last, gradient })
    }

    /// The unit direction in which the line gets shorter here, if there is one.
    fn shortening(&self) -> Option<Vec3> {
        self.gradient.try_normalize(ALONG_TRIANGLE)
    }

    /// The unit direction along the line away from another place on it; the opposite if it is the triangle that goes there.
    fn away_from(&self, other: &Vec3, is_edge: bool) -> Option<Vec3> {
        let ahead = self.line.dot(&(self.point - other)) >= 0.0;
        let direction = if ahead == is_edge { self.line } else { -self.line };
        (direction != Vec3::zeros()).then_some(direction)
    }

    fn pushed(&self, direction: Vec3) -> Push {
        Push { nodes: self.nodes, weights: self.weights, direction }
    }
}

/// Place and direction of the push on one crossing.
struct Push {
    nodes: [u32; 5],
    /// As of its place.
    weights: [f64; 5],
    direction: Vec3,
}

impl Push {
    /// Makes the two part with this speed [m/s], unless they do so faster.
    fn apply(&self, known: &mut Known, wanted: f64) {
        let nodes = self.nodes.iter().zip(self.weights);
        let squares = self.direction.component_mul(&self.direction);
        let (mut speed, mut response) = (0.0, 0.0);
        for (number, w) in nodes.clone() {
            let point = &known.points[number];
            speed += point.v.dot(&self.direction) * w;
            response += w * w * point.mobility.dot(&squares);
        }
        if speed >= wanted || response <= 0.0 {
            return;
        }
        // By the impulse that gives the whole change.
        let leverage =
            |(number, w): (&u32, f64)| (known.points[number].mobility.component_mul(&self.direction) * w).norm();
        if nodes.clone().map(leverage).fold(0.0, f64::max) > MOST_LEVERAGE * response {
            return;
        }
        let impulse = self.direction * ((wanted - speed) / response);
        for (number, w) in nodes {
            if let Some(point) = known.points.get_mut(number) {
                point.v += point.mobility.component_mul(&impulse) * w;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::contact::broad_phase::bvh_search::PairSearch;
    use crate::contact::broad_phase::proximity_list::tests::ranks::Heap;
    use crate::contact::intersections::exact;
    use crate::contact::testing::on_ranks;
    use crate::geometry::aabb::Aabb;
    use crate::geometry::random::SplitMix64;
    use crate::parallel::ranks::Ranks;

    /// Velocities of own vertices after the crossings of a heap were pushed apart, as bits; and how many there were.
    fn pushed(heap: &Heap, ranks: &Ranks, starts: &[usize]) -> (Vec<[u64; 3]>, usize) {
        let surface = heap.surface(ranks, starts);
        let x = heap.at(&surface, 2);
        let mut search = PairSearch::new();
        search.refit(&surface, |i| Aabb::of_point(&x[i]));
        let crossings = exact::crossings(&surface, &search, &x, None);
        let mut v: Vec<Vec3> = surface.nodes().own().map(|node| x[node] * 0.1).collect();
        push_apart(&surface, &crossings, &x, |node| x[node as usize] * 0.2, &mut v);
        (v.iter().map(|v| [v.x, v.y, v.z].map(f64::to_bits)).collect(), crossings.len())
    }

    #[test]
    fn what_pins_leave_with_hardly_any_weight_is_not_thrown() {
        let wanted = 0.1;
        for weight in [1.0, 0.3, 1e-3, 1e-9, 1e-17] {
            // One node is free.
            let mobility = |number: u32| if number == 0 { Vec3::repeat(1e4) } else { Vec3::zeros() };
            let point =
                |number: u32| (number, Point { x: Vec3::zeros(), v: Vec3::zeros(), mobility: mobility(number) });
            let mut known = Known { points: (0..5).map(point).collect(), edges: BTreeMap::new() };
            let weights = [weight, 1.0 - weight, -0.2, -0.3, -0.5];
            Push { nodes: [0, 1, 2, 3, 4], weights, direction: Vec3::x() }.apply(&mut known, wanted);
            // The whole change where the lever allows it, none elsewhere: with a part of it each step would throw the node on.
            let expected = if weight * MOST_LEVERAGE >= 1.0 { Vec3::x() * (wanted / weight) } else { Vec3::zeros() };
            let found = known.points[&0].v;
            assert!((found - expected).norm() < 1e-12, "weight {weight}: {found:?} for {expected:?}");
        }
    }

    #[test]
    fn any_number_of_ranks_pushes_alike() {
        let mut random = SplitMix64::new(41);
        let heap = Arc::new(Heap::random(&mut random, true));
        let (alone, crossings) = pushed(&heap, &Ranks::default(), &heap.cut(&mut random, 1));
        assert!(crossings > 20);
        for count in [2, 3, 5] {
            let (heap, starts) = (heap.clone(), heap.cut(&mut random, count));
            let found = on_ranks(count, move |ranks| pushed(&heap, &ranks, &starts).0).concat();
            assert!(found == alone, "{count} ranks");
        }
    }
}
