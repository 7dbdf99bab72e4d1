//! Solves against a Cholesky factor of the whole matrix, and what the preconditioner has to be.

use nalgebra::{DMatrix, DVector};

use super::*;
use crate::block_matrix::testing::Sheet;
use crate::contact::repulsion::pair_forces::{PairForce, PairHistory};
use crate::contact::topology::nodes::ContactNodes;
use crate::contact::topology::pair::{Pair, PairKind};
use crate::geometry::random::SplitMix64;
use crate::parallel::local_ranks::LocalRanks;
use crate::parallel::ranks::Ranks;

mod iterations_figure;

/// The system of a sheet on a rank, whose vertices are constrained by their numbers in the scene.
struct SheetSystem {
    parts: Parts,
    matrix: BlockMatrix,
    masses: Vec<f64>,
    worked_on: Vec<bool>,
    what: What,
}

impl SheetSystem {
    fn new(sheet: &Sheet, ranks: &Ranks, what: What) -> Self {
        let parts = sheet.parts(ranks);
        let (matrix, masses) = (sheet.matrix(&parts), Sheet::local(&parts, &sheet.masses));
        let worked_on = vec![true; parts.count()];
        Self { parts, matrix, masses, worked_on, what }
    }

    fn blocks(&self) -> BlockSystem<'_, Self> {
        let Self { parts, matrix, masses, worked_on, .. } = self;
        BlockSystem { parts, masses, worked_on, matrix, constraints: self }
    }

    /// A solver with the preconditioner of this system.
    fn solver(&self) -> PreconditionedCg {
        let mut cg = PreconditionedCg::new(&self.parts, &self.matrix);
        cg.prepare(&self.blocks());
        cg
    }

    /// Solves for what this right-hand side of all vertices says: the local vertices.
    fn solve(&self, cg: &mut PreconditionedCg, b: &[Vec3]) -> (Outcome, Vec<Vec3>) {
        let mut d = vec![Vec3::repeat(f64::NAN); self.parts.local_count()];
        let outcome = cg.solve(&self.blocks(), &Sheet::local(&self.parts, b)[self.parts.own()], &mut d, STOP);
        (outcome, d)
    }

    /// A rank's own vertices of these.
    fn own(&self, d: &[Vec3]) -> Vec<Vec3> {
        d[self.parts.own()].to_vec()
    }
}

/// Selection of the constrained vertices.
#[derive(Debug, Clone, Copy, PartialEq)]
enum What {
    Nothing,
    /// Every seventh is held, every fifth slides along a plane, the first forty are held all together.
    Some,
    All,
}

impl What {
    fn project(self, vertex: u32, r: &mut Vec3) {
        let normal = Vec3::new(0.6, 0.0, 0.8);
        match self {
            Self::All => *r = Vec3::zeros(),
            Self::Some if vertex.is_multiple_of(7) || vertex < 40 => *r = Vec3::zeros(),
            Self::Some if vertex.is_multiple_of(5) => *r -= normal * normal.dot(r),
            _ => {}
        }
    }
}

impl Projection for SheetSystem {
    fn project(&self, part: usize, r: &mut [Vec3]) {
        let range = self.parts.ranges()[part].clone();
        range.zip(r).for_each(|(local, r)| self.what.project(self.parts.number(local), r));
    }
}

const STOP: Stop = Stop { tolerance: 1e-9, max_iterations: 2000 };

/// Right-hand side of all vertices.
fn impulses(count: usize) -> Vec<Vec3> {
    let mut random = SplitMix64::new(5);
    (0..count).map(|_| random.vector()).collect()
}

/// The solution of a rank's own vertices; the preconditioner is that of another sheet and other constraints. Each local vertex
/// has the solution of its owner.
fn solve_with(other: (&Sheet, What), sheet: &Sheet, ranks: &Ranks, what: What, b: &[Vec3]) -> (Outcome, Vec<Vec3>) {
    let mut cg = SheetSystem::new(other.0, ranks, other.1).solver();
    let system = SheetSystem::new(sheet, ranks, what);
    let (outcome, mut d) = system.solve(&mut cg, b);
    let copies = d.clone();
    system.parts.halo().update(ranks, &mut d);
    assert!(copies == d || !outcome.finite, "ghosts are those of their owners");
    (outcome, system.own(&d))
}

