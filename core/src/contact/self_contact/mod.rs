//! Contact of cloth with cloth, and of cloth with the faces of bodies, through one collision step.
//!
//! A collision step goes from one collision-free state to the next: A remembers the state and the sides of all pairs that
//! are close, K time steps follow with repulsions in B.2 and B.8 or in their solves, and C stops what would pass through something on the way.
//! The state is put back to A and K is halved where C does not come to an end with impulses alone and K is above one.

mod intersections;
pub(crate) mod layers;
mod per_time_step;
pub(super) mod substeps;
mod touch;

use crate::Vec3;
use crate::contact::bodies::Bodies;
use crate::contact::bodies::collision::BodyCollision;
use crate::contact::bodies::constraints::BodyConstraints;
use crate::contact::broad_phase::bvh_search::PairSearch;
use crate::contact::broad_phase::proximity_list::{PredictedPaths, ProximityList};
use crate::contact::broad_phase::skin;
use crate::contact::collisions::collision_loop::{CollisionLoop, Collisions, Departure, LoopOutcome, Strategy};
use crate::contact::intersections::tangle::Tangle;
use crate::contact::repulsion::pair_forces::UnrepelledMotion;
use crate::contact::repulsion::{Laws, Repulsions};
use crate::contact::self_contact::substeps::Substeps;
use crate::contact::tolerances::{GAP_ROUNDINGS, REWOUND};
use crate::contact::topology::nodes::NodePaths;
use crate::contact::topology::pair::Pair;
use crate::contact::topology::surface::ContactSurface;
use crate::geometry::crossings::Crossing;
use crate::metrics::Metrics;
use crate::scene::{RepulsionPlace, Scene};
use crate::snapshot::SnapshotError;
use crate::snapshot::saved_section::{Field, SavedSection, SectionId};
use crate::state::State;

/// Section with the memory of both halves of self-contact.
pub(crate) const SECTION: SectionId = SectionId { name: "self_contact", version: 2 };

/// Collision steps by the number of time steps they were to have: 1, up to 3, up to 7, up to 15, and more.
const STEP_COUNTS: [&str; 5] =
    ["collision_steps_k1", "collision_steps_k2", "collision_steps_k4", "collision_steps_k8", "collision_steps_k16"];

/// Farthest that a node may foreseeably move in one collision step, as a share of its edges, besides the common motion.
const LARGEST_DISPLACEMENT: f64 = 0.5;

/// Farthest that the two sides of a pair which gets a side may come closer in a collision step, over the longest edges: the side of what
/// comes from farther away may change on the way.
const FARTHEST_SIDE: f64 = 0.2;

/// Safety factor on the motion foreseen from the last collision step.
const FORESIGHT: f64 = 1.3;

/// Settings of geometric collisions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct CollisionSettings {
    /// Largest number of time steps between two collision-free states.
    pub max_steps: u32,
}

/// The geometric half.
#[derive(Debug)]
struct Geometric {
    control: Substeps,
    work: CollisionLoop,
    /// Velocities at the collision-free state [m/s].
    velocities: Vec<Vec3>,
    /// Crossings of the collision-free state: those of the start, and of cloth that bodies have pinched. These and what follows
    /// from them are alike on all ranks, in numbers of the scene.
    crossings: Vec<Crossing>,
    /// Pairs that are left alone because of them.
    tangle: Tangle,
    /// Whether lines may wander that the wearing order decides, for which their number may grow.
    lets_wander: bool,
    /// Vertices of cloth that crosses a body where that body crosses itself, ascending. No face of a body may hold them: they
    /// may have to leave by another than they came in.
    pinched: Vec<u32>,
}

