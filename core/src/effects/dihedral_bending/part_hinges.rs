//! The hinges of one part: those that have one of its vertices, and those around whose angles their moments depend on.
//!
//! Shapes are computed for a span of hinges at a time, number by number, so that processors work on several hinges at once;
//! products of the gradients take a hinge at a time, with whole vectors. Both do the same with every hinge, so that one across a
//! border has the same bits at all of its parts.

use std::collections::VecDeque;
use std::ops::Range;

use super::Yield;
use super::elements::{Element, Shape};
use crate::Vec3;
use crate::block_matrix::{PartBlocks, Slot};
use crate::effects::force::{BlockFactors, Force, Linearised, PartForce, PartMotion, PartView, Plastic};
use crate::elements::corners;
use crate::parallel::parts::PART_SIZE;
use crate::parallel::simd4::Simd4;
use crate::scene::Scene;
use crate::snapshot::elements::ElementRows;
use crate::tolerances::SQUASHED;

/// Hinges whose shapes are computed together.
const SPAN: usize = 16;

/// Angles that a moment depends on beside the hinge's own: those at the other edges of its two triangles.
const OTHERS: usize = 4;

/// Hinges inside a part that follow each other without a vertex in common.
const APART: usize = 3;

/// Number of waiting hinges that are searched for one without a vertex in common.
const AHEAD: usize = 64;

const _: () = assert!(PART_SIZE <= u16::MAX as usize, "hinges number the vertices of a part by u16");

/// Derivative of the angle of a hinge by the positions of its vertices [rad/m]: `u₁` at the first opposite vertex,
/// `u₂` at the second, `p u₁ + q u₂` and `−(1 + p) u₁ − (1 + q) u₂` at the ends of the edge, as in Bridson, Marino
/// and Fedkiw 2003.
///
/// Kept as (u₁, p) and (u₂, q).
#[derive(Debug, Clone, Copy, Default, PartialEq)]
struct Gradient([Simd4; 2]);

impl Gradient {
    /// The gradient as eight numbers; zeros if the hinge `is_out`.
    #[inline(always)]
    fn numbers(shape: &Shape, is_out: bool) -> [f64; 8] {
        let Shape { edge, length, normals: [n1, n2], opposite: [i, l] } = shape;
        let unless_out = |number: f64| if is_out { 0.0 } else { number };
        let [a, b] = [n1, n2].map(|n| unless_out(length / n.norm_squared()));
        let inverse = unless_out(1.0 / (length * length));
        let [p, q] = [i, l].map(|to| to.dot(edge) * inverse);
        [n1.x * a, n1.y * a, n1.z * a, p, n2.x * b, n2.y * b, n2.z * b, q]
    }

    #[inline(always)]
    fn new([x1, y1, z1, p, x2, y2, z2, q]: [f64; 8]) -> Self {
        Self([Simd4::new([x1, y1, z1, p]), Simd4::new([x2, y2, z2, q])])
    }

    /// Whether the hinge was left out.
    fn is_zero(&self) -> bool {
        *self == Self::default()
    }

    /// `factor` times the gradient at each of the four vertices [rad/m].
    #[inline(always)]
    fn at_vertices(&self, factor: f64) -> [Simd4; 4] {
        let Self([u1, u2]) = self;
        // p and q are in the fourth lanes, which have to be zero in what leaves.
        let factors = Simd4::new([factor, factor, factor, 0.0]);
        let [a, b] = [u1.component_mul(factors), u2.component_mul(factors)];
        let toward = a.mul_add(u1.last(), b.component_mul(u2.last()));
        [a, toward, Simd4::ZERO - (toward + (a + b)), b]
    }

    /// Rate of the angle [rad/s] with these velocities of the vertices [m/s].
    #[inline(always)]
    fn rate(&self, [i, j, k, l]: [Simd4; 4]) -> f64 {
        let Self([u1, u2]) = self;
        let turning = j - k;
        let [a, b] = [(u1, i), (u2, l)].map(|(u, v)| turning.mul_add(u.last(), v - k));
        u1.mul_add(a, u2.component_mul(b)).sum()
    }
}

