//! One triangle of a membrane: its stiffness, its strain, and what the strain does to the corners.
//!
//! Shape functions are linear, so the deformation gradient `F = u₁ g₁ᵀ + u₂ g₂ᵀ` is constant over the triangle: u are the
//! edges from corner 0 to the others, g the gradients of the corners' shape functions in the rest plane, along warp and weft.
//! `F = R U` splits it into orthonormal axes R and a symmetric stretch U; the strain is `U − 1`.

use nalgebra::{Matrix2, Matrix3, SymmetricEigen, Vector2};

use crate::Vec3;
use crate::effects::tensile_curve::TensileCurve;
use crate::parallel::simd4::Simd4;
use crate::tolerances::FLAT_TRIANGLE;

/// Stiffness of an orthotropic membrane [N/m]: the stress of the strains along warp and weft and of the shear between them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Moduli {
    warp: f64,
    weft: f64,
    /// Stress along one of them by strain along the other.
    across: f64,
    shear: f64,
}

impl Moduli {
    /// From the forces per width and strain of strips cut along warp and weft [N/m], the shear modulus [N/m], and the
    /// geometric mean of Poisson's two ratios, between -1 and 1.
    pub(super) fn new([warp, weft, shear]: [f64; 3], poisson: f64) -> Self {
        let over = 1.0 / (1.0 - poisson * poisson);
        Self { warp: warp * over, weft: weft * over, across: poisson * (warp * weft).sqrt() * over, shear }
    }

    /// Stress [N/m] along warp, weft and of shear, by strain along warp, weft and change of the angle between them.
    pub(super) fn stress(&self, [warp, weft, shear]: [f64; 3]) -> [f64; 3] {
        [self.warp * warp + self.across * weft, self.across * warp + self.weft * weft, self.shear * shear]
    }

    /// The same as a matrix.
    fn matrix(&self) -> Matrix3<f64> {
        Matrix3::new(self.warp, self.across, 0.0, self.across, self.weft, 0.0, 0.0, 0.0, self.shear)
    }

    /// Energy by area [J/m²].
    pub(super) fn energy(&self, strain: [f64; 3]) -> f64 {
        let stress = self.stress(strain);
        0.5 * (stress[0] * strain[0] + stress[1] * strain[1] + stress[2] * strain[2])
    }
}

/// A membrane's law: what linear cloth resists with, and how it stiffens as it is pulled along warp and weft.
#[derive(Debug, Clone, Copy)]
pub(super) struct Law {
    pub(super) moduli: Moduli,
    /// For warp and weft: force by strain of a pulled strip [N/m], and its curve over that.
    pub(super) curves: [Option<(f64, TensileCurve)>; 2],
}

impl Law {
    /// Stress [N/m] along warp, weft and of shear, by the strains.
    pub(super) fn stress(&self, strain: [f64; 3]) -> [f64; 3] {
        let mut stress = self.moduli.stress(strain);
        for ((stress, strain), curve) in stress.iter_mut().zip(strain).zip(&self.curves) {
            if let Some((modulus, curve)) = curve.as_ref().filter(|_| strain > 0.0) {
                *stress += modulus * strain * (curve.factor(strain) - 1.0);
            }
        }
        stress
    }

    /// Energy by area [J/m²].
    pub(super) fn energy(&self, strain: [f64; 3]) -> f64 {
        let stiffened = self.curves.iter().zip(strain).filter_map(|(curve, strain)| {
            let (modulus, curve) = curve.as_ref()?;
            Some(modulus * curve.extra_energy(strain))
        });
        stiffened.fold(self.moduli.energy(strain), |energy, more| energy + more)
    }

    /// Returns the increase of the slopes of stress by strain along warp and weft by the curves [N/m].
    fn rises(&self, strain: [f64; 3]) -> [f64; 2] {
        [0, 1].map(|axis| self.curves[axis].as_ref().map_or(0.0, |(modulus, curve)| modulus * curve.rise(strain[axis])))
    }
}

/// Gradients of the shape functions of corners 1 and 2 along warp and weft [1/m]; that of corner 0 is minus their sum.
pub(super) type Gradients = [[f64; 2]; 2];

