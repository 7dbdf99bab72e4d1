//! Repulsion inside the solves of long steps: pairs that are closer than their thickness push each other apart with a spring, a
//! damper and friction (`docs/theory/tr_bdf2.md#repulsion-in-the-solves`).
//!
//! Impulses after a solve move single vertices by what a step of milliseconds takes them, and stiff cloth answers in the next.
//! Here the solve itself finds the velocities at which springs of the cloth and of its pairs agree.

use rayon::prelude::*;

use crate::Vec3;
use crate::contact::repulsion::active_pair::{OrientedPair, PairsOfKind};
use crate::contact::repulsion::{CHUNK, Laws};
use crate::contact::tolerances::SLOW_SLIP;
use crate::contact::topology::nodes::ContactNodes;
use crate::contact::topology::pair::{Pair, PairKind};
use crate::contact::topology::surface::ContactSurface;
use crate::long_steps::{
    EDGE_ENDS, FIRST_TANGENT, KEPT_APART, LOOK_AHEAD, LOOK_BEHIND, ONSET, PAIR_DAMPING, PARALLEL_EDGES, PRESSURE,
    SHARED_END, STIFFENING, STIFFENING_ON_BODIES,
};
use crate::parallel::simd4::Simd4;

/// Area of a vertex, over the square of its mean edge, in a mesh of equilateral triangles.
const AREA: f64 = 0.866_025_403_784_438_6;

/// Least factor of the spring of two edges that counts for their damping time: a vertex on a vertex.
const SOFTEST_EDGES: f64 = SHARED_END * SHARED_END;

/// Newton steps for the overlap of a push. From the right they halve what is left at worst, and a tangent anywhere near will do.
const OVERLAP_STEPS: usize = 12;

/// Positions and velocities of the nodes of contact at a stage.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PairStage<'a> {
    /// The surfaces.
    pub surface: &'a ContactSurface,
    /// Positions of all nodes, ghosts and points of bodies included [m].
    pub x: &'a [Vec3],
    /// Their displacements since the collision-free state [m].
    pub displacements: &'a [Vec3],
    /// Their velocities [m/s].
    pub v: &'a [Vec3],
    /// Inverse masses of the nodes of cloth, zero where held [1/kg].
    pub mobility: &'a [f64],
    /// Accelerations of the nodes of cloth before pairs repel each other.
    pub unrepelled: &'a UnrepelledMotion,
    /// Length of the step [s].
    pub dt: f64,
    /// True for a guess of Newton's method, about which the law of each pair is linearised; false for the state at the start of the step.
    pub is_guess: bool,
}

/// Motion of the nodes of cloth at the start of a step under all forces but those of pairs. It tells how hard a pair is pressed.
#[derive(Debug, Default)]
pub(crate) struct UnrepelledMotion {
    /// Accelerations [m/s²], zero where a body holds the node.
    accelerations: Vec<Vec3>,
    /// Inverse masses, zero where held, by a body too [1/kg].
    mobility: Vec<f64>,
}

impl UnrepelledMotion {
    /// Sets the accelerations of this rank's own nodes [m/s²], none where a body holds one, and brings them to the ghosts. `mobility` are
    /// inverse masses of all nodes of cloth [1/kg]. All ranks call it together.
    pub(crate) fn set(&mut self, nodes: &ContactNodes, mobility: &[f64], of_own: impl Iterator<Item = Option<Vec3>>) {
        let Self { accelerations, mobility: free } = self;
        accelerations.clear();
        accelerations.resize(nodes.cloth(), Vec3::zeros());
        free.clear();
        free.extend_from_slice(mobility);
        for (node, acceleration) in nodes.own().zip(of_own) {
            match acceleration {
                Some(acceleration) => accelerations[node] = acceleration,
                None => free[node] = 0.0,
            }
        }
        nodes.update_all(&mut [accelerations, free]);
    }

    /// Force that keeps the sides of a pair from accelerating towards each other along `normal` [N], negative where they part.
    fn pressing_force(&self, nodes: [u32; 4], weights: [f64; 4], normal: &Vec3) -> f64 {
        let (mut approach, mut response) = (0.0, 0.0);
        for (node, weight) in nodes.into_iter().zip(weights) {
            if let Some(mobility) = self.mobility.get(node as usize).filter(|mobility| **mobility > 0.0) {
                approach -= weight * self.accelerations[node as usize].dot(normal);
                response += weight * weight * mobility;
            }
        }
        if response > 0.0 { approach / response } else { 0.0 }
    }
}

