//! Bounds on the motion of a surface around a place: what moves together keeps its distances.

use crate::Vec3;
use crate::geometry::aabb::Aabb;

/// Cells along the diagonal of the region that the surface sweeps over between two samples.
const CELLS: f64 = 32.0;

/// Cells that a triangle may sweep over; the velocity of one that sweeps over more counts everywhere.
const MOST_CELLS: usize = 512;

/// Motion that the surface around a place has in common between two samples.
#[derive(Clone, Copy, Debug)]
pub(super) struct LocalMotion {
    /// Velocity [m/s].
    pub velocity: Vec3,
    /// Largest difference of a point's velocity from it, of the points within `reach` [m/s].
    pub spread: f64,
    /// Distance from the place [m].
    pub reach: f64,
}

/// Velocities of the surface in the cells of a grid over the region that it sweeps over.
#[derive(Clone, Debug, Default)]
pub(super) struct MotionGrid {
    origin: Vec3,
    /// Length of a cell's edge [m].
    cell: f64,
    counts: [usize; 3],
    /// Boxes around the velocities of the triangles that pass through each cell [m/s].
    velocities: Vec<Aabb>,
    /// Box around the velocities of triangles that sweep over many cells [m/s].
    everywhere: Aabb,
    /// Fastest point [m/s].
    fastest: f64,
}

impl MotionGrid {
    /// Takes the motion of triangles between two samples `a` and `b` of their points [m], `duration` [s] apart.
    pub(super) fn set(&mut self, triangles: &[[u32; 3]], [a, b]: [&[Vec3]; 2], duration: f64) {
        let swept = a.iter().chain(b).fold(Aabb::EMPTY, |all, p| all.union(&Aabb::of_point(p)));
        let extent = Vec3::from_fn(|k, _| f64::from(swept.max[k]) - f64::from(swept.min[k]));
        self.origin = Vec3::from_fn(|k, _| f64::from(swept.min[k]));
        self.cell = extent.norm() / CELLS;
        self.counts = [0, 1, 2].map(|k| (extent[k] / self.cell) as usize + 1);
        self.velocities.clear();
        self.velocities.resize(self.counts.iter().product(), Aabb::EMPTY);
        self.everywhere = Aabb::EMPTY;
        let speed = if duration > 0.0 { 1.0 / duration } else { 0.0 };
        let farthest = a.iter().zip(b).map(|(a, b)| (b - a).norm_squared()).fold(0.0, f64::max).sqrt();
        self.fastest = if duration > 0.0 { farthest / duration } else { 0.0 };
        for corners in triangles {
            let (mut path, mut velocity) = (Aabb::EMPTY, Aabb::EMPTY);
            for point in corners {
                let (a, b) = (&a[*point as usize], &b[*point as usize]);
                path = path.union(&Aabb::of_segment(a, b));
                velocity = velocity.union(&Aabb::of_point(&((b - a) * speed)));
            }
            self.add(&path, &velocity);
        }
    }

    fn add(&mut self, path: &Aabb, velocity: &Aabb) {
        let [from, to] = [&path.min, &path.max].map(|corner| {
            [0, 1, 2].map(|k| (self.place(k, f64::from(corner[k])).max(0.0) as usize).min(self.counts[k] - 1))
        });
        if (0..3).map(|k| to[k] - from[k] + 1).product::<usize>() > MOST_CELLS {
            self.everywhere = self.everywhere.union(velocity);
            return;
        }
        for i in from[0]..=to[0] {
            for j in from[1]..=to[1] {
                for k in from[2]..=to[2] {
                    let cell = &mut self.velocities[(i * self.counts[1] + j) * self.counts[2] + k];
                    *cell = cell.union(velocity);
                }
            }
        }
    }

    /// Number of the cell along an axis at a coordinate [m], as a fraction.
    fn place(&self, axis: usize, coordinate: f64) -> f64 {
        (coordinate - self.origin[axis]) / self.cell
    }

    /// Fastest point of the surface [m/s].
    pub(super) fn fastest(&self) -> f64 {
        self.fastest
    }

    /// The motion around a place: of all points that are within a cell's edge of it at any time between the samples.
    pub(super) fn around(&self, place: &Vec3) -> LocalMotion {
        let range = |axis: usize| {
            let cell = self.place(axis, place[axis]).floor().clamp(-2.0, self.counts[axis] as f64 + 1.0) as isize;
            (cell - 1).max(0) as usize..((cell + 2).max(0) as usize).min(self.counts[axis])
        };
        let mut velocities = self.everywhere;
        for i in range(0) {
            for j in range(1) {
                let row = (i * self.counts[1] + j) * self.counts[2];
                for k in range(2) {
                    velocities = velocities.union(&self.velocities[row + k]);
                }
            }
        }
        if velocities.min[0] > velocities.max[0] {
            return LocalMotion { velocity: Vec3::zeros(), spread: 0.0, reach: self.cell };
        }
        let [min, max] = [velocities.min, velocities.max].map(|corner| Vec3::from(corner.map(f64::from)));
        LocalMotion { velocity: (min + max) * 0.5, spread: (max - min).norm() * 0.5, reach: self.cell }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::random::SplitMix64;
    use crate::geometry::testing::torus;

    #[test]
    fn every_point_near_a_place_moves_with_its_motion() {
        let (triangles, a) = torus(20, 0.9, 0.35);
        let turned = |p: &Vec3, angle: f64| {
            Vec3::new(angle.cos() * p.x - angle.sin() * p.z, p.y, angle.sin() * p.x + angle.cos() * p.z)
        };
        // A turn, a turn with a leap, and rest.
        for (angle, leap) in [(0.1, 0.0), (0.3, 5.0), (0.0, 0.0)] {
            let b: Vec<Vec3> = a.iter().map(|p| turned(p, angle) + Vec3::y() * leap).collect();
            let mut grid = MotionGrid::default();
            grid.set(&triangles, [&a, &b], 0.5);
            let mut random = SplitMix64::new(81);
            let mut near = 0;
            for round in 0..1000 {
                let on_path = a[round % a.len()].lerp(&b[round % a.len()], random.signed().abs());
                let place = on_path + random.vector() * 0.1;
                let motion = grid.around(&place);
                for (a, b) in a.iter().zip(&b) {
                    let velocity = (b - a) / 0.5;
                    assert!(velocity.norm() <= grid.fastest() * (1.0 + 1e-12));
                    let is_near = |share: f64| (a.lerp(b, share) - place).norm() < motion.reach;
                    if (0..=20).any(|k| is_near(f64::from(k) / 20.0)) {
                        near += 1;
                        assert!((velocity - motion.velocity).norm() <= motion.spread + 1e-12, "{place:?}");
                    }
                }
            }
            assert!(near > 100, "{near}");
            let far = grid.around(&Vec3::new(1e9, -1e9, 0.0));
            assert!(far.spread == 0.0 || leap > 0.0);
        }
    }
}
