//! Networks of linear springs, shared by the stretch and bending effects (method 1.2).
//!
//! A spring between vertices 1 and 2 with unit direction e from 1 to 2 pulls vertex 1 with
//! `k (l - l_rest) e - c ((v1 - v2)·e) e` and vertex 2 with the opposite; `k` in N/m, `c` in N s/m. The elastic term is
//! the paper's `E (l/l0 - 1) e` with `k = E/l0`; the damping term carries the sign that dissipates.
//!
//! Storage: a part keeps the springs between its own vertices once, in rows of equal length, and those that leave it in
//! a second list that changes its own ends only. Each spring belongs to the row of one end, chosen so that rows have
//! nearly the same length everywhere: loops of known length have no branches to mispredict. For the damping product a
//! spring is `c / l²` and the number of its other end, 10 bytes; its direction is taken from the positions, which are
//! shared by all springs of a vertex (`docs/decisions/0001-state-layout.md`).

use crate::Vec3;
use crate::effects::{BuildContext, Effect, Force, PartForce, PartView};
use crate::error::Problem;
use crate::mesh::TriangleMesh;
use crate::parallel::parts::PART_SIZE;
use crate::scene::Scene;
use crate::settings::{Default, Dimension, Field, Settings};

/// How the stiffness of each spring follows from a setting.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Stiffness {
    /// Membrane stiffness Y [N/m]: `k = Y · A / l0²` with A the rest area next to the spring, so that the cloth's
    /// stiffness does not depend on the mesh (exact for equilateral triangles: k = Y √3/2). Source: A. Van Gelder,
    /// "Approximate simulation of elastic membranes by triangulated spring meshes", 1998.
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

/// Stiffness of each spring [N/m], and a note on those that were softened (method 1.4: a rest length that is clamped
/// from below in the stiffness, not in the length at rest).
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

/// Longest row: vertices with more springs have several.
const ROW: usize = 4;

/// Rows of one length.
#[derive(Debug, Clone, Copy)]
struct RowGroup {
    /// Springs of each row, from 1 to [`ROW`].
    length: usize,
    /// Number of rows.
    count: usize,
}

/// The springs of one part.
#[derive(Debug, Default)]
struct PartSprings {
    /// First vertex of the part.
    start: usize,
    groups: Vec<RowGroup>,
    /// Vertex of each row, counted from the part's first vertex; group after group.
    rows: Vec<u16>,
    /// Other end of each inner spring, counted from the part's first vertex; row after row.
    inner: Vec<u16>,
    /// Own end (counted from the part's first vertex) and other end (in solver order) of each spring across the border.
    border: Vec<[u32; 2]>,
    /// Stiffness [N/m] and rest length [m], inner springs first.
    elastic: Vec<[f64; 2]>,
    /// Damping c of each spring [N s/m].
    damping: Vec<f64>,
    /// c / l² at the last update [N s/m³]; zero where the ends coincided.
    scaled_damping: Vec<f64>,
    /// Whether the strain of these springs is the strain of the cloth.
    measures_strain: bool,
}

const _: () = assert!(PART_SIZE <= u16::MAX as usize, "rows number the vertices of a part by u16");

/// A spring of one part: own end, other end (both in solver order) and element.
type Entry = (usize, usize, usize);

