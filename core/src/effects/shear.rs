//! Shear: an altitude spring in every triangle, from the corner opposite its longest edge to that edge
//! (`docs/theory/step.md#membranes-altitudes-ether`).
//!
//! ```toml
//! [garment.shear]
//! stiffness = "100 N/m"       # the same cloth at every mesh density
//! damping_ratio = 1.0
//! compressed_by = 0.1         # acts only on triangles that are squashed by more than that
//! ```
//!
//! Springs along edges leave a triangle free to collapse: its corner may pass through the opposite edge while no edge changes
//! much. An altitude spring pulls that corner with `k (l − l₀) e − c (v·e) e`, where e points from the corner to its foot on
//! the edge, l is the distance, l₀ that at rest, and v the corner's velocity relative to the foot; the ends of the edge share
//! the opposite by the place of the foot. `k` is as for springs along edges: `stiffness · A / l₀²` with A the triangle's rest
//! area, or `spring_stiffness / l₀` as in the authors' scenes (3.313709 N with a damping ratio of 4).
//!
//! Limits: which altitude acts is decided by the longest edge at the time, and the potential jumps where that changes. A
//! corner that lies exactly on its edge has no direction to go and is not pushed. Stiffness against shear follows from the
//! mesh; measured values belong to `membrane`.

#![cfg(feature = "effects")]

use crate::Vec3;
use crate::block_matrix::{PartBlocks, Slot};
use crate::effects::force::{BlockFactors, Force, Linearised, PartForce, PartMotion, PartView};
use crate::effects::spec::{BuildContext, Cost, Effect, EffectSpec, MapSpec, Need, Scope, Study};
use crate::effects::springs::{self, SpringElement, Stiffnesses};
use crate::elements::corners::{add, by_part, gather, outside, own_fraction};
use crate::error::Problem;
use crate::parallel::simd4::Simd4;
use crate::settings::{Default, Dimension, Field, Settings};

/// Registry entry.
pub(crate) static SPEC: EffectSpec = EffectSpec {
    name: "shear",
    summary: "springs along the shortest altitude of each triangle resist shearing and collapse",
    scope: Scope::Garment,
    example: r#"[garment.shear]
stiffness = "5 N/m""#,
    fields: &[
        Field {
            help: "force per width and strain of the altitude springs, the same at every mesh density; the shear stiffness \
                   of the cloth follows from these and from the mesh, so for a measured one use `membrane`",
            ..springs::FIELDS[0]
        },
        Field {
            help: "force of one altitude spring per unit strain; refining the mesh stiffens the cloth; 3.3 in the scenes \
                   of Selle et al. (2009)",
            ..springs::FIELDS[1]
        },
        springs::FIELDS[2],
        springs::FIELDS[3],
        Field {
            name: "compressed_by",
            dimension: Dimension::None,
            default: Default::Absent,
            range: (0.0, 0.95),
            help: "compressive strain of an altitude from which on its spring acts; if it is left out, springs act in \
                   tension and compression",
        },
    ],
    needs: &[Need::State],
    elements: "triangles",
    maps: &[MapSpec::of("shear", &["stiffness", "spring_stiffness"]), MapSpec::of("shear_damping", &["damping_ratio"])],
    study: Study::INTERNAL,
    cost: Cost { bytes_of_point: 520.0, update: 25.0, product: 8.0 },
    build,
    ..EffectSpec::BARE
};

/// The altitude from one corner of a triangle.
#[derive(Debug, Clone, Copy)]
struct Altitude {
    /// Length at rest [m].
    rest_length: f64,
    /// Stiffness [N/m].
    stiffness: f64,
    /// Damping c [N s/m].
    damping: f64,
}

/// The altitude that acts, as it was at the last update.
#[derive(Debug, Clone, Copy)]
struct Acting {
    /// Its corner.
    corner: usize,
    /// Place of the foot between the two corners that follow, from 0 to 1.
    foot: f64,
    /// From the corner to the foot.
    direction: Simd4,
}

/// A triangle of a part.
#[derive(Debug, Clone, Copy)]
struct Triangle {
    /// Local vertices.
    corners: [u32; 3],
    altitudes: [Altitude; 3],
    acting: Option<Acting>,
}

/// The altitude springs of one part.
struct PartShear {
    /// First vertex of the part.
    start: usize,
    triangles: Vec<Triangle>,
    /// Vertices of other parts, ascending.
    neighbours: Vec<u32>,
    compressed_by: Option<f64>,
}