/// The solution with the preconditioner that belongs to it.
fn solve(sheet: &Sheet, ranks: &Ranks, what: What) -> (Outcome, Vec<Vec3>) {
    solve_with((sheet, what), sheet, ranks, what, &impulses(sheet.x.len()))
}

/// Whether the part with this first vertex, a number of the scene, is solved for in [`solve_some`].
fn is_solved(first: u32) -> bool {
    !(first / 44).is_multiple_of(3)
}

/// The change of a rank's own vertices when some parts alone are solved for, with coarse levels that are those of all.
fn solve_some(sheet: &Sheet, ranks: &Ranks, what: What) -> (Outcome, Vec<Vec3>) {
    let mut system = SheetSystem::new(sheet, ranks, what);
    let mut cg = system.solver();
    let b = impulses(sheet.x.len());
    // What another solve leaves behind must not matter.
    let (outcome, _) = system.solve(&mut cg, &b);
    assert!(outcome.converged);
    let parts = &system.parts;
    system.worked_on = parts.ranges().iter().map(|range| is_solved(parts.number(range.start))).collect();
    cg.prepare_finest(&system.blocks());
    let (outcome, d) = system.solve(&mut cg, &b);
    (outcome, system.own(&d))
}

#[test]
fn parts_that_are_not_solved_for_stay_and_the_others_fit_them() {
    let sheet = Sheet::new(20, 100.0, 9);
    let (outcome, alone) = solve_some(&sheet, &Ranks::default(), What::Some);
    assert!(outcome.converged && !outcome.worse, "{outcome:?}");
    let parts = sheet.parts(&Ranks::default());
    let stays = |vertex: usize| !is_solved(parts.ranges()[parts.part_of(vertex)].start as u32);
    assert!((0..alone.len()).any(stays));
    assert!((0..alone.len()).filter(|vertex| stays(*vertex)).all(|vertex| alone[vertex] == Vec3::zeros()));
    let count = sheet.x.len();
    let mut p = projection(count, What::Some);
    (0..count).filter(|vertex| stays(*vertex)).for_each(|vertex| p.rows_mut(3 * vertex, 3).fill(0.0));
    let expected = direct_within(&sheet, &p);
    let error = alone.iter().zip(expected).map(|(d, e)| (d - e).norm()).fold(0.0, f64::max);
    assert!(error < 5e-5, "{error}");
    for ranks in [2, 3] {
        let shares =
            LocalRanks::run(ranks, 1, |communicator| solve_some(&sheet, &Ranks::new(communicator), What::Some).1);
        assert!(shares.expect("no rank ends early").concat() == alone, "{ranks} ranks");
    }
}

/// P of all vertices.
fn projection(count: usize, what: What) -> DMatrix<f64> {
    let mut p = DMatrix::<f64>::identity(3 * count, 3 * count);
    for vertex in 0..count {
        for axis in 0..3 {
            let mut column = Vec3::ith(axis, 1.0);
            what.project(vertex as u32, &mut column);
            p.fixed_view_mut::<3, 1>(3 * vertex, 3 * vertex + axis).copy_from(&column);
        }
    }
    p
}

/// The solution within the constraints: `(P A P + 1 - P) d = P b`.
fn direct(sheet: &Sheet, what: What) -> Vec<Vec3> {
    direct_within(sheet, &projection(sheet.x.len(), what))
}

/// The same for this P.
fn direct_within(sheet: &Sheet, p: &DMatrix<f64>) -> Vec<Vec3> {
    let count = sheet.x.len();
    let b = DVector::from_iterator(3 * count, impulses(count).into_iter().flat_map(|b| [b.x, b.y, b.z]));
    let system = p * sheet.dense() * p + DMatrix::identity(3 * count, 3 * count) - p;
    let d = system.cholesky().expect("it is positive definite").solve(&(p * b));
    (0..count).map(|vertex| d.fixed_rows::<3>(3 * vertex).into()).collect()
}

