//! Networks of linear springs, shared by the stretch and bending effects (method 1.2).
//!
//! A spring between vertices 1 and 2 with unit direction e from 1 to 2 pulls vertex 1 with
//! `k (l - l_rest) e - c ((v1 - v2)·e) e` and vertex 2 with the opposite; `k` in N/m, `c` in N s/m. The elastic term is the
//! paper's `E (l/l0 - 1) e` with `k = E/l0`; the damping term carries the sign that dissipates.
//!
//! Storage: a part keeps the springs between its own vertices once, row by row, and those that leave it in a second list
//! that changes its own ends only. For the damping product a spring is its direction times √c: 28 bytes, of which each is
//! read once.

use crate::Vec3;
use crate::effects::{BuildContext, Effect, Force, PartView};
use crate::error::Problem;
use crate::mesh::TriangleMesh;
use crate::scene::Scene;
use crate::settings::{Default, Dimension, Field, Settings};

/// How the stiffness of each spring follows from a setting.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Stiffness {
    /// Membrane stiffness Y [N/m]: `k = Y · A / l0²` with A the rest area next to the spring, so that the cloth's stiffness
    /// does not depend on the mesh (exact for equilateral triangles: k = Y √3/2). Source: A. Van Gelder, "Approximate
    /// simulation of elastic membranes by triangulated spring meshes", 1998.
    Membrane(f64),
    /// The authors' constant E [N]: `k = E / l0`; refining the mesh makes the cloth stiffer (method 1.3).
    Constant(f64),
}

/// One spring before it is sorted into parts.
#[derive(Debug, Clone, Copy)]
pub struct SpringElement {
    /// Vertices in the garment's own order.
    pub vertices: [u32; 2],
    /// Length at rest [m], positive.
    pub rest_length: f64,
    /// Rest area that belongs to it [m²].
    pub area: f64,
}

/// The settings that stretch and bending share.
pub const FIELDS: &[Field] = &[
    Field {
        name: "stiffness",
        dimension: Dimension::Stiffness,
        default: Default::Absent,
        range: (0.0, 1e8),
        help: "force per width and strain, the same at every mesh density; cloth has 50 to 2000 N/m along the threads",
    },
    Field {
        name: "spring_stiffness",
        dimension: Dimension::Force,
        default: Default::Absent,
        range: (0.0, 1e8),
        help: "force of one spring per unit strain, as in the paper's scenes; refining the mesh stiffens the cloth",
    },
    Field {
        name: "damping_ratio",
        dimension: Dimension::None,
        default: Default::Number(1.0),
        range: (0.0, 1e3),
        help: "damping of each spring; 1 is critical for its two vertices alone, 0 rings for ever",
    },
    Field {
        name: "short_edges",
        dimension: Dimension::None,
        default: Default::Absent,
        range: (0.0, 0.5),
        help: "share of the springs, the shortest ones, that are softened to the stiffness of the longest among them, so \
               that a few slivers do not set the time step; 0.05 with `stiffness`, 0 with `spring_stiffness`",
    },
];

/// Share of the springs that is softened when the scene says nothing and the stiffness does not depend on the mesh.
const SHORT_EDGES: f64 = 0.05;

/// Reads which stiffness the settings give.
///
/// # Errors
/// Both or none of `stiffness` and `spring_stiffness` are written.
fn stiffness_setting(settings: &Settings) -> Result<Stiffness, String> {
    match (settings.optional("stiffness"), settings.optional("spring_stiffness")) {
        (Some(y), None) => Ok(Stiffness::Membrane(y)),
        (None, Some(e)) => Ok(Stiffness::Constant(e)),
        (Some(_), Some(_)) => Err("`stiffness` and `spring_stiffness` exclude each other".into()),
        (None, None) => Err("either `stiffness` (N/m) or `spring_stiffness` (N) is needed".into()),
    }
}

/// Makes the effect of the springs that `elements` finds in a garment's mesh; the body of stretch and bending alike.
///
/// # Errors
/// The stiffness is given twice or not at all.
pub fn build_effect(
    settings: &Settings,
    context: &BuildContext<'_>,
    name: &str,
    elements: fn(&TriangleMesh) -> Vec<SpringElement>,
    measures_strain: bool,
) -> Result<Effect, Problem> {
    let Some(garment) = context.garment else {
        return Err(Problem::scene(name, "this effect acts on one garment", "move its table under a [[garment]]"));
    };
    let place = format!("garment \"{}\", {name}", context.scene.description().garments[garment].name);
    let stiffness = stiffness_setting(settings).map_err(|e| Problem::scene(place, e, "give one of them"))?;
    let elements = elements(&context.scene.meshes()[garment]);
    let (stiffnesses, notes) = stiffnesses(&elements, stiffness, settings.optional("short_edges"));
    let damping_ratio = settings.number("damping_ratio");
    let (forces, bytes) = build_parts(context.scene, garment, &elements, &stiffnesses, damping_ratio, measures_strain);
    Ok(Effect { forces, bytes, notes, ..Effect::default() })
}

