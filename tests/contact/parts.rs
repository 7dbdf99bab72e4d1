//! Rules of contact for parts of garments.

use drapery_core::Vec3;
use drapery_core::geometry::shapes::Shape;
use drapery_core::mesh::PolygonMesh;
use drapery_core::scene::{
    BodyShape, ContactRule, ContactSide, EffectRequest, GarmentDescription, Integrator, RigidMotion, Scene,
    SceneDescription,
};
use drapery_selftest::bench::{Bench, Conditions, Record, Trial};
use drapery_selftest::case::Tier;
use drapery_tests::*;

use ContactSide::{Body, Garment, Part};

const CELLS: usize = 10;
const SHEET: usize = (CELLS + 1) * (CELLS + 1);
const GRAVITY: f64 = 9.81;

/// One garment of two level sheets at these heights [m]; the second is its part `pocket`.
fn coat(heights: [f64; 2]) -> GarmentDescription {
    let one = sheet(CELLS, CELLS, 0.02);
    let points = heights.iter().flat_map(|height| one.points.iter().map(move |p| p + Vec3::y() * *height)).collect();
    let faces = one.face_indices.chunks(3).map(|t| [t[0], t[1], t[2]]);
    let triangles: Vec<[u32; 3]> = faces.clone().chain(faces.map(|t| t.map(|v| v + SHEET as u32))).collect();
    let pocket = (SHEET as u32..2 * SHEET as u32).collect();
    GarmentDescription {
        thickness: 0.002,
        parts: [("pocket".to_owned(), pocket)].into(),
        ..GarmentDescription::new("coat", PolygonMesh::from_triangles(points, &triangles), 0.2)
    }
}

fn scene(garments: [GarmentDescription; 2], rules: &[ContactRule]) -> SceneDescription {
    let [coat, rug] = garments;
    let mut description = scene_of(coat, 24);
    description.garments.push(rug);
    add_gravity(&mut description, [0.0, -GRAVITY, 0.0]);
    for garment in 0..2 {
        description.effects.push(EffectRequest::of_garment("stretch", garment).with("stiffness", 200.0));
    }
    description.effects.push(EffectRequest::of_scene("self_repulsion"));
    description.effects.push(EffectRequest::of_scene("self_collision"));
    description.contacts = rules.to_vec();
    description
}

fn rug(height: f64) -> GarmentDescription {
    let mut mesh = sheet(CELLS, CELLS, 0.02);
    mesh.points.iter_mut().for_each(|p| *p += Vec3::new(0.003, height, 0.001));
    GarmentDescription { thickness: 0.002, ..GarmentDescription::new("rug", mesh, 0.2) }
}

fn ignore(a: ContactSide, b: ContactSide) -> ContactRule {
    ContactRule { ignore: true, ..ContactRule::new([a, b]) }
}

/// Runs twelve frames, the beginning on several numbers of ranks; nothing that does not ignore each other may cross.
fn simulated(description: SceneDescription, integrator: Integrator) -> Record {
    let conditions = Conditions { tier: Tier::Quick, integrator, drapery: "drapery".as_ref() };
    let mut bench = Bench::new(conditions).expect("a folder");
    bench.simulate(&Trial::still(description, 12)).unwrap_or_else(|text| panic!("{integrator:?}: {text}"))
}

/// Mean height of these points [m].
fn height(points: &[Vec3]) -> f64 {
    centre(points).y
}

#[test]
fn a_pocket_passes_through_its_coat_and_meets_all_else() {
    for integrator in Integrator::ALL {
        // The pocket falls through the coat, the rug rests on the coat.
        let garments = || [coat([0.0, 0.03]), rug(0.05)];
        let held = |mut description: SceneDescription| {
            add_pins(&mut description, (0..SHEET as u32).collect());
            description
        };
        let rules = [ignore(Part(0, 0), Garment(0)), ignore(Part(0, 0), Garment(1))];
        let record = simulated(held(scene(garments(), &rules)), integrator);
        let [coat, rug] = [0, 1].map(|garment| record.last().positions[garment].as_slice());
        let (fallen, free) = (0.03 - height(&coat[SHEET..]), 0.5 * GRAVITY * 0.25);
        assert!((fallen / free - 1.0).abs() < 0.02, "{integrator:?}: it fell by {fallen} m and not by {free} m");
        assert!(height(rug) > 0.0, "{integrator:?}: the rug is at {} m", height(rug));
        // Without the rule of the coat the pocket lies on it, and without that of the rug the rug lies on the pocket.
        let record = simulated(held(scene(garments(), &rules[1..])), integrator);
        assert!(height(&record.last().positions[0][SHEET..]) > 0.0, "{integrator:?}");
    }
}

#[test]
fn a_part_passes_through_a_body_that_holds_the_rest() {
    for integrator in Integrator::ALL {
        // The pocket starts below the floor, which only it may.
        let mut description = scene([coat([0.01, -0.05]), rug(0.03)], &[ignore(Part(0, 0), Body(0))]);
        add_body(&mut description, BodyShape::Rigid(Shape::HalfSpace), RigidMotion::at(Vec3::zeros()), 0.3);
        let record = simulated(description, integrator);
        let coat = &record.last().positions[0];
        let (fallen, free) = (-0.05 - height(&coat[SHEET..]), 0.5 * GRAVITY * 0.25);
        assert!((fallen / free - 1.0).abs() < 0.02, "{integrator:?}: it fell by {fallen} m and not by {free} m");
        assert!(height(&coat[..SHEET]) > -1e-3, "{integrator:?}: the coat is at {} m", height(&coat[..SHEET]));
    }
}

#[test]
fn parts_and_rules_that_contradict_are_named() {
    let problems_of = |change: &dyn Fn(&mut SceneDescription)| {
        let mut description = scene([coat([0.0, 0.03]), rug(0.05)], &[ignore(Part(0, 0), Garment(1))]);
        description.garments[1].parts.insert("fringe".into(), vec![0, 1, 2]);
        change(&mut description);
        Scene::validate(description).map_or_else(|problems| problems.to_string(), |_| String::new())
    };
    assert_eq!(problems_of(&|_| {}), "");
    for (change, words) in [
        (
            &(|scene: &mut SceneDescription| {
                scene.contacts.push(ContactRule { friction: Some(0.2), ..ContactRule::new([Garment(0), Part(1, 0)]) })
            }) as &dyn Fn(&mut SceneDescription),
            "it speaks of the same cloth as the rule for part \"pocket\" of garment \"coat\" and garment \"rug\"",
        ),
        (
            &|scene| drop(scene.garments[0].parts.insert("hem".into(), vec![7, 150])),
            "vertex 150 is of part \"hem\" too",
        ),
        (&|scene| drop(scene.garments[0].parts.insert("hem".into(), vec![999])), "there is no vertex 999"),
        (&|scene| scene.contacts[0].between[0] = Part(0, 3), "it names an object that does not exist"),
    ] {
        let text = problems_of(change);
        assert!(text.contains(words), "{words}\n{text}");
    }
}
