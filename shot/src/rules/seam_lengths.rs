//! Seams of which one side is much longer than the other: the longer one gathers.

use drapery_core::Vec3;
use drapery_core::scene::SeamDescription;

use super::{Facts, Finding};

/// Ratio of the lengths above which a seam gathers. Sleeves are eased into an armhole by up to a tenth and knitted bands stretched by up
/// to a quarter; gathers begin at one and a half.
const GATHERS: f64 = 4.0 / 3.0;

/// Vertices that a side has to have to be a line: fewer are a button or a tack.
const LINE: usize = 4;

/// Stitches of a longer seam that are looked at, evenly spaced: the time grows with their square.
const STITCHES: usize = 2000;

pub(super) fn find(facts: &Facts<'_>) -> Vec<Finding> {
    facts.scene.seams.iter().enumerate().filter_map(|(number, seam)| of_seam(facts, number, seam)).collect()
}

/// A seam whose sides differ; one to a surface has one side only.
fn of_seam(facts: &Facts<'_>, number: usize, seam: &SeamDescription) -> Option<Finding> {
    if seam.pairs.len() < LINE {
        return None;
    }
    let vertices = [0_usize, 1].map(|side| {
        let mut side: Vec<u32> = seam.pairs.iter().map(|pair| pair[side]).collect();
        side.sort_unstable();
        side.dedup();
        side
    });
    if vertices.iter().all(|side| side.len() < LINE) {
        return None;
    }
    let step = seam.pairs.len().div_ceil(STITCHES);
    let length = |side: usize| {
        let garment = seam.garments[side];
        // A garment that cannot be read is reported elsewhere.
        let rest = facts.garments[garment].positions().ok()?;
        let points = vertices[side].iter().step_by(step).map(|vertex| rest.get(*vertex as usize).copied());
        Some(length_of_line(&points.collect::<Option<Vec<Vec3>>>()?) * facts.scene.garments[garment].rest_scale)
    };
    let lengths = [length(0)?, length(1)?];
    let [short, long] = if lengths[0] < lengths[1] { [0, 1] } else { [1, 0] };
    if lengths[long] <= GATHERS * lengths[short] {
        return None;
    }
    let named = |side: usize| {
        let name = &facts.scene.garments[seam.garments[side]].name;
        let (key, count) = (["from", "to"][side], vertices[side].len());
        format!("the side `{key}`, {count} vertices of garment \"{name}\", is {:.3} m long at rest", lengths[side])
    };
    let message = format!(
        "{}, and {}: the longer side gathers on the shorter one. Choose vertices of edges of the same length on both sides; if it is \
         meant to gather, silence this rule",
        named(long),
        named(short)
    );
    let line = if seam.zip { "regions with the same ends in `from` and `to`" } else { "" };
    Some(Finding { object: format!("seam {number}"), message, line: line.to_owned() })
}

/// Length of the line on which points lie, in whatever order [m]: the longest way through their minimum spanning tree. Points beside the
/// line, as of a second row, hardly change it.
fn length_of_line(points: &[Vec3]) -> f64 {
    // For each point that is not in the tree its distance from the tree, and the nearest point there; Prim's algorithm.
    let mut outside: Vec<(usize, f64, usize)> =
        (1..points.len()).map(|point| (point, (points[point] - points[0]).norm(), 0)).collect();
    let mut order = Vec::with_capacity(outside.len());
    while let Some(next) = (0..outside.len()).min_by(|a, b| outside[*a].1.total_cmp(&outside[*b].1)) {
        let added = outside.swap_remove(next);
        for (point, distance, nearest) in &mut outside {
            let to_added = (points[*point] - points[added.0]).norm();
            if to_added < *distance {
                (*distance, *nearest) = (to_added, added.0);
            }
        }
        order.push(added);
    }
    // From the leaves: the longest way down from each point, and the longest through one.
    let (mut down, mut longest) = (vec![0.0_f64; points.len()], 0.0_f64);
    for (point, distance, parent) in order.into_iter().rev() {
        let way = down[point] + distance;
        longest = longest.max(down[parent] + way);
        down[parent] = down[parent].max(way);
    }
    longest
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn length_follows_a_line_in_any_order_and_around_corners() {
        // An L of 3 m and 2 m, every other point first.
        let along = |k: usize| {
            let t = 0.1 * k as f64;
            Vec3::new(t.min(3.0), (t - 3.0).max(0.0), 0.0)
        };
        let mixed: Vec<Vec3> = (0..=50).step_by(2).chain((1..50).step_by(2)).map(along).collect();
        assert!((length_of_line(&mixed) - 5.0).abs() < 1e-12);
        // A loop lacks one edge.
        let around = |k: u32| Vec3::new(f64::from(k).to_radians().cos(), f64::from(k).to_radians().sin(), 0.0);
        let round: Vec<Vec3> = (0..360).map(around).collect();
        let chord = 2.0 * 0.5_f64.to_radians().sin();
        assert!((length_of_line(&round) - 359.0 * chord).abs() < 1e-9);
        assert_eq!(length_of_line(&[Vec3::zeros()]), 0.0);
    }
}
