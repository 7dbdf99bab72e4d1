//! Seams: springs between vertices that are not neighbours on a mesh, of one garment or of two, which close over time and stay; and
//! between vertices of one garment and points on faces of another.
//!
//! A pair whose ends are `l` apart is pulled as a spring of the length L(t), which goes evenly from what the gap is at the start
//! to what is to be left of it:
//!
//! ```text
//! F₁ = [k (l − L) + c ((v₂ − v₁)·e − dL/dt)] e,   F₂ = −F₁,   c = 2 ζ √(k μ),   e from 1 to 2
//! ```
//!
//! Damping is relative to the closing, so that it does not hold it up; momentum and angular momentum are kept. A seam that opens
//! loses stiffness and damping evenly over its time. A zip gives them to one pair after the other as it closes, each with the
//! closed gap as its length, and takes them in the opposite order as it opens.
//!
//! The end on a face is x = Σ bᵢ xᵢ with fixed barycentric weights b. Its corners share the force: Fᵢ = bᵢ F₂.
//!
//! A stitch whose spring pulls with more than `break_force` at a state free of collisions opens for good: it is counted
//! (`stitches_broken`) and named in the record of that frame, and is in the section `seams` of checkpoints.
//!
//! ```toml
//! [[seam]]
//! from = { garment = "front", where = { box = { min = [0.2, 0, -1], max = [0.3, 2, 1] } } }
//! to = { garment = "back", where = { box = { min = [0.2, 0, -1], max = [0.3, 2, 1] } } }
//! strength = "800 N/m"
//! ```
//!
//! Limits: layers that touch keep their thickness also where they are sewn, so a scene with `self_repulsion` or
//! `self_collision` closes its seams to the larger thickness of both garments, unless it says another `rest_gap`. A seam is not
//! welded: strained strongly it opens by force over stiffness.

#![cfg(feature = "effects")]

use crate::Vec3;
use crate::block_matrix::{PartBlocks, Slot};
use crate::effects::force::{BlockFactors, Breakable, BrokenElement, Force, Linearised, PartMotion, PartView};
use crate::effects::spec::{BuildContext, Cost, Effect, EffectSpec, Need, Report, Scope, Study};
use crate::error::Problem;
use crate::parallel::parts::Parts;
use crate::parallel::simd4::Simd4;
use crate::scene::seam_pairs::{Sewn, SewnTo};
use crate::scene::{Scene, SeamDescription};
use crate::settings::Settings;
use crate::snapshot::elements::ElementRows;
use crate::snapshot::saved_section::SectionId;

/// Stitches that are broken.
const SECTION: SectionId = SectionId { name: "seams", version: 1 };

/// Registry entry.
pub(crate) static SPEC: EffectSpec = EffectSpec {
    name: "seams",
    summary: "pairs of vertices are sewn together",
    scope: Scope::Implied,
    example: r#"[[seam]]
strength = "20 N/m"
from = { garment = "sheet", corners = ["inj0"] }
to = { garment = "sheet", corners = ["injn"] }"#,
    fields: &[],
    needs: &[Need::State],
    elements: "stitches",
    section: Some(SECTION),
    report: Report { counts: &["stitches_broken"], ..Report::NONE },
    study: Study { is_essential: true, does_work: Some(|_| true), ..Study::INTERNAL },
    cost: Cost { update: 15.0, product: 5.0, ..Cost::NONE },
    build,
    ..EffectSpec::BARE
};

/// Length and hold of a seam's pairs over time.
#[derive(Debug, Clone, Copy)]
struct Closing {
    from: f64,
    until: f64,
    /// At the end [m].
    rest_gap: f64,
    /// Times between which it opens [s].
    opening: Option<[f64; 2]>,
    /// Whether it closes by its hold instead of its length.
    is_zip: bool,
    /// Whether the length stays that at the start.
    keeps_gap: bool,
}

impl Closing {
    /// Length at a time, and its rate [m, m/s], of a pair that starts `gap` apart.
    fn length(&self, gap: f64, time: f64) -> (f64, f64) {
        if self.keeps_gap {
            (gap, 0.0)
        } else if time >= self.until || self.is_zip {
            (self.rest_gap, 0.0)
        } else if time <= self.from {
            (gap, 0.0)
        } else {
            let rate = (self.rest_gap - gap) / (self.until - self.from);
            (gap + rate * (time - self.from), rate)
        }
    }