/// Fails unless the solution is the direct one. Blocks are rounded to single precision: an error of 6e-8, times 600 for what they
/// add up to by the mass, in solutions of a length of about 1.
fn assert_direct(found: &[Vec3], sheet: &Sheet, what: What) {
    let error = found.iter().zip(direct(sheet, what)).map(|(d, e)| (d - e).norm()).fold(0.0, f64::max);
    assert!(error < 5e-5, "{what:?}: {error}");
}

#[test]
fn solutions_are_those_of_a_direct_solve_with_and_without_constraints() {
    for (parts, stiffness) in [(1, 3.0), (4, 100.0)] {
        let sheet = Sheet::new(10, stiffness, parts);
        for what in [What::Nothing, What::Some, What::All] {
            let (outcome, found) = solve(&sheet, &Ranks::default(), what);
            assert!(outcome.converged && outcome.finite && !outcome.worse, "{outcome:?}");
            assert_direct(&found, &sheet, what);
        }
    }
}

#[test]
fn an_old_preconditioner_leads_to_the_same_solution() {
    let sheet = Sheet::new(10, 100.0, 4);
    for (stiffness, before, what) in [(5.0, What::Nothing, What::Some), (400.0, What::Some, What::Nothing)] {
        let old = (&Sheet::new(10, stiffness, 4), before);
        let (outcome, found) = solve_with(old, &sheet, &Ranks::default(), what, &impulses(sheet.x.len()));
        assert!(outcome.converged && !outcome.worse, "{outcome:?}");
        assert_direct(&found, &sheet, what);
    }
}

#[test]
fn solutions_have_the_same_bits_on_any_number_of_ranks_and_threads() {
    let sheet = Sheet::new(20, 100.0, 9);
    let (outcome, alone) = solve(&sheet, &Ranks::default(), What::Some);
    for ranks in [1, 2, 3, 5] {
        for threads in [1, 2] {
            let shares =
                LocalRanks::run(ranks, threads, |communicator| solve(&sheet, &Ranks::new(communicator), What::Some));
            let (outcomes, shares): (Vec<_>, Vec<_>) = shares.expect("no rank ends early").into_iter().unzip();
            assert!(outcomes.iter().all(|of_rank| *of_rank == outcome));
            assert!(shares.concat() == alone, "{ranks} ranks, {threads} threads");
        }
    }
}

/// `P W P` of the preconditioner W, column by column.
fn preconditioner(sheet: &Sheet, what: What) -> DMatrix<f64> {
    let of_sheet = SheetSystem::new(sheet, &Ranks::default(), what);
    let (mut cg, system) = (of_sheet.solver(), of_sheet.blocks());
    let count = sheet.x.len();
    let mut of_all = DMatrix::zeros(3 * count, 3 * count);
    for (column, mut out) in of_all.column_iter_mut().enumerate() {
        cg.r.fill(Simd4::ZERO);
        cg.r[column / 3] = Simd4::from(&Vec3::ith(column % 3, 1.0));
        cg.s.fill(Simd4::ZERO);
        cg.step(&system, 0.0);
        cg.direction(&system, 0.0, 0.0);
        for (vertex, s) in cg.s.iter().enumerate() {
            out.fixed_rows_mut::<3>(3 * vertex).copy_from(&Vec3::from(*s));
        }
    }
    of_all
}

#[test]
fn the_preconditioner_is_symmetric_and_positive_definite() {
    for what in [What::Nothing, What::Some] {
        for stiffness in [1.0, 1e6] {
            let sheet = Sheet::new(14, stiffness, 3);
            let of_all = preconditioner(&sheet, what);
            let asymmetry = (&of_all - of_all.transpose()).amax();
            // Blocks in single precision.
            assert!(asymmetry < 1e-6 * of_all.amax(), "{what:?}, {stiffness}: {asymmetry}");
            let count = of_all.nrows();
            let free = projection(count / 3, what);
            let definite = &of_all + DMatrix::identity(count, count) - free;
            let smallest = definite.symmetric_eigenvalues().min();
            // No less than diag(A)⁻¹ allows: rows add up to a few times the stiffness and the mass.
            assert!(smallest > 0.05 / (1.5 + stiffness), "{what:?}, {stiffness}: {smallest}");
        }
    }
}

