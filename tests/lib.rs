//! Shared pieces of Drapery's tests: small scenes built in code, and the closed-form truths.

pub mod conformance;

use drapery_core::Vec3;
use drapery_core::mesh::PolygonMesh;
use drapery_core::scene::{
    BodyDescription, BodyShape, EffectRequest, GarmentDescription, PinAnchor, PinDescription, PinHold, PinTarget,
    RigidMotion, Scene, SceneDescription,
};
use drapery_core::simulation::{FrameInput, FrameSummary, Sample, Simulation};

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

/// A flat rectangle of `nx` by `nz` cells in the plane y = 0, around the origin, `dx` apart [m].
pub fn sheet(nx: usize, nz: usize, dx: f64) -> PolygonMesh {
    let at = |i: usize, k: usize| (i + (nx + 1) * k) as u32;
    let mut points = Vec::new();
    let mut triangles = Vec::new();
    for k in 0..=nz {
        for i in 0..=nx {
            points.push(Vec3::new((i as f64 - 0.5 * nx as f64) * dx, 0.0, (k as f64 - 0.5 * nz as f64) * dx));
            if i < nx && k < nz {
                // Diagonals alternate, so that the sheet has no direction of its own.
                let (a, b, c, d) = (at(i, k), at(i + 1, k), at(i + 1, k + 1), at(i, k + 1));
                triangles.extend(if (i + k) % 2 == 0 { [[a, c, b], [a, d, c]] } else { [[a, d, b], [b, d, c]] });
            }
        }
    }
    PolygonMesh::from_triangles(points, &triangles)
}

/// A scene with one garment, at `fps` frames per second from frame 0.
pub fn scene_of(garment: GarmentDescription, fps: u32) -> SceneDescription {
    let mut description = SceneDescription::new("test");
    description.timeline.fps_numerator = fps;
    description.garments.push(garment);
    description
}

/// Adds gravity [m/s²].
pub fn add_gravity(description: &mut SceneDescription, acceleration: [f64; 3]) {
    description.effects.push(EffectRequest::of_scene("gravity").with_vector("acceleration", acceleration));
}

/// Adds a stretch effect with the authors' constant spring stiffness [N] to garment 0.
pub fn add_springs(description: &mut SceneDescription, stiffness: f64, damping_ratio: f64) {
    let request = EffectRequest::of_garment("stretch", 0);
    description.effects.push(request.with("spring_stiffness", stiffness).with("damping_ratio", damping_ratio));
}

/// Adds a body and the effect that it needs.
pub fn add_body(description: &mut SceneDescription, shape: BodyShape, motion: RigidMotion, friction: f64) {
    let name = format!("body{}", description.bodies.len());
    description.bodies.push(BodyDescription { friction, ..BodyDescription::new(&name, shape, motion) });
    if description.bodies.len() == 1 {
        description.effects.push(EffectRequest::of_scene("body_collision"));
    }
}

/// Pins vertices of garment 0 where they start.
pub fn add_pins(description: &mut SceneDescription, vertices: Vec<u32>) {
    description.pins.push(PinDescription {
        garment: 0,
        target: PinTarget::Path { anchor: PinAnchor::Start, vertices, offsets: Vec::new() },
        axes: [true; 3],
        from: f64::NEG_INFINITY,
        until: f64::INFINITY,
        hold: PinHold::Hard,
    });
    if description.pins.len() == 1 {
        description.effects.push(EffectRequest::of_scene("pins"));
    }
}

/// A running simulation of a description that needs no samples.
pub fn start(description: SceneDescription) -> Simulation {
    let frame = description.timeline.start;
    let scene = Scene::validate(description).unwrap_or_else(|p| panic!("{p}"));
    Simulation::new(scene, &FrameInput::to_frame(frame)).unwrap_or_else(|p| panic!("{p}"))
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

/// The unit ball as a closed surface of triangles, poles on y: triangles and points.
pub fn unit_ball(rings: usize, sectors: usize) -> (Vec<[u32; 3]>, Vec<Vec3>) {
    let mut points = vec![Vec3::y()];
    for r in 1..rings {
        let (sin, cos) = (std::f64::consts::PI * r as f64 / rings as f64).sin_cos();
        points.extend((0..sectors).map(|s| {
            let (east, north) = (std::f64::consts::TAU * s as f64 / sectors as f64).sin_cos();
            Vec3::new(sin * north, cos, -sin * east)
        }));
    }
    points.push(-Vec3::y());
    let last = points.len() as u32 - 1;
    let at = |r: usize, s: usize| (1 + (r - 1) * sectors + s % sectors) as u32;
    let mut triangles = Vec::new();
    for s in 0..sectors {
        triangles.push([0, at(1, s), at(1, s + 1)]);
        triangles.push([last, at(rings - 1, s + 1), at(rings - 1, s)]);
        for r in 1..rings - 1 {
            triangles.push([at(r, s), at(r + 1, s), at(r + 1, s + 1)]);
            triangles.push([at(r, s), at(r + 1, s + 1), at(r, s + 1)]);
        }
    }
    (triangles, points)
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
    FrameInput {
        frame,
        bodies: vec![vec![Sample { time, positions: swelling_ball(time).1 }]],
        tracks: Vec::new(),
        wind: Vec::new(),
    }
}