/// Force of a pair in touch on its nodes: node i is pushed by `weights[i]` times the force.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct PairForce {
    /// The pair, by the scene's numbers.
    pub pair: Pair,
    /// Its nodes of contact.
    pub nodes: [u32; 4],
    /// Weights of the point on one side, and minus those of the other.
    pub weights: [f64; 4],
    /// Unit direction from the second side to the first.
    pub normal: Vec3,
    /// Signed distance [m], negative where the two have passed through each other.
    pub distance: f64,
    /// Distance that the pair keeps [m].
    pub thickness: f64,
    /// Force on the first side [N]: as it is evaluated, and after a solve about there as that has found it.
    pub force: Vec3,
    /// Its component along the normal [N], negative where the solve pulled at it.
    pub push: f64,
    /// History of the pair within a step.
    pub history: PairHistory,
    /// Minus its derivative by the distance along the normal [N/m].
    pub stiffness: f64,
    /// Minus those by the relative velocity, along the normal and across it [N s/m].
    pub damping: [f64; 2],
    /// Change of the velocity along its normal in the solve about this evaluation, over its thickness [1/s]; nothing before.
    pub last_change: f64,
}

/// History of a pair in touch within a step, kept from one evaluation to the next.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct PairHistory {
    /// Push at the two evaluations before, the later first, after the solve where one followed; nothing where it was not in touch [N].
    pushes: [f64; 2],
    /// Speed at which its sides slid on each other when it was first evaluated in this step [m/s].
    first_slip: Option<f64>,
}

impl PairHistory {
    /// History of a pair that was not in touch.
    pub(crate) const NONE: Self = Self { pushes: [0.0; 2], first_slip: None };

    /// Returns the history after an evaluation and its solve.
    fn after(before: &PairForce) -> Self {
        Self { pushes: [before.push, before.history.pushes[0]], first_slip: before.history.first_slip }
    }

    /// Returns the push that friction may count on [N]. A guess overlaps by what its solve takes back and would rub a
    /// hundred times as hard as the pair bears in the end; one that only some solves press together bears nothing for
    /// good.
    fn load(&self) -> f64 {
        self.pushes[0].min(self.pushes[1]).max(0.0)
    }

    /// Push that the solve before has found [N]; nothing for a pair that was not in touch.
    fn solved_push(&self) -> Option<f64> {
        self.first_slip.map(|_| self.pushes[0])
    }

    /// Whether the pair was pressed together at the evaluation before.
    fn was_pressed(&self) -> bool {
        self.solved_push().is_some_and(|push| push > 0.0)
    }
}

/// After a solve of which these are the products of the pairs with its solution, in a system that weighs damping of pairs by
/// `share alpha`: notes the force of each at the velocities that the solve has found, and by how much its velocity along the normal
/// has changed.
pub(crate) fn note_solution(pairs: &mut [PairForce], products: &[Simd4], [share, alpha]: [f64; 2]) {
    for (pair, product) in pairs.iter_mut().zip(products) {
        let taken = Vec3::from(*product) / (share * alpha);
        pair.force -= taken;
        let taken = taken.dot(&pair.normal);
        pair.push -= taken;
        let change = taken / (pair.damping[0] + alpha * pair.stiffness);
        pair.last_change = change.abs() / pair.thickness;
    }
}

