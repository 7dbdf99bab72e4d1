//! Tests of the guarantees of a moving surface.

use super::*;
use crate::geometry::random::SplitMix64;
use crate::geometry::testing::{cube, torus};

fn at_rest(mesh: (Vec<[u32; 3]>, Vec<Vec3>)) -> MovingSurface {
    let mut surface = MovingSurface::new(mesh.0, mesh.1.len()).unwrap();
    surface.set_samples(0.0, &mesh.1, 0.0, &mesh.1).unwrap();
    surface
}

/// Turns, twists and shifts; `amount` 0 is the identity.
fn deformed(x: &[Vec3], amount: f64) -> Vec<Vec3> {
    let twist = |p: &Vec3| {
        let (sin, cos) = (amount * (1.0 + 0.3 * p.y)).sin_cos();
        Vec3::new(cos * p.x - sin * p.z, p.y + 0.2 * amount * p.x, sin * p.x + cos * p.z)
    };
    x.iter().map(twist).collect()
}

#[test]
fn the_sign_of_the_distance_is_that_of_the_winding_number() {
    let mut random = SplitMix64::new(41);
    for mesh in [cube(), torus(20, 0.9, 0.35)] {
        let surface = at_rest((mesh.0, deformed(&mesh.1, 0.4)));
        assert!(surface.is_closed());
        let mut inside = 0;
        for _ in 0..4000 {
            let p = random.vector() * 1.3;
            let found = surface.closest(&p, 10.0, None).unwrap();
            assert_eq!(found.distance < 0.0, surface.winding_number(&p) == 1, "{p:?} {found:?}");
            assert!(((p - found.point).norm() - found.distance.abs()).abs() < 1e-14);
            assert!((found.point + found.gradient(&p) * found.distance - p).norm() < 1e-12);
            inside += usize::from(found.distance < 0.0);
        }
        assert!(inside > 300);
    }
}

#[test]
fn the_closest_point_is_the_one_a_look_at_every_triangle_finds_whatever_the_hint() {
    let (triangles, x) = torus(20, 0.9, 0.35);
    let surface = at_rest((triangles.clone(), x.clone()));
    let mut random = SplitMix64::new(42);
    for round in 0..1000 {
        // Every fourth point is a vertex or on an edge: several triangles are equally close.
        let t = triangles[round % triangles.len()].map(|v| x[v as usize]);
        let p = [random.vector(), random.vector(), t[0], (t[0] + t[1]) * 0.5][round % 4];
        let all = triangles
            .iter()
            .enumerate()
            .map(|(i, t)| (closest_on_triangle(&p, &t.map(|v| x[v as usize])).distance_squared, i as u32));
        let (expected, triangle) = all.min_by(|a, b| a.partial_cmp(b).unwrap()).unwrap();
        let found = surface.closest(&p, 10.0, None);
        assert_eq!(found.map(|f| f.triangle), Some(triangle));
        assert!((found.unwrap().distance.abs() - expected.sqrt()).abs() < 1e-15);
        for hint in [0, 77, triangle, 1_000_000] {
            assert_eq!(surface.closest(&p, 10.0, Some(hint)), found);
        }
        assert!(surface.closest(&p, 0.999 * expected.sqrt() - 1e-12, Some(triangle)).is_none());
    }
}

#[test]
fn a_neighbourhood_answers_like_the_tree_or_not_at_all() {
    let (triangles, a) = torus(20, 0.9, 0.35);
    // Turned, twisted and carried along; at rest for comparison.
    let b: Vec<Vec3> = deformed(&a, 0.1).iter().map(|p| p + Vec3::new(0.3, -0.1, 0.2)).collect();
    let mut random = SplitMix64::new(47);
    for (b, least) in [(&b, 1500), (&a, 5000)] {
        let mut surface = MovingSurface::new(triangles.clone(), a.len()).unwrap();
        surface.set_samples(0.0, &a, 1.0, b).unwrap();
        let [mut held, mut not, mut nothing] = [0; 3];
        for round in 0..1000 {
            let start = random.signed().abs();
            surface.set_step(0.0, start);
            // Beside the surface, on a vertex, where triangles are equally close, and anywhere.
            let vertex = round % a.len();
            let on_it = surface.positions()[vertex];
            let p = [on_it + random.vector() * 0.02, on_it, random.vector()][round % 3];
            let (margin, reach) = ([0.01, 0.03, 1.0][round % 3], [10.0, 0.005][round % 2]);
            let (found, around) = surface.closest_and_around(&p, reach, Some(7), margin);
            assert_eq!(found, surface.closest(&p, reach, None));
            for _ in 0..10 {
                let time = start + 0.1 * random.signed();
                surface.set_step(0.0, time);
                let place =
                    p + (b[vertex] - a[vertex]) * (surface.end - around.time) + random.vector() * (0.5 * margin);
                match surface.closest_among(&around, &place, reach) {
                    Some(answer) => {
                        assert_eq!(
                            answer,
                            surface.closest(&place, reach, None),
                            "{p:?} at {start}, {place:?} at {time}"
                        );
                        held += 1;
                        nothing += usize::from(answer.is_none());
                    }
                    None => not += 1,
                }
            }
        }
        assert!(held > least && not > 1000 && nothing > 200, "{held} {not} {nothing}");
        // Another interval has another motion.
        let place = surface.positions()[0];
        let (_, around) = surface.closest_and_around(&place, 1.0, None, 0.01);
        assert!(surface.closest_among(&around, &place, 1.0).is_some());
        surface.set_samples(1.0, b, 2.0, &a).unwrap();
        surface.set_step(1.0, 1.0);
        assert!(surface.closest_among(&around, &place, 1.0).is_none());
    }
}

