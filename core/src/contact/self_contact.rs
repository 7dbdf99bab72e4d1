//! Contact of cloth with cloth, and of cloth with the faces of deforming bodies, through one collision step.
//!
//! A collision step goes from one collision-free state to the next: A remembers the state and the sides of all pairs that
//! are close, K time steps follow with repulsions in B.2 and B.8, and C stops what would pass through something on the way.
//! Where C does not come to an end with impulses alone and K is above one, the state is put back to A and K halved.

use crate::Vec3;
use crate::bodies::Bodies;
use crate::contact::geometric::{CollisionLoop, Collisions};
use crate::contact::neighbours::Neighbours;
use crate::contact::pair::{Pair, PairKind};
use crate::contact::repulsion::{Laws, Passes, Repulsions};
use crate::contact::search::PairSearch;
use crate::contact::surface::{ContactSurface, NodePaths};
use crate::contact::tolerances::GAP_ROUNDINGS;
use crate::contact::untangle::push_apart;
use crate::effects::pins::{HardPins, PinTargets};
use crate::geometry::aabb::Aabb;
use crate::geometry::crossings::Crossing;
use crate::metrics::Metrics;
use crate::remembered::{Field, Remembered};
use crate::scene::Scene;
use crate::state::State;

/// Name of the section of a snapshot.
pub const SECTION: &str = "self_contact";

/// Version of the section of a snapshot.
pub const VERSION: u32 = 1;

/// Collision steps without a rewind after which K is doubled (method 2.1).
const GROWTH_PERIOD: u32 = 3;

/// Collision steps by the number of time steps they were to have: 1, up to 3, up to 7, up to 15, and more.
const STEP_COUNTS: [&str; 5] =
    ["collision_steps_k1", "collision_steps_k2", "collision_steps_k4", "collision_steps_k8", "collision_steps_k16"];

/// Rounds in which what would cross more stays where it was; then everything does.
const REVERT_ROUNDS: u32 = 6;

/// Shortest share of a time step to which hard contact shortens it.
const SHORTEST_STEP: f64 = 0.125;

/// Farthest that a node may foreseeably move in one collision step, as a share of its edges, besides the common motion.
const LONGEST_WAY: f64 = 0.5;

/// Reach of a list of neighbours that is to last, as a share of a node's edges. Below 0.35 no two primitives of flat cloth
/// come within reach of each other.
const LONG_REACH: f64 = 0.33;

/// Reach of a list for one collision step at most.
const SHORT_REACH: f64 = 0.1;

/// Collision steps that a list with the long reach has to last.
const LASTING: f64 = 4.0;

/// What may go wrong with foreseeing motion from the last collision step.
const FORESIGHT: f64 = 1.3;

/// Settings of geometric collisions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CollisionSettings {
    /// Largest number of time steps between two collision-free states.
    pub max_steps: u32,
    /// Whether collisions are resolved after the position half of every step, as in the authors' later code, instead of
    /// after whole steps.
    pub after_position: bool,
}

/// Number and length of the time steps per collision step, found by trying.
#[derive(Debug)]
struct StepControl {
    steps: u32,
    max_steps: u32,
    /// Share of the step that the cloth would allow.
    share: f64,
    successes: u32,
}

impl StepControl {
    fn succeeded(&mut self) {
        self.successes += 1;
        if self.successes.is_multiple_of(GROWTH_PERIOD) {
            if self.share < 1.0 {
                self.share = (2.0 * self.share).min(1.0);
            } else {
                self.steps = (2 * self.steps).min(self.max_steps);
            }
        }
    }

    /// Where zones are needed even after single steps, contact changes faster than the steps resolve.
    fn failed(&mut self) {
        self.successes = 0;
        if self.steps > 1 {
            self.steps /= 2;
        } else {
            self.share = (0.5 * self.share).max(SHORTEST_STEP);
        }
    }
}

/// The geometric half.
#[derive(Debug)]
struct Geometric {
    after_position: bool,
    control: StepControl,
    work: CollisionLoop,
    /// Velocities at the collision-free state [m/s].
    velocities: Vec<Vec3>,
    /// Crossings of the collision-free state: those of the start, and of cloth that bodies have pinched.
    crossings: Vec<Crossing>,
    /// Pairs that are left alone because of them, ascending.
    ignored: Vec<Pair>,
    /// Vertices of cloth that crosses a body where that body crosses itself, ascending. No face of a body may hold them: they
    /// may have to leave by another than they came in.
    pinched: Vec<u32>,
}

