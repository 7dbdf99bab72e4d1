//! Membranes against the elasticity of orthotropic sheets.

use drapery_core::Vec3;
use drapery_core::mesh::PolygonMesh;
use drapery_core::scene::{EffectRequest, GarmentDescription, PinHold, PinTarget, SceneDescription};
use drapery_core::simulation::Simulation;
use drapery_tests::*;

/// Cells of the sheets along x and z, and the length of a cell [m].
const CELLS: [usize; 2] = [7, 5];
const CELL: f64 = 0.1;

/// Stiffness along the warp and the weft and in shear [N/m], and Poisson's ratio: five times stiffer one way, as denim is.
const DENIM: [f64; 3] = [200.0, 1000.0, 60.0];
const POISSON: f64 = 0.25;

/// A flat sheet whose inner vertices stand irregularly.
fn irregular() -> PolygonMesh {
    let mut mesh = sheet(CELLS[0], CELLS[1], CELL);
    for inner in inner_vertices() {
        let phase = inner as f64;
        mesh.points[inner] += Vec3::new((7.0 * phase).sin(), 0.0, (5.0 * phase).cos()) * 0.25 * CELL;
    }
    mesh
}

fn at(vertex: usize) -> [usize; 2] {
    [vertex % (CELLS[0] + 1), vertex / (CELLS[0] + 1)]
}

fn inner_vertices() -> Vec<usize> {
    let inside = |vertex: &usize| (0..2).all(|axis| at(*vertex)[axis] > 0 && at(*vertex)[axis] < CELLS[axis]);
    (0..(CELLS[0] + 1) * (CELLS[1] + 1)).filter(inside).collect()
}

/// The sheet as a membrane of denim with its warp at `angle` [rad] from the x axis towards the z axis.
fn membrane(angle: f64) -> SceneDescription {
    let mut description = scene_of(GarmentDescription::new("sheet", irregular(), 0.2), 50);
    description.solver.cg_tolerance = Some(1e-10);
    description.effects.push(denim(angle).with("damping_ratio", 3.0));
    description
}

fn denim(angle: f64) -> EffectRequest {
    let request = EffectRequest::of_garment("membrane", 0).with("warp", DENIM[0]).with("weft", DENIM[1]);
    let request = request.with("shear", DENIM[2]).with("poisson", POISSON).with("thin_triangles", 0.0);
    request.with_vector("grain", [angle.cos(), 0.0, angle.sin()])
}

fn settled(mut description: SceneDescription, frames: usize) -> (Simulation, f64) {
    description.solver.max_dt = None;
    let mut simulation = start(description);
    let summary = run(&mut simulation, frames);
    let fastest = velocities(&simulation).iter().map(Vec3::norm).fold(0.0, f64::max);
    assert!(fastest < 1e-8, "still moving at {fastest} m/s");
    (simulation, summary.potential_energy)
}