/// The state of self-contact; whole, or repulsions alone, or collisions alone.
#[derive(Debug)]
pub(crate) struct SelfContact {
    surface: ContactSurface,
    search: PairSearch,
    proximity: ProximityList,
    repulsions: Option<Repulsions>,
    geometric: Option<Geometric>,
    /// Inverse masses of the nodes of cloth, zero where held in all directions [1/kg].
    mobility: Vec<f64>,
    /// Bodies that the nodes of cloth lie on in B.8; empty without bodies.
    constraints: Vec<BodyConstraints>,
    paths: NodePaths,
    /// Whether some rank has vertices that no triangle has.
    has_isolated: bool,
    /// Positions and velocities of the nodes of cloth in B.2 and B.8, and at a stage of a long step.
    cloth: [Vec<Vec3>; 2],
    /// Displacements of all nodes since the collision-free state at a stage of a long step [m].
    displacements: Vec<Vec3>,
    /// Accelerations of the nodes of cloth at the start of a long step under all forces but those of pairs.
    unrepelled: UnrepelledMotion,
    /// Distance that collisions keep in this collision step [m].
    gap: f64,
    /// Time of the collision-free state [s].
    start_time: f64,
    /// Longest way of a node as a share of its edges [1/s], in the last collision step.
    displacement_rate: f64,
    /// Longest way since the list was made, at the last collision-free state.
    skin_used: f64,
    /// Reach of lists around predicted paths, as a share of the nodes' edges.
    predicted_reach: f64,
    /// Least such reach.
    least_predicted: f64,
    /// Time since the last collision-free state, at the last call of C [s].
    elapsed: f64,
    /// Strategy by which the collisions of this collision step are resolved.
    strategy: Strategy,
    /// Vertices that nothing repels in this collision step, by their numbers in the scene, ascending.
    without_repulsion: Vec<u32>,
    /// Vertices of zones that stayed where they were in the last collision step, likewise; those that this rank has solved.
    frozen: Vec<u32>,
    /// See [`SelfContact::largest_correction`].
    largest_correction: (f64, u32),
}

/// Options of the end of a collision step.
#[derive(Debug, Clone, Copy)]
pub(crate) struct EndOptions {
    /// Whether a hard case is left to a shorter collision step.
    pub may_rewind: bool,
    /// Whether the exact check looks at all cloth.
    pub checks_all: bool,
}

/// Outcome of a collision step.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Ending {
    /// The state is free of collisions, or as good as can be; this says what was left.
    Resolved,
    /// So is this one, but zones stayed where they were because nothing else resolved them.
    Stopped,
    /// The state was put back to the start of the collision step, to be tried again with shorter ones.
    Rewound,
}

impl SelfContact {
    /// Self-contact with these laws of repulsion and settings of collisions; `clamp` is the largest thickness as a fraction of
    /// the rest edges around a vertex.
    pub(crate) fn new(scene: &Scene, repulsion: Option<(Laws, f64)>, collision: Option<CollisionSettings>) -> Self {
        let surface = ContactSurface::new(scene, repulsion.map_or(0.0, |(_, clamp)| clamp));
        let place = scene.description().solver.integrator.spec().repulsion;
        let in_solves = repulsion.is_some() && place == RepulsionPlace::Solves;
        let surface = if in_solves { surface.with_repelling_bodies(scene) } else { surface };
        let proximity = ProximityList::new(&surface);
        let geometric = collision.map(|settings| Geometric {
            control: Substeps::new(settings.max_steps),
            work: CollisionLoop::default(),
            velocities: Vec::new(),
            crossings: Vec::new(),
            tangle: Tangle::default(),
            lets_wander: false,
            pinched: Vec::new(),
        });
        Self {
            search: PairSearch::new(),
            proximity,
            repulsions: repulsion.map(|(laws, _)| Repulsions::new(laws, place)),
            geometric,
            mobility: cloth_mobility(&surface),
            constraints: Vec::new(),
            paths: NodePaths::default(),
            has_isolated: scene.isolated().is_some(),
            cloth: Default::default(),
            displacements: Vec::new(),
            unrepelled: UnrepelledMotion::default(),
            gap: 0.0,
            start_time: 0.0,
            displacement_rate: 0.0,
            skin_used: f64::INFINITY,
            predicted_reach: skin::FIRST_PREDICTED,
            least_predicted: skin::least_predicted(place),
            elapsed: 0.0,
            strategy: Strategy::Usual,
            without_repulsion: Vec::new(),
            frozen: Vec::new(),
            largest_correction: (0.0, 0),
            surface,
        }
    }