/// The state of self-contact; whole, or repulsions alone, or collisions alone.
#[derive(Debug)]
pub struct SelfContact {
    surface: ContactSurface,
    search: PairSearch,
    neighbours: Neighbours,
    repulsions: Option<Repulsions>,
    geometric: Option<Geometric>,
    /// Inverse masses of the cloth, zero where a vertex is held in all directions [1/kg].
    mobility: Vec<f64>,
    /// Inverse masses of all nodes per axis, zero where held [1/kg].
    node_mobility: Vec<Vec3>,
    paths: NodePaths,
    /// Time of the collision-free state [s].
    start_time: f64,
    /// Longest way of a node as a share of its edges [1/s], in the last collision step.
    wear: f64,
    /// Longest way since the list was made, at the last collision-free state.
    used: f64,
}

/// How a collision step ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ending {
    /// The state is free of collisions, or as good as can be; this says what was left.
    Resolved,
    /// The state was put back to the start of the collision step, to be tried again with shorter ones.
    Rewound,
}

impl SelfContact {
    /// Self-contact with these laws of repulsion and settings of collisions; `clamp` is the largest thickness as a fraction of
    /// the rest edges around a vertex.
    pub fn new(scene: &Scene, repulsion: Option<(Laws, f64)>, collision: Option<CollisionSettings>) -> Self {
        let surface = ContactSurface::new(scene, repulsion.map_or(0.0, |(_, clamp)| clamp));
        let neighbours = Neighbours::new(&surface, repulsion.is_some());
        let geometric = collision.map(|settings| Geometric {
            after_position: settings.after_position,
            control: StepControl { steps: 1, max_steps: settings.max_steps, share: 1.0, successes: 0 },
            work: CollisionLoop::new(surface.nodes()),
            velocities: Vec::new(),
            crossings: Vec::new(),
            ignored: Vec::new(),
            pinched: Vec::new(),
        });
        let mobility: Vec<f64> = scene.masses().iter().map(|m| 1.0 / m).collect();
        let mut node_mobility: Vec<Vec3> = mobility.iter().map(|w| Vec3::repeat(*w)).collect();
        node_mobility.resize(surface.nodes(), Vec3::zeros());
        Self {
            search: PairSearch::new(&surface),
            neighbours,
            repulsions: repulsion.map(|(laws, _)| Repulsions::new(laws, surface.cloth_nodes())),
            geometric,
            mobility,
            node_mobility,
            paths: NodePaths::default(),
            start_time: 0.0,
            wear: 0.0,
            used: f64::INFINITY,
            surface,
        }
    }

    /// Memory held [bytes].
    pub fn bytes(&self) -> usize {
        let nodes = self.surface.nodes() * (3 * size_of::<Vec3>() + size_of::<f64>());
        let repulsions = self.repulsions.as_ref().map_or(0, Repulsions::bytes);
        self.surface.bytes() + self.search.bytes() + self.neighbours.bytes() + repulsions + nodes
    }

    /// Whether there are repulsions.
    pub fn repels(&self) -> bool {
        self.repulsions.is_some()
    }

    /// Whether collisions are resolved between B.4 and B.5.
    pub fn collides_after_position(&self) -> bool {
        self.geometric.as_ref().is_some_and(|g| g.after_position)
    }

    /// Notes which vertices are held during the coming step.
    pub fn set_held(&mut self, masses: &[f64], pins: Option<&HardPins>, targets: &PinTargets) {
        let Some(pins) = pins else { return };
        for (vertex, _, _) in pins.axes() {
            self.node_mobility[vertex] = Vec3::repeat(1.0 / masses[vertex]);
        }
        for (vertex, target, axes) in pins.axes() {
            if targets.is_active(target) {
                (0..3).filter(|axis| axes[*axis]).for_each(|axis| self.node_mobility[vertex][axis] = 0.0);
            }
            self.mobility[vertex] = self.node_mobility[vertex].max();
        }
    }

    /// Share of the time step that the cloth allows, shortened where contact needs it.
    pub fn step_share(&self) -> f64 {
        self.geometric.as_ref().map_or(1.0, |g| g.control.share)
    }

