//! Painted maps: what is the same everywhere is the number, what is not is that of each vertex.

use drapery_core::Vec3;
use drapery_core::effects::maps;
use drapery_core::geometry::shapes::Shape;
use drapery_core::mesh::PolygonMesh;
use drapery_core::scene::vertex_maps::PaintedMap;
use drapery_core::scene::{
    BodyShape, EffectRequest, GarmentDescription, Integrator, Mass, PinHold, RigidMotion, Scene, SceneDescription,
};
use drapery_tests::*;
use nalgebra::UnitQuaternion;

/// A sheet that slides on a floor in the wind, held by springs at two corners, with every quantity that can be painted on one
/// sheet; each is `times` what it is otherwise.
fn blown(times: f64) -> SceneDescription {
    let mut mesh = sheet(8, 6, 0.05);
    mesh.points.iter_mut().for_each(|p| *p += Vec3::new(0.0, 0.004 + 0.002 * (9.0 * p.x).sin(), 0.0));
    let mut garment = GarmentDescription::new("sheet", mesh, 0.2 * times);
    garment.thickness = 0.002 * times;
    garment.velocity = Vec3::new(0.5, -0.2, 0.3);
    let mut description = scene_of(garment, 100);
    add_gravity(&mut description, [0.0, -9.81, 0.0]);
    for (name, stiffness) in [("stretch", 64.0), ("shear", 8.0), ("bending", 2.0), ("dihedral_bending", 1.0 / 65536.0)]
    {
        let request = EffectRequest::of_garment(name, 0).with("stiffness", stiffness * times);
        description.effects.push(request.with("damping_ratio", 0.25 * times));
    }
    let wrinkles = EffectRequest::of_garment("plastic_wrinkles", 0).with("yield_radius", 2.0 * times);
    description.effects.push(wrinkles.with("hardening", 0.125 * times).with("largest_angle", 1.0 / 256.0 * times));
    let limit = EffectRequest::of_garment("strain_limit", 0).with("limit", 1.0 / 512.0 * times);
    description.effects.push(limit.with("compression", 1.0 / 512.0 * times));
    description.effects.push(EffectRequest::of_scene("ether_drag").with("rate", 0.5 * times));
    let wind = EffectRequest::of_scene("wind").with_vector("velocity", [3.0, 1.0, 0.0]);
    let wind = wind.with("density", 0.5 * times).with("tangential", 0.1 * times);
    description.effects.push(wind.with("normal", 0.3 * times));
    add_body(&mut description, BodyShape::Rigid(Shape::HalfSpace), RigidMotion::at(Vec3::zeros()), 0.25 * times);
    add_pins(&mut description, vec![0, 8]);
    description.pins[0].hold =
        PinHold::Spring { stiffness: 16.0 * times, damping_ratio: 0.125 * times, break_force: Some(0.25 * times) };
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
    // A factor of four rounds nothing, wherever it or its root is multiplied.
    let expected = state_after(blown(4.0));
    let mut painted = blown(1.0);
    painted.garments[0].maps = of_one_sheet().map(|name| (name.to_owned(), uniform(4.0, false))).collect();
    assert_eq!(state_after(painted), expected);
    let absolute = [
        ("density", 0.8),
        ("thickness", 0.008),
        ("friction", 1.0),
        ("stretch", 256.0),
        ("shear", 32.0),
        ("bending", 8.0),
        ("dihedral_bending", 1.0 / 16384.0),
        ("strain_limit", 1.0 / 128.0),
        ("pins", 64.0),
        ("ether_drag", 2.0),
        ("stretch_damping", 1.0),
        ("shear_damping", 1.0),
        ("bending_damping", 1.0),
        ("dihedral_bending_damping", 1.0),
        ("yield_radius", 8.0),
        ("hardening", 0.5),
        ("largest_angle", 1.0 / 64.0),
        ("compression", 1.0 / 128.0),
        ("pin_damping", 0.5),
        ("break_force", 1.0),
    ];
    let mut replaced = blown(1.0);
    let maps = absolute.iter().map(|(name, value)| ((*name).to_owned(), uniform(*value, true)));
    replaced.garments[0].maps = maps.chain([("wind".to_owned(), uniform(4.0, false))]).collect();
    assert_eq!(state_after(replaced), expected);
    assert_ne!(state_after(blown(1.0)), expected, "the numbers matter");
}

