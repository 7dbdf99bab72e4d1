//! The integrator of scenes that leave it to the solver (`docs/theory/tr_bdf2.md#when-long-steps-pay`).

use drapery_core::parallel::local_ranks::LocalRanks;
use drapery_core::parallel::ranks::Ranks;
use drapery_core::scene::{Integrator, Scene, SceneDescription};
use drapery_core::simulation::{Advance, FrameInput, Simulation};
use drapery_core::snapshot::Snapshot;
use drapery_tests::*;

/// A hung sheet of 800 triangles with springs of this stiffness [N/m], with the choice left to the solver.
fn hung(stiffness: f64) -> SceneDescription {
    let mut description = cloth(20, 0.02, stiffness);
    add_pins(&mut description, vec![0, 20]);
    description.solver.integrator = Integrator::Auto;
    description
}

fn chosen(description: SceneDescription) -> Integrator {
    start(description).scene().description().solver.integrator
}

fn problems(description: SceneDescription) -> String {
    let scene = Scene::validate(description).unwrap_or_else(|problems| panic!("{problems}"));
    Simulation::new(scene, &FrameInput::to_frame(0)).err().expect("no integrator reads all of it").to_string()
}

#[test]
fn stiff_cloth_gets_long_steps_and_soft_cloth_short_ones() {
    for (stiffness, expected) in [(2.0, Integrator::SemiImplicit), (2000.0, Integrator::TrBdf2)] {
        let simulation = start(hung(stiffness));
        let [short, long] = Integrator::ALL.map(|integrator| simulation.estimate_with(integrator).total());
        assert_eq!(simulation.scene().description().solver.integrator, expected, "{stiffness}: {short} s, {long} s");
        assert_eq!(long < short, expected == Integrator::TrBdf2);
    }
}

#[test]
fn keys_and_effects_that_one_integrator_alone_reads_choose_it() {
    let with = |stiffness: f64, change: &dyn Fn(&mut SceneDescription)| {
        let mut description = hung(stiffness);
        change(&mut description);
        description
    };
    let cfl = |description: &mut SceneDescription| description.solver.cfl = 2.0;
    let steps = |description: &mut SceneDescription| description.solver.steps_per_frame = 16;
    let curve = |description: &mut SceneDescription| {
        let springs = description.effects.iter_mut().find(|request| request.effect == "stretch").expect("springs");
        *springs = springs.clone().with("extension", 0.1).with("load", 100.0);
    };
    assert_eq!(chosen(with(2000.0, &cfl)), Integrator::SemiImplicit);
    assert_eq!(chosen(with(2.0, &steps)), Integrator::TrBdf2);
    assert_eq!(chosen(with(2.0, &curve)), Integrator::TrBdf2);
    let both = problems(with(2.0, &|description| {
        cfl(description);
        steps(description);
    }));
    assert!(both.contains("has no effect with"), "{both}");
    let both = problems(with(2.0, &|description| {
        cfl(description);
        curve(description);
    }));
    assert!(both.contains("`cfl` has no effect with") || both.contains("`extension` asks"), "{both}");
}

#[test]
fn every_number_of_ranks_chooses_the_same_and_moves_as_with_the_choice_written_out() {
    let on = |ranks: usize, description: &SceneDescription| {
        let work = |communicator| {
            let ranks = Ranks::new(communicator);
            let scene =
                Scene::distribute(&ranks, ranks.is_first().then(|| description.clone())).expect("a valid scene");
            let input = |scene: &Scene, frame| scene.share_input(ranks.is_first().then(|| FrameInput::to_frame(frame)));
            let start = input(&scene, 0);
            let mut simulation = Simulation::new(scene, &start).expect("a start");
            let expected = Integrator::ALL.map(|integrator| simulation.estimate_with(integrator).total().to_bits());
            let next = input(simulation.scene(), 1);
            simulation.advance(&next).expect("a frame");
            let mut snapshot = simulation.snapshot();
            // A choice that is written out never changes.
            snapshot.sections.retain(|section| section.name != "integrator");
            (simulation.scene().description().solver.integrator, expected, snapshot)
        };
        LocalRanks::run(ranks, 1, work).unwrap_or_else(|e| panic!("{ranks} ranks: {e}"))
    };
    for stiffness in [2.0, 2000.0] {
        let mut description = hung(stiffness);
        let alone = on(1, &description).remove(0);
        for (integrator, expected, _) in on(3, &description) {
            assert_eq!((integrator, expected), (alone.0, alone.1), "{stiffness}");
        }
        description.solver.integrator = alone.0;
        assert!(on(2, &description)[0].2 == alone.2, "{stiffness}");
    }
}

/// Frames of the wrung sheet, in one of which its integrator changes.
const WRUNG_FRAMES: i64 = 8;

/// A stiff sheet that its edges wring by three turns a second.
fn stiff_wrung() -> SceneDescription {
    wrung(24, 5000.0, 3.0, WRUNG_FRAMES)
}

/// The frames behind which the integrator changes and the integrators that it changes to, and a snapshot of each frame.
type Course = (Vec<(i64, Integrator)>, Vec<Snapshot>);

/// Goes on to the last frame, and pauses at every state free of collisions if it is to.
fn course(ranks: &Ranks, simulation: &mut Simulation, pauses: bool) -> Course {
    let (mut changes, mut snapshots) = (Vec::new(), Vec::new());
    for frame in simulation.frame() + 1..=WRUNG_FRAMES {
        let input = simulation.scene().share_input(ranks.is_first().then(|| FrameInput::to_frame(frame)));
        let summary = loop {
            match simulation.advance_or_pause(&input, &mut |_| pauses).expect("a frame") {
                Advance::Done(summary) => break summary,
                Advance::Paused(_) => (),
            }
        };
        changes.extend(summary.next_integrator.map(|next| (frame, next)));
        snapshots.push(simulation.snapshot());
    }
    (changes, snapshots)
}

#[test]
fn wrung_cloth_changes_to_short_steps_at_the_same_frame_on_any_ranks_and_after_a_stop() {
    let on = |count: usize| {
        let work = |communicator| {
            let ranks = Ranks::new(communicator);
            let scene = Scene::distribute(&ranks, ranks.is_first().then(stiff_wrung)).expect("a valid scene");
            let start = scene.share_input(ranks.is_first().then(|| FrameInput::to_frame(0)));
            let mut simulation = Simulation::new(scene, &start).expect("a start");
            assert!(simulation.scene().may_change_integrator());
            course(&ranks, &mut simulation, false)
        };
        LocalRanks::run(count, 1, work).unwrap_or_else(|e| panic!("{count} ranks: {e}")).remove(0)
    };
    let (changes, snapshots) = on(1);
    let Some((changed, Integrator::SemiImplicit)) = changes.first() else { panic!("no change: {changes:?}") };
    assert!(on(3) == (changes.clone(), snapshots.clone()), "three ranks");
    for stop in [changed - 1, *changed, changed + 1] {
        let scene = Scene::validate(stiff_wrung()).expect("a valid scene");
        let kept = &snapshots[stop as usize - 1];
        let mut resumed = Simulation::restore(scene, &FrameInput::to_frame(stop), kept).expect("a snapshot of it");
        assert!(resumed.snapshot() == *kept, "frame {stop}");
        let rest = course(&Ranks::default(), &mut resumed, true);
        let later: Vec<_> = changes.iter().filter(|(frame, _)| *frame > stop).copied().collect();
        assert!(rest == (later, snapshots[stop as usize..].to_vec()), "frame {stop}");
    }
}