/// Stiffness of each spring [N/m], and a note on those that were softened (method 1.4: a rest length that is clamped from
/// below in the stiffness, not in the length at rest).
fn stiffnesses(elements: &[SpringElement], stiffness: Stiffness, short_edges: Option<f64>) -> (Vec<f64>, Vec<String>) {
    let default = if matches!(stiffness, Stiffness::Membrane(_)) { SHORT_EDGES } else { 0.0 };
    let mut lengths: Vec<f64> = elements.iter().map(|e| e.rest_length).collect();
    lengths.sort_unstable_by(f64::total_cmp);
    let rank = (short_edges.unwrap_or(default) * lengths.len() as f64) as usize;
    let shortest = lengths.get(rank).copied().unwrap_or(0.0);
    let softened = lengths.partition_point(|l| *l < shortest);
    let of = |element: &SpringElement| {
        let length = element.rest_length.max(shortest);
        match stiffness {
            Stiffness::Membrane(y) => y * element.area / (length * length),
            Stiffness::Constant(e) => e / length,
        }
    };
    let note = format!(
        "{softened} springs shorter than {:.3} mm are softened to that length, so that they do not set the time step",
        1e3 * shortest
    );
    (elements.iter().map(of).collect(), if softened > 0 { vec![note] } else { Vec::new() })
}

/// The springs of one part.
#[derive(Debug, Default)]
struct PartSprings {
    /// First vertex of the part.
    start: usize,
    /// For each vertex of the part, its first entry among the inner springs; one more at the end.
    rows: Vec<u32>,
    /// Other end of each inner spring, counted from the part's first vertex and greater than its row.
    inner: Vec<u32>,
    /// Own end (counted from the part's first vertex) and other end (in solver order) of each spring across the border.
    border: Vec<[u32; 2]>,
    /// Stiffness [N/m] and rest length [m], inner springs first.
    elastic: Vec<[f64; 2]>,
    /// √c of each spring [(N s/m)^½].
    root_damping: Vec<f64>,
    /// Unit direction times √c at the last update.
    directions: Vec<Vec3>,
    /// Whether the strain of these springs is the strain of the cloth.
    measures_strain: bool,
}

/// Sorts the springs of a garment into its parts.
fn build_parts(
    scene: &Scene,
    garment: usize,
    elements: &[SpringElement],
    stiffnesses: &[f64],
    damping_ratio: f64,
    measures_strain: bool,
) -> (Vec<(usize, Box<dyn Force>)>, usize) {
    let (parts, masses) = (scene.parts(), scene.masses());
    // (part, own end, other end, element): sorted, so that rows are contiguous and every order is fixed by the scene.
    let mut entries: Vec<(usize, bool, usize, usize, usize)> = Vec::with_capacity(elements.len() * 9 / 8);
    for (number, element) in elements.iter().enumerate() {
        let [a, b] = element.vertices.map(|v| parts.solver_index(garment, v));
        let (a, b) = (a.min(b), a.max(b));
        let (part_a, part_b) = (parts.part_of(a), parts.part_of(b));
        entries.push((part_a, part_a != part_b, a, b, number));
        if part_a != part_b {
            entries.push((part_b, true, b, a, number));
        }
    }
    entries.sort_unstable();
    let mut bytes = 0;
    let mut built: Vec<(usize, Box<dyn Force>)> = Vec::new();
    for group in entries.chunk_by(|a, b| a.0 == b.0) {
        let range = parts.ranges()[group[0].0].clone();
        let mut springs = PartSprings { start: range.start, measures_strain, ..PartSprings::default() };
        springs.rows = vec![0; range.len() + 1];
        for &(_, across, own, other, number) in group {
            let element = &elements[number];
            let k = stiffnesses[number];
            let reduced_mass = masses[own] * masses[other] / (masses[own] + masses[other]);
            springs.elastic.push([k, element.rest_length]);
            springs.root_damping.push((2.0 * damping_ratio * (k * reduced_mass).sqrt()).sqrt());
            if across {
                springs.border.push([(own - range.start) as u32, other as u32]);
            } else {
                springs.rows[own - range.start + 1] += 1;
                springs.inner.push((other - range.start) as u32);
            }
        }
        for i in 0..range.len() {
            springs.rows[i + 1] += springs.rows[i];
        }
        springs.directions = vec![Vec3::zeros(); springs.elastic.len()];
        bytes += springs.elastic.len() * (16 + 8 + 24) + springs.inner.len() * 4 + springs.border.len() * 8;
        bytes += springs.rows.len() * 4;
        built.push((group[0].0, Box::new(springs)));
    }
    (built, bytes)
}

