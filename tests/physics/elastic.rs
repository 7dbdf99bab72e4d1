//! Elastic bands, and garments that shrink and grow.

use drapery_core::Vec3;
use drapery_core::mesh::PolygonMesh;
use drapery_core::scene::{EffectRequest, ElasticDescription, GarmentDescription, Integrator, SceneDescription};
use drapery_core::settings::SettingValue;
use drapery_core::simulation::Simulation;
use drapery_tests::*;

const INTEGRATORS: [Integrator; 2] = [Integrator::SemiImplicit, Integrator::TrBdf2];

/// A triangle with a base of 0.2 m, on springs of 3 N along its edges.
fn triangle(integrator: Integrator) -> SceneDescription {
    let points = vec![Vec3::zeros(), Vec3::new(0.2, 0.0, 0.0), Vec3::new(0.1, 0.0, 0.15)];
    let mesh = PolygonMesh::from_triangles(points, &[[0, 2, 1]]);
    let mut description = scene_of(GarmentDescription::new("triangle", mesh, 0.2), 24);
    description.solver.integrator = integrator;
    description.effects.push(EffectRequest::of_garment("stretch", 0).with("spring_stiffness", 3.0));
    description
}

fn lengths(simulation: &Simulation) -> [f64; 3] {
    let x = positions(simulation);
    [(0, 1), (0, 2), (1, 2)].map(|(a, b)| (x[a] - x[b]).norm())
}

#[test]
fn a_band_and_the_cloth_share_their_tension() {
    for integrator in INTEGRATORS {
        let mut description = triangle(integrator);
        description
            .elastics
            .push(ElasticDescription { rest_scale: 0.6, ..ElasticDescription::new(0, vec![0, 1], 5.0) });
        description.effects.push(EffectRequest::of_scene("elastic_bands"));
        let mut simulation = start(description);
        run(&mut simulation, 96);
        // E₁ (l / l₀ − 1) + E₂ (l / (s l₀) − 1) = 0 along the base; the corner follows, its edges at rest.
        let expected = 0.2 * (3.0 + 5.0) / (3.0 + 5.0 / 0.6);
        let side = (0.1_f64.powi(2) + 0.15_f64.powi(2)).sqrt();
        for (found, expected) in lengths(&simulation).into_iter().zip([expected, side, side]) {
            assert!((found - expected).abs() < 1e-7, "{integrator:?}: {found} m for {expected} m");
        }
        let plan = simulation.plan().iter().find(|effect| effect.name == "elastic_bands").expect("it is planned");
        assert_eq!(plan.elements, 1);
        assert!(
            plan.notes[0].contains("1 edges, 0.2000 m long in the rest shape, 0.1200 m relaxed"),
            "{:?}",
            plan.notes
        );
    }
}

#[test]
fn cloth_shrinks_to_its_rest_scale_and_keeps_its_mass() {
    for integrator in INTEGRATORS {
        let mut description = triangle(integrator);
        let curve = vec![(0.0, SettingValue::Number(1.0)), (24.0, SettingValue::Number(0.7))];
        description.curves.insert("garment.triangle.rest_scale".into(), curve);
        let mut simulation = start(description);
        let masses = simulation.scene().masses().to_vec();
        let before = lengths(&simulation);
        run(&mut simulation, 96);
        for (found, before) in lengths(&simulation).into_iter().zip(before) {
            assert!((found - 0.7 * before).abs() < 1e-8, "{integrator:?}: {found} m of {before} m");
        }
        assert_eq!(simulation.scene().masses(), masses);
    }
}

#[test]
fn cloth_that_starts_at_another_scale_starts_where_it_was_modelled() {
    let mut description = triangle(Integrator::TrBdf2);
    description.garments[0].rest_scale = 1.25;
    let mut simulation = start(description);
    assert!((lengths(&simulation)[0] - 0.2).abs() < 1e-15);
    run(&mut simulation, 96);
    assert!((lengths(&simulation)[0] - 0.25).abs() < 1e-8);
}

#[test]
fn bands_of_no_length_and_of_other_vertices_are_refused() {
    let refusal = |vertices: Vec<u32>, stiffness: f64| {
        let mut description = triangle(Integrator::TrBdf2);
        description.elastics.push(ElasticDescription::new(0, vertices, stiffness));
        description.effects.push(EffectRequest::of_scene("elastic_bands"));
        let input = drapery_core::simulation::FrameInput::to_frame(0);
        match drapery_core::scene::Scene::validate(description) {
            Ok(scene) => Simulation::new(scene, &input).map(drop).unwrap_err().to_string(),
            Err(problems) => problems.to_string(),
        }
    };
    assert!(refusal(vec![2], 1.0).contains("no edge of the cloth has both of its ends among the chosen vertices"));
    assert!(refusal(vec![0, 7], 1.0).contains("vertex 7 does not exist"));
    assert!(refusal(vec![0, 1], f64::NAN).contains("stiffness"));
}
