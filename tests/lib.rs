//! Shared pieces of Drapery's tests: small scenes built in code, and the closed-form truths.
//!
//! ```
//! use drapery_core::scene::GarmentDescription;
//! use drapery_tests::{add_gravity, centre, positions, run, scene_of, sheet, start};
//!
//! // A sheet falls freely for a second: g t²/2.
//! let mut description = scene_of(GarmentDescription::new("sheet", sheet(2, 2, 0.1), 0.2), 24);
//! add_gravity(&mut description, [0.0, -9.81, 0.0]);
//! let mut simulation = start(description);
//! run(&mut simulation, 24);
//! assert!((centre(&positions(&simulation)).y + 0.5 * 9.81).abs() < 1e-12);
//! ```

pub mod conformance;
pub mod effect_names;
pub mod source_text;
pub mod structure;

use drapery_core::Vec3;
use drapery_core::scene::{EffectRequest, Integrator, PinAnchor, PinTarget, Scene, SceneDescription};
use drapery_core::simulation::{FrameInput, FrameSummary, Sample, Simulation};
pub use drapery_selftest::scenes::*;

/// Folder of the reference data beside the project, if it is there; tests that need it say that they skip.
pub fn shared_data() -> Option<std::path::PathBuf> {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data");
    if folder.is_dir() {
        return Some(folder);
    }
    println!("skipped: no shared data");
    None
}

/// The closed-form truths of the reference data.
pub fn truths() -> Option<serde_json::Value> {
    let text = std::fs::read_to_string(shared_data()?.join("analytic/truths.json")).expect("truths.json can be read");
    Some(serde_json::from_str(&text).expect("truths.json is valid JSON"))
}

/// A running simulation of a description that needs no samples.
pub fn start(description: SceneDescription) -> Simulation {
    let frame = description.timeline.start;
    let scene = Scene::validate(description).unwrap_or_else(|p| panic!("{p}"));
    Simulation::new(scene, &FrameInput::to_frame(frame)).unwrap_or_else(|p| panic!("{p}"))
}

/// A square metre of `cells` by `cells` cells with springs of this stiffness [N/m], of which two pinned edges turn against each other by
/// `turns` turns a second while they come closer, for some frames of 1/24 s; the choice of the integrator is left to the solver.
pub fn wrung(cells: usize, stiffness: f64, turns: f64, frames: i64) -> SceneDescription {
    let mut description = cloth(cells, 1.0 / cells as f64, stiffness);
    description.solver.integrator = Integrator::Auto;
    for effect in ["self_repulsion", "self_collision"] {
        description.effects.push(EffectRequest::of_scene(effect));
    }
    for (column, side) in [(0, -1.0), (cells, 1.0)] {
        for row in 0..=cells {
            let vertices = vec![(row * (cells + 1) + column) as u32];
            let radius = row as f64 / cells as f64 - 0.5;
            let offset = |frame: i64| {
                let time = frame as f64 / 24.0;
                let angle = 0.5 * side * std::f64::consts::TAU * turns * time;
                (time, Vec3::new(-side * 0.2 * time, radius * angle.sin(), radius * (angle.cos() - 1.0)))
            };
            add_pins(&mut description, vertices.clone());
            let offsets = (0..=frames).map(offset).collect();
            let target = PinTarget::Path { anchor: PinAnchor::Start, vertices, offsets };
            description.pins.last_mut().expect("it was added").target = target;
        }
    }
    description
}

/// Goes on by `frames` frames; returns the last summary.
pub fn run(simulation: &mut Simulation, frames: usize) -> FrameSummary {
    let next = |s: &mut Simulation| s.advance(&FrameInput::to_frame(s.frame() + 1)).unwrap_or_else(|e| panic!("{e}"));
    (1..frames).for_each(|_| drop(next(simulation)));
    next(simulation)
}

/// Positions of garment 0 in its own order.
pub fn positions(simulation: &Simulation) -> Vec<Vec3> {
    let mut out = Vec::new();
    simulation.garment_positions(0, &mut out);
    out
}

/// Velocities of garment 0 in its own order.
pub fn velocities(simulation: &Simulation) -> Vec<Vec3> {
    let mut out = Vec::new();
    simulation.garment_velocities(0, &mut out);
    out
}

/// Mean of the points.
pub fn centre(points: &[Vec3]) -> Vec3 {
    points.iter().sum::<Vec3>() / points.len() as f64
}

/// A ball of radius 0.2 m as a triangle surface, which at time `t` [s] has swollen and drifted: triangles and points [m].
pub fn swelling_ball(t: f64) -> (Vec<[u32; 3]>, Vec<Vec3>) {
    let (triangles, mut points) = unit_ball(12, 24);
    points.iter_mut().for_each(|p| *p = *p * (0.2 + 0.1 * t) + Vec3::new(0.3 * t, 0.2 * t, 0.0));
    (triangles, points)
}

/// The swelling ball at a frame of 1/24 s, as the only body.
pub fn ball_input(frame: i64) -> FrameInput {
    let time = frame as f64 / 24.0;
    FrameInput { frame, bodies: vec![vec![Sample { time, positions: swelling_ball(time).1 }]], ..FrameInput::default() }
}

/// Leaves the choice of the step to the frame: this many equal steps in each.
pub fn set_steps_of_a_frame(description: &mut SceneDescription, integrator: Integrator, steps: usize) {
    let frame = description.timeline.frame_duration();
    let solver = &mut description.solver;
    solver.integrator = integrator;
    if integrator.spec().is_implicit {
        solver.steps_per_frame = steps;
    } else {
        (solver.cfl, solver.max_dt) = (1e6, (steps > 1).then(|| frame / steps as f64));
    }
}
