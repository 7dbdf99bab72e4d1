//! A sheet of springs and hinges for tests of matrices and solves, on any number of ranks.

use nalgebra::{DMatrix, Matrix3};

use super::BlockMatrix;
use crate::Vec3;
use crate::geometry::random::SplitMix64;
use crate::parallel::for_each_part::PerPart;
use crate::parallel::parts::{Partition, Parts};
use crate::parallel::ranks::Ranks;
use crate::parallel::simd4::Simd4;

/// Elements of a crumpled sheet, in numbers of the scene.
#[derive(Debug, Clone)]
pub(crate) struct Sheet {
    /// Positions of its vertices [m], and of some that no element has.
    pub(crate) x: Vec<Vec3>,
    /// Mass of each [kg].
    pub(crate) masses: Vec<f64>,
    /// Springs and k of each [kg].
    springs: Vec<([u32; 2], f64)>,
    /// Hinges with their gradients and stiffness.
    hinges: Vec<([u32; 4], [Vec3; 4], f64)>,
    /// First vertices of parts.
    starts: Vec<usize>,
    /// Vertices that no element has.
    lonely: [usize; 2],
}

impl Sheet {
    /// `side` by `side` vertices with springs of `stiffness` times the mass of a vertex, bending a hundredth
    /// of that, two vertices alone, and parts of these sizes.
    pub(crate) fn new(side: usize, stiffness: f64, parts: usize) -> Self {
        let mut random = SplitMix64::new(7);
        let count = side * side + 2;
        // Along a curve that stays in a neighbourhood, with the two that are alone somewhere in between.
        let mut cells: Vec<(usize, usize)> = (0..side).flat_map(|i| (0..side).map(move |k| (i, k))).collect();
        cells.sort_by_key(|(i, k)| {
            (0..8).map(|bit| (i >> bit & 1) << (2 * bit) | (k >> bit & 1) << (2 * bit + 1)).sum::<usize>()
        });
        let mut places = vec![0_u32; side * side];
        for (place, (i, k)) in cells.iter().enumerate() {
            places[i + side * k] = (place + usize::from(place >= side) + usize::from(place >= 3 * side)) as u32;
        }
        let at = |i: usize, k: usize| places[i + side * k];
        let mut x = vec![Vec3::zeros(); count];
        for i in 0..side {
            for k in 0..side {
                x[at(i, k) as usize] = Vec3::new(i as f64, 0.0, k as f64) + 0.3 * random.vector();
            }
        }
        let masses: Vec<f64> = (0..count).map(|_| 1.0 + 0.5 * random.signed()).collect();
        let (mut springs, mut hinges) = (Vec::new(), Vec::new());
        for i in 0..side {
            for k in 0..side {
                let mut ends = |far: bool, to: (usize, usize)| {
                    if far {
                        springs.push(([at(i, k), at(to.0, to.1)], stiffness * (1.0 + 0.5 * random.signed())));
                    }
                };
                ends(i + 1 < side, (i + 1, k));
                ends(k + 1 < side, (i, k + 1));
                ends(i + 1 < side && k + 1 < side, (i + 1, k + 1));
                if i + 1 < side && k + 1 < side {
                    let normal = random.vector();
                    let weights = [1.0, 0.3, -0.6, -0.7].map(|weight| normal * weight);
                    let corners = [at(i, k + 1), at(i + 1, k), at(i, k), at(i + 1, k + 1)];
                    hinges.push((corners, weights, 0.01 * stiffness));
                }
            }
        }
        let starts = (0..=parts).map(|part| count * part / parts).collect();
        Self { x, masses, springs, hinges, starts, lonely: [side, 3 * side + 1].map(|place| place.min(count - 1)) }
    }

    /// Vertices that no element has.
    pub(crate) fn lonely(&self) -> &[usize] {
        &self.lonely
    }

    /// Vertices of all elements.
    fn elements(&self) -> impl Iterator<Item = &[u32]> {
        let springs = self.springs.iter().map(|(ends, _)| ends.as_slice());
        springs.chain(self.hinges.iter().map(|(corners, ..)| corners.as_slice()))
    }

    /// The parts of a rank, with what its elements reach as ghosts.
    pub(crate) fn parts(&self, ranks: &Ranks) -> Parts {
        let count = self.x.len();
        let whole = 0..count;
        let partition = Partition::new(self.starts.clone(), vec![whole]);
        let assignment = partition.balance(&partition.sizes(), ranks.count());
        let own = self.starts[assignment[ranks.rank()]] as u32..self.starts[assignment[ranks.rank() + 1]] as u32;
        let touching = self.elements().filter(|element| element.iter().any(|v| own.contains(v)));
        let mut ghosts: Vec<u32> = touching.flatten().copied().filter(|v| !own.contains(v)).collect();
        ghosts.sort_unstable();
        ghosts.dedup();
        let numbers = ghosts.iter().copied().chain(own).map(|v| count as u32 - v).collect();
        Parts::new(ranks.clone(), partition, assignment, ghosts, numbers)
    }

