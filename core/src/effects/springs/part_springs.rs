//! The springs of one part: how they are stored, and the loops over them.
//!
//! Storage: a part keeps the springs between its own vertices once, in rows of equal length, and those that leave it in
//! a second list, sorted by neighbour, that changes its own ends only. Each spring belongs to the row of one end, chosen
//! so that rows have nearly the same length everywhere: loops of known length have no branches to mispredict. For the
//! damping product a spring is `c / l²` and the number of its other end, 10 bytes; its direction is taken from the
//! positions, which are shared by all springs of a vertex (`docs/dev/decisions/0001-state-layout.md`).

use crate::Vec3;
use crate::block_matrix::{PartBlocks, Slot};
use crate::effects::force::{BlockFactors, Force, Linearised, PartForce, PartMotion, PartView, Strained};
use crate::effects::springs::SpringNetwork;
use crate::effects::tensile_curve::TensileCurve;
use crate::parallel::parts::PART_SIZE;
use crate::parallel::simd4::Simd4;
use crate::scene::Scene;

/// Longest row: vertices with more springs have several.
const ROW: usize = 4;

/// Vertices whose rows stay together: few enough for their vectors to fit the nearest cache.
const ROW_BLOCK: usize = 256;

/// Rows whose lengths are computed together.
const SPAN: usize = 16;

/// Neighbours that are fetched at once: waiting for many far reads together takes as long as for one. Their numbers are
/// taken modulo this, which changes nothing and spares a check.
const NEIGHBOURS: usize = 64;

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
    /// Springs across the border: own end (counted from the part's first vertex) and number of the neighbour.
    border: Vec<[u16; 2]>,
    /// Vertices of other parts at the far ends of border springs, ascending.
    neighbours: Vec<u32>,
    /// Number of border springs to each [`NEIGHBOURS`] neighbours, whose numbers start anew.
    border_groups: Vec<usize>,
    /// Stiffness of each spring [N/m], inner springs first.
    stiffness: Vec<f64>,
    /// Length of each spring at rest [m].
    rest_length: Vec<f64>,
    /// Damping c of each spring [N s/m].
    damping: Vec<f64>,
    /// c / l² at the last update [N s/m³]; zero where the ends coincided.
    scaled_damping: Vec<f64>,
    /// Whether the strain of these springs is the strain of the cloth.
    measures_strain: bool,
    /// Curve by which all of them stiffen in tension, by their stiffness at rest; `None` where they do not.
    curve: Option<TensileCurve>,
    /// The smallest rest length that counts for rates of strain [m]: softened springs count as the shortest of the others.
    shortest: f64,
}

const _: () = assert!(PART_SIZE <= u16::MAX as usize, "rows number the vertices of a part by u16");

/// A spring of one part: own end, other end (both local vertices) and element.
type Entry = (usize, usize, usize);

