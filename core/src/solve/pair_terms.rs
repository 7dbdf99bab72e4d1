//! Terms that pairs in touch add to the matrix of a long step: for each pair a block T on the relative velocity of
//! its two sides, `A += wᵀ T w` with the weights w of its four nodes (`docs/theory/linear_solver.md#pairs-in-touch`).
//!
//! They come and go from step to step and join vertices that no element joins, so they are not in the matrix of blocks. Their
//! product has two passes: T of the relative velocity, pair by pair, and what each vertex has of its pairs, in the order of
//! these, which the scene fixes.

use nalgebra::Matrix3;
use rayon::prelude::*;

use crate::Vec3;
use crate::contact::repulsion::pair_forces::PairForce;
use crate::contact::topology::nodes::ContactNodes;
use crate::parallel::parts::Parts;
use crate::parallel::simd4::Simd4;
use crate::solve::constraints::{FREE, LocalProjections};
use crate::solve::ghost_directions::GhostRow;

/// Pairs that one task works on.
const TASK: usize = 512;

/// The block of a pair.
#[derive(Debug, Clone, Copy)]
struct PairTerm {
    /// Nodes of contact; those of bodies have no velocity in a solve.
    nodes: [u32; 4],
    weights: [f64; 4],
    normal: Simd4,
    /// T = across · 1 + (along - across) · n nᵀ [kg].
    along: f64,
    across: f64,
}

/// A pair as one of its vertices sees it.
#[derive(Debug, Clone, Copy)]
struct Incidence {
    /// Counted from the first of its part.
    vertex: u32,
    term: u32,
    weight: f64,
}

/// The terms of a rank's own vertices.
#[derive(Debug, Default)]
pub(crate) struct PairTerms {
    terms: Vec<PairTerm>,
    /// Incidences sorted by vertex and, within each vertex, by pair.
    incidences: Vec<Incidence>,
    /// First incidence of each part, and the number of all at the end.
    rows: Vec<usize>,
    /// First node of each part.
    first_nodes: Vec<usize>,
    /// T of the relative velocity of each pair [N s].
    products: Vec<Simd4>,
    /// The numbering of nodes, where some rank has terms.
    nodes: Option<ContactNodes>,
    /// Velocities of the nodes of cloth, where there are ghosts.
    values: Vec<Simd4>,
}

/// Data on the nodes of contact that the coarse levels need.
#[derive(Debug, Default)]
pub(super) struct NodesAround {
    /// Node of the first coarse level of each node of cloth.
    aggregates: Vec<u32>,
    /// Projections of the unit vectors at each node of cloth.
    projections: Vec<[Vec3; 3]>,
}

impl PairTerm {
    fn block(&self) -> Matrix3<f64> {
        let normal = Vec3::from(self.normal);
        Matrix3::identity() * self.across + normal * normal.transpose() * (self.along - self.across)
    }
}

impl PairTerms {
    /// Takes over the pairs of a stage, of which some rank has one: `force_factor` is what forces weigh in it, `alpha` what changes of
    /// velocity move the nodes by [s].
    pub(crate) fn set(
        &mut self,
        parts: &Parts,
        nodes: &ContactNodes,
        pairs: &[PairForce],
        [force_factor, alpha]: [f64; 2],
    ) {
        self.clear();
        let own = nodes.own();
        self.terms.reserve_exact(pairs.len());
        let mut of_vertices: Vec<(usize, Incidence)> = Vec::with_capacity(4 * pairs.len());
        for (term, pair) in (0..).zip(pairs) {
            let [along, across] = pair.damping.map(|damping| alpha * damping);
            let along = along + alpha * alpha * pair.stiffness;
            self.terms.push(PairTerm {
                nodes: pair.nodes,
                weights: pair.weights,
                normal: Simd4::from(&pair.normal),
                along: force_factor * along,
                across: force_factor * across,
            });
            for (node, weight) in pair.nodes.into_iter().zip(pair.weights) {
                if own.contains(&(node as usize)) {
                    let vertex = node as usize - own.start + parts.own().start;
                    of_vertices.push((vertex, Incidence { vertex: 0, term, weight }));
                }
            }
        }
        // The order of the pairs stays. A stable sort would take more memory.
        of_vertices.sort_unstable_by_key(|(vertex, incidence)| (*vertex, incidence.term));
        let mut rest = of_vertices.into_iter().peekable();
        for range in parts.ranges() {
            self.first_nodes.push(range.start - parts.own().start + own.start);
            self.rows.push(self.incidences.len());
            while let Some((vertex, incidence)) = rest.next_if(|(vertex, _)| *vertex < range.end) {
                self.incidences.push(Incidence { vertex: (vertex - range.start) as u32, ..incidence });
            }
        }
        self.rows.push(self.incidences.len());
        self.products.resize(self.terms.len(), Simd4::ZERO);
        self.nodes = Some(nodes.clone());
    }

    /// Without any.
    pub(crate) fn clear(&mut self) {
        self.terms.clear();
        self.incidences.clear();
        self.rows.clear();
        self.first_nodes.clear();
        self.nodes = None;
    }

    /// Whether no rank has any.
    pub(crate) fn is_empty(&self) -> bool {
        self.nodes.is_none()
    }

    /// The numbering of the nodes of pairs; `None` where no rank has any.
    pub(super) fn nodes(&self) -> Option<&ContactNodes> {
        self.nodes.as_ref()
    }