/// Returns the difference of the angle of a hinge from its angle at rest [rad], and its gradient as numbers; both are
/// zero where a triangle is not higher than its least height [m].
#[inline(always)]
fn bent(shape: &Shape, rest_angle: f64, least_heights: [f64; 2]) -> (f64, [f64; 8]) {
    let squared_length = shape.length * shape.length;
    let is_flat = |side: usize| shape.normals[side].norm_squared() <= least_heights[side].powi(2) * squared_length;
    let is_out = is_flat(0) | is_flat(1);
    let off = shape.angle() - rest_angle;
    (if is_out { 0.0 } else { off }, Gradient::numbers(shape, is_out))
}

/// One number of each hinge of a span.
type Span = [f64; SPAN];

/// The shapes of the hinges of a span, and what follows of them.
#[derive(Default)]
struct Bends {
    edges: [Span; 3],
    opposite: [[Span; 3]; 2],
    rest_angles: Span,
    least_heights: [Span; 2],
    /// Differences of the angles from the angles at rest [rad].
    off: Span,
    /// The numbers of gradients.
    gradients: [Span; 8],
}

impl Bends {
    /// Takes up to [`SPAN`] hinges at these positions [m]. Behind them the last ones stay, which nobody asks for.
    fn find(&mut self, hinges: &[Hinge], x: &[Vec3]) {
        for (n, hinge) in hinges[..hinges.len().min(SPAN)].iter().enumerate() {
            let [i, j, k, l] = hinge.vertices.map(|v| x[v as usize]);
            for axis in 0..3 {
                self.edges[axis][n] = k[axis] - j[axis];
                self.opposite[0][axis][n] = i[axis] - k[axis];
                self.opposite[1][axis][n] = l[axis] - k[axis];
            }
            self.rest_angles[n] = hinge.rest_angle;
            [self.least_heights[0][n], self.least_heights[1][n]] = hinge.least_heights;
        }
        for n in 0..SPAN {
            let vector = |[x, y, z]: &[Span; 3]| Vec3::new(x[n], y[n], z[n]);
            let shape = Shape::of(vector(&self.edges), [vector(&self.opposite[0]), vector(&self.opposite[1])]);
            let least_heights = [self.least_heights[0][n], self.least_heights[1][n]];
            let (off, gradient) = bent(&shape, self.rest_angles[n], least_heights);
            self.off[n] = off;
            (0..8).for_each(|number| self.gradients[number][n] = gradient[number]);
        }
    }

    /// The gradient of a hinge of the span.
    fn gradient(&self, n: usize) -> Gradient {
        Gradient::new(std::array::from_fn(|number| self.gradients[number][n]))
    }
}

/// Laws of each hinge of a garment beside its moments.
#[derive(Debug)]
pub(super) struct Laws {
    /// Damping of each angle as a fraction of critical.
    pub(super) damping_ratios: Vec<f64>,
    /// Parameters by which sharp folds of each stay, if they do.
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

impl Hinge {
    /// Returns the difference of its angle from the angle at rest [rad].
    fn off(&self, x: &[Vec3]) -> f64 {
        bent(&Shape::at(self.vertices.map(|v| x[v as usize])), self.rest_angle, self.least_heights).0
    }
}

/// Coefficients of the moment of a hinge.
#[derive(Debug)]
struct Moments {
    /// Moment per own angle [N·m per rad].
    own: f64,
    /// Moment per angle of others.
    of_others: [f64; OTHERS],
    /// Places of the others in the part; the hinge's own place where there are fewer.
    others: [u32; OTHERS],
}

impl Moments {
    /// Returns the coefficients of the element `place` of a part, which knows the places of others by their numbers.
    fn new(element: &Element, place: u32, place_of: impl Fn(u32) -> u32) -> Self {
        let [(_, own), others @ ..] = &element.row[..] else { unreachable!("a row begins with the element itself") };
        assert!(others.len() <= OTHERS, "the two triangles of a hinge have four other edges");
        let mut moments = Self { own: *own, of_others: [0.0; OTHERS], others: [place; OTHERS] };
        for (n, (other, moment)) in others.iter().enumerate() {
            (moments.others[n], moments.of_others[n]) = (place_of(*other), *moment);
        }
        moments
    }

