//! Seams: how they close, and what they keep.

use drapery_core::Vec3;
use drapery_core::mesh::PolygonMesh;
use drapery_core::scene::{
    EffectRequest, FacePoint, GarmentDescription, Integrator, Mass, PinAnchor, PinDescription, PinHold, PinTarget,
    SceneDescription, SeamDescription,
};
use drapery_core::simulation::{BrokenHold, HoldOwner, Simulation};
use drapery_tests::*;

/// Cells of each sheet along the seam.
const CELLS: usize = 8;

/// A seam between the facing edges of two sheets that are `gap` apart along x [m]; they are 0.2 m wide, 0.2 kg/m².
fn two_sheets(gap: f64, rest_gap: Option<f64>) -> SceneDescription {
    let half = |side: f64| {
        let mut mesh = sheet(6, CELLS, 0.025);
        mesh.points.iter_mut().for_each(|p| p.x += side * (0.075 + 0.5 * gap));
        mesh
    };
    let mut description = scene_of(GarmentDescription::new("left", half(-1.0), 0.2), 100);
    description.garments.push(GarmentDescription::new("right", half(1.0), 0.2));
    for garment in 0..2 {
        description.effects.push(EffectRequest::of_garment("stretch", garment).with("stiffness", 200.0));
        description.effects.push(EffectRequest::of_garment("bending", garment).with("stiffness", 5.0));
    }
    let edge = |column: usize| (0..=CELLS).map(move |row| (column + 7 * row) as u32);
    description.seams.push(SeamDescription {
        from: 0.1,
        until: 0.5,
        rest_gap,
        ..SeamDescription::new([0, 1], edge(6).zip(edge(0)).map(|(a, b)| [a, b]).collect(), 400.0)
    });
    description.effects.push(EffectRequest::of_scene("seams"));
    description
}

/// Lengths of the gaps [m].
fn gaps(simulation: &Simulation) -> Vec<f64> {
    let (mut left, mut right) = (Vec::new(), Vec::new());
    simulation.garment_positions(0, &mut left);
    simulation.garment_positions(1, &mut right);
    (0..=CELLS).map(|row| (left[6 + 7 * row] - right[7 * row]).norm()).collect()
}

#[test]
fn a_seam_closes_evenly_over_its_time_and_stays_closed() {
    let mut simulation = start(two_sheets(0.08, Some(0.002)));
    let expected = |t: f64| 0.08 + (0.002 - 0.08) * ((t - 0.1) / 0.4).clamp(0.0, 1.0);
    for frame in 1..=70 {
        run(&mut simulation, 1);
        for gap in gaps(&simulation) {
            // The sheets have weight: they lag by the force over the stiffness while they are drawn, and swing at the end.
            assert!((gap - expected(0.01 * frame as f64)).abs() < 0.01, "frame {frame}: {gap} m");
        }
    }
    run(&mut simulation, 100);
    assert!(gaps(&simulation).iter().all(|gap| (gap - 0.002).abs() < 2e-4), "{:?}", gaps(&simulation));
}

#[test]
fn a_seam_keeps_momentum_and_angular_momentum() {
    let mut description = two_sheets(0.08, Some(0.0));
    // Moved apart sideways, so that the seam turns the sheets as well.
    description.garments[1].mesh.points.iter_mut().for_each(|p| p.z += 0.03);
    description.solver.cg_tolerance = Some(1e-13);
    let mut simulation = start(description);
    run(&mut simulation, 50);
    let state = simulation.state();
    let masses = simulation.scene().masses();
    let moving: f64 = state.v.iter().zip(masses).map(|(v, m)| v.norm() * m).sum();
    let linear: Vec3 = state.v.iter().zip(masses).map(|(v, m)| v * *m).sum();
    let angular: Vec3 = state.x.iter().zip(&state.v).zip(masses).map(|((x, v), m)| x.cross(v) * *m).sum();
    assert!(moving > 1e-3, "the sheets move");
    assert!(linear.norm() < 1e-10 * moving, "{linear:?} of {moving}");
    // Forces act at the middle of a straight step: kept to the order of the scheme.
    assert!(angular.norm() < 1e-3 * 0.1 * moving, "{angular:?} of {moving}");
}

