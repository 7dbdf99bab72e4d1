//! Iterations and times of the linear solver of long steps on folded cloth that hangs from a row of pins, one thread:
//! `cargo bench -p drapery-core --bench linear_solver`.
//!
//! A = M + h D + h² K of springs along the edges and of hinges, h = 0.293 dt, damping critical for each element alone; the
//! right-hand side is the impulse of gravity and of waves of one per cent strain; tolerance min(1 cm/s, g dt/10). The first table
//! has nanoseconds a vertex of what an iteration consists of, and of one without the preconditioner: conjugate gradients that are
//! written here, over the same blocks. The second one has iterations and milliseconds of solves. `-- iteration` measures an
//! iteration without the preconditioner alone.

use std::hint::black_box;
use std::time::Instant;

use drapery_core::Vec3;
use drapery_core::block_matrix::{BlockMatrix, Slot};
use drapery_core::mesh::{PolygonMesh, TriangleMesh};
use drapery_core::parallel::for_each_part::{PerPart, PerVertex};
use drapery_core::parallel::simd4::Simd4;
use drapery_core::scene::{EffectRequest, GarmentDescription, Scene, SceneDescription};
use drapery_core::solve::conjugate_gradient::{Outcome, Stop};
use drapery_core::solve::preconditioned_cg::{BlockSystem, PreconditionedCg, Projection};

/// Frames a second.
const FPS: f64 = 24.0;

/// Implicit coefficient h / dt of both stages of the integrator.
const STAGE: f64 = 0.293;

/// Mass by area [kg/m²].
const DENSITY: f64 = 0.2;

/// Bending rigidity [N m].
const BENDING: f64 = 1e-5;

/// A piece of cloth with its elements.
struct Cloth {
    scene: Scene,
    x: Vec<Vec3>,
    /// Vertices that are held.
    held: Vec<bool>,
    springs: Vec<Spring>,
    hinges: Vec<Hinge>,
    /// Springs and hinges that touch each part, with the places of their blocks.
    of_parts: Vec<OfPart>,
}

struct Spring {
    ends: [u32; 2],
    /// Stiffness relative to the stiffness of the membrane [1].
    stiffness: f64,
    direction: Vec3,
}

struct Hinge {
    corners: [u32; 4],
    gradients: [Vec3; 4],
    /// [N m].
    stiffness: f64,
}

#[derive(Default)]
struct OfPart {
    springs: Vec<(u32, Option<Slot>)>,
    hinges: Vec<(u32, Option<[Slot; 6]>)>,
}

/// A square sheet of a metre with `n` by `n` vertices and alternating diagonals.
fn sheet(n: usize) -> PolygonMesh {
    grid(n, n, false, |u, w| Vec3::new(u, -w, 0.0))
}

/// A flared tube like a skirt, 0.6 m long, with `n` vertices around it.
fn skirt(n: usize) -> PolygonMesh {
    grid(n, n / 2, true, |u, w| {
        let (radius, angle) = (0.12 + 0.2 * w, u * std::f64::consts::TAU);
        Vec3::new(radius * angle.cos(), -0.6 * w, radius * angle.sin())
    })
}

/// A grid of triangles, `at` from 0 to 1 in both directions, closed along the first if asked for.
fn grid(n: usize, rows: usize, closed: bool, at: impl Fn(f64, f64) -> Vec3) -> PolygonMesh {
    let columns = if closed { n } else { n - 1 };
    let mut points = Vec::new();
    for k in 0..rows {
        points.extend((0..n).map(|i| at(i as f64 / columns as f64, k as f64 / (rows - 1) as f64)));
    }
    let mut triangles = Vec::new();
    for k in 0..rows - 1 {
        for i in 0..columns {
            let at = |i: usize, k: usize| (i % n + n * k) as u32;
            let (a, b, c, d) = (at(i, k), at(i + 1, k), at(i + 1, k + 1), at(i, k + 1));
            triangles.extend(if (i + k) % 2 == 0 { [[a, c, b], [a, d, c]] } else { [[a, d, b], [b, d, c]] });
        }
    }
    PolygonMesh::from_triangles(points, &triangles)
}

