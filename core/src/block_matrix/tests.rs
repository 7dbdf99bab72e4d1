//! The matrix against one that is assembled element by element without any of its tricks.

use nalgebra::DVector;

use super::testing::Sheet;
use super::*;
use crate::geometry::random::SplitMix64;
use crate::parallel::for_each_part::PerVertex;
use crate::parallel::local_ranks::LocalRanks;
use crate::parallel::ranks::Ranks;

fn random_vectors(count: usize) -> Vec<Vec3> {
    let mut random = SplitMix64::new(11);
    (0..count).map(|_| random.vector()).collect()
}

/// The product of all rows, by scene numbers.
fn product(sheet: &Sheet, ranks: &Ranks, s: &[Vec3]) -> Vec<(u32, Vec3)> {
    let parts = sheet.parts(ranks);
    let matrix = sheet.matrix(&parts);
    let s = Sheet::local(&parts, s);
    let mut q = vec![Vec3::zeros(); parts.own().len()];
    parts.for_each(PerVertex(&mut q), &|part, q| matrix.parts()[part].multiply(&s, q.0));
    parts.own().map(|local| parts.number(local)).zip(q).collect()
}

#[test]
fn the_product_is_that_of_the_matrix_of_all_elements() {
    for parts in [1, 3] {
        let sheet = Sheet::new(9, 50.0, parts);
        let s = random_vectors(sheet.x.len());
        let expected = sheet.dense() * DVector::from_iterator(3 * s.len(), s.iter().flat_map(|s| [s.x, s.y, s.z]));
        for (vertex, q) in product(&sheet, &Ranks::default(), &s) {
            let expected = expected.fixed_rows::<3>(3 * vertex as usize);
            assert!((q - expected).norm() < BLOCK_ERROR, "{vertex}: {q} {expected}");
        }
    }
}

/// Rounding of single precision, of a row whose blocks add up to 500 in a few sums each.
const BLOCK_ERROR: f64 = 500.0 * 2.0 * f32::EPSILON as f64;

#[test]
fn a_translation_feels_the_diagonal_alone_to_the_last_bit() {
    let sheet = Sheet::new(9, 1e9, 3);
    let translation = Vec3::new(0.7, -1.3, 0.2);
    let moved = product(&sheet, &Ranks::default(), &vec![translation; sheet.x.len()]);
    let free = product(&Sheet::new(9, 0.0, 3), &Ranks::default(), &vec![translation; sheet.x.len()]);
    assert!(moved == free);
    let starts: Vec<usize> = sheet.parts(&Ranks::default()).ranges().iter().map(|range| range.start).collect();
    let has_drag =
        |vertex: usize| starts.iter().rfind(|start| **start <= vertex).is_some_and(|s| (vertex - s).is_multiple_of(3));
    let masses = moved.iter().filter(|(vertex, _)| !has_drag(*vertex as usize));
    assert!(masses.clone().count() > 50);
    masses.for_each(|(vertex, q)| assert_eq!(*q, translation * sheet.masses[*vertex as usize]));
}

#[test]
fn diagonal_blocks_are_those_of_the_matrix_of_all_elements() {
    let sheet = Sheet::new(9, 50.0, 3);
    let (dense, parts) = (sheet.dense(), sheet.parts(&Ranks::default()));
    let matrix = sheet.matrix(&parts);
    for (range, rows) in parts.ranges().iter().zip(matrix.parts()) {
        for (vertex, block) in range.clone().zip(rows.diagonal_blocks()) {
            let expected = dense.fixed_view::<3, 3>(3 * vertex, 3 * vertex);
            assert!((block - expected).norm() < BLOCK_ERROR, "{vertex}");
        }
    }
}

#[test]
fn blocks_across_a_border_are_transposed_to_the_last_bit() {
    let sheet = Sheet::new(9, 50.0, 3);
    let parts = sheet.parts(&Ranks::default());
    let matrix = sheet.matrix(&parts);
    let mut blocks = Vec::new();
    for (range, rows) in parts.ranges().iter().zip(matrix.parts()) {
        let pairs = rows.outside_pairs().iter().map(|(vertex, other)| (range.start as u32 + vertex, *other));
        blocks.extend(pairs.zip(rows.outside_blocks()));
    }
    assert!(blocks.len() > 60);
    for ((a, b), block) in &blocks {
        let other = blocks.iter().find(|(pair, _)| *pair == (*b, *a)).map(|(_, block)| block.transpose());
        assert_eq!(other, Some(*block), "{a}, {b}");
    }
}

#[test]
fn products_have_the_same_bits_on_any_number_of_ranks() {
    let sheet = Sheet::new(12, 300.0, 7);
    let s = random_vectors(sheet.x.len());
    let alone = product(&sheet, &Ranks::default(), &s);
    for ranks in [2, 3, 5] {
        let shares = LocalRanks::run(ranks, 2, |communicator| product(&sheet, &Ranks::new(communicator), &s));
        assert!(shares.expect("no rank ends early").concat() == alone, "{ranks} ranks");
    }
}

#[test]
fn what_is_added_for_pairs_of_other_parts_is_not_seen() {
    let sheet = Sheet::new(6, 1.0, 2);
    let parts = sheet.parts(&Ranks::default());
    let mut matrix = sheet.matrix(&parts);
    let s = random_vectors(sheet.x.len());
    let mut before = vec![Vec3::zeros(); parts.ranges()[0].len()];
    matrix.parts()[0].multiply(&s, &mut before);
    let rows = &mut matrix.parts_mut()[0];
    let beyond = parts.ranges()[1].start as u32;
    rows.add_coupling(rows.slot(beyond, beyond + 1), &Matrix3::repeat(1e6));
    let mut after = before.clone();
    matrix.parts()[0].multiply(&s, &mut after);
    assert!(before == after);
    matrix.parts_mut()[0].clear();
    matrix.parts()[0].multiply(&s, &mut after);
    assert!(after.iter().all(|q| *q == Vec3::zeros()));
}
