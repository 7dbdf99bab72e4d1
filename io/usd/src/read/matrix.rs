//! Matrices of 4×4 for row vectors, `p' = p M`, as USD has them: row by row, translation in elements 12 to 14.

/// A matrix, row by row.
pub(crate) type Matrix = [f64; 16];

/// The matrix that changes nothing.
pub(crate) const IDENTITY: Matrix = [1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1.];

/// A rotation as a unit quaternion: w, x, y, z.
pub(crate) type Quaternion = [f64; 4];

/// `a b`: for row vectors, the map that applies `a` first.
pub(crate) fn multiply(a: &Matrix, b: &Matrix) -> Matrix {
    std::array::from_fn(|i| (0..4).map(|k| a[i / 4 * 4 + k] * b[k * 4 + i % 4]).sum())
}

/// `p M` for a point, without the projective division: transforms of scenes are affine.
pub(crate) fn transform_point(p: [f64; 3], m: &Matrix) -> [f64; 3] {
    std::array::from_fn(|i| p[0] * m[i] + p[1] * m[4 + i] + p[2] * m[8 + i] + m[12 + i])
}

/// A translation.
pub(crate) fn translation(t: [f64; 3]) -> Matrix {
    let mut matrix = IDENTITY;
    matrix[12..15].copy_from_slice(&t);
    matrix
}

/// A scale along the axes.
pub(crate) fn scale(s: [f64; 3]) -> Matrix {
    let mut matrix = IDENTITY;
    (0..3).for_each(|axis| matrix[5 * axis] = s[axis]);
    matrix
}

/// A rotation about the axis 0, 1 or 2, counter-clockwise as seen from its tip [degrees].
pub(crate) fn rotation(axis: usize, degrees: f64) -> Matrix {
    let (sin, cos) = degrees.to_radians().sin_cos();
    let (a, b) = ((axis + 1) % 3, (axis + 2) % 3);
    let mut matrix = IDENTITY;
    matrix[4 * a + a] = cos;
    matrix[4 * a + b] = sin;
    matrix[4 * b + a] = -sin;
    matrix[4 * b + b] = cos;
    matrix
}

/// A rotation by a quaternion, which is made one of unit length; one of length zero turns nothing.
pub(crate) fn from_quaternion(q: Quaternion) -> Matrix {
    let length = q.iter().map(|x| x * x).sum::<f64>().sqrt();
    if length == 0.0 {
        return IDENTITY;
    }
    from_quaternion_as_is(q.map(|component| component / length))
}

/// The same for a quaternion that is taken to be of unit length, as places of instances are: one in half precision is not, and shears
/// a little.
pub(crate) fn from_quaternion_as_is([w, x, y, z]: Quaternion) -> Matrix {
    let mut matrix = IDENTITY;
    matrix[..3].copy_from_slice(&[1. - 2. * (y * y + z * z), 2. * (x * y + w * z), 2. * (x * z - w * y)]);
    matrix[4..7].copy_from_slice(&[2. * (x * y - w * z), 1. - 2. * (x * x + z * z), 2. * (y * z + w * x)]);
    matrix[8..11].copy_from_slice(&[2. * (x * z + w * y), 2. * (y * z - w * x), 1. - 2. * (x * x + y * y)]);
    matrix
}

/// Volume of the unit cube under the linear part; negative for a mirror.
pub(crate) fn determinant(m: &Matrix) -> f64 {
    m[0] * (m[5] * m[10] - m[6] * m[9]) - m[1] * (m[4] * m[10] - m[6] * m[8]) + m[2] * (m[4] * m[9] - m[5] * m[8])
}

