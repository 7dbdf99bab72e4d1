//! Cloth against cloth: what starts free of crossings stays free of them, exactly, in every frame.

use drapery_core::geometry::shapes::Shape;
use drapery_core::mesh::PolygonMesh;
use drapery_core::metrics::Metrics;
use drapery_core::scene::{
    BodyShape, EffectRequest, GarmentDescription, Integrator, PinAnchor, PinTarget, RigidMotion, Scene,
    SceneDescription,
};
use drapery_core::simulation::{FrameInput, Simulation};
use drapery_core::snapshot::Values;
use drapery_core::{Vec3, self_intersections};
use drapery_tests::*;

const THICKNESS: f64 = 1e-3;

/// A sheet above another, `gap` apart, that moves with `velocity`; a stack of garments if there are more.
fn sheets(count: usize, cells: usize, dx: f64, gap: f64) -> SceneDescription {
    let mut description = SceneDescription::new("sheets");
    for layer in 0..count {
        let mut mesh = sheet(cells, cells, dx);
        // Turned a little, so that edges do not lie on edges.
        let turn = nalgebra::Rotation3::from_axis_angle(&Vec3::y_axis(), 0.3 * layer as f64);
        mesh.points.iter_mut().for_each(|p| *p = turn * *p + Vec3::new(0.0, gap * layer as f64, 0.0));
        let garment = GarmentDescription::new(&format!("layer{layer}"), mesh, 0.2);
        description.garments.push(GarmentDescription { thickness: THICKNESS, ..garment });
        for effect in ["stretch", "bending"] {
            let request = EffectRequest::of_garment(effect, layer);
            let stiffness = if effect == "stretch" { 4.0 } else { 0.2 };
            description.effects.push(request.with("spring_stiffness", stiffness).with("damping_ratio", 1.0));
        }
    }
    description
}

pub(crate) fn with_contact(mut description: SceneDescription) -> SceneDescription {
    description.effects.push(EffectRequest::of_scene("self_repulsion"));
    description.effects.push(EffectRequest::of_scene("self_collision"));
    description
}

/// Positions of all garments one after the other.
fn all_positions(simulation: &Simulation) -> Vec<Vec3> {
    let mut all = Vec::new();
    for garment in 0..simulation.scene().meshes().len() {
        let mut out = Vec::new();
        simulation.garment_positions(garment, &mut out);
        all.extend(out);
    }
    all
}

/// Crossings among all garments with their vertices where they are written, in single precision.
fn crossings_as_written(simulation: &Simulation) -> usize {
    crossings_as_stored(simulation, |x| f64::from(x as f32))
}

/// Crossings among all garments with every component of their positions as `store` has it.
pub(crate) fn crossings_as_stored(simulation: &Simulation, store: impl Fn(f64) -> f64) -> usize {
    let mut triangles = Vec::new();
    for (garment, mesh) in simulation.scene().meshes().iter().enumerate() {
        let first = simulation.scene().parts().garment(garment).start as u32;
        triangles.extend(mesh.triangles().iter().map(|t| t.map(|v| v + first)));
    }
    let x: Vec<Vec3> = simulation.state().x.iter().map(|p| p.map(&store)).collect();
    self_intersections(&triangles, &x).len()
}

/// Runs frame by frame; nothing may cross in any of them. Returns the counts of all frames.
fn run_free(simulation: &mut Simulation, frames: usize) -> Metrics {
    let mut all = Metrics::default();
    assert_eq!(simulation.crossings(), [], "at the start");
    for _ in 0..frames {
        let summary = run(simulation, 1);
        assert_eq!(simulation.crossings(), [], "frame {}", summary.frame);
        assert_eq!(crossings_as_written(simulation), 0, "as written, frame {}", summary.frame);
        all.add(&summary.metrics);
    }
    all
}