/// The gradients of a triangle with these corners at rest [m], whose warp lies along `warp` as far as its plane allows, and
/// its area [m²].
pub(super) fn gradients(corners: [Vec3; 3], warp: Vec3) -> (Gradients, f64) {
    let u = [corners[1] - corners[0], corners[2] - corners[0]];
    let normal = u[0].cross(&u[1]);
    let area = 0.5 * normal.norm();
    // Scene::validate refuses triangles without area, and the caller a warp that stands upright on the triangle.
    let normal = normal / (2.0 * area);
    let warp = (warp - normal * normal.dot(&warp)).normalize();
    let weft = normal.cross(&warp);
    let [a, b] = u.map(|u| [u.dot(&warp), u.dot(&weft)]);
    let over = 1.0 / (a[0] * b[1] - a[1] * b[0]);
    ([[b[1] * over, -b[0] * over], [-a[1] * over, a[0] * over]], area)
}

/// The edges at rest from corner 0 to 1, from 0 to 2, and from 1 to 2 [m] along warp and weft.
pub(super) fn rest_edges([a, b]: &Gradients) -> [[f64; 2]; 3] {
    let over = 1.0 / (a[0] * b[1] - a[1] * b[0]);
    // The matrices of edges and of gradients are each other's inverse transpose.
    let [first, second] = [[b[1] * over, -b[0] * over], [-a[1] * over, a[0] * over]];
    [first, second, [second[0] - first[0], second[1] - first[1]]]
}

/// Largest stiffness by area [N/m³] that any motion of the corners meets: the largest eigenvalue of the triangle's stiffness
/// matrix at rest, by its area.
pub(super) fn largest_stiffness(gradients: &Gradients, moduli: &Moduli) -> f64 {
    let [a, b] = gradients;
    let corners = [[-a[0] - b[0], -a[1] - b[1]], *a, *b];
    let sum = |of: fn([f64; 2]) -> f64| corners.map(of).iter().sum::<f64>();
    let (xx, xy, yy) = (sum(|g| g[0] * g[0]), sum(|g| g[0] * g[1]), sum(|g| g[1] * g[1]));
    let strains = Matrix3::new(xx, 0.0, xy, 0.0, yy, xy, xy, xy, xx + yy);
    let root = root(moduli);
    (root.transpose() * strains * root).symmetric_eigenvalues().max()
}

/// A matrix L with L Lᵀ the moduli.
fn root(moduli: &Moduli) -> Matrix3<f64> {
    let first = moduli.warp.sqrt();
    let across = if first > 0.0 { moduli.across / first } else { 0.0 };
    let second = (moduli.weft - across * across).max(0.0).sqrt();
    Matrix3::new(first, 0.0, 0.0, across, second, 0.0, 0.0, 0.0, moduli.shear.sqrt())
}

/// Orientation of a deformed triangle: all that rates of strain and forces need.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Frame {
    /// Directions to which warp and weft of the triangle at rest have been turned.
    axes: [Simd4; 2],
    /// Shear, and difference between the stretches, both by the sum of the stretches: what a turn within the triangle's plane
    /// does to the strain.
    turn: [f64; 2],
}

impl Frame {
    /// The frame and the strain of a triangle with edges `u` from corner 0 to the others [m].
    ///
    /// A triangle that has collapsed to a line has a known direction only along the line, and pushes along it alone;
    /// one that has collapsed to a point has no direction at all and does not push.
    pub(super) fn of([a, b]: &Gradients, u: [Vec3; 2]) -> (Self, [f64; 3]) {
        let f = [u[0] * a[0] + u[1] * b[0], u[0] * a[1] + u[1] * b[1]];
        let (xx, xy, yy) = (f[0].norm_squared(), f[0].dot(&f[1]), f[1].norm_squared());
        let normal = f[0].cross(&f[1]);
        let area = normal.norm();
        // The polar factor is the sum of F and its cofactors, by the sum of the stretches.
        let trace = (xx + yy + 2.0 * area).sqrt();
        if trace == 0.0 {
            return (Self::default(), [-1.0, -1.0, 0.0]);
        }
        let is_flat = area <= FLAT_TRIANGLE * (xx + yy);
        let normal = if is_flat { Vec3::zeros() } else { normal / area };
        let over = 1.0 / trace;
        let axes = [(f[0] + f[1].cross(&normal)) * over, (f[1] + normal.cross(&f[0])) * over];
        let strain = [(xx + area) * over - 1.0, (yy + area) * over - 1.0, 2.0 * xy * over];
        let turn = [0.5 * strain[2] * over, (strain[0] - strain[1]) * over];
        (Self { axes: axes.map(|axis| Simd4::from(&axis)), turn }, strain)
    }