/// Sorts the springs of a garment into its parts.
pub(in crate::effects) fn build(scene: &Scene, garment: usize, network: &SpringNetwork<'_>) -> (Vec<PartForce>, usize) {
    let SpringNetwork { elements, stiffnesses, damping_ratios, shortest, measures_strain, curve } = *network;
    let (parts, masses) = (scene.parts(), scene.masses());
    let first = parts.garment(garment).start;
    let part_of = |vertex: usize| parts.own().contains(&vertex).then(|| parts.part_of(vertex));
    // (part, whether it crosses the border, spring): sorted, so that every order is fixed by the scene.
    let mut entries: Vec<(usize, bool, Entry)> = Vec::with_capacity(elements.len() * 9 / 8);
    for (number, element) in elements.iter().enumerate() {
        let [a, b] = element.vertices.map(|v| first + v as usize);
        let (a, b) = (a.min(b), a.max(b));
        let (part_a, part_b) = (part_of(a), part_of(b));
        let across = part_a != part_b;
        entries.extend(part_a.map(|part| (part, across, (a, b, number))));
        entries.extend(part_b.filter(|_| across).map(|part| (part, true, (b, a, number))));
    }
    entries.sort_unstable();
    let mut bytes = 0;
    let mut built: Vec<PartForce> = Vec::new();
    for group in entries.chunk_by(|a, b| a.0 == b.0) {
        let range = parts.ranges()[group[0].0].clone();
        let (inner, border) = group.split_at(group.partition_point(|(_, across, _)| !across));
        let numbers = || Vec::with_capacity(group.len());
        let mut springs = PartSprings {
            start: range.start,
            inner: Vec::with_capacity(inner.len()),
            border: Vec::with_capacity(border.len()),
            stiffness: numbers(),
            rest_length: numbers(),
            damping: numbers(),
            measures_strain,
            curve,
            ..PartSprings::default()
        };
        let mut add = |own: usize, other: usize, number: usize| {
            let element = &elements[number];
            let k = stiffnesses[number];
            let reduced_mass = masses[own] * masses[other] / (masses[own] + masses[other]);
            springs.stiffness.push(k);
            springs.rest_length.push(element.rest_length);
            springs.damping.push(2.0 * damping_ratios[number] * (k * reduced_mass).sqrt());
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
        let mut border: Vec<Entry> = border.iter().map(|e| e.2).collect();
        border.sort_unstable_by_key(|&(own, other, number)| (other, own, number));
        for of_neighbour in border.chunk_by(|a, b| a.1 == b.1) {
            let neighbour = springs.neighbours.len() % NEIGHBOURS;
            springs.neighbours.push(of_neighbour[0].1 as u32);
            if neighbour == 0 {
                springs.border_groups.push(0);
            }
            if let Some(count) = springs.border_groups.last_mut() {
                *count += of_neighbour.len();
            }
            for &(own, other, number) in of_neighbour {
                springs.border.push([(own - range.start) as u16, neighbour as u16]);
                add(own, other, number);
            }
        }
        springs.scaled_damping = vec![0.0; springs.damping.len()];
        springs.shortest = springs.rest_length.iter().copied().fold(f64::INFINITY, f64::min).max(shortest);
        bytes += springs.damping.len() * (16 + 8 + 8) + springs.inner.len() * 2 + springs.border.len() * 4;
        bytes += springs.rows.len() * 2 + springs.neighbours.len() * 4 + springs.border_groups.len() * 8;
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
    rows.sort_by_key(|row| ((row[0].0 - vertices.start) / ROW_BLOCK, row.len()));
    rows
}

/// Rows of one length with what belongs to their springs.
struct Rows<'a, T> {
    vertices: &'a [u16],
    others: &'a [u16],
    stiffness: &'a [f64],
    rest_length: &'a [f64],
    damping: &'a [f64],
    scaled_damping: T,
}

impl Rows<'_, &[f64]> {
    /// Adds `c (v2 - v1)·e e` of every spring to its ends.
    fn add_damping<const N: usize>(&self, x: &[Simd4], v: &[Simd4], f: &mut [Simd4]) {
        let (x, v) = (&x[..f.len()], &v[..f.len()]);
        let rows = self.vertices.iter().zip(self.others.as_chunks::<N>().0);
        for ((i, others), scaled) in rows.zip(self.scaled_damping.as_chunks::<N>().0) {
            let i = usize::from(*i);
            let (xi, vi) = (x[i], v[i]);
            let mut sum = Simd4::ZERO;
            for n in 0..N {
                let j = usize::from(others[n]);
                let u = xi - x[j];
                let force = u * (scaled[n] * u.dot(vi - v[j]));
                sum += force;
                f[j] += force;
            }
            f[i] -= sum;
        }
    }

    /// Compares the rate of every spring with the fastest so far.
    fn compare_rates<const N: usize>(&self, x: &[Simd4], v: &[Simd4], fastest: &mut Fraction) {
        let v = &v[..x.len()];
        let rows = self.vertices.iter().zip(self.others.as_chunks::<N>().0);
        for ((i, others), rest) in rows.zip(self.rest_length.as_chunks::<N>().0) {
            let i = usize::from(*i);
            let (xi, vi) = (x[i], v[i]);
            for n in 0..N {
                let j = usize::from(others[n]);
                fastest.compare(xi - x[j], vi - v[j], rest[n]);
            }
        }
    }
}

