//! The same bits on any number of ranks and threads.

use std::sync::Arc;

use drapery_core::Vec3;
use drapery_core::geometry::shapes::Shape;
use drapery_core::mesh::PolygonMesh;
use drapery_core::parallel::communicator::Communicator;
use drapery_core::parallel::local_ranks::LocalRanks;
use drapery_core::parallel::ranks::Ranks;
use drapery_core::scene::vertex_maps::PaintedMap;
use drapery_core::scene::{
    BodyDescription, BodyShape, EffectRequest, GarmentDescription, Integrator, PinAnchor, PinDescription, PinHold,
    PinTarget, RigidMotion, Scene, SceneDescription, SeamDescription, WindGridShape,
};
use drapery_core::settings::SettingValue;
use drapery_core::simulation::{FrameInput, FrameSummary, Sample, Simulation};
use drapery_core::snapshot::Snapshot;
use drapery_core::wind_grid::WindSample;
use drapery_tests::*;

/// Ranks, and threads of each.
const COUNTS: [[usize; 2]; 3] = [[1, 1], [3, 2], [8, 1]];

/// A scene and the frames of its bodies and tracks.
pub(crate) struct Shot {
    pub(crate) description: SceneDescription,
    pub(crate) input: fn(i64) -> FrameInput,
    pub(crate) frames: i64,
}

/// Outcome of a run: its state, and the summary of every frame.
type Outcome = (Snapshot, Vec<FrameSummary>);

impl Shot {
    /// One rank's side of the run.
    fn simulate(&self, communicator: Arc<dyn Communicator>, from: Option<&Snapshot>, frames: [i64; 2]) -> Outcome {
        let ranks = Ranks::new(communicator);
        let first = || ranks.is_first();
        let scene = Scene::distribute(&ranks, first().then(|| self.description.clone())).expect("a valid scene");
        let input = |scene: &Scene, frame: i64| scene.share_input(first().then(|| (self.input)(frame)));
        let start = input(&scene, frames[0]);
        let mut simulation = match from {
            None => Simulation::new(scene, &start).expect("a start"),
            Some(snapshot) => {
                let mut snapshot = snapshot.clone();
                Simulation::restore_from(scene, &start, first().then_some(&mut snapshot as _)).expect("a snapshot")
            }
        };
        let mut summaries = Vec::new();
        for frame in frames[0] + 1..=frames[1] {
            if frame == 3 {
                simulation.assign(uneven(simulation.scene())).expect("parts change their ranks");
            }
            let input = input(simulation.scene(), frame);
            summaries.push(simulation.advance(&input).expect("a frame"));
        }
        (simulation.snapshot(), summaries)
    }

    fn run(&self, [ranks, threads]: [usize; 2], from: Option<&Snapshot>, frames: [i64; 2]) -> Outcome {
        let work = |communicator| self.simulate(communicator, from, frames);
        let all = LocalRanks::run(ranks, threads, work).unwrap_or_else(|e| panic!("{ranks} ranks: {e}"));
        all.into_iter().next().expect("there is a first rank")
    }

    /// Any number of ranks comes to the same, and so does a run that goes on with another number.
    pub(crate) fn has_the_same_bits_everywhere(&self) {
        let [one, ..] = COUNTS;
        let (whole, summaries) = self.run(one, None, [0, self.frames]);
        for count in &COUNTS[1..] {
            let (snapshot, found) = self.run(*count, None, [0, self.frames]);
            assert_alike(&snapshot, &whole, &format!("{count:?} ranks and threads"));
            for (a, b) in found.iter().zip(&summaries) {
                assert_eq!((a.steps, a.cg_iterations), (b.steps, b.cg_iterations), "{count:?}, frame {}", a.frame);
                let figures = |s: &FrameSummary| [s.kinetic_energy, s.potential_energy, s.dt_min].map(f64::to_bits);
                assert_eq!(
                    (figures(a), &a.max_strain, &a.strains, &a.overstretched),
                    (figures(b), &b.max_strain, &b.strains, &b.overstretched),
                    "{count:?}, frame {}",
                    a.frame
                );
                for (name, amount) in b.metrics.counts() {
                    assert_eq!(a.metrics.counted(name), *amount, "{name}, {count:?}, frame {}", a.frame);
                }
            }
        }
        let middle = self.frames / 2;
        let (half, _) = self.run([4, 1], None, [0, middle]);
        let (snapshot, _) = self.run([2, 1], Some(&half), [middle, self.frames]);
        assert_alike(&snapshot, &whole, "four ranks, then two");
    }
}