#[test]
fn a_corner_and_an_edge_that_fall_on_a_triangle_never_pass() {
    // Scenes 33 and 34 of the authors: 1.5 m/s from 25 mm, thickness 0.1 m.
    let triangle = [[0.0, 0.0, -0.45], [0.0, 0.0, 0.45], [0.45, 0.0, 0.0]];
    let corner = [[0.225, 0.025, 0.0], [0.4, 0.8, 0.2], [0.4, 0.8, -0.2]];
    let edge = [[-0.45, 0.025, 0.0], [0.45, 0.025, 0.1], [0.0, 0.9, 0.05]];
    for falling in [corner, edge] {
        for effects in [&["self_repulsion"][..], &["self_collision"], &["self_repulsion", "self_collision"]] {
            let mut description = SceneDescription::new("pair");
            for (name, corners) in [("below", triangle), ("above", falling)] {
                let mesh = PolygonMesh::from_triangles(corners.map(Vec3::from).to_vec(), &[[0, 1, 2]]);
                let garment = GarmentDescription { thickness: 0.1, ..GarmentDescription::new(name, mesh, 0.2) };
                description.garments.push(garment);
                let request = EffectRequest::of_garment("stretch", description.garments.len() - 1);
                description.effects.push(request.with("spring_stiffness", 20.0).with("damping_ratio", 1.0));
            }
            description.garments[1].velocity = Vec3::new(0.0, -1.5, 0.0);
            for effect in effects {
                description.effects.push(EffectRequest::of_scene(effect));
            }
            let mut simulation = start(description);
            for frame in 0..24 {
                run(&mut simulation, 1);
                assert_eq!(crossings_as_written(&simulation), 0, "{effects:?}, frame {frame}");
            }
        }
    }
}

#[test]
fn two_sheets_that_hit_at_ten_metres_per_second_never_cross() {
    let mut description = with_contact(sheets(2, 16, 0.02, 0.05));
    description.garments[0].velocity = Vec3::new(0.0, 5.0, 0.0);
    description.garments[1].velocity = Vec3::new(0.0, -5.0, 0.3);
    let mut simulation = start(description);
    let metrics = run_free(&mut simulation, 12);
    assert!(metrics.counted("collision_hits") + metrics.counted("repulsions") > 0, "they meet");
}

#[test]
fn contact_of_free_sheets_keeps_their_momentum_and_adds_no_energy() {
    let mut description = with_contact(sheets(2, 12, 0.02, 0.02));
    description.garments[0].velocity = Vec3::new(1.0, 5.0, 0.0);
    description.garments[1].velocity = Vec3::new(0.0, -5.0, 0.0);
    let mut simulation = start(description);
    let momentum = |s: &Simulation| -> Vec3 { s.scene().masses().iter().zip(&s.state().v).map(|(m, v)| v * *m).sum() };
    let size = |s: &Simulation| -> f64 { s.scene().masses().iter().zip(&s.state().v).map(|(m, v)| m * v.norm()).sum() };
    let (before, scale) = (momentum(&simulation), size(&simulation));
    let mut energy = f64::INFINITY;
    let mut met = 0;
    for frame in 0..12 {
        let summary = run(&mut simulation, 1);
        met += summary.metrics.counted("collision_hits") + summary.metrics.counted("repulsions");
        assert!((momentum(&simulation) - before).norm() <= 1e-12 * scale, "frame {frame}");
        let now = summary.kinetic_energy + summary.potential_energy;
        assert!(now <= 1.001 * energy, "frame {frame}: {now} J after {energy} J");
        energy = now;
    }
    assert!(met > 0, "they meet");
}

/// About `count` triangles with random velocities of up to `speed` [m/s].
fn storm(cells: usize, speed: f64) -> SceneDescription {
    let mut description = with_contact(sheets(1, cells, 0.02, 0.0));
    let points = description.garments[0].mesh.points.len();
    let mut state = 88172645463325252_u64;
    let mut number = || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        2.0 * (state >> 11) as f64 / (1u64 << 53) as f64 - 1.0
    };
    let velocities = (0..points).map(|_| Vec3::new(number(), number(), number()) * speed).collect();
    description.garments[0].start_velocities = Some(velocities);
    description
}