    /// The moment of the hinge `place` [N·m] at these angles [rad].
    #[inline]
    fn moment(&self, place: usize, angle: impl Fn(usize) -> f64) -> f64 {
        let others = self.others.iter().zip(&self.of_others);
        others.fold(self.own * angle(place), |sum, (other, moment)| sum + moment * angle(*other as usize))
    }

    /// The sum of their sizes [N·m per rad].
    fn size(&self) -> f64 {
        self.of_others.iter().fold(self.own.abs(), |sum, moment| sum + moment.abs())
    }
}

/// Initial and present state of a hinge that can yield.
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
    /// Hinges inside the part, then those across its border, then those whose angles alone matter.
    hinges: Vec<Hinge>,
    /// Vertices of those inside, counted from the part's first.
    inside: Vec<[u16; 4]>,
    /// Coefficients of the moment of each hinge of the part.
    moments: Vec<Moments>,
    /// Damping of the angle of each hinge of the part [N·m·s].
    damping: Vec<f64>,
    /// Stiffness that counts for the time step, of each vertex [N/m].
    stiffness: Vec<f64>,
    neighbours: Vec<u32>,
    /// At the last update: by how much each angle is off [rad].
    angles: Vec<f64>,
    /// At the last update, for each hinge of the part; zero where it is left out.
    gradients: Vec<Gradient>,
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
    let entries = corners::by_part(parts, elements.iter().map(|e| e.vertices.map(|v| (first + v) as usize)));
    let (mut built, mut bytes): (Vec<PartForce>, usize) = (Vec::new(), 0);
    for group in entries.chunk_by(|a, b| a.0 == b.0) {
        let own: Vec<u32> = group.iter().map(|(_, number)| *number as u32).collect();
        let range = parts.ranges()[group[0].0].clone();
        let part = PartHinges::new(scene, first, range, elements, own, laws);
        bytes += part.bytes();
        built.push((group[0].0, Box::new(part)));
    }
    (built, bytes)
}

/// Hinges in an order in which those that share a vertex do not follow each other closely, where there is a choice: the sums of
/// their vertices then need not wait for each other.
pub(super) fn spread(numbers: Vec<u32>, vertices_of: impl Fn(u32) -> [u32; 4]) -> Vec<u32> {
    let mut waiting: VecDeque<u32> = numbers.into();
    let mut spread: Vec<u32> = Vec::with_capacity(waiting.len());
    while !waiting.is_empty() {
        let last = &spread[spread.len().saturating_sub(APART)..];
        let meets = |a: u32, b: u32| vertices_of(a).iter().any(|v| vertices_of(b).contains(v));
        let is_free = |number: &u32| !last.iter().any(|other| meets(*number, *other));
        let next = waiting.iter().take(AHEAD).position(is_free).unwrap_or(0);
        spread.extend(waiting.remove(next));
    }
    spread
}

