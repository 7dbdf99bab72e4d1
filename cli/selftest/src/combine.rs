//! Three hard cases at once, drawn by a seed: what is mended for each alone may still fail together.
//!
//! A common scene, a sheet that falls, is changed by what makes each of the three hard. What holds for every case
//! decides: finite numbers, the same bits on any number of ranks, no crossing where there was none at the start.

use drapery_core::Vec3;
use drapery_core::geometry::shapes::Shape;
use drapery_core::scene::{BodyShape, GarmentDescription, PinAnchor, RigidMotion, SceneDescription};

use crate::bench::{Bench, Trial};
use crate::case::Figure;
use crate::scenes::*;

/// Frames of a combination.
const FRAMES: i64 = 6;

/// Change of the common scene that makes a case hard.
type Change = fn(&mut SceneDescription, &mut Random);

/// The cases that combine, in the order in which they change the scene.
const CHANGES: [(&str, Change); 20] = [
    ("H22", |scene, _| two_triangles(scene)),
    ("H1", |scene, _| set_all(scene, "stiffness", 1e5)),
    ("H2", |scene, _| set_all(scene, "stiffness", 0.01)),
    ("H3", |scene, _| uneven(scene)),
    ("H4", |scene, _| scene.solver.cfl *= 20.0),
    ("H5", |scene, _| scene.solver.max_dt = Some(5e-5)),
    ("H7", |scene, random| set_all(scene, "damping_ratio", [0.0, 300.0][random.pick(2)])),
    ("H10", |scene, _| scene.solver.cg_max_iterations = 3),
    ("H11", |scene, _| sliver(scene)),
    ("H19", |scene, random| part_pins(scene, random)),
    ("H21", |scene, random| scene.garments.iter_mut().for_each(|g| g.thickness = [0.06, 1e-6][random.pick(2)])),
    ("H23", |scene, random| scene.garments[0].velocity += random.vector() * 20.0),
    ("H24", |scene, _| add_crossing(scene)),
    ("H28", |scene, _| add_layer(scene)),
    ("H33", |scene, random| scene.bodies.iter_mut().for_each(|b| b.friction = [0.0, 10.0][random.pick(2)])),
    ("H36", |scene, _| add_needle(scene)),
    ("H39", |scene, random| shift(scene, random.vector() * 100.0)),
    ("H41", |scene, _| (scene.timeline.origin, scene.timeline.start) = (1_000_000, 1_000_000)),
    ("H50", |scene, random| scene.timeline.fps_numerator = [6, 1000][random.pick(2)]),
    ("storm", |scene, random| storm(scene, random)),
];

/// The case in which cloth starts with crossings.
const CROSSES: &str = "H24";

/// Three different cases of a seed.
fn drawn(seed: u64) -> [usize; 3] {
    let mut random = Random::new(seed.wrapping_add(1));
    (0..8).for_each(|_| _ = random.number());
    let mut three = [CHANGES.len(); 3];
    for place in 0..3 {
        while three[place] == CHANGES.len() || three[..place].contains(&three[place]) {
            three[place] = random.pick(CHANGES.len());
        }
    }
    three.sort_unstable();
    three
}

/// Returns the title of the combination of a seed.
pub fn title(seed: u64) -> String {
    drawn(seed).map(|change| CHANGES[change].0).join(" + ")
}

/// Runs the combination of a seed.
///
/// # Errors
/// A rule of every case is broken; the text describes the breach.
pub fn judge(bench: &mut Bench<'_>, seed: u64) -> Result<Vec<Figure>, String> {
    let mut random = Random::new(seed);
    let mut description = cloth(8, 0.03, 50.0);
    description.garments[0].mesh.points.iter_mut().for_each(|p| p.y = 0.112);
    add_weight(&mut description);
    let ball = BodyShape::Rigid(Shape::Sphere { radius: 0.1 });
    add_body(&mut description, ball, RigidMotion::at(Vec3::zeros()), 0.3);
    description.bodies[0].thickness = 0.001;
    add_self_contact(&mut description);
    let three = drawn(seed);
    three.iter().for_each(|change| (CHANGES[*change].1)(&mut description, &mut random));
    let may_cross = three.iter().any(|change| CHANGES[*change].0 == CROSSES);
    let record = bench.simulate(&Trial { may_cross, ..Trial::still(description, FRAMES) })?;
    let before = record.frames[0].crossings as f64;
    Ok(vec![Figure::at_most("intersections at the end", record.last().crossings as f64, before)])
}

