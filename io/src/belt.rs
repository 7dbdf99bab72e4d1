//! A belt as a body of its own: a ring around the section of another body, bound to its surface, which it follows.
//!
//! The section is the convex hull of what three planes cut out of the body, at the middle and at both rims of the belt, because a
//! belt spans the hollow of the back. Around it, at the distance of the gap, runs a closed band of eight edges in its profile. Every
//! point of the band is bound to the closest point of the body in this pose (`drapery_core::geometry::surface_binding`).

use std::collections::BTreeMap;

use drapery_core::Vec3;
use drapery_core::geometry::surface_binding::SurfaceBinding;
use drapery_core::mesh::PolygonMesh;

use crate::error::IoError;
use crate::mesh_data::{Connectivity, MeshData, MeshReader};
use crate::mesh_source::MeshSource;

/// Corners of the profile.
const PROFILE: usize = 8;

/// Largest angle between neighbouring points of the offset hull [rad].
const ARC: f64 = 0.1;

/// Size and place of a belt.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct BeltShape {
    /// A point inside of the part of the body that it runs around [m].
    pub(crate) at: Vec3,
    /// Axis that it runs around, of length one.
    pub(crate) axis: Vec3,
    /// Width along the axis [m].
    pub(crate) width: f64,
    /// Thickness of the strap [m].
    pub(crate) depth: f64,
    /// Distance from the hull of the body [m].
    pub(crate) gap: f64,
    /// Points along its length.
    pub(crate) resolution: usize,
}

/// A point of the hull, and the direction outwards there.
#[derive(Debug, Clone, Copy)]
struct Outline {
    base: [f64; 2],
    angle: f64,
}

impl Outline {
    /// The point at a distance from the hull.
    fn at(&self, distance: f64) -> [f64; 2] {
        let (sin, cos) = libm::sincos(self.angle);
        [self.base[0] + distance * cos, self.base[1] + distance * sin]
    }
}

impl BeltShape {
    /// Two directions across the axis.
    fn across(&self) -> [Vec3; 2] {
        let least = self.axis.iamin();
        let u = self.axis.cross(&Vec3::ith(least, 1.0)).normalize();
        [u, self.axis.cross(&u)]
    }

