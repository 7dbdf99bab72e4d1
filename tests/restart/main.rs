//! A simulation that goes on from a snapshot comes to the same bits as one that was never interrupted.

use drapery_core::Vec3;
use drapery_core::metrics::Metrics;
use drapery_core::scene::{
    BodyDescription, BodyShape, EffectRequest, GarmentDescription, Integrator, PinAnchor, PinDescription, PinHold,
    PinTarget, RigidMotion, Scene, SceneDescription,
};
use drapery_core::simulation::{Advance, FrameInput, RestoreError, Sample, Simulation};
use drapery_core::snapshot::{Snapshot, Values};
use drapery_tests::*;

/// Frames of every run.
const FRAMES: i64 = 5;

/// A scene and what moves in it.
struct Shot {
    name: &'static str,
    description: SceneDescription,
    input: fn(i64) -> FrameInput,
}

impl Shot {
    fn start(&self) -> Simulation {
        Simulation::new(self.scene(), &(self.input)(0)).unwrap_or_else(|p| panic!("{}: {p}", self.name))
    }

    fn scene(&self) -> Scene {
        Scene::validate(self.description.clone()).unwrap_or_else(|p| panic!("{}: {p}", self.name))
    }

    fn restore(&self, frame: i64, snapshot: &Snapshot) -> Simulation {
        Simulation::restore(self.scene(), &(self.input)(frame), snapshot)
            .unwrap_or_else(|e| panic!("{}, frame {frame}: {e}", self.name))
    }
}

fn still(frame: i64) -> FrameInput {
    FrameInput::to_frame(frame)
}

/// The swelling ball with two samples a frame, and a track of two points that sways.
fn ball_and_track(frame: i64) -> FrameInput {
    let times: Vec<f64> = if frame == 0 { vec![0.0] } else { vec![frame as f64 - 0.4, frame as f64] };
    let times = || times.iter().map(|t| t / 24.0);
    let ball = times().map(|time| Sample { time, positions: swelling_ball(time).1 }).collect();
    let sway = |t: f64| Vec3::new(0.3 * t * t, 0.25, 2.0 * (9.0 * t).sin() / 24.0);
    let corners = [Vec3::new(-0.2, 0.0, -0.2), Vec3::new(-0.2, 0.0, 0.2)];
    let track = times().map(|time| Sample { time, positions: corners.map(|c| c + sway(time)).to_vec() }).collect();
    FrameInput { frame, bodies: vec![ball], tracks: vec![track], ..FrameInput::default() }
}

fn add_contact(description: &mut SceneDescription, repulsion: bool, collision: bool) {
    if repulsion {
        description.effects.push(EffectRequest::of_scene("self_repulsion"));
    }
    if collision {
        description.effects.push(EffectRequest::of_scene("self_collision"));
    }
}

/// Two sheets that hit each other at an angle.
fn hitting(repulsion: bool, collision: bool) -> SceneDescription {
    let mut description = SceneDescription::new("hitting");
    for (layer, speed) in [(0, 1.5), (1, -1.5)] {
        let mut mesh = sheet(14, 14, 0.02);
        let turn = nalgebra::Rotation3::new(Vec3::new(0.2, 0.4, 0.1) * f64::from(layer));
        mesh.points.iter_mut().for_each(|p| *p = turn * *p + Vec3::y() * (0.05 * f64::from(layer)));
        let garment = GarmentDescription::new(&format!("layer{layer}"), mesh, 0.2);
        let velocity = Vec3::new(0.0, speed, 0.2);
        description.garments.push(GarmentDescription { thickness: 1e-3, velocity, ..garment });
        let request = EffectRequest::of_garment("stretch", layer as usize);
        description.effects.push(request.with("spring_stiffness", 6.0).with("damping_ratio", 1.0));
    }
    add_contact(&mut description, repulsion, collision);
    description
}

