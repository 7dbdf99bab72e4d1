use std::collections::BTreeMap;
use std::f64::consts::PI;

use drapery_core::mesh::TriangleMesh;

use super::*;

fn panel(panel: &Panel) -> Shape {
    Form::Panel(*panel).shape()
}

fn leaves(leaves: &Leaves) -> Shape {
    Form::Leaves(Box::new(Cloud::of(*leaves))).shape()
}

fn flat(resolution: u32, aspect: f64) -> Panel {
    Panel { resolution, side: 1.0, aspect, shape: PanelShape::Flat, center: None, rotation: None }
}

fn area(shape: &Shape) -> f64 {
    TriangleMesh::new(&shape.mesh).rest_areas().iter().sum()
}

/// Signed volume by the divergence theorem; positive if faces are counter-clockwise seen from outside.
fn volume(shape: &Shape) -> f64 {
    let at = |i: u32| shape.mesh.points[i as usize];
    shape.mesh.faces().map(|f| at(f[0]).dot(&at(f[1]).cross(&at(f[2]))) / 6.0).sum()
}

/// Every edge is used once in each direction by a closed surface.
fn is_closed(shape: &Shape) -> bool {
    let mut sides = BTreeMap::new();
    for face in shape.mesh.faces() {
        for (a, b) in [(face[0], face[1]), (face[1], face[2]), (face[2], face[0])] {
            *sides.entry((a, b)).or_insert(0) += 1;
        }
    }
    sides.iter().all(|(&(a, b), count)| *count == 1 && sides.contains_key(&(b, a)))
}

#[test]
fn panels_have_the_counts_of_the_authors_scenes() {
    for (resolution, aspect, nodes, triangles) in
        [(40, 1.7, 2829, 5440), (150, 1.0, 22_801, 45_000), (40, 1.0, 1681, 3200), (250, 4.0, 251_251, 500_000)]
    {
        let made = panel(&flat(resolution, aspect));
        assert_eq!(made.mesh.points.len(), nodes);
        assert_eq!(made.mesh.face_counts.len(), triangles);
        assert_eq!(made.uvs.len(), nodes);
    }
}

#[test]
fn a_panel_has_its_area_and_the_order_and_diagonals_of_the_method() {
    let made = panel(&flat(4, 1.5));
    assert!((area(&made) - 1.5).abs() < 1e-14);
    assert_eq!(Form::Panel(flat(4, 1.5)).grid(), Some([7, 5]));
    assert_eq!(made.mesh.points[1], Vec3::new(0.25, 0.5, 0.0));
    assert_eq!(made.mesh.points[7], Vec3::new(0.0, 0.5, 0.25));
    let faces: Vec<_> = made.mesh.faces().take(4).map(<[u32]>::to_vec).collect();
    assert_eq!(faces, [[0, 1, 7], [1, 8, 7], [1, 2, 9], [1, 9, 8]]);
    // All faces look the same way.
    let at = |i: u32| made.mesh.points[i as usize];
    assert!(made.mesh.faces().all(|f| (at(f[1]) - at(f[0])).cross(&(at(f[2]) - at(f[0]))).y < 0.0));
}

#[test]
fn a_centred_panel_is_turned_about_its_centre() {
    let rotation = Some(Rotation { axis: [0.0, 0.0, 2.0], degrees: 90.0 });
    let made = panel(&Panel { center: Some([1.0, 2.0, 3.0]), rotation, ..flat(2, 2.0) });
    assert!((made.mesh.points[0] - Vec3::new(1.0, 1.0, 2.5)).norm() < 1e-15);
    assert!((made.mesh.points[14] - Vec3::new(1.0, 3.0, 3.5)).norm() < 1e-15);
}