/// The largest squared rate of relative change of length, as a fraction: most springs then need no division.
struct Fraction {
    squared: f64,
    over: f64,
    /// Springs shorter than this at rest count as this long [m].
    shortest: f64,
}

impl Fraction {
    /// Takes the rate of a spring whose ends are `u` apart and part by `change`, if it is larger.
    #[inline]
    fn compare(&mut self, u: Simd4, change: Simd4, rest: f64) {
        let along = change.dot(u);
        let rest = rest.max(self.shortest);
        let (squared, over) = (along * along, u.dot(u) * rest * rest);
        if squared * self.over > self.squared * over && over > 0.0 {
            (self.squared, self.over) = (squared, over);
        }
    }
}

impl Rows<'_, &mut [f64]> {
    /// Adds the tension of every spring to its ends and keeps c / l².
    fn update<const N: usize>(&mut self, curve: Option<&TensileCurve>, x: &[Simd4], f: &mut [Simd4]) {
        let x = &x[..f.len()];
        let others = self.others.as_chunks::<N>().0;
        let spans = self.vertices.chunks(SPAN).zip(others.chunks(SPAN)).enumerate();
        for (span, (vertices, others)) in spans {
            let mut pulls = [[0.0; N]; SPAN];
            for ((i, others), squared) in vertices.iter().zip(others).zip(&mut pulls) {
                let xi = x[usize::from(*i)];
                for n in 0..N {
                    let u = xi - x[usize::from(others[n])];
                    squared[n] = u.dot(u);
                }
            }
            let first = span * SPAN * N;
            let springs = first..first + vertices.len() * N;
            pull(
                &mut pulls.as_flattened_mut()[..springs.len()],
                &self.stiffness[springs.clone()],
                &self.rest_length[springs.clone()],
                &self.damping[springs.clone()],
                &mut self.scaled_damping[springs.clone()],
            );
            if let Some(curve) = curve {
                stiffen(curve, &mut pulls.as_flattened_mut()[..springs.len()], &self.stiffness[springs]);
            }
            for ((i, others), pulls) in vertices.iter().zip(others).zip(&pulls) {
                let i = usize::from(*i);
                let xi = x[i];
                let mut sum = Simd4::ZERO;
                for n in 0..N {
                    let j = usize::from(others[n]);
                    let force = (xi - x[j]) * pulls[n];
                    sum += force;
                    f[j] += force;
                }
                f[i] -= sum;
            }
        }
    }
}

/// Copies what belongs to these vertices.
#[inline]
fn fetch(vertices: &[u32], from: &[Vec3]) -> [Simd4; NEIGHBOURS] {
    std::array::from_fn(|n| vertices.get(n).map_or(Simd4::ZERO, |v| Simd4::from(&from[*v as usize])))
}

/// Turns squared lengths into tensions over length [N/m], and c into c / l²; several springs share the time of a root and
/// a division.
fn pull(lengths: &mut [f64], stiffness: &[f64], rest: &[f64], damping: &[f64], scaled: &mut [f64]) {
    let springs = lengths.iter_mut().zip(stiffness.iter().zip(rest)).zip(damping.iter().zip(scaled));
    for ((length, (k, rest)), (c, scaled)) in springs {
        let squared = *length;
        // Coinciding ends have no direction to pull along.
        let inverse = if squared > 0.0 { 1.0 / squared } else { 0.0 };
        // k (l - l0) / l, without a second division.
        *length = k * (1.0 - rest * (squared.sqrt() * inverse));
        *scaled = c * inverse;
    }
}

