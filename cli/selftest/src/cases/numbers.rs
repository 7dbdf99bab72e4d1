//! H38 to H41: numbers and space. Runs that differ only by how they are written down are compared over their first
//! frames, before folds make more of rounding than it is.

use drapery_core::Vec3;
use drapery_core::geometry::shapes::Shape;
use drapery_core::scene::{BodyShape, EffectRequest, RigidMotion, SceneDescription};
use nalgebra::Matrix3;

use crate::bench::{Bench, Record, Trial};
use crate::case::{Case, Figure};
use crate::scenes::*;

/// A sheet that falls onto a ball, over a second sheet: `size` times as large as usual, seen through `turn` and then
/// shifted by `shift` [m]. The rest shapes stay where they are: they say in which order vertices are worked on.
fn scene(size: f64, turn: &Matrix3<f64>, shift: Vec3) -> SceneDescription {
    // Times stay the same: gravity grows with the size, stiffness with its square, forces with its third power.
    let mut description = cloth(10, 0.03 * size, 20.0 * size * size);
    let mut second = description.garments[0].clone();
    second.name = "second".into();
    second.mesh.points.iter_mut().for_each(|p| *p = 0.8 * *p - Vec3::new(0.003, 0.01, 0.002) * size);
    description.garments.push(second);
    add_cloth(&mut description, 1, 20.0 * size * size);
    let gravity = turn * Vec3::new(0.0, -GRAVITY * size, 0.0);
    add_gravity(&mut description, [gravity.x, gravity.y, gravity.z]);
    let start = turn * Vec3::new(0.1, -1.0, 0.2) * size;
    for garment in &mut description.garments {
        let place = |p: &Vec3| turn * (p + Vec3::y() * (0.075 * size)) + shift;
        garment.start = Some(garment.mesh.points.iter().map(place).collect());
        (garment.velocity, garment.thickness) = (start, 0.0005 * size);
    }
    let ball = BodyShape::Rigid(Shape::Sphere { radius: 0.05 * size });
    add_body(&mut description, ball, RigidMotion::at(shift), 0.3);
    description.bodies[0].thickness = 0.001 * size;
    let repulsion = EffectRequest::of_scene("self_repulsion").with("stiffness", 0.5 * size.powi(3));
    description.effects.extend([repulsion, EffectRequest::of_scene("self_collision")]);
    description.solver.cg_tolerance = Some(1e-7 * size);
    description.timeline.fps_numerator = 60;
    description
}

/// Runs a scene. Long steps are solved more tightly: the order of their sums follows the numbers of a scene, so that runs differ by
/// what solves leave.
fn run(bench: &mut Bench<'_>, mut description: SceneDescription) -> Result<Record, String> {
    let tighter = bench.by_integrator(1.0, 1e-5);
    description.solver.cg_tolerance = description.solver.cg_tolerance.map(|tolerance| tolerance * tighter);
    bench.simulate_once(&Trial::still(description, 2))
}

/// Largest distance of vertices of `b` from where `place` puts those of `a`, over the size of the scene [m].
fn error(a: &Record, b: &Record, size: f64, place: impl Fn(&Vec3) -> Vec3) -> f64 {
    let pairs = a.last().positions.iter().flatten().zip(b.last().positions.iter().flatten());
    pairs.map(|(a, b)| (place(a) - b).norm()).fold(0.0, f64::max) / size
}

