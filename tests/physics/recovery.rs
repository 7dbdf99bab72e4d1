//! Steps that go wrong are tried again, and counted.

use std::sync::Arc;

use drapery_core::Vec3;
use drapery_core::parallel::communicator::Communicator;
use drapery_core::parallel::local_ranks::LocalRanks;
use drapery_core::parallel::ranks::Ranks;
use drapery_core::scene::{EffectRequest, GarmentDescription, Scene, SceneDescription};
use drapery_core::simulation::{Advance, FrameInput, Simulation};
use drapery_core::snapshot::Snapshot;
use drapery_tests::*;

/// A sheet without damping, kicked, with steps fifty times longer than are stable.
fn reckless(cells: usize) -> SceneDescription {
    let mut description = scene_of(GarmentDescription::new("sheet", sheet(cells, cells, 0.02), 0.2), 24);
    let stretch = EffectRequest::of_garment("stretch", 0).with("stiffness", 200.0).with("damping_ratio", 0.0);
    description.effects.push(stretch);
    let points = &description.garments[0].mesh.points;
    description.garments[0].start = Some(points.iter().map(|p| Vec3::new(1.05 * p.x, 0.0, 0.97 * p.z)).collect());
    description.solver.cfl = 200.0;
    description
}

#[test]
fn steps_far_too_long_are_tried_again_with_shorter_ones_and_counted() {
    let mut simulation = start(reckless(8));
    let mut retried = 0;
    for _ in 0..12 {
        let summary = run(&mut simulation, 1);
        retried += summary.metrics.counted("retried_shorter");
        let named = summary.recoveries.iter().all(|r| r.level == "retried_shorter" && r.garment == "sheet");
        assert!(named, "{:?}", summary.recoveries);
        // Energy of a stretch by 5 %; unstable steps would multiply it in each of them.
        let strain = summary.max_strain.map_or(f64::INFINITY, |s| s.strain);
        assert!(strain < 0.5, "frame {}: {strain}", summary.frame);
    }
    assert!(retried > 0);
}

#[test]
fn calm_cloth_is_never_tried_again() {
    let mut description = reckless(8);
    description.solver.cfl = 2.0;
    let mut simulation = start(description);
    let summary = run(&mut simulation, 12);
    assert!(summary.metrics.counts().iter().all(|(name, _)| !name.starts_with("retried")), "{:?}", summary.metrics);
    assert!(summary.recoveries.is_empty());
}

/// The state after two frames on `ranks` ranks.
fn on_ranks(ranks: usize) -> Snapshot {
    let work = |communicator: Arc<dyn Communicator>| {
        let ranks = Ranks::new(communicator);
        let scene = Scene::distribute(&ranks, ranks.is_first().then(|| reckless(60))).expect("a valid scene");
        let mut simulation = Simulation::new(scene, &FrameInput::to_frame(0)).expect("a start");
        let mut retried = 0;
        for frame in 1..=2 {
            let summary = simulation.advance(&FrameInput::to_frame(frame)).expect("a frame");
            retried += summary.metrics.counted("retried_shorter");
        }
        assert!(retried > 0 || !ranks.is_first());
        simulation.snapshot()
    };
    let all = LocalRanks::run(ranks, 1, work).unwrap_or_else(|e| panic!("{e}"));
    all.into_iter().next().expect("there is a first rank")
}

#[test]
fn steps_that_are_tried_again_have_the_same_bits_on_any_number_of_ranks_and_after_a_pause() {
    let one = on_ranks(1);
    assert!(on_ranks(3) == one, "3 ranks");
    // Stopped at every fifth good state, and gone on with from what was saved.
    let scene = || Scene::validate(reckless(60)).unwrap_or_else(|p| panic!("{p}"));
    let mut simulation = Simulation::new(scene(), &FrameInput::to_frame(0)).expect("a start");
    for frame in 1..=2 {
        loop {
            let mut asked = 0;
            let mut pause = |_| {
                asked += 1;
                asked == 5
            };
            match simulation.advance_or_pause(&FrameInput::to_frame(frame), &mut pause).expect("a frame") {
                Advance::Done(_) => break,
                Advance::Paused(_) => {
                    let saved = simulation.snapshot();
                    let input = FrameInput::to_frame(frame - 1);
                    simulation = Simulation::restore(scene(), &input, &saved).expect("a snapshot");
                }
            }
        }
    }
    assert!(simulation.snapshot() == one, "after pauses");
}