    /// Memory held [bytes].
    pub(crate) fn bytes(&self) -> usize {
        let vectors = 2 * self.surface.node_count() + 2 * self.cloth[0].len() + self.displacements.len();
        let nodes = self.surface.node_count() * size_of::<f64>() + size_of_val(self.constraints.as_slice());
        let repulsions = self.repulsions.as_ref().map_or(0, Repulsions::bytes);
        let search = self.search.bytes() + self.proximity.bytes();
        self.surface.bytes() + search + repulsions + nodes + vectors * size_of::<Vec3>()
    }

    /// Memory that the proximity list takes where layers lie on each other [bytes].
    pub(crate) fn bytes_in_heap(&self) -> usize {
        skin::bytes_in_heap(self.surface.nodes().own().len())
    }

    /// True if the scene has self-repulsion.
    pub(crate) fn repels(&self) -> bool {
        self.repulsions.is_some()
    }

    /// Takes the inverse masses of pinned own vertices in the coming step, from those of all local vertices [1/kg]. All ranks
    /// call it together.
    pub(crate) fn set_mobility(&mut self, pinned: impl Iterator<Item = usize> + Clone, of_vertices: &[Vec3]) {
        let Self { surface, mobility, .. } = self;
        let place = surface.place();
        let shift = surface.nodes().own().start;
        let own = |vertex: usize| place.contains(&vertex).then(|| vertex - place.start + shift);
        surface.change_mobility(|all| {
            for (vertex, node) in pinned.clone().filter_map(|vertex| Some((vertex, own(vertex)?))) {
                all[node] = of_vertices[vertex];
            }
        });
        for node in pinned.filter_map(own).chain(surface.nodes().ghost_places()) {
            mobility[node] = surface.mobility()[node].max();
        }
    }

    /// Steps have another length from now on: how many a collision step has is found again.
    pub(crate) fn restart_substeps(&mut self) {
        self.geometric.iter_mut().for_each(|geometric| geometric.control.restart());
    }

    /// Share of the time step that the cloth allows, shortened where contact needs it.
    pub(crate) fn step_share(&self) -> f64 {
        self.geometric.as_ref().map_or(1.0, |g| g.control.share)
    }

    /// Sets the strategy of the next collision step, and the vertices that nothing repels in it, by their numbers in the scene,
    /// ascending: alike on all ranks.
    pub(crate) fn set_strategy(&mut self, strategy: Strategy, without_repulsion: Vec<u32>) {
        (self.strategy, self.without_repulsion) = (strategy, without_repulsion);
    }

    /// Vertices of zones that stayed where they were in the last collision step, by their numbers in the scene; those that this
    /// rank has solved.
    pub(crate) fn frozen_vertices(&self) -> &[u32] {
        &self.frozen
    }

    /// The farthest that the last collision step has moved an own vertex which bodies do not pinch, over the edges around it, and its
    /// number in the scene.
    pub(crate) fn largest_correction(&self) -> (f64, u32) {
        self.largest_correction
    }

