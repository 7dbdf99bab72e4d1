//! Signed distance fields: negative inside, positive outside, in metres.
//!
//! Limbs are round cones and ellipsoids joined by a smooth minimum. A blend is not a distance any more, so offsets are
//! measured to first order, value / |gradient|, which is exact on the surface and good to a few percent near it.

use nalgebra::{Unit, UnitQuaternion};

/// A point or direction in metres, y up.
pub type Vec3 = nalgebra::Vector3<f64>;

/// Any signed field \[m\] over space.
pub type Field<'a> = dyn Fn(&Vec3) -> f64 + Sync + 'a;

/// Step of the central differences \[m\]: small against every radius, large against rounding.
const GRADIENT_STEP: f64 = 1e-5;

/// One building block of a body or garment.
#[derive(Debug, Clone, Copy)]
pub enum Shape {
    /// The union of all spheres whose centre runs from one end to the other while the radius changes linearly.
    RoundCone {
        /// Centres of the end spheres \[m\].
        ends: [Vec3; 2],
        /// Radii of the end spheres \[m\]; they differ by less than the length.
        radii: [f64; 2],
    },
    /// An ellipsoid.
    Ellipsoid {
        /// Centre \[m\].
        center: Vec3,
        /// Semi-axes \[m\], along x, y, z before the rotation.
        radii: Vec3,
        /// Turns the axes into place.
        rotation: UnitQuaternion<f64>,
    },
}

impl Shape {
    /// Signed distance \[m\]: exact for round cones, first order for ellipsoids.
    pub fn distance(&self, p: &Vec3) -> f64 {
        match self {
            Shape::RoundCone { ends, radii } => round_cone(p, ends, radii),
            Shape::Ellipsoid { center, radii, rotation } => {
                let q = rotation.inverse_transform_vector(&(p - center));
                let scaled = q.component_div(radii).norm();
                let slope = q.component_div(&radii.component_mul(radii)).norm();
                // At the very centre the quotient has no limit; any value at least this deep will do.
                if slope < 1e-9 { -radii.min() } else { scaled * (scaled - 1.0) / slope }
            }
        }
    }

    /// Box that holds the shape: lower and upper corner \[m\].
    pub fn bounds(&self) -> (Vec3, Vec3) {
        match self {
            Shape::RoundCone { ends, radii } => {
                let reach = |i: usize, sign: f64| ends[i].add_scalar(sign * radii[i]);
                (reach(0, -1.0).inf(&reach(1, -1.0)), reach(0, 1.0).sup(&reach(1, 1.0)))
            }
            Shape::Ellipsoid { center, radii, .. } => (center.add_scalar(-radii.max()), center.add_scalar(radii.max())),
        }
    }
}

/// Distance to a round cone: minimise |p - c(h)| - r(h) over the sphere parameter h; the condition that the derivative
/// vanishes gives h in closed form.
fn round_cone(p: &Vec3, ends: &[Vec3; 2], radii: &[f64; 2]) -> f64 {
    let (axis, length) = Unit::new_and_get(ends[1] - ends[0]);
    let from_start = p - ends[0];
    let along = from_start.dot(&axis);
    let across = (from_start - axis.into_inner() * along).norm();
    let sine = (radii[0] - radii[1]) / length;
    let h = ((along - across * sine / (1.0 - sine * sine).sqrt()) / length).clamp(0.0, 1.0);
    (along - h * length).hypot(across) - radii[0] - h * (radii[1] - radii[0])
}

/// Smooth minimum of two distances with continuous second derivative; equal to the minimum when they differ by more
/// than `blend` \[m\], and at most `blend / 6` below it.
pub fn smooth_min(a: f64, b: f64, blend: f64) -> f64 {
    let h = (blend - (a - b).abs()).max(0.0) / blend;
    a.min(b) - h * h * h * blend / 6.0
}

/// Central-difference gradient of a field \[1\].
pub fn gradient(field: &Field, p: &Vec3) -> Vec3 {
    Vec3::from_fn(|axis, _| {
        let mut step = Vec3::zeros();
        step[axis] = GRADIENT_STEP;
        (field(&(p + step)) - field(&(p - step))) / (2.0 * GRADIENT_STEP)
    })
}

/// Moves `p` onto the zero level of `field` by Newton steps along the gradient, to 1e-9 m or the number of steps given.
pub fn project(field: &Field, p: &Vec3, steps: usize) -> Vec3 {
    let mut q = *p;
    for _ in 0..steps {
        let value = field(&q);
        if value.abs() < 1e-9 {
            break;
        }
        let g = gradient(field, &q);
        q -= g * (value / g.norm_squared().max(1e-6));
    }
    q
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_round_cone_is_as_far_as_the_nearest_of_its_spheres() {
        let ends = [Vec3::new(0.1, 0.2, -0.1), Vec3::new(0.4, -0.1, 0.2)];
        let radii = [0.12, 0.05];
        let shape = Shape::RoundCone { ends, radii };
        for p in [Vec3::new(0.5, 0.5, 0.0), Vec3::new(-0.3, 0.1, 0.2), Vec3::new(0.2, 0.1, 0.4)] {
            let nearest = (0..=100_000)
                .map(|i| {
                    let h = i as f64 * 1e-5;
                    (p - ends[0].lerp(&ends[1], h)).norm() - radii[0] - h * (radii[1] - radii[0])
                })
                .fold(f64::INFINITY, f64::min);
            // The samples are 5 um apart; the minimum is flat there.
            assert!((shape.distance(&p) - nearest).abs() < 1e-9);
        }
    }

    #[test]
    fn the_smooth_minimum_is_the_minimum_outside_its_blend() {
        assert_eq!(smooth_min(0.3, 0.1, 0.2), 0.1);
        assert!((smooth_min(0.1, 0.1, 0.06) - 0.09).abs() < 1e-15);
    }

    #[test]
    fn projection_reaches_the_surface() {
        let ball = |p: &Vec3| p.norm_squared() - 0.25;
        let on = project(&ball, &Vec3::new(0.3, 0.7, -0.2), 20);
        assert!((on.norm() - 0.5).abs() < 1e-8);
    }
}
