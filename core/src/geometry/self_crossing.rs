//! Crossings of a triangle surface with itself, and a test whether a point lies inside despite them.
//!
//! Production characters cross themselves at elbows, armpits and hips. Cloth there has no right place: the side of the
//! closest triangle says nothing when that triangle lies inside the body. The winding number does.

use crate::Vec3;
use crate::geometry::aabb::Aabb;
use crate::geometry::bvh::Bvh;
use crate::geometry::tolerances;

/// Horizontal slopes of the rays that count windings, per unit of y. Any value works; these meet no symmetric model in
/// a row of edges.
const RAY_SLOPES: [f64; 2] = [0.127_368_942_117, 0.331_772_654_063];

/// Result of [`find`].
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct SelfCrossing {
    /// Pairs of triangles that cross, beyond the vertex or edge they may share, ascending.
    pub pairs: Vec<[u32; 2]>,
}

impl SelfCrossing {
    /// The triangles in `pairs`, ascending, each once.
    pub(crate) fn triangles(&self) -> Vec<u32> {
        let mut triangles: Vec<u32> = self.pairs.iter().flatten().copied().collect();
        triangles.sort_unstable();
        triangles.dedup();
        triangles
    }
}

/// Finds the crossings of a surface with itself; `tree` bounds its triangles at these `positions`.
///
/// Sides are decided in `f64`, not exactly: triangles that merely touch may go either way.
pub(crate) fn find(triangles: &[[u32; 3]], positions: &[Vec3], tree: &Bvh) -> SelfCrossing {
    let boxes: Vec<Aabb> = triangles.iter().map(|t| bounds_of(&t.map(|v| positions[v as usize]))).collect();
    let mut pairs = Vec::new();
    tree.self_pairs(|i, j| {
        if boxes[i as usize].overlaps(&boxes[j as usize]) {
            let (a, b) = (&triangles[i as usize], &triangles[j as usize]);
            if an_edge_crosses(a, b, positions) || an_edge_crosses(b, a, positions) {
                pairs.push([i, j]);
            }
        }
    });
    pairs.sort_unstable();
    SelfCrossing { pairs }
}

/// Returns the winding number of the closed surface around `point`: 0 outside, 1 inside, 2 where two parts of it
/// overlap.
///
/// Counts signed crossings of a ray. Edges are judged by products that are exact negatives of one another in the two
/// triangles that share them, so a ray through an edge or a corner is counted once. Meaningless for an open surface.
pub(crate) fn winding_number(triangles: &[[u32; 3]], positions: &[Vec3], tree: &Bvh, point: &Vec3) -> i32 {
    let mut winding = 0;
    let on_ray = |bounds: &Aabb| ray_meets(bounds, point);
    tree.for_each_where(on_ray, |t| winding += ray_crossing(&triangles[t as usize], positions, point));
    winding
}

fn bounds_of(corners: &[Vec3; 3]) -> Aabb {
    corners.iter().fold(Aabb::EMPTY, |bounds, p| bounds.union(&Aabb::of_point(p)))
}

/// Whether an edge of `a` passes through the triangle `b`. Edges with a corner of `b` touch it in any case and are left
/// out.
fn an_edge_crosses(a: &[u32; 3], b: &[u32; 3], x: &[Vec3]) -> bool {
    let shared = a.map(|v| b.contains(&v));
    if shared.iter().filter(|&&s| s).count() > 1 {
        return false;
    }
    let corners = b.map(|v| x[v as usize]);
    let [first, second] = [corners[1] - corners[0], corners[2] - corners[0]];
    let (normal, size) = (first.cross(&second), first.norm() * second.norm());
    // Zero on the plane: rounding says nothing of two triangles in one plane.
    let sides = a.map(|v| {
        let from = x[v as usize] - corners[0];
        let volume = normal.dot(&from);
        if volume.abs() > tolerances::VOLUME * size * from.norm() { volume.signum() } else { 0.0 }
    });
    (0..3).any(|k| {
        let l = (k + 1) % 3;
        let free = !shared[k] && !shared[l];
        free && sides[k] * sides[l] < 0.0 && line_meets(&[x[a[k] as usize], x[a[l] as usize]], &corners)
    })
}