    /// A: remembers the collision-free state and gives close pairs their sides; returns how many time steps of length `dt` [s]
    /// the collision step may have.
    pub(crate) fn begin_collision_step(
        &mut self,
        state: &State,
        bodies: &Bodies,
        dt: f64,
        metrics: &mut Metrics,
    ) -> u32 {
        self.surface.gather(&state.x, bodies, &mut self.paths.start);
        self.start_time = state.time;
        if let Some(geometric) = &mut self.geometric {
            geometric.velocities.clear();
            geometric.velocities.extend_from_slice(&state.v);
        }
        let wanted = self.geometric.as_ref().map_or(1, |g| g.control.steps);
        let per_step = FORESIGHT * self.displacement_rate * dt;
        let affordable = (LARGEST_DISPLACEMENT / per_step.max(f64::MIN_POSITIVE)) as u32;
        let steps = wanted.min(affordable).max(1);
        let displacement = per_step * f64::from(steps);
        self.gap = self.gap_now();
        self.skin_used = self.displacement_at_start();
        let lasting = match self.proximity.full_skin() {
            0.0 => Some(self.first_reach()),
            _ => skin::lasting_after(&self.proximity, displacement),
        };
        let duration = dt * f64::from(steps);
        if !self.list_serves(lasting, displacement, duration) {
            metrics.count_once(self.surface.ranks(), "pair_searches", 1);
            let predicted = lasting.is_none().then(|| {
                let ends = self.surface.predict(&self.paths.start, &state.v, bodies, [state.time, duration]);
                PredictedPaths { ends, duration }
            });
            self.rebuild(lasting.unwrap_or(self.predicted_reach), predicted);
            self.skin_used = self.displacement_at_start();
        }
        if let Some(repulsions) = &mut self.repulsions {
            let tangle = self.geometric.as_ref().map(|g| &g.tangle).filter(|tangle| !tangle.is_empty());
            let reach = if lasting.is_some() { 2.0 * self.proximity.skin() } else { FARTHEST_SIDE };
            let slack = (2.0 * displacement).min(reach) * self.surface.longest_edge();
            let (has_deep_parts, points) = (bodies.have_deep_parts(), self.surface.body_points());
            let is_without_repulsion =
                |pair: &Pair| pair.nodes.iter().any(|number| self.without_repulsion.binary_search(number).is_ok());
            let is_ignored = |pair: &Pair| {
                tangle.is_some_and(|tangle| tangle.lets_pass(pair))
                    || (!self.without_repulsion.is_empty() && is_without_repulsion(pair))
                    || (has_deep_parts && points.are_deep(pair, bodies))
            };
            repulsions.record_orientations(
                self.surface.nodes(),
                &self.proximity,
                &self.paths.start,
                slack,
                &is_ignored,
            );
            metrics.count("pairs_near", repulsions.near(self.surface.nodes()));
        }
        let ranks = self.surface.ranks();
        metrics.count_once(ranks, "collision_steps", 1);
        metrics.count_once(ranks, STEP_COUNTS[(steps.ilog2() as usize).min(STEP_COUNTS.len() - 1)], 1);
        metrics.count_once(ranks, "collision_steps_shortened", u64::from(self.step_share() < 1.0));
        steps
    }

    /// Reach of the first list, which would be too long for the memory in a heap that it does not know.
    fn first_reach(&mut self) -> f64 {
        let Self { surface, search, proximity, paths, gap, .. } = self;
        let density = proximity.density_with(surface, search, &mut paths.start, skin::LONG_SKIN, *gap);
        skin::lasting(skin::LONG_SKIN, density)
    }

    /// Longest way of a node since the list was made, at the start of a collision step, as a share of its edges.
    fn displacement_at_start(&mut self) -> f64 {
        self.elapsed = 0.0;
        self.proximity.update_displacements(&self.surface, [&self.paths.start; 2].map(Vec::as_slice), [0.0; 2])
    }

    /// Whether the list serves a collision step in which nodes go `displacement` of their edges in `duration` [s]; `lasting` is the reach of a
    /// list that is to last from now on.
    fn list_serves(&self, lasting: Option<f64>, displacement: f64, duration: f64) -> bool {
        // A step that is tried again starts where its list was made.
        let is_made_here = self.skin_used < REWOUND;
        match (self.proximity.predicted_duration(), lasting) {
            (None, Some(reach)) if is_made_here && self.proximity.full_skin() == reach => true,
            (None, _) => self.skin_used + displacement <= self.proximity.skin(),
            (Some(predicted), None) => is_made_here && duration <= predicted,
            (Some(_), Some(_)) => false,
        }
    }

    /// Distance that everything keeps [m]: several times what rounding to single precision can close, at the largest distance
    /// from the scene's origin, which does not change when the scene is turned. What takes no part may lie anywhere.
    fn gap_now(&self) -> f64 {
        let (surface, x) = (&self.surface, &self.paths.start);
        let farthest = |largest: f64, p: &Vec3| largest.max((p - surface.origin()).norm());
        let largest = if self.has_isolated {
            let corners = surface.cloth().triangles().iter().flatten().map(|node| &x[*node as usize]);
            corners.chain(&x[surface.nodes().cloth()..]).fold(0.0, farthest)
        } else {
            x.iter().fold(0.0, farthest)
        };
        GAP_ROUNDINGS * f64::from(f32::EPSILON) * surface.ranks().max(largest)
    }

