//! The hinges of one part: those that have one of its vertices, and those around whose angles their moments depend on.

use std::ops::Range;

use super::Yield;
use super::elements::{Element, Shape};
use crate::Vec3;
use crate::block_matrix::{PartBlocks, Slot};
use crate::effects::force::{BlockFactors, Force, PartForce, PartMotion, PartView};
use crate::parallel::simd4::Simd4;
use crate::scene::Scene;
use crate::snapshot::saved_section::ElementRows;
use crate::tolerances::SQUASHED;

/// How the angle of a hinge changes with its vertices [rad/m]: `u₁` at the first opposite vertex, `u₂` at the second,
/// `p u₁ + q u₂` and `−(1 + p) u₁ − (1 + q) u₂` at the ends of the edge, as in Bridson, Marino and Fedkiw 2003.
#[derive(Debug, Clone, Copy, Default)]
struct Gradient {
    u: [Vec3; 2],
    p: f64,
    q: f64,
}

impl Gradient {
    /// The gradient of this shape. Zero if a triangle has no area.
    #[inline]
    fn of(Shape { edge, length, normals: [n1, n2], opposite: [i, l] }: &Shape) -> Self {
        let squared = [n1.norm_squared(), n2.norm_squared()];
        if *length == 0.0 || squared.contains(&0.0) {
            return Self::default();
        }
        let along = |to: &Vec3| to.dot(edge) / (length * length);
        let u = [n1 * (length / squared[0]), n2 * (length / squared[1])];
        Self { u, p: along(i), q: along(l) }
    }

    /// The gradient at each of the four vertices [rad/m].
    fn at_vertices(&self) -> [Vec3; 4] {
        let [u1, u2] = self.u;
        [u1, u1 * self.p + u2 * self.q, u1 * -(1.0 + self.p) - u2 * (1.0 + self.q), u2]
    }

    /// Rate of the angle [rad/s] with these velocities of the vertices [m/s].
    fn rate(&self, [i, j, k, l]: [Vec3; 4]) -> f64 {
        let turning = k - j;
        self.u[0].dot(&(i - k - turning * self.p)) + self.u[1].dot(&(l - k - turning * self.q))
    }
}

/// What holds for each hinge of a garment beside its moments.
#[derive(Debug)]
pub(super) struct Laws {
    /// Damping of each angle as a fraction of critical.
    pub(super) damping_ratios: Vec<f64>,
    /// How sharp folds of each stay, if they do.
    pub(super) yields: Option<Vec<Yield>>,
}

/// A hinge of a part.
#[derive(Debug)]
struct Hinge {
    /// Local vertices.
    vertices: [u32; 4],
    rest_angle: f64,
    /// Heights below which a triangle is too flat [m].
    least_heights: [f64; 2],
}

/// Where a hinge that can yield began, and what it has come to.
#[derive(Debug, Clone, Copy)]
struct Fold {
    /// Rest angle of the rest shape [rad].
    first_angle: f64,
    /// Angle off its rest at which it yields [rad].
    yield_angle: f64,
    /// Growth of the yield angle by what was exceeded.
    hardening: f64,
    /// Largest change of the angle at rest [rad].
    largest: f64,
    has_yielded: bool,
}

/// The hinges of one part.
#[derive(Debug, Default)]
struct PartHinges {
    /// Vertices of the part.
    range: Range<usize>,
    /// Hinges with a vertex of the part, then those whose angles alone matter.
    hinges: Vec<Hinge>,
    /// End of the moments of each hinge of the part.
    rows: Vec<u32>,
    /// Hinge, and moment per angle [N·m per rad].
    moments: Vec<(u32, f64)>,
    /// Damping of the angle of each hinge of the part [N·m·s].
    damping: Vec<f64>,
    /// Stiffness that counts for the time step, of each vertex [N/m].
    stiffness: Vec<f64>,
    neighbours: Vec<u32>,
    /// At the last update: by how much each angle is off [rad].
    angles: Vec<f64>,
    /// At the last update, for each hinge of the part; zero where it is left out.
    gradients: Vec<Gradient>,
    /// Where the blocks of each hinge of the part are in the matrix of the implicit step; empty in the others.
    slots: Vec<[Slot; 6]>,
    /// For each hinge, where folds stay; empty where they do not.
    folds: Vec<Fold>,
    /// Hinges that were left out, and that yielded, since they were last asked for.
    left_out: u64,
    yielded: u64,
}

