//! Distance of cloth from the nearest other cloth or body, as a share of the thickness that keeps the two apart.

use drapery_core::geometry::aabb::Aabb;
use drapery_core::geometry::bvh::Bvh;
use drapery_core::geometry::distance::closest_on_triangle;
use drapery_core::geometry::shapes::Shape;
use drapery_core::scene::{ContactSide, SceneDescription};
use drapery_core::{RigidMotion, Vec3};

use super::rest::Rest;
use crate::drawn::bodies::placement;

/// Distances are looked for up to this many times the thickness; what is farther away is in no contact.
pub(super) const REACH: f64 = 2.0;

/// Cloth that is no farther along the cloth than this many times the reach is the cloth around the vertex: half a circle is so long by
/// its diameter, and so is the path along edges across a regular mesh at most.
const FOLD: f64 = std::f64::consts::FRAC_PI_2;

/// A surface at a frame that cloth can touch.
pub(super) struct Surface {
    /// The garment or body that it belongs to.
    pub(super) side: ContactSide,
    /// The mesh among those of the garment; 0 for a body.
    pub(super) mesh: usize,
    /// Its form.
    form: Form,
}

enum Form {
    Mesh {
        positions: Vec<Vec3>,
        triangles: Vec<[u32; 3]>,
        tree: Bvh,
    },
    /// An analytic shape, its motion, and the time [s].
    Rigid {
        shape: Shape,
        motion: RigidMotion,
        time: f64,
    },
}

impl Surface {
    /// A mesh at these positions [m].
    pub(super) fn mesh(side: ContactSide, mesh: usize, positions: Vec<Vec3>, triangles: Vec<[u32; 3]>) -> Self {
        let corner = |v: u32| Aabb::of_point(&positions[v as usize]);
        let boxes: Vec<Aabb> =
            triangles.iter().map(|[a, b, c]| corner(*a).union(&corner(*b)).union(&corner(*c))).collect();
        let tree = Bvh::build(&boxes);
        Self { side, mesh, form: Form::Mesh { positions, triangles, tree } }
    }

    /// An analytic shape where its motion has brought it at a time [s].
    pub(super) fn rigid(side: ContactSide, shape: Shape, motion: RigidMotion, time: f64) -> Self {
        Self { side, mesh: 0, form: Form::Rigid { shape, motion, time } }
    }

    /// Positions of a mesh [m]; none of an analytic shape.
    pub(super) fn positions(&self) -> &[Vec3] {
        match &self.form {
            Form::Mesh { positions, .. } => positions,
            Form::Rigid { .. } => &[],
        }
    }

    /// Distance of a point [m] up to `reach` [m]; triangles with a vertex for which `is_left_out` do not count. Zero inside an analytic
    /// shape.
    fn distance(&self, point: &Vec3, reach: f64, is_left_out: impl Fn(u32) -> bool) -> Option<f64> {
        match &self.form {
            Form::Rigid { shape, motion, time } => {
                let (rotation, origin) = placement(motion, *time);
                let distance = shape.distance(&(rotation.inverse() * (point - origin))).max(0.0);
                (distance <= reach).then_some(distance)
            }
            Form::Mesh { tree, .. } if tree.is_empty() => None,
            Form::Mesh { positions, triangles, tree } => {
                let squared = |triangle: u32| {
                    let corners = triangles[triangle as usize];
                    if corners.iter().any(|v| is_left_out(*v)) {
                        return f64::INFINITY;
                    }
                    closest_on_triangle(point, &corners.map(|v| positions[v as usize])).distance_squared
                };
                tree.nearest(point, reach, None, squared).map(|(_, squared)| squared.sqrt())
            }
        }
    }
}

/// For each vertex of a mesh of a garment the smallest share of distance by thickness over all `surfaces` at the same frame; NaN where
/// everything is farther away than twice the thickness. What ignores each other does not count, nor the cloth around the vertex itself.
pub(super) fn shares(
    scene: &SceneDescription,
    (garment, mesh): (usize, usize),
    points: &[Vec3],
    rest: &Rest,
    surfaces: &[Surface],
) -> Vec<f32> {
    let own = ContactSide::Garment(garment);
    let mut shares = vec![f32::NAN; points.len()];
    for surface in surfaces.iter().filter(|surface| !scene.ignores(own, surface.side)) {
        let is_itself = surface.side == own && surface.mesh == mesh;
        for (vertex, point) in points.iter().enumerate() {
            let thickness = thickness(scene, own, f64::from(rest.thickness[vertex]), surface.side);
            let reach = REACH * thickness;
            let mut found = surface.distance(point, reach, |other| is_itself && other == vertex as u32);
            // The search for what is near at rest takes time, and few vertices have anything near at all.
            if is_itself && found.is_some() {
                let near = rest.near(vertex as u32, FOLD * reach);
                found = surface.distance(point, reach, |other| near.binary_search(&other).is_ok());
            }
            if let Some(distance) = found.filter(|_| thickness > 0.0) {
                shares[vertex] = shares[vertex].min((distance / thickness) as f32);
            }
        }
    }
    shares
}

