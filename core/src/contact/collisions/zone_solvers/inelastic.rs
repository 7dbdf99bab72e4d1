//! A zone whose contacts stop closing, and that is otherwise left alone.
//!
//! D. Harmon, E. Vouga, R. Tamstorf, E. Grinspun: "Robust treatment of simultaneous collisions" (SIGGRAPH 2008),
//! with inequalities: among all velocities that satisfy every contact, those nearest to the present ones, measured
//! by mass. Their impulses λ solve
//!
//! ```text
//! min ½ λᵀ A M A' λ + λᵀ r(v),   λ ≥ 0,      v' = v + M A' λ,   r(v) = A v − targets
//! ```
//!
//! A row of A is the weights of a contact times its normal, A' its transpose, M the inverse masses. The matrix is
//! never made: a product is a sweep over the contacts. Contacts repeat and depend on each other, so it is singular,
//! and the impulses are not unique; the velocities are. Sweeps of projected Gauss-Seidel find which contacts push,
//! conjugate gradients solve among these (as in J. Morales, J. Nocedal, M. Smelyanskiy, Numerische Mathematik 111,
//! 2008). Neither ever raises the objective, which for targets of zero is the change of the kinetic energy: it
//! starts at zero and ends below.

use crate::Vec3;
use crate::contact::collisions::impulse::{Constraint, apply_impulse, normal_velocity, response};
use crate::contact::tolerances::{ZONE_FLAT, ZONE_RESIDUAL};

/// Sweeps, there and back, between two solves among the pushing contacts.
const SWEEPS: usize = 2;

/// Passes over all contacts after which a zone is given up, at most. A stack of four hundred layers takes half as many,
/// ten thousand contacts in a heap three hundred.
const MAX_PASSES: usize = 5000;

/// The same for small zones, with [`PASSES_A_CONTACT`] more for each contact. Zones that need more hold contacts that nearly
/// contradict each other, and are sooner made rigid than solved (`docs/dev/decisions/0037-heaps.md`).
const FEWEST_PASSES: usize = 200;

/// See [`FEWEST_PASSES`].
const PASSES_A_CONTACT: usize = 10;

/// Rounds of sweeps and a solve in which the error has to halve: contradicting contacts, as between two prescribed
/// surfaces that close, never get better.
const PATIENCE: usize = 8;

/// Share of its first residual down to which the solve among pushing contacts goes: which contacts push may change yet.
const FACE_REDUCTION: f64 = 0.1;

/// Roundings that enter a relative velocity.
const ROUNDINGS: f64 = 32.0;

/// Outcome of the solve of a zone.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Outcome {
    /// Largest shortfall of a relative normal velocity below its target [m/s]; zero if there is none.
    pub residual: f64,
    /// Passes over the contacts.
    pub iterations: usize,
    /// Whether all contacts reach their targets, and none pushes that separates.
    pub converged: bool,
}

/// Changes the velocities `v` [m/s] as little as possible, measured by mass, such that the relative normal velocity
/// of every constraint reaches its target [m/s]; `mobility` holds the inverse masses per axis [1/kg].
///
/// Impulses only push, so a contact that separates is not held; tangential velocities change only as momentum
/// demands. Linear momentum is kept, and angular momentum as far as the weights and normals of each constraint keep
/// it. Constraints that no impulse can change are left out, and count in the residual. Only nodes named in
/// constraints are touched. Where the constraints contradict each other the result is the best impulses found, and
/// not `converged`.
pub(crate) fn inelastic(constraints: &[Constraint], targets: &[f64], mobility: &[Vec3], v: &mut [Vec3]) -> Outcome {
    let mut zone = Zone::new(constraints, targets, mobility, v);
    let (iterations, error_is_small) = zone.solve();
    for (node, change) in zone.nodes.iter().zip(zone.total_change()) {
        v[*node as usize] += change;
    }
    let shortfall = |(c, target): (&Constraint, &f64)| (target - normal_velocity(c, v)).max(0.0);
    let residual = constraints.iter().zip(targets).map(shortfall).fold(0.0, f64::max);
    Outcome { residual, iterations, converged: error_is_small && residual <= zone.tolerance }
}

/// One contact of a zone, with nodes numbered within the zone.
struct Row {
    constraint: Constraint,
    target: f64,
    response: f64,
    /// Impulse along the normal [N s], never negative.
    impulse: f64,
}

