//! Velocities in the world, from stored ones and the transforms of parents.

use drapery_alembic::{IDENTITY, Matrix, transform_point};

/// Velocities in the world, of points under a transform; where that moves, by the transforms half a frame before and after, with the
/// time between them [s].
pub(crate) fn in_world(
    mut velocities: Vec<[f32; 3]>,
    points: &[[f32; 3]],
    to_world: &Matrix,
    around: Option<([Matrix; 2], f64)>,
) -> Vec<[f32; 3]> {
    let around = around.filter(|([before, after], _)| before != after);
    let is_turned = (0..12).any(|k| to_world[k] != IDENTITY[k]);
    if !is_turned && around.is_none() {
        return velocities;
    }
    let linear = |m: &Matrix, v: [f64; 3]| -> [f64; 3] {
        std::array::from_fn(|axis| (0..3).map(|row| v[row] * m[4 * row + axis]).sum())
    };
    for (velocity, point) in velocities.iter_mut().zip(points) {
        let mut moved = linear(to_world, velocity.map(f64::from));
        if let Some(([before, after], seconds)) = &around {
            let [before, after] = [before, after].map(|m| transform_point(point.map(f64::from), m));
            (0..3).for_each(|axis| moved[axis] += (after[axis] - before[axis]) / seconds);
        }
        *velocity = moved.map(|x| x as f32);
    }
    velocities
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn velocities_turn_with_their_parents_and_take_their_motion() {
        // A quarter turn about Z and a shift: x becomes y.
        let turned: Matrix = [0., 1., 0., 0., -1., 0., 0., 0., 0., 0., 1., 0., 5., 6., 7., 1.];
        assert_eq!(in_world(vec![[1., 0., 2.]], &[[0.; 3]], &turned, None), [[0., 1., 2.]]);
        assert_eq!(in_world(vec![[1., 0., 2.]], &[[0.; 3]], &turned, Some(([turned; 2], 0.1))), [[0., 1., 2.]]);
        // A parent that grows by a tenth in a twentieth of a second carries a point at x = 3 along with 6 a second.
        let grown = |by: f64| {
            let mut matrix = IDENTITY;
            matrix[0] = by;
            matrix
        };
        let carried =
            in_world(vec![[1., 0., 0.]], &[[3., 0., 0.]], &IDENTITY, Some(([grown(0.95), grown(1.05)], 0.05)));
        assert!((carried[0][0] - 7.0).abs() < 1e-6, "{carried:?}");
        let still = vec![[0.1, 0.2, 0.3]];
        assert_eq!(in_world(still.clone(), &[[3., 0., 0.]], &IDENTITY, Some(([IDENTITY; 2], 0.05))), still);
    }
}
