//! Cloth against the faces, edges and corners of meshes: no edge pokes through, and what bodies pinch comes out again.

use drapery_core::Vec3;
use drapery_core::geometry::shapes::Shape;
use drapery_core::mesh::PolygonMesh;
use drapery_core::metrics::Metrics;
use drapery_core::scene::{
    BodyDescription, BodyShape, EffectRequest, GarmentDescription, Integrator, RigidMotion, SceneDescription,
};
use drapery_tests::*;

use crate::{FPS, MeshBody, box_mesh, run_with_mesh, upright_sheet};

const CELLS: usize = 16;

/// A sheet in the plane x = 0 that hangs from its upper border, with both effects of self-contact.
fn hanging() -> SceneDescription {
    hanging_by(5.0)
}

/// The same with springs of this stiffness [N/m].
fn hanging_by(stiffness: f64) -> SceneDescription {
    let mut description = scene_of(upright_sheet(CELLS, 0.025), FPS);
    add_springs(&mut description, stiffness, 1.0);
    add_gravity(&mut description, [0.0, -9.81, 0.0]);
    let top = (CELLS * (CELLS + 1)) as u32;
    add_pins(&mut description, (top..=top + CELLS as u32).collect());
    description.effects.push(EffectRequest::of_scene("self_repulsion"));
    description.effects.push(EffectRequest::of_scene("self_collision"));
    description
}

#[test]
fn no_edge_or_corner_of_a_mesh_pokes_through_cloth() {
    // A plate edge on, thinner than the cloth's cells: no vertex of the cloth needs to come near it. And a cube, corner first.
    let plate = (Vec3::new(0.06, 0.002, 0.06), Vec3::zeros());
    let cube = (Vec3::repeat(0.04), Vec3::new(0.0, 0.6, 0.8));
    for (half, turn) in [plate, cube] {
        let (points, triangles) = box_mesh(half, 1);
        let turn = nalgebra::Rotation3::new(turn);
        let place = |time: f64| -> Vec<Vec3> {
            points.iter().map(|p| turn * p + Vec3::new(1.5 * time - 0.15, -0.1, 0.013)).collect()
        };
        let mut all = Metrics::default();
        let mut farthest = 0.0_f64;
        let body = MeshBody { triangles, points: &place };
        let thickness = |b: &mut BodyDescription| b.thickness = 0.001;
        run_with_mesh(hanging(), &body, thickness, 12, |simulation, summary| {
            assert_eq!(simulation.crossings(), [], "frame {}, {half:?}", summary.frame);
            all.add(&summary.metrics);
            farthest = positions(simulation).iter().map(|x| x.x).fold(farthest, f64::max);
        });
        assert!(farthest > 0.1, "the body takes the cloth along: {farthest} m");
        assert!(all.counted("collision_hits") > 0, "only collisions see the edges");
        assert_eq!((all.counted("pairs_pinched"), all.counted("crossings")), (0, 0));
    }
}

#[test]
fn cloth_pinched_by_a_body_that_crosses_itself_is_counted_and_comes_out_when_it_opens() {
    // One mesh of two boxes that pass 3 cm into each other and part again.
    let (one, faces) = box_mesh(Vec3::new(0.1, 0.25, 0.25), 24);
    let (other, more) = box_mesh(Vec3::new(0.1, 0.24, 0.24), 24);
    let mut triangles = faces;
    triangles.extend(more.iter().map(|t| t.map(|v| v + one.len() as u32)));
    let gap = |time: f64| 0.02 - 0.05 * (std::f64::consts::PI * time.min(1.0)).sin();
    let place = |time: f64| -> Vec<Vec3> {
        let apart = 0.1 + 0.5 * gap(time);
        one.iter().map(|p| p - Vec3::x() * apart).chain(other.iter().map(|p| p + Vec3::x() * apart)).collect()
    };
    let body = MeshBody { triangles, points: &place };
    for integrator in [Integrator::SemiImplicit, Integrator::TrBdf2] {
        let mut description = hanging();
        description.solver.integrator = integrator;
        let mut all = Metrics::default();
        let (mut opens, mut left, mut energy) = (None, Vec::new(), 0.0_f64);
        let properties = |b: &mut BodyDescription| (b.thickness, b.max_push_speed) = (0.002, 1.0);
        run_with_mesh(description, &body, properties, 48, |simulation, summary| {
            all.add(&summary.metrics);
            if gap(simulation.state().time) < 0.0 {
                energy = energy.max(summary.kinetic_energy);
            }
            if opens.is_none() && all.counted("body_pinched") > 0 && gap(simulation.state().time) > 0.0 {
                opens = Some(summary.frame);
            }
            if opens.is_some_and(|frame| summary.frame >= frame + 12) {
                left.push(simulation.crossings().len());
            }
        });
        assert!(all.counted("body_pinched") + all.counted("pairs_pinched") > 0, "{integrator:?}: the bodies pinch");
        assert!(all.counted("crossings") > 0, "{integrator:?}: what is pinched crosses the bodies");
        let none = !left.is_empty() && left.iter().all(|crossings| *crossings == 0);
        assert!(none, "{integrator:?}: still crossing: {left:?}");
        // Surfaces drag cloth along with their mean velocity, and these are mirror images of each other.
        let pinched_in_solves = integrator.spec().pinched_in_solves;
        assert!(!pinched_in_solves || energy < 0.02, "{energy} J while it is pinched");
    }
}