/// Rows, and the nodes they name, gathered.
struct Zone {
    rows: Vec<Row>,
    nodes: Vec<u32>,
    mobility: Vec<Vec3>,
    v: Vec<Vec3>,
    /// Largest error of a relative velocity that counts as none [m/s].
    tolerance: f64,
}

impl Zone {
    fn new(constraints: &[Constraint], targets: &[f64], mobility: &[Vec3], v: &[Vec3]) -> Self {
        let mut nodes: Vec<u32> = constraints.iter().flat_map(|c| c.nodes).collect();
        nodes.sort_unstable();
        nodes.dedup();
        let mut rows = Vec::with_capacity(constraints.len());
        let mut largest = 0.0_f64;
        for (constraint, &target) in constraints.iter().zip(targets) {
            largest = largest.max((normal_velocity(constraint, v) - target).abs());
            let response = response(constraint, mobility);
            if response > 0.0 {
                // Every node of a constraint is in the list, which holds nothing else.
                let nodes = constraint.nodes.map(|q| nodes.partition_point(|&node| node < q) as u32);
                rows.push(Row { constraint: Constraint { nodes, ..*constraint }, target, response, impulse: 0.0 });
            }
        }
        let mobility: Vec<Vec3> = nodes.iter().map(|&q| mobility[q as usize]).collect();
        let v: Vec<Vec3> = nodes.iter().map(|&q| v[q as usize]).collect();
        let fastest = v.iter().map(|v| v.amax()).fold(0.0, f64::max);
        let tolerance = (ZONE_RESIDUAL * largest).max(ROUNDINGS * f64::EPSILON * fastest);
        Self { rows, nodes, mobility, v, tolerance }
    }

    /// Finds the impulses. Returns the number of passes, and whether the error fell below the tolerance.
    fn solve(&mut self) -> (usize, bool) {
        let mut scratch = Scratch::default();
        let (mut passes, mut best, mut waited) = (0, f64::INFINITY, 0);
        let most = (FEWEST_PASSES + PASSES_A_CONTACT * self.rows.len()).min(MAX_PASSES);
        while passes < most && waited < PATIENCE {
            let error = self.error();
            if error <= self.tolerance {
                return (passes, true);
            }
            if error <= 0.5 * best {
                (best, waited) = (error, 0);
            }
            waited += 1;
            for _ in 0..SWEEPS {
                self.sweep();
            }
            passes += 2 * SWEEPS + scratch.conjugate_gradients(self);
            self.step_to_bounds(&mut scratch);
        }
        (passes, false)
    }

    /// Relative normal velocity above the target [m/s].
    fn excess(&self, row: &Row) -> f64 {
        normal_velocity(&row.constraint, &self.v) - row.target
    }

    /// Largest shortfall, or velocity of a contact that pushes though it separates [m/s].
    fn error(&self) -> f64 {
        let error = |row: &Row| self.excess(row).min(row.impulse * row.response).abs();
        self.rows.iter().map(error).fold(0.0, f64::max)
    }

    /// Projected Gauss-Seidel, forwards and back.
    fn sweep(&mut self) {
        let count = self.rows.len();
        for i in (0..count).chain((0..count).rev()) {
            let excess = self.excess(&self.rows[i]);
            let row = &mut self.rows[i];
            let impulse = (row.impulse - excess / row.response).max(0.0);
            let change = row.constraint.normal * (impulse - row.impulse);
            row.impulse = impulse;
            apply_impulse(&row.constraint, &self.mobility, &mut self.v, &change);
        }
    }

    /// Velocities that impulses along the normals of the rows give [m/s].
    fn velocities_of(&self, impulses: &[(usize, f64)], change: &mut Vec<Vec3>) {
        change.clear();
        change.resize(self.nodes.len(), Vec3::zeros());
        for &(i, impulse) in impulses {
            let constraint = &self.rows[i].constraint;
            apply_impulse(constraint, &self.mobility, change, &(constraint.normal * impulse));
        }
    }

    /// The change from the first velocities, summed anew so that no rounding of the iterations is left in it.
    fn total_change(&self) -> Vec<Vec3> {
        let impulses: Vec<_> = self.rows.iter().map(|row| row.impulse).enumerate().collect();
        let mut change = Vec::new();
        self.velocities_of(&impulses, &mut change);
        change
    }

