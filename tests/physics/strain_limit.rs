//! The limit on strain: what it promises of lengths, momentum and energy.

use drapery_core::Vec3;
use drapery_core::scene::{
    EffectRequest, GarmentDescription, Integrator, PinAnchor, PinDescription, PinHold, PinTarget, SceneDescription,
};
use drapery_core::simulation::Simulation;
use drapery_tests::*;

/// A soft sheet that hangs from one of its sides, with a limit on its strain.
fn hanging(cells: usize, limit: f64, sweeps: f64) -> SceneDescription {
    let mut mesh = sheet(4, cells, 0.02);
    mesh.points.iter_mut().for_each(|p| *p = Vec3::new(p.x, -p.z, 0.0));
    let mut description = scene_of(GarmentDescription::new("sheet", mesh, 0.2), 24);
    add_gravity(&mut description, [0.0, -9.81, 0.0]);
    description.effects.push(EffectRequest::of_garment("stretch", 0).with("stiffness", 2.0));
    description.effects.push(EffectRequest::of_garment("strain_limit", 0).with("limit", limit).with("sweeps", sweeps));
    add_pins(&mut description, (0..5).collect());
    description
}

fn largest_strain(simulation: &Simulation) -> f64 {
    let (mesh, x) = (&simulation.scene().meshes()[0], &simulation.state().x);
    let strain = |e: &drapery_core::mesh::Edge| {
        let [a, b] = e.vertices.map(|v| x[v as usize]);
        (b - a).norm() / mesh.rest_length(*e) - 1.0
    };
    mesh.edges().iter().map(strain).fold(0.0, f64::max)
}

#[test]
fn a_chain_under_load_stops_at_its_limit() {
    // Without the limit the weight of 0.6 m of this cloth, 1.2 N/m, would stretch it by 30 % on average.
    for limit in [0.1, 0.01] {
        let mut simulation = start(hanging(30, limit, 400.0));
        let mut over = 0;
        for frame in 0..24 {
            let summary = run(&mut simulation, 1);
            over += summary.metrics.counted("strain_over_limit");
            assert!(summary.metrics.counted("strain_limit_sweeps") > 0 || frame < 2, "the limit acts");
            let strain = largest_strain(&simulation);
            assert!(strain < limit + 2e-4, "limit {limit}, frame {frame}: strain {strain}");
        }
        assert_eq!(over, 0, "limit {limit}");
    }
}

#[test]
fn long_steps_hold_the_limit_over_sixty_rows_with_the_sweeps_of_a_frame_of_short_ones() {
    let strained = |sweeps: f64| {
        let mut description = hanging(60, 0.05, sweeps);
        description.solver.integrator = Integrator::TrBdf2;
        let mut simulation = start(description);
        let strains = (0..24).map(|_| {
            run(&mut simulation, 1);
            largest_strain(&simulation)
        });
        strains.fold(0.0, f64::max)
    };
    let (held, of_a_short_step) = (strained(100.0), strained(6.0));
    assert!(held < 0.05 + 2e-4, "strain {held}");
    assert!(of_a_short_step > 0.06, "strain {of_a_short_step} with as many sweeps as a short step has");
}

#[test]
fn too_few_sweeps_are_counted_and_not_hidden() {
    let mut simulation = start(hanging(60, 0.01, 1.0));
    let mut over = 0;
    (0..12).for_each(|_| over += run(&mut simulation, 1).metrics.counted("strain_over_limit"));
    assert!(over > 0 && largest_strain(&simulation) > 0.01 + 1e-4, "{over} {}", largest_strain(&simulation));
}