/// Sorts the springs of a garment into its parts.
fn build_parts(
    scene: &Scene,
    garment: usize,
    elements: &[SpringElement],
    stiffnesses: &[f64],
    damping_ratio: f64,
    measures_strain: bool,
) -> (Vec<PartForce>, usize) {
    let (parts, masses) = (scene.parts(), scene.masses());
    // (part, whether it crosses the border, spring): sorted, so that every order is fixed by the scene.
    let mut entries: Vec<(usize, bool, Entry)> = Vec::with_capacity(elements.len() * 9 / 8);
    for (number, element) in elements.iter().enumerate() {
        let [a, b] = element.vertices.map(|v| parts.solver_index(garment, v));
        let (a, b) = (a.min(b), a.max(b));
        let (part_a, part_b) = (parts.part_of(a), parts.part_of(b));
        entries.push((part_a, part_a != part_b, (a, b, number)));
        if part_a != part_b {
            entries.push((part_b, true, (b, a, number)));
        }
    }
    entries.sort_unstable();
    let mut bytes = 0;
    let mut built: Vec<PartForce> = Vec::new();
    for group in entries.chunk_by(|a, b| a.0 == b.0) {
        let range = parts.ranges()[group[0].0].clone();
        let (inner, border) = group.split_at(group.partition_point(|(_, across, _)| !across));
        let mut springs = PartSprings { start: range.start, measures_strain, ..PartSprings::default() };
        let mut add = |own: usize, other: usize, number: usize| {
            let element = &elements[number];
            let k = stiffnesses[number];
            let reduced_mass = masses[own] * masses[other] / (masses[own] + masses[other]);
            springs.elastic.push([k, element.rest_length]);
            springs.damping.push(2.0 * damping_ratio * (k * reduced_mass).sqrt());
        };
        let mut inner: Vec<Entry> = inner.iter().map(|e| e.2).collect();
        for row in balanced_rows(&mut inner, &range) {
            springs.rows.push((row[0].0 - range.start) as u16);
            match springs.groups.last_mut() {
                Some(group) if group.length == row.len() => group.count += 1,
                _ => springs.groups.push(RowGroup { length: row.len(), count: 1 }),
            }
            for &(own, other, number) in row {
                springs.inner.push((other - range.start) as u16);
                add(own, other, number);
            }
        }
        for &(_, _, (own, other, number)) in border {
            springs.border.push([(own - range.start) as u32, other as u32]);
            add(own, other, number);
        }
        springs.scaled_damping = vec![0.0; springs.elastic.len()];
        bytes += springs.elastic.len() * (16 + 8 + 8) + springs.inner.len() * 2 + springs.border.len() * 8;
        bytes += springs.rows.len() * 2;
        built.push((group[0].0, Box::new(springs)));
    }
    (built, bytes)
}

/// Gives every spring to the row of one of its ends so that no end could hand one over to make rows more equal, and
/// returns the rows by length.
fn balanced_rows<'a>(springs: &'a mut [Entry], vertices: &std::ops::Range<usize>) -> Vec<&'a [Entry]> {
    let mut counts = vec![0_u32; vertices.len()];
    springs.iter().for_each(|s| counts[s.0 - vertices.start] += 1);
    loop {
        let mut moved = false;
        for spring in &mut *springs {
            let (own, other) = (spring.0 - vertices.start, spring.1 - vertices.start);
            // Each move makes the sum of squares of the counts smaller, so there is an end.
            if counts[own] > counts[other] + 1 {
                (counts[own], counts[other]) = (counts[own] - 1, counts[other] + 1);
                (spring.0, spring.1) = (spring.1, spring.0);
                moved = true;
            }
        }
        if !moved {
            break;
        }
    }
    springs.sort_unstable();
    let mut rows: Vec<_> = springs.chunk_by(|a, b| a.0 == b.0).flat_map(|of_vertex| of_vertex.chunks(ROW)).collect();
    rows.sort_by_key(|row| row.len());
    rows
}

/// Springs along the edges of a mesh.
pub fn along_edges(mesh: &TriangleMesh) -> Vec<SpringElement> {
    let elements = mesh.edges().iter().zip(mesh.edge_areas());
    elements
        .map(|(e, area)| SpringElement { vertices: e.vertices, rest_length: mesh.rest_length(*e), area: *area })
        .collect()
}

/// Rows of one length with what belongs to their springs.
struct Rows<'a, T> {
    vertices: &'a [u16],
    others: &'a [u16],
    elastic: &'a [[f64; 2]],
    damping: &'a [f64],
    scaled_damping: T,
}