#[test]
fn layers_of_a_rope_keep_a_distance_in_long_steps() {
    let mut description = wrung(24, 1000.0, 1.5, 16);
    description.solver.integrator = Integrator::TrBdf2;
    let mut simulation = start(description);
    let metrics = run_free(&mut simulation, 16);
    // Tens of thousands where pairs push with no more than 4 kPa before their sides meet.
    let hits = metrics.counted("collision_hits");
    assert!(hits < 5000, "{hits}");
    assert!(metrics.counted("repulsions") > 10_000, "layers touch");
    // Where every step with an unsettled pair is retried, none is counted.
    assert!(metrics.counted("layers_unsettled") > 0, "no step is kept with unsettled pairs");
}

#[test]
fn a_storm_of_random_velocities_never_crosses_itself() {
    let mut simulation = start(storm(16, 100.0));
    let metrics = run_free(&mut simulation, 4);
    assert!(metrics.counted("collision_hits") > 100, "{}", metrics.counted("collision_hits"));
}

#[test]
fn self_contact_has_the_same_bits_on_any_number_of_threads() {
    let run_on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool of threads");
        pool.install(|| {
            let mut simulation = start(storm(24, 30.0));
            run(&mut simulation, 2);
            let bits = |x: &Vec3| x.iter().map(|c| c.to_bits()).collect::<Vec<_>>();
            let state = simulation.state();
            state.x.iter().chain(&state.v).flat_map(bits).collect::<Vec<_>>()
        })
    };
    let one = run_on(1);
    for threads in [2, 3, 7] {
        assert!(run_on(threads) == one, "{threads} threads");
    }
}

#[test]
fn a_storm_stays_free_of_crossings_with_each_integrator_and_without_repulsion() {
    for case in ["collisions alone", "one step at a time", "tr_bdf2"] {
        let mut description = storm(10, 20.0);
        description.effects.retain(|e| case != "collisions alone" || e.effect != "self_repulsion");
        if case == "tr_bdf2" {
            description.solver.integrator = Integrator::TrBdf2;
        }
        if case == "one step at a time" {
            let collision = description.effects.last_mut().expect("self_collision is the last");
            *collision = collision.clone().with("max_steps", 1.0);
        }
        run_free(&mut start(description), 6);
    }
}

#[test]
fn what_is_written_in_single_precision_does_not_cross() {
    // 500 m from the origin a position in single precision is 3e-5 m coarse. Repulsions would keep the sheets farther apart.
    let mut description = sheets(3, 10, 0.02, 0.004);
    description.effects.push(EffectRequest::of_scene("self_collision"));
    for (layer, garment) in description.garments.iter_mut().enumerate() {
        garment.mesh.points.iter_mut().for_each(|p| *p += Vec3::new(500.0, 300.0, -400.0));
        garment.velocity = Vec3::new(0.0, 2.0 - 2.0 * layer as f64, 0.0);
    }
    let metrics = run_free(&mut start(description), 12);
    assert!(metrics.counted("collision_hits") > 0, "they collide");
}

#[test]
fn sheets_that_cross_at_the_start_run_never_cross_more_and_come_apart() {
    // The second sheet stands upright through the first.
    let mut description = with_contact(sheets(2, 8, 0.02, 0.0));
    let points = &mut description.garments[1].mesh.points;
    points.iter_mut().for_each(|p| *p = Vec3::new(0.003 + 0.2 * p.y, p.x + 0.004, p.z));
    let mut simulation = start(description);
    let mut crossings = simulation.crossings().len();
    assert!(crossings > 10, "{crossings}");
    for frame in 0..36 {
        let summary = run(&mut simulation, 1);
        let now = simulation.crossings().len();
        assert!(now <= crossings, "frame {frame}: {now} after {crossings}");
        assert_eq!(summary.metrics.counted("crossings"), now as u64);
        crossings = now;
    }
    assert_eq!(crossings, 0, "after 1.5 s");
}

