//! Normals of a mesh at its points.

/// The normal of a point that belongs to no face, or whose faces cancel each other.
const NONE: [f32; 3] = [0.0, 1.0, 0.0];

/// Normals at the points of a mesh, each the mean of those of the faces around it, weighted by their areas; of length one. Faces are
/// counter-clockwise seen from outside. What names no point counts nowhere.
///
/// They follow from the positions as these are stored, by sums, products and roots alone: who computes them again on another machine
/// has the same bits.
pub fn at_points(face_counts: &[u32], face_indices: &[u32], points: &[[f32; 3]]) -> Vec<[f32; 3]> {
    let mut sums = vec![[0.0_f64; 3]; points.len()];
    let mut rest = face_indices;
    for count in face_counts {
        let (face, later) = rest.split_at((*count as usize).min(rest.len()));
        rest = later;
        let Some(area) = area(face, points) else { continue };
        for corner in face {
            (0..3).for_each(|axis| sums[*corner as usize][axis] += area[axis]);
        }
    }
    sums.into_iter().map(normal).collect()
}

/// Twice the area of a polygon as a vector along its normal; `None` where a corner is none of the points.
fn area(face: &[u32], points: &[[f32; 3]]) -> Option<[f64; 3]> {
    let at = |corner: &u32| points.get(*corner as usize).map(|point| point.map(f64::from));
    let (first, mut others) = (at(face.first()?)?, face[1..].iter());
    let from_first = |point: [f64; 3]| [0, 1, 2].map(|axis| point[axis] - first[axis]);
    let mut sum = [0.0; 3];
    let Some(second) = others.next() else { return Some(sum) };
    let mut before = from_first(at(second)?);
    for corner in others {
        let next = from_first(at(corner)?);
        let cross = |i: usize, j: usize| before[i] * next[j] - before[j] * next[i];
        for (total, part) in sum.iter_mut().zip([cross(1, 2), cross(2, 0), cross(0, 1)]) {
            *total += part;
        }
        before = next;
    }
    Some(sum)
}

/// The direction of a vector.
fn normal(sum: [f64; 3]) -> [f32; 3] {
    let length = (sum[0] * sum[0] + sum[1] * sum[1] + sum[2] * sum[2]).sqrt();
    if length > 0.0 && length.is_finite() { sum.map(|c| (c / length) as f32) } else { NONE }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn normals_are_the_means_of_the_faces_by_their_areas() {
        // A square of area 1 that faces z, and at one of its edges a triangle of area 0.5 that faces x.
        let points =
            [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0], [1.0, 0.0, -1.0], [9.0, 9.0, 9.0]];
        let found = at_points(&[4, 3], &[0, 1, 2, 3, 1, 4, 2], &points.map(|p| p.map(|c: f64| c as f32)));
        let mixed = [1.0 / 5.0_f64.sqrt(), 0.0, 2.0 / 5.0_f64.sqrt()].map(|c| c as f32);
        assert_eq!(found, [[0.0, 0.0, 1.0], mixed, mixed, [0.0, 0.0, 1.0], [1.0, 0.0, 0.0], NONE]);
    }

    #[test]
    fn faces_that_are_none_or_name_no_points_count_nowhere() {
        let points = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]];
        let found = at_points(&[3, 2, 0, 3, 7], &[0, 1, 2, 0, 1, 0, 1, 900, 2], &points);
        assert_eq!(found, [[0.0, 1.0, 0.0]; 3]);
    }
}