/// The inverse, by elimination with pivots; `None` when the matrix flattens space.
pub(crate) fn inverse(m: &Matrix) -> Option<Matrix> {
    let mut left = *m;
    let mut right = IDENTITY;
    for column in 0..4 {
        let pivot = (column..4).max_by(|a, b| left[4 * a + column].abs().total_cmp(&left[4 * b + column].abs()))?;
        let divisor = left[4 * pivot + column];
        if divisor == 0.0 || !divisor.is_finite() {
            return None;
        }
        for k in 0..4 {
            left.swap(4 * column + k, 4 * pivot + k);
            right.swap(4 * column + k, 4 * pivot + k);
            left[4 * column + k] /= divisor;
            right[4 * column + k] /= divisor;
        }
        for row in (0..4).filter(|row| *row != column) {
            let factor = left[4 * row + column];
            for k in 0..4 {
                left[4 * row + k] -= factor * left[4 * column + k];
                right[4 * row + k] -= factor * right[4 * column + k];
            }
        }
    }
    right.iter().all(|x| x.is_finite()).then_some(right)
}

/// The linear part as a stretch and then a rotation, `L = S R`: the polar decomposition. The stretch is symmetric, and negative
/// when the matrix mirrors, so that the rotation is one.
pub(crate) fn stretch_and_rotation(m: &Matrix) -> ([[f64; 3]; 3], Quaternion) {
    let row = |i: usize| [m[4 * i], m[4 * i + 1], m[4 * i + 2]];
    let linear = [row(0), row(1), row(2)];
    let dot = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    // L Lᵀ = S R Rᵀ S = S².
    let square = std::array::from_fn(|i| std::array::from_fn(|j| dot(linear[i], linear[j])));
    let (values, axes) = eigen(square);
    let sign = if determinant(m) < 0.0 { -1.0 } else { 1.0 };
    let stretches = values.map(|value| sign * value.max(0.0).sqrt());
    let compose = |of: [f64; 3]| -> [[f64; 3]; 3] {
        std::array::from_fn(|i| std::array::from_fn(|j| (0..3).map(|k| axes[i][k] * of[k] * axes[j][k]).sum()))
    };
    let stretch = compose(stretches);
    // A direction that is flattened has no rotation; it keeps that of the others.
    let undo = compose(stretches.map(|s| if s == 0.0 { 0.0 } else { 1.0 / s }));
    let turned = std::array::from_fn(|i| std::array::from_fn(|j| (0..3).map(|k| undo[i][k] * linear[k][j]).sum()));
    (stretch, to_quaternion(turned))
}

/// Eigenvalues and eigenvectors (in columns) of a symmetric matrix, by Jacobi's rotations.
fn eigen(mut a: [[f64; 3]; 3]) -> ([f64; 3], [[f64; 3]; 3]) {
    let mut axes = [[1., 0., 0.], [0., 1., 0.], [0., 0., 1.]];
    // Each sweep squares what is left beside the diagonal; ten are far more than double precision needs.
    for _ in 0..10 {
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            if a[p][q] == 0.0 {
                continue;
            }
            let theta = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
            let t = theta.signum() / (theta.abs() + theta.hypot(1.0));
            let c = 1.0 / t.hypot(1.0);
            let s = t * c;
            for row in &mut a {
                (row[p], row[q]) = (c * row[p] - s * row[q], s * row[p] + c * row[q]);
            }
            for k in 0..3 {
                (a[p][k], a[q][k]) = (c * a[p][k] - s * a[q][k], s * a[p][k] + c * a[q][k]);
                (axes[k][p], axes[k][q]) = (c * axes[k][p] - s * axes[k][q], s * axes[k][p] + c * axes[k][q]);
            }
        }
    }
    ([a[0][0], a[1][1], a[2][2]], axes)
}