#[test]
fn sewn_layers_that_repel_each_other_close_to_their_thickness_and_the_seam_is_not_strained() {
    let mut description = two_sheets(0.04, None);
    description.garments.iter_mut().for_each(|garment| garment.thickness = 0.003);
    for effect in ["self_repulsion", "self_collision"] {
        description.effects.push(EffectRequest::of_scene(effect));
    }
    let mut simulation = start(description);
    let summary = run(&mut simulation, 120);
    assert_eq!(summary.metrics.counted("crossings"), 0);
    for gap in gaps(&simulation) {
        assert!((gap - 0.003).abs() < 3e-4, "{gap} m");
    }
    assert!(simulation.plan().iter().any(|effect| effect.name == "seams" && !effect.notes.is_empty()));
}

#[test]
fn seams_of_vertices_that_do_not_exist_are_refused_by_number() {
    let refusal = |change: fn(&mut SeamDescription)| {
        let mut description = two_sheets(0.04, None);
        change(&mut description.seams[0]);
        drapery_core::scene::Scene::validate(description).unwrap_err().to_string()
    };
    assert!(refusal(|seam| seam.pairs[0][1] = 63).contains("63"));
    assert!(refusal(|seam| seam.garments[1] = 2).contains("garment"));
    assert!(refusal(|seam| seam.stiffness = f64::NAN).contains("stiffness"));
    assert!(refusal(|seam| (seam.garments, seam.pairs[0]) = ([0, 0], [3, 3])).contains("itself"));
}

/// The right sheet hangs from the left one, whose vertices are all held, by a seam that is closed from the start.
fn hanging_by_a_seam(integrator: Integrator) -> SceneDescription {
    let mut description = two_sheets(0.002, Some(0.002));
    set_steps_of_a_frame(&mut description, integrator, 4);
    description.seams[0].from = 0.0;
    description.seams[0].until = 0.0;
    let vertices = 0..7 * (CELLS as u32 + 1);
    let target = PinTarget::Path { anchor: PinAnchor::Start, vertices: vertices.collect(), offsets: Vec::new() };
    let (from, until) = (f64::NEG_INFINITY, f64::INFINITY);
    description.pins.push(PinDescription { garment: 0, target, axes: [true; 3], from, until, hold: PinHold::Hard });
    description.effects.push(EffectRequest::of_scene("pins"));
    add_gravity(&mut description, [0.0, -9.81, 0.0]);
    description
}

/// Height of the right sheet's centre of mass, above that of the left one, which is held [m].
fn height(simulation: &Simulation) -> f64 {
    let masses = simulation.scene().masses();
    let moment: f64 = simulation.state().x.iter().zip(masses).map(|(x, m)| x.y * m).sum();
    moment / (0.5 * masses.iter().sum::<f64>())
}

#[test]
fn a_button_that_opens_lets_the_cloth_fall_freely() {
    for integrator in [Integrator::SemiImplicit, Integrator::TrBdf2] {
        let mut description = hanging_by_a_seam(integrator);
        (description.seams[0].opens, description.seams[0].opened) = (Some(0.5), None);
        description.solver.cg_tolerance = Some(1e-10);
        let mut simulation = start(description);
        run(&mut simulation, 49);
        assert!(gaps(&simulation).iter().all(|gap| *gap < 0.03), "{integrator:?}: {:?}", gaps(&simulation));
        // The seam lets go at the end of frame 50: from 51 on gravity alone acts on the centre.
        run(&mut simulation, 2);
        let [a, b] = [(); 2].map(|()| {
            run(&mut simulation, 1);
            height(&simulation)
        });
        run(&mut simulation, 18);
        let (h, t) = (0.01, 0.18);
        let expected = b + ((b - a) / h - 0.5 * 9.81 * h) * t - 0.5 * 9.81 * t * t;
        let found = height(&simulation);
        assert!((found - expected).abs() < 1e-6, "{integrator:?}: {found} m, expected {expected} m");
    }
}