/// A band wound twice through itself along a curve that meets itself, with these rows and columns of vertices pinned.
fn wound_twice(rows: &[u32], columns: &[u32]) -> SceneDescription {
    const CELLS: [usize; 2] = [24, 3];
    let (mesh, length) = (sheet(CELLS[0], CELLS[1], 0.03), 0.03 * CELLS[0] as f64);
    let wound = |p: &Vec3| {
        let share = p.x / length;
        let angle = 2.0 * std::f64::consts::TAU * share;
        let radius = length / (2.0 * std::f64::consts::TAU) + 0.02 * (3.0 * angle).sin() * share;
        Vec3::new(radius * angle.cos(), radius * angle.sin(), p.z)
    };
    let start = Some(mesh.points.iter().map(wound).collect());
    let garment = GarmentDescription { thickness: THICKNESS, start, ..GarmentDescription::new("band", mesh, 0.2) };
    let mut description = with_contact(scene_of(garment, 24));
    description.effects.push(EffectRequest::of_garment("stretch", 0).with("stiffness", 100.0));
    add_gravity(&mut description, [0.0, -9.81, 0.0]);
    let across = CELLS[0] as u32 + 1;
    rows.iter().for_each(|row| add_pins(&mut description, (0..across).map(|i| row * across + i).collect()));
    let last = CELLS[1] as u32;
    columns.iter().for_each(|column| add_pins(&mut description, (0..=last).map(|k| k * across + column).collect()));
    description
}

#[test]
fn a_band_that_starts_wound_through_itself_runs_with_any_of_its_edges_pinned() {
    let pinned: [(&[u32], &[u32]); 3] = [(&[0], &[]), (&[0, 3], &[]), (&[], &[0])];
    for ((rows, columns), integrator) in pinned.into_iter().flat_map(|pins| Integrator::ALL.map(|how| (pins, how))) {
        let mut description = wound_twice(rows, columns);
        description.solver.integrator = integrator;
        let mut simulation = start(description);
        let mut crossings = simulation.crossings().len();
        assert!(crossings > 50, "{crossings}");
        for frame in 0..2 {
            let summary = run(&mut simulation, 1);
            let now = simulation.crossings().len();
            assert!(now <= crossings, "{rows:?} {columns:?}, {integrator:?}, frame {frame}: {now} after {crossings}");
            assert_eq!(summary.metrics.counted("crossings"), now as u64);
            // Pinned nodes alone threw others at 1e16 m/s.
            let fastest = velocities(&simulation).iter().map(Vec3::norm).fold(0.0, f64::max);
            assert!(fastest < 30.0, "{rows:?} {columns:?}, {integrator:?}, frame {frame}: {fastest} m/s");
            crossings = now;
        }
    }
}

#[test]
fn pins_that_pull_cloth_through_what_it_crosses_keep_their_velocity_where_it_cannot_follow() {
    let mut description = with_contact(sheets(2, 8, 0.03, 0.0));
    description.timeline.fps_numerator = 1000;
    // The second sheet stands through the first near its last corner.
    description.garments[1].mesh = sheet(5, 5, 0.03);
    let points = &mut description.garments[1].mesh.points;
    points.iter_mut().for_each(|p| *p = Vec3::new(0.11, p.x + 0.048, p.z + 0.004));
    let corners = [0, description.garments[0].mesh.points.len() - 1];
    let velocities_of_pins = [-1.0, 1.0].map(|sign| sign * Vec3::new(5.0, 5.0, 0.0));
    for (n, (corner, velocity)) in corners.into_iter().zip(velocities_of_pins).enumerate() {
        add_pins(&mut description, vec![corner as u32]);
        let offsets = vec![(0.0, Vec3::zeros()), (1.0, velocity)];
        description.pins[n].target =
            PinTarget::Path { anchor: PinAnchor::Start, vertices: vec![corner as u32], offsets };
    }
    let mut simulation = start(description);
    let before = positions(&simulation);
    let (mut reverted, mut behind) = (0, 0.0_f64);
    for frame in 1..=36 {
        let summary = run(&mut simulation, 1);
        reverted += summary.metrics.counted("crossings_reverted");
        let (x, v) = (positions(&simulation), velocities(&simulation));
        for (corner, velocity) in corners.into_iter().zip(velocities_of_pins) {
            behind = behind.max((x[corner] - before[corner] - 1e-3 * f64::from(frame) * velocity).norm());
            assert!((v[corner] - velocity).norm() < 1e-9, "frame {frame}, vertex {corner}: {} m/s", v[corner]);
        }
    }
    assert!(reverted > 0 && behind > 1e-3, "nothing was in its way");
}

