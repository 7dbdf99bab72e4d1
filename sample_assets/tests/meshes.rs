//! Properties that the generated meshes promise in the rest pose.

mod common;

use std::sync::OnceLock;

use common::{crossings, gap, samples, together};
use drapery_assets::anatomy::union;
use drapery_assets::export::{ExportError, Fineness, Order, Wardrobe};
use drapery_assets::garments::Garment;
use drapery_assets::mannequin::Mannequin;
use drapery_assets::pins::pin_ring;
use drapery_assets::skeleton::{Side, shoulder};
use drapery_assets::surface_mesh::SurfaceMesh;

/// Smallest gap between any two surfaces at rest \[m\].
const LEAST_GAP: f64 = 0.003;

fn wardrobe(resolution: f64) -> Wardrobe {
    Wardrobe::make(&Order { resolution, frames: [1, 1], ..Order::default() }).unwrap()
}

/// The wardrobe that most tests look at.
fn default_wardrobe() -> &'static Wardrobe {
    static MADE: OnceLock<Wardrobe> = OnceLock::new();
    MADE.get_or_init(|| wardrobe(1.0))
}

/// The same with fine garments.
fn full_wardrobe() -> &'static Wardrobe {
    static MADE: OnceLock<Wardrobe> = OnceLock::new();
    MADE.get_or_init(|| {
        Wardrobe::make(&Order { garments: Fineness::Full, frames: [1, 1], ..Order::default() }).unwrap()
    })
}

fn garment<'a>(wardrobe: &'a Wardrobe, name: &str) -> &'a Garment {
    wardrobe.garments.iter().find(|garment| garment.name == name).unwrap()
}

fn euler(mesh: &SurfaceMesh) -> i64 {
    (mesh.points.len() + mesh.faces.len()) as i64 - mesh.edges().len() as i64
}

#[test]
fn the_body_is_one_closed_surface_without_handles_facing_out() {
    for resolution in [0.5, 0.73, 1.0, 1.31] {
        let body = Mannequin::new(resolution, 0.0, 0).rest;
        assert!(body.edges().iter().all(|(_, faces)| *faces == 2), "open or branching at resolution {resolution}");
        assert_eq!(euler(&body), 2, "resolution {resolution}");
        assert!(body.volume() > 0.045, "volume {} m3", body.volume());
    }
}

#[test]
fn the_body_has_ten_thousand_points_and_stands_1_70_m_high() {
    let body = &default_wardrobe().mannequin.rest;
    assert!((9_000..11_000).contains(&body.points.len()), "{} points", body.points.len());
    let heights = body.points.iter().map(|p| p.y);
    let (lowest, highest) = (heights.clone().fold(f64::INFINITY, f64::min), heights.fold(0.0, f64::max));
    // The soles are blends of spheres that touch the floor; a blend adds up to a sixth of its 8 mm.
    assert!(lowest.abs() < 0.002 && (highest - 1.70).abs() < 0.005, "{lowest} .. {highest}");
}

#[test]
fn resolution_multiplies_the_points_by_its_square() {
    let (coarse, fine) = (wardrobe(0.5), default_wardrobe());
    let ratio = |a: &SurfaceMesh, b: &SurfaceMesh| b.points.len() as f64 / a.points.len() as f64;
    assert!((ratio(&coarse.mannequin.rest, &fine.mannequin.rest) - 4.0).abs() < 0.2);
    for (a, b) in coarse.garments.iter().zip(&fine.garments) {
        assert!((ratio(&a.mesh, &b.mesh) - 4.0).abs() < 0.4, "{}", a.name);
    }
}

#[test]
fn nothing_crosses_at_rest() {
    for wardrobe in [&wardrobe(0.5), default_wardrobe(), full_wardrobe()] {
        let body = &wardrobe.mannequin.rest;
        let [skirt, tshirt, trousers] = ["skirt", "tshirt", "trousers"].map(|name| &garment(wardrobe, name).mesh);
        assert_eq!(crossings(&together(&[body, skirt, tshirt])), 0);
        assert_eq!(crossings(&together(&[body, trousers])), 0);
    }
}

#[test]
fn garments_start_off_the_body_and_off_each_other() {
    let wardrobe = default_wardrobe();
    let limbs = &wardrobe.mannequin.limbs;
    for garment in &wardrobe.garments {
        let closest = samples(&garment.mesh).iter().map(|p| union(limbs, p)).fold(f64::INFINITY, f64::min);
        assert!(closest > LEAST_GAP, "{}: {closest} m", garment.name);
    }
    let (skirt, tshirt) = (&garment(wardrobe, "skirt").mesh, &garment(wardrobe, "tshirt").mesh);
    assert!(gap(skirt, tshirt).min(gap(tshirt, skirt)) > LEAST_GAP);
}

