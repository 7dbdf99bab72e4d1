//! Hanging chains and catenaries: where damped springs come to rest.

use drapery_core::Vec3;
use drapery_core::mesh::PolygonMesh;
use drapery_core::scene::{GarmentDescription, Mass};
use drapery_core::simulation::Simulation;
use drapery_tests::*;

/// A ribbon one cell wide whose two rails are chains of springs; masses are uniform, `mass` for each pair of vertices.
fn ribbon(cells: usize, dx: f64, mass: f64) -> GarmentDescription {
    let mesh: PolygonMesh = sheet(cells, 1, dx);
    let mut garment = GarmentDescription::new("ribbon", mesh, 1.0);
    garment.mass = Mass::UniformTotal(mass * (cells + 1) as f64);
    garment
}

fn settle(simulation: &mut Simulation, frames: usize) {
    run(simulation, frames);
    let fastest = velocities(simulation).iter().map(Vec3::norm).fold(0.0, f64::max);
    assert!(fastest < 1e-5, "still moving at {fastest} m/s");
}

#[test]
fn a_hanging_chain_stretches_as_hooke_says() {
    let Some(truths) = truths() else { return };
    for case in truths["hanging_spring_chain"]["examples"].as_array().unwrap() {
        let [n, m, k] = ["N", "m", "k"].map(|key| case[key].as_f64().unwrap());
        // A garment is made of triangles, so the chain is a ribbon whose rows move vertically only; its diagonals share the load
        // with the rails. What the closed form fixes is the tension across each gap: k times the tabulated elongation.
        let cells = n as usize;
        let mut garment = ribbon(cells, 0.1, m);
        let turn = nalgebra::Rotation3::from_axis_angle(&Vec3::z_axis(), -std::f64::consts::FRAC_PI_2);
        garment.mesh.points.iter_mut().for_each(|p| *p = turn * *p);
        let mut description = scene_of(garment, 30);
        add_gravity(&mut description, [0.0, -9.81, 0.0]);
        add_springs(&mut description, k * 0.1 / 2.0, 1.0);
        description.solver.cg_tolerance = Some(1e-8);
        let (top, rows) = (vec![0, cells as u32 + 1], cells as u32 + 1);
        add_pins(&mut description, top.clone());
        add_pins(&mut description, (0..2 * rows).filter(|v| !top.contains(v)).collect());
        description.pins[1].axes = [true, false, true];
        let mut simulation = start(description);
        settle(&mut simulation, 1200);
        // Tension across each gap, from the positions and the spring law, against the weight below it.
        let (scene, x) = (simulation.scene(), &simulation.state().x);
        let mesh = &scene.meshes()[0];
        for gap in 0..cells {
            let column = |v: u32| scene.parts().own_vertex(v as usize).1 as usize % (cells + 1);
            let tension: f64 = mesh
                .edges()
                .iter()
                .filter(|e| {
                    column(e.vertices[0]).min(column(e.vertices[1])) == gap
                        && column(e.vertices[0]) != column(e.vertices[1])
                })
                .map(|e| {
                    let [a, b] = e.vertices.map(|v| x[v as usize]);
                    let (u, rest) = (b - a, mesh.rest_length(*e));
                    (k * 0.1 / 2.0 / rest) * (u.norm() - rest) * (u.y / u.norm()).abs()
                })
                .sum();
            let weight = k * case["elongations"][gap].as_f64().unwrap();
            assert!((tension / weight - 1.0).abs() < 1e-5, "gap {gap} of {cells}: {tension} N for {weight} N");
        }
    }
}