    /// T of the relative velocities with `own` at the own vertices, and with these at ghosts, by their nodes.
    pub(super) fn multiply(&mut self, own: &[Simd4], ghosts: impl Iterator<Item = (usize, Simd4)>) {
        let Self { terms, products, nodes: Some(nodes), values, .. } = self else { return };
        let values = if nodes.ranks().is_alone() {
            own
        } else {
            values.resize(nodes.cloth(), Simd4::ZERO);
            values[nodes.own()].copy_from_slice(own);
            ghosts.for_each(|(node, velocity)| values[node] = velocity);
            values
        };
        let chunks = products.par_chunks_mut(TASK).zip(terms.par_chunks(TASK));
        chunks.for_each(|(products, terms)| {
            for (product, term) in products.iter_mut().zip(terms) {
                let mut relative = Simd4::ZERO;
                for (node, weight) in term.nodes.into_iter().zip(term.weights) {
                    if let Some(v) = values.get(node as usize) {
                        relative += *v * weight;
                    }
                }
                let along = (term.along - term.across) * relative.dot(term.normal);
                *product = term.normal * along + relative * term.across;
            }
        });
    }

    /// Velocities of the nodes of cloth in the last product [m/s], where pairs have ghosts.
    pub(crate) fn velocities(&self) -> &[Simd4] {
        &self.values
    }

    /// Returns T of the relative velocity of each pair in the last product [N s].
    pub(crate) fn products(&self) -> &[Simd4] {
        &self.products
    }

    /// Adds what the vertices of a part have of the last product to their rows.
    #[inline]
    pub(super) fn add_product(&self, part: usize, q: &mut [Simd4]) {
        for Incidence { vertex, term, weight } in self.of_part(part) {
            q[*vertex as usize] += self.products[*term as usize] * *weight;
        }
    }

    /// Adds to the diagonal blocks of a part's vertices.
    pub(super) fn add_diagonal(&self, part: usize, blocks: &mut [Matrix3<f64>]) {
        for Incidence { vertex, term, weight } in self.of_part(part) {
            blocks[*vertex as usize] += self.terms[*term as usize].block() * (weight * weight);
        }
    }

    /// Aggregates and projections of the nodes of cloth; `ghosts` knows those of other ranks.
    pub(super) fn nodes_around<'a>(
        &self,
        parts: &Parts,
        aggregates: &[u32],
        projections: &LocalProjections,
        ghosts: impl Iterator<Item = (usize, &'a GhostRow)>,
    ) -> NodesAround {
        let Some(nodes) = &self.nodes else { return NodesAround::default() };
        let own = parts.own();
        let mut around = NodesAround { aggregates: vec![0; nodes.cloth()], projections: vec![FREE; nodes.cloth()] };
        around.aggregates[nodes.own()].copy_from_slice(&aggregates[own.clone()]);
        for (to, vertex) in around.projections[nodes.own()].iter_mut().zip(own) {
            if let Some(projection) = projections.of(vertex) {
                *to = [0, 1, 2].map(|column| projection.column(column).into());
            }
        }
        for (ghost, row) in ghosts {
            (around.aggregates[ghost], around.projections[ghost]) = (row.node, row.columns);
        }
        around
    }

    /// Gives `visit` the blocks that each pair with a vertex of a part has in the rows of aggregates that move as one where
    /// constraints let them: by row, those of the diagonal and those of couplings with another aggregate, in the form of
    /// [`crate::block_matrix`]. What a pair has inside one aggregate vanishes.
    pub(super) fn visit_aggregates(
        &self,
        part: usize,
        around: &NodesAround,
        mut visit: impl FnMut(u32, Option<u32>, Matrix3<f64>),
    ) {
        let mut rows: Vec<(u32, u32)> = Vec::new();
        let first = self.first_nodes.get(part).copied().unwrap_or_default();
        let aggregate = |incidence: &Incidence| around.aggregates[first + incidence.vertex as usize];
        rows.extend(self.of_part(part).iter().map(|incidence| (incidence.term, aggregate(incidence))));
        rows.sort_unstable();
        rows.dedup();
        for (term, row) in rows {
            let term = &self.terms[term as usize];
            let mut of_aggregates = [(u32::MAX, Matrix3::zeros()); 4];
            for (node, weight) in term.nodes.into_iter().zip(term.weights) {
                let Some(aggregate) = around.aggregates.get(node as usize) else { continue };
                let known = of_aggregates.iter_mut().find(|(known, _)| [*aggregate, u32::MAX].contains(known));
                if let Some((known, sum)) = known {
                    *known = *aggregate;
                    *sum += Matrix3::from_columns(&around.projections[node as usize]) * weight;
                }
            }
            let of_row =
                of_aggregates.iter().find(|(aggregate, _)| *aggregate == row).map_or_else(Matrix3::zeros, |a| a.1);
            let block = of_row.transpose() * term.block();
            let mut together = Matrix3::zeros();
            for (aggregate, weight) in of_aggregates.iter().filter(|(aggregate, _)| *aggregate != u32::MAX) {
                together += weight;
                if *aggregate != row {
                    visit(row, Some(*aggregate), -(block * weight));
                }
            }
            visit(row, None, block * together);
        }
    }

    fn of_part(&self, part: usize) -> &[Incidence] {
        self.rows.get(part).map_or(&[], |first| &self.incidences[*first..self.rows[part + 1]])
    }

    /// Memory held [bytes].
    pub(super) fn bytes(&self) -> usize {
        self.terms.capacity() * (size_of::<PairTerm>() + size_of::<Simd4>())
            + self.incidences.capacity() * size_of::<Incidence>()
            + size_of_val(self.values.as_slice())
    }
}