/// A sheet that a swelling ball pushes into folds; corners on a track, bound to the ball, held in mid-air for a while, and on
/// a spring.
fn everything() -> SceneDescription {
    let mut mesh = sheet(20, 20, 0.02);
    mesh.points.iter_mut().for_each(|p| p.y = 0.25 + 0.3 * p.x.abs());
    let mut description =
        scene_of(GarmentDescription { thickness: 2e-3, ..GarmentDescription::new("sheet", mesh, 0.2) }, 24);
    add_gravity(&mut description, [0.0, -9.81, 0.0]);
    add_springs(&mut description, 6.0, 1.0);
    description.effects.push(EffectRequest::of_garment("bending", 0).with("spring_stiffness", 0.1));
    let (triangles, points) = swelling_ball(0.0);
    let shape = BodyShape::Surface { triangles, point_count: points.len() };
    let body = BodyDescription::new("ball", shape, RigidMotion::at(Vec3::zeros()));
    description.bodies.push(BodyDescription { friction: 0.4, thickness: 2e-3, ..body });
    let pin = |target, (from, until), hold| PinDescription { garment: 0, target, axes: [true; 3], from, until, hold };
    let always = (f64::NEG_INFINITY, f64::INFINITY);
    let spring = PinHold::Spring { stiffness: 50.0, damping_ratio: 0.5, break_force: Some(0.5) };
    let here = PinTarget::Path { anchor: PinAnchor::WhenHeld, vertices: vec![440], offsets: Vec::new() };
    description.pins = vec![
        pin(PinTarget::Track { vertices: vec![0, 420], track: 0 }, always, PinHold::Hard),
        pin(PinTarget::BodyNearest { vertices: vec![220], body: 0 }, always, spring),
        pin(here, (1.3 / 24.0, 4.2 / 24.0), PinHold::Hard),
    ];
    for effect in ["pins", "attachments", "body_collision"] {
        description.effects.push(EffectRequest::of_scene(effect));
    }
    add_contact(&mut description, true, true);
    description
}

/// Triangles and points at this time of a torso whose neck is a part of its own, and a hand that passes through a sheet into the torso and
/// out again within the frames.
fn torso_neck_and_hand(time: f64) -> (Vec<[u32; 3]>, Vec<Vec3>) {
    let (mut triangles, mut points) = (Vec::new(), Vec::new());
    let out = 0.08 - 0.2 * (std::f64::consts::PI * time * 24.0 / FRAMES as f64).sin();
    let [torso, neck, hand] = [[0.1, 0.22, 0.22], [0.03, 0.1, 0.03], [0.02, 0.3, 0.02]].map(Vec3::from);
    let places = [Vec3::x() * -0.105, Vec3::new(-0.105, 0.25, 0.15), Vec3::x() * out];
    for (size, place) in [torso, neck, hand].into_iter().zip(places) {
        let (own, faces) = box_mesh(size, 8);
        triangles.extend(faces.iter().map(|t| t.map(|corner| corner + points.len() as u32)));
        points.extend(own.iter().map(|p| p + place));
    }
    (triangles, points)
}

/// The same with two samples a frame.
fn hand(frame: i64) -> FrameInput {
    let times = if frame == 0 { vec![0.0] } else { vec![frame as f64 - 0.4, frame as f64] };
    let sample = |time: f64| Sample { time: time / 24.0, positions: torso_neck_and_hand(time / 24.0).1 };
    FrameInput { frame, bodies: vec![times.into_iter().map(sample).collect()], ..FrameInput::default() }
}

/// A sheet that is held above and below in front of that torso.
fn before_the_torso(integrator: Integrator) -> SceneDescription {
    let mut mesh = sheet(12, 12, 0.04);
    mesh.points.iter_mut().for_each(|p| *p = Vec3::new(0.02, p.x, p.z));
    let mut description = scene_of(GarmentDescription::new("sheet", mesh, 0.2), 24);
    add_springs(&mut description, 6.0, 1.0);
    add_contact(&mut description, true, true);
    add_pins(&mut description, (0..13).chain(156..169).collect());
    let (triangles, points) = torso_neck_and_hand(0.0);
    let shape = BodyShape::Surface { triangles, point_count: points.len() };
    let body = BodyDescription::new("torso", shape, RigidMotion::at(Vec3::zeros()));
    description.bodies.push(BodyDescription { thickness: 2e-3, ..body });
    description.effects.push(EffectRequest::of_scene("body_collision"));
    description.solver.integrator = integrator;
    description
}

fn shots() -> Vec<Shot> {
    let shot = |name, description, input| Shot { name, description, input };
    let mut hanging = scene_of(GarmentDescription::new("sheet", sheet(12, 12, 0.05), 0.2), 24);
    add_gravity(&mut hanging, [0.0, -9.81, 0.0]);
    add_springs(&mut hanging, 6.0, 1.0);
    add_pins(&mut hanging, vec![0, 12]);
    let mut implicit = everything();
    implicit.solver.integrator = Integrator::TrBdf2;
    let mut folding = hitting(true, true);
    for garment in 0..2 {
        let bending = EffectRequest::of_garment("dihedral_bending", garment).with("stiffness", 1e-5);
        let wrinkles = EffectRequest::of_garment("plastic_wrinkles", garment).with("yield_radius", 0.2);
        folding.effects.extend([bending, wrinkles.with("hardening", 0.1)]);
    }
    vec![
        shot("hanging", hanging, still),
        shot("folds that stay", folding, still),
        shot("repulsion alone", hitting(true, false), still),
        shot("collision alone", hitting(false, true), still),
        shot("both", hitting(true, true), still),
        shot("everything", everything(), ball_and_track),
        shot("everything in implicit steps", implicit, ball_and_track),
        shot("a hand in a torso", before_the_torso(Integrator::SemiImplicit), hand),
        shot("a hand in a torso in implicit steps", before_the_torso(Integrator::TrBdf2), hand),
    ]
}