impl Cloth {
    fn new(mesh: PolygonMesh) -> Self {
        let mut description = SceneDescription::new("bench");
        description.garments.push(GarmentDescription::new("cloth", mesh, DENSITY));
        description.effects.push(EffectRequest::of_garment("stretch", 0).with("stiffness", 100.0));
        let scene = Scene::validate(description).unwrap_or_else(|problems| panic!("{problems}"));
        let mesh = &scene.meshes()[0];
        let top = mesh.rest_positions().iter().map(|x| x.y).fold(f64::MIN, f64::max);
        let held = mesh.rest_positions().iter().map(|x| x.y > top - 1e-6).collect();
        let x = folded(mesh);
        let springs = springs(mesh, &x);
        let hinges = hinges(mesh, &x);
        let mut of_parts: Vec<OfPart> = (0..scene.parts().count()).map(|_| OfPart::default()).collect();
        let parts_of = |vertices: &[u32]| {
            let mut parts: Vec<usize> = vertices.iter().map(|v| scene.parts().part_of(*v as usize)).collect();
            parts.sort_unstable();
            parts.dedup();
            parts
        };
        for (number, spring) in (0_u32..).zip(&springs) {
            parts_of(&spring.ends).into_iter().for_each(|part| of_parts[part].springs.push((number, None)));
        }
        for (number, hinge) in (0_u32..).zip(&hinges) {
            parts_of(&hinge.corners).into_iter().for_each(|part| of_parts[part].hinges.push((number, None)));
        }
        Self { x, held, springs, hinges, of_parts, scene }
    }

    /// A matrix for the elements, which learn the places of their blocks.
    fn matrix(&mut self) -> BlockMatrix {
        let Self { scene, springs, hinges, of_parts, .. } = self;
        let mut matrix = BlockMatrix::new(scene.parts(), &|part, visit| {
            of_parts[part].springs.iter().for_each(|(spring, _)| visit(&springs[*spring as usize].ends));
            of_parts[part].hinges.iter().for_each(|(hinge, _)| visit(&hinges[*hinge as usize].corners));
        });
        for (rows, of_part) in matrix.parts_mut().iter_mut().zip(of_parts) {
            for (spring, slot) in &mut of_part.springs {
                let [a, b] = springs[*spring as usize].ends;
                *slot = Some(rows.slot(a, b));
            }
            for (hinge, slots) in &mut of_part.hinges {
                *slots = rows.slots(&hinges[*hinge as usize].corners).collect::<Vec<_>>().try_into().ok();
            }
        }
        matrix
    }

    /// Assembles A for a step of this length [s] and a membrane of this stiffness [N/m].
    fn assemble(&self, matrix: &mut BlockMatrix, dt: f64, membrane: f64) {
        let (parts, masses) = (self.scene.parts(), self.scene.masses());
        let h = STAGE * dt;
        let implicit = |k: f64, inverse_mass: f64| h * 2.0 * (k / inverse_mass).sqrt() + h * h * k;
        parts.for_each(PerPart(matrix.parts_mut()), &|part, rows| {
            let (rows, of_part) = (&mut rows.0[0], &self.of_parts[part]);
            rows.clear();
            masses[parts.ranges()[part].clone()].iter().enumerate().for_each(|(v, m)| rows.add_scalar(v, *m));
            for (number, slot) in &of_part.springs {
                let spring = &self.springs[*number as usize];
                let k = membrane * spring.stiffness;
                let [a, b] = spring.ends.map(|v| 1.0 / masses[v as usize]);
                // A hundredth of the stiffness lies across, as that of a strain of a per cent does.
                let slot = slot.expect("the matrix is made first");
                rows.add_spring(slot, &spring.direction, implicit(k, a + b), 0.01 * h * h * k);
            }
            for (number, slots) in &of_part.hinges {
                let hinge = &self.hinges[*number as usize];
                let pairs = hinge.corners.iter().zip(&hinge.gradients);
                let inverse = pairs.map(|(v, g)| g.norm_squared() / masses[*v as usize]).sum();
                let slots = slots.as_ref().expect("the matrix is made first");
                let root = implicit(hinge.stiffness, inverse).sqrt();
                rows.add_outer(slots, &hinge.gradients.map(|g| Simd4::from(&(g * root))));
            }
        });
    }

    /// The impulse of gravity and of waves in a step.
    fn impulse(&self, dt: f64, membrane: f64) -> Vec<Vec3> {
        let h = 2.0 * STAGE * dt;
        let rest = self.scene.meshes()[0].rest_positions();
        let wave = |x: &Vec3| {
            let mut u = Vec3::zeros();
            for (length, turn) in [(0.05, 0.3), (0.12, 1.1), (0.4, 2.3)] {
                let along = Vec3::new(f64::cos(turn), f64::sin(turn), 0.7).dot(x) * std::f64::consts::TAU / length;
                let amplitude = 0.005 * length / std::f64::consts::TAU;
                u += Vec3::new(along.sin(), (along + turn).sin(), (along - turn).cos()) * amplitude;
            }
            u
        };
        let mut b: Vec<Vec3> = self.scene.masses().iter().map(|m| Vec3::new(0.0, -9.81 * m * h, 0.0)).collect();
        for Spring { ends: [a, z], stiffness, direction } in &self.springs {
            let stretch = (wave(&rest[*z as usize]) - wave(&rest[*a as usize])).dot(direction);
            let impulse = direction * (h * membrane * stiffness * stretch);
            b[*a as usize] += impulse;
            b[*z as usize] -= impulse;
        }
        b
    }
}