pub(super) const H38: Case = Case {
    id: "H38",
    title: "garments of a millimetre and of a kilometre",
    must: "the same motion at every size: no length is built in",
    judge: |bench| {
        // In long steps layers push by a law in pascals, which does not scale with this scene: they have to stay apart at every size.
        let layers: &[bool] = bench.by_integrator(&[true], &[false, true]);
        let mut figures = Vec::new();
        for with_layers in layers {
            let of_size = |bench: &mut Bench<'_>, size: f64| {
                let mut description = scene(size, &Matrix3::identity(), Vec3::zeros());
                if !with_layers {
                    description.garments.pop();
                    description.effects.retain(|effect| effect.garment != Some(1));
                }
                run(bench, description)
            };
            let usual = of_size(bench, 1.0)?;
            figures.push(Figure::at_least("contacts", usual.counted("body_contacts"), 1.0));
            for size in [1e-3, 1e3] {
                let scaled = of_size(bench, size)?;
                if *with_layers && bench.by_integrator(false, true) {
                    let crossings: usize = scaled.frames.iter().map(|frame| frame.crossings).sum();
                    let what = format!("intersections of layers at {size} times the size");
                    figures.push(Figure::exactly(what, crossings as f64, 0.0));
                } else {
                    let off = error(&usual, &scaled, 0.3 * size, |x| x * size);
                    figures.push(Figure::at_most(format!("distance at {size} times the size, relative"), off, 1e-6));
                }
            }
        }
        Ok(figures)
    },
};

pub(super) const H39: Case = Case {
    id: "H39",
    title: "100 km from the origin",
    must: "the same motion as at the origin",
    judge: |bench| {
        let shift = Vec3::new(1e5, -3e4, 2e4);
        let mut figures = Vec::new();
        for with_self_contact in [false, true] {
            let mut at = |shift: Vec3| {
                let mut description = scene(1.0, &Matrix3::identity(), shift);
                description.effects.retain(|effect| with_self_contact || !effect.effect.starts_with("self_"));
                run(bench, description)
            };
            let (here, there) = (at(Vec3::zeros())?, at(shift)?);
            let with = if with_self_contact { "with" } else { "without" };
            let what = format!("distance from the run at the origin, {with} self-contact [m]");
            figures.push(Figure::at_most(what, error(&here, &there, 1.0, |x| x + shift), 1e-6));
        }
        Ok(figures)
    },
};

pub(super) const H40: Case = Case {
    id: "H40",
    title: "the whole scene turned, and seen in a mirror",
    must: "the same motion, turned or mirrored",
    judge: |bench| {
        let usual = run(bench, scene(1.0, &Matrix3::identity(), Vec3::zeros()))?;
        let unturned = scene(1.0, &Matrix3::identity(), Vec3::zeros());
        let bar = bench.same_motion(unturned, |bench, finer| Ok(error(&usual, &run(bench, finer)?, 0.3, |x| *x)))?;
        let mut figures = Vec::new();
        for degrees in [30.0_f64, 90.0, 217.0] {
            let axis = nalgebra::Unit::new_normalize(Vec3::new(0.3, 1.0, -0.6));
            let turn = nalgebra::Rotation3::from_axis_angle(&axis, degrees.to_radians()).into_inner();
            let turned = run(bench, scene(1.0, &turn, Vec3::zeros()))?;
            let off = error(&usual, &turned, 0.3, |x| turn * x);
            figures.push(Figure::at_most(format!("distance after a turn by {degrees} degrees, relative"), off, bar));
        }
        let mirror = Matrix3::from_diagonal(&Vec3::new(-1.0, 1.0, 1.0));
        let mirrored = run(bench, scene(1.0, &mirror, Vec3::zeros()))?;
        figures.push(Figure::at_most(
            "distance in the mirror, relative",
            error(&usual, &mirrored, 0.3, |x| mirror * x),
            bar,
        ));
        Ok(figures)
    },
};

pub(super) const H41: Case = Case {
    id: "H41",
    title: "frame one million",
    must: "the same bits as from frame 0: times come from whole numbers",
    judge: |bench| {
        let mut late = scene(1.0, &Matrix3::identity(), Vec3::zeros());
        let early = run(bench, late.clone())?;
        (late.timeline.origin, late.timeline.start) = (1_000_000, 1_000_000);
        let late = run(bench, late)?;
        Ok(vec![Figure::exactly("distance from the early run [m]", error(&early, &late, 1.0, |x| *x), 0.0)])
    },
};