/// The snapshot as bits: equal ones mean equal signs of zeros too.
fn bits(snapshot: &Snapshot) -> Vec<(String, String, Vec<u64>)> {
    let sections = snapshot.sections.iter();
    let datasets = sections.flat_map(|section| section.datasets.iter().map(|d| (section.name.clone(), d)));
    let all = datasets.map(|(section, dataset)| {
        let values = match &dataset.values {
            Values::F64(values) => values.iter().map(|x| x.to_bits()).collect(),
            Values::U64(values) => values.clone(),
            Values::I64(values) => values.iter().map(|x| x.cast_unsigned()).collect(),
            Values::U32(values) => values.iter().map(|x| u64::from(*x)).collect(),
            Values::U8(values) => values.iter().map(|x| u64::from(*x)).collect(),
        };
        (section, dataset.name.clone(), values)
    });
    all.collect()
}

fn assert_same(a: &Snapshot, b: &Snapshot, place: &str) {
    for ((section, name, a), (_, _, b)) in bits(a).iter().zip(&bits(b)) {
        let differing = a.iter().zip(b).filter(|(a, b)| a != b).count();
        assert!(a.len() == b.len() && differing == 0, "{place}: {differing} of {} values of {section}/{name}", a.len());
    }
    assert_eq!(a.sections.len(), b.sections.len());
}

/// Counts of a run, by name; what was counted only on the way of one of two runs is zero in the other.
fn assert_same_counts(a: &Metrics, b: &Metrics, place: &str) {
    for (name, _) in a.counts().iter().chain(b.counts()) {
        assert_eq!(a.counted(name), b.counted(name), "{place}: {name}");
    }
}

/// Snapshots of all frames of an uninterrupted run, and what each frame counted.
fn uninterrupted(shot: &Shot) -> Vec<(Snapshot, Metrics)> {
    let mut simulation = shot.start();
    let mut all = vec![(simulation.snapshot(), Metrics::default())];
    for frame in 1..=FRAMES {
        let summary = simulation.advance(&(shot.input)(frame)).unwrap_or_else(|e| panic!("{}: {e}", shot.name));
        all.push((simulation.snapshot(), summary.metrics));
    }
    all
}

#[test]
fn every_frame_can_be_gone_on_from() {
    for shot in shots() {
        let whole = uninterrupted(&shot);
        for frame in 0..FRAMES {
            let (mut snapshot, mut at) = (whole[frame as usize].0.clone(), frame);
            // Every frame is restored from the one before: a resume of a resume of a resume.
            while at < FRAMES {
                let mut simulation = shot.restore(at, &snapshot);
                assert_same(&simulation.snapshot(), &snapshot, &format!("{}, read back at frame {at}", shot.name));
                let summary = simulation.advance(&(shot.input)(at + 1)).unwrap_or_else(|e| panic!("{e}"));
                at += 1;
                snapshot = simulation.snapshot();
                let (expected, metrics) = &whole[at as usize];
                let place = format!("{}, frame {at} from {frame}", shot.name);
                assert_same(&snapshot, expected, &place);
                assert_same_counts(&summary.metrics, metrics, &place);
            }
        }
    }
}

#[test]
fn every_state_free_of_collisions_between_two_frames_can_be_gone_on_from() {
    for shot in shots() {
        let whole = uninterrupted(&shot);
        for frame in [1, 3, 4] {
            let input = (shot.input)(frame);
            let (expected, metrics) = &whole[frame as usize];
            for pause_at in [1, 2, 5, 17] {
                let mut simulation = shot.restore(frame - 1, &whole[frame as usize - 1].0);
                let mut states = 0;
                let mut pause = |_| {
                    states += 1;
                    states == pause_at
                };
                let Advance::Paused(first) = simulation.advance_or_pause(&input, &mut pause).unwrap() else { break };
                let place = format!("{}, frame {frame}, state {pause_at}", shot.name);
                // In the same process, and in another one.
                let mut other = shot.restore(frame - 1, &simulation.snapshot());
                for simulation in [&mut simulation, &mut other] {
                    let last = simulation.advance(&input).unwrap_or_else(|e| panic!("{place}: {e}"));
                    assert_same(&simulation.snapshot(), expected, &place);
                    assert_same_counts(&last.after(&first).metrics, metrics, &place);
                }
            }
        }
    }
}