/// Fastest speed at which a vertex this far from where it has to be [m] comes there [m/s]: there in a frame, or edges change in
/// the longest stable step by what a step may change them.
fn fastest_recovery(simulation: &Simulation, distance: f64) -> f64 {
    let frame = 1.0 / 24.0;
    let share = simulation.scene().description().solver.largest_strain_per_step();
    (distance / frame).max(share * simulation.scene().mean_edge() / simulation.elastic_step().min(frame))
}

#[test]
fn cloth_deep_in_a_body_comes_out_without_a_blow_on_the_layer_above_however_short_steps_are() {
    for max_dt in [1e-3, 1e-4, 1e-5] {
        let mut description = with_contact(sheets(2, 5, 0.03, 0.008));
        let ball = BodyShape::Rigid(Shape::Sphere { radius: 0.2 });
        add_body(&mut description, ball, RigidMotion::at(Vec3::new(0.0, -0.21, 0.0)), 0.3);
        description.solver.max_dt = Some(max_dt);
        let mut snapshot = start(description.clone()).snapshot();
        // No scene starts so: both layers are 20 mm lower, the first 10 mm and the second 2 mm deep.
        let values = snapshot.sections.iter_mut().flat_map(|section| &mut section.datasets);
        for data in values.filter(|data| data.name == "positions") {
            let Values::F64(values) = &mut data.values else { panic!("positions are numbers") };
            values.iter_mut().skip(1).step_by(3).for_each(|y| *y -= 0.02);
        }
        let scene = Scene::validate(description).unwrap_or_else(|problems| panic!("{problems}"));
        let restored = Simulation::restore(scene, &FrameInput::to_frame(0), &snapshot);
        let mut simulation = restored.unwrap_or_else(|error| panic!("{error}"));
        let fastest = fastest_recovery(&simulation, 0.01);
        let all = run_free(&mut simulation, 1);
        assert!(all.counted("repulsions") > 0 && all.counted("body_contacts") > 0, "nothing met");
        let speed = simulation.state().v.iter().map(Vec3::norm).fold(0.0, f64::max);
        assert!(speed <= 2.0 * fastest, "steps of {max_dt} s: {speed} m/s, it comes out with {fastest} m/s");
    }
}