/// Springs along the edges of a mesh.
pub fn along_edges(mesh: &TriangleMesh) -> Vec<SpringElement> {
    let elements = mesh.edges().iter().zip(mesh.edge_areas());
    elements
        .map(|(e, area)| SpringElement { vertices: e.vertices, rest_length: mesh.rest_length(*e), area: *area })
        .collect()
}

impl PartSprings {
    /// Tension over length of spring `s` when its ends are `u` apart; keeps its direction.
    #[inline]
    fn pull(&mut self, s: usize, u: Vec3) -> Vec3 {
        let length = u.norm();
        if length == 0.0 {
            // Coinciding ends have no direction to pull along.
            self.directions[s] = Vec3::zeros();
            return Vec3::zeros();
        }
        let [k, rest] = self.elastic[s];
        let inverse = 1.0 / length;
        self.directions[s] = u * (self.root_damping[s] * inverse);
        u * (k * (length - rest) * inverse)
    }

    /// Every spring as (own end, other end, number, whether it crosses the border), ends in solver order.
    fn ends(&self) -> impl Iterator<Item = (usize, usize, usize, bool)> + '_ {
        let inner = (0..self.rows.len() - 1).flat_map(move |i| {
            let row = self.rows[i] as usize..self.rows[i + 1] as usize;
            row.map(move |s| (self.start + i, self.start + self.inner[s] as usize, s, false))
        });
        let first = self.inner.len();
        let border = self.border.iter().enumerate();
        inner.chain(border.map(move |(b, e)| (self.start + e[0] as usize, e[1] as usize, first + b, true)))
    }
}

impl Force for PartSprings {
    fn update(&mut self, view: &PartView<'_>, f: &mut [Vec3]) {
        let own = &view.x[self.start..self.start + f.len()];
        for i in 0..f.len() {
            let mut sum = Vec3::zeros();
            for s in self.rows[i] as usize..self.rows[i + 1] as usize {
                let j = self.inner[s] as usize;
                let force = self.pull(s, own[j] - own[i]);
                sum += force;
                f[j] -= force;
            }
            f[i] += sum;
        }
        for b in 0..self.border.len() {
            let [i, j] = self.border[b];
            f[i as usize] += self.pull(self.inner.len() + b, view.x[j as usize] - own[i as usize]);
        }
    }

    fn add_damping(&self, v: &[Vec3], f: &mut [Vec3]) {
        let own = &v[self.start..self.start + f.len()];
        let (inner, border) = self.directions.split_at(self.inner.len());
        for (i, row) in self.rows.windows(2).enumerate() {
            let row = row[0] as usize..row[1] as usize;
            let vi = own[i];
            let mut sum = Vec3::zeros();
            for (j, g) in self.inner[row.clone()].iter().zip(&inner[row]) {
                let j = *j as usize;
                let force = g * g.dot(&(own[j] - vi));
                sum += force;
                f[j] -= force;
            }
            f[i] += sum;
        }
        for ([i, j], g) in self.border.iter().zip(border) {
            f[*i as usize] += g * g.dot(&(v[*j as usize] - own[*i as usize]));
        }
    }

    fn add_stiffness(&self, sums: &mut [f64]) {
        for (i, j, s, across) in self.ends() {
            sums[i - self.start] += self.elastic[s][0];
            if !across {
                sums[j - self.start] += self.elastic[s][0];
            }
        }
    }

    fn strain_rate(&self, x: &[Vec3], v: &[Vec3]) -> f64 {
        // |d(length)/dt| / rest length, compared as squares to spare the roots.
        let squared = |(i, j, s, _): (usize, usize, usize, bool)| {
            let (u, rest) = (x[j] - x[i], self.elastic[s][1]);
            let along = (v[j] - v[i]).dot(&u);
            let length_squared = u.norm_squared();
            if length_squared > 0.0 { along * along / (length_squared * rest * rest) } else { 0.0 }
        };
        self.ends().map(squared).fold(0.0, f64::max).sqrt()
    }

    fn energy(&self, view: &PartView<'_>) -> f64 {
        let energy = |(i, j, s, across): (usize, usize, usize, bool)| {
            let [k, rest] = self.elastic[s];
            let stretch = (view.x[j] - view.x[i]).norm() - rest;
            0.5 * k * stretch * stretch * if across { 0.5 } else { 1.0 }
        };
        self.ends().map(energy).sum()
    }

    fn largest_strain(&self, x: &[Vec3]) -> Option<(f64, [usize; 2])> {
        if !self.measures_strain {
            return None;
        }
        let strain =
            |(i, j, s, _): (usize, usize, usize, bool)| ((x[j] - x[i]).norm() / self.elastic[s][1] - 1.0, [i, j]);
        self.ends().map(strain).max_by(|a, b| a.0.total_cmp(&b.0))
    }
}
