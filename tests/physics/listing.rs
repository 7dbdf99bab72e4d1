//! The lines of the listings as an observer sees them: what one line leaves follows from what the lines before have left, by the
//! equations of the paper (A. Selle, J. Su, G. Irving, R. Fedkiw, "Robust High-Resolution Cloth Using Parallelism,
//! History-Based Collisions, and Accurate Friction", TVCG 2009, section 2).

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex};

use drapery_core::Vec3;
use drapery_core::geometry::shapes::Shape;
use drapery_core::observe::{LINES, Observation, Observer, Tracepoint};
use drapery_core::parallel::local_ranks::LocalRanks;
use drapery_core::parallel::ranks::Ranks;
use drapery_core::scene::{
    BodyDescription, BodyShape, EffectRequest, GarmentDescription, PinAnchor, PinDescription, PinHold, PinTarget,
    RigidMotion, Scene, SceneDescription,
};
use drapery_core::simulation::{Advance, FrameInput, Simulation};
use drapery_core::snapshot::Snapshot;
use drapery_tests::*;

/// Frames of every run.
const FRAMES: i64 = 2;

/// A sheet of several logical parts, held at two corners, that falls on a ball with friction.
fn scene() -> SceneDescription {
    let mut description = SceneDescription::new("listing");
    let mut mesh = sheet(80, 80, 0.0125);
    mesh.points.iter_mut().for_each(|point| point.y += 0.2);
    description.garments.push(GarmentDescription::new("sheet", mesh, 0.2));
    let ball = BodyShape::Rigid(Shape::Sphere { radius: 0.19 });
    description.bodies.push(BodyDescription::new("ball", ball, RigidMotion::at(Vec3::zeros())));
    description.pins.push(PinDescription {
        garment: 0,
        target: PinTarget::Path { anchor: PinAnchor::Start, vertices: vec![0, 79], offsets: Vec::new() },
        axes: [true; 3],
        from: f64::NEG_INFINITY,
        until: f64::INFINITY,
        hold: PinHold::Hard,
    });
    let effects = ["gravity", "pins", "body_collision", "self_repulsion", "self_collision"];
    description.effects.extend(effects.map(EffectRequest::of_scene));
    description.effects.push(EffectRequest::of_garment("stretch", 0).with("stiffness", 50.0));
    description
}

/// Returns the observations on the way, and the state at the end. With `pauses` it stops and resumes at every state.
fn observed(tracepoints: &[Tracepoint], ranks: usize, pauses: bool) -> (Vec<Observation>, Snapshot) {
    let seen = Arc::new(Mutex::new(Vec::new()));
    let work = |communicator| {
        let ranks = Ranks::new(communicator);
        let scene = Scene::distribute(&ranks, ranks.is_first().then(scene)).expect("a valid scene");
        let mut simulation = Simulation::new(scene, &FrameInput::to_frame(0)).expect("a start");
        if !tracepoints.is_empty() {
            let seen = Arc::clone(&seen);
            let sink = Box::new(move |observation| seen.lock().unwrap().push(observation));
            let sink = ranks.is_first().then_some(sink as Box<_>);
            simulation.observe(Some(Observer::new(tracepoints.to_vec(), (1, 0), sink)));
        }
        for frame in 1..=FRAMES {
            let input = FrameInput::to_frame(frame);
            while let Advance::Paused(_) = simulation.advance_or_pause(&input, &mut |_| pauses).expect("a frame") {}
        }
        simulation.snapshot()
    };
    let snapshot = LocalRanks::run(ranks, 1, work).expect("all ranks end").swap_remove(0);
    (std::mem::take(&mut *seen.lock().unwrap()), snapshot)
}

fn everywhere() -> Vec<Tracepoint> {
    LINES.iter().map(|line| line.parse().expect("a line")).collect()
}

/// Quantities of the garment, by line and name.
type Quantities<'a> = BTreeMap<(&'a str, &'a str), &'a [Vec3]>;

/// The largest distance between two fields.
fn apart(a: &[Vec3], b: impl Iterator<Item = Vec3>) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max)
}