/// Another assignment of the parts: all but one to the last rank that gets any, which is not the last one.
fn uneven(scene: &Scene) -> Vec<usize> {
    let parts = scene.parts();
    let (count, ranks) = (parts.partition().sizes().len(), parts.ranks().count());
    (0..=ranks)
        .map(|rank| {
            if rank == 0 {
                0
            } else if rank == 1 && ranks > 2 {
                1
            } else {
                count
            }
        })
        .collect()
}

fn assert_alike(a: &Snapshot, b: &Snapshot, what: &str) {
    assert_eq!(a.sections.len(), b.sections.len(), "{what}");
    for (a, b) in a.sections.iter().zip(&b.sections) {
        assert_eq!((&a.name, a.version), (&b.name, b.version), "{what}");
        for (x, y) in a.datasets.iter().zip(&b.datasets) {
            assert!(x == y, "{what}: {}/{} differs", a.name, x.name);
        }
    }
}

/// A sheet of 81 by 81 vertices, 1 m wide, in four parts, with stretch, bending and gravity, at 120 frames a second.
fn cloth(height: f64) -> SceneDescription {
    let mut mesh = sheet(80, 80, 1.0 / 80.0);
    mesh.points.iter_mut().for_each(|p| p.y += height);
    let mut description = scene_of(GarmentDescription::new("sheet", mesh, 0.2), 120);
    add_gravity(&mut description, [0.0, -9.81, 0.0]);
    description.effects.push(EffectRequest::of_garment("stretch", 0).with("stiffness", 200.0));
    description.effects.push(EffectRequest::of_garment("bending", 0).with("stiffness", 5.0));
    description
}

pub(crate) fn no_input(frame: i64) -> FrameInput {
    FrameInput::to_frame(frame)
}

#[test]
fn a_hanging_sheet_with_springs_and_late_pins() {
    let mut description = cloth(0.0);
    add_pins(&mut description, vec![0, 80]);
    description.pins.push(PinDescription {
        garment: 0,
        target: PinTarget::Path {
            anchor: PinAnchor::WhenHeld,
            vertices: vec![6480, 6560],
            offsets: vec![(0.0, Vec3::zeros()), (0.1, Vec3::y() * 0.02)],
        },
        axes: [true, false, true],
        from: 0.01,
        until: 0.025,
        hold: PinHold::Hard,
    });
    description.pins.push(PinDescription {
        garment: 0,
        target: PinTarget::Path { anchor: PinAnchor::Start, vertices: vec![3000, 40, 3300], offsets: Vec::new() },
        axes: [true; 3],
        from: 0.004,
        until: f64::INFINITY,
        hold: PinHold::Spring { stiffness: 30.0, damping_ratio: 0.5, break_force: Some(0.4) },
    });
    description.effects.push(EffectRequest::of_scene("attachments"));
    Shot { description, input: no_input, frames: 4 }.has_the_same_bits_everywhere();
}

/// Returns the positions of the vertices of the first garment after three frames [m], from rank 0.
fn places(description: &SceneDescription, [ranks, threads]: [usize; 2]) -> Vec<Vec3> {
    let work = |communicator| {
        let ranks = Ranks::new(communicator);
        let scene = Scene::distribute(&ranks, ranks.is_first().then(|| description.clone())).expect("a valid scene");
        let mut simulation = Simulation::new(scene, &no_input(0)).expect("a start");
        for frame in 1..=3 {
            if frame == 3 {
                simulation.assign(uneven(simulation.scene())).expect("parts change their ranks");
            }
            simulation.advance(&no_input(frame)).expect("a frame");
        }
        let mut x = Vec::new();
        simulation.garment_positions(0, &mut x);
        x
    };
    let all = LocalRanks::run(ranks, threads, work).unwrap_or_else(|e| panic!("{ranks} ranks: {e}"));
    all.into_iter().next().expect("there is a first rank")
}