/// The quaternion of a rotation matrix for row vectors.
fn to_quaternion(r: [[f64; 3]; 3]) -> Quaternion {
    let trace = r[0][0] + r[1][1] + r[2][2];
    let q = if trace > 0.0 {
        let w = (1.0 + trace).sqrt() / 2.0;
        [w, (r[1][2] - r[2][1]) / (4. * w), (r[2][0] - r[0][2]) / (4. * w), (r[0][1] - r[1][0]) / (4. * w)]
    } else {
        // The largest of x, y and z, so that nothing small is divided by.
        let i = (0..3).max_by(|a, b| r[*a][*a].total_cmp(&r[*b][*b])).unwrap_or(0);
        let (j, k) = ((i + 1) % 3, (i + 2) % 3);
        let largest = (1.0 + r[i][i] - r[j][j] - r[k][k]).max(0.0).sqrt() / 2.0;
        let mut q = [(r[j][k] - r[k][j]) / (4. * largest), 0., 0., 0.];
        q[1 + i] = largest;
        q[1 + j] = (r[i][j] + r[j][i]) / (4. * largest);
        q[1 + k] = (r[i][k] + r[k][i]) / (4. * largest);
        q
    };
    if q.iter().all(|x| x.is_finite()) { q } else { [1., 0., 0., 0.] }
}

/// `a b`, the product of two quaternions.
pub(crate) fn quaternion_product(a: Quaternion, b: Quaternion) -> Quaternion {
    [
        a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
        a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
        a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
        a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn assert_close(a: &[f64], b: &[f64]) {
        assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-12), "{a:?} instead of {b:?}");
    }

    #[test]
    fn rotations_turn_the_next_axis_to_the_one_after_it() {
        assert_close(&transform_point([0., 1., 0.], &rotation(0, 90.)), &[0., 0., 1.]);
        assert_close(&transform_point([0., 0., 1.], &rotation(1, 90.)), &[1., 0., 0.]);
        assert_close(&transform_point([1., 0., 0.], &rotation(2, 90.)), &[0., 1., 0.]);
        let half = 0.5_f64.sqrt();
        assert_close(&from_quaternion([half, 0., 0., half]), &rotation(2, 90.));
    }

    #[test]
    fn an_inverse_undoes_and_a_flat_matrix_has_none() {
        let m = multiply(&scale([2., -3., 0.5]), &multiply(&rotation(1, 33.), &translation([1., 2., 3.])));
        assert_close(&multiply(&m, &inverse(&m).unwrap()), &IDENTITY);
        assert!((determinant(&m) + 3.0).abs() < 1e-12);
        assert!(inverse(&scale([1., 0., 1.])).is_none());
    }

    #[test]
    fn stretch_and_rotation_compose_to_the_matrix_and_the_rotation_is_one() {
        let turn = multiply(&rotation(0, 200.), &rotation(2, 77.));
        for stretch in [[1., 1., 1.], [2., 0.5, 3.], [-1., -2., -0.5]] {
            let (s, q) = stretch_and_rotation(&multiply(&scale(stretch), &turn));
            let s = [s[0][0], s[0][1], s[0][2], 0., s[1][0], s[1][1], s[1][2], 0., s[2][0], s[2][1], s[2][2], 0.];
            let mut linear = IDENTITY;
            linear[..12].copy_from_slice(&s);
            assert_close(&multiply(&linear, &from_quaternion(q)), &multiply(&scale(stretch), &turn));
            assert_close(&linear, &scale(stretch));
            // Whatever the axes of the stretch are, it is symmetric.
            let skewed = multiply(&scale([1., 2., 0.5]), &multiply(&turn, &scale(stretch)));
            let (s, q) = stretch_and_rotation(&skewed);
            assert_close(
                &s.concat(),
                &[s[0][0], s[1][0], s[2][0], s[0][1], s[1][1], s[2][1], s[0][2], s[1][2], s[2][2]],
            );
            let mut linear = IDENTITY;
            (0..3).for_each(|row| linear[4 * row..4 * row + 3].copy_from_slice(&s[row]));
            assert_close(&multiply(&linear, &from_quaternion(q)), &skewed);
        }
    }

    #[test]
    fn the_product_of_quaternions_applies_the_right_one_first() {
        let half = |axis: usize, degrees: f64| {
            let mut q = [(degrees / 2.).to_radians().cos(), 0., 0., 0.];
            q[1 + axis] = (degrees / 2.).to_radians().sin();
            q
        };
        let product = quaternion_product(half(1, 50.), half(0, 30.));
        assert_close(&from_quaternion(product), &multiply(&rotation(0, 30.), &rotation(1, 50.)));
    }
}