    /// Share of stiffness and damping that acts at a time.
    fn hold(&self, time: f64) -> f64 {
        let closed = if self.is_zip { ramp([self.from, self.until], time) } else { 1.0 };
        closed * self.opening.map_or(1.0, |opening| 1.0 - ramp(opening, time))
    }

    /// A zip's own times of the pair in this share of its length.
    fn of_pair(self, [low, high]: [f64; 2]) -> Self {
        if !self.is_zip {
            return self;
        }
        let between = |[from, until]: [f64; 2], share: f64| from + share * (until - from);
        let times = [self.from, self.until];
        // The pair that was closed last opens first.
        let opening = self.opening.map(|times| [between(times, 1.0 - high), between(times, 1.0 - low)]);
        Self { from: between(times, low), until: between(times, high), opening, ..self }
    }
}

/// Evenly from 0 at the first time to 1 at the second; a step where they are the same.
fn ramp([from, until]: [f64; 2], time: f64) -> f64 {
    if time >= until { 1.0 } else { ((time - from) / (until - from)).max(0.0) }
}

/// A stitch at one of its own vertices. It has N vertices: the first is sewn to the second, or to a point of the face of the others.
#[derive(Debug, Clone, Copy)]
struct Stitch<const N: usize> {
    /// Own vertex, counted from the part's first.
    own: usize,
    /// Local vertices.
    vertices: [usize; N],
    /// Their weights in the vector from the first vertex to the place that it is sewn to: -1 and those of the place.
    weights: [f64; N],
    /// Share of the pull along that vector that the own vertex has.
    side: f64,
    /// Number of the seam.
    seam: usize,
    /// Distance at the start [m].
    gap: f64,
    closing: Closing,
    /// Stiffness [N/m].
    stiffness: f64,
    /// Damping [N s/m].
    damping: f64,
    /// Damping over squared length at the last update [N s/m³].
    scaled_damping: f64,
    /// Force at which it breaks [N], infinite if it never does.
    break_force: f64,
    /// Time at which it broke [s], infinite while it holds.
    broken_at: f64,
}

impl<const N: usize> Stitch<N> {
    /// From the first vertex to the place that it is sewn to [m], or the rate of that vector [m/s].
    fn apart(&self, values: &[Vec3]) -> Vec3 {
        let far = self.vertices.iter().zip(self.weights).skip(1);
        far.map(|(vertex, weight)| values[*vertex] * weight).sum::<Vec3>() - values[self.vertices[0]]
    }

    /// Share of stiffness and damping that acts at a time.
    fn hold(&self, time: f64) -> f64 {
        if self.broken_at.is_finite() { 0.0 } else { self.closing.hold(time) }
    }

    /// Whether it counts here, of all its own vertices: at the first vertex.
    fn counts(&self, start: usize) -> bool {
        start + self.own == self.vertices[0]
    }

    /// Its vertices in a list of elements: four, where a pair stands twice.
    fn key(&self) -> [u32; 4] {
        std::array::from_fn(|k| self.vertices[k % N] as u32)
    }
}

/// The stitches of one part.
struct PartSeams<const N: usize> {
    /// First vertex of the part.
    start: usize,
    stitches: Vec<Stitch<N>>,
    /// Vertices in other parts, ascending.
    neighbours: Vec<u32>,
}