#[test]
fn a_sheet_with_elements_that_take_no_part_and_vertices_that_go_with_others() {
    let mut description = cloth(0.21);
    let mesh = &mut description.garments[0].mesh;
    let (mut points, mut triangles) = (mesh.points.clone(), mesh.face_indices.as_chunks().0.to_vec());
    // On a corner, beside another on the line of its edge, and alone; faces twice and without area.
    points.extend([points[6560], points[80] + Vec3::x(), Vec3::repeat(0.4)]);
    triangles.extend([[6560, 6561, 6559], [79, 80, 6562], [3000, 3001, 3002], triangles[77]]);
    *mesh = PolygonMesh::from_triangles(points, &triangles);
    add_body(&mut description, BodyShape::Rigid(Shape::Sphere { radius: 0.2 }), RigidMotion::at(Vec3::zeros()), 0.4);
    let whole = places(&description, [1, 1]);
    assert_eq!(whole[6561], whole[6560]);
    assert!((whole[6562] - whole[80] - Vec3::x()).norm() < 1e-12);
    assert_eq!(whole[6563], Vec3::repeat(0.4));
    for count in [[3, 2], [7, 1]] {
        assert!(places(&description, count) == whole, "{count:?}");
    }
    Shot { description, input: no_input, frames: 4 }.has_the_same_bits_everywhere();
}

#[test]
fn two_garments_that_fall_on_a_spinning_ball_and_on_a_floor() {
    let mut description = cloth(0.21);
    description.garments[0].velocity = Vec3::new(0.0, -1.0, 0.0);
    let mut small = GarmentDescription::new("small", sheet(12, 9, 0.02), 0.3);
    small.mesh.points.iter_mut().for_each(|p| *p += Vec3::new(0.6, 0.01, 0.6));
    description.garments.push(small);
    description.effects.push(EffectRequest::of_garment("stretch", 1).with("stiffness", 100.0));
    let motion = RigidMotion { angular_velocity: Vec3::y() * 3.0, ..RigidMotion::at(Vec3::zeros()) };
    add_body(&mut description, BodyShape::Rigid(Shape::Sphere { radius: 0.2 }), motion, 0.4);
    add_body(&mut description, BodyShape::Rigid(Shape::HalfSpace), RigidMotion::at(Vec3::zeros()), 0.2);
    Shot { description, input: no_input, frames: 4 }.has_the_same_bits_everywhere();
}

/// A crumpled sheet that goes on folding, some folds for good.
fn crumpling() -> SceneDescription {
    let mut description = cloth(0.0);
    description.effects.pop();
    let bending = EffectRequest::of_garment("dihedral_bending", 0);
    description.effects.push(bending.with("stiffness", 1e-5).with("damping_ratio", 0.5));
    let wrinkles = EffectRequest::of_garment("plastic_wrinkles", 0).with("yield_radius", 0.1);
    description.effects.push(wrinkles.with("hardening", 0.2));
    let wave = |p: &Vec3| p + Vec3::y() * (0.004 * (40.0 * p.x + 9.0 * p.z).sin() * (31.0 * p.z).cos());
    description.garments[0].start = Some(description.garments[0].mesh.points.iter().map(wave).collect());
    add_pins(&mut description, vec![0, 80]);
    description
}

#[test]
fn a_crumpled_sheet_that_keeps_some_folds() {
    let shot = Shot { description: crumpling(), input: no_input, frames: 4 };
    let (_, summaries) = shot.run([1, 1], None, [0, shot.frames]);
    let yielded = |frame: usize| summaries[frame].metrics.counted("hinges_yielded");
    assert!((0..4).all(|frame| yielded(frame) > 10), "folds stay in every frame");
    shot.has_the_same_bits_everywhere();
}

/// The swelling ball as a body.
fn ball() -> BodyDescription {
    let (triangles, points) = swelling_ball(0.0);
    let shape = BodyShape::Surface { triangles, point_count: points.len() };
    BodyDescription {
        friction: 0.3,
        thickness: 0.001,
        ..BodyDescription::new("ball", shape, RigidMotion::at(Vec3::zeros()))
    }
}