/// Iterations of a sheet that is held here and there, to a residual as a step asks for.
fn iterations(side: usize, stiffness: f64, parts: usize) -> usize {
    let sheet = Sheet::new(side, stiffness, parts);
    let (outcome, _) = solve(&sheet, &Ranks::default(), What::Nothing);
    assert!(outcome.converged);
    outcome.iterations
}

#[test]
fn iterations_hardly_grow_with_stiffness_and_mesh() {
    // Without coarse levels they grow with the root of the stiffness, here tenfold.
    let [soft, stiff] = [100.0, 1e4].map(|stiffness| iterations(24, stiffness, 4));
    assert!(stiff < 2 * soft, "{soft} {stiff}");
    // The same cloth with edges half as long has four times the stiffness by mass: twice as many without coarse levels.
    let fine = iterations(48, 4e4, 12);
    assert!(2 * fine < 3 * stiff, "{stiff} {fine}");
}

#[test]
fn a_newton_step_goes_as_far_as_its_forcing_says_and_small_corrections_to_their_end() {
    let sheet = Sheet::new(12, 1e4, 2);
    let system = SheetSystem::new(&sheet, &Ranks::default(), What::Some);
    let (parts, d, mut cg) = (&system.parts, direct(&sheet, What::Some), system.solver());
    let b = Sheet::local(parts, &impulses(sheet.x.len()));
    let mut step = |forcing: &mut Forcing| {
        let mut found = vec![Vec3::zeros(); parts.local_count()];
        let outcome = cg.newton_step(&system.blocks(), &b[parts.own()], &mut found, STOP, forcing);
        assert!(outcome.converged);
        let error = DVector::from_iterator(
            3 * d.len(),
            found.iter().enumerate().flat_map(|(i, found)| {
                let off = found - d[parts.number(i) as usize];
                [off.x, off.y, off.z]
            }),
        );
        (outcome.iterations, error.norm())
    };
    let length = d.iter().map(Vec3::norm_squared).sum::<f64>().sqrt();
    let (all, exact) = step(&mut Forcing::new(f64::INFINITY));
    assert!(exact < 1e-4 * length, "{exact} of {length}");
    let mut forcing = Forcing::new(0.0);
    let (some, rough) = step(&mut forcing);
    assert!(2 * some < all && rough > 10.0 * exact && rough < 0.5 * length, "{some} of {all}: {rough} of {length}");
    // The error is as large as before: the method has not converged, so the next step goes no farther.
    assert_eq!(step(&mut forcing), (some, rough));
    // After one with a hundred times the error it has to leave 0.9 times a hundredth of a hundredth.
    forcing.before = forcing.before.map(|error| 1e4 * error);
    let (more, fine) = step(&mut forcing);
    assert!(some < more && more < all && fine < 0.1 * rough, "{more} of {all}: {fine} after {rough}");
}

#[test]
fn what_has_neither_mass_nor_neighbours_is_held_and_disturbs_nothing() {
    let mut sheet = Sheet::new(10, 30.0, 2);
    let alone: Vec<usize> = sheet.lonely().to_vec();
    alone.iter().for_each(|vertex| sheet.masses[*vertex] = 0.0);
    let mut b = impulses(sheet.x.len());
    alone.iter().for_each(|vertex| b[*vertex] = Vec3::x());
    let (outcome, found) = solve_with((&sheet, What::Nothing), &sheet, &Ranks::default(), What::Nothing, &b);
    assert!(outcome.converged && outcome.finite);
    assert!(alone.iter().all(|vertex| found[*vertex] == Vec3::zeros()));
    assert!(found.iter().all(|d| d.iter().all(|component| component.is_finite())));
}