#[test]
fn a_zip_closes_from_its_first_pair_and_opens_from_its_last() {
    for integrator in [Integrator::SemiImplicit, Integrator::TrBdf2] {
        let mut description = two_sheets(0.03, Some(0.002));
        set_steps_of_a_frame(&mut description, integrator, 4);
        description.seams[0].zip = true;
        let mut simulation = start(description.clone());
        // The slider passes the first pair.
        run(&mut simulation, 14);
        let begun = gaps(&simulation);
        assert!(begun[0] < 0.02 && begun[8] > 0.025, "{integrator:?}: {begun:?}");
        // It has passed five; the sheets drift together meanwhile, and the last pairs have no spring yet.
        run(&mut simulation, 21);
        let closed = gaps(&simulation);
        assert!(closed[..5].iter().all(|gap| *gap < 0.003), "{integrator:?}: {closed:?}");
        assert!(closed[7..].iter().all(|gap| *gap > 0.0035), "{integrator:?}: {closed:?}");
        run(&mut simulation, 65);
        assert!(gaps(&simulation).iter().all(|gap| (gap - 0.002).abs() < 1e-3), "{:?}", gaps(&simulation));
        let mut description = hanging_by_a_seam(integrator);
        let seam = &mut description.seams[0];
        (seam.zip, seam.opens, seam.opened) = (true, Some(0.1), Some(0.5));
        let mut simulation = start(description);
        run(&mut simulation, 40);
        let open = gaps(&simulation);
        assert!(open[..2].iter().all(|gap| *gap < 0.003) && open[5..].iter().all(|gap| *gap > 0.02), "{open:?}");
    }
}

#[test]
fn seams_that_open_too_early_are_refused() {
    let refusal = |opens: Option<f64>, opened: Option<f64>| {
        let mut description = two_sheets(0.04, None);
        (description.seams[0].opens, description.seams[0].opened) = (opens, opened);
        drapery_core::scene::Scene::validate(description).unwrap_err().to_string()
    };
    assert!(refusal(Some(0.3), None).contains("it opens at 0.3 s, before it is closed at 0.5 s"));
    assert!(refusal(Some(0.9), Some(0.8)).contains("before it starts to open"));
    assert!(refusal(None, Some(0.8)).contains("without `opens`"));
}

/// A weight, a small triangle of 20 g, that hangs by one corner from the middle of a held face.
fn weight_on_a_face(integrator: Integrator, break_force: f64) -> SceneDescription {
    let face = vec![Vec3::zeros(), Vec3::new(0.3, 0.0, 0.0), Vec3::new(0.0, 0.0, 0.3)];
    let mesh = PolygonMesh::from_triangles(face, &[[0, 2, 1]]);
    let mut description = scene_of(GarmentDescription::new("held", mesh, 0.2), 100);
    set_steps_of_a_frame(&mut description, integrator, 4);
    let at = Vec3::new(0.1, -0.004, 0.05);
    let corners = [Vec3::zeros(), Vec3::new(0.01, -0.02, 0.0), Vec3::new(-0.01, -0.02, 0.0)];
    let mesh = PolygonMesh::from_triangles(corners.map(|corner| at + corner).into(), &[[0, 1, 2]]);
    let weight = GarmentDescription { mass: Mass::UniformTotal(0.02), ..GarmentDescription::new("weight", mesh, 0.2) };
    description.garments.push(weight);
    description.effects.push(EffectRequest::of_garment("stretch", 1).with("spring_stiffness", 100.0));
    let target = PinTarget::Path { anchor: PinAnchor::Start, vertices: vec![0, 1, 2], offsets: Vec::new() };
    let (from, until) = (f64::NEG_INFINITY, f64::INFINITY);
    description.pins.push(PinDescription { garment: 0, target, axes: [true; 3], from, until, hold: PinHold::Hard });
    description.effects.push(EffectRequest::of_scene("pins"));
    let faces = vec![FacePoint { vertex: 0, corners: [0, 1, 2], weights: [0.5, 1.0 / 3.0, 1.0 / 6.0] }];
    let seam = SeamDescription::new([1, 0], Vec::new(), 200.0);
    description.seams.push(SeamDescription { faces, keeps_gap: true, break_force: Some(break_force), ..seam });
    description.effects.push(EffectRequest::of_scene("seams"));
    add_gravity(&mut description, [0.0, -9.81, 0.0]);
    description
}

#[test]
fn a_weight_hangs_from_the_point_of_a_face_that_it_is_sewn_to() {
    for integrator in [Integrator::SemiImplicit, Integrator::TrBdf2] {
        let mut simulation = start(weight_on_a_face(integrator, 1.0));
        run(&mut simulation, 400);
        let mut x = Vec::new();
        simulation.garment_positions(1, &mut x);
        // The gap of 4 mm, and the spring strained by the weight: m g / k.
        let expected = Vec3::new(0.1, -0.004 - 0.02 * 9.81 / 200.0, 0.05);
        assert!((x[0] - expected).norm() < 1e-6, "{integrator:?}: {:?} for {expected:?}", x[0]);
    }
}