    /// A: remembers the collision-free state and gives close pairs their sides; returns how many time steps of length `dt` [s]
    /// the collision step may have.
    pub fn begin_interval(&mut self, state: &State, bodies: &Bodies, dt: f64, metrics: &mut Metrics) -> u32 {
        self.surface.gather(&state.x, bodies, &mut self.paths.start);
        self.start_time = state.time;
        if let Some(geometric) = &mut self.geometric {
            geometric.velocities.clear();
            geometric.velocities.extend_from_slice(&state.v);
        }
        let wanted = self.geometric.as_ref().map_or(1, |g| g.control.steps);
        let per_step = FORESIGHT * self.wear * dt;
        let affordable = (LONGEST_WAY / per_step.max(f64::MIN_POSITIVE)) as u32;
        let steps = wanted.min(affordable).max(1);
        let way = per_step * f64::from(steps);
        self.used = self.neighbours.note_ways(&self.paths.start, &self.paths.start);
        if self.used + way > self.neighbours.reach() || self.used.is_nan() {
            metrics.count("pair_searches", 1);
            // A list that lasts is worth being long; one that does not is for repulsions alone.
            let reach = if LASTING * way <= LONG_REACH { LONG_REACH } else { way.min(SHORT_REACH) };
            self.neighbours.rebuild(&self.surface, &mut self.search, &self.paths.start, reach, gap(&self.paths.start));
            self.used = self.neighbours.note_ways(&self.paths.start, &self.paths.start);
        }
        if let Some(repulsions) = &mut self.repulsions {
            let ignored = self.geometric.as_ref().map(|g| &g.ignored).filter(|pairs| !pairs.is_empty());
            let slack = 2.0 * way.min(self.neighbours.reach()) * self.surface.longest_edge();
            let is_ignored = |pair: &Pair| ignored.is_some_and(|pairs| pairs.binary_search(pair).is_ok());
            repulsions.take_sides(&self.neighbours, &self.paths.start, slack, &is_ignored);
        }
        metrics.count("collision_steps", 1);
        metrics.count(STEP_COUNTS[(steps.ilog2() as usize).min(STEP_COUNTS.len() - 1)], 1);
        metrics.count("collision_steps_shortened", u64::from(self.step_share() < 1.0));
        steps
    }

    /// B.2: repulsion of the velocities of the half step.
    pub fn half_velocity(&mut self, dt: f64, x: &[Vec3], v: &mut [Vec3], metrics: &mut Metrics) {
        if let Some(repulsions) = &mut self.repulsions {
            repulsions.apply(Passes::Full, dt, x, &self.mobility, v, metrics);
        }
    }

    /// B.8: repulsion of the final velocities, without springs.
    pub fn final_velocity(&mut self, dt: f64, x: &[Vec3], v: &mut [Vec3], metrics: &mut Metrics) {
        if let Some(repulsions) = &mut self.repulsions {
            repulsions.positions_changed();
            repulsions.apply(Passes::WithoutSprings, dt, x, &self.mobility, v, metrics);
        }
    }

    /// C: makes the state free of collisions. `x` and `v` are those at the end of the collision step, which took `duration`
    /// [s]; `bodies` stand at its end. With `may_rewind` a hard case is left to a shorter collision step. The vertices that
    /// were moved go to `moved`, each with how far [m].
    pub fn end_interval(
        &mut self,
        (x, v): (&mut [Vec3], &mut [Vec3]),
        bodies: &Bodies,
        duration: f64,
        may_rewind: bool,
        metrics: &mut Metrics,
        mut moved: impl FnMut(usize, f64),
    ) -> Ending {
        if let Some(repulsions) = &mut self.repulsions {
            metrics.count("inverted_pairs", repulsions.inverted());
            repulsions.positions_changed();
        }
        self.surface.gather(x, bodies, &mut self.paths.end);
        let used = self.neighbours.note_ways(&self.paths.start, &self.paths.end);
        if duration > 0.0 {
            self.wear = (used - self.used).max(0.0) / duration;
        }
        let Some(geometric) = &mut self.geometric else { return Ending::Resolved };
        let (ignored, pinched, surface) = (&geometric.ignored, &geometric.pinched, &self.surface);
        let is_ignored = |pair: &Pair| {
            let lets_out =
                || !surface.repels(pair) && pair.nodes.iter().any(|node| pinched.binary_search(node).is_ok());
            ignored.binary_search(pair).is_ok() || (!pinched.is_empty() && lets_out())
        };
        let collisions = Collisions {
            surface: &self.surface,
            mobility: &self.node_mobility,
            gap: gap(&self.paths.start),
            duration,
            ignored: &is_ignored,
            may_give_back: may_rewind && geometric.control.steps > 1,
        };
        let outcome =
            geometric.work.resolve(&collisions, &mut self.neighbours, &mut self.search, &mut self.paths, used, metrics);
        if outcome.given_back {
            metrics.count("rewinds", 1);
            geometric.control.failed();
            return Ending::Rewound;
        }
        if outcome.hard {
            geometric.control.failed()
        } else {
            geometric.control.succeeded()
        }
        for &node in &outcome.moved {
            let node = node as usize;
            let change = self.paths.end[node] - x[node];
            x[node] = self.paths.end[node];
            v[node] += change / duration;
            moved(node, change.norm());
        }
        if !outcome.moved.is_empty() || !geometric.crossings.is_empty() || outcome.pinched {
            self.check(&outcome.moved, (x, v), bodies, duration, metrics);
        }
        Ending::Resolved
    }