fn build(_: &Settings, context: &BuildContext<'_>) -> Result<Effect, Problem> {
    let (scene, parts) = (context.scene, context.scene.parts());
    let seams = &scene.description().seams;
    let closings: Vec<Closing> = seams.iter().map(|seam| closing(scene, seam)).collect();
    let (mut pairs, mut on_faces) = (Vec::new(), Vec::new());
    for sewn in scene.sewn() {
        let local = |vertex: u32| {
            parts.local(vertex).ok_or_else(|| {
                let what = "a vertex of a stitch is not known on its rank";
                Problem::scene(format!("seam {}", sewn.seam), what, "report this")
            })
        };
        let (seam, mass) = (&seams[sewn.seam], |vertex: usize| scene.masses()[vertex]);
        let closing = closings[sewn.seam].of_pair(sewn.share);
        let vertex = local(sewn.vertex)?;
        match sewn.to {
            SewnTo::Vertex(other) => {
                let other = local(other)?;
                let [p, q] = [vertex, other].map(mass);
                let on_spring = seam.stiffness * p * q / (p + q);
                add(parts, &mut pairs, seam, (sewn, closing), [vertex, other], [-1.0, 1.0], on_spring);
            }
            SewnTo::Face { corners: [a, b, c], weights: [u, v, w] } => {
                let corners = [local(a)?, local(b)?, local(c)?];
                let moved = |(corner, weight): (usize, f64)| weight * weight / mass(corner);
                let inverse = corners.into_iter().zip([u, v, w]).map(moved).sum::<f64>() + 1.0 / mass(vertex);
                let ([a, b, c], on_spring) = (corners, seam.stiffness / inverse);
                add(parts, &mut on_faces, seam, (sewn, closing), [vertex, a, b, c], [-1.0, u, v, w], on_spring);
            }
        }
    }
    let breaks = scene.description().seams_can_break().then_some(SECTION);
    let mut effect = Effect { notes: notes(seams, &closings), breaks, ..Effect::default() };
    put(parts, pairs, &mut effect);
    put(parts, on_faces, &mut effect);
    Ok(effect)
}

/// Adds a stitch at each of its own vertices, each with its part; `on_spring` is the mass that moves against its spring times its
/// stiffness [kg N/m].
fn add<const N: usize>(
    parts: &Parts,
    entries: &mut Vec<(usize, Stitch<N>)>,
    seam: &SeamDescription,
    (sewn, closing): (&Sewn, Closing),
    vertices: [usize; N],
    weights: [f64; N],
    on_spring: f64,
) {
    let damping = 2.0 * seam.damping_ratio * on_spring.sqrt();
    for (vertex, weight) in vertices.into_iter().zip(weights).filter(|(vertex, _)| parts.own().contains(vertex)) {
        let part = parts.part_of(vertex);
        let stitch = Stitch {
            own: vertex - parts.ranges()[part].start,
            vertices,
            weights,
            side: -weight,
            seam: sewn.seam,
            gap: sewn.gap,
            closing,
            stiffness: seam.stiffness,
            damping,
            scaled_damping: 0.0,
            break_force: seam.break_force.unwrap_or(f64::INFINITY),
            broken_at: f64::INFINITY,
        };
        entries.push((part, stitch));
    }
}

/// Gives an effect the forces of stitches in the order of the seams, part by part.
fn put<const N: usize>(parts: &Parts, mut entries: Vec<(usize, Stitch<N>)>, effect: &mut Effect) {
    entries.sort_by_key(|(part, _)| *part);
    for group in entries.chunk_by(|a, b| a.0 == b.0) {
        let (part, stitches) = (group[0].0, group.iter().map(|(_, stitch)| *stitch).collect::<Vec<_>>());
        let own = parts.ranges()[part].clone();
        let all = stitches.iter().flat_map(|stitch| stitch.vertices);
        let mut neighbours: Vec<u32> = all.filter(|v| !own.contains(v)).map(|v| v as u32).collect();
        neighbours.sort_unstable();
        neighbours.dedup();
        effect.elements += stitches.iter().filter(|stitch| stitch.counts(own.start)).count();
        effect.bytes += size_of_val(stitches.as_slice()) + size_of_val(neighbours.as_slice());
        effect.forces.push((part, Box::new(PartSeams { start: own.start, stitches, neighbours })));
    }
}

/// Returns the closing of a seam in this scene.
fn closing(scene: &Scene, seam: &SeamDescription) -> Closing {
    let description = scene.description();
    let touches = description.effects.iter().any(|e| e.effect == "self_repulsion" || e.effect == "self_collision");
    let [a, b] = seam.garments.map(|garment| description.garments[garment].thickness);
    let rest_gap = seam.rest_gap.unwrap_or(if touches { a.max(b) } else { 0.0 });
    let opening = seam.opens.map(|opens| [opens, seam.opened.unwrap_or(opens)]);
    Closing { from: seam.from, until: seam.until, rest_gap, opening, is_zip: seam.zip, keeps_gap: seam.keeps_gap }
}

