//! A hundred steps of a small fixed scene on one thread, for counting instructions: what is not asked for costs nothing,
//! whether the build has it or not (docs/dev/measurements/effects.md). Prints the number of steps and a digest of the positions.

use drapery_core::{
    BodyDescription, BodyShape, EffectRequest, FrameInput, GarmentDescription, PolygonMesh, RigidMotion, Scene,
    SceneDescription, Shape, Simulation, Vec3,
};

/// Vertices along a side of the sheet.
const SIDE: u32 = 16;

/// A sheet just above a ball, with the effects that every build has.
fn description() -> SceneDescription {
    let place = |i: u32| f64::from(i) * 0.02 - 0.15;
    let points = (0..SIDE * SIDE).map(|v| Vec3::new(place(v % SIDE), 0.102, place(v / SIDE))).collect();
    let cell = |c: u32| c / (SIDE - 1) * SIDE + c % (SIDE - 1);
    let halves = |v: u32| [[v, v + SIDE, v + 1], [v + 1, v + SIDE, v + SIDE + 1]];
    let triangles: Vec<[u32; 3]> = (0..(SIDE - 1) * (SIDE - 1)).flat_map(|c| halves(cell(c))).collect();
    let mesh = PolygonMesh::from_triangles(points, &triangles);
    let mut description = SceneDescription::new("micro");
    description.timeline.fps_numerator = 10;
    description.solver.max_dt = Some(0.001);
    description.garments.push(GarmentDescription::new("sheet", mesh, 0.2));
    let ball = BodyShape::Rigid(Shape::Sphere { radius: 0.1 });
    let body = BodyDescription::new("ball", ball, RigidMotion::at(Vec3::zeros()));
    description.bodies.push(BodyDescription { friction: 0.3, thickness: 0.001, ..body });
    let stretch = EffectRequest::of_garment("stretch", 0).with("stiffness", 10.0);
    let of_scene = ["gravity", "body_collision", "self_repulsion", "self_collision"].map(EffectRequest::of_scene);
    description.effects.extend(std::iter::once(stretch).chain(of_scene));
    description
}

fn main() {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("one thread can be started");
    pool.install(|| {
        let scene = Scene::validate(description()).unwrap_or_else(|problems| panic!("{problems}"));
        let mut simulation = Simulation::new(scene, &FrameInput::to_frame(0)).unwrap_or_else(|p| panic!("{p}"));
        let summary = simulation.advance(&FrameInput::to_frame(1)).unwrap_or_else(|error| panic!("{error}"));
        let turned = |digest: u64, x: &f64| digest.rotate_left(7) ^ x.to_bits();
        let digest = simulation.state().x.iter().flat_map(|x| x.iter()).fold(0, turned);
        println!("{} steps, positions {digest:016x}", summary.steps);
    });
}