    /// Rates of strain [1/s] of corners that move with `v` relative to corner 0 [m/s].
    pub(super) fn rates(&self, [a, b]: &Gradients, v: [Simd4; 2]) -> [f64; 3] {
        let f = [v[0] * a[0] + v[1] * b[0], v[0] * a[1] + v[1] * b[1]];
        let [along, across] = self.axes;
        let sides = [along.dot(f[1]), across.dot(f[0])];
        // A turn in the plane is no strain; what it looks like is taken out.
        let turn = sides[0] - sides[1];
        let bent = self.turn[0] * turn;
        [along.dot(f[0]) - bent, across.dot(f[1]) + bent, sides[0] + sides[1] + self.turn[1] * turn]
    }

    /// Returns the forces on corners 1 and 2 [N] by stresses, as forces by the corners' strain [N m]: the transpose
    /// of [`rates`](Self::rates). Corner 0 gets minus their sum.
    pub(super) fn forces(&self, gradients: &Gradients, [warp, weft, shear]: [f64; 3]) -> [Simd4; 2] {
        let turn = self.turn[0] * (weft - warp) + self.turn[1] * shear;
        let [along, across] = self.axes;
        let columns = [along * warp + across * (shear - turn), along * (shear + turn) + across * weft];
        gradients.map(|g| columns[0] * g[0] + columns[1] * g[1])
    }
}

/// Resistance of a strained triangle to displacements of its corners, by area: the blocks of a stiffness matrix.
pub(super) struct Blocks {
    /// Strain by the displacement of each corner [1/m]: a column for each axis.
    strains: [Matrix3<f64>; 3],
    /// Unit normal; zero where the triangle is a line.
    normal: Vec3,
    /// Resistance of each pair of corners to displacements across the triangle [N/m³]: (0, 1), (0, 2), (1, 2).
    across: [f64; 3],
    /// Increase of the moduli along warp and weft by stiffening [N/m].
    rises: [f64; 2],
}

impl Blocks {
    /// The blocks in the frame and strain of [`Frame::of`], where the stress is `stress` [N/m].
    pub(super) fn new(frame: &Frame, gradients: &Gradients, strain: [f64; 3], law: &Law) -> Self {
        let (stress, rises) = (law.stress(strain), law.rises(strain));
        let axis = |k: usize| Simd4::from(&Vec3::ith(k, 1.0));
        let of_corner = |moved: &dyn Fn(Simd4) -> [Simd4; 2]| {
            Matrix3::from_columns(&[0, 1, 2].map(|k| Vec3::from(frame.rates(gradients, moved(axis(k))))))
        };
        let [second, third] = [of_corner(&|v| [v, Simd4::ZERO]), of_corner(&|v| [Simd4::ZERO, v])];
        let [along, other] = frame.axes.map(Vec3::from);
        // Across itself a triangle resists by the tension in it alone: U⁻¹σ, of which pressure is left out, as it has the other
        // sign.
        let stretch = Matrix2::new(1.0 + strain[0], 0.5 * strain[2], 0.5 * strain[2], 1.0 + strain[1]);
        let stress = Matrix2::new(stress[0], stress[2], stress[2], stress[1]);
        let tension = stretch.try_inverse().map_or(Matrix2::zeros(), |inverse| {
            let product = inverse * stress;
            let eigen = SymmetricEigen::new((product + product.transpose()) * 0.5);
            let positive = Matrix2::from_diagonal(&eigen.eigenvalues.map(|value| value.max(0.0)));
            eigen.eigenvectors * positive * eigen.eigenvectors.transpose()
        });
        let [g1, g2] = gradients.map(|g| Vector2::new(g[0], g[1]));
        let g = [-g1 - g2, g1, g2];
        let across = [[0, 1], [0, 2], [1, 2]].map(|[a, b]| g[a].dot(&(tension * g[b])));
        let normal = along.cross(&other).try_normalize(0.0).unwrap_or_default();
        Self { strains: [-second - third, second, third], normal, across, rises }
    }