#[test]
fn a_strip_that_springs_pull_carries_its_modulus_times_its_strain_in_every_element() {
    let (strain, pull) = (0.05, 400.0);
    let [length, width] = CELLS.map(|cells| cells as f64 * CELL);
    for (along, angle) in [(0, 0.0), (1, std::f64::consts::FRAC_PI_2)] {
        let (stiffness, other) = (DENIM[along], DENIM[1 - along]);
        let narrowing = POISSON * (stiffness / other).sqrt() * strain;
        let mut description = membrane(angle);
        let place = |p: &Vec3| Vec3::new((p.x + 0.5 * length) * (1.0 + strain), 0.0, p.z * (1.0 - narrowing));
        let points = description.garments[0].mesh.points.clone();
        let expected: Vec<Vec3> = points.iter().map(place).collect();
        description.garments[0].mesh.points.iter_mut().for_each(|p| p.x += 0.5 * length);
        let column = |i: usize| move |vertex: &usize| at(*vertex)[0] == i;
        let all = 0..points.len();
        add_pins(&mut description, all.clone().filter(column(0)).map(|v| v as u32).collect());
        description.pins[0].axes = [true, false, false];
        // The springs carry the tension of the strip, each that of its share of the width.
        let beyond = stiffness * width * strain / pull;
        for corner in [true, false] {
            let is_corner = |vertex: &usize| (at(*vertex)[1].is_multiple_of(CELLS[1])) == corner;
            let vertices = all.clone().filter(column(CELLS[0])).filter(is_corner);
            for vertex in vertices {
                add_pins(&mut description, vec![vertex as u32]);
                let Some(pin) = description.pins.last_mut() else { continue };
                let share = if corner { 0.5 } else { 1.0 } / CELLS[1] as f64;
                pin.hold = PinHold::Spring { stiffness: pull * share, damping_ratio: 1.0, break_force: None };
                let target = expected[vertex] + Vec3::x() * beyond;
                let offset = target - description.garments[0].mesh.points[vertex];
                if let PinTarget::Path { offsets, .. } = &mut pin.target {
                    offsets.push((0.0, offset));
                }
            }
        }
        description.effects.push(EffectRequest::of_scene("attachments"));
        let (simulation, _) = settled(description, 1000);
        for (x, expected) in positions(&simulation).iter().zip(&expected) {
            assert!((x - expected).norm() < 1e-7, "warp at {angle}: {x:?} for {expected:?}");
        }
    }
}

#[test]
fn a_sheet_pulled_at_any_angle_to_its_warp_has_the_stiffness_of_an_orthotropic_sheet() {
    let area = CELLS.iter().map(|cells| *cells as f64 * CELL).product::<f64>();
    for angle in [0.0, 0.4, std::f64::consts::FRAC_PI_4, 1.2] {
        // Stress of 1 N/m along x in the axes of the cloth, and the strain that it makes there.
        let (c, s) = (angle.cos(), angle.sin());
        let stress = [c * c, s * s, -c * s];
        let across = -POISSON / (DENIM[0] * DENIM[1]).sqrt();
        let strain = [
            stress[0] / DENIM[0] + across * stress[1],
            across * stress[0] + stress[1] / DENIM[1],
            stress[2] / DENIM[2],
        ];
        let compliance: f64 = (0..3).map(|k| stress[k] * strain[k]).sum();
        // Pulled by 4 %: back in the axes x and z.
        let [warp, weft, half] = [strain[0], strain[1], 0.5 * strain[2]].map(|e| 0.04 / compliance * e);
        let xx = c * c * warp + s * s * weft - 2.0 * c * s * half;
        let zz = s * s * warp + c * c * weft + 2.0 * c * s * half;
        let xz = c * s * (warp - weft) + (c * c - s * s) * half;
        assert!((xx - 0.04).abs() < 1e-15);
        let mut description = membrane(angle);
        let place = |p: &Vec3| Vec3::new(p.x * (1.0 + xx) + p.z * xz, 0.0, p.x * xz + p.z * (1.0 + zz));
        let inner = inner_vertices();
        let points = description.garments[0].mesh.points.clone();
        let expected: Vec<Vec3> = points.iter().map(place).collect();
        let start = |(vertex, p): (usize, &Vec3)| if inner.contains(&vertex) { points[vertex] } else { *p };
        description.garments[0].start = Some(expected.iter().enumerate().map(start).collect());
        add_pins(&mut description, (0..points.len()).filter(|v| !inner.contains(v)).map(|v| v as u32).collect());
        let (simulation, energy) = settled(description, 400);
        // Only the edge is held: inside, a constant strain is the rest.
        for (x, expected) in positions(&simulation).iter().zip(&expected) {
            assert!((x - expected).norm() < 1e-9, "warp at {angle}: {x:?} for {expected:?}");
        }
        let theory = 0.5 * 0.04 * 0.04 / compliance * area;
        assert!((energy / theory - 1.0).abs() < 1e-9, "warp at {angle}: {energy} J for {theory} J");
    }
}

