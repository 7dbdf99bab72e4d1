//! Times the kernels of a step and prints each as a share of the memory bandwidth that a triad reaches in the same run:
//! `cargo bench -p drapery-core`. Criterion prints its statistics on the way; the table at the end takes the fastest
//! and the median sample of each kernel and the triad measured right before it, with the same threads.
//!
//! # What is counted
//!
//! The least memory traffic of the algorithm, as in the STREAM benchmark: every array that a pass cannot do without
//! counts once where it is read and once where it is written; whatever a write fetches first is not counted, in the
//! triad (`a = b + s c`, 24 bytes) and in the kernels alike. A spring counts once, although one that crosses a part's
//! border is evaluated twice. With V vertices (24-byte vectors, 8-byte masses) and S springs of stretch and bending
//! together:
//!
//! * damping product `q = h M⁻¹ G s`: each spring's c/l² (8) and other end (2); x, s, mass, q: `10 S + 80 V`;
//! * CG iteration: the product, then v, r and s each read and written and q read: `10 S + 248 V`; timed over a solve of
//!   ten iterations, with a tenth of the first residual's product;
//! * elastic update: each spring's k, rest length, c (24) and other end (2) read, c/l² (8) written; x and mass read,
//!   force written: `34 S + 56 V`;
//! * blocks of an implicit step: each spring's k, rest length, c and place (28) read and its block (36) written; x read:
//!   `64 S + 24 V`;
//! * of H hinges: their gradients (64), c (8) and vertices (8) in the product, `80 H + 80 V`; in the update vertices, rest
//!   angle, least heights, five moments and the numbers of four neighbours read, angle and gradient written, `156 H + 56 V`;
//!   for the blocks gradient, stiffness, c and places read and P blocks written, one for each pair of vertices,
//!   `104 H + 36 P`;
//! * body contact: x, v, v½ and x' read: `96 V`. The records of contacts and the bodies are not counted: a vertex in the open
//!   needs neither, nor is anything of it written;
//! * step without contacts: choice of dt (v: `24 V`; springs are looked at only where cloth moves fast); two velocity
//!   solves; x' (x and v½ read, x' written: `72 V`); v' (v½ and v read, v written: `72 V`). A solve is an elastic
//!   update that also reads v (in the second also x', for the middle) and writes v½, a product that writes the first
//!   residual, and its iterations, i in both solves: `88 S + 560 V + i (10 S + 248 V)` in all. Iterations are averaged
//!   over all frames, so where they vary (few vertices) only the median share means something.

use std::cell::RefCell;
use std::hint::black_box;
use std::time::{Duration, Instant};

use criterion::{BenchmarkId, Criterion, Throughput};
use drapery_core::Vec3;
use drapery_core::block_matrix::PartBlocks;
use drapery_core::contact::bodies::Bodies;
use drapery_core::contact::bodies::collision::{BodyCollision, CollisionStep};
use drapery_core::contact::bodies::recovery_speed::RecoverySpeed;
use drapery_core::effects::{BlockFactors, ForceContext, PartView, build_all};
use drapery_core::geometry::shapes::Shape;
use drapery_core::mesh::PolygonMesh;
use drapery_core::metrics::Metrics;
use drapery_core::parallel::for_each_part::{PerPart, PerVertex};
use drapery_core::parallel::parts::{PART_SIZE, Parts};
use drapery_core::parallel::simd4::Simd4;
use drapery_core::pins::PinTargets;
use drapery_core::scene::{
    BodyDescription, BodyShape, EffectRequest, GarmentDescription, PinAnchor, PinDescription, PinHold, PinTarget,
    RigidMotion, Scene, SceneDescription,
};
use drapery_core::simulation::{FrameInput, Sample, Simulation};
use drapery_core::solve::conjugate_gradient::{ConjugateGradient, Stop, System};
use drapery_core::solve::force_evaluation::matrix_of;
use drapery_core::solve::implicit_velocity::{DampingSystem, PartForces, VelocityProblem, by_part};
use drapery_core::volumes::Volumes;
use drapery_core::wind_grid::WindGrid;

