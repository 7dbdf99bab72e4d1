//! An effect does something if a scene asks for it, and does not exist otherwise.

mod controls;
mod sleeping;

use std::collections::BTreeSet;

use drapery_core::Vec3;
use drapery_core::effects::{EffectSpec, REGISTRY, Scope};
use drapery_core::parallel::local_ranks::LocalRanks;
use drapery_core::parallel::ranks::Ranks;
use drapery_core::scene::{Scene, SceneDescription};
use drapery_core::simulation::{FrameInput, FrameSummary, Simulation};
use drapery_core::snapshot::Snapshot;
use drapery_tests::{positions, run, start};

use controls::CONTROLS;

/// Effects that only count what they could not do.
const COUNTS_FAULTS: [&str; 2] = ["pins", "dihedral_bending"];

/// Frames that a control runs.
const FRAMES: usize = 6;

/// Outcome of a scene.
struct Outcome {
    summary: FrameSummary,
    positions: Vec<Vec3>,
    snapshot: Snapshot,
    /// Effects that ran.
    effects: Vec<&'static EffectSpec>,
}

fn outcome(description: SceneDescription) -> Outcome {
    let mut simulation = start(description);
    let summary = (0..FRAMES).fold(FrameSummary::empty(0), |all, _| run(&mut simulation, 1).after(&all));
    let names: BTreeSet<&str> = simulation.plan().iter().map(|effect| effect.name).collect();
    let effects = REGISTRY.iter().copied().filter(|spec| names.contains(spec.name)).collect();
    Outcome { summary, positions: positions(&simulation), snapshot: simulation.snapshot(), effects }
}

/// The control of an effect, with it and without it.
fn with_and_without(name: &str) -> [Outcome; 2] {
    let (_, scene) = CONTROLS.iter().find(|(control, _)| *control == name).expect("every effect has a control");
    let mut without = scene();
    let requires_it = |spec: &&&EffectSpec| spec.requires.contains(&name);
    let dependent = REGISTRY.iter().filter(requires_it).map(|spec| spec.name.to_owned());
    let asked: Vec<String> = without.effects.iter().map(|request| request.effect.clone()).collect();
    let names: Vec<String> = std::iter::once(name.to_owned()).chain(dependent.filter(|n| asked.contains(n))).collect();
    without.leave_out(&names).unwrap_or_else(|problems| panic!("{name}: {problems:?}"));
    [outcome(scene()), outcome(without)]
}

/// Counts that only this effect can have, given those that run.
fn own_counts(spec: &EffectSpec, others: &[&EffectSpec]) -> Vec<&'static str> {
    let shared = |count: &&str| others.iter().any(|other| other.report.counts.contains(count));
    spec.report.counts.iter().copied().filter(|count| !shared(count)).collect()
}

#[test]
fn every_effect_has_a_control() {
    let names: Vec<&str> = REGISTRY.iter().map(|spec| spec.name).collect();
    let controls: Vec<&str> = CONTROLS.iter().map(|(name, _)| *name).collect();
    assert_eq!(
        controls, names,
        "tests/effects/controls.rs needs a scene for each effect, in the order of the registry"
    );
}

#[test]
fn every_effect_that_is_switched_on_changes_positions_or_counts() {
    for spec in REGISTRY {
        let [on, off] = with_and_without(spec.name);
        let moved = on.positions.iter().zip(&off.positions).any(|(a, b)| a != b);
        let counts = own_counts(spec, &off.effects);
        let counted = counts.iter().any(|count| on.summary.metrics.counted(count) > 0);
        println!("{}: moved {moved}, counted {counted} of {counts:?}", spec.name);
        assert!(moved || counted, "{} has no effect on its control", spec.name);
        assert!(
            counts.is_empty() || counted || COUNTS_FAULTS.contains(&spec.name),
            "{} counts nothing on its control, of {counts:?}",
            spec.name
        );
    }
}

#[test]
fn an_effect_that_is_left_out_counts_nothing_runs_no_stage_and_has_no_section_in_snapshots() {
    for spec in REGISTRY {
        let [_, off] = with_and_without(spec.name);
        let name = spec.name;
        assert!(off.effects.iter().all(|effect| effect.name != name), "{name}");
        for count in own_counts(spec, &off.effects) {
            assert_eq!(off.summary.metrics.counted(count), 0, "{name}: {count}");
        }
        let mut sections: Vec<&str> = off.effects.iter().filter_map(|s| s.section).map(|s| s.name).collect();
        sections.push("state");
        for section in &off.snapshot.sections {
            assert!(sections.contains(&section.name.as_str()), "{name}: section {}", section.name);
        }
        for stage in off.summary.metrics.stages() {
            let owners: Vec<&str> = drapery_core::effects::cost::owners(&stage.name).collect();
            let runs = off.effects.iter().any(|effect| owners.contains(&effect.name));
            assert!(owners.is_empty() || runs, "{name}: stage {}", stage.name);
        }
    }
}

/// Messages, bytes and common operations of the third frame on two ranks.
fn traffic(description: &SceneDescription) -> [u64; 3] {
    let one_rank = |communicator| {
        let ranks = Ranks::new(communicator);
        let scene = Scene::distribute(&ranks, ranks.is_first().then(|| description.clone())).expect("a valid scene");
        let mut simulation = Simulation::new(scene, &FrameInput::to_frame(0)).expect("a start");
        let mut frame = |frame| simulation.advance(&FrameInput::to_frame(frame)).expect("a frame").metrics;
        (1..3).for_each(|number| drop(frame(number)));
        let metrics = frame(3);
        ["messages", "bytes_sent", "collectives"].map(|count| metrics.counted(count))
    };
    let all = LocalRanks::run(2, 1, one_rank).expect("ranks end");
    all.into_iter().next().expect("there is a first rank")
}

#[test]
fn what_is_left_out_sends_nothing() {
    for spec in REGISTRY.iter().filter(|spec| spec.scope != Scope::Implied) {
        let (_, scene) =
            CONTROLS.iter().find(|(control, _)| *control == spec.name).expect("every effect has a control");
        let goes = |name: &str| {
            name == spec.name || REGISTRY.iter().any(|s| s.name == name && s.requires.contains(&spec.name))
        };
        let (mut never_asked, mut left_out) = (scene(), scene());
        let names: BTreeSet<String> =
            left_out.effects.iter().map(|r| r.effect.clone()).filter(|name| goes(name)).collect();
        never_asked.effects.retain(|request| !goes(&request.effect));
        left_out.leave_out(&names.into_iter().collect::<Vec<_>>()).unwrap_or_else(|problems| panic!("{problems:?}"));
        let [never_asked, left_out] = [traffic(&never_asked), traffic(&left_out)];
        assert!(never_asked[2] > 0, "two ranks speak");
        assert_eq!(left_out, never_asked, "{}: messages, bytes, common operations", spec.name);
    }
}