/// Sorts the hinges of a garment into its parts.
pub(super) fn build(scene: &Scene, garment: usize, elements: &[Element], laws: &Laws) -> (Vec<PartForce>, usize) {
    let parts = scene.parts();
    let first = parts.garment(garment).start as u32;
    let part_of = |vertex: u32| parts.own().contains(&(vertex as usize)).then(|| parts.part_of(vertex as usize));
    let mut entries: Vec<(usize, u32)> = Vec::with_capacity(elements.len() * 9 / 8);
    for (number, element) in elements.iter().enumerate() {
        let mut of = element.vertices.map(|v| part_of(first + v));
        of.sort_unstable();
        entries.extend(
            of.iter()
                .enumerate()
                .filter(|(n, part)| *n == 0 || of[n - 1] != **part)
                .filter_map(|(_, part)| part.map(|part| (part, number as u32))),
        );
    }
    entries.sort_unstable();
    let (mut built, mut bytes): (Vec<PartForce>, usize) = (Vec::new(), 0);
    for group in entries.chunk_by(|a, b| a.0 == b.0) {
        let own: Vec<u32> = group.iter().map(|(_, number)| *number).collect();
        let range = parts.ranges()[group[0].0].clone();
        let part = PartHinges::new(scene, first, range, elements, &own, laws);
        bytes += part.bytes();
        built.push((group[0].0, Box::new(part)));
    }
    (built, bytes)
}

impl PartHinges {
    /// The hinges `own` of the part with these vertices, and those around them.
    fn new(scene: &Scene, first: u32, range: Range<usize>, elements: &[Element], own: &[u32], laws: &Laws) -> Self {
        let mut around: Vec<u32> =
            own.iter().flat_map(|n| elements[*n as usize].row.iter().map(|(other, _)| *other)).collect();
        around.sort_unstable();
        around.dedup();
        around.retain(|number| own.binary_search(number).is_err());
        let mut part = Self { range: range.clone(), stiffness: vec![0.0; range.len()], ..Self::default() };
        let place = |number: u32| match own.binary_search(&number) {
            Ok(place) => place as u32,
            Err(_) => (own.len() + around.partition_point(|other| *other < number)) as u32,
        };
        let mesh = scene.meshes()[scene.parts().garment_of(range.start)].rest_positions();
        let shape = |number: u32| Shape::at(elements[number as usize].vertices.map(|v| mesh[v as usize]));
        let gradient = |number: u32| Gradient::of(&shape(number));
        for number in own.iter().chain(&around) {
            let element = &elements[*number as usize];
            let heights = shape(*number).heights();
            let least_heights = heights.map(|height| SQUASHED * height);
            if let Some(yields) = &laws.yields {
                let Yield { radius, hardening, largest } = yields[*number as usize];
                let yield_angle = 0.5 * (heights[0] + heights[1]) / radius;
                let first_angle = element.rest_angle;
                part.folds.push(Fold { first_angle, yield_angle, hardening, largest, has_yielded: false });
            }
            let vertices = element.vertices.map(|v| first + v);
            part.hinges.push(Hinge { vertices, rest_angle: element.rest_angle, least_heights });
        }
        for number in own {
            let element = &elements[*number as usize];
            part.moments.extend(element.row.iter().map(|(other, moment)| (place(*other), *moment)));
            part.rows.push(part.moments.len() as u32);
            let vectors = gradient(*number).at_vertices();
            part.add_to_stiffness(element, first, vectors, &|other| gradient(other).at_vertices());
            let masses = element.vertices.map(|v| scene.masses()[(first + v) as usize]);
            let softness: f64 = vectors.iter().zip(masses).map(|(u, m)| u.norm_squared() / m).sum();
            part.damping.push(2.0 * laws.damping_ratios[*number as usize] * (element.row[0].1 / softness).sqrt());
        }
        let outside = part.hinges.iter().flat_map(|hinge| hinge.vertices).filter(|v| !range.contains(&(*v as usize)));
        part.neighbours = outside.collect();
        part.neighbours.sort_unstable();
        part.neighbours.dedup();
        part.angles = vec![0.0; part.hinges.len()];
        part.gradients = vec![Gradient::default(); own.len()];
        part
    }