impl PartHinges {
    /// The hinges `own` of the part with these vertices, and those around them.
    fn new(scene: &Scene, first: u32, range: Range<usize>, elements: &[Element], own: Vec<u32>, laws: &Laws) -> Self {
        // Which of its vertices are the part's own.
        let own_vertices =
            |number: u32| elements[number as usize].vertices.map(|v| range.contains(&((first + v) as usize)));
        let (inside, mut across): (Vec<u32>, Vec<u32>) =
            own.iter().partition(|number| own_vertices(**number) == [true; 4]);
        let inside = spread(inside, |number| elements[number as usize].vertices);
        // Processors foresee what comes again and again.
        across.sort_by_key(|number| own_vertices(*number));
        let mut around: Vec<u32> =
            own.iter().flat_map(|n| elements[*n as usize].row.iter().map(|(other, _)| *other)).collect();
        around.sort_unstable();
        around.dedup();
        around.retain(|number| own.binary_search(number).is_err());
        let numbers = [inside.as_slice(), &across, &around].concat();
        let mut places: Vec<(u32, u32)> = numbers.iter().copied().zip(0..).collect();
        places.sort_unstable();
        let place_of = |number: u32| places[places.partition_point(|(other, _)| *other < number)].1;
        let mut part = Self {
            range: range.clone(),
            stiffness: vec![0.0; range.len()],
            hinges: Vec::with_capacity(numbers.len()),
            moments: Vec::with_capacity(own.len()),
            damping: Vec::with_capacity(own.len()),
            ..Self::default()
        };
        let mesh = scene.meshes()[scene.parts().garment_of(range.start)].rest_positions();
        let shape = |number: u32| Shape::at(elements[number as usize].vertices.map(|v| mesh[v as usize]));
        let gradient =
            |number: u32| Gradient::new(bent(&shape(number), 0.0, [0.0; 2]).1).at_vertices(1.0).map(Vec3::from);
        for number in &numbers {
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
        for (place, number) in (0..).zip(&numbers[..own.len()]) {
            let element = &elements[*number as usize];
            part.moments.push(Moments::new(element, place, place_of));
            let vectors = gradient(*number);
            part.add_to_stiffness(element, first, vectors, &gradient);
            let masses = element.vertices.map(|v| scene.masses()[(first + v) as usize]);
            let softness: f64 = vectors.iter().zip(masses).map(|(u, m)| u.norm_squared() / m).sum();
            part.damping.push(2.0 * laws.damping_ratios[*number as usize] * (element.row[0].1 / softness).sqrt());
        }
        let in_part = |hinge: &Hinge| hinge.vertices.map(|v| (v as usize - range.start) as u16);
        part.inside = part.hinges[..inside.len()].iter().map(in_part).collect();
        part.neighbours = corners::outside(&range, part.hinges.iter().map(|hinge| hinge.vertices));
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
            + self.inside.len() * size_of::<[u16; 4]>()
            + self.moments.len() * size_of::<Moments>()
            + self.gradients.len() * (size_of::<Gradient>() + 8)
            + self.stiffness.len() * 8
            + self.neighbours.len() * 4
            + self.folds.len() * size_of::<Fold>()
    }

    /// Whether a hinge counts here: at the part that has its first vertex.
    fn counts(&self, hinge: usize) -> bool {
        self.hinges[hinge].vertices.iter().min().is_some_and(|first| self.index_of(*first as usize).is_some())
    }

    /// The hinges across the border of the part, by their places.
    fn across(&self) -> Range<usize> {
        self.inside.len()..self.gradients.len()
    }
}

/// Adds a pull along the gradient of a hinge to its vertices inside a part.
#[inline(always)]
fn pull(gradient: &Gradient, pull: f64, corners: [usize; 4], f: &mut [Simd4]) {
    for (corner, force) in corners.into_iter().zip(gradient.at_vertices(pull)) {
        f[corner] += force;
    }
}

impl Force for PartHinges {
    fn neighbours(&self) -> &[u32] {
        &self.neighbours
    }

    fn update(&mut self, view: &PartView<'_>, _own: &[Simd4], f: &mut [Simd4]) {
        let mut bends = Bends::default();
        let mut gradients = self.gradients.chunks_mut(SPAN);
        for (hinges, angles) in self.hinges.chunks(SPAN).zip(self.angles.chunks_mut(SPAN)) {
            bends.find(hinges, view.x);
            angles.copy_from_slice(&bends.off[..angles.len()]);
            // Those of the part come first.
            let kept = gradients.next().unwrap_or_default();
            kept.iter_mut().enumerate().for_each(|(n, gradient)| *gradient = bends.gradient(n));
        }
        let is_out = |hinge: &usize| self.gradients[*hinge].is_zero() && self.counts(*hinge);
        self.left_out += (0..self.gradients.len()).filter(is_out).count() as u64;
        let moment = |place: usize| self.moments[place].moment(place, |other| self.angles[other]);
        for (place, (corners, gradient)) in self.inside.iter().zip(&self.gradients).enumerate() {
            pull(gradient, -moment(place), corners.map(usize::from), f);
        }
        for place in self.across() {
            let forces = self.gradients[place].at_vertices(-moment(place));
            corners::add(self.range.start, self.hinges[place].vertices, forces, f);
        }
    }