    /// Makes the proximity list anew around the collision-free state.
    fn rebuild(&mut self, reach: f64, predicted: Option<PredictedPaths>) {
        let Self { surface, search, proximity, paths, mobility, gap, .. } = self;
        proximity.rebuild(surface, search, &mut paths.start, reach, *gap, predicted);
        if surface.nodes().cloth() != mobility.len() || !surface.ranks().is_alone() {
            *mobility = cloth_mobility(surface);
        }
    }

    /// C: makes the state free of collisions. `x` and `v` are those at the end of the collision step, which took `duration`
    /// [s]; `bodies` stand at its end. Body collision, if the scene has it, hears of the vertices that were moved.
    pub(crate) fn end_collision_step(
        &mut self,
        (x, v): (&mut [Vec3], &mut [Vec3]),
        bodies: &Bodies,
        duration: f64,
        EndOptions { may_rewind, checks_all }: EndOptions,
        metrics: &mut Metrics,
        mut body_collision: Option<&mut BodyCollision>,
    ) -> Ending {
        if let Some(repulsions) = &mut self.repulsions {
            metrics.count("inverted_pairs", repulsions.inverted());
            repulsions.positions_changed();
            repulsions.release_sides();
        }
        self.surface.gather(x, bodies, &mut self.paths.end);
        self.elapsed = duration;
        let paths = [&self.paths.start, &self.paths.end].map(Vec::as_slice);
        let used = self.proximity.update_displacements(&self.surface, paths, [0.0, duration]);
        if duration > 0.0 {
            let displacement = match self.proximity.predicted_duration() {
                Some(_) => self.surface.largest_displacement(paths),
                None => (used - self.skin_used).max(0.0),
            };
            self.displacement_rate = displacement / duration;
        }
        if self.geometric.is_none() {
            return Ending::Resolved;
        }
        let let_go = self.let_go(bodies, body_collision.as_deref());
        let departure = Departure::of(used, &self.proximity, self.surface.nodes());
        if self.proximity.predicted_duration().is_some() {
            let all = f64::from(self.surface.nodes().global_cloth_count());
            let left = departure.beyond as f64 / all.max(1.0);
            self.predicted_reach = skin::predicted_after(self.predicted_reach, left, self.least_predicted);
        }
        let outcome = self.resolve((bodies, &let_go), (duration, departure), may_rewind, metrics);
        let Some(geometric) = &mut self.geometric else { return Ending::Resolved };
        if outcome.rewound {
            metrics.count_once(self.surface.ranks(), "rewinds", 1);
            geometric.control.failed();
            return Ending::Rewound;
        }
        if outcome.hard {
            geometric.control.failed()
        } else {
            geometric.control.succeeded()
        }
        let (place, first) = (self.surface.place(), self.surface.nodes().own().start);
        self.largest_correction = (0.0, 0);
        for &number in &outcome.moved {
            let node = number as usize;
            let vertex = node - first + place.start;
            let change = self.paths.end[node] - x[vertex];
            let (share, in_scene) =
                (change.norm() / self.surface.edge_length()[node], self.surface.nodes().number(number));
            // Shorter steps leave a vertex that bodies pinch no more room.
            let is_pinched = geometric.pinched.binary_search(&in_scene).is_ok()
                || body_collision.as_ref().is_some_and(|bodies| bodies.is_pinched(vertex));
            if share > self.largest_correction.0 && !is_pinched {
                self.largest_correction = (share, in_scene);
            }
            x[vertex] = self.paths.end[node];
            // Held velocities stay as prescribed: where a pin was ahead of its vertex, the way back may be of any length.
            v[vertex] += (change / duration).component_mul(&self.surface.free_axes(node));
            if let Some(bodies) = &mut body_collision {
                bodies.moved(vertex, change.norm());
            }
        }
        let has_crossings = !geometric.crossings.is_empty() || outcome.pinched;
        if self.surface.ranks().any(!outcome.moved.is_empty() || has_crossings || checks_all) {
            let moved = (!checks_all).then_some(&outcome.moved[..]);
            self.check(moved, (x, v), bodies, duration, metrics);
        }
        let cloth = self.surface.nodes().global_cloth_count();
        self.frozen.clear();
        self.frozen.extend(outcome.stopped_nodes.iter().filter(|number| **number < cloth));
        if outcome.stopped { Ending::Stopped } else { Ending::Resolved }
    }

