//! Normals of a mesh: one at each point, or several where hard edges split them.

use std::collections::HashMap;

/// Distance between the ends of two directions of length one below which they are the same: programs that print few digits, or add
/// up the faces in another order for each corner, mean no hard edge.
const SAME: f64 = 1e-3;

/// The normal of a point that belongs to no face, or whose faces cancel each other.
const NONE: [f32; 3] = [0.0, 1.0, 0.0];

/// Normals at the points of a mesh, each the mean of those of the faces around it, weighted by their areas; of length one. Faces are
/// counter-clockwise seen from outside. What names no point counts nowhere.
///
/// They follow from the positions as these are stored, by sums, products and roots alone: who computes them again on another machine
/// has the same bits.
pub fn at_points(face_counts: &[u32], face_indices: &[u32], points: &[[f32; 3]]) -> Vec<[f32; 3]> {
    means((face_counts, face_indices), (face_indices, points.len()), points)
}

/// The same where hard edges split them: the mean of the faces that have a normal, for each of [`SplitNormals`]; without those,
/// [`at_points`].
pub fn of_faces(
    (face_counts, face_indices): (&[u32], &[u32]),
    split: Option<&SplitNormals>,
    points: &[[f32; 3]],
) -> Vec<[f32; 3]> {
    let Some(split) = split.filter(|split| split.indices.len() == face_indices.len()) else {
        return at_points(face_counts, face_indices, points);
    };
    means((face_counts, face_indices), (&split.indices, split.count), points)
}

/// The means of the faces that have each of `count` normals, by the normal of each corner.
fn means(
    (face_counts, face_indices): (&[u32], &[u32]),
    (normals, count): (&[u32], usize),
    points: &[[f32; 3]],
) -> Vec<[f32; 3]> {
    let mut sums = vec![[0.0_f64; 3]; count];
    let mut rest = (face_indices, normals);
    for count in face_counts {
        let corners = (*count as usize).min(rest.0.len());
        let ((face, later), (normals, of_later)) = (rest.0.split_at(corners), rest.1.split_at(corners));
        rest = (later, of_later);
        let Some(area) = area(face, points) else { continue };
        for normal in normals {
            let Some(sum) = sums.get_mut(*normal as usize) else { continue };
            (0..3).for_each(|axis| sum[axis] += area[axis]);
        }
    }
    sums.into_iter().map(normal).collect()
}

/// Normals of a mesh with hard edges: those of faces on both sides of such an edge differ where they meet.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct SplitNormals {
    /// Number of the normal of each face corner, counted from 0, in the order of the mesh's face indices. No two points share one.
    pub indices: Vec<u32>,
    /// Number of normals.
    pub count: usize,
}

/// Stands for no normal.
const NO_NORMAL: u32 = u32::MAX;

impl SplitNormals {
    /// Splits normals between the corners of a point that are not the `same`, two corners being given by their places in
    /// `face_indices`; none where the corners of every one of the `points` are.
    pub fn between(face_indices: &[u32], points: usize, same: impl Fn(usize, usize) -> bool) -> Option<Self> {
        // The first normal of each point; of each normal a corner that has it, and the next normal of the point.
        let mut first = vec![NO_NORMAL; points];
        let mut normals: Vec<(usize, u32)> = Vec::new();
        let mut is_split = false;
        let mut number = |(corner, point): (usize, &u32)| {
            let mut last = NO_NORMAL;
            let mut next = *first.get(*point as usize)?;
            while next != NO_NORMAL {
                let (known, after) = normals[next as usize];
                if same(known, corner) {
                    return Some(next);
                }
                (last, next) = (next, after);
            }
            let new = u32::try_from(normals.len()).ok().filter(|new| *new != NO_NORMAL)?;
            normals.push((corner, NO_NORMAL));
            match last {
                NO_NORMAL => first[*point as usize] = new,
                _ => {
                    normals[last as usize].1 = new;
                    is_split = true;
                }
            }
            Some(new)
        };
        let indices = face_indices.iter().enumerate().map(&mut number).collect::<Option<Vec<u32>>>()?;
        is_split.then_some(Self { indices, count: normals.len() })
    }

    /// Splits normals where the directions that a file has at the corners of a point differ. Directions that are none split
    /// nothing.
    pub fn of_directions(face_indices: &[u32], points: usize, directions: &[[f32; 3]]) -> Option<Self> {
        let unit = |v: &[f32; 3]| {
            let length = v.iter().map(|c| f64::from(*c) * f64::from(*c)).sum::<f64>().sqrt();
            (length > 0.0 && length.is_finite()).then(|| v.map(|c| f64::from(c) / length))
        };
        let same = |a: usize, b: usize| {
            let (Some(a), Some(b)) = (directions.get(a).and_then(unit), directions.get(b).and_then(unit)) else {
                return true;
            };
            (0..3).map(|axis| (a[axis] - b[axis]).powi(2)).sum::<f64>() <= SAME * SAME
        };
        Self::between(face_indices, points, same)
    }