#[test]
fn every_line_leaves_what_the_paper_says() {
    let (seen, _) = observed(&everywhere(), 1, false);
    let mut steps: BTreeMap<(i64, u64), Vec<&Observation>> = BTreeMap::new();
    seen.iter().for_each(|seen| steps.entry((seen.frame, seen.step)).or_default().push(seen));
    assert!(steps.len() > 4, "{} steps", steps.len());
    let (mut corrected, mut rubbed) = (0.0_f64, 0.0_f64);
    for lines in steps.values() {
        let dt = lines.iter().map(|seen| seen.dt).fold(0.0, f64::max);
        let quantity = |seen: &'_ &Observation| seen.garments[0].iter().map(|(name, _)| *name).collect::<Vec<_>>();
        assert!(lines.iter().all(|seen| quantity(seen)[0] == "x" && quantity(seen).len() >= 2));
        let all: Quantities<'_> = lines
            .iter()
            .flat_map(|seen| seen.garments[0].iter().map(|(name, values)| ((seen.line, *name), &values[..])))
            .collect();
        let at = |line, name| all[&(line, name)].iter();
        // B.3: x' = x + dt v½ of B.2, and v* = v.
        assert_eq!(
            apart(all[&("B.3", "x_new")], at("B.2", "x").zip(at("B.2", "v_half")).map(|(x, v)| x + v * dt)),
            0.0
        );
        assert_eq!(apart(all[&("B.3", "v_star")], at("B.1", "v").copied()), 0.0);
        // B.4 corrects both where there is the ball.
        corrected = corrected.max(apart(all[&("B.4", "x_new")], at("B.3", "x_new").copied()));
        // B.6: v' = 2 v½ − v*, at x'.
        let extrapolated = at("B.5", "v_half").zip(at("B.4", "v_star")).map(|(half, start)| half * 2.0 - start);
        assert_eq!(apart(all[&("B.6", "v")], extrapolated), 0.0);
        assert_eq!(apart(all[&("B.6", "x")], at("B.4", "x_new").copied()), 0.0);
        // B.7 and B.8 change velocities alone.
        assert_eq!(apart(all[&("B.8", "x")], at("B.6", "x").copied()), 0.0);
        rubbed = rubbed.max(apart(all[&("B.7", "v")], at("B.6", "v").copied()));
    }
    assert!(corrected > 1e-6 && rubbed > 1e-3, "B.4 {corrected} m, B.7 {rubbed} m/s: the sheet has to touch the ball");
}

#[test]
fn an_observer_sees_the_same_on_ranks_and_after_pauses_and_changes_nothing() {
    let (none, undisturbed) = observed(&[], 1, false);
    assert!(none.is_empty());
    let (whole, state) = observed(&everywhere(), 1, false);
    assert!(state == undisturbed, "an observer changes the result");
    for (ranks, pauses) in [(3, false), (1, true), (3, true)] {
        let (seen, state) = observed(&everywhere(), ranks, pauses);
        assert!(state == undisturbed, "{ranks} ranks, with pauses: {pauses}");
        assert!(seen == whole, "{ranks} ranks, with pauses: {pauses}");
    }
}

#[test]
fn a_tracepoint_selects_a_line_a_frame_and_a_step() {
    let (all, _) = observed(&everywhere(), 1, false);
    let select = |text: &str| observed(&[text.parse().expect("a tracepoint")], 1, false).0;
    let expected = |keep: &dyn Fn(&&Observation) -> bool| all.iter().filter(keep).cloned().collect::<Vec<_>>();
    assert!(select("B.4") == expected(&|seen| seen.line == "B.4"));
    assert!(select("C@2") == expected(&|seen| (seen.line, seen.frame) == ("C", 2)));
    let one = select("B.4@2.2");
    assert_eq!(one.len(), 1);
    assert!(one == expected(&|seen| (seen.line, seen.frame, seen.step) == ("B.4", 2, 2)));
    assert!(select("B.4@7").is_empty());
}