/// The gaps that are left, where the scene does not say them.
fn notes(seams: &[SeamDescription], closings: &[Closing]) -> Vec<String> {
    let chosen =
        seams.iter().zip(closings).enumerate().filter(|(_, (seam, _))| seam.rest_gap.is_none() && !seam.keeps_gap);
    let note = |(s, (_, closing)): (usize, (_, &Closing))| {
        format!("seam {s} closes to {} mm, the thickness that layers keep", 1e3 * closing.rest_gap)
    };
    chosen.filter(|(_, (_, closing))| closing.rest_gap > 0.0).map(note).collect()
}

impl<const N: usize> Force for PartSeams<N> {
    fn update(&mut self, view: &PartView<'_>, _: &[Simd4], f: &mut [Simd4]) {
        for stitch in &mut self.stitches {
            let (length, rate) = stitch.closing.length(stitch.gap, view.context.time);
            let (apart, inverse) = direction(stitch.apart(view.x));
            let hold = stitch.hold(view.context.time);
            let (stiffness, damping) = (hold * stitch.stiffness, hold * stitch.damping);
            let pull = stiffness * (apart.norm() - length) - damping * rate;
            stitch.scaled_damping = damping * inverse * inverse;
            f[stitch.own] += Simd4::from(&(apart * (stitch.side * pull * inverse)));
        }
    }

    fn add_damping(&self, motion: &PartMotion<'_>, f: &mut [Simd4]) {
        for stitch in &self.stitches {
            let apart = stitch.apart(motion.x);
            let along = apart.dot(&stitch.apart(motion.v));
            f[stitch.own] += Simd4::from(&(apart * (stitch.side * stitch.scaled_damping * along)));
        }
    }

    fn add_stiffness(&self, sums: &mut [f64]) {
        self.stitches.iter().for_each(|stitch| sums[stitch.own] += stitch.side.abs() * stitch.stiffness);
    }

    fn neighbours(&self) -> &[u32] {
        &self.neighbours
    }

    fn energy(&self, view: &PartView<'_>) -> f64 {
        let energy = |stitch: &Stitch<N>| {
            let stretch = stitch.apart(view.x).norm() - stitch.closing.length(stitch.gap, view.context.time).0;
            // The shares of all vertices add up to two.
            0.25 * stitch.side.abs() * stitch.hold(view.context.time) * stitch.stiffness * stretch * stretch
        };
        self.stitches.iter().map(energy).sum()
    }

    fn linearised(&self) -> Option<&dyn Linearised> {
        Some(self)
    }

    fn breakable(&self) -> Option<&dyn Breakable> {
        Some(self)
    }

    fn breakable_mut(&mut self) -> Option<&mut dyn Breakable> {
        Some(self)
    }
}

impl<const N: usize> Linearised for PartSeams<N> {
    fn visit_elements(&self, visit: &mut dyn FnMut(&[u32])) {
        self.stitches.iter().for_each(|stitch| visit(&stitch.vertices.map(|vertex| vertex as u32)));
    }

    fn add_blocks(&self, view: &PartView<'_>, factors: BlockFactors, slots: &[Slot], rows: &mut PartBlocks) {
        // A stitch is listed at each of its vertices in the part, and has its blocks once.
        let own = view.start..view.start + view.masses.len();
        let is_first = |stitch: &Stitch<N>| {
            stitch.vertices.iter().find(|vertex| own.contains(vertex)) == Some(&(view.start + stitch.own))
        };
        let slots = slots.chunks(N * (N - 1) / 2);
        for (stitch, slots) in self.stitches.iter().zip(slots).filter(|(stitch, _)| is_first(stitch)) {
            let (apart, inverse) = direction(stitch.apart(view.x));
            if inverse > 0.0 {
                let (length, _) = stitch.closing.length(stitch.gap, view.context.time);
                let hold = stitch.hold(view.context.time);
                let stiffness = factors.stiffness * (hold * stitch.stiffness);
                let across = stiffness * (1.0 - length * inverse).max(0.0);
                let along = stiffness + factors.damping * (hold * stitch.damping);
                let pairs = (0..N).flat_map(|a| (a + 1..N).map(move |b| (a, b)));
                for (slot, (a, b)) in slots.iter().zip(pairs) {
                    let coupling = -stitch.weights[a] * stitch.weights[b];
                    rows.add_spring(*slot, &(apart * inverse), coupling * along, coupling * across);
                }
            }
        }
    }
}