#[test]
fn a_crumpled_membrane_keeps_its_momentum_and_never_gains_energy() {
    let mut garment = GarmentDescription::new("sheet", irregular(), 0.2);
    let crumpled = |(i, p): (usize, &Vec3)| {
        let phase = i as f64;
        p + Vec3::new((0.7 * phase).sin(), (1.3 * phase).cos(), (2.1 * phase).sin()) * 0.2 * CELL
    };
    garment.start = Some(garment.mesh.points.iter().enumerate().map(crumpled).collect());
    let mut description = scene_of(garment, 100);
    description.solver.cfl = 1.0;
    description.solver.cg_tolerance = Some(1e-13);
    description.effects.push(denim(0.3).with("damping_ratio", 0.2));
    let mut simulation = start(description);
    let mut masses = vec![0.0; simulation.state().x.len()];
    for (solver, mass) in simulation.scene().masses().iter().enumerate() {
        masses[simulation.scene().parts().own_vertex(solver).1 as usize] = *mass;
    }
    let first = run(&mut simulation, 1);
    let mut energy = first.kinetic_energy + first.potential_energy;
    let scale = (2.0 * energy * masses.iter().sum::<f64>()).sqrt();
    for _ in 0..50 {
        let summary = run(&mut simulation, 1);
        let now = summary.kinetic_energy + summary.potential_energy;
        assert!(now <= energy * 1.0005, "energy grew from {energy} to {now} J");
        energy = now.min(energy);
        let (x, v) = (positions(&simulation), velocities(&simulation));
        let linear: Vec3 = v.iter().zip(&masses).map(|(v, m)| v * *m).sum();
        let angular: Vec3 = x.iter().zip(&v).zip(&masses).map(|((x, v), m)| x.cross(v) * *m).sum();
        assert!(linear.norm() < 1e-12 * scale, "{linear:?}");
        // Forces act at the middle of the step's straight line: angular momentum is kept to the order of the scheme.
        assert!(angular.norm() < 1e-4 * scale, "{angular:?}");
    }
}

#[test]
fn an_undamped_membrane_of_any_stiffness_is_stable_at_the_step_that_is_chosen_for_it() {
    // Foil is 1.8e6 N/m; a thousand times that still has to take its steps.
    for stiffness in [1e2, 1e6, 2e9_f64] {
        let mut garment = GarmentDescription::new("sheet", irregular(), 0.2);
        let shaken = |(i, p): (usize, &Vec3)| {
            let phase = i as f64;
            // As much energy at every stiffness: 1e-3 of an edge in the softest.
            p + Vec3::new((3.0 * phase).sin(), 0.0, (5.0 * phase).cos()) * (1e-3 * CELL * (1e2 / stiffness).sqrt())
        };
        garment.start = Some(garment.mesh.points.iter().enumerate().map(shaken).collect());
        let mut description = scene_of(garment, 24);
        let request = EffectRequest::of_garment("membrane", 0).with("warp", stiffness).with("damping_ratio", 0.0);
        description.effects.push(request);
        let probe = start(description.clone()).elastic_step();
        // The same number of steps at every stiffness.
        description.timeline.fps_numerator = (1.0 / (500.0 * probe)) as u32 + 1;
        let mut simulation = start(description);
        let mut largest = 0.0_f64;
        let first = run(&mut simulation, 1);
        let energy = first.kinetic_energy + first.potential_energy;
        assert!(first.steps >= 250, "{} steps", first.steps);
        for _ in 0..5 {
            let summary = run(&mut simulation, 1);
            largest = largest.max(summary.kinetic_energy + summary.potential_energy);
        }
        // The energy of a step's scheme swings by its phase, but a step too long would double it in a few.
        assert!(largest < 2.0 * energy, "{stiffness} N/m: from {energy} to {largest} J");
    }
}