fn build(settings: &Settings, context: &BuildContext<'_>) -> Result<Effect, Problem> {
    let (scene, parts) = (context.scene, context.scene.parts());
    let Some(garment) = context.garment else {
        return Err(Problem::scene("shear", "this effect acts on one garment", "move its table under a [[garment]]"));
    };
    let mesh = &scene.meshes()[garment];
    let first = parts.garment(garment).start;
    let corners: Vec<[usize; 3]> = mesh.triangles().iter().map(|t| t.map(|v| first + v as usize)).collect();
    // One spring for each corner of each triangle, of which one acts at a time.
    let springs: Vec<SpringElement> =
        mesh.triangles().iter().zip(mesh.rest_areas()).flat_map(altitudes_of(mesh)).collect();
    let is_own = |corners: &[usize; 3]| corners.iter().min().is_some_and(|first| parts.own().contains(first));
    let shortest = |springs: &[SpringElement]| springs.iter().map(|s| s.rest_length).fold(f64::INFINITY, f64::min);
    let counted = corners.iter().zip(springs.chunks(3)).filter(|(corners, _)| is_own(corners));
    let lengths: Vec<f64> = counted.map(|(_, springs)| shortest(springs)).collect();
    let Stiffnesses { of_springs: stiffnesses, notes, .. } =
        springs::stiffnesses_of(settings, context, "shear", &springs, &lengths)?;
    let damping_ratios = springs::damping_ratios(settings, context, "shear", &springs);
    let triangle = |number: usize| {
        let inverse = corners[number].map(|corner| 1.0 / scene.masses()[corner]);
        let altitude = |corner: usize| {
            let (spring, stiffness) = (3 * number + corner, stiffnesses[3 * number + corner]);
            // The foot of an altitude is taken to be in the middle of its edge.
            let edge = (inverse[(corner + 1) % 3] + inverse[(corner + 2) % 3]) / 4.0;
            let damping = 2.0 * damping_ratios[spring] * (stiffness / (inverse[corner] + edge)).sqrt();
            Altitude { rest_length: springs[spring].rest_length, stiffness, damping }
        };
        let altitudes = [0, 1, 2].map(altitude);
        Triangle { corners: corners[number].map(|corner| corner as u32), altitudes, acting: None }
    };
    let mut bytes = 0;
    let mut forces: Vec<PartForce> = Vec::new();
    for group in by_part(parts, corners.iter().copied()).chunk_by(|a, b| a.0 == b.0) {
        let range = &parts.ranges()[group[0].0];
        let triangles: Vec<Triangle> = group.iter().map(|(_, number)| triangle(*number)).collect();
        let neighbours = outside(range, triangles.iter().map(|t| t.corners));
        bytes += triangles.len() * size_of::<Triangle>() + neighbours.len() * size_of::<u32>();
        let (start, compressed_by) = (range.start, settings.optional("compressed_by"));
        forces.push((group[0].0, Box::new(PartShear { start, triangles, neighbours, compressed_by })));
    }
    Ok(Effect { forces, elements: lengths.len(), bytes, notes, ..Effect::default() })
}

/// The three altitudes of a triangle of the mesh, given its corners and its area, in the order of the corners.
fn altitudes_of(mesh: &crate::mesh::TriangleMesh) -> impl Fn((&[u32; 3], &f64)) -> [SpringElement; 3] + '_ {
    let at = |v: u32| mesh.rest_positions()[v as usize];
    move |(corners, area)| {
        [0, 1, 2].map(|corner| {
            let edge = [corners[(corner + 1) % 3], corners[(corner + 2) % 3]];
            let rest_length = 2.0 * area / (at(edge[1]) - at(edge[0])).norm();
            SpringElement { vertices: edge, rest_length, area: *area }
        })
    }
}

/// Returns the place and direction of the altitude to the longest edge, and its length [m]; `None` where it has no
/// direction.
fn longest_edge_altitude(x: [Vec3; 3]) -> Option<(Acting, f64)> {
    let squared = [0, 1, 2].map(|corner| (x[(corner + 2) % 3] - x[(corner + 1) % 3]).norm_squared());
    let longer = |a: usize, b: usize| if squared[b] > squared[a] { b } else { a };
    let corner = longer(longer(0, 1), 2);
    let (from, edge) = (x[(corner + 1) % 3], x[(corner + 2) % 3] - x[(corner + 1) % 3]);
    let foot = ((x[corner] - from).dot(&edge) / squared[corner]).clamp(0.0, 1.0);
    let apart = from + edge * foot - x[corner];
    let length = apart.norm();
    let direction = Simd4::from(&(apart / length));
    (length > 0.0 && squared[corner] > 0.0).then_some((Acting { corner, foot, direction }, length))
}

