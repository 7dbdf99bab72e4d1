//! Solves against a Cholesky factor of the whole matrix.

use nalgebra::{DMatrix, DVector};

use super::*;
use crate::block_matrix::testing::Sheet;
use crate::geometry::random::SplitMix64;
use crate::parallel::local_ranks::LocalRanks;
use crate::parallel::ranks::Ranks;

/// Constraints by numbers of the scene: every seventh vertex is held, every fifth slides along a plane, the others are free.
struct Constraints<'a> {
    parts: &'a Parts,
    what: What,
}

/// Which vertices are constrained.
#[derive(Debug, Clone, Copy, PartialEq)]
enum What {
    Nothing,
    Some,
    All,
}

impl What {
    fn project(self, vertex: u32, r: &mut Vec3) {
        let normal = Vec3::new(0.6, 0.0, 0.8);
        match self {
            Self::All => *r = Vec3::zeros(),
            Self::Some if vertex.is_multiple_of(7) => *r = Vec3::zeros(),
            Self::Some if vertex.is_multiple_of(5) => *r -= normal * normal.dot(r),
            _ => {}
        }
    }
}

impl Projection for Constraints<'_> {
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

/// The solution of a rank's own vertices; each local vertex has that of its owner.
fn solve(sheet: &Sheet, ranks: &Ranks, what: What) -> (Outcome, Vec<Vec3>) {
    let parts = sheet.parts(ranks);
    let matrix = sheet.matrix(&parts);
    let masses = Sheet::local(&parts, &sheet.masses);
    let mut cg = PreconditionedCg::new(&parts, &matrix, &Sheet::local(&parts, &sheet.x));
    let constraints = Constraints { parts: &parts, what };
    let system = BlockSystem { parts: &parts, masses: &masses, matrix: &matrix, constraints: &constraints };
    cg.prepare(&system);
    let b = Sheet::local(&parts, &impulses(sheet.x.len()));
    let mut d = vec![Vec3::repeat(f64::NAN); parts.local_count()];
    let outcome = cg.solve(&system, &b[parts.own()], &mut d, STOP);
    let copies = d.clone();
    parts.halo().update(ranks, &mut d);
    assert!(copies == d, "ghosts are those of their owners");
    (outcome, d[parts.own()].to_vec())
}

/// The solution within the constraints: `(P A P + 1 - P) d = P b`.
fn direct(sheet: &Sheet, what: What) -> Vec<Vec3> {
    let count = sheet.x.len();
    let mut p = DMatrix::<f64>::identity(3 * count, 3 * count);
    for vertex in 0..count {
        for axis in 0..3 {
            let mut column = Vec3::ith(axis, 1.0);
            what.project(vertex as u32, &mut column);
            p.fixed_view_mut::<3, 1>(3 * vertex, 3 * vertex + axis).copy_from(&column);
        }
    }
    let b = DVector::from_iterator(3 * count, impulses(count).into_iter().flat_map(|b| [b.x, b.y, b.z]));
    let system = &p * sheet.dense() * &p + DMatrix::identity(3 * count, 3 * count) - &p;
    let d = system.cholesky().expect("it is positive definite").solve(&(p * b));
    (0..count).map(|vertex| d.fixed_rows::<3>(3 * vertex).into()).collect()
}

#[test]
fn solutions_are_those_of_a_direct_solve_with_and_without_constraints() {
    for (parts, stiffness) in [(1, 3.0), (4, 300.0)] {
        let sheet = Sheet::new(10, stiffness, parts);
        for what in [What::Nothing, What::Some, What::All] {
            let (outcome, found) = solve(&sheet, &Ranks::default(), what);
            assert!(outcome.converged && outcome.finite && !outcome.worse, "{outcome:?}");
            let expected = direct(&sheet, what);
            let error = found.iter().zip(&expected).map(|(d, e)| (d - e).norm()).fold(0.0, f64::max);
            // The smallest eigenvalue is that of the masses, 0.5 kg: an error is at most a few residuals of all vertices.
            assert!(error < 100.0 * STOP.tolerance, "{what:?}: {error}");
        }
    }
}

#[test]
fn solutions_have_the_same_bits_on_any_number_of_ranks_and_threads() {
    let sheet = Sheet::new(12, 100.0, 7);
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