    /// The band around a body in a pose.
    ///
    /// # Errors
    /// The plane of the belt does not cut the body; the text says where the body is.
    pub(crate) fn around(&self, body: &PolygonMesh) -> Result<PolygonMesh, String> {
        let (triangles, _) = body.triangulate();
        let mut section = Vec::new();
        for height in [-0.5, 0.0, 0.5].map(|share| share * self.width) {
            section.extend(self.section(body, &triangles, height));
        }
        let hull = convex_hull(section);
        if hull.len() < 3 {
            let along = body.points.iter().map(|point| self.axis.dot(&(point - self.at)));
            let (low, high) = along.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), h| (a.min(h), b.max(h)));
            return Err(format!(
                "this point is not inside of the body, which is from {low:.3} to {high:.3} m along the axis from there"
            ));
        }
        let outline = self.resampled(&offset_outline(&hull));
        Ok(self.band(&outline))
    }

    /// Points, in the plane across the axis, of the piece that a plane at a height cuts out of the body around the axis; none if
    /// the axis is outside.
    fn section(&self, body: &PolygonMesh, triangles: &[[u32; 3]], height: f64) -> Vec<[f64; 2]> {
        let [u, v] = self.across();
        let above = |p: u32| self.axis.dot(&(body.points[p as usize] - self.at)) - height;
        // Cut edges are the nodes of the pieces, cut triangles their segments.
        let (mut nodes, mut places) = (BTreeMap::new(), Vec::new());
        let mut segments: Vec<[usize; 2]> = Vec::new();
        for [a, b, c] in triangles {
            let mut ends = Vec::new();
            for (p, q) in [(*a, *b), (*b, *c), (*c, *a)] {
                let (p, q) = (p.min(q), p.max(q));
                let (d, e) = (above(p), above(q));
                if (d < 0.0) == (e < 0.0) {
                    continue;
                }
                ends.push(*nodes.entry([p, q]).or_insert_with(|| {
                    let [x, y] = [p, q].map(|p| body.points[p as usize]);
                    let place = x + (y - x) * (d / (d - e)) - self.at;
                    places.push([u.dot(&place), v.dot(&place)]);
                    places.len() - 1
                }));
            }
            if let [one, other] = ends[..] {
                segments.push([one, other]);
            }
        }
        let piece_of = pieces(places.len(), &segments);
        let mut pieces: BTreeMap<usize, Vec<[usize; 2]>> = BTreeMap::new();
        segments.iter().for_each(|segment| pieces.entry(piece_of[segment[0]]).or_default().push(*segment));
        let encloses = |segments: &&Vec<[usize; 2]>| {
            let crossed = segments.iter().filter(|ends| {
                let [[x, y], [z, w]] = ends.map(|end| places[end]);
                (y < 0.0) != (w < 0.0) && x + (z - x) * (y / (y - w)) > 0.0
            });
            crossed.count() % 2 == 1
        };
        let size = |segments: &&Vec<[usize; 2]>| {
            let distances = segments.iter().map(|ends| places[ends[0]].iter().map(|c| c * c).sum::<f64>());
            distances.fold(0.0, f64::max)
        };
        // Of pieces inside one another, as of a body with insides, the outermost.
        let chosen = pieces.values().filter(encloses).max_by(|a, b| size(a).total_cmp(&size(b)));
        chosen.into_iter().flatten().flatten().map(|end| places[*end]).collect()
    }

    /// Points of an outline at even distances, one for each along the length of the belt.
    fn resampled(&self, outline: &[Outline]) -> Vec<Outline> {
        let points: Vec<[f64; 2]> = outline.iter().map(|point| point.at(self.gap)).collect();
        let lengths: Vec<f64> =
            (0..points.len()).map(|k| distance(points[k], points[(k + 1) % points.len()])).collect();
        let step = lengths.iter().sum::<f64>() / self.resolution as f64;
        let (mut found, mut k, mut before) = (Vec::new(), 0, 0.0);
        for number in 0..self.resolution {
            let wanted = step * number as f64;
            while k + 1 < lengths.len() && before + lengths[k] <= wanted {
                before += lengths[k];
                k += 1;
            }
            let share = if lengths[k] > 0.0 { ((wanted - before) / lengths[k]).clamp(0.0, 1.0) } else { 0.0 };
            let (one, other) = (outline[k], outline[(k + 1) % outline.len()]);
            let turn = (other.angle - one.angle).rem_euclid(std::f64::consts::TAU);
            let base = [0, 1].map(|axis| one.base[axis] + share * (other.base[axis] - one.base[axis]));
            found.push(Outline { base, angle: one.angle + share * turn });
        }
        found
    }

    /// The band along an outline that runs counter-clockwise around the axis; its faces look outwards.
    fn band(&self, outline: &[Outline]) -> PolygonMesh {
        let ([u, v], half) = (self.across(), 0.5 * self.width);
        let bevel = 0.25 * self.depth.min(self.width);
        let profile: [[f64; 2]; PROFILE] = [
            [0.0, bevel - half],
            [bevel, -half],
            [self.depth - bevel, -half],
            [self.depth, bevel - half],
            [self.depth, half - bevel],
            [self.depth - bevel, half],
            [bevel, half],
            [0.0, half - bevel],
        ];
        let place = |point: &Outline, [out, along]: [f64; 2]| {
            let [x, y] = point.at(self.gap + out);
            self.at + u * x + v * y + self.axis * along
        };
        let points = outline.iter().flat_map(|point| profile.iter().map(move |corner| place(point, *corner)));
        let (points, count) = (points.collect(), outline.len());
        let number = |k: usize, j: usize| (PROFILE * (k % count) + j % PROFILE) as u32;
        let faces = (0..count).flat_map(|k| (0..PROFILE).map(move |j| (k, j)));
        let corners = |(k, j): (usize, usize)| [number(k, j), number(k + 1, j), number(k + 1, j + 1), number(k, j + 1)];
        let face_indices: Vec<u32> = faces.flat_map(corners).collect();
        PolygonMesh { points, face_counts: vec![4; face_indices.len() / 4], face_indices }
    }
}