    /// The normals that a mesh without hard edges has: one at each point.
    pub fn at_points(face_indices: &[u32], points: usize) -> Self {
        Self { indices: face_indices.to_vec(), count: points }
    }

    /// The normals as a file numbers them; `None` where these are not `count` normals of these corners, each of one point.
    pub fn numbered(indices: Vec<u32>, count: usize, face_indices: &[u32]) -> Option<Self> {
        let mut points = vec![None; count];
        let has_one_point = |(index, point): (&u32, &u32)| {
            points.get_mut(*index as usize).is_some_and(|known| known.get_or_insert(*point) == point)
        };
        let fits = indices.len() == face_indices.len() && indices.iter().zip(face_indices).all(has_one_point);
        fits.then_some(Self { indices, count })
    }

    /// Normals that may be but some of others, counted anew: the numbers of the others at each corner.
    pub fn counted(others: Vec<u32>) -> Self {
        let mut numbers = HashMap::new();
        let mut number = |other: u32| {
            let next = numbers.len() as u32;
            *numbers.entry(other).or_insert(next)
        };
        let indices = others.into_iter().map(&mut number).collect();
        Self { indices, count: numbers.len() }
    }

    /// The normal of each corner.
    pub fn at_corners(&self, normals: &[[f32; 3]]) -> Vec<[f32; 3]> {
        self.indices.iter().map(|index| normals.get(*index as usize).copied().unwrap_or(NONE)).collect()
    }

    /// Each normal once, of those at the corners; `None` where the corners of one do not have the same, or are not as many.
    pub fn of_corners(&self, corners: &[[f32; 3]]) -> Option<Vec<[f32; 3]>> {
        let mut found = vec![None; self.count];
        for (index, normal) in self.indices.iter().zip(corners) {
            let bits = |normal: &[f32; 3]| normal.map(f32::to_bits);
            let known = found.get_mut(*index as usize)?.get_or_insert(*normal);
            if bits(known) != bits(normal) {
                return None;
            }
        }
        (corners.len() == self.indices.len()).then(|| found.into_iter().map(|normal| normal.unwrap_or(NONE)).collect())
    }
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
    fn a_hard_edge_splits_the_normals_at_both_its_ends() {
        // The same two faces, and a hard edge between points 1 and 2.
        let points =
            [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0], [1.0, 0.0, -1.0]].map(|p: [f32; 3]| p);
        let (counts, corners) = ([4, 3], [0, 1, 2, 3, 1, 4, 2]);
        let (up, right) = ([0.0, 0.0, 2.0], [0.7, 0.0004, 0.0]);
        let split = SplitNormals::of_directions(&corners, 5, &[up, up, up, up, right, right, right]).unwrap();
        assert_eq!((&split.indices[..], split.count), (&[0, 1, 2, 3, 4, 5, 6][..], 7));
        let found = of_faces((&counts, &corners), Some(&split), &points);
        assert_eq!(found, [[[0.0, 0.0, 1.0]; 4].as_slice(), &[[1.0, 0.0, 0.0]; 3]].concat());
        let at_corners = split.at_corners(&found);
        assert_eq!(split.of_corners(&at_corners), Some(found));
        assert_eq!(split.of_corners(&at_corners[1..]), None);
        // Soft, but for rounding; and what is no direction.
        let none = [f32::NAN, 0.0, 0.0];
        assert_eq!(SplitNormals::of_directions(&corners, 5, &[up, up, up, up, [1e-4, 0.0, 0.3], [0.0; 3], none]), None);
        assert_eq!(SplitNormals::numbered(split.indices.clone(), 7, &corners), Some(split));
        assert_eq!(SplitNormals::numbered(vec![0, 1, 2, 3, 0, 4, 5], 7, &corners), None, "two points share one");
        assert_eq!(SplitNormals::numbered(vec![0, 1, 2, 3, 1, 4, 7], 7, &corners), None);
    }

    #[test]
    fn faces_that_are_none_or_name_no_points_count_nowhere() {
        let points = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]];
        let found = at_points(&[3, 2, 0, 3, 7], &[0, 1, 2, 0, 1, 0, 1, 900, 2], &points);
        assert_eq!(found, [[0.0, 1.0, 0.0]; 3]);
    }
}