/// Returns the names of the maps that apply to [`blown`]. Maps of elements, which take the place of springs, are left out, and so
/// is the map of layers, which take two sheets.
fn of_one_sheet() -> impl Iterator<Item = &'static str> {
    let others = ["membrane", "membrane_damping", "grain_angle", "self_friction"];
    maps().map(|(map, _)| map.name).filter(move |name| !others.contains(name))
}

/// A sheet of measured cloth with all its stiffness `times` as large, that falls on a corner.
fn falling(times: f64) -> SceneDescription {
    let mut description = blown(1.0);
    description.effects.retain(|effect| !["stretch", "shear"].contains(&effect.effect.as_str()));
    let membrane = EffectRequest::of_garment("membrane", 0).with("warp", 100.0 * times).with("weft", 60.0 * times);
    let membrane = membrane.with("shear", 8.0 * times).with("damping_ratio", 0.25 * times);
    description.effects.push(membrane.with("grain_angle", 0.125 * times));
    description
}

#[test]
fn a_map_of_a_membrane_is_a_share_of_all_its_moduli() {
    let mut painted = falling(1.0);
    painted.garments[0].maps.insert("membrane".into(), uniform(4.0, false));
    painted.garments[0].maps.insert("membrane_damping".into(), uniform(1.0, true));
    painted.garments[0].maps.insert("grain_angle".into(), uniform(4.0, false));
    assert_eq!(state_after(painted), state_after(falling(4.0)));
    let mut absolute = falling(1.0);
    absolute.garments[0].maps.insert("membrane".into(), uniform(4.0, true));
    assert!(Scene::validate(absolute).unwrap_err().to_string().contains("factor without a unit"));
}