#[test]
fn a_pseudo_normal_does_not_depend_on_how_the_sides_are_cut_into_triangles() {
    let (triangles, corners) = cube();
    let surface = at_rest((triangles, corners.clone()));
    for corner in corners {
        // Three right angles meet here, each cut into one or two triangles.
        let at_corner = surface.closest(&(corner * 2.0), 10.0, None).unwrap();
        assert!((at_corner.normal - corner.normalize()).norm() < 1e-15);
        let beside = Vec3::new(corner.x * 2.0, 0.1, corner.z * 3.0);
        let on_edge = surface.closest(&beside, 10.0, None).unwrap();
        assert!((on_edge.normal - Vec3::new(corner.x, 0.0, corner.z).normalize()).norm() < 1e-15);
        let toward = Vec3::new(corner.x, 0.0, corner.z * 2.0).normalize();
        assert!((on_edge.gradient(&beside) - toward).norm() < 1e-15);
    }
}

#[test]
fn the_gradient_on_the_surface_is_its_normal() {
    let (triangles, x) = torus(20, 0.9, 0.35);
    let surface = at_rest((triangles.clone(), x.clone()));
    let mut random = SplitMix64::new(45);
    for t in &triangles {
        let [a, b, c] = t.map(|v| x[v as usize]);
        let normal = (b - a).cross(&(c - a)).normalize();
        // On the face up to rounding, and a nanometre off it, where the direction has digits again.
        for height in [0.0, 1e-9 * random.signed()] {
            let p = a * 0.3 + b * 0.3 + c * 0.4 + normal * height;
            let found = surface.closest(&p, 1.0, None).unwrap();
            assert!((found.gradient(&p) - normal).norm() < 1e-3, "{height}");
        }
    }
}

#[test]
fn the_velocity_is_that_of_the_samples_and_steps_join_without_a_gap() {
    let (triangles, a) = torus(12, 1.0, 0.3);
    let b = deformed(&a, 0.3);
    let mut surface = MovingSurface::new(triangles, a.len()).unwrap();
    surface.set_samples(1.0, &a, 1.5, &b).unwrap();
    let weights = [0.2, 0.3, 0.5];
    let motion = surface.point_at(5, weights, 1.0) - surface.point_at(5, weights, 0.0);
    assert!((surface.velocity(5, weights) - motion / 0.5).norm() < 1e-14);
    surface.set_step(1.0, 1.125);
    let quarter = (a[7] * 3.0 + b[7]) / 4.0;
    assert!((surface.positions()[7] - quarter).norm() < 1e-15);
    surface.set_step(1.125, 1.5);
    assert_eq!(surface.positions(), &b[..]);
    surface.set_samples(1.5, &b, 1.5, &b).unwrap();
    assert_eq!((surface.velocity(5, weights), surface.positions()), (Vec3::zeros(), &b[..]));
}

#[test]
fn a_node_that_ends_inside_a_deforming_body_was_seen_entering_it() {
    let (triangles, a) = torus(24, 0.9, 0.3);
    let flight = Vec3::new(1.5, -0.5, 0.7); // much more than the body is thick
    let b: Vec<Vec3> = deformed(&a, 0.5).iter().map(|p| p + flight).collect();
    let mut surface = MovingSurface::new(triangles, a.len()).unwrap();
    surface.set_samples(0.0, &a, 1.0, &b).unwrap();
    let mut random = SplitMix64::new(43);
    let (mut entered, mut passed) = (0, 0);
    for _ in 0..6000 {
        let (from, to) = (random.vector() * 1.4, random.vector() * 1.4 + flight);
        surface.set_step(0.0, 0.0);
        let starts_outside = surface.winding_number(&from) == 0;
        surface.set_step(0.0, 1.0);
        let ends_inside = surface.winding_number(&to) == 1;
        let hit = surface.path_hit(&from, &to, Crossings::Entering);
        if let Some(hit) = hit {
            let node = from * (1.0 - hit.fraction) + to * hit.fraction;
            assert!((surface.point_at(hit.triangle, hit.weights, hit.fraction) - node).norm() < 1e-8);
            assert_eq!(hit.side, Side::Front);
        }
        if starts_outside {
            assert!(hit.is_some() || !ends_inside);
            entered += usize::from(ends_inside);
            passed += usize::from(hit.is_some() && !ends_inside);
        }
    }
    assert!(entered > 100 && passed > 100, "{entered} {passed}");
}