    /// Takes the step with all impulses that would become negative set to zero, or so much of it as lowers the
    /// objective: half, a quarter, and at last the part before the first impulse becomes zero, which always does.
    fn step_to_bounds(&mut self, scratch: &mut Scratch) {
        let Scratch { step, taken, change, .. } = scratch;
        let fraction_to_bound = |&(i, d): &(usize, f64)| if d < 0.0 { -self.rows[i].impulse / d } else { 1.0 };
        let inside = step.iter().map(fraction_to_bound).fold(1.0, f64::min);
        let mut fraction = 1.0;
        loop {
            taken.clear();
            taken.extend(step.iter().map(|&(i, d)| (i, (fraction * d).max(-self.rows[i].impulse))));
            self.velocities_of(taken, change);
            let rise = |&(i, d): &(usize, f64)| {
                d * (self.excess(&self.rows[i]) + 0.5 * normal_velocity(&self.rows[i].constraint, change))
            };
            if fraction <= inside || taken.iter().map(rise).sum::<f64>() < 0.0 {
                break;
            }
            fraction = (0.5 * fraction).max(inside);
        }
        for &(i, d) in taken.iter() {
            let impulse = self.rows[i].impulse + d;
            // The one that bounds the step has to end at zero exactly, or it would bound the next one too.
            self.rows[i].impulse = if impulse <= f64::EPSILON * d.abs() { 0.0 } else { impulse };
        }
        for (v, change) in self.v.iter_mut().zip(change.iter()) {
            *v += change;
        }
    }
}

/// Vectors of conjugate gradients over the contacts that push.
#[derive(Default)]
struct Scratch {
    /// Row and change of its impulse so far [N s].
    step: Vec<(usize, f64)>,
    /// The part of it that is taken [N s].
    taken: Vec<(usize, f64)>,
    /// Row and direction of search [N s].
    direction: Vec<(usize, f64)>,
    /// Excess of each of these rows after the step [m/s].
    gradient: Vec<f64>,
    /// Velocities that the direction gives to the nodes [m/s].
    change: Vec<Vec3>,
}

impl Scratch {
    /// Finds the step after which the pushing contacts of the zone neither close nor part, scaled by the responses
    /// and whatever the signs of the impulses then are. Returns the number of passes.
    fn conjugate_gradients(&mut self, zone: &Zone) -> usize {
        self.step.clear();
        self.direction.clear();
        self.gradient.clear();
        for (i, row) in zone.rows.iter().enumerate().filter(|(_, row)| row.impulse > 0.0) {
            let excess = zone.excess(row);
            self.step.push((i, 0.0));
            self.direction.push((i, -excess / row.response));
            self.gradient.push(excess);
        }
        let enough = (FACE_REDUCTION * self.largest_gradient()).max(0.1 * zone.tolerance);
        let mut slope = self.slope(zone);
        let mut passes = 1;
        while self.largest_gradient() > enough && passes < MAX_PASSES {
            passes += 1;
            zone.velocities_of(&self.direction, &mut self.change);
            let (mut curvature, mut size) = (0.0, 0.0);
            for &(i, p) in &self.direction {
                curvature += p * normal_velocity(&zone.rows[i].constraint, &self.change);
                size += p * p * zone.rows[i].response;
            }
            // Impulses that cancel each other change no velocity: where they still have a gradient, contacts
            // contradict.
            if curvature <= ZONE_FLAT * size {
                break;
            }
            self.advance(zone, slope / curvature);
            let last = std::mem::replace(&mut slope, self.slope(zone));
            for ((i, p), gradient) in self.direction.iter_mut().zip(&self.gradient) {
                *p = *p * (slope / last) - gradient / zone.rows[*i].response;
            }
        }
        passes
    }

    /// Goes `length` directions further.
    fn advance(&mut self, zone: &Zone, length: f64) {
        for (((i, p), (_, step)), gradient) in self.direction.iter().zip(&mut self.step).zip(&mut self.gradient) {
            *step += length * p;
            *gradient += length * normal_velocity(&zone.rows[*i].constraint, &self.change);
        }
    }

    /// Gradient times scaled gradient [J].
    fn slope(&self, zone: &Zone) -> f64 {
        self.direction.iter().zip(&self.gradient).map(|((i, _), g)| g * g / zone.rows[*i].response).sum()
    }

    fn largest_gradient(&self) -> f64 {
        self.gradient.iter().fold(0.0, |largest, g| g.abs().max(largest))
    }
}