/// Doubles in each array of the triad: 128 MiB, far more than any cache.
const TRIAD: usize = 1 << 24;

/// Side of the sheet [m].
const SIDE: f64 = 2.0;

/// Radius of the body under it [m].
const RADIUS: f64 = 0.8;

/// One line of the table.
struct Row {
    kernel: &'static str,
    vertices: usize,
    threads: usize,
    bytes: f64,
    /// Seconds of each sample, and of each triad before them.
    samples: Vec<f64>,
    triads: Vec<f64>,
}

/// A running bench: criterion, the arrays of the triad and the rows so far.
struct Bench {
    criterion: Criterion,
    triad: [Vec<f64>; 3],
    threads: usize,
    rows: Vec<Row>,
}

impl Bench {
    /// Seconds of one triad with the threads of the current pool.
    fn triad(&mut self) -> f64 {
        use rayon::prelude::*;
        const CHUNK: usize = 1 << 16;
        let [a, b, c] = &mut self.triad;
        let start = Instant::now();
        a.par_chunks_mut(CHUNK).zip(b.par_chunks(CHUNK)).zip(c.par_chunks(CHUNK)).for_each(|((a, b), c)| {
            for ((a, b), c) in a.iter_mut().zip(b).zip(c) {
                *a = b + 3.0 * c;
            }
        });
        black_box(&a);
        start.elapsed().as_secs_f64()
    }

    /// Times `work(iterations)`, which returns what they took, and notes its row. `bytes` is asked afterwards.
    fn kernel(
        &mut self,
        kernel: &'static str,
        vertices: usize,
        bytes: impl Fn() -> f64,
        mut work: impl FnMut(u64) -> Duration,
    ) {
        work(1);
        let triads = (0..5).map(|_| self.triad()).collect();
        let samples = RefCell::new(Vec::new());
        let mut group = self.criterion.benchmark_group(kernel);
        group.throughput(Throughput::Bytes(bytes() as u64));
        group.bench_function(BenchmarkId::new(format!("{} threads", self.threads), vertices), |b| {
            b.iter_custom(|iterations| {
                let took = work(iterations);
                samples.borrow_mut().push(took.as_secs_f64() / iterations as f64);
                took
            });
        });
        group.finish();
        let samples = samples.into_inner();
        if samples.is_empty() {
            return; // the command line filters it out
        }
        self.rows.push(Row { kernel, vertices, threads: self.threads, bytes: bytes(), samples, triads });
    }
}

/// Fastest and median.
fn fastest_and_median(seconds: &[f64]) -> (f64, f64) {
    let mut sorted = seconds.to_vec();
    sorted.sort_unstable_by(f64::total_cmp);
    (sorted[0], sorted[sorted.len() / 2])
}

fn print_table(rows: &[Row]) {
    println!("\nkernel, vertices, threads, bytes per vertex, ns per vertex, GB/s, triad GB/s, share fastest (median)");
    for row in rows {
        let (fast, median) = fastest_and_median(&row.samples);
        let (triad_fast, triad_median) = fastest_and_median(&row.triads);
        let triad_bytes = (TRIAD * 3 * size_of::<f64>()) as f64;
        let share = |seconds: f64, triad: f64| 100.0 * (row.bytes / seconds) / (triad_bytes / triad);
        println!(
            "{:<26} {:>8} {:>2} {:>6.0} B {:>8.2} ns {:>7.2} {:>7.2} {:>5.0} % ({:.0} %)",
            row.kernel,
            row.vertices,
            row.threads,
            row.bytes / row.vertices as f64,
            fast * 1e9 / row.vertices as f64,
            row.bytes / fast * 1e-9,
            triad_bytes / triad_fast * 1e-9,
            share(fast, triad_fast),
            share(median, triad_median),
        );
    }
}

/// Repeats `work` and says how long it took.
fn timed(iterations: u64, mut work: impl FnMut()) -> Duration {
    let start = Instant::now();
    (0..iterations).for_each(|_| work());
    start.elapsed()
}