/// The forces of all pairs in touch, by kind and nodes. `before` are those of the evaluation before in this step; none if it is the first.
pub(super) fn pair_forces(
    kinds: &mut [PairsOfKind; 2],
    laws: &Laws,
    at: &PairStage<'_>,
    before: &[PairForce],
) -> Vec<PairForce> {
    for PairsOfKind { oriented, damping_times, .. } in kinds.iter_mut() {
        if !at.is_guess || damping_times.len() != oriented.len() {
            damping_times.clear();
            damping_times.par_extend(oriented.par_iter().map(|pair| rounded_up(pair.longest_damping_time(at))));
        }
    }
    let history = |pair: &Pair| {
        let found = before.binary_search_by(|other| other.pair.cmp(pair));
        found.map_or(PairHistory::NONE, |found| PairHistory::after(&before[found]))
    };
    let mut all = Vec::new();
    for of_kind in &*kinds {
        let chunks = of_kind.oriented.par_chunks(CHUNK).zip(of_kind.damping_times.par_chunks(CHUNK));
        let of_chunk = |(pairs, times): (&[OrientedPair], &[f32])| {
            let mut near = Vec::new();
            for (pair, time) in pairs.iter().zip(times) {
                if !pair.is_out_of_touch(at, f64::from(*time)) {
                    near.push(pair);
                }
            }
            near.into_iter().filter_map(|pair| pair.force(laws, at, history)).collect()
        };
        let pieces: Vec<Vec<PairForce>> = chunks.map(of_chunk).collect();
        pieces.into_iter().for_each(|piece| all.extend(piece));
    }
    all.sort_unstable_by_key(|force| force.pair);
    all
}

/// An upper bound in single precision.
fn rounded_up(bound: f64) -> f32 {
    let rounded = bound as f32;
    if f64::from(rounded) < bound { rounded.next_up() } else { rounded }
}

/// The spring of a pair, and with it the law of its push (`docs/theory/tr_bdf2.md#repulsion-in-the-solves`).
struct PairSpring {
    /// Stiffness where the overlap is small, but larger than the onset [N/m].
    linear: f64,
    /// Distance that the pair keeps [m].
    thickness: f64,
    /// Factors of the cube and of the fourth power of the overlap over the thickness.
    stiffening: [f64; 2],
}

impl PairSpring {
    /// Push of two layers that yield by half of their thickness, over that of a linear spring that yields by all of it.
    const HALF_PUSH: f64 = 0.5 + STIFFENING[0] / 8.0 + STIFFENING[1] / 16.0 - 0.5 * ONSET;

    /// The spring of a pair that nothing presses.
    fn new(linear: f64, thickness: f64, is_on_body: bool) -> Self {
        Self { linear, thickness, stiffening: if is_on_body { STIFFENING_ON_BODIES } else { STIFFENING } }
    }

    /// The spring that is stiffer where more presses it [N] than two layers bear at half of their thickness: with any bound of its push a
    /// stage would take the sides through each other, and C would throw them apart again in every step.
    fn pressed_by(self, pressing_force: f64) -> Self {
        let half = Self::HALF_PUSH * self.linear * self.thickness;
        Self { linear: self.linear * (pressing_force / half).max(1.0), ..self }
    }

    /// Push F [N] at `y` [m], which is the overlap of a pair at rest, and its derivative F' [N/m]: F is convex and increases,
    /// so that Newton's method finds the push of a pair without turning round.
    fn at(&self, y: f64) -> (f64, f64) {
        let Self { linear, thickness, stiffening } = *self;
        // p = P (s + a s³ + b s⁴) with s = o/H, less the share of the onset, and the tangent at o = H beyond it.
        let inside = y.min(thickness);
        let share = inside / thickness;
        let begun = (share / ONSET).min(1.0);
        // Terms of the cube and of the fourth power, over s.
        let [cubic, quartic] = [stiffening[0] * share.powi(2), stiffening[1] * share.powi(3)];
        let stiffness = linear * (begun + 3.0 * cubic + 4.0 * quartic);
        let push = linear * ((begun + cubic + quartic) * inside - 0.5 * begun * begun * ONSET * thickness);
        (push + stiffness * (y - inside), stiffness)
    }

    /// Returns the overlap at which the push is `push` [N], at most `most` [m]: Newton's method on a convex function,
    /// from its right.
    fn overlap_of(&self, push: f64, most: f64) -> f64 {
        let mut y = most;
        for _ in 0..OVERLAP_STEPS {
            let (found, stiffness) = self.at(y);
            if found <= push {
                break;
            }
            y -= (found - push) / stiffness;
        }
        y
    }

    /// Push [N] and its derivative [N/m] at `y` [m] by the tangent that suits a pair of this history in a guess of Newton's method.
    ///
    /// The law is flat where layers touch lightly. Its tangent at a deep overlap would take back half of the overlap in a round, and the next
    /// one half of the rest. The push that the solve before has found says where the law is needed. A pair that was pressed and that a guess
    /// has parted has the tangent at that push, which may pull: else the solve would throw what the pair holds.
    fn linearised(&self, y: f64, history: &PairHistory) -> (f64, f64) {
        let onset = ONSET * self.thickness;
        let about = match history.solved_push() {
            None => y.min(FIRST_TANGENT * self.thickness),
            Some(push) if push > 0.0 && y < onset => y.max(self.overlap_of(push, onset)),
            Some(push) => y.min(self.overlap_of(push.max(0.0), y).max(onset)),
        };
        let (push, stiffness) = self.at(about);
        (push + stiffness * (y - about), stiffness)
    }
}

