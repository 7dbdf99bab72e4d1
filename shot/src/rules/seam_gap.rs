//! Seams to a surface that is far from their vertices.

use drapery_core::scene::{FacePoint, SeamDescription};
use drapery_core::tolerances::{FAR_BOUND, FAR_BOUND_EDGES, FAR_BOUND_THICKNESSES};

use super::{Facts, Finding};

pub(super) fn find(facts: &Facts<'_>) -> Vec<Finding> {
    let seams = facts.scene.seams.iter().enumerate().filter(|(_, seam)| !seam.faces.is_empty());
    seams.filter_map(|(number, seam)| of_seam(facts, number, seam)).collect()
}

/// The vertices of a seam that start far from their faces, if there are any.
fn of_seam(facts: &Facts<'_>, number: usize, seam: &SeamDescription) -> Option<Finding> {
    let [from, to] = seam.garments.map(|garment| facts.start_of(garment));
    let (from, to) = (from?, to?);
    let garments = seam.garments.map(|garment| &facts.scene.garments[garment]);
    let thickness: f64 = garments.iter().map(|garment| garment.thickness).sum();
    let far = |FacePoint { vertex, corners, weights }: &FacePoint| {
        let [a, b, c] = corners.map(|corner| to[corner as usize]);
        let edge = ((b - a).norm() + (c - b).norm() + (a - c).norm()) / 3.0;
        let gap = (a * weights[0] + b * weights[1] + c * weights[2] - from[*vertex as usize]).norm();
        let limit = (FAR_BOUND_EDGES * edge).max(FAR_BOUND_THICKNESSES * thickness).min(FAR_BOUND);
        (gap > limit).then_some((gap, *vertex))
    };
    let far: Vec<(f64, u32)> = seam.faces.iter().filter_map(far).collect();
    let (gap, vertex) = far.iter().max_by(|a, b| a.0.total_cmp(&b.0).then(b.1.cmp(&a.1)))?;
    let [name, other] = garments.map(|garment| &garment.name);
    let follows = if seam.keeps_gap { "keeps" } else { "closes" };
    let message = format!(
        "{} of its {} vertices of garment \"{name}\" start far from the surface of garment \"{other}\"; the farthest is \
         vertex {vertex} with a gap of {gap:.3} m, which the seam {follows}: start the garment on the surface, or leave \
         these vertices out",
        far.len(),
        seam.faces.len()
    );
    Some(Finding { object: format!("seam {number}"), message, line: String::new() })
}