/// A square sheet of `n` by `n` vertices with alternating diagonals.
fn sheet(n: usize) -> PolygonMesh {
    let dx = SIDE / (n - 1) as f64;
    let at = |i: usize, k: usize| (i + n * k) as u32;
    let mut points = Vec::with_capacity(n * n);
    let mut triangles = Vec::with_capacity(2 * n * n);
    for k in 0..n {
        for i in 0..n {
            points.push(Vec3::new(i as f64 * dx - 0.5 * SIDE, 0.0, k as f64 * dx - 0.5 * SIDE));
            if i + 1 < n && k + 1 < n {
                let (a, b, c, d) = (at(i, k), at(i + 1, k), at(i + 1, k + 1), at(i, k + 1));
                triangles.extend(if (i + k) % 2 == 0 { [[a, c, b], [a, d, c]] } else { [[a, d, b], [b, d, c]] });
            }
        }
    }
    PolygonMesh::from_triangles(points, &triangles)
}

/// A sheet with gravity, stretch and bending.
fn description(n: usize) -> SceneDescription {
    let mut description = SceneDescription::new("bench");
    description.garments.push(GarmentDescription::new("sheet", sheet(n), 0.2));
    description.effects.push(EffectRequest::of_scene("gravity"));
    description.effects.push(EffectRequest::of_garment("stretch", 0).with("stiffness", 200.0));
    description.effects.push(EffectRequest::of_garment("bending", 0).with("stiffness", 20.0));
    description
}

fn checked(description: SceneDescription) -> Scene {
    Scene::validate(description).unwrap_or_else(|problems| panic!("{problems}"))
}

/// Number of springs of stretch and bending.
fn spring_count(scene: &Scene) -> f64 {
    scene.meshes().iter().map(|m| m.edges().len() + m.hinges().len()).sum::<usize>() as f64
}

/// Positions [m] with ripples, so that no angle is zero.
fn rippled(x: &[Vec3]) -> Vec<Vec3> {
    x.iter().map(|p| p + Vec3::y() * 0.005 * (60.0 * p.x).sin() * (45.0 * p.z).cos()).collect()
}

/// A smooth field of velocities [m/s] with waves of many lengths.
fn waves(x: &[Vec3]) -> Vec<Vec3> {
    let wave = |p: &Vec3| Vec3::new((9.0 * p.z).sin(), (31.0 * p.x).cos(), (17.0 * (p.x + p.z)).sin());
    x.iter().map(|p| 0.1 * wave(p)).collect()
}