    fn add_damping(&self, motion: &PartMotion<'_>, f: &mut [Simd4]) {
        let own_v = &motion.own_v[..f.len()];
        for ((corners, gradient), damping) in self.inside.iter().zip(&self.gradients).zip(&self.damping) {
            let corners = corners.map(usize::from);
            let rate = gradient.rate(corners.map(|corner| own_v[corner]));
            pull(gradient, -damping * rate, corners, f);
        }
        for place in self.across() {
            let (vertices, gradient) = (self.hinges[place].vertices, &self.gradients[place]);
            // Written out: `map` of an array is not always inlined.
            let at = |corner: usize| Simd4::from(&motion.v[vertices[corner] as usize]);
            let rate = gradient.rate([at(0), at(1), at(2), at(3)]);
            corners::add(self.range.start, vertices, gradient.at_vertices(-self.damping[place] * rate), f);
        }
    }

    fn add_stiffness(&self, sums: &mut [f64]) {
        sums.iter_mut().zip(&self.stiffness).for_each(|(sum, own)| *sum += own);
    }

    fn energy(&self, view: &PartView<'_>) -> f64 {
        let angle = |hinge: usize| self.hinges[hinge].off(view.x);
        // Half of angle times moment, of which each of the four vertices brings a quarter.
        let own = |n: usize| corners::own_fraction(&self.range, self.hinges[n].vertices);
        let half = |n: usize| 0.5 * own(n) * angle(n) * self.moments[n].moment(n, angle);
        (0..self.moments.len()).map(half).sum()
    }

    fn take_counts(&mut self, count: &mut dyn FnMut(&'static str, u64)) {
        count("hinges_left_out", std::mem::take(&mut self.left_out));
        if !self.folds.is_empty() {
            count("hinges_yielded", std::mem::take(&mut self.yielded));
        }
    }

    fn linearised(&self) -> Option<&dyn Linearised> {
        Some(self)
    }

    fn plastic(&self) -> Option<&dyn Plastic> {
        Some(self)
    }

    fn plastic_mut(&mut self) -> Option<&mut dyn Plastic> {
        Some(self)
    }
}

impl Linearised for PartHinges {
    fn visit_elements(&self, visit: &mut dyn FnMut(&[u32])) {
        self.hinges[..self.gradients.len()].iter().for_each(|hinge| visit(&hinge.vertices));
    }

    fn add_blocks(&self, _: &PartView<'_>, factors: BlockFactors, slots: &[Slot], rows: &mut PartBlocks) {
        let laws = self.moments.iter().zip(&self.damping);
        let slots = slots.as_chunks::<6>().0;
        for ((gradient, slots), (moments, damping)) in self.gradients.iter().zip(slots).zip(laws) {
            // Moments of neighbouring angles would couple vertices two edges away; the sum of their sizes on the diagonal is
            // never less (Gershgorin), and an element keeps to its four vertices. How the gradient turns is left out: it has
            // either sign.
            let scale = factors.stiffness * moments.size() + factors.damping * damping;
            rows.add_outer(slots, &gradient.at_vertices(scale.sqrt()));
        }
    }
}

impl Plastic for PartHinges {
    fn update_plasticity(&mut self, x: &[Vec3]) {
        for n in 0..self.folds.len() {
            let (hinge, fold) = (&mut self.hinges[n], &mut self.folds[n]);
            let off = hinge.off(x);
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
        for (n, fold) in self.folds.iter().enumerate().filter(|(_, fold)| fold.has_yielded) {
            rows.insert(self.hinges[n].vertices, [self.hinges[n].rest_angle, fold.yield_angle]);
        }
    }

    fn restore_elements(&mut self, rows: &ElementRows) {
        for (hinge, fold) in self.hinges.iter_mut().zip(&mut self.folds) {
            if let Some([rest_angle, yield_angle]) = rows.get(&hinge.vertices) {
                (hinge.rest_angle, fold.yield_angle) = (*rest_angle, *yield_angle);
                fold.has_yielded = true;
            }
        }
    }
}
