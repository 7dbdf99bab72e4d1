//! Springs whose elastic force is implicit (`docs/theory/variants.md#fully-implicit`): to the damping matrix comes the
//! force's own derivative.
//!
//! With e the direction of a spring, l its length and k, c, l0 as ever, dF/dx on (x1, x2) is `-[K, -K; -K, K]` with
//! `K = k e eᵀ + k (1 - l0/l) (I - e eᵀ)`. Where the spring is shorter than at rest its second term is left out, so that the matrix
//! never adds energy.

use super::{NEIGHBOURS, PartMotion, PartSprings, ROW, Rows, Simd4, fetch};
use crate::Vec3;

impl Rows<'_, &[f64]> {
    /// Adds the product of every spring to its ends: along the spring as damping does, and across it.
    fn add_implicit<const N: usize>(&self, across: &[f64], x: &[Simd4], v: &[Simd4], f: &mut [Simd4]) {
        let (x, v) = (&x[..f.len()], &v[..f.len()]);
        let rows = self.vertices.iter().zip(self.others.as_chunks::<N>().0);
        let factors = self.scaled_damping.as_chunks::<N>().0.iter().zip(across.as_chunks::<N>().0);
        for ((i, others), (scaled, across)) in rows.zip(factors) {
            let i = usize::from(*i);
            let (xi, vi) = (x[i], v[i]);
            let mut sum = Simd4::ZERO;
            for n in 0..N {
                let j = usize::from(others[n]);
                let (u, change) = (xi - x[j], vi - v[j]);
                let force = u * (scaled[n] * u.dot(change)) + change * across[n];
                sum += force;
                f[j] += force;
            }
            f[i] -= sum;
        }
    }
}

impl PartSprings {
    /// Adds `over · K` to what damping was at the last update, at the same positions `x` [m]; `over` in s.
    pub(super) fn follow(&mut self, x: &[Vec3], over: f64) {
        let (mut scaled, mut across) = (std::mem::take(&mut self.scaled_damping), std::mem::take(&mut self.across));
        for (i, j, s, _) in self.ends() {
            let squared = (x[i] - x[j]).norm_squared();
            if squared > 0.0 {
                let stiffness = over * self.stiffness[s];
                across[s] = stiffness * (1.0 - self.rest_length[s] / squared.sqrt()).max(0.0);
                scaled[s] += (stiffness - across[s]) / squared;
            } else {
                across[s] = 0.0;
            }
        }
        (self.scaled_damping, self.across) = (scaled, across);
    }