    /// What self-contact remembers at a collision-free state: the list of neighbours by the positions it was made around, the
    /// number and length of the steps it takes, and what crosses.
    pub(crate) fn remember(&self) -> Remembered {
        let reference = self.neighbours.reference();
        let cloth = self.surface.cloth_nodes();
        let list = if reference.is_empty() {
            let bodies = self.surface.nodes() - cloth;
            Some((Vec::new(), vec![Vec3::zeros(); bodies])).filter(|_| false)
        } else {
            Some((reference[..cloth].to_vec(), reference[cloth..].to_vec()))
        };
        let memory = Remembered::new(SECTION, VERSION)
            .with("wear", Field::Number(self.wear))
            .with("list_reach", Field::Number(self.neighbours.full_reach()))
            .with("list_positions", Field::Nodes(list));
        let Some(geometric) = &self.geometric else { return memory };
        let crossings = geometric.crossings.iter().flat_map(|c| c.edge.into_iter().chain(c.triangle));
        memory
            .with("steps", Field::Count(geometric.control.steps.into()))
            .with("step_share", Field::Number(geometric.control.share))
            .with("successes", Field::Count(geometric.control.successes.into()))
            .with("crossings", Field::Numbers(5, crossings.collect()))
            .with("pinched", Field::Numbers(1, geometric.pinched.clone()))
    }

    /// Goes on from what was remembered.
    pub(crate) fn go_on(&mut self, memory: &Remembered, _: &State, _: &Bodies) {
        self.wear = memory.number("wear");
        if let Some((cloth, bodies)) = memory.nodes("list_positions") {
            let reference: Vec<Vec3> = cloth.iter().chain(bodies).copied().collect();
            let reach = memory.number("list_reach");
            // The list follows from the positions it was made around, to the last bit and in the same order.
            self.neighbours.rebuild(&self.surface, &mut self.search, &reference, reach, gap(&reference));
        }
        let Some(geometric) = &mut self.geometric else { return };
        let count = |name| u32::try_from(memory.count(name)).unwrap_or(u32::MAX);
        geometric.control.steps = count("steps").clamp(1, geometric.control.max_steps);
        geometric.control.share = memory.number("step_share").clamp(SHORTEST_STEP, 1.0);
        geometric.control.successes = count("successes");
        let rows = memory.numbers("crossings").as_chunks::<5>().0;
        let crossing = |&[a, b, c, d, e]: &[u32; 5]| Crossing { edge: [a, b], triangle: [c, d, e] };
        geometric.crossings = rows.iter().map(crossing).collect();
        geometric.ignored = ignored_pairs(&geometric.crossings);
        geometric.pinched = memory.numbers("pinched").to_vec();
    }

    /// Edges that crossed triangles when it was last looked for them.
    pub fn known_crossings(&self) -> &[Crossing] {
        self.geometric.as_ref().map_or(&[], |g| &g.crossings)
    }

    /// Puts the state back to the last collision-free one.
    pub fn rewind(&self, state: &mut State) {
        if let Some(geometric) = &self.geometric {
            let vertices = state.x.len();
            state.x.copy_from_slice(&self.paths.start[..vertices]);
            state.v.copy_from_slice(&geometric.velocities);
            state.time = self.start_time;
        }
    }