#[test]
fn a_thin_limb_at_fifty_metres_a_second_does_not_jump_over_a_node() {
    // 1 cm thick, 2 m of way in a frame; the node waits half-way and has no velocity of its own.
    let (triangles, x) = torus(16, 0.2, 0.005);
    let travel = Vec3::x() * (50.0 / 24.0);
    let moved: Vec<Vec3> = x.iter().map(|p| p + travel).collect();
    let mut surface = MovingSurface::new(triangles, x.len()).unwrap();
    surface.set_samples(0.0, &x, 1.0 / 24.0, &moved).unwrap();
    let node = Vec3::new(1.2, 0.0, 0.011);
    let hit = surface.path_hit(&node, &node, Crossings::Entering).expect("the limb passes through the node");
    let front = 0.205 + 50.0 / 24.0 * hit.fraction;
    assert!((front - 1.2).abs() < 0.01, "hit when the limb's front is at {front} m");
    assert!(surface.closest(&node, 0.1, None).is_none());
}

#[test]
fn every_answer_is_the_one_of_all_triangles_however_steps_lie_in_the_interval() {
    let (triangles, a) = torus(16, 0.9, 0.3);
    let b: Vec<Vec3> = deformed(&a, 0.4).iter().map(|p| p + Vec3::new(0.4, 0.1, -0.2)).collect();
    let mut surface = MovingSurface::new(triangles.clone(), a.len()).unwrap();
    surface.set_samples(0.0, &a, 1.0, &b).unwrap();
    let mut random = SplitMix64::new(46);
    // Forwards, across windows, back to an earlier step, and all at once.
    let mut steps: Vec<[f64; 2]> = (0..40).map(|i| [f64::from(i) / 40.0, f64::from(i + 1) / 40.0]).collect();
    steps.extend([[0.3, 0.31], [0.05, 0.9], [0.12, 0.13], [0.0, 1.0], [0.7, 0.7]]);
    let mut met = 0;
    for [t0, t1] in steps {
        surface.set_step(t0, t1);
        let [start, end] = surface.path().map(<[Vec3]>::to_vec);
        for _ in 0..40 {
            let (from, to) = (random.vector() * 1.4, random.vector() * 1.4);
            let distances =
                triangles.iter().map(|t| closest_on_triangle(&to, &t.map(|v| end[v as usize])).distance_squared);
            let (_, nearest) = distances.zip(0u32..).min_by(|a, b| a.partial_cmp(b).unwrap()).unwrap();
            assert_eq!(surface.closest(&to, 10.0, None).unwrap().triangle, nearest, "{t0} to {t1}");
            let crossing = |t: &[u32; 3]| {
                let at = [&start, &end].map(|x| t.map(|v| x[v as usize]));
                first_crossing(&[from, to], &at[0], &at[1], Crossings::Any).map(|hit| hit.fraction)
            };
            let first = triangles.iter().zip(0u32..).filter_map(|(t, i)| Some((crossing(t)?, i)));
            let first = first.min_by(|a, b| a.partial_cmp(b).unwrap());
            let hit = surface.path_hit(&from, &to, Crossings::Any).map(|hit| (hit.fraction, hit.triangle));
            assert_eq!(hit, first, "{t0} to {t1}");
            met += usize::from(hit.is_some());
        }
    }
    assert!(met > 200, "{met}");
}

#[test]
fn an_open_surface_is_hit_from_both_sides() {
    let sheet = vec![Vec3::zeros(), Vec3::x(), Vec3::z()]; // faces down
    let surface = at_rest((vec![[0, 1, 2]], sheet));
    assert!(!surface.is_closed());
    let (above, below) = (Vec3::new(0.2, 1.0, 0.2), Vec3::new(0.2, -1.0, 0.2));
    assert_eq!(surface.path_hit(&above, &below, Crossings::Any).unwrap().side, Side::Back);
    assert_eq!(surface.path_hit(&below, &above, Crossings::Any).unwrap().side, Side::Front);
    assert!(surface.path_hit(&above, &below, Crossings::Entering).is_none());
}

