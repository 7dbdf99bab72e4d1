//! Garments that start crossed come free in the order in which they are worn.

use drapery_core::Vec3;
use drapery_core::scene::{
    EffectRequest, GarmentDescription, Integrator, PinAnchor, PinHold, PinTarget, Scene, SceneDescription,
};
use drapery_core::simulation::{FrameInput, Simulation};
use drapery_selftest::bench::Conditions;
use drapery_selftest::case::Tier;
use drapery_selftest::report::rows;
use drapery_selftest::suite::judge_tangle;
use drapery_selftest::tangles;
use drapery_tests::{GRAVITY, add_pins, positions, sheet};

/// Seed of a sheet through a sheet, which takes two frames.
const SHEETS: u64 = 0;

#[test]
fn garments_worn_in_an_order_come_apart_on_any_number_of_ranks() {
    // A pocket and a hem.
    for (seed, integrator) in [(2, Integrator::SemiImplicit), (3, Integrator::TrBdf2)] {
        let conditions = Conditions { tier: Tier::Quick, integrator, drapery: "drapery".as_ref() };
        let verdict = judge_tangle(seed, conditions);
        assert!(verdict.passed(), "{}\n{:?}", rows(&verdict).join("\n"), verdict.trouble);
    }
}

fn simulation(description: SceneDescription) -> Simulation {
    let scene = Scene::validate(description).unwrap_or_else(|problems| panic!("{problems}"));
    Simulation::new(scene, &FrameInput::to_frame(0)).unwrap_or_else(|problems| panic!("{problems}"))
}

#[test]
fn a_tangle_goes_on_after_a_stop_with_the_same_bits() {
    let mut whole = simulation(tangles::scene(SHEETS));
    whole.advance(&FrameInput::to_frame(1)).expect("a frame");
    assert!(!whole.crossings().is_empty(), "it is free after one frame, and shows nothing");
    let snapshot = whole.snapshot();
    let scene = Scene::validate(tangles::scene(SHEETS)).expect("a scene");
    let mut resumed = Simulation::restore(scene, &FrameInput::to_frame(1), &snapshot).expect("its own snapshot");
    for frame in 2..=3 {
        for simulation in [&mut whole, &mut resumed] {
            simulation.advance(&FrameInput::to_frame(frame)).expect("a frame");
        }
    }
    assert!(positions(&whole) == positions(&resumed) && whole.snapshot() == resumed.snapshot());
}

/// Speed at which pins move [m/s].
const SPEED: f64 = 0.2;

/// Two sheets through each other, and far from them two patches: one follows a path, by a row of hard pins and by another that holds from the
/// second frame on; the other hangs by springs that break where they carry half its weight.
fn with_patches() -> SceneDescription {
    let mut description = tangles::scene(SHEETS);
    let path: Vec<_> = (0..9).map(|k| f64::from(k) / 24.0).map(|time| (time, Vec3::z() * SPEED * time)).collect();
    let mut add = |name: &str, x: f64, pins: [(Vec<u32>, f64); 2], offsets: Vec<(f64, Vec3)>, hold: PinHold| {
        let mut mesh = sheet(4, 4, 0.01);
        mesh.points.iter_mut().for_each(|p| p.x += x);
        let garment = description.garments.len();
        description.garments.push(GarmentDescription::new(name, mesh, 0.2));
        description.effects.push(EffectRequest::of_garment("stretch", garment).with("stiffness", 50.0));
        for (vertices, from) in pins {
            add_pins(&mut description, vertices.clone());
            let pin = description.pins.last_mut().expect("it was added");
            pin.target = PinTarget::Path { anchor: PinAnchor::WhenHeld, vertices, offsets: offsets.clone() };
            (pin.garment, pin.from, pin.hold) = (garment, from, hold);
        }
    };
    let always = f64::NEG_INFINITY;
    add("held", 5.0, [((0..5).collect(), always), (vec![24], 1.0 / 24.0)], path, PinHold::Hard);
    let weight = 0.2 * 0.04 * 0.04 * GRAVITY / 25.0;
    let hold = PinHold::Spring { stiffness: weight / 0.02, damping_ratio: 0.0, break_force: Some(0.5 * weight) };
    add("hung", 6.0, [((0..12).collect(), always), ((12..25).collect(), always)], Vec::new(), hold);
    description.effects.push(EffectRequest::of_scene("attachments"));
    description
}

#[test]
fn pins_stand_and_nothing_breaks_unseen_while_garments_come_apart() {
    let mut simulation = simulation(with_patches());
    let held = simulation.scene().description().garments.len() - 2;
    let (mut x, mut places, mut waited, mut broken) = (Vec::new(), Vec::new(), Vec::new(), 0);
    for frame in 1..=4 {
        let summary = simulation.advance(&FrameInput::to_frame(frame)).expect("a frame");
        simulation.garment_positions(held, &mut x);
        places.push([x[0], x[24]]);
        waited.push(summary.metrics.counted("untangling_steps"));
        // What breaks is named in the frame in which it breaks.
        assert_eq!(summary.metrics.counted("attachments_broken"), summary.broken.len() as u64, "frame {frame}");
        broken += summary.broken.len();
    }
    assert!(waited[0] > 0 && waited[1] > 0, "{waited:?}");
    assert_eq!(broken, 25);
    for pair in places.windows(2) {
        for (before, after) in pair[0].iter().zip(&pair[1]) {
            assert!((after - before - Vec3::z() * SPEED / 24.0).norm() < 1e-12, "{places:?}");
        }
    }
}

#[test]
fn without_layers_nothing_waits_and_the_bits_are_the_same() {
    let without = |layers: [Option<u32>; 2]| {
        let mut description = tangles::scene(SHEETS);
        description.garments.iter_mut().zip(layers).for_each(|(garment, layer)| garment.layer = layer);
        let mut simulation = simulation(description);
        let summary = simulation.advance(&FrameInput::to_frame(1)).expect("a frame");
        (positions(&simulation), summary.metrics.counted("untangling_steps"))
    };
    let (none, waited) = without([None, None]);
    assert_eq!(waited, 0);
    // One layer is no order, nor is the same one twice.
    for layers in [[Some(3), None], [Some(1), Some(1)]] {
        assert!(without(layers) == (none.clone(), 0), "{layers:?}");
    }
    let (other, waited) = without([Some(1), Some(2)]);
    assert!(other != none && waited > 0);
}