#[test]
fn a_slack_ribbon_hangs_in_a_catenary() {
    let Some(truths) = truths() else { return };
    for case in truths["catenary"]["table"].as_array().unwrap().iter().take(4) {
        let [ratio, sag] = ["length_over_span", "sag_over_span"].map(|key| case[key].as_f64().unwrap());
        let (cells, span) = (60, 1.0);
        let garment_dx = ratio * span / cells as f64;
        let mut garment = ribbon(cells, garment_dx, 1e-3);
        // A start of the right length between the supports: the ribbon folded into a shallow zigzag about the final curve.
        let a = solve_catenary(ratio);
        let place = |p: &Vec3| {
            let x = a * (p.x / a).asinh();
            Vec3::new(x, a * (x / a).cosh() - a * (0.5 / a).cosh(), p.z)
        };
        garment.start = Some(garment.mesh.points.iter().map(place).collect());
        let mut description = scene_of(garment, 30);
        add_gravity(&mut description, [0.0, -9.81, 0.0]);
        // Stiff enough to stretch by less than 3e-5 under its weight of 0.6 N.
        add_springs(&mut description, 3e4, 1.0);
        let last = cells as u32;
        add_pins(&mut description, vec![0, last, last + 1, 2 * last + 1]);
        let mut simulation = start(description);
        run(&mut simulation, 60);
        let x = positions(&simulation);
        let lowest = x.iter().map(|p| p.y).fold(0.0, f64::min);
        let top = x[0].y;
        assert!(((top - lowest) / (sag * span) - 1.0).abs() < 0.01, "ratio {ratio}: sag {} for {sag}", top - lowest);
    }
}

/// a of `2 a sinh(1/(2a)) = ratio`, by bisection.
fn solve_catenary(ratio: f64) -> f64 {
    let (mut low, mut high) = (0.05, 100.0);
    for _ in 0..200 {
        let a = 0.5 * (low + high);
        if 2.0 * a * (0.5_f64 / a).sinh() > ratio { low = a } else { high = a }
    }
    0.5 * (low + high)
}

/// A triangle that falls from its places into springs of 10 rad/s, critically damped, that break at a share of its weight.
fn hung_until(share: f64) -> drapery_core::simulation::Simulation {
    let points = vec![Vec3::zeros(), Vec3::z() * 0.1, Vec3::x() * 0.1];
    let mesh = drapery_core::mesh::PolygonMesh::from_triangles(points, &[[0, 1, 2]]);
    let mass = 0.2 * 0.005 / 3.0;
    let mut description = scene_of(GarmentDescription::new("triangle", mesh, 0.2), 100);
    description.solver.max_dt = Some(1e-3);
    add_gravity(&mut description, [0.0, -9.81, 0.0]);
    add_pins(&mut description, vec![0, 1, 2]);
    let break_force = Some(share * mass * 9.81);
    description.pins[0].hold =
        drapery_core::scene::PinHold::Spring { stiffness: 100.0 * mass, damping_ratio: 1.0, break_force };
    description.effects[1] = drapery_core::scene::EffectRequest::of_scene("attachments");
    start(description)
}

#[test]
fn an_attachment_holds_less_than_its_breaking_force_and_lets_go_for_good_at_more() {
    let mut held = hung_until(1.01);
    assert!(run(&mut held, 300).broken.is_empty());
    assert!((positions(&held)[0].y + 9.81 / 100.0).abs() < 1e-6, "it hangs where the spring carries it");
    // (1 + ωt) e^(-ωt) = 0.2 at ωt = 2.994: in the 30th hundredth of a second.
    let mut loose = hung_until(0.8);
    assert!(run(&mut loose, 29).broken.is_empty());
    let summary = run(&mut loose, 1);
    let vertices: Vec<u32> = summary.broken.iter().map(|broken| broken.vertex).collect();
    assert_eq!((vertices.as_slice(), summary.metrics.counted("attachments_broken")), (&[0, 1, 2][..], 3));
    assert_eq!(summary.broken[0].garment, "triangle");
    let before = velocities(&loose)[0].y;
    assert!(run(&mut loose, 10).broken.is_empty());
    assert!((velocities(&loose)[0].y - before + 0.981).abs() < 1e-9, "it falls freely");
}