/// The swelling ball, and three points that a pin follows.
fn ball_and_track(frame: i64) -> FrameInput {
    let time = frame as f64 / 120.0;
    let at = |x: f64| Vec3::new(x, 0.26 + 0.1 * time, 0.5);
    let track = vec![Sample { time, positions: vec![at(-0.5), at(0.5), at(0.0)] }];
    let ball = vec![Sample { time, positions: swelling_ball(time).1 }];
    FrameInput { frame, bodies: vec![ball], tracks: vec![track], ..FrameInput::default() }
}

#[test]
fn a_sheet_on_a_deforming_ball_that_follows_a_track() {
    let mut description = cloth(0.26);
    description.bodies.push(ball());
    description.effects.push(EffectRequest::of_scene("body_collision"));
    let pin = |target| PinDescription {
        garment: 0,
        target,
        axes: [true; 3],
        from: f64::NEG_INFINITY,
        until: f64::INFINITY,
        hold: PinHold::Hard,
    };
    description.pins.push(pin(PinTarget::Track { vertices: vec![6480, 6560, 6520], track: 0 }));
    description.pins.push(pin(PinTarget::BodyNearest { body: 0, vertices: vec![3280, 3281] }));
    description.effects.push(EffectRequest::of_scene("pins"));
    Shot { description, input: ball_and_track, frames: 4 }.has_the_same_bits_everywhere();
}

/// A sheet 1 mm over another, which falls and folds over a swelling ball.
fn two_sheets_on_a_ball() -> SceneDescription {
    let mut description = cloth(0.205);
    let mut upper = GarmentDescription::new("upper", sheet(50, 50, 0.011), 0.2);
    upper.mesh.points.iter_mut().for_each(|p| *p += Vec3::new(0.003, 0.21, 0.004));
    upper.velocity = Vec3::new(0.0, -2.0, 0.3);
    description.garments.push(upper);
    description.effects.push(EffectRequest::of_garment("stretch", 1).with("stiffness", 100.0));
    description.bodies.push(ball());
    for effect in ["body_collision", "self_repulsion", "self_collision"] {
        description.effects.push(EffectRequest::of_scene(effect));
    }
    description.garments.iter_mut().for_each(|garment| garment.thickness = 0.004);
    description
}

#[test]
fn two_sheets_that_meet_on_a_deforming_ball() {
    let ball = |frame| FrameInput { tracks: Vec::new(), ..ball_and_track(frame) };
    let shot = Shot { description: two_sheets_on_a_ball(), input: ball, frames: 4 };
    let (_, summaries) = shot.run([1, 1], None, [0, shot.frames]);
    let counted = |name: &str| summaries.iter().map(|summary| summary.metrics.counted(name)).sum::<u64>();
    assert!(counted("repulsions") > 0 && counted("collision_hits") > 0, "the sheets meet");
    shot.has_the_same_bits_everywhere();
}

/// Every effect that works on triangles or edges over borders of parts, with pins that come and go.
#[test]
fn a_membrane_with_altitudes_ether_and_a_limit_on_its_strain() {
    let mut description = cloth(0.0);
    description.effects.retain(|effect| effect.effect == "gravity");
    let membrane = EffectRequest::of_garment("membrane", 0).with("warp", 6.0).with("weft", 2.0).with("shear", 0.5);
    description.effects.push(membrane.with_vector("grain", [1.0, 0.0, 0.4]).with("thin_triangles", 0.1));
    description.effects.push(EffectRequest::of_garment("shear", 0).with("stiffness", 1.0).with("compressed_by", 0.02));
    let limit = EffectRequest::of_garment("strain_limit", 0).with("limit", 0.02).with("compression", 0.3);
    description.effects.push(limit.with("sweeps", 40.0));
    description.effects.push(EffectRequest::of_scene("ether_drag").with("rate", 1.0));
    // Thrown apart, so that the limit acts from the start and across all borders.
    let apart = |p: &Vec3| Vec3::new(2.0 * p.x, (9.0 * p.z).sin(), 2.0 * p.z);
    let points = &description.garments[0].mesh.points;
    description.garments[0].start_velocities = Some(points.iter().map(apart).collect());
    add_pins(&mut description, vec![0, 80]);
    description.pins.push(PinDescription {
        garment: 0,
        target: PinTarget::Path { anchor: PinAnchor::WhenHeld, vertices: vec![3280, 3281], offsets: Vec::new() },
        axes: [true, false, true],
        from: 0.01,
        until: 0.025,
        hold: PinHold::Hard,
    });
    let shot = Shot { description, input: no_input, frames: 4 };
    let (_, summaries) = shot.run([1, 1], None, [0, shot.frames]);
    assert!(summaries.iter().all(|s| s.metrics.counted("strain_limit_sweeps") > 0), "the limit acts");
    shot.has_the_same_bits_everywhere();
}

