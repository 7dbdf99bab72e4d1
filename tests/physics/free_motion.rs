//! Motion without springs or contact, and conservation with them.

use drapery_core::Vec3;
use drapery_core::scene::GarmentDescription;
use drapery_tests::*;

#[test]
fn free_flight_is_exact_at_any_step() {
    for max_dt in [None, Some(0.013), Some(1e-3)] {
        let mut garment = GarmentDescription::new("sheet", sheet(3, 2, 0.1), 0.2);
        garment.velocity = Vec3::new(3.0, 5.0, -1.0);
        let mut description = scene_of(garment, 24);
        description.solver.max_dt = max_dt;
        add_gravity(&mut description, [0.0, -9.81, 0.0]);
        let mut simulation = start(description);
        let before = positions(&simulation);
        run(&mut simulation, 24);
        let fallen = Vec3::new(3.0, 5.0 - 0.5 * 9.81, -1.0);
        for (x, x0) in positions(&simulation).iter().zip(&before) {
            // Rounding of 1000 steps of metre-sized numbers.
            assert!((x - x0 - fallen).norm() < 1e-12, "{:?}", x - x0 - fallen);
        }
        assert!(velocities(&simulation).iter().all(|v| (v - Vec3::new(3.0, 5.0 - 9.81, -1.0)).norm() < 1e-12));
    }
}

#[test]
fn springs_keep_momentum_and_angular_momentum_and_never_add_energy() {
    let mut mesh = sheet(8, 6, 0.05);
    // A crumpled start sets everything moving.
    for (i, p) in mesh.points.iter_mut().enumerate() {
        *p += Vec3::new((i as f64 * 0.7).sin(), (i as f64 * 1.3).cos(), (i as f64 * 2.1).sin()) * 0.01;
    }
    let start_points = mesh.points.clone();
    let mut garment = GarmentDescription::new("sheet", sheet(8, 6, 0.05), 0.2);
    garment.start = Some(start_points);
    let mut description = scene_of(garment, 100);
    description.solver.cfl = 1.0;
    description.solver.cg_tolerance = Some(1e-13);
    add_springs(&mut description, 50.0, 0.2);
    let mut simulation = start(description);
    let mut masses = vec![0.0; simulation.state().x.len()];
    for (solver, mass) in simulation.scene().masses().iter().enumerate() {
        masses[simulation.scene().parts().own_vertex(solver).1 as usize] = *mass;
    }
    let moments = |s: &drapery_core::simulation::Simulation| {
        let (x, v) = (positions(s), velocities(s));
        let linear: Vec3 = v.iter().zip(&masses).map(|(v, m)| v * *m).sum();
        let angular: Vec3 = x.iter().zip(&v).zip(&masses).map(|((x, v), m)| x.cross(v) * *m).sum();
        (linear, angular)
    };
    let first = run(&mut simulation, 1);
    let mut energy = first.kinetic_energy + first.potential_energy;
    let scale = (2.0 * energy * masses.iter().sum::<f64>()).sqrt();
    for _ in 0..50 {
        let summary = run(&mut simulation, 1);
        let now = summary.kinetic_energy + summary.potential_energy;
        // The elastic part is explicit: energy swings by the square of the step's phase but must not grow.
        assert!(now <= energy * 1.0005, "energy grew from {energy} to {now} J");
        energy = now.min(energy);
        let (linear, angular) = moments(&simulation);
        assert!(linear.norm() < 1e-12 * scale, "{linear:?}");
        // Forces act at the middle of the step's straight line: angular momentum is kept to the order of the scheme.
        assert!(angular.norm() < 1e-4 * scale, "{angular:?}");
    }
}