impl Rows<'_, &[f64]> {
    /// Adds `c (v2 - v1)·e e` of every spring to its ends.
    fn add_damping<const N: usize>(&self, x: &[Vec3], v: &[Vec3], f: &mut [Vec3]) {
        let (x, v) = (&x[..f.len()], &v[..f.len()]);
        let rows = self.vertices.iter().zip(self.others.as_chunks::<N>().0);
        for ((i, others), scaled) in rows.zip(self.scaled_damping.as_chunks::<N>().0) {
            let i = usize::from(*i);
            let (xi, vi) = (x[i], v[i]);
            let mut sum = Vec3::zeros();
            for n in 0..N {
                let j = usize::from(others[n]);
                let u = x[j] - xi;
                let force = u * (scaled[n] * u.dot(&(v[j] - vi)));
                sum += force;
                f[j] -= force;
            }
            f[i] += sum;
        }
    }
}

impl Rows<'_, &[f64]> {
    /// Compares the rate of every spring with the fastest so far.
    fn compare_rates<const N: usize>(&self, x: &[Vec3], v: &[Vec3], fastest: &mut Fraction) {
        let rows = self.vertices.iter().zip(self.others.as_chunks::<N>().0);
        for ((i, others), elastic) in rows.zip(self.elastic.as_chunks::<N>().0) {
            let i = usize::from(*i);
            let (xi, vi) = (x[i], v[i]);
            for n in 0..N {
                let j = usize::from(others[n]);
                fastest.compare(&(x[j] - xi), &(v[j] - vi), elastic[n][1]);
            }
        }
    }
}

/// The largest squared rate of relative change of length, as a fraction: most springs then need no division.
struct Fraction {
    squared: f64,
    over: f64,
}

impl Fraction {
    /// Takes the rate of a spring whose ends are `u` apart and part by `change`, if it is larger.
    #[inline]
    fn compare(&mut self, u: &Vec3, change: &Vec3, rest: f64) {
        let along = change.dot(u);
        let (squared, over) = (along * along, u.norm_squared() * rest * rest);
        if squared * self.over > self.squared * over && over > 0.0 {
            *self = Self { squared, over };
        }
    }
}

impl Rows<'_, &mut [f64]> {
    /// Adds the tension of every spring to its ends and keeps c / l².
    fn update<const N: usize>(&mut self, x: &[Vec3], f: &mut [Vec3]) {
        let x = &x[..f.len()];
        let rows = self.vertices.iter().zip(self.others.as_chunks::<N>().0);
        let springs = self.elastic.as_chunks::<N>().0.iter().zip(self.damping.as_chunks::<N>().0);
        let rows = rows.zip(springs).zip(self.scaled_damping.as_chunks_mut::<N>().0);
        for (((i, others), (elastic, damping)), scaled) in rows {
            let i = usize::from(*i);
            let xi = x[i];
            let mut sum = Vec3::zeros();
            for n in 0..N {
                let j = usize::from(others[n]);
                let force;
                (force, scaled[n]) = pull(&(x[j] - xi), elastic[n], damping[n]);
                sum += force;
                f[j] -= force;
            }
            f[i] += sum;
        }
    }
}

/// Force on the first end of a spring whose ends are `u` apart, and c / l².
#[inline]
fn pull(u: &Vec3, [k, rest]: [f64; 2], damping: f64) -> (Vec3, f64) {
    let squared = u.norm_squared();
    // Coinciding ends have no direction to pull along.
    let inverse = if squared > 0.0 { 1.0 / squared } else { 0.0 };
    // (l - l0) / l, without a second division.
    let relative = 1.0 - rest * (squared.sqrt() * inverse);
    (u * (k * relative), damping * inverse)
}

impl PartSprings {
    /// The groups of rows, each with its slices; `scaled_damping` is what a call reads or writes.
    fn row_groups(&self) -> impl Iterator<Item = (usize, Rows<'_, &[f64]>)> {
        let (mut row, mut spring) = (0, 0);
        self.groups.iter().map(move |group| {
            let (rows, springs) = (row..row + group.count, spring..spring + group.count * group.length);
            (row, spring) = (rows.end, springs.end);
            let rows = Rows {
                vertices: &self.rows[rows],
                others: &self.inner[springs.clone()],
                elastic: &self.elastic[springs.clone()],
                damping: &self.damping[springs.clone()],
                scaled_damping: &self.scaled_damping[springs],
            };
            (group.length, rows)
        })
    }

