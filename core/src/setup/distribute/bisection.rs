//! The order of a garment's vertices: recursive bisection of the rest positions along the longest side of their bounds, ties by
//! vertex number, on any distribution of the positions over ranks.
//!
//! Sizes of the halves depend on the number of vertices alone, so each rank knows which places of the order will be
//! its own before anything is compared. Pieces that lie across a border of ranks are halved where their vertices are:
//! bounds are compared, and the vertex in the middle is found digit by digit of its key, by counting. At most one
//! piece lies across a border. The others are sent to their rank, which halves them by itself.

use std::ops::Range;

use bytemuck::{Pod, Zeroable};

use crate::Vec3;
use crate::parallel::ranks::Ranks;

/// Number of vertices at which the bisection stops ordering.
const LEAF_SIZE: usize = 8;

/// Bits of a digit of a key, and of all of them.
const DIGIT: u32 = 4;
const KEY: u32 = u64::BITS + u32::BITS;
const DIGITS: usize = 1 << DIGIT;

/// A vertex on its way.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct PlacedVertex {
    /// Rest position [m].
    position: Vec3,
    /// Number in the garment.
    vertex: u32,
    /// Number of the piece that it belongs to, once all pieces are whole.
    piece: u32,
}

/// Vertices that take these places of the order; each rank has some of them.
struct Piece {
    places: Range<usize>,
    rows: Vec<PlacedVertex>,
}

/// The vertices that take this rank's places among those of a garment, in their order, with their rest positions [m].
///
/// `places` are those of the garment, and `starts` the first of every rank, with the number of all at the end. `points` are the
/// rest positions of some vertices, of which this rank has the first number `first`; all ranks together have all, and call it
/// together.
pub(crate) fn order(
    ranks: &Ranks,
    places: Range<usize>,
    starts: &[u32],
    first: usize,
    points: &[Vec3],
) -> (Vec<u32>, Vec<Vec3>) {
    let row = |(position, vertex): (&Vec3, u32)| PlacedVertex { position: *position, vertex, piece: 0 };
    let rows = points.iter().zip(first as u32..).map(row).collect();
    let mut open = vec![Piece { places, rows }];
    let mut whole: Vec<(usize, Piece)> = Vec::new();
    open.retain(|piece| !piece.places.is_empty());
    while !open.is_empty() {
        let mut across = Vec::new();
        for piece in open {
            let rank = starts.partition_point(|start| *start as usize <= piece.places.start) - 1;
            if piece.places.end <= starts[rank + 1] as usize {
                whole.push((rank, piece));
            } else {
                across.push(piece);
            }
        }
        open = halves(ranks, across);
    }
    whole.sort_unstable_by_key(|(_, piece)| piece.places.start);
    let mut lists = vec![Vec::new(); ranks.count()];
    for (number, (rank, piece)) in (0..).zip(whole) {
        lists[rank].extend(piece.rows.into_iter().map(|row| PlacedVertex { piece: number, ..row }));
    }
    let mut own = ranks.all_to_all_v(lists).concat();
    own.sort_unstable_by_key(|row| (row.piece, row.vertex));
    let (mut vertices, mut rest) = (Vec::with_capacity(own.len()), Vec::with_capacity(own.len()));
    for piece in own.chunk_by(|a, b| a.piece == b.piece) {
        let positions: Vec<Vec3> = piece.iter().map(|row| row.position).collect();
        let mut order: Vec<u32> = (0..piece.len() as u32).collect();
        bisect(&positions, &mut order);
        vertices.extend(order.iter().map(|i| piece[*i as usize].vertex));
        rest.extend(order.iter().map(|i| positions[*i as usize]));
    }
    (vertices, rest)
}

/// Orders `order` by recursive bisection.
fn bisect(positions: &[Vec3], order: &mut [u32]) {
    if order.len() <= LEAF_SIZE {
        order.sort_unstable();
        return;
    }
    let at = |i: &u32| positions[*i as usize];
    let (low, high) = order.iter().fold((at(&order[0]), at(&order[0])), |(l, h), i| (l.inf(&at(i)), h.sup(&at(i))));
    let axis = (high - low).imax();
    let middle = order.len() / 2;
    order.select_nth_unstable_by(middle, |a, b| at(a)[axis].total_cmp(&at(b)[axis]).then(a.cmp(b)));
    let (low, high) = order.split_at_mut(middle);
    bisect(positions, low);
    bisect(positions, high);
}