/// The piece of each node: the smallest number among those that segments connect.
fn pieces(count: usize, segments: &[[usize; 2]]) -> Vec<usize> {
    let mut piece: Vec<usize> = (0..count).collect();
    fn root(piece: &mut [usize], mut node: usize) -> usize {
        while piece[node] != node {
            piece[node] = piece[piece[node]];
            node = piece[node];
        }
        node
    }
    for [a, b] in segments {
        let (a, b) = (root(&mut piece, *a), root(&mut piece, *b));
        piece[a.max(b)] = a.min(b);
    }
    (0..count).map(|node| root(&mut piece, node)).collect()
}

fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    libm::hypot(a[0] - b[0], a[1] - b[1])
}

/// The convex hull of points, counter-clockwise (A. M. Andrew, "Another efficient algorithm for convex hulls in two dimensions",
/// 1979).
fn convex_hull(mut points: Vec<[f64; 2]>) -> Vec<[f64; 2]> {
    points.sort_unstable_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    points.dedup();
    let turns_left =
        |a: [f64; 2], b: [f64; 2], c: [f64; 2]| (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]) > 0.0;
    let half = |points: &mut dyn Iterator<Item = [f64; 2]>| {
        let mut chain: Vec<[f64; 2]> = Vec::new();
        for point in points {
            while let [.., a, b] = chain[..]
                && !turns_left(a, b, point)
            {
                chain.pop();
            }
            chain.push(point);
        }
        chain.pop();
        chain
    };
    let mut hull = half(&mut points.iter().copied());
    hull.extend(half(&mut points.iter().rev().copied()));
    hull
}

/// The points of a convex polygon with the directions outwards at them: at a corner, all from those of one side to those of the other.
fn offset_outline(hull: &[[f64; 2]]) -> Vec<Outline> {
    let side = |k: usize| {
        let (a, b) = (hull[k % hull.len()], hull[(k + 1) % hull.len()]);
        // Outwards is to the right of a side that runs counter-clockwise.
        libm::atan2(a[0] - b[0], b[1] - a[1]).rem_euclid(std::f64::consts::TAU)
    };
    let mut outline = Vec::new();
    for k in 0..hull.len() {
        let (before, after) = (side(k + hull.len() - 1), side(k));
        let turn = (after - before).rem_euclid(std::f64::consts::TAU);
        let steps = (turn / ARC).ceil().max(1.0) as usize;
        let angles = (0..=steps).map(|step| before + turn * step as f64 / steps as f64);
        outline.extend(angles.map(|angle| Outline { base: hull[k], angle }));
    }
    outline
}

/// Reads a body as the belt that follows it.
pub(crate) struct BeltReader {
    /// The body.
    source: MeshSource,
    binding: SurfaceBinding,
    faces: Connectivity,
}

impl BeltReader {
    /// The belt that is `band` while the body of a file has these points and faces.
    ///
    /// # Errors
    /// The body has no face with an area.
    pub(crate) fn new(source: MeshSource, body: &PolygonMesh, band: PolygonMesh) -> Result<Self, String> {
        let binding = SurfaceBinding::new(body.points.clone(), body.triangulate().0, &band.points, &[]);
        let binding = binding.ok_or("the body has no face with an area")?;
        let faces = Connectivity { face_counts: band.face_counts, face_indices: band.face_indices };
        Ok(Self { source, binding, faces })
    }

    /// Positions of the belt while the points of the body are there [m].
    pub(crate) fn positions(&self, body: &[Vec3]) -> Vec<Vec3> {
        self.binding.positions(body)
    }
}

impl MeshReader for BeltReader {
    fn objects(&self) -> Vec<String> {
        self.source.objects()
    }

    fn sample_times(&self) -> &[f64] {
        self.source.sample_times()
    }

    fn mesh_at(&self, time: f64) -> Result<MeshData, IoError> {
        let mut points = Vec::new();
        self.positions_at(time, &mut points)?;
        let Connectivity { face_counts, face_indices } = self.faces.clone();
        Ok(MeshData::new(PolygonMesh { points, face_counts, face_indices }))
    }

    fn positions_at(&self, time: f64, positions: &mut Vec<Vec3>) -> Result<(), IoError> {
        let mut body = Vec::new();
        self.source.positions_at(time, &mut body)?;
        *positions = self.positions(&body);
        Ok(())
    }

    fn points_at(&self, time: f64, take: &mut dyn FnMut(&[Vec3])) -> Result<(), IoError> {
        let mut positions = Vec::new();
        self.positions_at(time, &mut positions)?;
        take(&positions);
        Ok(())
    }