/// Gusts that turn and grow, on 4 by 4 by 4 nodes.
fn gusts(frame: i64) -> FrameInput {
    let time = frame as f64 / 120.0;
    let node = |k: usize| {
        let phase = 0.7 * k as f64 + 40.0 * time;
        Vec3::new(8.0 * phase.sin(), 5.0 * phase.cos(), 3.0)
    };
    FrameInput { wind: vec![WindSample { time, velocities: (0..64).map(node).collect() }], ..no_input(frame) }
}

#[test]
fn a_hanging_sheet_in_gusts_of_a_grid() {
    let mut description = cloth(0.0);
    add_pins(&mut description, vec![0, 80]);
    let shape = WindGridShape { origin: Vec3::repeat(-0.6), spacing: Vec3::repeat(0.4), counts: [4; 3] };
    description.wind = Some(shape);
    let mut wind = EffectRequest::of_scene("wind").with("density", 1.0).with("tangential", 0.1).with("normal", 0.5);
    wind = wind.with_keys("keys", vec![(0.0, [1.0, 0.0, 0.0]), (0.02, [0.0, 0.0, 2.0])]);
    wind.settings.insert("file".into(), SettingValue::Text("gusts.h5".into()));
    description.effects.push(wind);
    Shot { description, input: gusts, frames: 4 }.has_the_same_bits_everywhere();
}

#[test]
fn balloons_of_pressure_and_of_gas() {
    let (triangles, points) = unit_ball(40, 60);
    let mut description = scene_of(GarmentDescription::new("sheet", sheet(30, 30, 0.02), 0.2), 120);
    description.effects.push(EffectRequest::of_garment("stretch", 0).with("stiffness", 100.0));
    for (g, gas) in [(1, false), (2, true)] {
        let at = |p: &Vec3| p * 0.2 + Vec3::new(0.5 * g as f64, 0.5, 0.0);
        let mesh = PolygonMesh::from_triangles(points.iter().map(at).collect(), &triangles);
        description.garments.push(GarmentDescription::new(&format!("ball{g}"), mesh, 0.2));
        description.effects.push(EffectRequest::of_garment("stretch", g).with("stiffness", 100.0));
        let pressure = EffectRequest::of_garment("pressure", g).with("overpressure", 60.0);
        description.effects.push(pressure.with_flag("gas", gas).with("ambient", 1e3));
    }
    add_gravity(&mut description, [0.0, -9.81, 0.0]);
    for integrator in [Integrator::SemiImplicit, Integrator::TrBdf2] {
        description.solver.integrator = integrator;
        Shot { description: description.clone(), input: no_input, frames: 4 }.has_the_same_bits_everywhere();
    }
}

#[test]
fn a_seam_between_two_garments_and_one_across_a_garment() {
    let mut description = cloth(0.0);
    let mut small = GarmentDescription::new("small", sheet(40, 60, 0.0125), 0.3);
    small.mesh.points.iter_mut().for_each(|p| *p += Vec3::new(0.8, 0.05, 0.0));
    description.garments.push(small);
    description.effects.push(EffectRequest::of_garment("stretch", 1).with("stiffness", 100.0));
    let seam = |garments, pairs: Vec<[u32; 2]>| SeamDescription {
        from: 0.005,
        until: 0.03,
        rest_gap: Some(0.001),
        damping_ratio: 0.5,
        ..SeamDescription::new(garments, pairs, 50.0)
    };
    description.seams.push(seam([0, 1], (0..=60).map(|k| [80 + 81 * (k + 10), 41 * k]).collect()));
    let across = seam([0, 0], (0..=80).map(|k| [81 * k, 81 * k + 70]).collect());
    description.seams.push(SeamDescription { zip: true, opens: Some(0.03), opened: Some(0.036), ..across });
    description.effects.push(EffectRequest::of_scene("seams"));
    Shot { description, input: no_input, frames: 4 }.has_the_same_bits_everywhere();
}