#[test]
fn garments_are_manifold_with_the_openings_of_their_kind() {
    for wardrobe in [&wardrobe(0.5), default_wardrobe(), full_wardrobe()] {
        for (name, openings) in [("skirt", 2), ("tshirt", 4), ("trousers", 3)] {
            let mesh = &garment(wardrobe, name).mesh;
            assert!(mesh.edges().iter().all(|(_, faces)| *faces <= 2), "{name}");
            assert_eq!(mesh.boundary_loops().len(), openings, "{name}");
            // A sphere with that many holes.
            assert_eq!(euler(mesh), 2 - openings as i64, "{name}");
            assert_eq!(mesh.without_unused_points().points.len(), mesh.points.len(), "{name}");
        }
    }
}

#[test]
fn garments_have_no_slivers_and_the_edge_length_asked_for() {
    for (wardrobe, fineness) in [(default_wardrobe(), Fineness::Light), (full_wardrobe(), Fineness::Full)] {
        for garment in &wardrobe.garments {
            let (altitude, edge) = (garment.mesh.smallest_altitude(), garment.mesh.mean_edge());
            assert!(altitude > 0.35 * edge, "{}: {altitude} m of {edge} m", garment.name);
            assert!((edge / fineness.edge() - 1.0).abs() < 0.1, "{}: {edge} m", garment.name);
        }
    }
}

#[test]
fn every_face_is_in_one_set_and_has_texture_coordinates() {
    for garment in wardrobe(0.6).garments {
        let mut faces: Vec<usize> = garment.face_sets.iter().flat_map(|(_, faces)| faces.clone()).collect();
        faces.sort_unstable();
        assert!(faces.into_iter().eq(0..garment.mesh.faces.len()), "{}", garment.name);
        assert!(garment.face_sets.iter().all(|(_, faces)| !faces.is_empty()), "{}", garment.name);
        for (face, corners) in garment.mesh.faces.iter().zip(&garment.uv_corners) {
            assert_eq!(face.len(), corners.len());
            let uv: Vec<[f64; 2]> = corners.iter().map(|&corner| garment.uvs[corner]).collect();
            let spread = |axis: usize| {
                uv.iter().map(|uv| uv[axis]).fold(f64::NEG_INFINITY, f64::max)
                    - uv.iter().map(|uv| uv[axis]).fold(f64::INFINITY, f64::min)
            };
            // 33 mm edges: a face across a seam would reach over the whole texture.
            assert!(spread(0) < 0.15 && spread(1) < 0.15, "{}: {uv:?}", garment.name);
        }
    }
}

#[test]
fn pins_rebuild_the_waist_ring() {
    let wardrobe = wardrobe(0.6);
    let body = &wardrobe.mannequin.rest;
    for name in ["skirt", "trousers"] {
        let garment = garment(&wardrobe, name);
        let highest = garment.mesh.points.iter().map(|p| p.y).fold(0.0, f64::max);
        let at_waist = garment.mesh.points.iter().filter(|p| p.y > highest - 1e-6).count();
        assert_eq!(garment.waist_ring.len(), at_waist, "{name}");
        for pin in pin_ring(&garment.mesh, &garment.waist_ring, body) {
            let off = (pin.position(&body.points) - garment.mesh.points[pin.vertex]).norm();
            assert!(off < 1e-9, "{name} vertex {}: {off} m", pin.vertex);
            assert!((pin.weights.iter().sum::<f64>() - 1.0).abs() < 1e-12 && pin.weights.iter().all(|w| *w >= 0.0));
            assert!(pin.offset[2] > 0.0, "{name}: the normal points out of the body");
        }
    }
}

#[test]
fn the_tshirt_cannot_slip_over_the_shoulders() {
    let wardrobe = default_wardrobe();
    let mesh = &garment(wardrobe, "tshirt").mesh;
    let height = |ring: &Vec<usize>| ring.iter().map(|&v| mesh.points[v].y).sum::<f64>() / ring.len() as f64;
    let neck = mesh.boundary_loops().into_iter().max_by(|a, b| height(a).total_cmp(&height(b))).unwrap();
    let half_width = neck.iter().map(|&v| mesh.points[v].x).fold(0.0, f64::max);
    assert!(half_width < 0.7 * shoulder(Side::Left).x, "{half_width} m");
}

#[test]
fn orders_out_of_range_are_refused() {
    let make = |change: fn(&mut Order)| {
        let mut order = Order::default();
        change(&mut order);
        Wardrobe::make(&order).err()
    };
    assert!(matches!(make(|order| order.resolution = f64::NAN), Some(ExportError::Resolution(_))));
    assert!(matches!(make(|order| order.resolution = 0.1), Some(ExportError::Resolution(_))));
    assert!(matches!(make(|order| order.frames = [9, 8]), Some(ExportError::Frames { .. })));
    assert!(matches!(make(|order| order.frames_per_second = 0.0), Some(ExportError::FrameRate(_))));
}