/// Whether the line through `s` passes inside the triangle: on the same side of its three edges.
fn line_meets(s: &[Vec3; 2], t: &[Vec3; 3]) -> bool {
    let along = s[1] - s[0];
    let around = [0, 1, 2].map(|k| along.cross(&(t[k] - s[0])).dot(&(t[(k + 1) % 3] - s[0])) >= 0.0);
    around[0] == around[1] && around[1] == around[2]
}

/// Whether the ray upwards from `origin` along (`RAY_SLOPES[0]`, 1, `RAY_SLOPES[1]`) meets the box.
fn ray_meets(bounds: &Aabb, origin: &Vec3) -> bool {
    let direction = [RAY_SLOPES[0], 1.0, RAY_SLOPES[1]];
    let (mut enter, mut leave) = (0.0, f64::INFINITY);
    for k in 0..3 {
        // All slopes are positive: the lower face is met first.
        enter = f64::max(enter, (f64::from(bounds.min[k]) - origin[k]) / direction[k]);
        leave = f64::min(leave, (f64::from(bounds.max[k]) - origin[k]) / direction[k]);
    }
    enter <= leave + tolerances::RAY_SLAB * leave.abs()
}

/// +1 if the ray from `origin` leaves through the front of the triangle, −1 if it enters, 0 if it misses.
fn ray_crossing(triangle: &[u32; 3], x: &[Vec3], origin: &Vec3) -> i32 {
    // Sheared so that the ray becomes the y axis; then only x and z decide whether it hits.
    let [a, b, c] = triangle.map(|v| {
        let p = x[v as usize] - origin;
        Vec3::new(p.x - RAY_SLOPES[0] * p.y, p.y, p.z - RAY_SLOPES[1] * p.y)
    });
    // A ray exactly through an edge or a corner is decided as if it were shifted a little along z, and far less along x.
    let side = |p: &Vec3, q: &Vec3| {
        let area = p.z * q.x - p.x * q.z;
        let shifted = [area, q.x - p.x, p.z - q.z].into_iter().find(|&d| d != 0.0);
        (area, shifted.is_some_and(|d| d > 0.0))
    };
    let (u, v, w) = (side(&b, &c), side(&c, &a), side(&a, &b));
    let total = u.0 + v.0 + w.0;
    if u.1 != v.1 || v.1 != w.1 || total == 0.0 {
        return 0;
    }
    let height = (u.0 * a.y + v.0 * b.y + w.0 * c.y) / total;
    match (height > 0.0, u.1) {
        (false, _) => 0,
        (true, true) => 1,
        (true, false) => -1,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::random::SplitMix64;
    use crate::geometry::testing::{cube, torus};

    fn tree_over(triangles: &[[u32; 3]], x: &[Vec3]) -> Bvh {
        let box_of = |t: &[u32; 3]| t.iter().fold(Aabb::EMPTY, |b, &v| b.union(&Aabb::of_point(&x[v as usize])));
        Bvh::build(&triangles.iter().map(box_of).collect::<Vec<_>>())
    }

    /// Sum of the signed solid angles over 4π: the definition of the winding number.
    fn winding_by_solid_angle(triangles: &[[u32; 3]], x: &[Vec3], p: &Vec3) -> f64 {
        let mut sum = 0.0;
        for t in triangles {
            let [a, b, c] = t.map(|v| x[v as usize] - p);
            let (la, lb, lc) = (a.norm(), b.norm(), c.norm());
            let bottom = la * lb * lc + a.dot(&b) * lc + b.dot(&c) * la + c.dot(&a) * lb;
            sum += 2.0 * libm::atan2(a.cross(&b).dot(&c), bottom);
        }
        sum / (4.0 * std::f64::consts::PI)
    }

    /// Two copies of a mesh as one surface, the second moved by `shift`.
    fn doubled(mesh: (Vec<[u32; 3]>, Vec<Vec3>), shift: Vec3) -> (Vec<[u32; 3]>, Vec<Vec3>) {
        let (mut triangles, mut x) = mesh;
        let n = x.len() as u32;
        triangles.extend(triangles.clone().iter().map(|t| t.map(|v| v + n)));
        x.extend(x.clone().iter().map(|p| p + shift));
        (triangles, x)
    }

    #[test]
    fn the_ray_count_equals_the_sum_of_solid_angles() {
        let mut random = SplitMix64::new(31);
        for (triangles, x) in [cube(), torus(24, 1.0, 0.3), doubled(torus(16, 0.8, 0.3), Vec3::new(0.3, 0.1, 0.2))] {
            let tree = tree_over(&triangles, &x);
            let mut counts = [0; 3];
            for _ in 0..3000 {
                let p = random.vector() * 1.2;
                let winding = winding_number(&triangles, &x, &tree, &p);
                assert_eq!(f64::from(winding), winding_by_solid_angle(&triangles, &x, &p).round());
                counts[winding as usize] += 1;
            }
            assert!(counts[0] > 0 && counts[1] > 0);
        }
    }

    #[test]
    fn rays_through_vertices_and_edges_are_counted_once() {
        let (triangles, x) = torus(16, 1.0, 0.25);
        let tree = tree_over(&triangles, &x);
        let direction = Vec3::new(RAY_SLOPES[0], 1.0, RAY_SLOPES[1]);
        for t in &triangles {
            for target in [x[t[0] as usize], (x[t[0] as usize] + x[t[1] as usize]) * 0.5] {
                let p = target - direction * 5.0; // far below the body
                assert_eq!(winding_number(&triangles, &x, &tree, &p), 0);
            }
        }
    }

    #[test]
    fn a_surface_that_does_not_cross_itself_has_no_pairs() {
        let (triangles, x) = torus(24, 1.0, 0.3);
        assert_eq!(find(&triangles, &x, &tree_over(&triangles, &x)), SelfCrossing::default());
    }

    #[test]
    fn a_flat_cap_does_not_cross_itself_however_it_lies() {
        let mut random = SplitMix64::new(9);
        let triangles: Vec<[u32; 3]> = (0..32).map(|k| [0, 1 + k, 1 + (k + 1) % 32]).collect();
        for _ in 0..200 {
            let [u, w] = [random.vector().normalize(), random.vector()];
            let axes = [u, u.cross(&w).normalize()];
            let on_rim = |k: u32| {
                let (sin, cos) = libm::sincos(std::f64::consts::TAU * f64::from(k) / 32.0);
                axes[0] * cos + axes[1] * sin
            };
            let x: Vec<Vec3> = std::iter::once(Vec3::zeros()).chain((0..32).map(on_rim)).collect();
            assert_eq!(find(&triangles, &x, &tree_over(&triangles, &x)).pairs, Vec::<[u32; 2]>::new());
        }
    }

    #[test]
    fn crossing_pairs_are_those_a_look_at_every_pair_finds() {
        let (triangles, x) = doubled(torus(16, 1.0, 0.4), Vec3::new(0.3, 0.11, 0.2));
        let found = find(&triangles, &x, &tree_over(&triangles, &x));
        let mut expected = Vec::new();
        for (i, a) in triangles.iter().enumerate() {
            for (j, b) in triangles.iter().enumerate().skip(i + 1) {
                // Signed volumes of tetrahedra, edge by edge.
                let volume = |a: u32, b: u32, c: u32, d: u32| {
                    let [a, b, c, d] = [a, b, c, d].map(|v| x[v as usize]);
                    (b - a).cross(&(c - a)).dot(&(d - a)) > 0.0
                };
                let cut = |s: &[u32; 3], t: &[u32; 3]| {
                    (0..3).map(|k| [s[k], s[(k + 1) % 3]]).filter(|e| !e.iter().any(|v| t.contains(v))).any(|[p, q]| {
                        let around = [0, 1, 2].map(|k| volume(p, q, t[k], t[(k + 1) % 3]));
                        let sides = [volume(t[0], t[1], t[2], p), volume(t[0], t[1], t[2], q)];
                        sides[0] != sides[1] && around.windows(2).all(|w| w[0] == w[1])
                    })
                };
                if cut(a, b) || cut(b, a) {
                    expected.push([i as u32, j as u32]);
                }
            }
        }
        assert_eq!(found.pairs, expected);
    }
}
