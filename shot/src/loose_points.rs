//! Points of a garment that belong to no face and lie far away. They count for the place and the size of the garment all the same, so
//! that rounding would take the area of its faces.

use drapery_core::Vec3;
use drapery_core::error::Problem;
use drapery_core::mesh::MeshStream;
use drapery_core::scene::{GarmentDescription, is_possible};
use drapery_io::garment_mesh::GarmentMesh;

/// Distance of a loose point from the faces that is refused, in sizes of these.
const FAR: f64 = 1000.0;

/// The first point of a garment that is loose and far away, at rest or at the start. Meshes that cannot be read are reported elsewhere.
pub(crate) fn far_away(mesh: &GarmentMesh, garment: &GarmentDescription) -> Option<Problem> {
    let mut used = vec![false; mesh.point_count()];
    let mut note = |corner: &u32| used.get_mut(*corner as usize).into_iter().for_each(|used| *used = true);
    mesh.faces(&mut |_, corners| corners.iter().for_each(&mut note)).ok()?;
    if used.iter().all(|used| *used) {
        return None;
    }
    let at_rest = mesh.positions().ok()?;
    let poses = [Some(at_rest.as_slice()), garment.start.as_deref()];
    let (vertex, apart, across) = poses.into_iter().flatten().find_map(|places| first_far(places, &used))?;
    let what = format!(
        "it belongs to no face and lies {apart:.0} m from the faces, which are {across:.3} m across: beside it rounding takes their area"
    );
    let place = format!("garment \"{}\", vertex {vertex}", garment.name);
    Some(Problem::data(place, what, "delete loose vertices and export the mesh again"))
}

/// The first loose point that is far from all used ones, its distance from their box and the size of that [m].
fn first_far(places: &[Vec3], used: &[bool]) -> Option<(usize, f64, f64)> {
    let known = || places.iter().zip(used).enumerate().filter(|(_, (place, _))| is_possible(place));
    let nothing = [Vec3::repeat(f64::INFINITY), Vec3::repeat(f64::NEG_INFINITY)];
    let in_faces = known().filter(|(_, (_, used))| **used);
    let [low, high] = in_faces.fold(nothing, |[low, high], (_, (place, _))| [low.inf(place), high.sup(place)]);
    let across = (high - low).norm();
    let loose = known().filter(|(_, (_, used))| !**used);
    let distances = loose.map(|(vertex, (place, _))| (vertex, (place - place.sup(&low).inf(&high)).norm(), across));
    distances.into_iter().find(|(_, apart, _)| *apart > FAR * across)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_loose_point_is_far_by_the_size_of_the_faces() {
        let square = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]].map(Vec3::from);
        let used = [true, true, true, true, false];
        let with = |x: f64| [square.to_vec(), vec![Vec3::new(x, 0.5, 0.0)]].concat();
        assert_eq!(first_far(&with(1000.0), &used), None);
        assert_eq!(first_far(&with(2001.0), &used), Some((4, 2000.0, 2_f64.sqrt())));
        // Numbers that are none are reported with all others.
        assert_eq!(first_far(&with(f64::NAN), &used), None);
        assert_eq!(first_far(&[], &[]), None);
    }
}