/// Smooth step from 0 to 1, of which the derivatives are zero at both ends.
fn smooth_step(t: f64) -> f64 {
    let t = t.clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

impl OrientedPair {
    /// Stiffness of the pair's spring where the overlap is small, but larger than the onset [N/m].
    #[inline]
    fn linear_stiffness(&self, at: &PairStage<'_>) -> f64 {
        let (mut edges, mut count) = (0.0, 0.0);
        for node in self.pair.nodes.into_iter().filter(|node| (*node as usize) < at.mobility.len()) {
            edges += at.surface.edge_length()[node as usize];
            count += 1.0;
        }
        let edge: f64 = edges / count;
        PRESSURE * AREA * edge * edge / self.thickness()
    }

    /// Upper bound on the damping time of the pair [s], wherever its two are closest; infinite where nodes are held. A pair that something
    /// presses is stiffer and has a shorter one.
    fn longest_damping_time(&self, at: &PairStage<'_>) -> f64 {
        let [a, b, c, d] = self.pair.nodes.map(|node| at.mobility.get(node as usize).copied().unwrap_or(0.0));
        // Weights of a side sum to one: their squares to no less than one over their number.
        let (response, softest) = match self.pair.kind {
            PairKind::PointTriangle => (a + b.min(c).min(d) / 3.0, 1.0),
            PairKind::EdgeEdge => (0.5 * (a.min(b) + c.min(d)), SOFTEST_EDGES),
        };
        PAIR_DAMPING / (softest * self.linear_stiffness(at) * response).sqrt()
    }

    /// Least y of a pair in touch [m], exclusive: in a guess, below zero for one that was pressed.
    fn least_overlap(&self, at: &PairStage<'_>) -> f64 {
        if at.is_guess { -KEPT_APART * self.thickness() } else { 0.0 }
    }

    /// Whether the pair cannot be in touch, wherever its two are closest, with a damping time of at most `damping_time` [s]: most are too far
    /// apart for how fast their nodes approach.
    ///
    /// Let the distance be at least s along the axis, the nodes approach along it at c at most and move against each other at v at most. Where
    /// the normal is θ off the axis, the distance is at least s/cos θ, and the approach along the normal at most c cos θ + v sin θ. So
    /// y ≤ H − s (1 + θ²/2) + τ c + τ v θ ≤ H − s + τ c + (τ v)²/2s. The approach is no more than v either. τ is the damping time at the
    /// distance s: the damper fades with the distance.
    #[inline]
    fn is_out_of_touch(&self, at: &PairStage<'_>, damping_time: f64) -> bool {
        let distance = self.distance_bound(at.displacements);
        let reach = self.thickness() - self.least_overlap(at);
        if distance <= reach {
            return false;
        }
        if distance > LOOK_AHEAD * self.thickness() {
            return true;
        }
        let damping_time = damping_time * self.damped_share(distance).min(1.0);
        let approach = damping_time * self.largest_approach(at.v).max(0.0);
        let squared = damping_time * damping_time * self.largest_difference_squared(at.v);
        let room = distance - reach;
        squared < room * room || approach + squared / (2.0 * distance) < room
    }

    /// Factor of the spring of two edges that touch near their ends or are nearly parallel; 1 for a point and a triangle.
    ///
    /// All edges that meet at a vertex which lies on an edge, or on a vertex, touch there, and they share the spring
    /// of one pair. Closest points of parallel edges jump from end to end (mollifier of M. Li et al., "Incremental
    /// Potential Contact", 2020).
    fn mollifier(&self, x: &[Vec3], weights: [f64; 4]) -> f64 {
        if self.pair.kind == PairKind::PointTriangle {
            return 1.0;
        }
        let [a, b, c, d] = weights.map(f64::abs);
        let of_edge = |end: f64| SHARED_END + (1.0 - SHARED_END) * smooth_step(end / EDGE_ENDS);
        let [p, q, r, s] = self.pair.positions(x);
        let (one, other) = (q - p, s - r);
        let lengths = (one.norm_squared() * other.norm_squared()).sqrt();
        let sine = one.cross(&other).norm() / lengths;
        of_edge(a.min(b)) * of_edge(c.min(d)) * smooth_step(sine / PARALLEL_EDGES)
    }

    /// Share of the damping time that is left at a distance [m]: above 1 within the thickness, 0 where pairs are no longer looked for.
    fn damped_share(&self, distance: f64) -> f64 {
        (LOOK_AHEAD - distance / self.thickness()) / (LOOK_AHEAD - 1.0)
    }

    /// Damping time at a distance [m] of a pair that has `whole` in touch [s], and minus the derivative of y by the distance where the sides
    /// move apart at `speed` [m/s]. A damper that ended at once where pairs are no longer looked for would come and go from round to round.
    fn damping(&self, whole: f64, distance: f64, speed: f64) -> (f64, f64) {
        let share = self.damped_share(distance);
        if share >= 1.0 {
            return (whole, 1.0);
        }
        (whole * share, 1.0 + whole * (-speed).max(0.0) / ((LOOK_AHEAD - 1.0) * self.thickness()))
    }

    /// Force of the pair, if it is in touch, or about to be, and nothing pulls it.
    fn force(&self, laws: &Laws, at: &PairStage<'_>, history: impl Fn(&Pair) -> PairHistory) -> Option<PairForce> {
        // A pair that has passed through has moved farther than one that is still in front.
        let reaches = [LOOK_AHEAD, LOOK_BEHIND].map(|reach| reach * self.thickness());
        let (weights, normal, distance) = self.touch(laws, at.x, reaches)?;
        // A normal that turns round without that says nothing of sides.
        let has_passed = || !self.is_beyond(at.displacements, 0.0);
        if distance < 0.0 && !has_passed() {
            return None;
        }
        let (nodes, surface) = (self.pair.nodes, at.surface);
        let (mut response, mut velocity) = (0.0, Vec3::zeros());
        for (node, weight) in nodes.into_iter().zip(weights) {
            velocity += at.v[node as usize] * weight;
            if let Some(mobility) = at.mobility.get(node as usize) {
                response += weight * weight * mobility;
            }
        }
        let mollifier = self.mollifier(at.x, weights);
        if response <= 0.0 || mollifier <= 0.0 {
            return None;
        }
        let pressing_force = at.unrepelled.pressing_force(nodes, weights, &normal);
        let body = surface.body_of(&nodes);
        let spring = PairSpring::new(self.linear_stiffness(at), self.thickness(), body.is_some());
        let mut spring = spring.pressed_by(pressing_force);
        let damped = mollifier.max(SOFTEST_EDGES) * spring.linear;
        spring.linear *= mollifier;
        let approach = velocity.dot(&normal);
        let (damping_time, steepness) = self.damping(PAIR_DAMPING / (damped * response).sqrt(), distance, approach);
        let y = self.thickness() - distance - damping_time * approach;
        if y <= self.least_overlap(at) {
            return None;
        }
        let pair = surface.nodes().numbered(&self.pair);
        let mut history = history(&pair);
        if y <= 0.0 && !history.was_pressed() {
            return None;
        }
        let slip = velocity - normal * approach;
        let of_cloth = || surface.friction().of(laws.friction, nodes, weights);
        let friction = body.map_or_else(of_cloth, |body| body.friction);
        let speed = slip.norm();
        let (push, stiffness) = if at.is_guess { spring.linearised(y, &history) } else { spring.at(y) };
        let first_slip = *history.first_slip.get_or_insert(speed);
        // What slows down within the step has at most Coulomb's friction at its end.
        let sliding = friction * history.load() / speed.max(first_slip).max(SLOW_SLIP);
        let tangential_damping = sliding.min(spring.linear * at.dt);
        let force = normal * push - slip * tangential_damping;
        Some(PairForce {
            pair,
            nodes,
            weights,
            normal,
            distance,
            thickness: self.thickness(),
            force,
            push,
            history,
            stiffness: steepness * stiffness,
            damping: [damping_time * stiffness, tangential_damping],
            last_change: 0.0,
        })
    }
}

#[cfg(test)]
mod tests;