impl Projection for Cloth {
    fn project(&self, part: usize, r: &mut [Vec3]) {
        let held = &self.held[self.scene.parts().ranges()[part].clone()];
        r.iter_mut().zip(held).filter(|(_, held)| **held).for_each(|(r, _)| *r = Vec3::zeros());
    }
}

/// The rest shape with folds.
fn folded(mesh: &TriangleMesh) -> Vec<Vec3> {
    let rest = mesh.rest_positions();
    let mut normals = vec![Vec3::zeros(); rest.len()];
    for triangle in mesh.triangles() {
        let [a, b, c] = triangle.map(|v| rest[v as usize]);
        triangle.iter().for_each(|v| normals[*v as usize] += (b - a).cross(&(c - a)));
    }
    let fold = |x: &Vec3| 0.03 * (40.0 * x.x + 3.0 * x.y).sin() * (9.0 * x.z + 2.0 * x.y).cos();
    rest.iter().zip(normals).map(|(x, n)| x + n.normalize() * fold(x)).collect()
}

fn springs(mesh: &TriangleMesh, x: &[Vec3]) -> Vec<Spring> {
    let of = |(edge, area): (&drapery_core::mesh::Edge, f64)| {
        let [a, b] = edge.vertices.map(|v| x[v as usize]);
        let direction = (b - a).normalize();
        Spring { ends: edge.vertices, stiffness: area / mesh.rest_length(*edge).powi(2), direction }
    };
    mesh.edges().iter().zip(mesh.edge_areas()).map(of).collect()
}

fn hinges(mesh: &TriangleMesh, x: &[Vec3]) -> Vec<Hinge> {
    let of = |hinge: &drapery_core::mesh::Hinge| {
        let ([j, k], [i, l]) = (mesh.edges()[hinge.edge as usize].vertices, hinge.opposite);
        let corners = [i, j, k, l];
        let [i, j, k, l] = corners.map(|v| x[v as usize]);
        let (n, o) = ((i - j).cross(&(i - k)), (l - k).cross(&(l - j)));
        let edge = k - j;
        let length = edge.norm();
        let (n, o, t) = (n / n.norm_squared(), o / o.norm_squared(), edge / length);
        let gradients = [
            n * length,
            n * (i - k).dot(&t) + o * (l - k).dot(&t),
            -n * (i - j).dot(&t) - o * (l - j).dot(&t),
            o * length,
        ];
        let area: f64 = hinge.triangles.iter().map(|triangle| mesh.rest_areas()[*triangle as usize]).sum();
        Hinge { corners, gradients, stiffness: 3.0 * BENDING * length * length / area }
    };
    mesh.hinges().iter().map(of).collect()
}

/// Fastest of some repetitions [s].
fn fastest(mut work: impl FnMut()) -> f64 {
    let time = |_| {
        let start = Instant::now();
        work();
        start.elapsed().as_secs_f64()
    };
    (0..15).map(time).fold(f64::INFINITY, f64::min)
}

/// Measures the pieces of an iteration.
fn pieces(name: &str, cloth: &mut Cloth) {
    let mut matrix = cloth.matrix();
    let (dt, membrane) = (1.0 / FPS / 8.0, 1000.0);
    let assembly = fastest(|| cloth.assemble(&mut matrix, dt, membrane));
    let (parts, masses) = (cloth.scene.parts(), cloth.scene.masses());
    let (s, mut q) = (cloth.x.clone(), vec![Vec3::zeros(); parts.own().len()]);
    let product = fastest(|| {
        parts.for_each(PerVertex(&mut q), &|part, q| matrix.parts()[part].multiply(&s, q.0));
        black_box(&q);
    });
    let system =
        BlockSystem { parts, masses, worked_on: &vec![true; parts.count()], matrix: &matrix, constraints: cloth };
    let mut cg = PreconditionedCg::new(parts, &matrix);
    let prepare = fastest(|| cg.prepare(&system));
    let b = cloth.impulse(dt, membrane);
    let mut d = vec![Vec3::zeros(); parts.local_count()];
    let mut solve = |max_iterations: usize| {
        fastest(|| {
            cg.solve(&system, &b, &mut d, Stop { tolerance: 0.0, max_iterations });
        })
    };
    let iteration = (solve(22) - solve(2)) / 20.0;
    let count = parts.own().len() as f64;
    let [assembly, product, prepare, iteration] =
        [assembly, product, prepare, iteration].map(|seconds| seconds * 1e9 / count);
    let [bytes, of_solver] = [matrix.bytes(), cg.bytes()].map(|bytes| bytes as f64 / count);
    println!(
        "{name:<14} {count:>6} {bytes:>6.0} B {of_solver:>6.0} B {assembly:>8.1} {product:>8.1} {prepare:>8.1} {iteration:>10.1}"
    );
}