#[test]
fn every_map_changes_what_it_is_of() {
    let plain = state_after(blown(1.0));
    for name in of_one_sheet().filter(|name| *name != "thickness") {
        let mut painted = blown(1.0);
        let values = (0..63).map(|v| 0.5 + 0.05 * v as f64).collect();
        painted.garments[0].maps.insert(name.to_owned(), PaintedMap { values, absolute: false });
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
    assert!(Scene::validate(description).unwrap_err().to_string().contains("nothing in this scene uses it"));
    let mut description = blown(1.0);
    description.effects.iter_mut().for_each(|effect| drop(effect.settings.remove("compression")));
    description.garments[0].maps.insert("compression".into(), uniform(1.0, false));
    assert!(Scene::validate(description).unwrap_err().to_string().contains("write `compression` as well"));
}

/// Columns of a strip along x behind the one where it is held, and its rows.
const STRIP: [usize; 2] = [16, 4];
const CELL: f64 = 0.00625;
const DENSITY: f64 = 0.2;
const GRAVITY: f64 = 9.81;

/// A strip held at its first `held` columns, at rest in a medium that calms it, and the share of a stiffness that is painted on
/// its columns: from four where it is held to one at its end.
fn tapered(of: &str, held: usize) -> (SceneDescription, Vec<f64>) {
    let columns = STRIP[0] + held;
    let at = |i: usize, k: usize| (i + columns * k) as u32;
    // All diagonals alike: where they alternate, a strip bends too softly (docs/dev/decisions/0013-bending.md).
    let cells = (0..STRIP[1])
        .flat_map(|k| (0..columns - 1).map(move |i| [at(i, k), at(i + 1, k), at(i + 1, k + 1), at(i, k + 1)]));
    let triangles: Vec<[u32; 3]> = cells.flat_map(|[a, b, c, d]| [[a, c, b], [a, d, c]]).collect();
    let mesh = PolygonMesh::from_triangles(sheet(columns - 1, STRIP[1], CELL).points, &triangles);
    let mut garment = GarmentDescription::new("strip", mesh, DENSITY);
    let shares: Vec<f64> = (0..columns).map(|i| 1.0 + 3.0 * (columns - 1 - i) as f64 / (columns - 1) as f64).collect();
    let values = (0..columns * (STRIP[1] + 1)).map(|v| shares[v % columns]).collect();
    garment.maps.insert(of.into(), PaintedMap { values, absolute: false });
    let mut description = scene_of(garment, 50);
    description.effects.push(EffectRequest::of_scene("ether_drag").with("rate", 150.0));
    let pinned = (0..columns * (STRIP[1] + 1)).filter(|v| v % columns < held).map(|v| v as u32).collect();
    add_pins(&mut description, pinned);
    (description, shares)
}

/// Returns the displacement of the last column of a strip at rest [m].
fn end_of(description: SceneDescription, held: usize) -> Vec3 {
    let (first, columns) = (description.garments[0].mesh.points.clone(), STRIP[0] + held);
    let mut simulation = start(description);
    run(&mut simulation, 30);
    let speed = velocities(&simulation).iter().map(Vec3::norm).fold(0.0, f64::max);
    assert!(speed < 1e-4, "still moving at {speed} m/s");
    let moved: Vec<Vec3> = positions(&simulation).iter().zip(&first).map(|(x, rest)| x - rest).collect();
    centre(&moved.into_iter().skip(columns - 1).step_by(columns).collect::<Vec<_>>())
}

#[test]
fn a_cantilever_of_painted_rigidity_drops_as_a_tapered_beam() {
    let (mut description, shares) = tapered("dihedral_bending", 2);
    add_gravity(&mut description, [0.0, -GRAVITY, 0.0]);
    let length = STRIP[0] as f64 * CELL;
    // Weight times the cube of the length, by the rigidity of the end: the slope stays below a twentieth.
    let rigidity = DENSITY * GRAVITY * length.powi(3) / 0.3;
    description.effects.push(EffectRequest::of_garment("stretch", 0).with("stiffness", 200.0));
    description.effects.push(EffectRequest::of_garment("dihedral_bending", 0).with("stiffness", rigidity));
    // By width: each column bends by the moment of what hangs beyond it, over half a cell to either side.
    let drop: f64 = (0..STRIP[0])
        .map(|column| {
            let beyond = (STRIP[0] - column) as f64 * CELL;
            DENSITY * GRAVITY * 0.5 * beyond * beyond / (rigidity * shares[column + 1]) * CELL * beyond
        })
        .sum();
    let found = -end_of(description, 2).y;
    assert!((found / drop - 1.0).abs() < 0.03, "{found} m, not {drop} m");
}

#[test]
fn a_hanging_strip_of_painted_membrane_stretches_column_by_column() {
    let (mut description, shares) = tapered("membrane", 1);
    add_gravity(&mut description, [GRAVITY, 0.0, 0.0]);
    let length = STRIP[0] as f64 * CELL;
    let warp = 50.0 * DENSITY * GRAVITY * length;
    let membrane = EffectRequest::of_garment("membrane", 0).with("warp", warp).with("poisson", 0.0);
    description.effects.push(membrane.with_vector("grain", [1.0, 0.0, 0.0]).with("thin_triangles", 0.0));
    let stretch: f64 = (0..STRIP[0])
        .map(|cell| {
            let below = (STRIP[0] - cell) as f64 - 0.5;
            DENSITY * GRAVITY * below * CELL / (0.5 * warp * (shares[cell] + shares[cell + 1])) * CELL
        })
        .sum();
    let found = end_of(description, 1).x;
    assert!((found / stretch - 1.0).abs() < 0.01, "{found} m, not {stretch} m");
}

#[test]
fn what_is_painted_away_is_as_if_it_were_not_there() {
    // A falling sheet whose right half has no membrane and no rigidity falls as dust there.
    let mut garment = GarmentDescription::new("sheet", sheet(8, 4, 0.05), DENSITY);
    garment.mesh.points.iter_mut().for_each(|p| p.y = 0.01 * (40.0 * p.x).sin() * (30.0 * p.z).cos());
    let flat = garment.mesh.points.iter().map(|p| Vec3::new(p.x, 0.0, p.z)).collect();
    garment.start = Some(flat);
    let values: Vec<f64> = (0..45).map(|v| f64::from(u8::from(v % 9 < 4))).collect();
    for name in ["membrane", "dihedral_bending"] {
        garment.maps.insert(name.into(), PaintedMap { values: values.clone(), absolute: false });
    }
    let mut description = scene_of(garment, 24);
    add_gravity(&mut description, [0.0, -GRAVITY, 0.0]);
    description.effects.push(EffectRequest::of_garment("membrane", 0).with("warp", 20.0));
    description.effects.push(EffectRequest::of_garment("dihedral_bending", 0).with("stiffness", 1e-4));
    let mut simulation = start(description);
    run(&mut simulation, 2);
    let v = velocities(&simulation);
    let free = Vec3::new(0.0, -GRAVITY * 2.0 / 24.0, 0.0);
    // Angles of triangles at the border of what is painted still pull at the corners beyond their edges.
    assert!((0..45).filter(|n| n % 9 > 5).all(|n| (v[n] - free).norm() < 1e-12), "dust");
    assert!((0..45).filter(|n| n % 9 < 4).all(|n| (v[n] - free).norm() > 1e-6), "cloth");
}

#[test]
fn every_vertex_falls_to_the_speed_that_its_painted_drag_allows() {
    let mut garment = GarmentDescription::new("sheet", sheet(3, 2, 0.1), DENSITY);
    let rates: Vec<f64> = (0..12).map(|v| 10.0 + f64::from(v)).collect();
    garment.maps.insert("ether_drag".into(), PaintedMap { values: rates.clone(), absolute: true });
    let mut description = scene_of(garment, 100);
    description.solver.cg_tolerance = Some(1e-14);
    add_gravity(&mut description, [0.0, -GRAVITY, 0.0]);
    description.effects.push(EffectRequest::of_scene("ether_drag").with("rate", 0.0));
    let mut simulation = start(description);
    run(&mut simulation, 500);
    for (v, rate) in velocities(&simulation).iter().zip(rates) {
        assert!((v.y + GRAVITY / rate).abs() < 1e-10, "rate {rate}: {v:?}");
    }
}

#[test]
fn edges_stop_at_the_limit_that_is_painted_on_them() {
    let (columns, rows) = (5, 31);
    let mut mesh = sheet(columns - 1, rows - 1, 0.02);
    mesh.points.iter_mut().for_each(|p| *p = Vec3::new(p.x, -p.z, 0.0));
    let mut garment = GarmentDescription::new("sheet", mesh, DENSITY);
    let limit = |row: usize| if row < 15 { 0.02 } else { 0.08 };
    let values = (0..columns * rows).map(|v| limit(v / columns)).collect();
    garment.maps.insert("strain_limit".into(), PaintedMap { values, absolute: true });
    let mut description = scene_of(garment, 24);
    add_gravity(&mut description, [0.0, -GRAVITY, 0.0]);
    description.effects.push(EffectRequest::of_garment("stretch", 0).with("stiffness", 2.0));
    description.effects.push(EffectRequest::of_garment("strain_limit", 0).with("sweeps", 400.0));
    description.effects.push(EffectRequest::of_scene("ether_drag").with("rate", 20.0));
    add_pins(&mut description, (0..columns as u32).collect());
    let mut simulation = start(description);
    run(&mut simulation, 24);
    let x = positions(&simulation);
    // Without a limit the weight below row 25 would stretch it by 12 %, and what is above by more.
    for row in 0..25 {
        let expected = 0.5 * (limit(row) + limit(row + 1));
        for column in 0..columns {
            let strain = (x[columns * (row + 1) + column] - x[columns * row + column]).norm() / 0.02 - 1.0;
            assert!((strain - expected).abs() < 0.1 * expected, "row {row}: {strain}, not {expected}");
        }
    }
}

/// Two layers closer than their thickness, the upper of which presses and slides, with this friction.
fn rubbing(friction: f64) -> SceneDescription {
    let mut description = scene_of(GarmentDescription::new("lower", sheet(6, 6, 0.05), DENSITY), 240);
    let mut upper = GarmentDescription::new("upper", sheet(6, 6, 0.05), DENSITY);
    upper.mesh.points.iter_mut().for_each(|p| *p += Vec3::new(0.012, 0.003, 0.017));
    upper.velocity = Vec3::new(0.4, -0.2, 0.1);
    description.garments.push(upper);
    for garment in &mut description.garments {
        garment.thickness = 0.004;
    }
    for garment in 0..2 {
        description.effects.push(EffectRequest::of_garment("stretch", garment).with("stiffness", 50.0));
    }
    description.effects.push(EffectRequest::of_scene("self_repulsion").with("friction", friction));
    description
}

#[test]
fn layers_rub_with_the_mean_of_what_is_painted_on_both() {
    let plain = state_after(rubbing(0.25));
    let with = |lower: Option<f64>, upper: Option<f64>, absolute: bool| {
        let mut description = rubbing(if absolute { 0.0 } else { 0.25 });
        for (garment, value) in description.garments.iter_mut().zip([lower, upper]) {
            if let Some(value) = value {
                garment.maps.insert("self_friction".into(), PaintedMap { values: vec![value; 49], absolute });
            }
        }
        state_after(description)
    };
    let apart = |a: &[Vec3], b: &[Vec3]| a.iter().zip(b).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max);
    assert!(apart(&state_after(rubbing(0.0)), &plain) > 1e-5, "friction matters");
    assert!(apart(&with(Some(0.0), Some(2.0), false), &plain) < 1e-9);
    assert!(apart(&with(Some(0.5), Some(0.0), true), &plain) < 1e-9);
    assert!(apart(&with(Some(3.0), None, false), &state_after(rubbing(0.5))) < 1e-9, "one of them alone");
}