#[test]
fn faces_without_area_and_doubled_faces_leave_every_answer_finite() {
    let (mut triangles, mut x) = cube();
    x.push(x[0]);
    triangles.extend([[0, 1, 8], [3, 3, 3], triangles[4]]);
    let surface = at_rest((triangles, x));
    let mut random = SplitMix64::new(44);
    for _ in 0..500 {
        let p = random.vector() * 2.0;
        let found = surface.closest(&p, 10.0, None).unwrap();
        let inside = p.iter().all(|c| c.abs() < 1.0);
        assert_eq!(found.distance < 0.0, inside, "{p:?}");
        assert!((found.normal.norm() - 1.0).abs() < 1e-14);
    }
    let needle = at_rest((vec![[0, 1, 2]], vec![Vec3::zeros(), Vec3::x(), Vec3::x() * 2.0]));
    let found = needle.closest(&Vec3::y(), 10.0, None).unwrap();
    assert_eq!((found.distance, found.normal), (1.0, Vec3::y()));
    assert!(needle.closest(&Vec3::zeros(), 1.0, None).unwrap().normal.norm() == 1.0);
}

#[test]
fn bad_input_is_an_error_that_names_the_element() {
    let point = Vec3::zeros();
    assert_eq!(MovingSurface::new(vec![], 3).err(), Some(SurfaceError::NoTriangles));
    let error = MovingSurface::new(vec![[0, 1, 2], [0, 1, 3]], 3).unwrap_err();
    assert_eq!(error, SurfaceError::PointOutOfRange { triangle: 1, point: 3, point_count: 3 });
    let mut surface = MovingSurface::new(vec![[0, 1, 2]], 3).unwrap();
    assert!(surface.closest(&point, 1.0, Some(0)).is_none());
    let good = [point; 3];
    let error = surface.set_samples(0.0, &good, 1.0, &good[..2]).unwrap_err();
    assert_eq!(error, SurfaceError::PointCount { time: 1.0, expected: 3, found: 2 });
    let mut broken = good;
    broken[2].y = f64::NAN;
    let error = surface.set_samples(0.0, &broken, 1.0, &good).unwrap_err();
    assert_eq!(error, SurfaceError::NotFinite { time: 0.0, point: 2 });
    assert_eq!(
        surface.set_samples(2.0, &good, 1.0, &good).unwrap_err(),
        SurfaceError::Times { time_a: 2.0, time_b: 1.0 }
    );
    assert!(surface.set_samples(f64::NAN, &good, 1.0, &good).is_err());
}

#[test]
fn a_closed_surface_that_turns_inside_out_goes_on_with_its_sides_exchanged() {
    let (triangles, points) = cube();
    let reversed: Vec<[u32; 3]> = triangles.iter().map(|[a, b, c]| [*a, *c, *b]).collect();
    let inside_out: Vec<Vec3> = points.iter().map(|p| -p).collect();
    for (triangles, inwards) in [(triangles, false), (reversed, true)] {
        let mut surface = MovingSurface::new(triangles, points.len()).unwrap().facing(inwards);
        surface.set_samples(0.0, &points, 1.0, &inside_out).unwrap();
        // There and back: what it is depends on where it is alone.
        for end in [0.2, 0.8, 0.4, 0.6, 1.0, 0.0] {
            surface.set_step(end, end);
            assert_eq!(surface.is_turned(), end > 0.5, "{end}");
            let outside = surface.closest(&(Vec3::x() * 5.0), 10.0, None).unwrap();
            assert_eq!(outside.distance > 0.0, !inwards, "{end}: {outside:?}");
        }
        surface.set_samples(1.0, &inside_out, 2.0, &inside_out).unwrap();
        assert!(surface.is_turned());
        surface.set_samples(2.0, &inside_out, 3.0, &points).unwrap();
        surface.set_step(2.0, 2.1);
        assert!(surface.is_turned(), "the later pose is the earlier one now");
        surface.set_step(2.9, 3.0);
        assert!(!surface.is_turned());
    }
    // What is flat encloses nothing, and an open surface has no inside.
    let (triangles, points) = cube();
    let flat: Vec<Vec3> = points.iter().map(|p| Vec3::new(p.x, p.y, -1e-6 * p.z)).collect();
    let mut surface = MovingSurface::new(triangles.clone(), points.len()).unwrap();
    surface.set_samples(0.0, &points, 1.0, &flat).unwrap();
    assert!(!surface.is_turned());
    let mut open = MovingSurface::new(triangles[1..].to_vec(), points.len()).unwrap();
    open.set_samples(0.0, &points, 1.0, &inside_out).unwrap();
    assert!(!open.is_turned());
}