#[test]
fn the_scenes_hold_what_has_to_be_remembered() {
    let shots = shots();
    let names = |name: &str| -> Vec<String> {
        let shot = shots.iter().find(|shot| shot.name == name).expect("it is one of the shots");
        uninterrupted(shot).remove(FRAMES as usize).0.sections.into_iter().map(|s| s.name).collect()
    };
    assert_eq!(names("hanging"), ["state", "pins"]);
    assert_eq!(names("collision alone"), ["state", "self_contact"]);
    assert_eq!(names("everything"), ["state", "pins", "body_collision", "deep_parts", "self_contact"]);
    let hand = shots.iter().find(|shot| shot.name == "a hand in a torso").expect("it is one of the shots");
    let whole = uninterrupted(hand);
    let known = |frame: usize, name: &str| {
        let sections = &whole[frame].0.sections;
        let section = sections.iter().find(|section| section.name == "deep_parts").expect("there is a surface");
        let dataset = section.datasets.iter().find(|dataset| dataset.name == name).expect("it has these points");
        matches!(&dataset.values, Values::U32(points) if !points.is_empty())
    };
    assert!(known(0, "joined") && !known(0, "deep"), "the neck is a part of the torso, and nothing passes through it");
    assert!(known(FRAMES as usize, "joined") && known(2, "deep"), "the hand is deep in the torso");
    for shot in &shots[1..] {
        let mut all = Metrics::default();
        uninterrupted(shot).iter().for_each(|(_, metrics)| all.add(metrics));
        let meets = ["repulsions", "collision_hits", "body_pinched"].map(|name| all.counted(name));
        assert!(meets.iter().sum::<u64>() > 0, "{}: nothing meets", shot.name);
    }
}

#[test]
fn the_snapshot_of_another_scene_is_refused() {
    let shots = shots();
    let snapshot = shots[3].start().snapshot();
    let refused = |shot: &Shot, frame: i64, snapshot: &Snapshot| match Simulation::restore(
        shot.scene(),
        &(shot.input)(frame),
        snapshot,
    ) {
        Err(RestoreError::Snapshot(error)) => error.to_string(),
        Err(other) => panic!("{other}"),
        Ok(_) => panic!("accepted"),
    };
    assert!(refused(&shots[0], 0, &snapshot).contains("`positions` has 450 rows, not 169"));
    assert!(refused(&shots[3], 1, &snapshot).contains("does not follow frame 1"));
    let mut broken = snapshot.clone();
    broken.sections[0].version += 1;
    let version = broken.sections[0].version;
    assert!(refused(&shots[3], 0, &broken).contains(&format!("it has version {version}, this program reads")));
    let mut broken = snapshot.clone();
    broken.sections.pop();
    assert!(refused(&shots[3], 0, &broken).contains("`self_contact` of the saved state: it is missing"));
    let contact = |name: &str, shape: &[usize], values: Values| {
        let mut broken = snapshot.clone();
        let section = broken.sections.iter_mut().find(|section| section.name == "self_contact");
        let dataset = section.and_then(|section| section.datasets.iter_mut().find(|dataset| dataset.name == name));
        let dataset = dataset.expect("the scene has contact of cloth with cloth");
        (dataset.shape, dataset.values) = (shape.to_vec(), values);
        refused(&shots[3], 0, &broken)
    };
    assert!(contact("pinched", &[1, 1], Values::U32(vec![900])).contains("`pinched` names node 900 of"));
    assert!(contact("crossings", &[1, 5], Values::U32(vec![0, 1, 2, 3, u32::MAX])).contains("`crossings` names node"));
    assert!(contact("step_share", &[1], Values::F64(vec![f64::NAN])).contains("`step_share` is NaN"));
    let spoilt = |shot: &Shot, (section, name): (&str, &str), value: f64| {
        let mut broken = shot.start().snapshot();
        let section = broken.sections.iter_mut().find(|known| known.name == section).expect("a section");
        let dataset = section.datasets.iter_mut().find(|dataset| dataset.name == name).expect("an array");
        let Values::F64(numbers) = &mut dataset.values else { panic!("`{name}` has no real numbers") };
        numbers[1] = value;
        refused(shot, 0, &broken)
    };
    for value in [f64::NAN, 1e233, -1e10] {
        for name in ["positions", "velocities"] {
            let said = spoilt(&shots[3], ("state", name), value);
            assert!(said.contains(&format!("row 0 of `{name}` is not finite, or beyond 1e9")), "{said}");
        }
        for name in ["places", "at_end"] {
            let said = spoilt(&shots[0], ("pins", name), value);
            assert!(said.contains(&format!("`{name}` of pin target 0 is not finite, or beyond 1e9")), "{said}");
        }
    }
}