    fn faces_at(&self, _: f64, take: &mut dyn FnMut(&[u32], &[u32])) -> Result<(), IoError> {
        take(&self.faces.face_counts, &self.faces.face_indices);
        Ok(())
    }

    fn check_attributes_at(&self, _: f64) -> Result<(), IoError> {
        Ok(())
    }

    fn connectivity_at(&self, _: f64) -> Result<Option<Connectivity>, IoError> {
        Ok(None)
    }

    fn frame_rate(&self) -> Option<f64> {
        self.source.stated_frame_rate()
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use drapery_core::geometry::moving_surface::enclosed_share;

    use super::*;

    /// A tube along y of 64 sides with this radius [m], around x = 0 and z = 0, from -1 to 1, and a thinner one beside it.
    fn body() -> PolygonMesh {
        let mut mesh = PolygonMesh::default();
        for (radius, middle) in [(0.15, 0.0), (0.04, 0.4)] {
            let first = mesh.points.len() as u32;
            for row in 0..3 {
                mesh.points.extend((0..64).map(|k| {
                    let angle = TAU * f64::from(k) / 64.0;
                    Vec3::new(middle + radius * angle.cos(), f64::from(row) - 1.0, radius * angle.sin())
                }));
            }
            for row in 0..2 {
                for k in 0..64 {
                    let number = |row: u32, k: u32| first + 64 * row + k % 64;
                    mesh.face_indices.extend([
                        number(row, k),
                        number(row + 1, k),
                        number(row + 1, k + 1),
                        number(row, k + 1),
                    ]);
                    mesh.face_counts.push(4);
                }
            }
        }
        mesh
    }

    const BELT: BeltShape = BeltShape {
        at: Vec3::new(0.02, 0.3, 0.0),
        axis: Vec3::new(0.0, 1.0, 0.0),
        width: 0.04,
        depth: 0.004,
        gap: 0.003,
        resolution: 96,
    };

    #[test]
    fn a_belt_is_a_closed_band_around_the_part_that_it_is_at() {
        let band = BELT.around(&body()).unwrap();
        assert_eq!((band.points.len(), band.face_counts.len()), (96 * 8, 96 * 8));
        for point in &band.points {
            let radius = point.x.hypot(point.z);
            assert!((0.15 + 0.003 - 2e-4..=0.15 + 0.007 + 1e-9).contains(&radius), "{radius} m");
            assert!((point.y - 0.3).abs() <= 0.02 + 1e-12, "{point:?}");
        }
        let (triangles, _) = band.triangulate();
        let volume = |[a, b, c]: &[u32; 3]| {
            let [a, b, c] = [a, b, c].map(|v| band.points[*v as usize]);
            a.dot(&b.cross(&c)) / 6.0
        };
        // The rectangle without its bevels, along the circle of its middle.
        let expected = (0.04 * 0.004 - 4.0 * 0.5 * 0.001 * 0.001) * TAU * (0.15 + 0.005);
        let found: f64 = triangles.iter().map(volume).sum();
        assert!((found / expected - 1.0).abs() < 2e-3, "{found} m³ for {expected} m³");
        assert!(enclosed_share(&triangles, &band.points) > 0.0, "its faces look outwards");
    }

    #[test]
    fn a_belt_around_a_point_outside_says_where_the_body_is() {
        let missed = BeltShape { at: Vec3::new(0.0, 1.5, 0.0), ..BELT }.around(&body()).unwrap_err();
        assert_eq!(
            missed,
            "this point is not inside of the body, which is from -2.500 to -0.500 m along the axis from there"
        );
        BeltShape { at: Vec3::new(0.25, 0.3, 0.0), ..BELT }.around(&body()).expect_err("between the two tubes");
    }

    #[test]
    fn the_hull_of_a_square_with_points_inside_is_the_square() {
        let corners = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
        let all = corners.into_iter().chain([[0.5, 0.5], [0.2, 0.9], [0.5, 0.0]]).collect();
        assert_eq!(convex_hull(all), corners);
        let outline = offset_outline(&corners);
        let far = |point: &Outline| point.at(0.5).iter().map(|c| (c - 0.5).abs()).fold(0.0, f64::max);
        assert!(outline.iter().all(|point| far(point) <= 1.0 + 1e-12));
    }
}