impl<const N: usize> Breakable for PartSeams<N> {
    fn break_overloaded(&mut self, x: &[Vec3], time: f64) -> u64 {
        let mut broken = 0;
        for stitch in self.stitches.iter_mut().filter(|stitch| stitch.break_force.is_finite()) {
            let (length, _) = stitch.closing.length(stitch.gap, time);
            let pull = stitch.hold(time) * stitch.stiffness * (stitch.apart(x).norm() - length);
            if pull > stitch.break_force {
                stitch.broken_at = time;
                broken += u64::from(stitch.counts(self.start));
            }
        }
        broken
    }

    fn visit_broken(&self, visit: &mut dyn FnMut(BrokenElement)) {
        for stitch in self.stitches.iter().filter(|stitch| stitch.broken_at.is_finite()) {
            let counts = stitch.counts(self.start);
            visit(BrokenElement { vertices: stitch.key(), time: stitch.broken_at, owner: stitch.seam, counts });
        }
    }

    fn restore_broken(&mut self, rows: &ElementRows) {
        for stitch in self.stitches.iter_mut().filter(|stitch| stitch.break_force.is_finite()) {
            stitch.broken_at = rows.get(&stitch.key()).map_or(f64::INFINITY, |[time, _]| *time);
        }
    }
}

/// The way between two ends, and one over its length; coinciding ends have no direction to pull along.
fn direction(apart: Vec3) -> (Vec3, f64) {
    let length = apart.norm();
    (apart, if length > 0.0 { 1.0 / length } else { 0.0 })
}

#[cfg(test)]
mod tests {
    use super::*;

    const SEAM: Closing =
        Closing { from: -1.0, until: 1.0, rest_gap: 0.1, opening: None, is_zip: false, keeps_gap: false };

    #[test]
    fn a_gap_closes_evenly_and_stays_closed() {
        let closing = SEAM;
        assert_eq!(closing.length(0.5, -2.0), (0.5, 0.0));
        assert_eq!(closing.length(0.5, 0.0), (0.3, -0.2));
        assert_eq!(closing.length(0.5, 1.0), (0.1, 0.0));
        let closed = Closing { from: 0.0, until: 0.0, ..SEAM };
        assert_eq!(closed.length(0.5, 0.0), (0.1, 0.0));
        assert_eq!((closing.hold(-2.0), closing.hold(9.0)), (1.0, 1.0));
    }

    #[test]
    fn a_button_opens_at_once_and_a_seam_evenly() {
        let button = Closing { opening: Some([2.0, 2.0]), ..SEAM };
        assert_eq!((button.hold(1.999), button.hold(2.0)), (1.0, 0.0));
        let seam = Closing { opening: Some([2.0, 4.0]), ..SEAM };
        assert_eq!([1.0, 2.5, 3.0, 5.0].map(|time| seam.hold(time)), [1.0, 0.75, 0.5, 0.0]);
    }

    #[test]
    fn a_zip_closes_pair_by_pair_and_opens_the_last_first() {
        let zip = Closing { from: 0.0, until: 4.0, opening: Some([10.0, 14.0]), is_zip: true, ..SEAM };
        let pair = |k: usize| zip.of_pair([0.25 * k as f64, 0.25 * (k + 1) as f64]);
        let holds = |time: f64| [0, 1, 2, 3].map(|k| pair(k).hold(time));
        assert_eq!(holds(0.0), [0.0; 4]);
        assert_eq!(holds(1.5), [1.0, 0.5, 0.0, 0.0]);
        assert_eq!(holds(4.0), [1.0; 4]);
        assert_eq!(holds(11.5), [1.0, 1.0, 0.5, 0.0]);
        assert_eq!(holds(14.0), [0.0; 4]);
        assert_eq!(pair(3).length(0.5, 0.0), (0.1, 0.0));
    }
}