/// Sets a setting of all stretch and bending effects.
fn set_all(scene: &mut SceneDescription, setting: &str, value: f64) {
    for effect in scene.effects.iter_mut().filter(|effect| effect.garment.is_some()) {
        let share = if setting == "stiffness" && effect.effect == "bending" { 0.05 } else { 1.0 };
        *effect = effect.clone().with(setting, share * value);
    }
}

/// Two triangles instead of the sheet.
fn two_triangles(scene: &mut SceneDescription) {
    scene.garments[0].mesh = sheet(1, 1, 0.1);
    scene.garments[0].mesh.points.iter_mut().for_each(|p| p.y = 0.112);
}

/// Cells that grow a hundredfold in area.
fn uneven(scene: &mut SceneDescription) {
    let stretch = |c: f64| 0.24 * ((2.3 * (c / 0.24 + 0.5)).exp() - 1.0) / (2.3_f64.exp() - 1.0) - 0.12;
    scene.garments[0].mesh.points.iter_mut().for_each(|p| *p = Vec3::new(stretch(p.x), p.y, stretch(p.z)));
}

/// A column of cells a thousandth as wide as high.
fn sliver(scene: &mut SceneDescription) {
    let narrow = |x: f64| if x > 0.0 { x - 0.03 + 3e-5 } else { x };
    scene.garments[0].mesh.points.iter_mut().for_each(|p| p.x = narrow(p.x));
}

/// Two corners that part by several times their distance.
fn part_pins(scene: &mut SceneDescription, random: &mut Random) {
    let last = scene.garments[0].mesh.points.len() as u32 - 1;
    for (vertex, sign) in [(0, -1.0), (last, 1.0)] {
        add_pins(scene, vec![vertex]);
        if let Some(drapery_core::scene::PinTarget::Path { anchor, offsets, .. }) =
            scene.pins.last_mut().map(|pin| &mut pin.target)
        {
            let way = (Vec3::new(0.5, 0.5, 0.0) + random.vector() * 0.2) * sign;
            *anchor = PinAnchor::Start;
            *offsets = vec![(0.0, Vec3::zeros()), (0.1, way)];
        }
    }
}

/// A sheet that stands through the first.
fn add_crossing(scene: &mut SceneDescription) {
    let mut mesh = sheet(5, 5, 0.03);
    mesh.points.iter_mut().for_each(|p| *p = Vec3::new(0.11, p.x + 0.16, p.z + 0.004));
    scene.garments.push(GarmentDescription::new("through", mesh, 0.2));
    add_cloth(scene, scene.garments.len() - 1, 50.0);
}

/// A sheet that falls onto the first.
fn add_layer(scene: &mut SceneDescription) {
    let mut mesh = sheet(6, 6, 0.03);
    mesh.points.iter_mut().for_each(|p| *p += Vec3::new(0.004, 0.3, 0.003));
    scene.garments.push(GarmentDescription::new("above", mesh, 0.2));
    scene.garments.last_mut().into_iter().for_each(|garment| garment.velocity = Vec3::new(0.0, -5.0, 0.0));
    add_cloth(scene, scene.garments.len() - 1, 50.0);
}

/// A needle beside the ball, its tip under the sheet.
fn add_needle(scene: &mut SceneDescription) {
    let needle = BodyShape::Rigid(Shape::Capsule { radius: 1e-4, half_length: 0.05 });
    add_body(scene, needle, RigidMotion::at(Vec3::new(0.06, 0.055, 0.05)), 0.3);
}

/// The scene elsewhere.
fn shift(scene: &mut SceneDescription, by: Vec3) {
    for garment in &mut scene.garments {
        garment.mesh.points.iter_mut().for_each(|p| *p += by);
    }
    let paths = scene.bodies.iter_mut().flat_map(|body| &mut body.motion.path);
    paths.for_each(|(_, place)| *place += by);
}

/// Velocities that have nothing to do with each other.
fn storm(scene: &mut SceneDescription, random: &mut Random) {
    let garment = &mut scene.garments[0];
    let velocity = garment.velocity;
    let points = garment.mesh.points.len();
    garment.start_velocities = Some((0..points).map(|_| velocity + random.vector() * 5.0).collect());
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_seed_draws_three_different_cases_always_the_same() {
        for seed in 0..500 {
            let [a, b, c] = drawn(seed);
            assert!(a < b && b < c && c < CHANGES.len(), "{seed}");
            assert_eq!(drawn(seed), [a, b, c]);
        }
        let all: std::collections::BTreeSet<usize> = (0..200).flat_map(drawn).collect();
        assert_eq!(all.len(), CHANGES.len(), "every case is drawn");
    }
}