    /// Returns the values of a rank's local vertices from an array of all vertices.
    pub(crate) fn local<T: Clone>(parts: &Parts, all: &[T]) -> Vec<T> {
        (0..parts.local_count()).map(|local| all[parts.number(local) as usize].clone()).collect()
    }

    /// The assembled matrix of a rank.
    pub(crate) fn matrix(&self, parts: &Parts) -> BlockMatrix {
        let locals = |vertices: &[u32]| -> Option<Vec<u32>> {
            vertices.iter().map(|v| parts.local(*v).map(|local| local as u32)).collect()
        };
        let visit_elements = |part: usize, visit: &mut dyn FnMut(&[u32])| {
            let range = parts.ranges()[part].clone();
            let touches = |element: &Vec<u32>| element.iter().any(|v| range.contains(&(*v as usize)));
            self.elements().filter_map(locals).filter(touches).for_each(|element| visit(&element));
        };
        let mut matrix = BlockMatrix::new(parts, &visit_elements);
        let masses = Self::local(parts, &self.masses);
        let locals = &locals;
        parts.for_each(PerPart(matrix.parts_mut()), &|part, rows| {
            let rows = &mut rows.0[0];
            let range = parts.ranges()[part].clone();
            rows.clear();
            for (vertex, mass) in masses[range.clone()].iter().enumerate() {
                rows.add_scalar(vertex, *mass);
                if vertex.is_multiple_of(3) {
                    rows.add_diagonal(vertex, &drag(*mass));
                }
            }
            for (ends, k) in &self.springs {
                let Some(at) = locals(ends).filter(|at| at.iter().any(|v| range.contains(&(*v as usize)))) else {
                    continue;
                };
                let slot = rows.slot(at[0], at[1]);
                let (along, across) = (*k, 0.1 * *k);
                rows.add_spring(slot, &self.direction(ends), along, across);
                // The same again as a block, the other way round.
                rows.add_coupling(rows.slot(at[1], at[0]), &skewed(*k).transpose());
            }
            for (corners, gradients, k) in &self.hinges {
                let at = locals(corners).filter(|at| at.iter().any(|v| range.contains(&(*v as usize))));
                let Some(at) = at else { continue };
                let slots: Vec<_> = rows.slots(&at).collect();
                rows.add_outer::<4, 6>(&slots.as_chunks().0[0], &gradients.map(|g| Simd4::from(&(g * k.sqrt()))));
            }
        });
        matrix
    }

    fn direction(&self, ends: &[u32; 2]) -> Vec3 {
        (self.x[ends[1] as usize] - self.x[ends[0] as usize]).normalize()
    }

    /// The same matrix, element by element.
    pub(crate) fn dense(&self) -> DMatrix<f64> {
        let count = self.x.len();
        let mut dense = DMatrix::zeros(3 * count, 3 * count);
        let mut add = |a: usize, b: usize, block: Matrix3<f64>| {
            let mut view = dense.view_mut((3 * a, 3 * b), (3, 3));
            view += block;
        };
        let starts = &self.starts;
        for (part, range) in starts.windows(2).enumerate() {
            for vertex in range[0]..range[1] {
                add(vertex, vertex, Matrix3::identity() * self.masses[vertex]);
                if (vertex - starts[part]).is_multiple_of(3) {
                    add(vertex, vertex, drag(self.masses[vertex]));
                }
            }
        }
        for (ends, k) in &self.springs {
            let e = self.direction(ends);
            let spring = e * e.transpose() * (0.9 * k) + Matrix3::identity() * (0.1 * k) + skewed(*k);
            let [a, b] = ends.map(|v| v as usize);
            add(a, a, spring);
            add(b, b, spring.transpose());
            add(a, b, -spring);
            add(b, a, -spring.transpose());
        }
        for (corners, gradients, k) in &self.hinges {
            for (a, g_a) in corners.iter().zip(gradients) {
                for (b, g_b) in corners.iter().zip(gradients) {
                    add(*a as usize, *b as usize, g_a * g_b.transpose() * *k);
                }
            }
        }
        dense
    }
}

/// Returns the term of D in addition to the mass.
fn drag(mass: f64) -> Matrix3<f64> {
    Matrix3::new(0.4, 0.1, 0.0, 0.1, 0.3, -0.1, 0.0, -0.1, 0.2) * mass
}

/// A symmetric block of another kind than a spring's.
fn skewed(k: f64) -> Matrix3<f64> {
    Matrix3::new(0.2, 0.05, 0.0, 0.05, 0.1, 0.02, 0.0, 0.02, 0.3) * k
}