impl Triangle {
    /// The altitude that acts at these positions, and its length [m].
    fn acting(&self, x: &[Vec3], compressed_by: Option<f64>) -> Option<(Acting, f64)> {
        let found = longest_edge_altitude(self.corners.map(|corner| x[corner as usize]));
        found.filter(|(acting, length)| {
            let rest_length = self.altitudes[acting.corner].rest_length;
            compressed_by.is_none_or(|share| *length < (1.0 - share) * rest_length)
        })
    }
}

impl Acting {
    /// A pull of the corner towards the foot [N], and its opposite, in the order of the triangle's corners.
    fn pull(&self, force: f64) -> [Simd4; 3] {
        let mut pulls = [Simd4::ZERO; 3];
        pulls[self.corner] = self.direction * force;
        pulls[(self.corner + 1) % 3] = self.direction * (-(1.0 - self.foot) * force);
        pulls[(self.corner + 2) % 3] = self.direction * (-self.foot * force);
        pulls
    }

    /// Returns the speed of the corner towards its foot, by the velocities of the corners [m/s].
    fn approach(&self, v: [Simd4; 3]) -> f64 {
        let foot = v[(self.corner + 1) % 3] * (1.0 - self.foot) + v[(self.corner + 2) % 3] * self.foot;
        (v[self.corner] - foot).dot(self.direction)
    }
}

impl Force for PartShear {
    fn neighbours(&self) -> &[u32] {
        &self.neighbours
    }

    fn update(&mut self, view: &PartView<'_>, _: &[Simd4], f: &mut [Simd4]) {
        for triangle in &mut self.triangles {
            let found = triangle.acting(view.x, self.compressed_by);
            triangle.acting = found.map(|(acting, _)| acting);
            if let Some((acting, length)) = found {
                let Altitude { rest_length, stiffness, .. } = triangle.altitudes[acting.corner];
                add(self.start, triangle.corners, acting.pull(stiffness * (length - rest_length)), f);
            }
        }
    }

    fn add_damping(&self, motion: &PartMotion<'_>, f: &mut [Simd4]) {
        for triangle in &self.triangles {
            if let Some(acting) = &triangle.acting {
                let v = gather(self.start, triangle.corners, motion.own_v, motion.v);
                let damping = triangle.altitudes[acting.corner].damping;
                add(self.start, triangle.corners, acting.pull(-damping * acting.approach(v)), f);
            }
        }
    }

    fn add_stiffness(&self, sums: &mut [f64]) {
        for triangle in &self.triangles {
            let stiffest = triangle.altitudes.iter().map(|a| a.stiffness).fold(0.0, f64::max);
            for corner in triangle.corners {
                if let Some(sum) = sums.get_mut((corner as usize).wrapping_sub(self.start)) {
                    *sum += stiffest;
                }
            }
        }
    }

    fn energy(&self, view: &PartView<'_>) -> f64 {
        let own = view.start..view.start + view.masses.len();
        let energy = |triangle: &Triangle| {
            let (acting, length) = triangle.acting(view.x, self.compressed_by)?;
            let Altitude { rest_length, stiffness, .. } = triangle.altitudes[acting.corner];
            // Counted from where the spring begins to act.
            let begin = self.compressed_by.unwrap_or(0.0) * rest_length;
            let square = (length - rest_length).powi(2) - begin * begin;
            Some(0.5 * stiffness * square * own_fraction(&own, triangle.corners))
        };
        self.triangles.iter().filter_map(energy).sum()
    }

    fn linearised(&self) -> Option<&dyn Linearised> {
        Some(self)
    }
}

impl Linearised for PartShear {
    fn visit_elements(&self, visit: &mut dyn FnMut(&[u32])) {
        self.triangles.iter().for_each(|triangle| visit(&triangle.corners));
    }

    fn add_blocks(&self, _: &PartView<'_>, factors: BlockFactors, slots: &[Slot], rows: &mut PartBlocks) {
        for (Triangle { acting, altitudes, .. }, slots) in self.triangles.iter().zip(slots.as_chunks::<3>().0) {
            if let Some(acting) = acting {
                let Altitude { stiffness, damping, .. } = altitudes[acting.corner];
                let scale = factors.stiffness * stiffness + factors.damping * damping;
                rows.add_outer(slots, &acting.pull(scale.sqrt()));
            }
        }
    }
}