/// Names of the kernels of internal forces, and what each moves: elastic update, blocks, damping product, CG iteration.
type Kernels = [(&'static str, f64); 4];

/// Springs along edges and across hinges.
fn springs(bench: &mut Bench, n: usize) {
    let scene = checked(description(n));
    let (vertices, springs) = (scene.parts().local_count() as f64, spring_count(&scene));
    let kernels = [
        ("elastic update", 34.0 * springs + 56.0 * vertices),
        ("blocks", 64.0 * springs + 24.0 * vertices),
        ("damping product", 10.0 * springs + 80.0 * vertices),
        ("CG iteration", 1.1 * (10.0 * springs + 80.0 * vertices) + 168.0 * vertices),
    ];
    internal_forces(bench, &scene, &kernels);
}

/// Angles between triangles.
fn hinges(bench: &mut Bench, n: usize) {
    let mut description = SceneDescription::new("bench");
    description.garments.push(GarmentDescription::new("sheet", sheet(n), 0.2));
    description.effects.push(EffectRequest::of_garment("dihedral_bending", 0).with("stiffness", 1e-5));
    let scene = checked(description);
    let (vertices, blocks) = (scene.parts().local_count() as f64, spring_count(&scene));
    let hinges = scene.meshes()[0].hinges().len() as f64;
    let kernels = [
        ("elastic update, hinges", 156.0 * hinges + 56.0 * vertices),
        ("blocks, hinges", 104.0 * hinges + 36.0 * blocks),
        ("damping product, hinges", 80.0 * hinges + 80.0 * vertices),
        ("CG iteration, hinges", 1.1 * (80.0 * hinges + 80.0 * vertices) + 168.0 * vertices),
    ];
    internal_forces(bench, &scene, &kernels);
}

/// The kernels of the forces of a scene.
fn internal_forces(bench: &mut Bench, scene: &Scene, kernels: &Kernels) {
    let [(update, update_bytes), (blocks, block_bytes), (product, product_bytes), (iteration, iteration_bytes)] =
        *kernels;
    let (parts, masses) = (scene.parts(), scene.masses());
    let count = parts.local_count();
    let x = rippled(&drapery_core::state::State::at_start(scene).x);
    let (targets, wind) = (PinTargets::default(), WindGrid::default());
    let context = ForceContext { time: 0.0, targets: &targets, v: &[], wind: &wind, volumes: &Volumes::default() };
    let effects = build_all(scene).unwrap_or_else(|problems| panic!("{problems}"));
    let mut forces = by_part(parts, effects.into_iter().flat_map(|(_, effect)| effect.forces));
    let view = |part: usize| {
        let range = parts.ranges()[part].clone();
        PartView { start: range.start, masses: &masses[range], x: &x, fraction: 0.0, context }
    };
    let mut f = vec![Vec3::zeros(); count];
    bench.kernel(
        update,
        count,
        || update_bytes,
        |iterations| {
            timed(iterations, || {
                parts.for_each((PerVertex(&mut f), PerPart(&mut forces)), &|part, (f, forces)| {
                    let mut sums = [Simd4::ZERO; PART_SIZE];
                    let sums = view(part).update(&mut forces.0[0], &mut sums);
                    f.0.iter_mut().zip(sums).for_each(|(f, sum)| *f = (*sum).into());
                });
            })
        },
    );
    assembly(bench, (blocks, block_bytes), (parts, &forces), &view);
    let v = waves(&x);
    let stop = Stop { tolerance: 0.0, max_iterations: 10 };
    let problem = VelocityProblem {
        parts,
        masses,
        effective_masses: None,
        context,
        pins: None,
        contacts: None,
        half_step: 1e-3,
        x: &x,
        fraction: 0.0,
        stop,
        held: &[],
    };
    let system = DampingSystem::new(&problem, &forces);
    bench.kernel(
        product,
        count,
        || product_bytes,
        |iterations| timed(iterations, || parts.for_each(PerVertex(&mut f), &|part, q| system.damping(part, &v, q.0))),
    );
    let mut cg = ConjugateGradient::new(parts);
    let mut solution = v.clone();
    bench.kernel(
        iteration,
        count,
        || iteration_bytes,
        |solves| {
            let mut seconds = 0.0;
            for _ in 0..solves {
                solution.copy_from_slice(&v);
                let start = Instant::now();
                let outcome = cg.solve(parts, masses, &system, &mut solution, stop);
                // The product of the first residual is spread over the iterations.
                seconds += start.elapsed().as_secs_f64() / outcome.iterations as f64;
            }
            Duration::from_secs_f64(seconds)
        },
    );
}

/// The blocks of forces that were updated where `view` has the cloth.
fn assembly<'a>(
    bench: &mut Bench,
    (name, bytes): (&'static str, f64),
    (parts, forces): (&Parts, &PartForces),
    view: &(impl Fn(usize) -> PartView<'a> + Sync),
) {
    let (mut matrix, slots) = matrix_of(parts, forces);
    let factors = BlockFactors { damping: 1e-3, stiffness: 1e-6 };
    let assemble = |part: usize, rows: &mut PartBlocks| {
        rows.clear();
        for (force, slots) in forces[part].iter().zip(slots.of_part(part)) {
            if let Some(force) = force.linearised() {
                force.add_blocks(&view(part), factors, slots, rows);
            }
        }
    };
    bench.kernel(
        name,
        parts.local_count(),
        || bytes,
        |iterations| {
            timed(iterations, || {
                parts.for_each(PerPart(matrix.parts_mut()), &|part, rows| assemble(part, &mut rows.0[0]));
            })
        },
    );
}

/// The sheet laid over a ball, going down at 0.5 m/s: a bit under half of it touches.
fn draped(n: usize) -> (PolygonMesh, Vec3) {
    let mut mesh = sheet(n);
    let edge = 0.9 * RADIUS;
    let (rim, slope) = ((RADIUS * RADIUS - edge * edge).sqrt(), edge / (RADIUS * RADIUS - edge * edge).sqrt());
    for p in &mut mesh.points {
        let rho = p.x.hypot(p.z);
        p.y = 1e-4 + if rho < edge { (RADIUS * RADIUS - rho * rho).sqrt() } else { rim - slope * (rho - edge) };
    }
    (mesh, Vec3::new(0.0, -0.5, 0.0))
}

/// A ball as a triangle surface, at time `t` [s]: it sways by 0.2 m/s.
fn ball(t: f64) -> (Vec<[u32; 3]>, Vec<Vec3>) {
    const RINGS: usize = 100;
    const SECTORS: usize = 200;
    let mut points = vec![Vec3::y() * RADIUS];
    for r in 1..RINGS {
        let (sin, cos) = (std::f64::consts::PI * r as f64 / RINGS as f64).sin_cos();
        points.extend((0..SECTORS).map(|s| {
            let (east, north) = (std::f64::consts::TAU * s as f64 / SECTORS as f64).sin_cos();
            Vec3::new(sin * north, cos, -sin * east) * RADIUS
        }));
    }
    points.push(-Vec3::y() * RADIUS);
    let last = points.len() as u32 - 1;
    let at = |r: usize, s: usize| (1 + (r - 1) * SECTORS + s % SECTORS) as u32;
    let mut triangles = Vec::new();
    for s in 0..SECTORS {
        triangles.push([0, at(1, s), at(1, s + 1)]);
        triangles.push([last, at(RINGS - 1, s + 1), at(RINGS - 1, s)]);
        for r in 1..RINGS - 1 {
            triangles.push([at(r, s), at(r + 1, s), at(r + 1, s + 1)]);
            triangles.push([at(r, s), at(r + 1, s + 1), at(r, s + 1)]);
        }
    }
    points.iter_mut().for_each(|p| p.x += 0.2 * t);
    (triangles, points)
}

/// Body contact against a shape; `animated` takes the ball as a moving surface.
fn contact(bench: &mut Bench, n: usize, animated: bool) {
    let mut description = description(n);
    let (mesh, velocity) = draped(n);
    description.garments[0].start = Some(mesh.points);
    let (triangles, points) = ball(0.0);
    let shape = if animated {
        BodyShape::Surface { triangles, point_count: points.len() }
    } else {
        BodyShape::Rigid(Shape::Sphere { radius: RADIUS })
    };
    let body = BodyDescription { friction: 0.3, ..BodyDescription::new("ball", shape, RigidMotion::at(Vec3::zeros())) };
    description.bodies.push(body);
    description.effects.push(EffectRequest::of_scene("body_collision"));
    let scene = checked(description);
    let samples = if animated { vec![vec![Sample { time: 0.0, positions: points }]] } else { vec![Vec::new()] };
    let mut bodies = Bodies::new(&scene, &samples, 0.0).unwrap_or_else(|problems| panic!("{problems}"));
    if animated {
        bodies.push_sample(0, Sample { time: 0.04, positions: ball(0.04).1 }).expect("the same topology");
    }
    let dt = 1e-3;
    bodies.set_step(0.02, 0.02 + dt);
    let built = build_all(&scene).unwrap_or_else(|problems| panic!("{problems}"));
    let mut collision: BodyCollision =
        built.into_iter().find_map(|(_, effect)| effect.body_collision).expect("the scene has a body");
    let x = drapery_core::state::State::at_start(&scene).x;
    let v = vec![velocity; x.len()];
    let mut x1: Vec<Vec3> = x.iter().zip(&v).map(|(x, v)| x + v * dt).collect();
    let (mut v_star, mut metrics) = (v.clone(), Metrics::default());
    let recovery_speed = RecoverySpeed::new(dt, 1.0, 1.0 / 24.0);
    let step =
        CollisionStep { bodies: &bodies, dt, recovery_speed, x: &x, v: &v, v_half: &v, pinched_in_solves: false };
    let kernel = if animated { "contact, moving surface" } else { "contact, sphere" };
    let bytes = 96.0 * x.len() as f64;
    bench.kernel(
        kernel,
        x.len(),
        || bytes,
        |iterations| timed(iterations, || collision.positions(&step, &mut x1, &mut v_star, &mut metrics)),
    );
}

/// The whole step of a sheet that hangs from two corners.
fn whole_step(bench: &mut Bench, n: usize) {
    let mut description = description(n);
    description.timeline.fps_numerator = 24 * n as u32; // some ten steps at every resolution
    description.pins.push(PinDescription {
        garment: 0,
        target: PinTarget::Path { anchor: PinAnchor::Start, vertices: vec![0, n as u32 - 1], offsets: Vec::new() },
        axes: [true; 3],
        from: f64::NEG_INFINITY,
        until: f64::INFINITY,
        hold: PinHold::Hard,
    });
    description.effects.push(EffectRequest::of_scene("pins"));
    let scene = checked(description);
    let (vertices, springs) = ((n * n) as f64, spring_count(&scene));
    let mut simulation = Simulation::new(scene, &FrameInput::to_frame(0)).unwrap_or_else(|p| panic!("{p}"));
    let counts = RefCell::new((0, 0));
    let bytes = || {
        let (steps, iterations) = *counts.borrow();
        let per_step = iterations as f64 / steps as f64;
        88.0 * springs + 560.0 * vertices + per_step * (10.0 * springs + 248.0 * vertices)
    };
    let mut detail = Metrics::default();
    let work = |frames: u64| {
        let mut seconds = 0.0;
        for _ in 0..frames {
            let input = FrameInput::to_frame(simulation.frame() + 1);
            let summary = simulation.advance(&input).unwrap_or_else(|e| panic!("{e}"));
            let mut counts = counts.borrow_mut();
            *counts = (counts.0 + summary.steps, counts.1 + summary.cg_iterations);
            // What a frame measures at its end is not part of a step.
            seconds += summary.metrics.stages().iter().map(|s| s.seconds).sum::<f64>() / summary.steps as f64;
            detail.add(&summary.metrics);
        }
        Duration::from_secs_f64(seconds)
    };
    bench.kernel("step without contacts", n * n, bytes, work);
    let (steps, iterations) = *counts.borrow();
    println!("{steps} steps, {:.1} CG iterations per step", iterations as f64 / steps as f64);
    for stage in detail.stages() {
        println!("    {:<20} {:>8.2} ms", stage.name, 1e3 * stage.seconds / steps as f64);
    }
}

fn main() {
    let measure = Duration::from_millis(1500);
    let criterion = || {
        let criterion = Criterion::default().sample_size(10).warm_up_time(Duration::from_millis(300));
        criterion.measurement_time(measure).configure_from_args()
    };
    // One run may be limited to some sizes and numbers of threads.
    let list = |name: &str, all: &[usize]| -> Vec<usize> {
        let chosen = std::env::var(name).ok();
        chosen.map_or(all.to_vec(), |list| list.split(',').filter_map(|n| n.trim().parse().ok()).collect())
    };
    let mut rows = Vec::new();
    for threads in list("DRAPERY_BENCH_THREADS", &[1, 2]) {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool of threads");
        pool.install(|| {
            let triad = [vec![0.0; TRIAD], vec![1.0; TRIAD], vec![2.0; TRIAD]];
            let mut bench = Bench { criterion: criterion(), triad, threads, rows: Vec::new() };
            for side in list("DRAPERY_BENCH_SIDES", &[100, 316, 1000]) {
                springs(&mut bench, side);
                hinges(&mut bench, side);
                contact(&mut bench, side, false);
                contact(&mut bench, side, true);
                whole_step(&mut bench, side);
            }
            rows.append(&mut bench.rows);
        });
    }
    print_table(&rows);
}