#[test]
fn a_pin_draws_its_vertex_from_behind_cloth_without_a_blow() {
    // One sheet flies off from where a pin takes hold of its corner a frame later, and another rises in between.
    let mut description = with_contact(sheets(2, 5, 0.03, 0.0));
    description.garments[0].velocity = Vec3::new(2.4, 0.0, 0.0);
    description.garments[1].mesh = sheet(5, 5, 0.03);
    let points = &mut description.garments[1].mesh.points;
    points.iter_mut().for_each(|p| *p = Vec3::new(0.05, p.x - 0.3, p.z - 0.074));
    description.garments[1].velocity = Vec3::new(0.0, 4.8, 0.0);
    add_pins(&mut description, vec![0]);
    description.pins[0].target = PinTarget::Path { anchor: PinAnchor::Start, vertices: vec![0], offsets: Vec::new() };
    description.pins[0].from = 1.0 / 24.0;
    let mut simulation = start(description);
    let home = positions(&simulation)[0];
    run_free(&mut simulation, 1);
    let away = positions(&simulation)[0] - home;
    assert!((away - Vec3::new(0.1, 0.0, 0.0)).norm() < 1e-6, "no pin yet: {away}");
    let fastest = fastest_recovery(&simulation, away.norm());
    let mut all = Metrics::default();
    for frame in 2..=4 {
        all.add(&run_free(&mut simulation, 1));
        // What is struck by something heavy leaves it with twice its speed, at most, beside its own across.
        let speed = simulation.state().v.iter().map(Vec3::norm).fold(0.0, f64::max);
        assert!(speed <= (2.0 * fastest).hypot(4.8), "frame {frame}: {speed} m/s, the pin pulls with {fastest} m/s");
    }
    assert!(all.counted("pins_behind") > 0 && all.counted("collision_hits") > 0, "nothing was in its way");
    assert_eq!(positions(&simulation)[0], home, "it has arrived");
    for level in ["retried_shorter", "retried_tighter", "retried_thinner", "retried_held"] {
        assert_eq!(all.counted(level), 0, "{level}");
    }
}

#[test]
fn sheets_that_touch_exactly_at_the_start_run() {
    let description = with_contact(sheets(2, 3, 0.02, 0.0));
    let mut simulation = start(description);
    run(&mut simulation, 6);
    assert!(all_positions(&simulation).iter().all(|p| p.iter().all(|c| c.is_finite())));
}

#[test]
fn strange_meshes_run_with_self_contact() {
    let points: Vec<Vec3> = [[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.0, 0.1], [0.0, 0.1, 0.0], [0.05, -0.1, 0.05]]
        .map(Vec3::from)
        .to_vec();
    let one = vec![[0, 1, 2]];
    let twice = vec![[0, 1, 2], [0, 1, 2]];
    let flipped = vec![[0, 1, 2], [0, 2, 1]];
    let three_on_an_edge = vec![[0, 1, 2], [0, 1, 3], [0, 4, 1]];
    for triangles in [one, twice, flipped, three_on_an_edge] {
        let mut mesh = PolygonMesh::from_triangles(points.clone(), &triangles);
        mesh.points.truncate(1 + triangles.concat().into_iter().max().unwrap_or(0) as usize);
        let garment = GarmentDescription { thickness: 5.0, ..GarmentDescription::new("strange", mesh, 0.2) };
        let mut description = with_contact(scene_of(garment, 24));
        add_springs(&mut description, 20.0, 1.0);
        description.garments[0].velocity = Vec3::new(1.0, 2.0, 3.0);
        // Of two faces in one place, one takes no part; everything runs.
        let doubled = triangles.len() == 2;
        let scene = Scene::validate(description).unwrap_or_else(|problems| panic!("{problems}"));
        assert_eq!(scene.warnings().iter().any(|warning| warning.contains("duplicate other faces")), doubled);
        let mut simulation = Simulation::new(scene, &FrameInput::to_frame(0)).unwrap_or_else(|p| panic!("{p}"));
        run(&mut simulation, 3);
        assert!(all_positions(&simulation).iter().all(|p| p.iter().all(|c| c.is_finite())));
    }
}

