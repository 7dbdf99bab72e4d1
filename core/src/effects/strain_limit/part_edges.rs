//! The edges of one part under a strain limit. An edge over a border is with both parts, with the same numbers.

use crate::Vec3;
use crate::effects::force::{FilterStep, Purpose};
use crate::effects::strain_limit::{Limits, RECOVERY};
use crate::elements::corners::by_part;
use crate::mesh::TriangleMesh;
use crate::parallel::parts::Parts;
use crate::tolerances::STRAIN_OVER_LIMIT;

/// An edge, and what is known of it during one solve.
#[derive(Debug, Clone, Copy)]
struct LimitedEdge {
    /// Local vertices, the smaller number first.
    ends: [u32; 2],
    rest_length: f64,
    limits: Limits,
    /// From the first to the second end after the step, as it would be.
    direction: Vec3,
    /// Length after the step as it would be, and the shortest and the longest that are allowed, by the step [m/s].
    parting: f64,
    allowed: [f64; 2],
    /// No less than what all impulses of one unit do to this edge [1/kg].
    response: f64,
    /// Impulse that pulls the ends together [kg m/s], and where it is heading.
    impulse: f64,
    ahead: f64,
}

/// The edges of one part.
#[derive(Debug, Default)]
pub(super) struct PartEdges {
    edges: Vec<LimitedEdge>,
    /// Whether the edge counts in this part: it holds the first end.
    counts: Vec<bool>,
    /// Length of the step [s].
    dt: f64,
}

/// The edges of a mesh, with these ends (local vertices), of every own part.
///
/// `limits` are those of each edge of the mesh.
pub(super) fn of_parts(
    parts: &Parts,
    mesh: &TriangleMesh,
    ends: &[[usize; 2]],
    limits: impl Fn(usize) -> Limits,
) -> Vec<PartEdges> {
    let mut built: Vec<PartEdges> = parts.ranges().iter().map(|_| PartEdges::default()).collect();
    for (part, number) in by_part(parts, ends.iter().copied()) {
        built[part].edges.push(LimitedEdge {
            ends: ends[number].map(|end| end as u32),
            rest_length: mesh.rest_length(mesh.edges()[number]),
            limits: limits(number),
            direction: Vec3::zeros(),
            parting: 0.0,
            allowed: [0.0; 2],
            response: 1.0,
            impulse: 0.0,
            ahead: 0.0,
        });
        built[part].counts.push(parts.ranges()[part].contains(&ends[number][0]));
    }
    built
}

impl PartEdges {
    pub(super) fn bytes(&self) -> usize {
        self.edges.len() * (size_of::<LimitedEdge>() + size_of::<bool>())
    }

    /// Number of edges that count in this part.
    pub(super) fn counted(&self) -> usize {
        self.counts.iter().filter(|counts| **counts).count()
    }

    /// Impulse of an edge.
    pub(super) fn impulse(&self, edge: usize) -> f64 {
        self.edges[edge].impulse
    }

    /// Returns the extrapolated impulse of an edge.
    pub(super) fn ahead(&self, edge: usize) -> f64 {
        self.edges[edge].ahead
    }

    /// Begins a solve for a step with these velocities and numbers of edges of the local vertices, without impulses. Returns the
    /// largest excess over what is allowed, by rest length, and the sum of the squares of those that count here.
    pub(super) fn begin(&mut self, step: &FilterStep<'_>, v: &[Vec3], valence: &[f64]) -> (f64, f64) {
        let FilterStep { mobility, x, dt, purpose, .. } = *step;
        self.dt = dt;
        let (mut worst, mut squares) = (0.0_f64, 0.0);
        for (edge, counts) in self.edges.iter_mut().zip(&self.counts) {
            let [i, j] = edge.ends.map(|end| end as usize);
            let now = x[j] - x[i];
            let then = now + (v[j] - v[i]) * dt;
            let (length, after) = (now.norm(), then.norm());
            edge.direction = then.try_normalize(0.0).unwrap_or_else(Vec3::zeros);
            let back = if purpose == Purpose::Positions { RECOVERY } else { 0.0 };
            let longest = (edge.limits.longest * edge.rest_length).max(length * (1.0 - back));
            let shortest = (edge.limits.shortest * edge.rest_length).min(length * (1.0 + back));
            edge.parting = after / dt;
            edge.allowed = [shortest / dt, longest / dt];
            edge.response = valence[i] * mobility[i].max() + valence[j] * mobility[j].max();
            (edge.impulse, edge.ahead) = (0.0, 0.0);
            // What pins hold at both ends cannot be changed.
            if edge.response > 0.0 {
                let excess = ((after - longest).max(shortest - after) / edge.rest_length).max(0.0);
                worst = worst.max(excess);
                squares += if *counts { excess * excess } else { 0.0 };
            }
        }
        (worst, squares)
    }

    /// Adds the impulses on the part's own vertices, the first of which is `start`, to `sums`, which need not be zero before.
    pub(super) fn add_up(&self, start: usize, impulse: fn(&Self, usize) -> f64, sums: &mut [Vec3]) {
        sums.fill(Vec3::zeros());
        for (number, edge) in self.edges.iter().enumerate() {
            let pull = edge.direction * impulse(self, number);
            let [i, j] = edge.ends.map(|end| (end as usize).wrapping_sub(start));
            if let Some(sum) = sums.get_mut(i) {
                *sum += pull;
            }
            if let Some(sum) = sums.get_mut(j) {
                *sum -= pull;
            }
        }
    }

    /// One sweep, from the change of velocity of all local vertices that the heading impulses make. Returns the largest excess
    /// that they left, by rest length.
    pub(super) fn sweep(&mut self, change: &[Vec3], ahead: f64) -> f64 {
        let mut worst = 0.0_f64;
        for edge in self.edges.iter_mut().filter(|edge| edge.response > 0.0) {
            let [i, j] = edge.ends.map(|end| end as usize);
            let parting = edge.parting + edge.direction.dot(&(change[j] - change[i]));
            let [shortest, longest] = edge.allowed;
            worst = worst.max((parting - longest).max(shortest - parting) * self.dt / edge.rest_length);
            let free = edge.ahead * edge.response + parting;
            let impulse = (free - free.clamp(shortest, longest)) / edge.response;
            edge.ahead = impulse + ahead * (impulse - edge.impulse);
            edge.impulse = impulse;
        }
        worst
    }

    /// Returns the number of edges beyond the limit after a step with these velocities.
    pub(super) fn over_limit(&self, x: &[Vec3], v: &[Vec3], dt: f64) -> u64 {
        let is_over = |edge: &LimitedEdge| {
            let [i, j] = edge.ends.map(|end| end as usize);
            let after = (x[j] - x[i] + (v[j] - v[i]) * dt).norm() / edge.rest_length;
            after > edge.limits.longest + STRAIN_OVER_LIMIT || after < edge.limits.shortest - STRAIN_OVER_LIMIT
        };
        self.edges.iter().zip(&self.counts).filter(|(edge, counts)| **counts && is_over(edge)).count() as u64
    }
}