#[test]
fn a_stitch_breaks_at_its_force_and_the_weight_falls_freely() {
    for integrator in [Integrator::SemiImplicit, Integrator::TrBdf2] {
        // A weight that is let go pulls with at most twice its force.
        let mut simulation = start(weight_on_a_face(integrator, 0.41));
        assert!((0..100).all(|_| run(&mut simulation, 1).broken.is_empty()), "{integrator:?}");
        let mut simulation = start(weight_on_a_face(integrator, 0.15));
        let broken: Vec<_> = (0..20).flat_map(|_| run(&mut simulation, 1).broken).collect();
        let expected = BrokenHold { garment: "weight".into(), vertex: 0, of: HoldOwner::Seam(0) };
        assert_eq!(broken, [expected], "{integrator:?}");
        let centre = |simulation: &Simulation| {
            let mut x = Vec::new();
            simulation.garment_positions(1, &mut x);
            x.iter().map(|place| place.y).sum::<f64>() / 3.0
        };
        let fallen = [(); 3].map(|()| {
            run(&mut simulation, 1);
            centre(&simulation)
        });
        let acceleration = (fallen[2] - 2.0 * fallen[1] + fallen[0]) / 0.01_f64.powi(2);
        assert!((acceleration + 9.81).abs() < 1e-6, "{integrator:?}: {acceleration} m/s²");
    }
}

/// Momentum and angular momentum, over the sum of the sizes of the momenta of all vertices, of two sheets that stitches on faces draw
/// together in this number of steps a frame.
fn momenta_of_face_stitches(integrator: Integrator, steps: usize) -> [f64; 2] {
    let mut description = two_sheets(0.06, Some(0.0));
    set_steps_of_a_frame(&mut description, integrator, steps);
    description.garments[1].mesh.points.iter_mut().for_each(|p| p.z += 0.03);
    description.solver.cg_tolerance = Some(1e-13);
    let seam = &mut description.seams[0];
    seam.pairs.clear();
    let weights = [0.2, 0.5, 0.3];
    let faces = (0..CELLS as u32).map(|row| (6 + 7 * row, [7 * row, 7 * row + 7, 7 * row + 1]));
    seam.faces = faces.map(|(vertex, corners)| FacePoint { vertex, corners, weights }).collect();
    let mut simulation = start(description);
    run(&mut simulation, 50);
    let (state, masses) = (simulation.state(), simulation.scene().masses());
    let moving: f64 = state.v.iter().zip(masses).map(|(v, m)| v.norm() * m).sum();
    let linear: Vec3 = state.v.iter().zip(masses).map(|(v, m)| v * *m).sum();
    let angular: Vec3 = state.x.iter().zip(&state.v).zip(masses).map(|((x, v), m)| x.cross(v) * *m).sum();
    assert!(moving > 1e-3, "the sheets move");
    [linear, angular].map(|momentum| momentum.norm() / moving)
}

#[test]
fn a_stitch_on_a_face_keeps_momentum_and_to_the_order_of_the_scheme_angular_momentum() {
    for integrator in [Integrator::SemiImplicit, Integrator::TrBdf2] {
        let [coarse, fine] = [4, 16].map(|steps| momenta_of_face_stitches(integrator, steps));
        assert!(coarse[0].max(fine[0]) < 1e-8, "{integrator:?}: {coarse:?} {fine:?}");
        assert!(coarse[1] < 1e-3 && fine[1] < 0.3 * coarse[1], "{integrator:?}: {coarse:?} {fine:?}");
    }
}

#[test]
fn stitches_on_faces_that_cannot_be_are_refused() {
    let refusal = |change: fn(&mut SceneDescription)| {
        let mut description = weight_on_a_face(Integrator::TrBdf2, 1.0);
        change(&mut description);
        drapery_core::scene::Scene::validate(description).unwrap_err().to_string()
    };
    assert!(refusal(|scene| scene.seams[0].faces[0].corners[1] = 3).contains("vertex 0 is sewn to the face [0, 3, 2]"));
    assert!(refusal(|scene| scene.seams[0].faces[0].weights[1] = 0.9).contains("do not add up to one"));
    assert!(refusal(|scene| scene.seams[0].garments = [0, 0]).contains("a face of its own"));
    assert!(
        refusal(|scene| {
            let again = scene.seams[0].clone();
            scene.seams.push(again);
        })
        .contains("vertex 0 is sewn twice to the same place")
    );
}
