//! Garments that start crossed come free in the order in which they are worn.

use drapery_core::scene::{Integrator, Scene, SceneDescription};
use drapery_core::simulation::{FrameInput, Simulation};
use drapery_selftest::bench::Conditions;
use drapery_selftest::case::Tier;
use drapery_selftest::report::rows;
use drapery_selftest::suite::judge_tangle;
use drapery_selftest::tangles;
use drapery_tests::positions;

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