#[test]
fn cloth_comes_free_of_a_hand_that_was_deep_in_a_torso() {
    // One mesh of a torso and a forearm. The sheet hangs in front of the torso. The arm moves through it into the torso within five
    // frames, and comes out under it.
    let (torso, faces) = box_mesh(Vec3::new(0.1, 0.22, 0.22), 16);
    let (arm, more) = box_mesh(Vec3::new(0.02, 0.3, 0.02), 16);
    let mut triangles = faces;
    triangles.extend(more.iter().map(|t| t.map(|v| v + torso.len() as u32)));
    let in_frames = |frames: f64| frames / f64::from(FPS);
    let from_sheet = |time: f64| 0.06 - 0.16 * (std::f64::consts::PI * (time / in_frames(10.0)).min(1.0)).sin();
    let place = |time: f64| -> Vec<Vec3> {
        let (apart, out) = (Vec3::x() * -0.105, Vec3::x() * from_sheet(time));
        torso.iter().map(|p| p + apart).chain(arm.iter().map(|p| p + out)).collect()
    };
    let body = MeshBody { triangles, points: &place };
    for (integrator, is_tight) in
        [Integrator::SemiImplicit, Integrator::TrBdf2].into_iter().flat_map(|i| [(i, true), (i, false)])
    {
        let mut description = hanging_by(100.0);
        if is_tight {
            // It is held below too, as close to the torso as a shirt.
            add_pins(&mut description, (0..=CELLS as u32).collect());
        }
        description.solver.integrator = integrator;
        let rest = description.garments[0].mesh.clone();
        assert!(rest.face_counts.iter().all(|corners| *corners == 3));
        let corners: Vec<usize> = rest.face_indices.iter().map(|v| *v as usize).collect();
        let edges: Vec<[usize; 2]> =
            corners.chunks_exact(3).flat_map(|t| [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]]).collect();
        let properties = |b: &mut BodyDescription| (b.thickness, b.max_push_speed) = (0.002, 1.0);
        let (mut pinched, mut most, mut left) = (0, 0.0_f64, Vec::new());
        run_with_mesh(description, &body, properties, 20, |simulation, summary| {
            pinched += summary.metrics.counted("body_pinched");
            let x = positions(simulation);
            let strain =
                |[a, b]: &[usize; 2]| (x[*a] - x[*b]).norm() / (rest.points[*a] - rest.points[*b]).norm() - 1.0;
            most = edges.iter().map(strain).fold(most, f64::max);
            if summary.frame >= 14 {
                let farthest = x.iter().map(|x| x.x).fold(f64::NEG_INFINITY, f64::max);
                left.push((summary.frame, simulation.crossings().len(), farthest));
            }
        });
        let case = format!("{integrator:?}, held below: {is_tight}");
        assert!(pinched > 0, "{case}: the arm passes through the sheet");
        assert!(most < 0.5, "{case}: an edge is strained by {most}");
        // The arm has left the torso at frame 9.
        let free = left.iter().all(|(_, crossings, farthest)| *crossings == 0 && *farthest < 0.03);
        assert!(free, "{case}: frame, crossings, farthest vertex: {left:?}");
    }
}

#[test]
fn layers_in_a_gap_too_narrow_for_them_are_not_struck_however_short_the_steps_are() {
    // Each layer is to be in the middle of the gap, and collisions keep them apart.
    for integrator in [Integrator::SemiImplicit, Integrator::TrBdf2] {
        let layer = |name: &str, height: f64| {
            let mut garment = GarmentDescription::new(name, sheet(6, 6, 0.02), 0.2);
            garment.mesh.points.iter_mut().for_each(|p| p.y = height);
            (garment.thickness, garment.mesh.points[24].y) = (1e-4, height + 1e-4);
            garment
        };
        let mut description = scene_of(layer("lower", 0.0007), FPS);
        description.garments.push(layer("upper", 0.0021));
        (0..2).for_each(|garment| add_cloth(&mut description, garment, 100.0));
        add_self_contact(&mut description);
        for side in [-1.0, 1.0] {
            let block = BodyShape::Rigid(Shape::Box { half_extents: [0.5, 0.05, 0.5] });
            let motion = RigidMotion::at(Vec3::new(0.0, 0.0015 + side * 0.0515, 0.0));
            add_body(&mut description, block, motion, 0.3);
        }
        description.bodies.iter_mut().for_each(|body| body.thickness = 0.002);
        let shortest = description.timeline.frame_duration() / 400.0;
        (description.solver.integrator, description.solver.max_dt) = (integrator, Some(shortest));
        let mut simulation = start(description);
        let summary = run(&mut simulation, 1);
        assert!(summary.metrics.counted("body_squeezed") > 0 && simulation.crossings().is_empty(), "{integrator:?}");
        let fastest = velocities(&simulation).iter().map(|v| v.norm()).fold(0.0, f64::max);
        assert!(fastest < 1.0, "{integrator:?}: {fastest} m/s");
    }
}