/// Takes springs that are pulled from the tension of linear ones over length [N/m] to that of the curve.
fn stiffen(curve: &TensileCurve, pulls: &mut [f64], stiffness: &[f64]) {
    for (pull, k) in pulls.iter_mut().zip(stiffness) {
        // k (l − l0) / l says the strain. Ends that coincide pull along nothing, with k.
        if *pull > 0.0 && *pull < *k {
            let share = *pull / k;
            *pull *= curve.factor(share / (1.0 - share));
        }
    }
}

/// Springs of a span on their way into the matrix of an implicit step.
#[derive(Default)]
struct SpanBlocks {
    /// From one end to the other [m], then the same as a unit vector.
    apart: [[f64; SPAN]; 3],
    stiffness: [f64; SPAN],
    rest_length: [f64; SPAN],
    damping: [f64; SPAN],
    length: [f64; SPAN],
    /// Components of the blocks along the springs and across them.
    along: [f64; SPAN],
    across: [f64; SPAN],
}

impl SpanBlocks {
    /// Takes a spring, whose ends are `apart` [m], in the place `n`. Behind the last one others stay, which nobody asks for.
    #[inline]
    fn take(&mut self, n: usize, apart: &Vec3, [stiffness, rest_length, damping]: [f64; 3]) {
        (0..3).for_each(|axis| self.apart[axis][n] = apart[axis]);
        (self.stiffness[n], self.rest_length[n], self.damping[n]) = (stiffness, rest_length, damping);
    }

    /// Turns them into what linear springs bring; several share the time of a root and a division.
    fn find(&mut self, factors: BlockFactors) {
        for n in 0..SPAN {
            let [x, y, z] = [0, 1, 2].map(|axis| self.apart[axis][n]);
            let length = (x * x + y * y + z * z).sqrt();
            // Coinciding ends have no direction.
            let (inverse, stiffness, damping) =
                if length > 0.0 { (1.0 / length, self.stiffness[n], self.damping[n]) } else { (0.0, 0.0, 0.0) };
            // Compressed springs push sideways: that part is negative, and left out.
            self.across[n] = factors.stiffness * stiffness * (1.0 - self.rest_length[n] * inverse).max(0.0);
            self.along[n] = factors.stiffness * stiffness + factors.damping * damping;
            self.length[n] = length;
            (0..3).for_each(|axis| self.apart[axis][n] *= inverse);
        }
    }

    /// Takes those that are pulled from linear springs to ones with this curve.
    fn stiffen(&mut self, curve: &TensileCurve, factors: BlockFactors) {
        for n in 0..SPAN {
            if self.across[n] > 0.0 {
                let strain = self.length[n] / self.rest_length[n] - 1.0;
                self.across[n] *= curve.factor(strain);
                self.along[n] += factors.stiffness * self.stiffness[n] * curve.rise(strain);
            }
        }
    }

    /// Adds the first of them to the blocks at these places.
    fn add(&self, slots: &[Slot], rows: &mut PartBlocks) {
        for (n, slot) in slots.iter().enumerate() {
            let direction = Vec3::from(std::array::from_fn(|axis| self.apart[axis][n]));
            rows.add_spring(*slot, &direction, self.along[n], self.across[n]);
        }
    }
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
                stiffness: &self.stiffness[springs.clone()],
                rest_length: &self.rest_length[springs.clone()],
                damping: &self.damping[springs.clone()],
                scaled_damping: &self.scaled_damping[springs],
            };
            (group.length, rows)
        })
    }

    /// The groups of border springs: which they are, and the neighbours that they are numbered by.
    fn border_groups(&self) -> impl Iterator<Item = (std::ops::Range<usize>, &[u32])> {
        let mut last = 0;
        self.border_groups.iter().zip(self.neighbours.chunks(NEIGHBOURS)).map(move |(count, neighbours)| {
            last += count;
            (last - count..last, neighbours)
        })
    }

    /// Every spring as (own end, other end, number, whether it crosses the border), ends in solver order.
    fn ends(&self) -> impl Iterator<Item = (usize, usize, usize, bool)> + '_ {
        let lengths = self.groups.iter().flat_map(|group| std::iter::repeat_n(group.length, group.count));
        let own = self.rows.iter().zip(lengths).flat_map(|(row, length)| std::iter::repeat_n(*row, length));
        let inner = own.zip(&self.inner).enumerate();
        let first = self.inner.len();
        let border = self.border_groups().flat_map(move |(springs, neighbours)| {
            springs.map(move |b| (self.border[b][0], neighbours[usize::from(self.border[b][1])], b))
        });
        inner
            .map(move |(s, (i, j))| (self.start + usize::from(i), self.start + usize::from(*j), s, false))
            .chain(border.map(move |(i, j, b)| (self.start + usize::from(i), j as usize, first + b, true)))
    }
}