    /// Vertices of the scene that bodies pinch now, ascending. The ranks ask each other only where a part is deep inside another one.
    fn let_go(&self, bodies: &Bodies, body_collision: Option<&BodyCollision>) -> Vec<u32> {
        let Some(collision) = body_collision.filter(|_| bodies.have_deep_parts()) else { return Vec::new() };
        let (place, nodes) = (self.surface.place(), self.surface.nodes());
        let first = nodes.own().start;
        let own: Vec<u32> =
            collision.pinched_now().map(|vertex| nodes.number((vertex - place.start + first) as u32)).collect();
        let mut all = nodes.ranks().all_gather_v(&own).concat();
        all.sort_unstable();
        all
    }

    /// Stops what would pass through something on the paths. The ghosts are those of before when it is done. Vertices that are `let_go`
    /// pass through bodies, and everything through parts that are deep inside others.
    fn resolve(
        &mut self,
        (bodies, let_go): (&Bodies, &[u32]),
        (duration, departure): (f64, Departure),
        may_rewind: bool,
        metrics: &mut Metrics,
    ) -> LoopOutcome {
        let Self { surface, search, proximity, geometric, paths, gap, .. } = self;
        let Some(Geometric { control, work, tangle, pinched, .. }) = geometric else { return LoopOutcome::default() };
        let cloth = surface.nodes().global_cloth_count();
        // Pairs have numbers of the scene here.
        let has_deep_parts = bodies.have_deep_parts();
        let points = surface.body_points();
        let is_ignored = |pair: &Pair| {
            let of_body = || pair.nodes.iter().any(|number| *number >= cloth);
            let is_let_go =
                |number: &u32| pinched.binary_search(number).is_ok() || let_go.binary_search(number).is_ok();
            let lets_out = || of_body() && pair.nodes.iter().any(is_let_go);
            let is_deep = || has_deep_parts && points.are_deep(pair, bodies);
            tangle.lets_pass(pair) || is_deep() || (!(pinched.is_empty() && let_go.is_empty()) && lets_out())
        };
        let mut collisions = Collisions {
            surface,
            gap: *gap,
            duration,
            ignored: &is_ignored,
            may_rewind: may_rewind && control.steps > 1,
            strategy: self.strategy,
        };
        let kept = collisions.surface.nodes().clone();
        let mut outcome = work.resolve(&mut collisions, proximity, search, paths, departure, metrics);
        work.release_candidates();
        // Where another rank alone has new ghosts, this one sends more.
        if !surface.nodes().is_laid_out_as(&kept) {
            let renumber = surface.set_nodes(kept);
            proximity.renumber(&renumber, surface);
            paths.renumber(&renumber);
            renumber.renumber(outcome.moved.iter_mut());
        }
        outcome
    }

    /// Returns the memory of self-contact at a collision-free state: the proximity list by the positions it was made
    /// around, the number and length of the steps it takes, and the crossings.
    pub(crate) fn save(&self) -> SavedSection {
        let (reference, nodes) = (self.proximity.reference(), self.surface.nodes());
        let list = reference.map(|x| [&x[nodes.own()], &x[nodes.cloth()..]]);
        let memory = SavedSection::new(SECTION)
            .with("wear", Field::single(self.displacement_rate))
            .with("list_reach", Field::single(self.proximity.full_skin()))
            .with("list_density", Field::single(self.proximity.density()))
            .with("predicted_reach", Field::single(self.predicted_reach))
            .with("list_positions", Field::nodes(nodes.count() - nodes.cloth(), list));
        let Some(geometric) = &self.geometric else { return memory };
        let crossings = geometric.crossings.iter().flat_map(|c| c.edge.into_iter().chain(c.triangle));
        memory
            .with("steps", Field::single(u64::from(geometric.control.steps)))
            .with("step_share", Field::single(geometric.control.share))
            .with("successes", Field::single(u64::from(geometric.control.successes)))
            .with("crossings", Field::numbers(5, crossings.collect()))
            .with("pinched", Field::numbers(1, geometric.pinched.clone()))
    }

