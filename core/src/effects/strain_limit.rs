//! Strain limit: no edge gets longer, or shorter, than a given share of its rest length.
//!
//! ```toml
//! [garment.strain_limit]
//! limit = "10 %"              # cloth is soft at first and then stops
//! compression = "5 %"         # optional; folding is not compression
//! ```
//!
//! Soft springs with a limit behave as woven cloth does, and allow longer steps than stiff springs. Twice a step velocities are
//! changed by impulses along the edges, equal and opposite at their ends, so that momentum stays: v½ in B.2, after
//! self-repulsion, so that the end positions `x + dt v½` keep the limit; and v' in B.8, so that nothing goes on stretching.
//! v½ only makes positions: an edge that is too long at the start gets shorter by up to a fiftieth a step. v' is never pulled
//! together, only kept from parting, so that the limit takes energy and gives none. Pinned vertices do not yield.
//!
//! The smallest such change solves `min ½ |Δv|²_M, lower ≤ |x + dt (v + Δv)| ≤ upper` for all edges at once, linearised about
//! `x + dt v`, and again where that was too far from it. Its dual has one unknown for each edge and is solved by accelerated projected gradients, each sweep from the last
//! one's values alone: no order enters, and an edge between two parts is computed by both from the same numbers. Sweeps end when
//! no edge is longer by a ten-thousandth than allowed, when they get nowhere, or after `sweeps` of them. What is left is counted
//! (`strain_over_limit`) and shows in the largest strain of the frame: a limit of 1 % under load over a hundred rows of edges
//! takes some hundred sweeps, and several times as many in a long step, in which edges go farther. Bodies, and collisions in C,
//! come after the limit and may stretch edges beyond it.

#![cfg(feature = "effects")]

mod part_edges;

use crate::Vec3;
use crate::effects::force::{FilterStep, Purpose, VelocityFilter};
use crate::effects::spec::{BuildContext, Cost, Effect, EffectSpec, MapSpec, Need, Report, Scope, Study};
use crate::error::Problem;
use crate::metrics::Metrics;
use crate::parallel::for_each_part::{PerPart, PerVertex};
use crate::parallel::parts::Parts;
use crate::parallel::reduce::largest;
use crate::scene::SceneDescription;
use crate::settings::{Default, Dimension, Field, Settings};
use crate::tolerances::STRAIN_OVER_LIMIT;
use part_edges::PartEdges;

/// Registry entry.
pub(crate) static SPEC: EffectSpec = EffectSpec {
    name: "strain_limit",
    summary: "strain limiting: edges stop at a largest stretch",
    scope: Scope::Garment,
    example: r"[garment.strain_limit]
limit = 0.01",
    fields: &[
        Field {
            name: "limit",
            dimension: Dimension::None,
            default: Default::Number(0.1),
            range: (0.001, 10.0),
            help: "largest strain of an edge: change of its length by its rest length; woven cloth locks at 3 % \
                   to 15 %",
        },
        Field {
            name: "compression",
            dimension: Dimension::None,
            default: Default::Absent,
            range: (0.0, 0.99),
            help: "largest compressive strain of an edge; no limit if it is left out",
        },
        Field {
            name: "sweeps",
            dimension: Dimension::None,
            default: Default::Number(100.0),
            range: (1.0, 1e5),
            help: "maximum number of iterations over the edges, twice a short time step; a long one takes up to 16 times as \
                   many; few are needed unless the load is carried over many rows of edges",
        },
    ],
    needs: &[Need::State],
    elements: "edges",
    maps: &[
        MapSpec::of("strain_limit", &["limit"]),
        MapSpec { varies: Some(has_compression), ..MapSpec::of("compression", &["compression"]) },
    ],
    report: Report {
        stages: &["B.2 strain limit", "B.8 strain limit"],
        counts: &["strain_limit_sweeps", "strain_over_limit"],
        ..Report::NONE
    },
    study: Study::INTERNAL,
    cost: Cost { bytes_of_point: 330.0, ..Cost::NONE },
    build,
    ..EffectSpec::BARE
};

/// Share of its length by which an edge that starts a step beyond the limit is brought back in it.
const RECOVERY: f64 = 0.02;

