//! A garment at rest: its edges and their lengths, against which strain is measured, and its thickness.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BinaryHeap};

use drapery_core::Vec3;

/// The rest shape of a mesh that is drawn.
#[derive(Debug)]
pub(super) struct Rest {
    /// Edges, each once: two vertices in ascending order.
    edges: Vec<[u32; 2]>,
    /// Their lengths [m].
    lengths: Vec<f64>,
    /// Edges of each vertex, as places in `around`: those of vertex v are `starts[v]..starts[v + 1]`.
    starts: Vec<u32>,
    /// Edges, vertex by vertex.
    around: Vec<u32>,
    /// Thickness of each vertex [m].
    pub(super) thickness: Vec<f32>,
}

impl Rest {
    /// The rest shape of triangles at these positions [m].
    pub(super) fn new(points: &[Vec3], triangles: &[[u32; 3]], thickness: Vec<f32>) -> Self {
        let sides = triangles.iter().flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]]);
        let mut edges: Vec<[u32; 2]> = sides.map(|[a, b]| [a.min(b), a.max(b)]).collect();
        edges.sort_unstable();
        edges.dedup();
        let lengths = edges.iter().map(|&edge| length(points, edge)).collect();
        let mut starts = vec![0; points.len() + 1];
        for vertex in edges.as_flattened() {
            starts[*vertex as usize + 1] += 1;
        }
        for vertex in 0..points.len() {
            starts[vertex + 1] += starts[vertex];
        }
        let (mut filled, mut around) = (starts.clone(), vec![0; 2 * edges.len()]);
        for (number, edge) in edges.iter().enumerate() {
            for &vertex in edge {
                around[filled[vertex as usize] as usize] = number as u32;
                filled[vertex as usize] += 1;
            }
        }
        Self { edges, lengths, starts, around, thickness }
    }

    /// Largest strain (extension by rest length) of the edges at each vertex; NaN at vertices without edges.
    pub(super) fn strain(&self, points: &[Vec3]) -> Vec<f32> {
        let mut strains = vec![f32::NAN; points.len()];
        for (&edge, rest) in self.edges.iter().zip(&self.lengths) {
            let strain = (length(points, edge) / rest - 1.0) as f32;
            for vertex in edge {
                // The maximum of a number and NaN is the number.
                strains[vertex as usize] = strains[vertex as usize].max(strain);
            }
        }
        strains
    }

    /// Vertices that are at most `reach` [m] away at rest along edges (Dijkstra's search), and all that share an edge with the vertex;
    /// ascending.
    pub(super) fn near(&self, vertex: u32, reach: f64) -> Vec<u32> {
        let mut near: BTreeMap<u32, f64> = BTreeMap::from([(vertex, 0.0)]);
        // Distances are not negative, so their bits are ordered as they are.
        let mut ahead = BinaryHeap::from([Reverse((0, vertex))]);
        while let Some(Reverse((bits, from))) = ahead.pop() {
            let distance = f64::from_bits(bits);
            if distance > near[&from] || distance > reach {
                continue;
            }
            let [start, end] = [0, 1].map(|side| self.starts[from as usize + side] as usize);
            for &edge in &self.around[start..end] {
                let [a, b] = self.edges[edge as usize];
                let other = if a == from { b } else { a };
                let along = distance + self.lengths[edge as usize];
                let is_near = along <= reach || from == vertex;
                if is_near && near.get(&other).is_none_or(|known| along < *known) {
                    near.insert(other, along);
                    ahead.push(Reverse((along.to_bits(), other)));
                }
            }
        }
        near.into_keys().collect()
    }
}

fn length(points: &[Vec3], [a, b]: [u32; 2]) -> f64 {
    (points[b as usize] - points[a as usize]).norm()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A strip of squares of 1 cm, each of two triangles: vertices 2 i and 2 i + 1 stand at x = i.
    fn strip(squares: u32) -> (Vec<Vec3>, Vec<[u32; 3]>) {
        let point = |i: u32| Vec3::new(0.01 * f64::from(i / 2), 0.0, 0.01 * f64::from(i % 2));
        let faces = (0..squares).flat_map(|i| [[0, 1, 2], [1, 3, 2]].map(|face| face.map(|v: u32| v + 2 * i)));
        ((0..2 * squares + 2).map(point).collect(), faces.collect())
    }

    #[test]
    fn strain_is_that_of_the_longest_edge_at_a_vertex() {
        let (points, triangles) = strip(4);
        let rest = Rest::new(&points, &triangles, vec![0.001; points.len()]);
        // Five across, eight along, four diagonals.
        assert_eq!(rest.edges.len(), 5 + 8 + 4);
        assert!(rest.strain(&points).iter().all(|strain| strain.abs() < 1e-6));
        // Stretched by 5 % along x, the edges along x have that strain, and diagonals half of it.
        let stretched: Vec<Vec3> = points.iter().map(|p| Vec3::new(1.05 * p.x, p.y, p.z)).collect();
        assert!(rest.strain(&stretched).iter().all(|strain| (strain - 0.05).abs() < 1e-6));
        // One end pulled: only the vertices at its edges have a strain.
        let mut pulled = points.clone();
        pulled[8].x += 0.001;
        pulled[9].x += 0.001;
        let strains = rest.strain(&pulled);
        assert!(strains[..6].iter().all(|strain| strain.abs() < 1e-6), "{strains:?}");
        assert!(strains[6..].iter().all(|strain| (strain - 0.1).abs() < 1e-6), "{strains:?}");
    }

    #[test]
    fn vertices_without_edges_have_no_strain() {
        let (mut points, triangles) = strip(1);
        points.push(Vec3::zeros());
        let rest = Rest::new(&points, &triangles, vec![0.0; 5]);
        let strain = rest.strain(&points);
        assert!(strain[4].is_nan() && strain[..4].iter().all(|s| s.is_finite()));
        assert_eq!(rest.near(4, 1.0), [4]);
    }

    #[test]
    fn what_is_near_at_rest_are_neighbours_and_what_edges_lead_to_within_the_reach() {
        let (points, triangles) = strip(5);
        let rest = Rest::new(&points, &triangles, vec![0.0; points.len()]);
        assert_eq!(rest.near(0, 0.0), [0, 1, 2]);
        assert_eq!(rest.near(0, 0.0201), [0, 1, 2, 3, 4]);
        assert_eq!(rest.near(0, 1.0).len(), points.len());
    }
}