    /// Adds the row sums of the stiffness matrix to the vertices of the part. A spring of stiffness k counts as k at both ends and
    /// has row sums of 2 k, hence the half.
    fn add_to_stiffness(
        &mut self,
        element: &Element,
        first: u32,
        vectors: [Vec3; 4],
        vectors_of: &dyn Fn(u32) -> [Vec3; 4],
    ) {
        let lengths = |vectors: [Vec3; 4]| vectors.iter().map(Vec3::norm).sum::<f64>();
        let moment: f64 = element.row.iter().map(|(other, moment)| moment.abs() * lengths(vectors_of(*other))).sum();
        for (v, u) in element.vertices.iter().zip(vectors) {
            if let Some(place) = self.index_of((first + v) as usize) {
                self.stiffness[place] += 0.5 * u.norm() * moment;
            }
        }
    }

    /// Place of a local vertex in the part.
    fn index_of(&self, vertex: usize) -> Option<usize> {
        self.range.contains(&vertex).then(|| vertex - self.range.start)
    }

    fn bytes(&self) -> usize {
        self.hinges.len() * (size_of::<Hinge>() + 8)
            + self.moments.len() * size_of::<(u32, f64)>()
            + self.gradients.len() * (size_of::<Gradient>() + 8 + 4)
            + self.stiffness.len() * 8
            + self.neighbours.len() * 4
            + self.folds.len() * size_of::<Fold>()
    }

    /// Whether a hinge counts here: at the part that has its first vertex.
    fn counts(&self, hinge: usize) -> bool {
        self.hinges[hinge].vertices.iter().min().is_some_and(|first| self.index_of(*first as usize).is_some())
    }

    /// Moment of a hinge of the part [N·m].
    fn moment(&self, hinge: usize, angle: impl Fn(usize) -> f64) -> f64 {
        let start = if hinge == 0 { 0 } else { self.rows[hinge - 1] };
        let row = &self.moments[start as usize..self.rows[hinge] as usize];
        row.iter().map(|(other, moment)| moment * angle(*other as usize)).sum()
    }

    /// Adds a pull along the gradient of a hinge to the part's own vertices.
    #[inline]
    fn pull(&self, hinge: usize, pull: f64, f: &mut [Simd4]) {
        let Gradient { u: [u1, u2], p, q } = &self.gradients[hinge];
        let [a, b] = [Simd4::from(u1) * pull, Simd4::from(u2) * pull];
        let toward = a * *p + b * *q;
        for (vertex, force) in self.hinges[hinge].vertices.iter().zip([a, toward, toward * -1.0 - a - b, b]) {
            let place = (*vertex as usize).wrapping_sub(self.range.start);
            if let Some(f) = f.get_mut(place) {
                *f += force;
            }
        }
    }
}

/// What the hinge is off its angle at rest [rad], and its gradient; nothing where a triangle is squashed.
#[inline]
fn bent(hinge: &Hinge, x: &[Vec3]) -> (f64, Gradient) {
    let shape = Shape::at(hinge.vertices.map(|v| x[v as usize]));
    let is_flat = |(normal, least): (&Vec3, f64)| normal.norm_squared() <= (least * shape.length).powi(2);
    if shape.normals.iter().zip(hinge.least_heights).any(is_flat) {
        return (0.0, Gradient::default());
    }
    (shape.angle() - hinge.rest_angle, Gradient::of(&shape))
}

impl Force for PartHinges {
    fn neighbours(&self) -> &[u32] {
        &self.neighbours
    }

    fn update(&mut self, view: &PartView<'_>, _own: &[Simd4], f: &mut [Simd4]) {
        for (n, hinge) in self.hinges.iter().enumerate() {
            let (angle, gradient) = bent(hinge, view.x);
            self.angles[n] = angle;
            if let Some(kept) = self.gradients.get_mut(n) {
                *kept = gradient;
            }
        }
        let is_out = |hinge: &usize| self.gradients[*hinge].u[0] == Vec3::zeros() && self.counts(*hinge);
        self.left_out += (0..self.gradients.len()).filter(is_out).count() as u64;
        for hinge in 0..self.gradients.len() {
            self.pull(hinge, -self.moment(hinge, |other| self.angles[other]), f);
        }
    }

