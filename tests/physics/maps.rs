//! Painted maps: what is the same everywhere is the number, what is not is that of each vertex.

use drapery_core::Vec3;
use drapery_core::geometry::shapes::Shape;
use drapery_core::scene::painted::{MAPS, PaintedMap};
use drapery_core::scene::{
    BodyShape, EffectRequest, GarmentDescription, Mass, PinHold, RigidMotion, Scene, SceneDescription,
};
use drapery_tests::*;

/// A sheet that slides on a floor in the wind, held by springs at two corners, with every quantity that can be painted; each is
/// `times` what it is otherwise.
fn blown(times: f64) -> SceneDescription {
    let mut mesh = sheet(8, 6, 0.05);
    mesh.points.iter_mut().for_each(|p| *p += Vec3::new(0.0, 0.004 + 0.002 * (9.0 * p.x).sin(), 0.0));
    let mut garment = GarmentDescription::new("sheet", mesh, 0.2 * times);
    garment.thickness = 0.002 * times;
    garment.velocity = Vec3::new(0.5, -0.2, 0.3);
    let mut description = scene_of(garment, 100);
    add_gravity(&mut description, [0.0, -9.81, 0.0]);
    description.effects.push(EffectRequest::of_garment("stretch", 0).with("stiffness", 64.0 * times));
    description.effects.push(EffectRequest::of_garment("bending", 0).with("stiffness", 2.0 * times));
    let wind = EffectRequest::of_scene("wind").with_vector("velocity", [3.0, 1.0, 0.0]);
    let wind = wind.with("density", 0.5 * times).with("tangential", 0.1 * times);
    description.effects.push(wind.with("normal", 0.3 * times));
    add_body(&mut description, BodyShape::Rigid(Shape::HalfSpace), RigidMotion::at(Vec3::zeros()), 0.25 * times);
    add_pins(&mut description, vec![0, 8]);
    description.pins[0].hold = PinHold::Spring { stiffness: 16.0 * times, damping_ratio: 0.5, break_force: None };
    description.effects.pop();
    description.effects.push(EffectRequest::of_scene("attachments"));
    description.effects.push(EffectRequest::of_scene("self_repulsion"));
    description
}

fn uniform(value: f64, absolute: bool) -> PaintedMap {
    PaintedMap { values: vec![value; 63], absolute }
}

fn state_after(description: SceneDescription) -> Vec<Vec3> {
    let mut simulation = start(description);
    run(&mut simulation, 8);
    positions(&simulation)
}

#[test]
fn a_map_of_one_value_is_the_number_times_that_value_to_the_last_bit() {
    let doubled = state_after(blown(2.0));
    let mut painted = blown(1.0);
    // A factor of two rounds nothing, wherever it is multiplied.
    painted.garments[0].maps = MAPS.iter().map(|(name, _)| ((*name).to_owned(), uniform(2.0, false))).collect();
    assert_eq!(state_after(painted), doubled);
    let absolute = [
        ("density", 0.4),
        ("thickness", 0.004),
        ("friction", 0.5),
        ("stretch", 128.0),
        ("bending", 4.0),
        ("pins", 32.0),
    ];
    let mut replaced = blown(1.0);
    let maps = absolute.iter().map(|(name, value)| ((*name).to_owned(), uniform(*value, true)));
    replaced.garments[0].maps = maps.chain([("wind".to_owned(), uniform(2.0, false))]).collect();
    assert_eq!(state_after(replaced), doubled);
    assert_ne!(state_after(blown(1.0)), doubled, "the numbers matter");
}

#[test]
fn every_map_changes_what_it_is_of() {
    let plain = state_after(blown(1.0));
    for (name, _) in MAPS.iter().filter(|(name, _)| *name != "thickness") {
        let mut painted = blown(1.0);
        let values = (0..63).map(|v| 0.5 + 0.05 * v as f64).collect();
        painted.garments[0].maps.insert((*name).to_owned(), PaintedMap { values, absolute: false });
        assert_ne!(state_after(painted), plain, "{name}");
    }
}

#[test]
fn a_painted_half_is_as_heavy_as_it_says() {
    let mut description = scene_of(GarmentDescription::new("sheet", sheet(2, 1, 0.1), 0.1), 24);
    let values = vec![1.0, 1.0, 4.0, 1.0, 1.0, 4.0];
    description.garments[0].maps.insert("density".into(), PaintedMap { values, absolute: false });
    let scene = Scene::validate(description.clone()).unwrap_or_else(|p| panic!("{p}"));
    let mass = |vertex: u32| {
        let local =
            (0..6).find(|local| scene.parts().own_vertex(*local).1 == vertex).expect("every vertex is somewhere");
        scene.masses()[local]
    };
    // The corners at the right have one or two triangles of 0.005 m²: 4 · 0.1 kg/m² of a third of them.
    let right = mass(2) + mass(5);
    assert!((right - 0.4 * 3.0 * 0.005 / 3.0).abs() < 1e-15, "{right} kg");
    description.garments[0].mass = Mass::UniformTotal(1.0);
    assert!(Scene::validate(description).unwrap_err().to_string().contains("density"));
}

#[test]
fn a_broken_map_is_refused_with_its_name_and_vertex() {
    let refusal = |name: &str, change: fn(&mut PaintedMap)| {
        let mut description = blown(1.0);
        let mut map = uniform(1.0, false);
        change(&mut map);
        description.garments[0].maps.insert(name.into(), map);
        Scene::validate(description).unwrap_err().to_string()
    };
    for broken in [f64::NAN, -0.1, f64::INFINITY] {
        let mut description = blown(1.0);
        let mut map = uniform(1.0, false);
        map.values[17] = broken;
        description.garments[0].maps.insert("stretch".into(), map);
        let text = Scene::validate(description).unwrap_err().to_string();
        assert!(text.contains("map of stretch") && text.contains("17"), "{text}");
    }
    assert!(refusal("density", |map| map.values[3] = 0.0).contains("vertices 3"));
    assert!(refusal("friction", |map| map.values.truncate(62)).contains("62 values"));
    assert!(refusal("colour", |_| ()).contains("colour"));
    let mut description = blown(1.0);
    description.effects.retain(|effect| effect.effect != "wind");
    description.garments[0].maps.insert("wind".into(), uniform(1.0, false));
    assert!(Scene::validate(description).unwrap_err().to_string().contains("nothing in this scene looks at it"));
}