/// An iteration of conjugate gradients without a preconditioner.
fn plain_iteration(name: &str, cloth: &mut Cloth) {
    let mut matrix = cloth.matrix();
    let (dt, membrane) = (1.0 / FPS / 8.0, 1000.0);
    cloth.assemble(&mut matrix, dt, membrane);
    let parts = cloth.scene.parts();
    let b = cloth.impulse(dt, membrane);
    let solve = |iterations: usize| {
        let (mut d, mut r, mut s, mut q) = (vec![Vec3::zeros(); b.len()], b.clone(), b.clone(), b.clone());
        (0..parts.count()).for_each(|part| cloth.project(part, &mut r[parts.ranges()[part].clone()]));
        s.copy_from_slice(&r);
        let mut rho = dot(&r, &r);
        for _ in 0..iterations {
            let mut curvature = 0.0;
            for (part, range) in parts.ranges().iter().enumerate() {
                let q = &mut q[range.clone()];
                matrix.parts()[part].multiply(&s, q);
                cloth.project(part, q);
                curvature += dot(&s[range.clone()], q);
            }
            let alpha = rho / curvature;
            let mut sum = 0.0;
            for (((d, r), s), q) in d.iter_mut().zip(&mut r).zip(&s).zip(&q) {
                *d += s * alpha;
                *r -= q * alpha;
                sum += r.norm_squared();
            }
            let beta = sum / rho;
            s.iter_mut().zip(&r).for_each(|(s, r)| *s = r + *s * beta);
            rho = sum;
        }
        assert!(rho.is_finite() && rho < 1e3 * dot(&b, &b), "it goes towards the solution");
        black_box(d);
    };
    let seconds = (fastest(|| solve(42)) - fastest(|| solve(2))) / 40.0;
    let count = parts.own().len();
    let each = seconds * 1e9 / count as f64;
    println!("{name:<14} {count:>6} an iteration without the preconditioner {each:>6.1} ns a vertex");
}

fn dot(a: &[Vec3], b: &[Vec3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a.dot(b)).sum()
}

fn solves(name: &str, cloth: &mut Cloth) {
    let mut matrix = cloth.matrix();
    for membrane in [97.0, 1000.0, 10_000.0] {
        for steps in [16, 8, 4] {
            let dt = 1.0 / FPS / f64::from(steps);
            cloth.assemble(&mut matrix, dt, membrane);
            let (parts, masses) = (cloth.scene.parts(), cloth.scene.masses());
            let system = BlockSystem {
                parts,
                masses,
                worked_on: &vec![true; parts.count()],
                matrix: &matrix,
                constraints: cloth,
            };
            let mut cg = PreconditionedCg::new(parts, &matrix);
            let start = Instant::now();
            cg.prepare(&system);
            let prepare = start.elapsed();
            let b = cloth.impulse(dt, membrane);
            let mut d = vec![Vec3::zeros(); parts.local_count()];
            let stop = Stop { tolerance: (9.81 * dt / 10.0).min(0.01), max_iterations: 5000 };
            let start = Instant::now();
            let Outcome { iterations, converged, .. } = cg.solve(&system, &b, &mut d, stop);
            let solve = start.elapsed();
            assert!(converged);
            println!(
                "{name:<14} {:>6} {membrane:>6} N/m {steps:>3} {iterations:>5} {:>8.2} ms {:>8.2} ms",
                parts.own().len(),
                prepare.as_secs_f64() * 1e3,
                solve.as_secs_f64() * 1e3
            );
        }
    }
}

fn main() {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a pool of threads");
    let mut cloths = [("sheet", sheet(71)), ("sheet", sheet(127)), ("skirt", skirt(180)), ("sheet", sheet(200))]
        .map(|(name, mesh)| (name, Cloth::new(mesh)));
    pool.install(|| {
        cloths.iter_mut().for_each(|(name, cloth)| plain_iteration(name, cloth));
        if std::env::args().any(|argument| argument == "iteration") {
            return;
        }
        println!("cloth, vertices, bytes a vertex of matrix and solver; ns a vertex of assembly, product, preparation, iteration");
        cloths.iter_mut().for_each(|(name, cloth)| pieces(name, cloth));
        println!("\ncloth, vertices, stiffness, steps a frame, iterations, preparation, solve");
        cloths.iter_mut().for_each(|(name, cloth)| solves(name, cloth));
    });
}