#[test]
fn the_parabola_has_equal_arc_lengths_and_its_own_ends() {
    let made = panel(&Panel { side: 0.3, shape: PanelShape::Parabola, ..flat(100, 4.0) });
    let chords: Vec<f64> = made.mesh.points[..401].windows(2).map(|w| (w[1] - w[0]).norm()).collect();
    // Arc length of y = 1.5 x² over [-1, 1] is (3√10 + asinh 3)/3. A chord is shorter by the share (curvature ·
    // step)²/24, and the curvature is at most 3 / 0.25.
    let step = 0.25 * (3.0 * 10.0_f64.sqrt() + 3.0_f64.asinh()) / 3.0 / 400.0;
    let share = (12.0 * step).powi(2) / 24.0;
    assert!(chords.iter().all(|c| (0.0..1.01 * share).contains(&(1.0 - c / step))), "{chords:?} {step}");
    assert!((made.mesh.points[0] - Vec3::new(-0.25, 0.375, -0.15)).norm() < 1e-14);
    assert!((made.mesh.points[400] - Vec3::new(0.25, 0.375, -0.15)).norm() < 1e-14);
    assert!(made.mesh.points[200].xy().norm() < 1e-14);
}

#[test]
fn a_disc_has_rings_of_six_sectors_and_nearly_the_area_of_a_circle() {
    let made = Form::Disc(Disc { resolution: 20, radius: 0.15, center: [0.0; 3], rotation: None }).shape();
    assert_eq!(made.mesh.points.len(), 1 + 3 * 20 * 21);
    assert_eq!(made.mesh.face_counts.len(), 6 * 20 * 20);
    // A regular polygon with n corners has the area n/2 r² sin(2π/n).
    assert!((area(&made) - 60.0 * 0.0225 * (2.0 * PI / 120.0).sin()).abs() < 1e-12);
    let at = |i: u32| made.mesh.points[i as usize];
    assert!(made.mesh.faces().all(|f| (at(f[1]) - at(f[0])).cross(&(at(f[2]) - at(f[0]))).y > 0.0));
}

#[test]
fn a_sphere_is_closed_and_its_volume_converges() {
    let error = |n| {
        let made = Form::Sphere(Ball { resolution: n, radius: 0.5, center: [0.0; 3] }).shape();
        assert_eq!(made.mesh.points.len(), (4 * n * n + 2) as usize);
        assert_eq!(made.mesh.face_counts.len(), (8 * n * n) as usize);
        assert!(is_closed(&made));
        1.0 - volume(&made) / (PI / 6.0)
    };
    let (coarse, fine) = (error(8), error(16));
    // The facets cut off a volume of second order in their size.
    assert!(fine > 0.0 && (coarse / fine - 4.0).abs() < 0.1, "{coarse} {fine}");
}

#[test]
fn a_tube_has_the_area_of_its_polygon_and_looks_outward() {
    let made = Form::Tube(Tube { resolution: 36, radius: 0.1, length: 0.5, center: [0.0; 3], rotation: None }).shape();
    let polygon = 36.0 * 2.0 * 0.1 * (PI / 36.0).sin();
    assert!((area(&made) - polygon * 0.5).abs() < 1e-12);
    let at = |i: u32| made.mesh.points[i as usize];
    let outward = |f: &[u32]| {
        let middle = at(f[0]) + at(f[1]) + at(f[2]);
        (at(f[1]) - at(f[0])).cross(&(at(f[2]) - at(f[0]))).dot(&Vec3::new(middle.x, 0.0, middle.z)) > 0.0
    };
    assert!(made.mesh.faces().all(outward));
}

#[test]
fn leaves_do_not_touch_and_depend_on_the_seed_alone() {
    let block = Leaves {
        count: [3, 3, 2],
        resolution: 2,
        side: 1.0,
        aspect: 1.7,
        base_height: 12.0,
        seed: 65_539,
        max_angle: 60.0,
    };
    let made = leaves(&block);
    assert_eq!(made, leaves(&block));
    assert_ne!(made, leaves(&Leaves { seed: 1, ..block }));
    assert_eq!(made.mesh.points.len(), 18 * 12);
    assert!((area(&made) - 18.0 * 1.7).abs() < 1e-12);
    // Points of different leaves, a slow judge that knows nothing of boxes.
    let leaf = |i: usize| i / 12;
    let points = &made.mesh.points;
    let closest = (0..points.len())
        .flat_map(|a| (0..a).map(move |b| (a, b)))
        .filter(|(a, b)| leaf(*a) != leaf(*b))
        .map(|(a, b)| (points[a] - points[b]).norm())
        .fold(f64::INFINITY, f64::min);
    assert!(closest > LEAF_MARGIN, "{closest}");
}
