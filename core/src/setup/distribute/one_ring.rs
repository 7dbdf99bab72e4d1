//! The triangles around vertices: sent from where their faces were read to the owners of their corners, who tell each other what
//! lies beyond edges between vertices of others.

use std::ops::Range;

use bytemuck::{Pod, Zeroable};

use crate::parallel::message::codec_of_rows;
use crate::parallel::ranks::Ranks;
use crate::setup::distribute::block_rows::BlockDistribution;
use crate::setup::distribute::even_blocks::{FetchedValues, joined};

/// A triangle of a polygon; ordered by the polygon first.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Pod, Zeroable)]
pub(crate) struct Triangle {
    /// Number of the polygon in the garment.
    pub(crate) polygon: u32,
    /// Numbers of the corners: in the garment while faces are in blocks, in the scene from then on.
    pub(crate) corners: [u32; 3],
}

codec_of_rows!(Triangle);

/// The rank that owns a number of the scene.
pub(crate) fn owner(starts: &[u32], number: u32) -> usize {
    starts.partition_point(|start| *start <= number) - 1
}

/// The triangles of the scene with an own vertex, ascending; corners are numbers in the scene. `cut` are those whose faces are in
/// this rank's block, with corners of the garment, `places` the number in the scene of each of its points that is
/// there, and `starts` the first of every rank.
pub(crate) fn one_ring(
    ranks: &Ranks,
    blocks: &BlockDistribution,
    cut: Vec<Triangle>,
    places: &[u32],
    starts: &[u32],
) -> Vec<Triangle> {
    let numbers = FetchedValues::new(ranks, cut.iter().flat_map(|triangle| triangle.corners), blocks, places);
    let mut lists: Vec<Vec<Triangle>> = vec![Vec::new(); ranks.count()];
    for Triangle { polygon, corners } in &cut {
        let corners = corners.map(|vertex| numbers.at(vertex));
        let [p, q, r] = corners.map(|number| owner(starts, number));
        let row = Triangle { polygon: *polygon, corners };
        lists[p].push(row);
        if q != p {
            lists[q].push(row);
        }
        if r != p && r != q {
            lists[r].push(row);
        }
    }
    drop((cut, numbers));
    let mut own = joined(ranks.all_to_all_v(lists));
    own.sort_unstable();
    own
}

/// The triangles at own vertices, for those who ask.
struct Star<'a> {
    triangles: &'a [Triangle],
    own: Range<u32>,
    /// First of each own vertex, and the number of all at the end.
    rows: Vec<u32>,
    at: Vec<u32>,
}

impl<'a> Star<'a> {
    fn new(triangles: &'a [Triangle], own: Range<u32>) -> Self {
        let corners = || {
            let of = |(t, triangle): (u32, &Triangle)| triangle.corners.map(|corner| (t, corner));
            (0..)
                .zip(triangles)
                .flat_map(of)
                .filter(|(_, v)| own.contains(v))
                .map(|(t, v)| (t, (v - own.start) as usize))
        };
        let mut rows = vec![0u32; own.len() + 1];
        corners().for_each(|(_, v)| rows[v + 1] += 1);
        (0..own.len()).for_each(|v| rows[v + 1] += rows[v]);
        let mut next = rows.clone();
        let mut at = vec![0; rows[own.len()] as usize];
        for (t, v) in corners() {
            at[next[v] as usize] = t;
            next[v] += 1;
        }
        Self { triangles, own, rows, at }
    }

    /// The triangles with both ends of an edge, of which the first is an own vertex.
    fn across(&self, [p, q]: [u32; 2]) -> impl Iterator<Item = Triangle> + use<'_, 'a> {
        let v = (p - self.own.start) as usize;
        let all = &self.at[self.rows[v] as usize..self.rows[v + 1] as usize];
        all.iter().map(|t| self.triangles[*t as usize]).filter(move |triangle| triangle.corners.contains(&q))
    }
}

/// Widens what [`one_ring`] has found by the triangles beyond its edges, `times` times. All ranks call it together.
pub(crate) fn grow(
    ranks: &Ranks,
    near: Vec<Triangle>,
    own: &Range<u32>,
    starts: &[u32],
    times: usize,
) -> Vec<Triangle> {
    if ranks.is_alone() {
        return near;
    }
    let star = Star::new(&near, own.clone());
    let mut beyond: Vec<Triangle> = Vec::new();
    let mut latest = near.clone();
    for _ in 0..times {
        let edges = latest.iter().flat_map(|Triangle { corners: [a, b, c], .. }| [[*a, *b], [*b, *c], [*c, *a]]);
        // Own vertices know all their triangles.
        let strange = edges.filter(|edge| edge.iter().all(|v| !own.contains(v)));
        let mut strange: Vec<[u32; 2]> = strange.map(|[p, q]| [p.min(q), p.max(q)]).collect();
        strange.sort_unstable();
        strange.dedup();
        let mut questions = vec![Vec::new(); ranks.count()];
        strange.iter().for_each(|edge| questions[owner(starts, edge[0])].push(*edge));
        let answer = |edges: Vec<[u32; 2]>| {
            let mut found: Vec<Triangle> = edges.into_iter().flat_map(|edge| star.across(edge)).collect();
            found.sort_unstable();
            found.dedup();
            found
        };
        let answers = ranks.all_to_all_v(questions).into_iter().map(answer).collect();
        latest = joined(ranks.all_to_all_v(answers));
        latest.retain(|triangle| near.binary_search(triangle).is_err() && beyond.binary_search(triangle).is_err());
        latest.sort_unstable();
        latest.dedup();
        beyond.extend_from_slice(&latest);
        beyond.sort_unstable();
    }
    let mut all = near;
    all.extend(beyond);
    all.sort_unstable();
    all
}