#[test]
fn what_is_no_number_is_told_and_a_limit_of_iterations_is_kept() {
    let sheet = Sheet::new(10, 30.0, 2);
    let of_sheet = SheetSystem::new(&sheet, &Ranks::default(), What::Nothing);
    let (mut cg, system) = (of_sheet.solver(), of_sheet.blocks());
    let mut b = impulses(sheet.x.len());
    let mut d = vec![Vec3::zeros(); sheet.x.len()];
    let few = cg.solve(&system, &b, &mut d, Stop { max_iterations: 3, ..STOP });
    assert_eq!(few, Outcome { solves: 1, iterations: 3, converged: false, finite: true, worse: false });
    b[17].y = f64::NAN;
    let broken = cg.solve(&system, &b, &mut d, STOP);
    assert!(!broken.finite && !broken.converged, "{broken:?}");
    // Nothing of it is left.
    b[17].y = 0.0;
    let again = cg.solve(&system, &b, &mut d, STOP);
    assert!(again.converged && d.iter().all(|d| d.norm().is_finite()));
    // Nothing to be done takes no iteration.
    let nothing = cg.solve(&system, &vec![Vec3::zeros(); sheet.x.len()], &mut d, STOP);
    assert_eq!(nothing, Outcome { solves: 1, iterations: 0, converged: true, finite: true, worse: false });
}

/// Contacts between vertices of a sheet that no element joins: by their numbers in the scene, with two points of a body behind them.
fn pairs_of(count: usize) -> Vec<PairForce> {
    let mut random = SplitMix64::new(11);
    let mut number = |below: usize| ((random.signed() + 1.0) * 0.5 * below as f64) as u32;
    let corners: Vec<[u32; 4]> = (0..60).map(|_| [0; 4].map(|_| number(count))).collect();
    let mut random = SplitMix64::new(12);
    let distinct = corners.into_iter().filter(|nodes| (1..4).all(|i| !nodes[..i].contains(&nodes[i])));
    let of_pair = |(place, mut nodes): (usize, [u32; 4])| {
        let share = 0.5 + 0.4 * random.signed();
        let weights = [1.0, -share, -0.7 * (1.0 - share), -0.3 * (1.0 - share)];
        if place % 3 == 0 {
            // Behind all cloth.
            nodes[1..].copy_from_slice(&[count as u32, count as u32 + 1, count as u32 + 2]);
        }
        let normal = random.vector().normalize();
        PairForce {
            pair: Pair { kind: PairKind::EdgeEdge, nodes },
            nodes,
            weights,
            normal,
            distance: 0.0,
            thickness: 1e-3,
            force: Vec3::zeros(),
            push: 0.0,
            history: PairHistory::NONE,
            stiffness: 40.0,
            damping: [3.0, 1.0 + 0.5 * random.signed()],
            last_change: 0.0,
        }
    };
    distinct.enumerate().map(of_pair).collect()
}

/// Force factor and α, which weigh the stiffness and damping of pairs in the systems of these tests.
const PAIR_FACTORS: [f64; 2] = [2.0, 0.5];

/// The terms of a rank's own vertices.
fn set_pairs(cg: &mut PreconditionedCg, parts: &Parts, sheet: &Sheet) {
    let own = parts.own();
    let starts: Vec<u32> = parts.rank_starts().to_vec();
    let count = sheet.x.len() as u32;
    let owned = starts[parts.ranks().rank()]..starts[parts.ranks().rank() + 1];
    let held: Vec<PairForce> =
        pairs_of(sheet.x.len()).into_iter().filter(|pair| pair.nodes.iter().any(|node| owned.contains(node))).collect();
    let mut ghosts: Vec<u32> =
        held.iter().flat_map(|pair| pair.nodes).filter(|node| *node < count && !owned.contains(node)).collect();
    ghosts.sort_unstable();
    ghosts.dedup();
    let nodes = ContactNodes::new(parts.ranks(), &starts, ghosts, 3);
    let local = |number: u32| nodes.local(number).expect("it is own, a ghost or of a body");
    let held: Vec<PairForce> =
        held.into_iter().map(|pair| PairForce { nodes: pair.nodes.map(local), ..pair }).collect();
    assert_eq!(nodes.own().len(), own.len());
    cg.pairs_mut().set(parts, &nodes, &held, PAIR_FACTORS);
}