    /// Finds the crossings that the state has now: around the vertices in `moved` if there were none before, else all. More of
    /// cloth with cloth than before are not accepted: what makes them stays where it was.
    fn check(
        &mut self,
        moved: &[u32],
        (x, v): (&mut [Vec3], &mut [Vec3]),
        bodies: &Bodies,
        duration: f64,
        metrics: &mut Metrics,
    ) {
        let Some(geometric) = &mut self.geometric else { return };
        metrics.count("crossing_checks", 1);
        let surface = &self.surface;
        let among_cloth = |all: &[Crossing]| all.iter().filter(|c| surface.is_cloth(c)).count();
        let (before, allowed) = (&geometric.crossings, among_cloth(&geometric.crossings));
        let only = before.is_empty().then_some(moved);
        let mut stopped = Vec::new();
        let mut round = 0;
        let found = loop {
            let end = &self.paths.end;
            self.search.fit(surface, |i| Aabb::of_point(&end[i]));
            let found = self.search.crossings(surface, end, only.filter(|_| round == 0));
            if among_cloth(&found) <= allowed || round > REVERT_ROUNDS {
                break found;
            }
            metrics.count("crossings_reverted", 1);
            stopped.resize(x.len(), false);
            let new = found.iter().filter(|c| surface.is_cloth(c) && before.binary_search(c).is_err());
            new.flat_map(|c| c.edge.iter().chain(&c.triangle)).for_each(|&node| stopped[node as usize] = true);
            // The neighbours of what stays too: nothing new may be made at its border. At last everything stays.
            surface.grow(&mut stopped);
            for node in (0..x.len()).filter(|&node| stopped[node] || round == REVERT_ROUNDS) {
                let change = self.paths.start[node] - self.paths.end[node];
                self.paths.end[node] = self.paths.start[node];
                x[node] = self.paths.start[node];
                v[node] += change / duration;
            }
            round += 1;
        };
        geometric.crossings = found;
        geometric.ignored = ignored_pairs(&geometric.crossings);
        geometric.pinched = pinched_vertices(surface, &geometric.crossings, bodies);
        let paths = &self.paths;
        let velocity = |node: u32| (paths.end[node as usize] - paths.start[node as usize]) / duration;
        // Where a body crosses itself there is no way out yet.
        let pinched = |c: &Crossing| surface.is_pinched(c, bodies);
        let free: Vec<Crossing> = geometric.crossings.iter().filter(|c| !pinched(c)).copied().collect();
        push_apart(surface, &free, &paths.end, velocity, &self.node_mobility, v);
    }

    /// All crossings of the state `x` [m], with bodies where they stand; the pairs that cross are left alone from now on.
    pub fn check_everything(&mut self, x: &[Vec3], bodies: &Bodies) -> &[Crossing] {
        self.surface.gather(x, bodies, &mut self.paths.end);
        let end = &self.paths.end;
        self.search.fit(&self.surface, |i| Aabb::of_point(&end[i]));
        let found = self.search.crossings(&self.surface, end, None);
        match &mut self.geometric {
            Some(geometric) => {
                geometric.ignored = ignored_pairs(&found);
                geometric.pinched = pinched_vertices(&self.surface, &found, bodies);
                geometric.crossings = found;
                &geometric.crossings
            }
            None => &[],
        }
    }

    /// Whether geometric collisions keep the state free of crossings.
    pub fn keeps_free(&self) -> bool {
        self.geometric.is_some()
    }
}

/// Distance that everything keeps [m]: several times what rounding to single precision can close, at the largest coordinate.
fn gap(x: &[Vec3]) -> f64 {
    let largest = x.iter().fold(0.0_f64, |largest, p| largest.max(p.amax()));
    GAP_ROUNDINGS * f64::from(f32::EPSILON) * largest
}

/// The pairs of points, triangles and edges that may pass through each other because an edge crosses a triangle: its ends
/// with the triangle, and the edge with the triangle's edges (method 4.9). Ascending.
fn ignored_pairs(crossings: &[Crossing]) -> Vec<Pair> {
    let mut pairs = Vec::new();
    for Crossing { edge, triangle: [a, b, c] } in crossings {
        for p in edge {
            pairs.push(Pair { kind: PairKind::PointTriangle, nodes: [*p, *a, *b, *c] });
        }
        for [p, q] in [[a, b], [b, c], [c, a]] {
            let other = [*p.min(q), *p.max(q)];
            let [first, second] = if *edge < other { [*edge, other] } else { [other, *edge] };
            let nodes = [first[0], first[1], second[0], second[1]];
            pairs.push(Pair { kind: PairKind::EdgeEdge, nodes });
        }
    }
    pairs.sort_unstable();
    pairs.dedup();
    pairs
}

/// The vertices of cloth in crossings of cloth with bodies where these may cross themselves, ascending.
fn pinched_vertices(surface: &ContactSurface, crossings: &[Crossing], bodies: &Bodies) -> Vec<u32> {
    let pinched = crossings.iter().filter(|crossing| surface.is_pinched(crossing, bodies));
    let nodes = pinched.flat_map(|c| c.edge.into_iter().chain(c.triangle));
    let mut vertices: Vec<u32> = nodes.filter(|&node| !surface.is_body(node)).collect();
    vertices.sort_unstable();
    vertices.dedup();
    vertices
}
