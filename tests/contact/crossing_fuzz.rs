//! Random layers, speeds and step lengths: cloth that starts free of crossings has none after any step, whatever a step had to try.
//! The judge is the exact check of all triangles, which knows nothing of the solver.

use drapery_core::Vec3;
use drapery_core::geometry::random::SplitMix64;
use drapery_core::geometry::shapes::Shape;
use drapery_core::scene::{BodyShape, EffectRequest, GarmentDescription, Integrator, RigidMotion, SceneDescription};
use drapery_core::simulation::{Advance, FrameInput, Simulation};
use drapery_tests::*;

use crate::self_contact::{crossings_as_stored, with_contact};

/// Frames of each scene.
const FRAMES: i64 = 4;

/// An entry that the draw chooses.
fn choose<T: Copy>(random: &mut SplitMix64, choices: &[T]) -> T {
    choices[(random.unit() * choices.len() as f64) as usize]
}

/// Layers that are thrown at each other, at a floor and at a ball, with long steps or short ones.
fn layers(seed: u64, integrator: Integrator) -> SceneDescription {
    let mut random = SplitMix64::new(seed);
    let mut description = SceneDescription::new("layers");
    description.timeline.fps_numerator = choose(&mut random, &[1, 12, 24, 24, 48]);
    let speed = choose(&mut random, &[0.0, 1.0, 5.0, 20.0]);
    let (count, cells) = (choose(&mut random, &[1, 2, 3, 5]), choose(&mut random, &[5, 8, 12]));
    let (dx, gap) = (choose(&mut random, &[0.01, 0.03]), choose(&mut random, &[0.002, 0.01, 0.05]));
    let stiffness = choose(&mut random, &[1.0, 50.0, 1000.0]);
    for layer in 0..count {
        let mut mesh = sheet(cells, cells, dx);
        let turn = nalgebra::Rotation3::from_axis_angle(&Vec3::y_axis(), random.signed());
        let height = 0.1 + gap * layer as f64;
        mesh.points.iter_mut().for_each(|p| *p = turn * *p + Vec3::new(0.0, height, 0.0));
        let garment = GarmentDescription::new(&format!("layer{layer}"), mesh, 0.2);
        let velocity = random.vector() * speed - Vec3::y() * speed;
        description.garments.push(GarmentDescription { thickness: 1e-3, velocity, ..garment });
        description.effects.push(EffectRequest::of_garment("stretch", layer).with("stiffness", stiffness));
        description.effects.push(EffectRequest::of_garment("dihedral_bending", layer).with("stiffness", 1e-5));
    }
    add_gravity(&mut description, [0.0, -9.81, 0.0]);
    if choose(&mut random, &[true, false]) {
        add_body(&mut description, BodyShape::Rigid(Shape::HalfSpace), RigidMotion::at(Vec3::zeros()), 0.3);
    }
    if choose(&mut random, &[true, false]) {
        let (from, to) = (Vec3::new(0.0, 0.04, 0.0), random.vector() * choose(&mut random, &[0.5, 10.0, 20.0]));
        let motion = RigidMotion { path: vec![(0.0, from), (1.0, from + to)], ..RigidMotion::at(Vec3::zeros()) };
        add_body(&mut description, BodyShape::Rigid(Shape::Sphere { radius: 0.03 }), motion, 0.3);
    }
    if choose(&mut random, &[true, false]) {
        add_pins(&mut description, (0..=cells as u32).collect());
    }
    description.solver.integrator = integrator;
    match choose(&mut random, &[1, 2, 8, 24]) {
        steps if integrator.spec().is_implicit => description.solver.steps_per_frame = steps,
        steps => description.solver.max_dt = Some(description.timeline.frame_duration() / steps as f64),
    }
    with_contact(description)
}

/// Simulates a scene of a seed; nothing may cross after any of its steps. Returns the number of attempts with shorter steps.
fn is_free_after_every_step(seed: u64, integrator: Integrator) -> u64 {
    let mut simulation: Simulation = start(layers(seed, integrator));
    let (mut states, mut retried) = (0, 0);
    for frame in 1..=FRAMES {
        loop {
            let advance = simulation.advance_or_pause(&FrameInput::to_frame(frame), &mut |_| true);
            let advance = advance.unwrap_or_else(|error| panic!("seed {seed}, {integrator:?}: {error}"));
            states += 1;
            let found = crossings_as_stored(&simulation, |x| x);
            assert_eq!(found, 0, "seed {seed}, {integrator:?}, frame {frame}, state {states}");
            let (Advance::Done(summary) | Advance::Paused(summary)) = &advance;
            retried += summary.metrics.counted("retried_shorter");
            if matches!(advance, Advance::Done(_)) {
                break;
            }
        }
    }
    retried
}

/// Some seeds, with both integrators.
fn are_free_after_every_step(seeds: std::ops::Range<u64>) {
    for integrator in [Integrator::TrBdf2, Integrator::SemiImplicit] {
        let retried: u64 = seeds.clone().map(|seed| is_free_after_every_step(seed, integrator)).sum();
        assert!(retried > 0 || integrator == Integrator::SemiImplicit, "no step went wrong: the scenes are too easy");
    }
}

#[test]
fn random_layers_never_cross_after_any_step() {
    are_free_after_every_step(0..6);
}

#[test]
#[ignore = "long: part of make test-full"]
fn many_random_layers_never_cross_after_any_step() {
    are_free_after_every_step(0..400);
}