    /// Every spring as (own end, other end, number, whether it crosses the border), ends in solver order.
    fn ends(&self) -> impl Iterator<Item = (usize, usize, usize, bool)> + '_ {
        let lengths = self.groups.iter().flat_map(|group| std::iter::repeat_n(group.length, group.count));
        let own = self.rows.iter().zip(lengths).flat_map(|(row, length)| std::iter::repeat_n(*row, length));
        let inner = own.zip(&self.inner).enumerate();
        let first = self.inner.len();
        let border = self.border.iter().enumerate();
        inner
            .map(move |(s, (i, j))| (self.start + usize::from(i), self.start + usize::from(*j), s, false))
            .chain(border.map(move |(b, e)| (self.start + e[0] as usize, e[1] as usize, first + b, true)))
    }
}

impl Force for PartSprings {
    fn update(&mut self, view: &PartView<'_>, f: &mut [Vec3]) {
        let own = &view.x[self.start..self.start + f.len()];
        let (mut row, mut spring) = (0, 0);
        for group in &self.groups {
            let (rows, springs) = (row..row + group.count, spring..spring + group.count * group.length);
            (row, spring) = (rows.end, springs.end);
            let mut rows = Rows {
                vertices: &self.rows[rows],
                others: &self.inner[springs.clone()],
                elastic: &self.elastic[springs.clone()],
                damping: &self.damping[springs.clone()],
                scaled_damping: &mut self.scaled_damping[springs],
            };
            match group.length {
                1 => rows.update::<1>(own, f),
                2 => rows.update::<2>(own, f),
                3 => rows.update::<3>(own, f),
                _ => rows.update::<ROW>(own, f),
            }
        }
        let first = self.inner.len();
        let springs = self.elastic[first..].iter().zip(&self.damping[first..]);
        for (([i, j], (elastic, damping)), scaled) in
            self.border.iter().zip(springs).zip(&mut self.scaled_damping[first..])
        {
            let force;
            (force, *scaled) = pull(&(view.x[*j as usize] - own[*i as usize]), *elastic, *damping);
            f[*i as usize] += force;
        }
    }

    fn add_damping(&self, x: &[Vec3], v: &[Vec3], f: &mut [Vec3]) {
        let part = self.start..self.start + f.len();
        let (own_x, own_v) = (&x[part.clone()], &v[part]);
        for (length, rows) in self.row_groups() {
            match length {
                1 => rows.add_damping::<1>(own_x, own_v, f),
                2 => rows.add_damping::<2>(own_x, own_v, f),
                3 => rows.add_damping::<3>(own_x, own_v, f),
                _ => rows.add_damping::<ROW>(own_x, own_v, f),
            }
        }
        for ([i, j], scaled) in self.border.iter().zip(&self.scaled_damping[self.inner.len()..]) {
            let (i, j) = (*i as usize, *j as usize);
            let u = x[j] - own_x[i];
            f[i] += u * (scaled * u.dot(&(v[j] - own_v[i])));
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
        let mut fastest = Fraction { squared: 0.0, over: 1.0 };
        for (length, rows) in self.row_groups() {
            match length {
                1 => rows.compare_rates::<1>(&x[self.start..], &v[self.start..], &mut fastest),
                2 => rows.compare_rates::<2>(&x[self.start..], &v[self.start..], &mut fastest),
                3 => rows.compare_rates::<3>(&x[self.start..], &v[self.start..], &mut fastest),
                _ => rows.compare_rates::<ROW>(&x[self.start..], &v[self.start..], &mut fastest),
            }
        }
        for ([i, j], [_, rest]) in self.border.iter().zip(&self.elastic[self.inner.len()..]) {
            let (i, j) = (self.start + *i as usize, *j as usize);
            fastest.compare(&(x[j] - x[i]), &(v[j] - v[i]), *rest);
        }
        (fastest.squared / fastest.over).sqrt()
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
