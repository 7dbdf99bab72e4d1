//! H23 to H37: contact.

use drapery_core::Vec3;
use drapery_core::scene::{BodyShape, GarmentDescription, RigidMotion, SceneDescription};
use drapery_core::simulation::{FrameInput, Sample};

use crate::bench::{Bench, Input, Trial};
use crate::case::{Case, Figure};
use crate::scenes::*;

/// A sheet of `cells` by `cells` squares of `dx` [m] in the plane x = 0.
pub(super) fn upright(cells: usize, dx: f64) -> GarmentDescription {
    let mut mesh = sheet(cells, cells, dx);
    mesh.points.iter_mut().for_each(|p| *p = Vec3::new(0.0, p.z, p.x));
    GarmentDescription::new("sheet", mesh, 0.2)
}

/// Adds a body of these triangles; `place` gives its points at a time [s]. Returns what the frames need.
pub(super) fn add_mesh_body<'a>(
    description: &mut SceneDescription,
    triangles: Vec<[u32; 3]>,
    place: impl Fn(f64) -> Vec<Vec3> + Sync + 'a,
) -> Input<'a> {
    let shape = BodyShape::Surface { triangles, point_count: place(0.0).len() };
    add_body(description, shape, RigidMotion::at(Vec3::zeros()), 0.3);
    let timeline = description.timeline;
    Box::new(move |frame| {
        let time = timeline.time(frame);
        FrameInput {
            frame,
            bodies: vec![vec![Sample { time, positions: place(time) }]],
            tracks: Vec::new(),
            wind: Vec::new(),
        }
    })
}

pub(super) const H23: Case = Case {
    id: "H23",
    title: "a kick of 5 to 50 m/s by a plate of 6 mm, one sample a frame",
    must: "nothing passes through the plate",
    judge: |bench| {
        let mut figures = Vec::new();
        for speed in [5.0, 20.0, 50.0] {
            let (points, triangles) = box_mesh(Vec3::new(0.003, 0.3, 0.3), 4);
            let place = |time: f64| -> Vec<Vec3> {
                points.iter().map(|p| p + Vec3::x() * (speed * (time - 1.5 / 24.0))).collect()
            };
            let mut description = scene_of(upright(12, 0.03), 24);
            add_cloth(&mut description, 0, 100.0);
            add_self_contact(&mut description);
            let input = add_mesh_body(&mut description, triangles, place);
            description.bodies[0].thickness = 0.001;
            let record = bench.simulate(&Trial { input, ..Trial::still(description, 5) })?;
            let front = speed * (5.0 - 1.5) / 24.0 + 0.003;
            let behind = record.last().positions[0].iter().filter(|x| x.x < front).count();
            figures.push(Figure::exactly(format!("vertices behind the plate at {speed} m/s"), behind as f64, 0.0));
        }
        Ok(figures)
    },
};

/// How far a patch slides in `seconds` down a plane of this slope [rad] from `speed` [m/s], over what Coulomb says.
fn slide(bench: &mut Bench<'_>, friction: f64, slope: f64, speed: f64) -> Result<(f64, f64), String> {
    let turn = nalgebra::UnitQuaternion::from_axis_angle(&Vec3::z_axis(), -slope);
    let mut mesh = sheet(4, 4, 0.03);
    let down = turn * Vec3::x();
    // Not below the plane by rounding.
    mesh.points.iter_mut().for_each(|p| *p = turn * (*p + Vec3::y() * 1e-6));
    let mut description = scene_of(GarmentDescription::new("patch", mesh, 0.2), 24);
    description.garments[0].velocity = down * speed;
    add_cloth(&mut description, 0, 200.0);
    add_weight(&mut description);
    add_floor(&mut description, friction);
    (description.bodies[0].motion.rotation, description.bodies[0].thickness) = (turn, 0.0);
    let record = bench.simulate(&Trial::still(description, 12))?;
    let centre = |x: &[Vec3]| x.iter().sum::<Vec3>() / x.len() as f64;
    let way = (centre(&record.last().positions[0]) - centre(&record.frames[0].positions[0])).dot(&down);
    let pull = GRAVITY * (slope.sin() - friction * slope.cos());
    let seconds: f64 = if pull < 0.0 { 0.5_f64.min(speed / -pull) } else { 0.5 };
    Ok((way, speed * seconds + 0.5 * pull * seconds * seconds))
}

pub(super) const H33: Case = Case {
    id: "H33",
    title: "friction of 0, 10 and in between on a slope of 30 degrees",
    must: "Coulomb's law",
    judge: |bench| {
        let slope = std::f64::consts::FRAC_PI_6;
        let mut figures = Vec::new();
        for (friction, speed) in [(0.0, 0.0), (0.3, 0.0), (0.3, 1.0), (0.8, 1.0), (10.0, 1.0), (10.0, 0.0)] {
            let (way, truth) = slide(bench, friction, slope, speed)?;
            let what = format!("error of the way at friction {friction} from {speed} m/s [m]");
            figures.push(Figure::at_most(what, (way - truth).abs(), 2e-4 + 0.002 * truth));
        }
        Ok(figures)
    },
};
