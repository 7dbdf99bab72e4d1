//! Cloth against the edges of analytic shapes, and against bodies thinner than their motion in a step.

use drapery_core::Vec3;
use drapery_core::geometry::shapes::Shape;
use drapery_core::metrics::Metrics;
use drapery_core::scene::{BodyDescription, BodyShape, GarmentDescription, Integrator, RigidMotion, SceneDescription};
use drapery_core::simulation::{FrameSummary, Simulation};
use drapery_io::scene_file;
use drapery_tests::*;
use nalgebra::UnitQuaternion;

use crate::{FPS, MeshBody, run_with_mesh, upright_sheet};

/// Cells of the coarse sheet, and their size [m].
const CELLS: usize = 8;
const DX: f64 = 0.1;

/// Samples along each side of a triangle.
const SAMPLES: usize = 12;

const THICKNESS: f64 = 0.002;

/// Smallest signed distance between the faces of the sheet and a shape in its pose [m], by samples of all faces.
fn closest(simulation: &Simulation, shape: &Shape, motion: &RigidMotion) -> f64 {
    // Positions in the order of the solver, as the triangles.
    let (x, time) = (&simulation.state().x, simulation.state().time);
    let turn = UnitQuaternion::from_scaled_axis(motion.angular_velocity * time) * motion.rotation;
    let local = |p: Vec3| turn.inverse() * (p - motion.path[0].1);
    let mut least = f64::INFINITY;
    for corners in simulation.scene().meshes()[0].triangles() {
        let [a, b, c] = corners.map(|v| local(x[v as usize]));
        for i in 0..=SAMPLES {
            for j in 0..=SAMPLES - i {
                let [s, t] = [i, j].map(|k| k as f64 / SAMPLES as f64);
                least = least.min(shape.distance(&(a + (b - a) * s + (c - a) * t)));
            }
        }
    }
    least
}

/// A coarse sheet above the origin, with contact.
fn coarse(integrator: Integrator) -> SceneDescription {
    let mut garment = GarmentDescription::new("sheet", sheet(CELLS, CELLS, DX), 0.2);
    garment.mesh.points.iter_mut().for_each(|p| *p += Vec3::new(0.03, 0.32, 0.02));
    let mut description = scene_of(garment, FPS);
    description.solver.integrator = integrator;
    add_cloth(&mut description, 0, 200.0);
    add_gravity(&mut description, [0.0, -9.81, 0.0]);
    add_self_contact(&mut description);
    description
}

/// Lays the coarse sheet for 16 frames on a shape that starts `turned` times as far as (0.5, 0, 0.3) rad, and spins. After each frame `check`
/// gets the distance of the faces from the shape [m], and words for the frame.
fn drape(
    shape: Shape,
    turned: f64,
    thickness: f64,
    integrator: Integrator,
    mut check: impl FnMut(&FrameSummary, f64, &str),
) {
    let rotation = UnitQuaternion::from_scaled_axis(Vec3::new(0.5, 0.0, 0.3) * turned);
    let motion = RigidMotion { rotation, angular_velocity: Vec3::y() * 1.5, ..RigidMotion::at(Vec3::zeros()) };
    let mut description = coarse(integrator);
    add_body(&mut description, BodyShape::Rigid(shape), motion.clone(), 0.3);
    description.bodies[0].thickness = thickness;
    let mut simulation = start(description);
    for frame in 1..=16 {
        let summary = run(&mut simulation, 1);
        check(&summary, closest(&simulation, &shape, &motion), &format!("{shape:?}, {integrator:?}, frame {frame}"));
    }
    let lowest = positions(&simulation).iter().map(|p| p.y).fold(f64::INFINITY, f64::min);
    assert!(lowest < 0.1, "{shape:?}: it hangs over the edges, down to {lowest} m");
}

#[test]
fn no_box_or_cylinder_shows_through_the_faces_of_coarse_cloth() {
    let shapes = [
        Shape::Box { half_extents: [0.15, 0.2, 0.15] },
        Shape::Box { half_extents: [0.2, 0.15, 0.1] },
        Shape::Cylinder { radius: 0.05, half_length: 0.2 },
        Shape::Cylinder { radius: 0.2, half_length: 0.15 },
    ];
    for (number, shape) in shapes.into_iter().enumerate() {
        for integrator in [Integrator::SemiImplicit, Integrator::TrBdf2] {
            let mut all = Metrics::default();
            drape(shape, number as f64, THICKNESS, integrator, |summary, distance, place| {
                all.add(&summary.metrics);
                assert!(distance > 0.0, "{place}: {} mm", 1e3 * distance);
            });
            assert_eq!((all.counted("crossings"), all.counted("pairs_pinched")), (0, 0), "{shape:?}, {integrator:?}");
        }
    }
}

/// Thickness that a scene file with the coarse sheet gives a shape by itself [m].
fn chosen_thickness(shape: &str) -> f64 {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("coarse.toml");
    let text = format!(
        r#"
drapery = 1
[shot]
frames = "0-1"
[[body]]
name = "shape"
shape = {{ {shape} }}
[[garment]]
name = "sheet"
panel = {{ resolution = {CELLS}, side = {}, aspect = 1.0, center = [0, 1, 0] }}
material = "cotton_shirting"
"#,
        CELLS as f64 * DX
    );
    std::fs::write(&path, text).expect("a scene");
    let shot = scene_file::load(&path, &[]).and_then(|scene| scene.resolve().map_err(|mut errors| errors.remove(0)));
    shot.unwrap_or_else(|error| panic!("{error}")).scene.bodies[0].thickness
}