impl Force for PartSprings {
    fn neighbours(&self) -> &[u32] {
        &self.neighbours
    }

    fn update(&mut self, view: &PartView<'_>, own: &[Simd4], f: &mut [Simd4]) {
        let (mut row, mut spring) = (0, 0);
        let curve = self.curve.as_ref();
        for group in &self.groups {
            let (rows, springs) = (row..row + group.count, spring..spring + group.count * group.length);
            (row, spring) = (rows.end, springs.end);
            let mut rows = Rows {
                vertices: &self.rows[rows],
                others: &self.inner[springs.clone()],
                stiffness: &self.stiffness[springs.clone()],
                rest_length: &self.rest_length[springs.clone()],
                damping: &self.damping[springs.clone()],
                scaled_damping: &mut self.scaled_damping[springs],
            };
            match group.length {
                1 => rows.update::<1>(curve, own, f),
                2 => rows.update::<2>(curve, own, f),
                3 => rows.update::<3>(curve, own, f),
                _ => rows.update::<ROW>(curve, own, f),
            }
        }
        let first = self.inner.len();
        let mut scaled = std::mem::take(&mut self.scaled_damping);
        for (springs, neighbours) in self.border_groups() {
            let x = fetch(neighbours, view.x);
            for b in springs {
                let [i, j] = self.border[b].map(usize::from);
                let u = x[j % NEIGHBOURS] - own[i];
                let (spring, mut length) = (first + b..first + b + 1, [u.dot(u)]);
                let [stiffness, rest, damping] =
                    [&self.stiffness, &self.rest_length, &self.damping].map(|all| &all[spring.clone()]);
                pull(&mut length, stiffness, rest, damping, &mut scaled[spring]);
                if let Some(curve) = curve {
                    stiffen(curve, &mut length, stiffness);
                }
                f[i] += u * length[0];
            }
        }
        self.scaled_damping = scaled;
    }

    fn add_damping(&self, motion: &PartMotion<'_>, f: &mut [Simd4]) {
        let (x, v) = (motion.own_x, motion.own_v);
        for (length, rows) in self.row_groups() {
            match length {
                1 => rows.add_damping::<1>(x, v, f),
                2 => rows.add_damping::<2>(x, v, f),
                3 => rows.add_damping::<3>(x, v, f),
                _ => rows.add_damping::<ROW>(x, v, f),
            }
        }
        let scaled = &self.scaled_damping[self.inner.len()..];
        for (springs, neighbours) in self.border_groups() {
            let (far_x, far_v) = (fetch(neighbours, motion.x), fetch(neighbours, motion.v));
            for ([i, j], scaled) in self.border[springs.clone()].iter().zip(&scaled[springs]) {
                let (i, j) = (usize::from(*i), usize::from(*j) % NEIGHBOURS);
                let u = x[i] - far_x[j];
                f[i] -= u * (scaled * u.dot(v[i] - far_v[j]));
            }
        }
    }

    fn add_stiffness(&self, sums: &mut [f64]) {
        for (i, j, s, across) in self.ends() {
            sums[i - self.start] += self.stiffness[s];
            if !across {
                sums[j - self.start] += self.stiffness[s];
            }
        }
    }

