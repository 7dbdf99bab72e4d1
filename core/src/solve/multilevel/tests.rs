//! Aggregates and coarse rows against what they stand for.

use nalgebra::{DMatrix, Matrix3};

use super::*;
use crate::Vec3;
use crate::block_matrix::testing::Sheet;
use crate::parallel::parts::Partition;
use crate::parallel::ranks::Ranks;
use crate::solve::block_system::{BlockSystem, Projection};
use crate::tolerances::CONSTRAINED_STIFFNESS;

/// Every third vertex slides along a plane, every fourth is held.
struct Constrained<'a>(&'a Parts);

fn p_of(vertex: usize) -> Matrix3<f64> {
    let normal = Vec3::new(0.0, 0.6, 0.8);
    match vertex {
        v if v.is_multiple_of(4) => Matrix3::zeros(),
        v if v.is_multiple_of(3) => Matrix3::identity() - normal * normal.transpose(),
        _ => Matrix3::identity(),
    }
}

impl Projection for Constrained<'_> {
    fn project(&self, part: usize, r: &mut [Vec3]) {
        self.0.ranges()[part].clone().zip(r).for_each(|(vertex, r)| *r = p_of(vertex) * *r);
    }
}

#[test]
fn runs_cover_everything_and_have_about_the_size_asked_for() {
    for count in [0, 1, 5, 12, 13, 100, 1000, 2047] {
        let ends = runs(count, 8);
        assert_eq!((ends[0], ends[ends.len() - 1]), (0, count as u32));
        let lengths = ends.windows(2).map(|run| run[1] - run[0]);
        assert!(lengths.clone().all(|length| (6..=12).contains(&length) || (count < 6 && length == count as u32)));
    }
}

#[test]
fn coarse_levels_are_the_matrix_of_vertices_that_move_as_one_where_constraints_let_them() {
    let sheet = Sheet::new(24, 30.0, 3);
    let parts = sheet.parts(&Ranks::default());
    let matrix = sheet.matrix(&parts);
    let levels = prepared(&sheet, &parts, &matrix);
    assert!(levels.levels.len() > 1);
    // Nodes of the vertices, level by level.
    let ends: Vec<Vec<u32>> = parts.ranges().iter().map(|range| runs(range.len(), AGGREGATE)).collect();
    let mut nodes = nodes_of_local_vertices(&parts, 0, &ends);
    let dense = sheet.dense();
    let own_blocks: Vec<Matrix3<f64>> = matrix.parts().iter().flat_map(|rows| rows.own_diagonal()).collect();
    for level in &levels.levels {
        let mut together = DMatrix::zeros(dense.nrows(), 3 * level.count());
        for (vertex, node) in nodes.iter().enumerate() {
            together.fixed_view_mut::<3, 3>(3 * vertex, 3 * *node as usize).copy_from(&p_of(vertex));
        }
        let mut expected = together.transpose() * &dense * together;
        for (vertex, (node, diagonal)) in nodes.iter().zip(&own_blocks).enumerate() {
            let mut view = expected.fixed_view_mut::<3, 3>(3 * *node as usize, 3 * *node as usize);
            view += (Matrix3::identity() - p_of(vertex)) * (CONSTRAINED_STIFFNESS * diagonal.trace());
        }
        // Blocks in single precision.
        assert!((level.dense() - &expected).amax() < 1e-6 * expected.amax());
        let aggregates = runs(level.count(), COARSER_AGGREGATE);
        nodes.iter_mut().for_each(|node| *node = aggregates.partition_point(|end| end <= node) as u32 - 1);
    }
}

/// The levels of a sheet with constraints.
fn prepared(sheet: &Sheet, parts: &Parts, matrix: &BlockMatrix) -> Multilevel {
    let mut constraints = Constraints::none(parts);
    let (masses, worked_on) = (&*sheet.masses, &*vec![true; parts.count()]);
    constraints.update(&BlockSystem { parts, masses, worked_on, matrix, constraints: &Constrained(parts) });
    let mut levels = Multilevel::new(parts, matrix);
    levels.prepare(parts, matrix, &PairTerms::default(), &constraints, &GhostDirections::default());
    levels
}

#[test]
fn the_cycle_is_symmetric_and_positive_definite() {
    for stiffness in [1.0, 1e5] {
        let sheet = Sheet::new(32, stiffness, 5);
        let parts = sheet.parts(&Ranks::default());
        let mut levels = prepared(&sheet, &parts, &sheet.matrix(&parts));
        assert!(levels.levels.len() > 1);
        let count = 3 * levels.levels[0].count();
        let mut of_all = DMatrix::zeros(count, count);
        for (column, mut out) in of_all.column_iter_mut().enumerate() {
            levels.levels[0].b.fill(Simd4::ZERO);
            levels.levels[0].b[column / 3] = Simd4::from(&Vec3::ith(column % 3, 1.0));
            cycle(&mut levels.levels, &mut levels.coarsest);
            for (node, x) in levels.levels[0].x.iter().enumerate() {
                out.fixed_rows_mut::<3>(3 * node).copy_from(&Vec3::from(*x));
            }
        }
        // Blocks in single precision.
        let asymmetry = (&of_all - of_all.transpose()).amax() / of_all.amax();
        assert!(asymmetry < 1e-5, "{stiffness}: {asymmetry}");
        let smallest = of_all.symmetric_eigenvalues().min();
        assert!(smallest > 0.01 / (10.0 + stiffness), "{stiffness}: {smallest}");
    }
}

#[test]
fn levels_of_a_part_with_one_vertex_work() {
    for side in [1, 2] {
        let sheet = Sheet::new(side, 1.0, 1);
        let parts = sheet.parts(&Ranks::default());
        let matrix = sheet.matrix(&parts);
        let mut levels = Multilevel::new(&parts, &matrix);
        levels.prepare(&parts, &matrix, &PairTerms::default(), &Constraints::none(&parts), &GhostDirections::default());
        levels.parts_mut()[0].restrict(&vec![Simd4::from(&Vec3::x()); parts.own().len()]);
        assert!(levels.solve(&parts, &vec![0.0; parts.block_count()], 0.0).0 > 0.0);
    }
}

#[test]
fn levels_of_no_vertices_work() {
    let parts = Parts::new(Ranks::default(), Partition::default(), vec![0, 0], Vec::new(), Vec::new());
    let matrix = BlockMatrix::new(&parts, &|_, _| {});
    let mut levels = Multilevel::new(&parts, &matrix);
    levels.prepare(&parts, &matrix, &PairTerms::default(), &Constraints::none(&parts), &GhostDirections::default());
    assert_eq!(levels.solve(&parts, &vec![0.0; parts.block_count()], 0.0), (0.0, 0.0));
}