/// Both halves of each piece, found by all ranks together.
fn halves(ranks: &Ranks, pieces: Vec<Piece>) -> Vec<Piece> {
    if pieces.is_empty() {
        return pieces;
    }
    let axes = longest_sides(ranks, &pieces);
    let keys = |(piece, axis): (&Piece, &usize)| piece.rows.iter().map(|row| key(row, *axis)).collect();
    let middle = |piece: &Piece| piece.places.len() / 2;
    let keys = pieces.iter().zip(&axes).map(keys).collect();
    let middles = smallest(ranks, keys, pieces.iter().map(|piece| middle(piece) as u64).collect());
    let halve = |((piece, axis), found): ((Piece, usize), u128)| {
        let border = piece.places.start + middle(&piece);
        let (low, high) = piece.rows.into_iter().partition(|row| key(row, axis) < found);
        let Range { start, end } = piece.places;
        [Piece { places: start..border, rows: low }, Piece { places: border..end, rows: high }]
    };
    pieces.into_iter().zip(axes).zip(middles).flat_map(halve).collect()
}

/// The axis along which each piece is longest.
fn longest_sides(ranks: &Ranks, pieces: &[Piece]) -> Vec<usize> {
    let none = Vec3::repeat(f64::NEG_INFINITY);
    let bounds = |piece: &Piece| {
        let positions = piece.rows.iter().map(|row| row.position);
        let bounds = positions.fold((none, none), |(l, h), p| (l.sup(&-p), h.sup(&p)));
        [bounds.0.x, bounds.0.y, bounds.0.z, bounds.1.x, bounds.1.y, bounds.1.z]
    };
    let all = ranks.max_each(pieces.iter().flat_map(bounds).collect());
    let side = |b: &[f64; 6]| (Vec3::new(b[3], b[4], b[5]) - -Vec3::new(b[0], b[1], b[2])).imax();
    all.as_chunks().0.iter().map(side).collect()
}

/// Returns the key by which a vertex is compared: its coordinate in the order of `total_cmp`, then its number.
fn key(row: &PlacedVertex, axis: usize) -> u128 {
    let bits = row.position[axis].to_bits();
    let coordinate = if bits >> 63 == 0 { bits | 1 << 63 } else { !bits };
    u128::from(coordinate) << u32::BITS | u128::from(row.vertex)
}

/// For each list, of which every rank has some keys, the key with `below` smaller ones.
fn smallest(ranks: &Ranks, mut lists: Vec<Vec<u128>>, mut below: Vec<u64>) -> Vec<u128> {
    let mut found = vec![0; lists.len()];
    for shift in (0..KEY / DIGIT).rev().map(|digit| digit * DIGIT) {
        let digit = |key: &u128| (*key >> shift) as usize % DIGITS;
        let mut counts = vec![0u64; DIGITS * lists.len()];
        for (counts, list) in counts.chunks_mut(DIGITS).zip(&lists) {
            list.iter().for_each(|key| counts[digit(key)] += 1);
        }
        let counts = ranks.sum_each(counts);
        for (l, counts) in counts.chunks(DIGITS).enumerate() {
            let mut here = 0;
            while here + 1 < DIGITS && below[l] >= counts[here] {
                below[l] -= counts[here];
                here += 1;
            }
            found[l] |= (here as u128) << shift;
            lists[l].retain(|key| digit(key) == here);
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::parallel::local_ranks::LocalRanks;
    use crate::parallel::parts::Partition;
    use crate::setup::distribute::block_rows::BlockDistribution;

    /// Many equal coordinates, both zeros among them.
    fn points(count: usize) -> Vec<Vec3> {
        let coordinate = |k: usize| (k * 7919 % 113) as f64 / 8.0 - 7.0;
        let zero = |x: f64, k: usize| if x == 0.0 && k.is_multiple_of(2) { -0.0 } else { x };
        (0..count).map(|k| Vec3::new(zero(coordinate(k), k), coordinate(k / 3), zero(coordinate(k / 11), k))).collect()
    }

    #[test]
    fn any_ranks_find_the_order_that_one_finds_with_all_positions_at_hand() {
        for count in [0, 1, 2049, 30_000] {
            let all = points(count);
            let mut expected: Vec<u32> = (0..count as u32).collect();
            bisect(&all, &mut expected);
            for ranks in [1, 2, 3, 7, 8] {
                let orders = LocalRanks::run(ranks, 1, |communicator| {
                    let ranks = Ranks::new(communicator);
                    let mut partition = Partition::default();
                    // A garment before this one.
                    partition.add_garment(5000);
                    let places = partition.add_garment(count);
                    let assignment = partition.balance(&partition.sizes(), ranks.count());
                    let starts: Vec<u32> = assignment.iter().map(|p| partition.starts()[*p] as u32).collect();
                    let own = BlockDistribution::new(count, ranks.count()).rows(ranks.rank());
                    let (order, rest) = order(&ranks, places, &starts, own.start, &all[own.clone()]);
                    assert!(order.iter().zip(&rest).all(|(v, p)| all[*v as usize] == *p));
                    order
                });
                assert_eq!(orders.expect("no rank ends early").concat(), expected, "{count} vertices, {ranks} ranks");
            }
        }
    }
}