    fn energy(&self, view: &PartView<'_>) -> f64 {
        let energy = |(i, j, s, across): (usize, usize, usize, bool)| {
            let (k, rest) = (self.stiffness[s], self.rest_length[s]);
            let stretch = (view.x[j] - view.x[i]).norm() - rest;
            let stiffened = self.curve.as_ref().map_or(0.0, |curve| curve.extra_energy(stretch / rest) * rest * rest);
            (0.5 * k * stretch * stretch + k * stiffened) * if across { 0.5 } else { 1.0 }
        };
        self.ends().map(energy).sum()
    }

    fn linearised(&self) -> Option<&dyn Linearised> {
        Some(self)
    }

    fn strained(&self) -> Option<&dyn Strained> {
        Some(self)
    }
}

impl Linearised for PartSprings {
    fn visit_elements(&self, visit: &mut dyn FnMut(&[u32])) {
        self.ends().for_each(|(i, j, ..)| visit(&[i as u32, j as u32]));
    }

    fn add_blocks(&self, view: &PartView<'_>, factors: BlockFactors, slots: &[Slot], rows: &mut PartBlocks) {
        let mut span = SpanBlocks::default();
        self.ends().for_each(|(i, j, s, _)| {
            let n = s % SPAN;
            let constants = [self.stiffness[s], self.rest_length[s], self.damping[s]];
            span.take(n, &(view.x[j] - view.x[i]), constants);
            if n + 1 == SPAN || s + 1 == slots.len() {
                span.find(factors);
                if let Some(curve) = &self.curve {
                    span.stiffen(curve, factors);
                }
                span.add(&slots[s - n..=s], rows);
            }
        });
    }
}

impl Strained for PartSprings {
    fn strain_rate_bound(&self, part: std::ops::Range<usize>, v: &[Vec3]) -> f64 {
        // Two ends differ by no more than twice what any vertex differs from the first.
        let reference = Simd4::from(&v[self.start]);
        let squared = |v: &Vec3| {
            let from_reference = Simd4::from(v) - reference;
            from_reference.dot(from_reference)
        };
        let own = v[part].iter().map(squared).fold(0.0, f64::max);
        let all = self.neighbours.iter().map(|j| squared(&v[*j as usize])).fold(own, f64::max);
        2.0 * all.sqrt() / self.shortest
    }

    fn strain_rate(&self, motion: &PartMotion<'_>) -> f64 {
        let (x, v) = (motion.own_x, motion.own_v);
        let mut fastest = Fraction { squared: 0.0, over: 1.0, shortest: self.shortest };
        for (length, rows) in self.row_groups() {
            match length {
                1 => rows.compare_rates::<1>(x, v, &mut fastest),
                2 => rows.compare_rates::<2>(x, v, &mut fastest),
                3 => rows.compare_rates::<3>(x, v, &mut fastest),
                _ => rows.compare_rates::<ROW>(x, v, &mut fastest),
            }
        }
        let rest_length = &self.rest_length[self.inner.len()..];
        for (springs, neighbours) in self.border_groups() {
            let (far_x, far_v) = (fetch(neighbours, motion.x), fetch(neighbours, motion.v));
            for ([i, j], rest) in self.border[springs.clone()].iter().zip(&rest_length[springs]) {
                let (i, j) = (usize::from(*i), usize::from(*j) % NEIGHBOURS);
                fastest.compare(x[i] - far_x[j], v[i] - far_v[j], *rest);
            }
        }
        (fastest.squared / fastest.over).sqrt()
    }

    fn largest_strain(&self, x: &[Vec3]) -> Option<(f64, [usize; 2])> {
        if !self.measures_strain {
            return None;
        }
        let strain =
            |(i, j, s, _): (usize, usize, usize, bool)| ((x[j] - x[i]).norm() / self.rest_length[s] - 1.0, [i, j]);
        self.ends().map(strain).max_by(|a, b| a.0.total_cmp(&b.0))
    }
}