    fn visit_elements(&self, visit: &mut dyn FnMut(&[u32])) {
        self.hinges[..self.gradients.len()].iter().for_each(|hinge| visit(&hinge.vertices));
    }

    fn find_blocks(&mut self, rows: &PartBlocks) {
        self.slots = self.hinges[..self.gradients.len()].iter().map(|hinge| rows.slots(&hinge.vertices)).collect();
    }

    fn add_blocks(&self, _: &PartView<'_>, factors: BlockFactors, rows: &mut PartBlocks) {
        for (n, (gradient, slots)) in self.gradients.iter().zip(&self.slots).enumerate() {
            // Moments of neighbouring angles would couple vertices two edges away; the sum of their sizes on the diagonal is
            // never less (Gershgorin), and an element keeps to its four vertices. How the gradient turns is left out: it has
            // either sign.
            let start = if n == 0 { 0 } else { self.rows[n - 1] };
            let row = &self.moments[start as usize..self.rows[n] as usize];
            let stiffness: f64 = row.iter().map(|(_, moment)| moment.abs()).sum();
            let scale = factors.stiffness * stiffness + factors.damping * self.damping[n];
            rows.add_outer(slots, scale, &gradient.at_vertices());
        }
    }

    fn has_blocks(&self) -> bool {
        true
    }

    fn add_damping(&self, motion: &PartMotion<'_>, f: &mut [Simd4]) {
        for (n, (gradient, damping)) in self.gradients.iter().zip(&self.damping).enumerate() {
            let velocities = self.hinges[n].vertices.map(|v| motion.v[v as usize]);
            self.pull(n, -damping * gradient.rate(velocities), f);
        }
    }

    fn add_stiffness(&self, sums: &mut [f64]) {
        sums.iter_mut().zip(&self.stiffness).for_each(|(sum, own)| *sum += own);
    }

    fn energy(&self, view: &PartView<'_>) -> f64 {
        let angle = |hinge: usize| bent(&self.hinges[hinge], view.x).0;
        let own = |n: usize| self.hinges[n].vertices.iter().filter(|v| self.index_of(**v as usize).is_some()).count();
        // Half of angle times moment, of which each of the four vertices brings a quarter.
        let quarter = |n: usize| 0.125 * own(n) as f64 * angle(n) * self.moment(n, angle);
        (0..self.gradients.len()).map(quarter).sum()
    }

    fn take_counts(&mut self, count: &mut dyn FnMut(&'static str, u64)) {
        count("hinges_left_out", std::mem::take(&mut self.left_out));
        if !self.folds.is_empty() {
            count("hinges_yielded", std::mem::take(&mut self.yielded));
        }
    }

    fn update_plasticity(&mut self, x: &[Vec3]) {
        for n in 0..self.folds.len() {
            let (hinge, fold) = (&mut self.hinges[n], &mut self.folds[n]);
            let (off, _) = bent(hinge, x);
            let beyond = off.abs() - fold.yield_angle;
            if beyond <= 0.0 {
                continue;
            }
            let kept = hinge.rest_angle + beyond.copysign(off) - fold.first_angle;
            hinge.rest_angle = fold.first_angle + kept.clamp(-fold.largest, fold.largest);
            fold.yield_angle += fold.hardening * beyond;
            fold.has_yielded = true;
            self.yielded += u64::from(self.counts(n));
        }
    }

    fn save_elements(&self, rows: &mut ElementRows) {
        for (n, fold) in self.folds.iter().enumerate().filter(|(n, fold)| fold.has_yielded && self.counts(*n)) {
            rows.push(&self.hinges[n].vertices, &[self.hinges[n].rest_angle, fold.yield_angle]);
        }
    }

    fn restore_elements(&mut self, rows: &ElementRows) {
        let mut known: Vec<(Vec<u32>, &[f64])> = rows.iter().collect();
        known.sort_unstable_by(|a, b| a.0.cmp(&b.0));
        for (hinge, fold) in self.hinges.iter_mut().zip(&mut self.folds) {
            if let Ok(row) = known.binary_search_by(|(vertices, _)| vertices[..].cmp(&hinge.vertices)) {
                (hinge.rest_angle, fold.yield_angle) = (known[row].1[0], known[row].1[1]);
                fold.has_yielded = true;
            }
        }
    }
}
