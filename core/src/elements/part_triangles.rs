//! The triangles of one part: those with at least one of its vertices, in the order of the scene. A triangle across a border
//! is evaluated by all parts that own a corner, with the same operands; each adds to its own corners only.

#![cfg(feature = "effects")]

use std::ops::Range;

use crate::Vec3;
use crate::elements::corners;
use crate::parallel::simd4::Simd4;
use crate::scene::Scene;

/// The triangles that one part looks at.
#[derive(Debug, Clone)]
pub(crate) struct PartTriangles {
    /// The part's vertices.
    own: Range<usize>,
    /// Corners, local vertices.
    corners: Vec<[u32; 3]>,
    /// Corners of other parts, ascending.
    neighbours: Vec<u32>,
}

impl PartTriangles {
    /// The triangles of these garments, part by part; parts without any are left out.
    pub(crate) fn of(scene: &Scene, garments: Range<usize>) -> Vec<(usize, Self)> {
        let parts = scene.parts();
        let of_garment = |garment: usize| {
            let first = parts.garment(garment).start;
            let triangles = scene.meshes()[garment].triangles().iter();
            triangles.map(move |triangle| triangle.map(|v| (first + v as usize) as u32))
        };
        let triangles: Vec<[u32; 3]> = garments.flat_map(of_garment).collect();
        let entries = corners::by_part(parts, triangles.iter().map(|corners| corners.map(|v| v as usize)));
        let of_part = |group: &[(usize, usize)]| {
            let own = parts.ranges()[group[0].0].clone();
            let corners: Vec<[u32; 3]> = group.iter().map(|(_, number)| triangles[*number]).collect();
            let neighbours = corners::outside(&own, corners.iter().copied());
            (group[0].0, Self { own, corners, neighbours })
        };
        entries.chunk_by(|a, b| a.0 == b.0).map(of_part).collect()
    }

    /// Corners of every triangle, local vertices.
    pub(crate) fn corners(&self) -> &[[u32; 3]] {
        &self.corners
    }

    /// Corners of other parts, ascending.
    pub(crate) fn neighbours(&self) -> &[u32] {
        &self.neighbours
    }

    /// Number of triangles.
    pub(crate) fn count(&self) -> usize {
        self.corners.len()
    }

    /// Number of triangles that this part counts.
    pub(crate) fn counted(&self) -> usize {
        self.corners.iter().filter(|corners| self.counts(corners)).count()
    }

    /// Memory held [bytes].
    pub(crate) fn bytes(&self) -> usize {
        size_of_val(self.corners.as_slice()) + size_of_val(self.neighbours.as_slice())
    }

    /// Adds `force` [N] to each corner that is the part's own; `f` are the part's vertices.
    #[inline]
    pub(crate) fn add(&self, corners: &[u32; 3], force: &Vec3, f: &mut [Simd4]) {
        corners::add(self.own.start, *corners, [Simd4::from(force); 3], f);
    }

    /// Whether this part counts the triangle in sums over the cloth: it has the corner of the smallest number.
    pub(crate) fn counts(&self, corners: &[u32; 3]) -> bool {
        corners.iter().min().is_some_and(|first| self.own.contains(&(*first as usize)))
    }
}

/// Half the cross product of two sides: its length is the area [m²], its direction the normal.
#[inline]
pub(crate) fn area_vector([a, b, c]: &[Vec3; 3]) -> Vec3 {
    (b - a).cross(&(c - a)) * 0.5
}