#[test]
fn stiff_cloth_stretched_over_a_rim_comes_to_rest() {
    // A closed cylinder swells by 70 % inside a tube of which the upper end is held above it. At its rim the stretched cloth
    // presses with several times what pairs bear that nothing presses.
    const AROUND: usize = 24;
    let cylinder = |radius: f64, [low, high]: [f64; 2], rings: usize| -> Vec<Vec3> {
        let point = |n: usize| {
            let angle = std::f64::consts::TAU * (n % AROUND) as f64 / AROUND as f64;
            let height = low + (high - low) * (n / AROUND) as f64 / rings as f64;
            Vec3::new(radius * angle.cos(), height, radius * angle.sin())
        };
        (0..(rings + 1) * AROUND).map(point).collect()
    };
    let sides = |rings: usize| -> Vec<[u32; 3]> {
        let quad = |n: usize| {
            let next = n - n % AROUND + (n + 1) % AROUND;
            let [a, b, c, d] = [n, n + AROUND, next + AROUND, next].map(|n| n as u32);
            [[a, b, c], [a, c, d]]
        };
        (0..rings * AROUND).flat_map(quad).collect()
    };
    let (points, mut triangles) = (cylinder(0.1, [0.0, 0.5], 8), sides(8));
    let top = (8 * AROUND) as u32;
    for n in 1..AROUND as u32 - 1 {
        triangles.extend([[0, n, n + 1], [top, top + n + 1, top + n]]);
    }
    let place = |time: f64| -> Vec<Vec3> {
        let swollen = 1.0 + 0.7 * (time * f64::from(FPS) / 6.0).min(1.0);
        points.iter().map(|p| Vec3::new(p.x * swollen, p.y, p.z * swollen)).collect()
    };
    let mesh = PolygonMesh::from_triangles(cylinder(0.11, [0.1, 0.6], 16), &sides(16));
    let mut description = scene_of(GarmentDescription::new("tube", mesh, 0.2), FPS);
    description.garments[0].thickness = 6e-4;
    add_springs(&mut description, 50.0, 1.0);
    add_gravity(&mut description, [0.0, -9.81, 0.0]);
    add_pins(&mut description, (16 * AROUND as u32..17 * AROUND as u32).collect());
    add_self_contact(&mut description);
    set_steps_of_a_frame(&mut description, Integrator::TrBdf2, 8);
    let (mut steps, mut energy) = (0, 0.0_f64);
    let body = MeshBody { triangles, points: &place };
    run_with_mesh(
        description,
        &body,
        |body| body.thickness = 8e-4,
        18,
        |simulation, summary| {
            assert_eq!(simulation.crossings(), [], "frame {}", summary.frame);
            if summary.frame > 14 {
                steps += summary.steps;
                energy = energy.max(summary.kinetic_energy);
            }
        },
    );
    assert!(
        steps <= 48 && energy < 1e-4,
        "{steps} steps in four frames, {energy} J, long after the body has come to rest"
    );
}

#[test]
fn cloth_that_hangs_beside_a_mesh_is_not_drawn_to_it() {
    // Half a millimetre farther off than it would rest at, stretching in its own plane, so slowly that its distance is not measured in
    // each step.
    let (plate, triangles) = box_mesh(Vec3::new(0.05, 1.0, 1.0), 4);
    let place = |_: f64| -> Vec<Vec3> { plate.iter().map(|p| p - Vec3::x() * 0.0605).collect() };
    let body = MeshBody { triangles, points: &place };
    for integrator in [Integrator::SemiImplicit, Integrator::TrBdf2] {
        let mut description = hanging_by(200.0);
        description.solver.integrator = integrator;
        let mut farthest = 0.0_f64;
        let properties = |b: &mut BodyDescription| b.thickness = 0.01;
        run_with_mesh(description, &body, properties, 48, |simulation, _| {
            farthest = positions(simulation).iter().map(|x| x.x.abs()).fold(farthest, f64::max);
        });
        assert!(farthest < 1e-6, "{integrator:?}: {farthest} m towards the body");
    }
}