#[test]
fn a_pair_that_starts_too_close_is_opened_to_the_gap() {
    // Four roundings to single precision of the largest coordinate.
    let gap = 4.0 * f64::from(f32::EPSILON) * 0.8;
    let start_distance = 0.3 * gap;
    // One would pass through in the first frame, the other come closer without meeting.
    for speed in [0.1, 0.5 * start_distance * 24.0] {
        let mut description = SceneDescription::new("close");
        let below = [[0.0, 0.0, -0.45], [0.0, 0.0, 0.45], [0.45, 0.0, 0.0]];
        let above = [[0.225, start_distance, 0.0], [0.4, 0.8, 0.2], [0.4, 0.8, -0.2]];
        for (name, corners) in [("below", below), ("above", above)] {
            let mesh = PolygonMesh::from_triangles(corners.map(Vec3::from).to_vec(), &[[0, 1, 2]]);
            description.garments.push(GarmentDescription::new(name, mesh, 0.2));
        }
        description.garments[1].velocity = Vec3::new(0.0, -speed, 0.0);
        description.effects.push(EffectRequest::of_scene("self_collision"));
        let mut simulation = start(description);
        run(&mut simulation, 1);
        let at = all_positions(&simulation);
        let normal = (at[1] - at[0]).cross(&(at[2] - at[0])).normalize();
        let distance = normal.dot(&(at[3] - at[0])).abs();
        assert!((gap..4.0 * gap).contains(&distance), "{distance} m for a gap of {gap} m");
        assert_eq!(simulation.crossings(), []);
    }
}

#[test]
fn a_thickness_that_is_no_length_is_refused() {
    for thickness in [0.0, -1e-3, f64::NAN, f64::INFINITY] {
        let mut description = with_contact(sheets(2, 2, 0.02, 0.05));
        description.garments[1].thickness = thickness;
        let problems = Scene::validate(description).map(drop).expect_err("a problem");
        assert_eq!(problems.0.len(), 1);
        assert!(problems.to_string().contains("garment \"layer1\": `thickness` = "), "{problems}");
    }
}

#[test]
fn what_is_not_asked_for_neither_runs_nor_is_counted() {
    let counts_of = |effects: &[&str]| -> Vec<String> {
        let mut description = sheets(2, 6, 0.02, 0.004);
        description.garments[1].velocity = Vec3::new(0.0, -2.0, 0.0);
        effects.iter().for_each(|effect| description.effects.push(EffectRequest::of_scene(effect)));
        let mut simulation = start(description);
        let summary = run(&mut simulation, 2);
        assert_eq!(simulation.plan().iter().filter(|e| e.name.starts_with("self_")).count(), effects.len());
        let stages = summary.metrics.stages().iter().map(|s| s.name.to_string());
        stages.chain(summary.metrics.counts().iter().map(|(name, _)| name.to_string())).collect()
    };
    let none = counts_of(&[]);
    let of_solve = |name: &String| name.starts_with("B.") || name.starts_with("cg_") || name == "dt";
    assert!(none.iter().all(of_solve), "{none:?}");
    let has = |names: &[String], wanted: &str| names.iter().any(|name| name == wanted);
    let collision = counts_of(&["self_collision"]);
    assert!(has(&collision, "collision_steps") && has(&collision, "collision_hits"), "{collision:?}");
    let of_repulsion = ["repulsions", "attractions", "inverted_pairs", "B.2 self-repulsion", "B.8 self-repulsion"];
    assert!(!of_repulsion.iter().any(|name| has(&collision, name)), "{collision:?}");
    let repulsion = counts_of(&["self_repulsion"]);
    assert!(has(&repulsion, "repulsions"), "{repulsion:?}");
    assert!(!repulsion.iter().any(|name| name.starts_with("collision_h") || name.starts_with("C ")), "{repulsion:?}");
}

#[test]
fn pinned_cloth_is_not_moved_by_what_falls_on_it() {
    let mut description = with_contact(sheets(2, 8, 0.02, 0.03));
    add_gravity(&mut description, [0.0, -9.81, 0.0]);
    let vertices: Vec<u32> = (0..description.garments[0].mesh.points.len() as u32).collect();
    add_pins(&mut description, vertices);
    let mut simulation = start(description);
    let before = positions(&simulation);
    run_free(&mut simulation, 24);
    assert_eq!(positions(&simulation), before);
    let above = &all_positions(&simulation)[before.len()..];
    assert!(above.iter().any(|p| p.y > 0.0 && p.y < 5.0 * THICKNESS), "the other lies on it");
}