    /// Minus the blocks of the pairs (0, 1), (0, 2) and (1, 2): `elastic` times the moduli, and `tension` times what resists
    /// across and what stiffening adds.
    pub(super) fn couplings(&self, moduli: &Moduli, elastic: f64, tension: f64) -> [Matrix3<f64>; 3] {
        let mut moduli = moduli.matrix() * -elastic;
        self.rises.iter().enumerate().for_each(|(axis, rise)| moduli[(axis, axis)] -= tension * rise);
        let across = self.normal * self.normal.transpose() * -tension;
        let pairs = [[0, 1], [0, 2], [1, 2]].into_iter().zip(self.across);
        let mut blocks = [Matrix3::zeros(); 3];
        for (block, ([a, b], factor)) in blocks.iter_mut().zip(pairs) {
            *block = self.strains[a].transpose() * moduli * self.strains[b] + across * factor;
        }
        blocks
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Rotation3;

    use super::*;

    const CLOTH: [f64; 3] = [500.0, 100.0, 30.0];

    fn at_rest() -> ([Vec3; 3], Gradients, f64) {
        let corners = [Vec3::new(0.1, 0.0, 0.2), Vec3::new(0.13, 0.0, 0.21), Vec3::new(0.105, 0.0, 0.16)];
        let (gradients, area) = gradients(corners, Vec3::new(1.0, 0.3, 0.5));
        (corners, gradients, area)
    }

    fn edges(x: &[Vec3; 3]) -> [Vec3; 2] {
        [x[1] - x[0], x[2] - x[0]]
    }

    /// Energy by area, and minus its slope by the corners' places.
    fn pull(x: &[Vec3; 3], gradients: &Gradients, moduli: &Moduli) -> (f64, [Vec3; 3]) {
        let (frame, strain) = Frame::of(gradients, edges(x));
        let [b, c] = frame.forces(gradients, moduli.stress(strain)).map(Vec3::from);
        (moduli.energy(strain), [b + c, -b, -c])
    }

    /// Rest shapes turned, stretched, sheared and squeezed, the last almost flat.
    fn deformed() -> Vec<[Vec3; 3]> {
        let (rest, ..) = at_rest();
        let shapes = [
            nalgebra::Matrix3::identity(),
            nalgebra::Matrix3::new(1.2, 0.1, 0.3, 0.0, 1.0, -0.1, -0.2, 0.4, 0.8),
            nalgebra::Matrix3::new(0.4, 0.0, 1.1, 0.2, 0.0, 0.9, 0.1, 0.3, -0.7),
            nalgebra::Matrix3::new(3.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.01),
        ];
        let turn = Rotation3::new(Vec3::new(0.3, -1.0, 2.0));
        shapes.iter().map(|shape| rest.map(|x| turn * (shape * x))).collect()
    }

    #[test]
    fn a_pulled_strip_carries_its_modulus_times_the_strain_and_narrows_by_poisson_s_ratio() {
        let moduli = Moduli::new(CLOTH, 0.3);
        for (axis, along) in CLOTH[..2].iter().enumerate() {
            // Poisson's ratios obey ν₁₂ / E₁ = ν₂₁ / E₂, with 0.3 as their geometric mean.
            let ratio = 0.3 * (along / CLOTH[1 - axis]).sqrt();
            let mut strain = [-0.02 * ratio; 3];
            (strain[axis], strain[2]) = (0.02, 0.01);
            let stress = moduli.stress(strain);
            assert!((stress[axis] / (0.02 * along) - 1.0).abs() < 1e-14, "{stress:?}");
            assert!(stress[1 - axis].abs() < 1e-13 && (stress[2] / (0.01 * CLOTH[2]) - 1.0).abs() < 1e-14);
        }
    }

    #[test]
    fn forces_are_the_slope_of_the_energy_at_any_deformation() {
        let ((_, gradients, _), moduli) = (at_rest(), Moduli::new(CLOTH, 0.3));
        for x in deformed() {
            let (_, forces) = pull(&x, &gradients, &moduli);
            let scale = CLOTH[0] / 0.03;
            for (corner, axis) in (0..9).map(|k| (k / 3, k % 3)) {
                let energy = |distance: f64| {
                    let mut moved = x;
                    moved[corner][axis] += distance;
                    pull(&moved, &gradients, &moduli).0
                };
                // Central difference over a millionth of an edge; its own error is of that order squared.
                let slope = (energy(3e-8) - energy(-3e-8)) / 6e-8;
                assert!((forces[corner][axis] + slope).abs() < 1e-6 * scale, "{forces:?}, {slope}");
            }
        }
    }

    #[test]
    fn a_turned_triangle_has_the_same_energy_turned_forces_and_no_force_or_torque_on_itself() {
        let ((_, gradients, _), moduli) = (at_rest(), Moduli::new(CLOTH, 0.3));
        let turn = Rotation3::new(Vec3::new(1.0, 2.0, -0.7));
        for x in deformed() {
            let (energy, forces) = pull(&x, &gradients, &moduli);
            let (turned_energy, turned) = pull(&x.map(|x| turn * x + Vec3::x()), &gradients, &moduli);
            let scale = CLOTH[0] / 0.03;
            assert!((energy - turned_energy).abs() <= 1e-12 * (energy + CLOTH[0]));
            assert!((0..3).all(|c| (turn * forces[c] - turned[c]).norm() < 1e-11 * scale), "{forces:?} {turned:?}");
            let torque: Vec3 = (0..3).map(|c| x[c].cross(&forces[c])).sum();
            assert!(forces.iter().sum::<Vec3>().norm() < 1e-12 * scale && torque.norm() < 1e-12 * scale);
        }
    }

    #[test]
    fn a_strained_triangle_that_turns_as_a_whole_has_no_rate_of_strain() {
        let (_, gradients, _) = at_rest();
        for x in deformed() {
            let (frame, _) = Frame::of(&gradients, edges(&x));
            let turning = edges(&x).map(|u| Simd4::from(&Vec3::new(0.4, -2.0, 1.1).cross(&u)));
            assert!(frame.rates(&gradients, turning).iter().all(|rate| rate.abs() < 1e-12));
        }
    }

    #[test]
    fn a_triangle_collapsed_to_a_line_or_a_point_has_finite_forces_along_what_is_left() {
        let ((rest, gradients, _), moduli) = (at_rest(), Moduli::new(CLOTH, 0.3));
        let line = Vec3::new(1.0, 2.0, -2.0) / 3.0;
        for x in [rest.map(|x| line * (x.x - 2.0 * x.z)), [rest[0]; 3], [rest[0], rest[1], rest[1]]] {
            let (energy, forces) = pull(&x, &gradients, &moduli);
            assert!(energy.is_finite() && energy > 0.0);
            let bound = 3.0 * CLOTH[0] / 0.03;
            assert!(forces.iter().all(|f| f.norm() < bound), "{forces:?}");
            let [a, b] = edges(&x);
            let along = if a.norm() > b.norm() { a } else { b };
            let off_line = |f: &Vec3| f.cross(&along).norm() <= 1e-6 * bound * along.norm();
            assert!(forces.iter().all(off_line), "{forces:?}");
        }
    }

    #[test]
    fn no_motion_of_the_corners_meets_more_than_the_largest_stiffness() {
        let ((rest, gradients, _), moduli) = (at_rest(), Moduli::new(CLOTH, 0.3));
        let (frame, _) = Frame::of(&gradients, edges(&rest));
        let bound = largest_stiffness(&gradients, &moduli);
        let mut largest = 0.0_f64;
        let mut v = [Vec3::new(0.2, 0.5, -1.0), Vec3::new(1.0, 0.1, 0.4), Vec3::new(-0.6, 0.2, 0.3)];
        // Power iteration of the stiffness matrix at rest.
        for _ in 0..200 {
            let rates = frame.rates(&gradients, [v[1] - v[0], v[2] - v[0]].map(|v| Simd4::from(&v)));
            let [b, c] = frame.forces(&gradients, moduli.stress(rates)).map(Vec3::from);
            let (before, after) = (v.iter().map(Vec3::norm_squared).sum::<f64>(), [-b - c, b, c]);
            largest = largest.max((0..3).map(|k| v[k].dot(&after[k])).sum::<f64>() / before);
            let length = after.iter().map(Vec3::norm_squared).sum::<f64>().sqrt();
            v = after.map(|v| v / length);
        }
        assert!((largest / bound - 1.0).abs() < 1e-9, "{largest} {bound}");
    }

    #[test]
    fn edges_at_rest_are_those_of_the_triangle() {
        let (rest, gradients, _) = at_rest();
        let lengths = [[0, 1], [0, 2], [1, 2]].map(|[a, b]| (rest[a] - rest[b]).norm());
        for (edge, length) in rest_edges(&gradients).iter().zip(lengths) {
            assert!((edge[0].hypot(edge[1]) - length).abs() < 1e-15);
        }
    }
}