#[test]
fn layers_push_each_other_as_far_apart_as_is_painted_on_them() {
    let with = |thickness: f64, painted: Option<(f64, bool)>| {
        let mut description = rubbing(0.25);
        for garment in &mut description.garments {
            garment.thickness = thickness;
            let map = painted.map(|(value, absolute)| PaintedMap { values: vec![value; 49], absolute });
            garment.maps.extend(map.map(|map| ("thickness".to_owned(), map)));
        }
        state_after(description)
    };
    let expected = with(0.004, None);
    assert_eq!(with(0.002, Some((2.0, false))), expected);
    assert_eq!(with(0.001, Some((0.004, true))), expected);
    assert_ne!(with(0.002, None), expected, "thickness matters");
}

/// Distance that a patch slides along a plank, narrower than its cells and below no vertex, with this friction of the plank and painted
/// factor.
fn slid_along_a_plank(friction: f64, painted: Option<f64>) -> f64 {
    let turn = UnitQuaternion::from_axis_angle(&Vec3::z_axis(), -std::f64::consts::PI / 5.0);
    let mut garment = GarmentDescription::new("patch", sheet(4, 3, 0.02), 1.0);
    garment.mesh.points.iter_mut().for_each(|p| *p = turn * (*p + Vec3::y() * 0.0015));
    if let Some(factor) = painted {
        let values = (0..20).map(|v| factor + 1e-9 * f64::from(v)).collect();
        garment.maps.insert("friction".into(), PaintedMap { values, absolute: false });
    }
    let mut description = scene_of(garment, 24);
    description.solver.integrator = Integrator::TrBdf2;
    add_gravity(&mut description, [0.0, -9.81, 0.0]);
    description.effects.push(EffectRequest::of_garment("stretch", 0).with("stiffness", 1000.0));
    for effect in ["self_repulsion", "self_collision"] {
        description.effects.push(EffectRequest::of_scene(effect));
    }
    description.effects.push(EffectRequest::of_garment("dihedral_bending", 0).with("stiffness", 1e-3));
    let motion = RigidMotion { rotation: turn, ..RigidMotion::at(turn * Vec3::y() * -0.5) };
    add_body(&mut description, BodyShape::Rigid(Shape::Box { half_extents: [2.0, 0.5, 0.004] }), motion, friction);
    description.bodies[0].thickness = 0.001;
    let mut simulation = start(description);
    let before = centre(&positions(&simulation));
    run(&mut simulation, 12);
    (turn.inverse() * (centre(&positions(&simulation)) - before)).x
}

#[test]
fn friction_painted_on_cloth_holds_on_its_edges_and_faces_too() {
    let [rough, smooth] = [0.6, 0.15].map(|friction| slid_along_a_plank(friction, None));
    let painted = slid_along_a_plank(0.6, Some(0.25));
    assert!(smooth > 1.5 * rough, "{rough} {smooth}");
    assert!((painted - smooth).abs() < 1e-3 * (smooth - rough), "{painted} for {smooth}, and {rough} unpainted");
}