/// A with the pairs.
fn dense_with_pairs(sheet: &Sheet) -> DMatrix<f64> {
    let mut dense = sheet.dense();
    let [factor, alpha] = PAIR_FACTORS;
    for pair in pairs_of(sheet.x.len()) {
        let n = pair.normal * pair.normal.transpose();
        let along = alpha * pair.damping[0] + alpha * alpha * pair.stiffness;
        let block = (n * along + (nalgebra::Matrix3::identity() - n) * (alpha * pair.damping[1])) * factor;
        for (a, of_a) in pair.nodes.iter().zip(pair.weights) {
            for (b, of_b) in pair.nodes.iter().zip(pair.weights) {
                if (*a.max(b) as usize) < sheet.x.len() {
                    let mut view = dense.fixed_view_mut::<3, 3>(3 * *a as usize, 3 * *b as usize);
                    view += block * (of_a * of_b);
                }
            }
        }
    }
    dense
}

/// The solution with pairs of a rank's own vertices, and iterations.
fn solve_with_pairs(sheet: &Sheet, ranks: &Ranks, what: What) -> (Outcome, Vec<Vec3>) {
    let system = SheetSystem::new(sheet, ranks, what);
    // Twice, and without between: levels with couplings of pairs come and go.
    let mut cg = system.solver();
    set_pairs(&mut cg, &system.parts, sheet);
    cg.prepare(&system.blocks());
    let (outcome, d) = system.solve(&mut cg, &impulses(sheet.x.len()));
    (outcome, system.own(&d))
}

#[test]
fn solutions_with_pairs_in_touch_are_those_of_a_direct_solve() {
    for what in [What::Nothing, What::Some] {
        let sheet = Sheet::new(10, 30.0, 4);
        let (outcome, found) = solve_with_pairs(&sheet, &Ranks::default(), what);
        assert!(outcome.converged && !outcome.worse, "{outcome:?}");
        let count = sheet.x.len();
        let p = projection(count, what);
        let b = DVector::from_iterator(3 * count, impulses(count).into_iter().flat_map(|b| [b.x, b.y, b.z]));
        let system = &p * dense_with_pairs(&sheet) * &p + DMatrix::identity(3 * count, 3 * count) - &p;
        let expected = system.cholesky().expect("it is positive definite").solve(&(p * b));
        let error = (0..count).map(|vertex| (found[vertex] - expected.fixed_rows::<3>(3 * vertex)).norm());
        let error = error.fold(0.0, f64::max);
        assert!(error < 5e-5, "{what:?}: {error}");
    }
}

#[test]
fn solutions_with_pairs_in_touch_are_the_same_bits_on_any_number_of_ranks() {
    let sheet = Sheet::new(16, 30.0, 7);
    let (alone, expected) = solve_with_pairs(&sheet, &Ranks::default(), What::Some);
    for count in [2, 3, 7] {
        let shares =
            LocalRanks::run(count, 1, |communicator| solve_with_pairs(&sheet, &Ranks::new(communicator), What::Some));
        let found = shares.expect("no rank ends early");
        assert!(found.iter().all(|(outcome, _)| outcome.iterations == alone.iterations));
        let together: Vec<Vec3> = found.into_iter().flat_map(|(_, own)| own).collect();
        assert!(together == expected, "{count} ranks");
    }
}

#[test]
fn an_iteration_waits_twice_for_other_ranks() {
    let sheet = Sheet::new(16, 30.0, 7);
    let of_rank = |ranks: &Ranks| {
        let system = SheetSystem::new(&sheet, ranks, What::Some);
        let mut cg = system.solver();
        set_pairs(&mut cg, &system.parts, &sheet);
        cg.prepare(&system.blocks());
        let before = ranks.sent();
        let (outcome, _) = system.solve(&mut cg, &impulses(sheet.x.len()));
        let after = ranks.sent();
        // One step more than there are products; its exchange goes while its sums are joined.
        assert_eq!(after.collectives - before.collectives, 2 * outcome.iterations as u64 + 1);
        assert_eq!(after.exchanges - before.exchanges, outcome.iterations as u64 + 1);
    };
    LocalRanks::run(3, 1, |communicator| of_rank(&Ranks::new(communicator))).expect("no rank ends early");
}