#[test]
fn no_ball_or_capsule_shows_through_the_faces_of_coarse_cloth() {
    let shapes = [
        (Shape::Sphere { radius: 0.2 }, "sphere = { radius = 0.2 }"),
        (Shape::Capsule { radius: 0.2, half_length: 0.1 }, "capsule = { radius = 0.2, half_length = 0.1 }"),
    ];
    for (shape, written) in shapes {
        let thickness = chosen_thickness(written);
        for integrator in [Integrator::SemiImplicit, Integrator::TrBdf2] {
            drape(shape, 1.0, thickness, integrator, |summary, distance, place| {
                let strain = summary.max_strain.as_ref().map_or(0.0, |largest| largest.strain.max(0.0));
                // The sagitta of faces as large as at rest grows with the square of their stretch.
                let room = thickness * ((1.0 + strain).powi(2) - 1.0);
                assert!(distance > -room, "{place}: {} mm", 1e3 * distance);
                assert!(room < 0.2 * thickness, "{place}: {strain}");
            });
        }
    }
}

#[test]
fn cloth_does_not_pass_through_bodies_thinner_than_their_motion_in_a_step() {
    // Plates smaller than the sheet, which wraps around their edges, and larger ones, in front of which it stays.
    for (speed, size) in [(5.0, 0.15), (25.0, 0.4)] {
        for integrator in [Integrator::SemiImplicit, Integrator::TrBdf2] {
            strike_with_box(speed, size, integrator);
        }
    }
    // Around the border of a small open mesh cloth lies on both sides of it.
    for speed in [1.0, 2.0, 3.0, 3.5, 4.0, 6.0] {
        strike_with_open_mesh(speed, 0.15, 0.0, Integrator::SemiImplicit);
    }
    strike_with_open_mesh(4.0, 0.1, 10.0, Integrator::SemiImplicit);
    strike_with_open_mesh(5.0, 0.15, 0.0, Integrator::TrBdf2);
    for integrator in [Integrator::SemiImplicit, Integrator::TrBdf2] {
        strike_with_open_mesh(25.0, 0.4, 0.0, integrator);
    }
}

/// A plate that strikes an upright sheet of 60 cm.
struct Strike {
    description: SceneDescription,
    speed: f64,
    size: f64,
    /// Frames until it has gone on for half a metre.
    frames: i64,
}

impl Strike {
    fn new(speed: f64, size: f64, integrator: Integrator) -> Self {
        let mut description = scene_of(upright_sheet(12, 0.05), FPS);
        description.solver.integrator = integrator;
        add_cloth(&mut description, 0, 100.0);
        add_self_contact(&mut description);
        Self { description, speed, size, frames: (1.5 + 0.52 * f64::from(FPS) / speed).ceil() as i64 }
    }

    /// Place of the plate at a time [s], [m].
    fn at(&self, time: f64) -> Vec3 {
        Vec3::x() * (self.speed * (time - 1.5 / f64::from(FPS)))
    }

    /// Checks a frame; the plate is `half` behind and before its place [m].
    fn check(&self, simulation: &Simulation, summary: &FrameSummary, half: f64) {
        let place = format!("{half} m, {} m/s, {} m, frame {}", self.speed, self.size, simulation.frame());
        assert_eq!(summary.metrics.counted("crossings"), 0, "{place}");
        let plane = self.at(simulation.state().time).x + half;
        let in_front = positions(simulation).iter().map(|x| x.x - plane).fold(f64::INFINITY, f64::min);
        assert!(self.size < 0.3 || in_front > 0.0, "{place}: {} mm", 1e3 * in_front);
        let is_due = simulation.frame() >= 3 && self.speed >= 5.0;
        assert!(!is_due || positions(simulation).iter().all(|x| x.x > 0.0), "{place}: the sheet stays behind");
    }
}

/// Strikes the sheet with a box of 4 mm of this speed [m/s] and half of its size [m].
fn strike_with_box(speed: f64, size: f64, integrator: Integrator) {
    let mut strike = Strike::new(speed, size, integrator);
    let path = [0.0, 1.0].map(|time| (time, strike.at(time))).to_vec();
    let motion = RigidMotion { path, ..RigidMotion::at(Vec3::zeros()) };
    let plate = Shape::Box { half_extents: [0.002, size, size] };
    add_body(&mut strike.description, BodyShape::Rigid(plate), motion, 0.3);
    strike.description.bodies[0].thickness = 0.001;
    let mut simulation = start(strike.description.clone());
    for _ in 0..strike.frames {
        let summary = run(&mut simulation, 1);
        strike.check(&simulation, &summary, 0.002);
    }
}

/// The same with an open mesh of two triangles, which turns about the z axis [rad/s]; between frames its corners move straight.
fn strike_with_open_mesh(speed: f64, size: f64, spin: f64, integrator: Integrator) {
    let strike = Strike::new(speed, size, integrator);
    let corners = [[-size, -size], [size, -size], [size, size], [-size, size]];
    let place = |time: f64| {
        let (sin, cos) = (spin * (time - 1.5 / f64::from(FPS))).sin_cos();
        corners.map(|[y, z]| strike.at(time) + Vec3::new(-y * sin, y * cos, z)).to_vec()
    };
    let body = MeshBody { triangles: vec![[0, 1, 2], [0, 2, 3]], points: &place };
    let thin = |body: &mut BodyDescription| body.thickness = 0.001;
    run_with_mesh(strike.description.clone(), &body, thin, strike.frames, |simulation, summary| {
        strike.check(simulation, summary, 0.0);
    });
}
