//! Cloth that stiffens as it is pulled, in long steps, against its own curve; and what is said of strain.

use drapery_core::Vec3;
use drapery_core::parallel::local_ranks::LocalRanks;
use drapery_core::parallel::ranks::Ranks;
use drapery_core::scene::{
    EffectRequest, GarmentDescription, Integrator, PinAnchor, PinTarget, Scene, SceneDescription,
};
use drapery_core::simulation::{FrameInput, Simulation};
use drapery_tests::*;

const STIFFNESS: f64 = 5.0;
const EXTENSION: f64 = 0.05;
const LOAD: f64 = 2.0;
const LINEARITY: f64 = 0.5;

/// Rows of cells of 2 cm.
const ROWS: usize = 30;

/// A strip with this number of columns of cells that hangs from its upper side, with or without a curve.
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

/// A band of 4 by 2 cells between two rows of pins, of which the right one goes away by `far` widths in a frame.
fn pulled_apart(far: f64) -> SceneDescription {
    let mesh = sheet(4, 2, 0.05);
    let mut description = scene_of(GarmentDescription::new("band", mesh, 0.2), 24);
    description.solver.integrator = Integrator::TrBdf2;
    add_springs(&mut description, 10.0, 1.0);
    for (column, offset) in [(0, 0.0), (4, far * 0.2)] {
        let vertices: Vec<u32> = (0..3).map(|row| row * 5 + column).collect();
        add_pins(&mut description, vertices.clone());
        let offsets = vec![(0.0, Vec3::zeros()), (1.0 / 24.0, Vec3::x() * offset)];
        let target = PinTarget::Path { anchor: PinAnchor::Start, vertices, offsets };
        description.pins.last_mut().expect("it was added").target = target;
    }
    description
}

#[test]
fn cloth_that_is_pulled_to_more_than_twice_its_length_is_named_and_counted_by_any_ranks() {
    for (far, is_over) in [(0.7, false), (1.5, true)] {
        let frames = |ranks: usize| {
            let run = move |communicator| {
                let ranks = Ranks::new(communicator);
                let description = ranks.is_first().then(|| pulled_apart(far));
                let scene = Scene::distribute(&ranks, description).unwrap_or_else(|p| panic!("{p}"));
                let mut simulation = Simulation::new(scene, &FrameInput::to_frame(0)).unwrap_or_else(|p| panic!("{p}"));
                let summary = run(&mut simulation, 24);
                (summary.overstretched.clone(), summary.metrics.counted("edges_overstretched"))
            };
            LocalRanks::run(ranks, 1, run).expect("no rank ends early")
        };
        let alone = frames(1).remove(0);
        for count in [2, 3] {
            let found = frames(count);
            assert!(found.iter().all(|(found, _)| *found == alone.0), "{count} ranks");
            // The first rank has the counts of all.
            assert_eq!(found[0].1, alone.1, "{count} ranks");
        }
        let (found, counted) = alone;
        assert_eq!(found.is_some(), is_over, "{far}");
        let Some(found) = found else { continue };
        // At rest, the band is evenly stretched: the edges along it and no others, twelve, are 2.5 times as long; diagonals 1.9 times.
        assert_eq!((found.edges, counted, found.pinched), (12, 12, 0));
        assert!((found.most.strain - far).abs() < 0.1, "{}", found.most.strain);
        assert_eq!((found.most.garment.as_str(), found.bodies.len()), ("band", 0));
    }
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
