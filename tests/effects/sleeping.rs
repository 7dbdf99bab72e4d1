//! An effect that has nothing to do sleeps: it looks at nothing, and the bits are those without it.

use drapery_core::Vec3;
use drapery_core::scene::{
    BodyDescription, BodyShape, EffectRequest, GarmentDescription, RigidMotion, Scene, SceneDescription,
};
use drapery_core::simulation::{FrameInput, FrameSummary, Simulation};
use drapery_tests::{add_gravity, add_pins, ball_input, positions, scene_of, sheet, swelling_ball};

/// Frames that a scene runs.
const FRAMES: i64 = 5;

/// A sheet three metres above a deforming ball.
fn above_a_ball() -> SceneDescription {
    let mut mesh = sheet(12, 12, 0.05);
    mesh.points.iter_mut().for_each(|p| p.y += 3.0);
    let mut description = scene_of(GarmentDescription::new("sheet", mesh, 0.2), 24);
    add_gravity(&mut description, [0.0, -9.81, 0.0]);
    description.effects.push(EffectRequest::of_garment("stretch", 0).with("stiffness", 100.0));
    let (triangles, points) = swelling_ball(0.0);
    let shape = BodyShape::Surface { triangles, point_count: points.len() };
    description.bodies.push(BodyDescription::new("ball", shape, RigidMotion::at(Vec3::zeros())));
    description.effects.push(EffectRequest::of_scene("body_collision"));
    description
}

/// The same, held at two corners.
fn hung() -> SceneDescription {
    let mut description = above_a_ball();
    add_pins(&mut description, vec![0, 12]);
    description
}

/// Positions at the end, and everything counted on the way.
fn run(description: SceneDescription) -> (Vec<Vec3>, FrameSummary) {
    let has_ball = !description.bodies.is_empty();
    let input = |frame| if has_ball { ball_input(frame) } else { FrameInput::to_frame(frame) };
    let mut simulation = {
        let input = input(0);
        let scene = Scene::validate(description).unwrap_or_else(|problems| panic!("{problems}"));
        Simulation::new(scene, &input).unwrap_or_else(|problems| panic!("{problems}"))
    };
    let mut all = FrameSummary::empty(0);
    for frame in 1..=FRAMES {
        let summary = simulation.advance(&input(frame)).unwrap_or_else(|error| panic!("{error}"));
        all = summary.after(&all);
    }
    (positions(&simulation), all)
}

#[test]
fn a_body_out_of_reach_is_hardly_ever_asked_and_changes_no_bit() {
    let (with_body, summary) = run(hung());
    let asked = summary.metrics.counted("body_queries") as f64 / (summary.steps * with_body.len() as u64) as f64;
    assert!(asked < 0.1, "{asked} queries a vertex and step");
    assert_eq!(summary.metrics.counted("body_contacts"), 0);
    let mut alone = hung();
    alone.bodies.clear();
    alone.effects.retain(|request| request.effect != "body_collision");
    assert_eq!(run(alone).0, with_body);
}

#[test]
fn repulsions_without_a_pair_near_change_no_bit() {
    let mut repelled = hung();
    repelled.effects.push(EffectRequest::of_scene("self_repulsion"));
    let ((with, summary), (without, _)) = (run(repelled), run(hung()));
    assert_eq!(summary.metrics.counted("repulsions") + summary.metrics.counted("attractions"), 0);
    assert!(summary.metrics.counted("collision_steps") > 0, "repulsions are there");
    assert_eq!(with, without);
}

#[test]
fn cloth_that_falls_as_a_whole_is_searched_for_pairs_once() {
    let mut description = above_a_ball();
    // The points of a deforming body would move otherwise than the cloth.
    description.bodies.clear();
    description.effects.retain(|request| request.effect != "body_collision");
    description.effects.push(EffectRequest::of_scene("self_repulsion"));
    description.effects.push(EffectRequest::of_scene("self_collision"));
    let (_, summary) = run(description);
    let counted = |name| summary.metrics.counted(name);
    assert!(counted("collision_steps") > 3, "{} collision steps", counted("collision_steps"));
    assert_eq!([counted("pair_searches"), counted("swept_searches"), counted("collision_loops")], [1, 0, 0]);
}