    /// Goes on from what was remembered. All ranks call it together.
    ///
    /// # Errors
    /// The same on all ranks: it names nodes that do not exist, or numbers that are none.
    pub(crate) fn restore(&mut self, memory: &SavedSection) -> Result<(), SnapshotError> {
        self.check_memory(memory)?;
        self.displacement_rate = memory.single("wear");
        self.predicted_reach = memory.single("predicted_reach");
        self.proximity.forget(memory.single("list_reach"), memory.single("list_density"));
        if let Some([cloth, bodies]) = memory.nodes("list_positions") {
            let nodes = self.surface.nodes();
            let start = &mut self.paths.start;
            *start = vec![Vec3::zeros(); nodes.count()];
            start[nodes.own()].copy_from_slice(cloth);
            start[nodes.cloth()..].copy_from_slice(bodies);
            nodes.update(start);
            let reach = memory.single("list_reach");
            // The list follows from the positions it was made around, to the last bit and in the same order.
            self.gap = self.gap_now();
            self.rebuild(reach, None);
        }
        let Some(geometric) = &mut self.geometric else { return Ok(()) };
        let count = |name| u32::try_from(memory.single::<u64>(name)).unwrap_or(u32::MAX);
        geometric.control.restore(count("steps"), memory.single("step_share"), count("successes"));
        let rows = memory.values("crossings").as_chunks::<5>().0;
        let crossing = |&[a, b, c, d, e]: &[u32; 5]| Crossing { edge: [a, b], triangle: [c, d, e] };
        geometric.crossings = rows.iter().map(crossing).collect();
        geometric.tangle = Tangle::of(&self.surface, &geometric.crossings);
        geometric.pinched = memory.values("pinched").to_vec();
        Ok(())
    }

    /// Refuses a memory that would be followed into nodes that do not exist. What it looks at is alike on all ranks.
    fn check_memory(&self, memory: &SavedSection) -> Result<(), SnapshotError> {
        let error = |what: String| Err(SnapshotError { section: SECTION.name.to_owned(), what });
        let of_geometric = |name| self.geometric.as_ref().map(|_| name);
        for name in
            ["wear", "list_reach", "list_density", "predicted_reach"].into_iter().chain(of_geometric("step_share"))
        {
            let number: f64 = memory.single(name);
            if !(number >= 0.0 && number.is_finite()) {
                return error(format!("`{name}` is {number}"));
            }
        }
        let nodes = self.surface.nodes();
        let all = nodes.global_cloth_count() as usize + nodes.count() - nodes.cloth();
        for name in ["crossings", "pinched"].into_iter().filter_map(of_geometric) {
            if let Some(number) = memory.values::<u32>(name).iter().find(|number| **number as usize >= all) {
                return error(format!("`{name}` names node {number} of {all}"));
            }
        }
        Ok(())
    }

    /// Puts the state back to the last collision-free one; of the positions, those of own vertices.
    pub(crate) fn rewind(&self, state: &mut State) {
        if let Some(geometric) = &self.geometric {
            state.x[self.surface.place()].copy_from_slice(&self.paths.start[self.surface.nodes().own()]);
            state.v.copy_from_slice(&geometric.velocities);
            state.time = self.start_time;
        }
    }

    /// Whether geometric collisions keep the state free of crossings.
    pub(crate) fn keeps_free(&self) -> bool {
        self.geometric.is_some()
    }
}

/// Inverse masses of the nodes of cloth, zero where held in all directions [1/kg].
fn cloth_mobility(surface: &ContactSurface) -> Vec<f64> {
    surface.mobility()[..surface.nodes().cloth()].iter().map(Vec3::max).collect()
}