/// A sheet without forces but the limit, thrown apart; masses by vertex in the solver's order.
fn exploding(compression: Option<f64>) -> (Simulation, Vec<f64>) {
    let mut garment = GarmentDescription::new("sheet", sheet(9, 8, 0.03), 0.2);
    let speeds = |(i, p): (usize, &Vec3)| {
        let phase = i as f64;
        p * 8.0 + Vec3::new((0.7 * phase).sin(), (1.3 * phase).cos(), (2.1 * phase).sin())
    };
    garment.start_velocities = Some(garment.mesh.points.iter().enumerate().map(speeds).collect());
    let mut description = scene_of(garment, 240);
    let mut request = EffectRequest::of_garment("strain_limit", 0).with("limit", 0.05).with("sweeps", 1000.0);
    if let Some(compression) = compression {
        request = request.with("compression", compression);
    }
    description.effects.push(request);
    let simulation = start(description);
    let masses = simulation.scene().masses().to_vec();
    (simulation, masses)
}

#[test]
fn the_limit_keeps_momentum_takes_energy_and_gives_none() {
    for compression in [None, Some(0.1)] {
        let (mut simulation, masses) = exploding(compression);
        let momentum = |s: &Simulation| s.state().v.iter().zip(&masses).map(|(v, m)| v * *m).sum::<Vec3>();
        let energy =
            |s: &Simulation| s.state().v.iter().zip(&masses).map(|(v, m)| 0.5 * m * v.norm_squared()).sum::<f64>();
        let (before, mut last) = (momentum(&simulation), energy(&simulation));
        let first = last;
        let scale = (2.0 * first * masses.iter().sum::<f64>()).sqrt();
        for _ in 0..120 {
            run(&mut simulation, 1);
            assert!((momentum(&simulation) - before).norm() < 1e-12 * scale);
            let now = energy(&simulation);
            // Projections onto what is allowed shorten the velocity; their tolerance shows in the fourth digit.
            assert!(now <= last * (1.0 + 1e-3), "energy grew from {last} to {now} J");
            last = now;
            assert!(largest_strain(&simulation) < 0.05 + 1e-3, "{}", largest_strain(&simulation));
        }
        assert!(last < 0.9 * first, "the sheet was stopped");
    }
}

#[test]
fn pinned_vertices_do_not_yield_to_the_limit() {
    let mut description = hanging(10, 0.05, 400.0);
    // The lowest row follows a path that stretches the sheet to the limit and a little beyond.
    description.pins.push(PinDescription {
        garment: 0,
        target: PinTarget::Path {
            anchor: PinAnchor::Start,
            vertices: (50..55).collect(),
            offsets: vec![(0.0, Vec3::zeros()), (0.5, -Vec3::y() * 0.2 * 0.07)],
        },
        axes: [true; 3],
        from: f64::NEG_INFINITY,
        until: f64::INFINITY,
        hold: PinHold::Hard,
    });
    let mut simulation = start(description);
    let places = positions(&simulation);
    run(&mut simulation, 24);
    let x = positions(&simulation);
    assert!((0..5).all(|v| x[v] == places[v]));
    assert!((50..55).all(|v| (x[v] - places[v] + Vec3::y() * 0.014).norm() < 1e-15));
    // All rows share what the pins ask for.
    let strain = largest_strain(&simulation);
    assert!((0.069..0.2).contains(&strain), "{strain}");
}

#[test]
fn cloth_that_starts_far_beyond_its_limit_comes_back_without_being_thrown() {
    let mut garment = GarmentDescription::new("sheet", sheet(6, 6, 0.05), 0.2);
    garment.start = Some(garment.mesh.points.iter().map(|p| p * 1.5).collect());
    let mut description = scene_of(garment, 24);
    description.solver.max_dt = Some(1e-3);
    description.effects.push(EffectRequest::of_garment("strain_limit", 0).with("limit", 0.1).with("sweeps", 500.0));
    let mut simulation = start(description);
    let summary = run(&mut simulation, 4);
    assert!(largest_strain(&simulation) < 0.1 + 1e-3, "{}", largest_strain(&simulation));
    assert!(summary.kinetic_energy < 1e-12, "{} J", summary.kinetic_energy);
}