#[test]
fn the_implicit_step_on_a_deforming_ball() {
    let ball = |frame| FrameInput { tracks: Vec::new(), ..ball_and_track(frame) };
    let mut description = two_sheets_on_a_ball();
    description.solver.integrator = Integrator::TrBdf2;
    let shot = Shot { description, input: ball, frames: 2 };
    let (_, summaries) = shot.run([1, 1], None, [0, shot.frames]);
    let counted = |name: &str| summaries.iter().map(|summary| summary.metrics.counted(name)).sum::<u64>();
    assert!(counted("repulsions") > 0 && counted("body_contacts") > 0, "the sheets meet, and the ball");
    shot.has_the_same_bits_everywhere();
}

#[test]
fn the_implicit_step_of_a_sheet_that_slides_over_a_spinning_ball() {
    let mut description = cloth(0.2005);
    description.solver.integrator = Integrator::TrBdf2;
    description.garments[0].velocity = Vec3::new(1.0, -0.5, 0.0);
    let motion = RigidMotion { angular_velocity: Vec3::z() * 3.0, ..RigidMotion::at(Vec3::zeros()) };
    add_body(&mut description, BodyShape::Rigid(Shape::Sphere { radius: 0.2 }), motion, 0.4);
    let shot = Shot { description, input: no_input, frames: 4 };
    let (_, summaries) = shot.run([1, 1], None, [0, shot.frames]);
    assert!(summaries.iter().any(|summary| summary.metrics.counted("body_contacts") > 0), "it lies on the ball");
    shot.has_the_same_bits_everywhere();
}

#[test]
fn a_painted_sheet_that_is_blown_over_a_floor() {
    let mut description = cloth(0.003);
    description.garments[0].thickness = 0.002;
    description.garments[0].velocity = Vec3::new(1.0, -0.5, 0.3);
    add_body(&mut description, BodyShape::Rigid(Shape::HalfSpace), RigidMotion::at(Vec3::zeros()), 0.3);
    description.effects.push(EffectRequest::of_scene("self_repulsion"));
    let wind = EffectRequest::of_scene("wind").with("density", 1.0).with_vector("velocity", [2.0, 1.0, 0.0]);
    description.effects.push(wind);
    description.effects.push(EffectRequest::of_scene("ether_drag").with("rate", 1.0));
    for effect in ["dihedral_bending", "shear"] {
        description.effects.push(EffectRequest::of_garment(effect, 0).with("stiffness", 1e-5));
    }
    description.effects.push(EffectRequest::of_garment("plastic_wrinkles", 0).with("yield_radius", 0.5));
    let limit = EffectRequest::of_garment("strain_limit", 0).with("limit", 0.02).with("compression", 0.2);
    description.effects.push(limit.with("sweeps", 2.0));
    for (name, absolute, step) in
        [("density", false, 1e-4), ("thickness", true, 1e-7), ("friction", true, 1e-4), ("stretch", false, 1e-4)]
    {
        let values = (0..81 * 81).map(|v| step * (2000 + v) as f64).collect();
        description.garments[0].maps.insert(name.into(), PaintedMap { values, absolute });
    }
    let laws = ["stretch_damping", "shear_damping", "dihedral_bending_damping", "yield_radius", "compression"];
    for name in
        ["wind", "ether_drag", "dihedral_bending", "shear", "strain_limit", "self_friction"].into_iter().chain(laws)
    {
        let values = (0..81 * 81).map(|v| f64::from(v % 3)).collect();
        description.garments[0].maps.insert(name.into(), PaintedMap { values, absolute: false });
    }
    Shot { description, input: no_input, frames: 4 }.has_the_same_bits_everywhere();
}