    /// The products with damping and `over · K` together.
    pub(super) fn add_implicit(&self, motion: &PartMotion<'_>, f: &mut [Simd4]) {
        let (x, v) = (motion.own_x, motion.own_v);
        let mut first = 0;
        for (length, rows) in self.row_groups() {
            let across = &self.across[first..first + rows.others.len()];
            first += rows.others.len();
            match length {
                1 => rows.add_implicit::<1>(across, x, v, f),
                2 => rows.add_implicit::<2>(across, x, v, f),
                3 => rows.add_implicit::<3>(across, x, v, f),
                _ => rows.add_implicit::<ROW>(across, x, v, f),
            }
        }
        for (springs, neighbours) in self.border_groups() {
            let (far_x, far_v) = (fetch(neighbours, motion.x), fetch(neighbours, motion.v));
            let factors =
                self.scaled_damping[first..][springs.clone()].iter().zip(&self.across[first..][springs.clone()]);
            for ([i, j], (scaled, across)) in self.border[springs].iter().zip(factors) {
                let (i, j) = (usize::from(*i), usize::from(*j) % NEIGHBOURS);
                let (u, change) = (x[i] - far_x[j], v[i] - far_v[j]);
                f[i] -= u * (scaled * u.dot(change)) + change * *across;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::force::{ForceContext, PartView};
    use crate::effects::registry::build_all;
    use crate::mesh::PolygonMesh;
    use crate::parallel::parts::PART_SIZE;
    use crate::pins::PinTargets;
    use crate::scene::{EffectRequest, GarmentDescription, Integrator, Scene, SceneDescription};
    use crate::volumes::Volumes;
    use crate::wind_grid::WindGrid;

    /// An undamped sheet in two parts, stretched by a third, and uneven.
    fn scene() -> (Scene, Vec<Vec3>) {
        const N: usize = 50;
        let at = |k: usize| Vec3::new((k % N) as f64, 0.0, (k / N) as f64) * 0.01;
        let corners = (0..(N - 1) * N).filter(|k| k % N < N - 1).map(|k| k as u32);
        let triangles: Vec<_> =
            corners.flat_map(|k| [[k, k + N as u32, k + 1], [k + 1, k + N as u32, k + 1 + N as u32]]).collect();
        let mesh = PolygonMesh::from_triangles((0..N * N).map(at).collect(), &triangles);
        let mut description = SceneDescription::new("stretched");
        description.solver.integrator = Integrator::Implicit;
        description.garments.push(GarmentDescription::new("sheet", mesh, 0.2));
        let stretch = EffectRequest::of_garment("stretch", 0).with("stiffness", 200.0);
        description.effects.push(stretch.with("damping_ratio", 0.0));
        let scene = Scene::validate(description).unwrap_or_else(|problems| panic!("{problems}"));
        let mut x = scene.start_state()[0].clone();
        for (i, x) in x.iter_mut().enumerate() {
            let i = i as f64;
            *x = *x * 1.33 + Vec3::new((0.7 * i).sin(), (1.3 * i).cos(), (2.1 * i).sin()) * 5e-4;
        }
        (scene, x)
    }

    #[test]
    fn the_product_of_stretched_springs_is_the_derivative_of_their_force() {
        let (scene, x) = scene();
        let parts = scene.parts();
        assert!(parts.count() > 1, "some springs cross a border");
        let (targets, wind, volumes) = (PinTargets::default(), WindGrid::default(), Volumes::default());
        let around = ForceContext { time: 0.0, targets: &targets, v: &[], wind: &wind, volumes: &volumes };
        let v: Vec<Vec3> =
            (0..x.len()).map(|i| Vec3::new((3.0 * i as f64).sin(), (5.0 * i as f64).sin(), (i as f64).cos())).collect();
        let (over, moved) = (0.01, 1e-7);
        let place = |distance: f64| -> Vec<Vec3> { x.iter().zip(&v).map(|(x, v)| x + v * distance).collect() };
        let (before, after) = (place(-moved), place(moved));
        let effects = build_all(&scene).unwrap_or_else(|problems| panic!("{problems}"));
        for (part, mut force) in effects.into_iter().flat_map(|(_, effect)| effect.forces) {
            let range = parts.ranges()[part].clone();
            let mut force_at = |x: &[Vec3]| -> Vec<Vec3> {
                let masses = &scene.masses()[range.clone()];
                let view = PartView { start: range.start, masses, x, fraction: 0.0, around };
                let mut f = [Simd4::ZERO; PART_SIZE];
                let own: Vec<Simd4> = x[range.clone()].iter().map(Simd4::from).collect();
                force.update(&view, &own, &mut f[..range.len()]);
                force.linearise(&view, over);
                f[..range.len()].iter().map(|f| Vec3::from(*f)).collect()
            };
            let (lower, upper) = (force_at(&before), force_at(&after));
            force_at(&x);
            let mut product = [Simd4::ZERO; PART_SIZE];
            let product = &mut product[..range.len()];
            PartMotion::with(range, &x, &v, |motion| force.add_damping(motion, product));
            let largest = product.iter().map(|f| Vec3::from(*f).norm()).fold(0.0, f64::max);
            for (found, (lower, upper)) in product.iter().zip(lower.iter().zip(&upper)) {
                let expected = (upper - lower) * (over / (2.0 * moved));
                // Rounding over the way.
                assert!((Vec3::from(*found) - expected).norm() < 1e-6 * largest, "{found:?} for {expected:?}");
            }
        }
    }
}
