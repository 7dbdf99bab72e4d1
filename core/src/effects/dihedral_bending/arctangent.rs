//! The angle of a direction in the plane, without branches and tables, so that loops compute several at once.
//!
//! The standard library's arctangent calls the system's, which is another function on another processor.

use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI};

/// tan(π/8), up to which the series is used.
const TAN_PI_8: f64 = std::f64::consts::SQRT_2 - 1.0;

/// (1 - arctan(t)/t) / t² by powers of t², to the last bit up to 7/16: `s_atan.c` of Sun's FDLIBM 5.3.
const SERIES: [f64; 11] = [
    0.3333333333333293,
    -0.19999999999876483,
    0.14285714272503466,
    -0.11111110405462356,
    0.09090887133436507,
    -0.0769187620504483,
    0.06661073137387531,
    -0.058335701337905735,
    0.049768779946159324,
    -0.036531572744216916,
    0.016285820115365782,
];

/// The angle from the axis x to the direction (x, y) [rad], from -π to π, within 1e-15; zero for no direction.
#[inline(always)]
pub(super) fn arctangent(y: f64, x: f64) -> f64 {
    let is_steep = y.abs() > x.abs();
    let (low, high) = if is_steep { (x.abs(), y.abs()) } else { (y.abs(), x.abs()) };
    // tan(α - π/4) = (tan α - 1) / (tan α + 1), so that one division does.
    let is_turned = low > TAN_PI_8 * high;
    let (top, bottom) = if is_turned { (low - high, low + high) } else { (low, high) };
    let t = if bottom == 0.0 { 0.0 } else { top / bottom };
    let square = t * t;
    let fourth = square * square;
    let [a, b, c, d, e, f, g, h, i, j, k] = SERIES;
    let even = k.mul_add(fourth, i).mul_add(fourth, g).mul_add(fourth, e).mul_add(fourth, c).mul_add(fourth, a);
    let odd = j.mul_add(fourth, h).mul_add(fourth, f).mul_add(fourth, d).mul_add(fourth, b);
    let angle = t - t * (square * odd.mul_add(square, even));
    let angle = if is_turned { FRAC_PI_4 + angle } else { angle };
    let angle = if is_steep { FRAC_PI_2 - angle } else { angle };
    let angle = if x < 0.0 { PI - angle } else { angle };
    angle.copysign(y)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn angles_are_those_of_the_standard_library_to_rounding() {
        let mut random = crate::geometry::random::SplitMix64::new(3);
        let compare = |y: f64, x: f64| {
            let (found, expected) = (arctangent(y, x), y.atan2(x));
            assert!((found - expected).abs() <= 1e-15, "({x}, {y}): {found}, not {expected}");
            // Slight angles keep their digits.
            if x > 0.0 {
                assert!(
                    (found - expected).abs() <= 2.0 * f64::EPSILON * expected.abs(),
                    "({x}, {y}): {found}, {expected}"
                );
            }
        };
        for n in 0..200_000 {
            let angle = f64::from(n) * PI / 1e5;
            // Of any size, and close to the axes.
            let size = (40.0 * random.vector().x).exp();
            compare(size * angle.sin(), size * angle.cos());
            let slight = (40.0 * random.vector().x - 40.0).exp();
            [slight, -slight].into_iter().for_each(|slight| {
                compare(slight, size);
                compare(slight, -size);
                compare(size, slight);
            });
        }
    }

    #[test]
    fn directions_along_the_axes_are_exact_and_no_direction_is_zero() {
        let cases =
            [(0.0, 1.0, 0.0), (1.0, 0.0, FRAC_PI_2), (-1.0, 0.0, -FRAC_PI_2), (0.0, -1.0, PI), (-0.0, -1.0, -PI)];
        for (y, x, angle) in cases {
            assert_eq!(arctangent(y, x), angle);
        }
        assert_eq!(arctangent(1.0, 1.0), FRAC_PI_4);
        [0.0, -0.0].into_iter().for_each(|x| assert_eq!(arctangent(0.0, x), 0.0));
        assert!(arctangent(f64::NAN, 1.0).is_nan());
    }
}
