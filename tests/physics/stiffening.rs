//! Cloth that stiffens as it is pulled, in long steps, against its own curve; and what is said of strain.

use drapery_core::Vec3;
use drapery_core::scene::{EffectRequest, GarmentDescription, Integrator, SceneDescription};
use drapery_core::simulation::Simulation;
use drapery_tests::*;

const STIFFNESS: f64 = 5.0;
const EXTENSION: f64 = 0.05;
const LOAD: f64 = 2.0;
const LINEARITY: f64 = 0.5;

/// Rows of cells of 2 cm.
const ROWS: usize = 30;

/// A strip with so many columns of cells that hangs from its upper side, with or without a curve.
fn hanging(columns: u32, curve: bool) -> SceneDescription {
    let mut mesh = sheet(columns as usize, ROWS, 0.02);
    mesh.points.iter_mut().for_each(|p| *p = Vec3::new(p.x, -p.z, 0.0));
    let mut description = scene_of(GarmentDescription::new("strip", mesh, 0.2), 24);
    description.solver.integrator = Integrator::TrBdf2;
    add_gravity(&mut description, [0.0, -9.81, 0.0]);
    let strip = EffectRequest::of_garment("membrane", 0).with_vector("grain", [0.0, 1.0, 0.0]);
    let strip = strip.with("warp", STIFFNESS).with("shear", 1.0).with("poisson", 0.0);
    let curved =
        |strip: EffectRequest| strip.with("extension", EXTENSION).with("load", LOAD).with("linearity", LINEARITY);
    description.effects.push(if curve { curved(strip) } else { strip });
    description.effects.push(EffectRequest::of_scene("ether_drag").with("rate", 10.0));
    add_pins(&mut description, (0..=columns).collect());
    description
}

/// The strain at which cloth carries a force per width [N/m], by halving.
fn strain_at(force: f64) -> f64 {
    let r = LOAD / (STIFFNESS * EXTENSION);
    let q = 2.0 * (1.0 - 1.0 / r) / (LINEARITY - 1.0 / r) - 2.0;
    let carried = |e: f64| STIFFNESS * e * (1.0 + (r - 1.0) * (e / EXTENSION).powf(q));
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if carried(middle) < force { low = middle } else { high = middle }
    }
    low
}

fn length(simulation: &Simulation) -> f64 {
    let heights = || simulation.state().x.iter().map(|x| x.y);
    heights().fold(f64::MIN, f64::max) - heights().fold(f64::MAX, f64::min)
}

#[test]
fn a_strip_that_stiffens_hangs_down_as_far_as_its_curve_says() {
    let mut simulation = start(hanging(4, true));
    (0..96).for_each(|_| drop(run(&mut simulation, 1)));
    // The row of cells number i carries what hangs below its middle.
    let carried = |row: usize| 0.2 * 9.81 * 0.02 * (ROWS as f64 - row as f64 - 0.5);
    let expected = (0..ROWS).map(|row| 0.02 * (1.0 + strain_at(carried(row)))).sum::<f64>();
    let found = length(&simulation);
    // Triangles of a row share its load by thirds; it is still by less than a hundredth of what it has come down by.
    assert!((found - expected).abs() < 0.01 * (expected - 0.6), "{found} for {expected}");
    // Cloth of that stiffness at rest would come down more than three times as far: rho g L² / 2 Y.
    let linear = 0.2 * 9.81 * 0.6 * 0.6 / (2.0 * STIFFNESS);
    assert!(found - 0.6 < 0.4 * linear, "{found} {linear}");
}

#[test]
fn strains_of_a_frame_are_the_largest_and_that_which_one_edge_in_a_thousand_exceeds() {
    let mut simulation = start(hanging(30, false));
    for _ in 0..4 {
        let summary = run(&mut simulation, 1);
        let (mesh, x) = (&simulation.scene().meshes()[0], &simulation.state().x);
        let strain = |e: &drapery_core::mesh::Edge| {
            let [a, b] = e.vertices.map(|v| x[simulation.scene().parts().garment(0).start + v as usize]);
            (b - a).norm() / mesh.rest_length(*e) - 1.0
        };
        let mut all: Vec<f64> = mesh.edges().iter().map(strain).collect();
        all.sort_by(|a, b| b.total_cmp(a));
        let [found] = summary.strains.as_slice() else { panic!("one garment") };
        assert_eq!(found.garment, "strip");
        assert!((2000..3000).contains(&all.len()), "two edges may exceed the quantile");
        assert_eq!([found.largest, found.p99_9], [all[0], all[2]]);
        assert!(all[0] > all[2]);
        assert!(summary.max_strain.is_some_and(|most| (most.strain - all[0]).abs() < 1e-12));
    }
}