/// Sweeps between two looks at whether all edges keep the limit: on many ranks each look is an operation of all.
const SWEEPS_PER_LOOK: usize = 8;

/// Looks between two verdicts on whether sweeping is of use, and the share of the worst excess that may be left at a verdict of
/// what there was at the last one. What pins pull apart keeps no limit: impulses would only grow, and throw cloth sideways.
const LOOKS_PER_VERDICT: usize = 4;
const WORTHWHILE: f64 = 0.95;

/// Smallest share of a round's change that is tried where the whole makes edges longer on average, by the square.
const SHORTEST_WAY: f64 = 0.1;

/// Lengths that edges may have, by their rest lengths.
#[derive(Debug, Clone, Copy)]
struct Limits {
    longest: f64,
    shortest: f64,
}

/// The strain limit of one garment.
#[derive(Debug)]
struct StrainLimit {
    sweeps: usize,
    /// Edges of every own part.
    edges: Vec<PartEdges>,
    /// Number of edges of the garment at each local vertex.
    valence: Vec<f64>,
    /// Change of velocity of the local vertices [m/s].
    change: Vec<Vec3>,
    /// Largest excess over what is allowed in each own part, by rest length, and the sum of its squares.
    excess: Vec<f64>,
    squares: Vec<f64>,
}

/// Whether a garment has a number for the shortest that edges may be, which a map varies.
fn has_compression(description: &SceneDescription, garment: usize) -> bool {
    let mut own = description.effects.iter().filter(|e| e.effect == SPEC.name && e.garment == Some(garment));
    own.any(|e| e.settings.contains_key("compression"))
}

fn build(settings: &Settings, context: &BuildContext<'_>) -> Result<Effect, Problem> {
    let (scene, parts) = (context.scene, context.scene.parts());
    let Some(garment) = context.garment else {
        let advice = "move its table under a [[garment]]";
        return Err(Problem::scene("strain_limit", "this effect acts on one garment", advice));
    };
    let mesh = &scene.meshes()[garment];
    let first = parts.garment(garment).start;
    let ends: Vec<[usize; 2]> = mesh.edges().iter().map(|e| e.vertices.map(|v| first + v as usize)).collect();
    let mut valence = vec![0.0; parts.local_count()];
    ends.iter().flatten().for_each(|end| valence[*end] += 1.0);
    // Not all edges of a ghost are here.
    parts.halo().update(parts.ranks(), &mut valence);
    let (longest, painted) = (settings.number("limit"), scene.painted(garment, SPEC.name));
    let compression = settings.optional("compression");
    let limits = |edge: usize| {
        let ends = &mesh.edges()[edge].vertices;
        let longest = painted.map_or(longest, |map| map.mean(ends, longest));
        let shortening = compression.map(|share| scene.painted_mean(garment, "compression", ends, share));
        Limits { longest: 1.0 + longest, shortest: shortening.map_or(0.0, |share| (1.0 - share).max(0.0)) }
    };
    let edges = part_edges::of_parts(parts, mesh, &ends, limits);
    let limit = StrainLimit {
        sweeps: settings.number("sweeps") as usize
            * scene.description().solver.integrator.spec().strain_limit_sweep_factor,
        valence,
        change: vec![Vec3::zeros(); parts.local_count()],
        excess: vec![0.0; edges.len()],
        squares: vec![0.0; edges.len()],
        edges,
    };
    let elements = limit.edges.iter().map(PartEdges::counted).sum();
    Ok(Effect { bytes: limit.bytes(), elements, filters: vec![Box::new(limit)], ..Effect::default() })
}

impl StrainLimit {
    fn bytes(&self) -> usize {
        let of_vertices = self.change.len() * (size_of::<Vec3>() + size_of::<f64>());
        of_vertices + self.edges.iter().map(PartEdges::bytes).sum::<usize>()
    }
}

impl VelocityFilter for StrainLimit {
    fn stages(&self) -> [&'static str; 2] {
        ["B.2 strain limit", "B.8 strain limit"]
    }