/// Thickness [m] that keeps a vertex of a garment, with a thickness of its own, from something else.
fn thickness(scene: &SceneDescription, garment: ContactSide, own: f64, other: ContactSide) -> f64 {
    let rule = scene.contact_rule(garment, other).and_then(|rule| rule.thickness);
    rule.unwrap_or_else(|| match other {
        ContactSide::Body(body) => scene.bodies[body].thickness,
        ContactSide::Garment(_) if other == garment => own,
        ContactSide::Garment(other) | ContactSide::Part(other, _) => own.max(scene.garments[other].thickness),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use drapery_core::scene::{ContactRule, GarmentDescription};
    use drapery_core::{BodyDescription, BodyShape, PolygonMesh};

    /// Points and faces of a square sheet of 10 × 10 cells of 1 cm at a height [m].
    fn sheet(height: f64) -> (Vec<Vec3>, Vec<[u32; 3]>) {
        let point = |i: u32| Vec3::new(0.01 * f64::from(i % 11), height, 0.01 * f64::from(i / 11));
        let cells = (0..110u32).filter(|i| i % 11 < 10);
        let faces = cells.flat_map(|i| [[i, i + 11, i + 1], [i + 1, i + 11, i + 12]]);
        ((0..121).map(point).collect(), faces.collect())
    }

    fn scene(thickness: [f64; 2]) -> SceneDescription {
        let mut scene = SceneDescription::new("two sheets");
        for (name, thickness) in ["a", "b"].into_iter().zip(thickness) {
            let (points, faces) = sheet(0.0);
            let mesh = PolygonMesh::from_triangles(points, &faces);
            scene.garments.push(GarmentDescription { thickness, ..GarmentDescription::new(name, mesh, 0.1) });
        }
        scene
    }

    fn at(scene: &SceneDescription, points: &[Vec3], surfaces: &[Surface]) -> Vec<f32> {
        let (flat, faces) = sheet(0.0);
        let rest = Rest::new(&flat, &faces, vec![scene.garments[0].thickness as f32; 121]);
        shares(scene, (0, 0), points, &rest, surfaces)
    }

    fn garment(number: usize, (points, faces): (Vec<Vec3>, Vec<[u32; 3]>)) -> Surface {
        Surface::mesh(ContactSide::Garment(number), 0, points, faces)
    }

    #[test]
    fn two_sheets_are_as_far_apart_as_the_thicker_one_says() {
        let mut scene = scene([0.001, 0.002]);
        let surfaces = || [garment(0, sheet(0.0)), garment(1, sheet(0.003))];
        let found = at(&scene, &sheet(0.0).0, &surfaces());
        assert!(found.iter().all(|share| (share - 1.5).abs() < 1e-5), "{found:?}");
        // Beyond twice the thickness nothing is in contact.
        assert!(at(&scene, &sheet(0.0).0, &[garment(1, sheet(0.0041))]).iter().all(|share| share.is_nan()));
        let mut rule = ContactRule::new([ContactSide::Garment(0), ContactSide::Garment(1)]);
        rule.thickness = Some(0.004);
        scene.contacts = vec![rule];
        assert!(at(&scene, &sheet(0.0).0, &surfaces()).iter().all(|share| (share - 0.75).abs() < 1e-5));
        scene.contacts = vec![ContactRule { ignore: true, thickness: None, ..rule }];
        assert!(at(&scene, &sheet(0.0).0, &surfaces()).iter().all(|share| share.is_nan()));
    }

    #[test]
    fn a_flat_sheet_does_not_touch_itself_however_thick_it_is_and_a_folded_one_does() {
        for thickness in [0.001, 0.008, 0.04] {
            let found = at(&scene([thickness, 0.0]), &sheet(0.0).0, &[garment(0, sheet(0.0))]);
            assert!(found.iter().all(|share| share.is_nan()), "{thickness}: {found:?}");
        }
        // Folded over a strip of 2 cm, so that the layers are 2 mm apart.
        let fold = |p: &Vec3| if p.x > 0.06 { Vec3::new(0.1 - p.x, 0.002, p.z) } else { Vec3::new(p.x, 0.0, p.z) };
        let folded: Vec<Vec3> = sheet(0.0).0.iter().map(fold).collect();
        let surface = garment(0, (folded.clone(), sheet(0.0).1));
        let found = at(&scene([0.002, 0.0]), &folded, &[surface]);
        let far_from_the_fold = |i: &usize| i % 11 < 2;
        assert!((0..121).filter(far_from_the_fold).all(|i| (found[i] - 1.0).abs() < 1e-5), "{found:?}");
    }

    #[test]
    fn distances_of_shapes_are_exact_and_zero_inside() {
        let mut scene = scene([0.001, 0.0]);
        let ball = BodyShape::Rigid(Shape::Sphere { radius: 0.5 });
        let centre = Vec3::new(0.05, -0.512, 0.05);
        let motion = RigidMotion::at(centre);
        let body = BodyDescription::new("ball", ball, motion.clone());
        scene.bodies.push(BodyDescription { thickness: 0.01, ..body });
        let surface = Surface::rigid(ContactSide::Body(0), Shape::Sphere { radius: 0.5 }, motion.clone(), 3.0);
        let points = sheet(0.0).0;
        let found = at(&scene, &points, &[surface]);
        for (point, share) in points.iter().zip(&found) {
            let expected = ((point - centre).norm() - 0.5) / 0.01;
            assert!((f64::from(*share) - expected).abs() < 1e-5, "{share} {expected}");
        }
        let sunk: Vec<Vec3> = points.iter().map(|p| p - 0.1 * Vec3::y()).collect();
        let surface = Surface::rigid(ContactSide::Body(0), Shape::Sphere { radius: 0.5 }, motion, 3.0);
        assert!(at(&scene, &sunk, &[surface]).contains(&0.0));
    }
}