    fn apply(&mut self, step: &FilterStep<'_>, v: &mut [Vec3], metrics: &mut Metrics) {
        let FilterStep { parts, x, dt, purpose, .. } = *step;
        let (mut sweeps, mut before, mut taken) = (0, f64::INFINITY, 0.0);
        loop {
            let (worst, squares) = self.begin(step, v);
            if squares > before && taken > SHORTEST_WAY {
                // Too far to be told from here: half of it back.
                taken *= 0.5;
                self.go(parts, -taken, v);
                continue;
            }
            if worst <= STRAIN_OVER_LIMIT || squares > WORTHWHILE * before || sweeps >= self.sweeps {
                break;
            }
            (before, taken) = (squares, 1.0);
            sweeps += self.solve(step, self.sweeps - sweeps);
            self.go(parts, taken, v);
        }
        metrics.count_once(parts.ranks(), "strain_limit_sweeps", sweeps as u64);
        if purpose == Purpose::Positions {
            let over = self.edges.iter().map(|edges| edges.over_limit(x, v, dt)).sum();
            metrics.count("strain_over_limit", over);
        }
    }
}

impl StrainLimit {
    /// Begins a round of sweeps. Returns the largest excess over what is allowed, by rest length, and the sum of its squares.
    fn begin(&mut self, step: &FilterStep<'_>, v: &mut [Vec3]) -> (f64, f64) {
        let parts = step.parts;
        parts.halo().update(parts.ranks(), v);
        let Self { edges, valence, excess, squares, .. } = self;
        let seen: &[Vec3] = v;
        parts.for_each((PerPart(edges), PerPart(excess), PerPart(squares)), &|_, (edges, excess, squares)| {
            (excess.0[0], squares.0[0]) = edges.0[0].begin(step, seen, valence);
        });
        let [squares] = parts.join_parts(&[&self.squares]);
        (self.worst(parts), squares)
    }

    /// Goes a share of the change that the sweeps found.
    fn go(&self, parts: &Parts, share: f64, v: &mut [Vec3]) {
        for (v, change) in v[parts.own()].iter_mut().zip(&self.change[parts.own()]) {
            *v += change * share;
        }
    }

    /// The largest excess of all ranks, by rest length.
    fn worst(&self, parts: &Parts) -> f64 {
        parts.ranks().max(largest(&self.excess))
    }

    /// Finds the change of velocity in no more than `most` sweeps; returns how many it took.
    fn solve(&mut self, step: &FilterStep<'_>, most: usize) -> usize {
        let parts = step.parts;
        let (mut momentum, mut sweeps, mut before) = (1.0_f64, 0, f64::INFINITY);
        while sweeps < most {
            self.gather(step, PartEdges::ahead);
            let next = 0.5 * (1.0 + (1.0 + 4.0 * momentum * momentum).sqrt());
            let ahead = (momentum - 1.0) / next;
            momentum = next;
            let Self { edges, change, excess, .. } = self;
            parts.for_each((PerPart(edges), PerPart(excess)), &|_, (edges, excess)| {
                excess.0[0] = edges.0[0].sweep(change, ahead);
            });
            sweeps += 1;
            if sweeps.is_multiple_of(SWEEPS_PER_LOOK) {
                let worst = self.worst(parts);
                let judges = sweeps.is_multiple_of(LOOKS_PER_VERDICT * SWEEPS_PER_LOOK);
                if worst <= STRAIN_OVER_LIMIT || (judges && worst > WORTHWHILE * before) {
                    break;
                }
                before = if judges { worst } else { before };
            }
        }
        self.gather(step, PartEdges::impulse);
        sweeps
    }

    /// The change of velocity by these impulses of the edges.
    fn gather(&mut self, step: &FilterStep<'_>, impulse: fn(&PartEdges, usize) -> f64) {
        let FilterStep { parts, mobility, .. } = *step;
        let Self { edges, change, .. } = self;
        parts.for_each((PerPart(edges), PerVertex(&mut change[parts.own()])), &|part, (edges, change)| {
            let range = parts.ranges()[part].clone();
            edges.0[0].add_up(range.start, impulse, change.0);
            for (change, mobility) in change.0.iter_mut().zip(&mobility[range]) {
                change.component_mul_assign(mobility);
            }
        });
        parts.halo().update(parts.ranks(), change);
    }
}
