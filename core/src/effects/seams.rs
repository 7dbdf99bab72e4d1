//! Seams: springs between vertices that are not neighbours on a mesh, of one garment or of two, which close over time and stay.
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
use crate::effects::force::{BlockFactors, Force, Linearised, PartMotion, PartView};
use crate::effects::spec::{BuildContext, Cost, Effect, EffectSpec, Need, Scope, Study};
use crate::error::Problem;
use crate::parallel::simd4::Simd4;
use crate::scene::{Scene, SeamDescription};
use crate::settings::Settings;

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
}

impl Closing {
    /// Length at a time, and its rate [m, m/s], of a pair that starts `gap` apart.
    fn length(&self, gap: f64, time: f64) -> (f64, f64) {
        if time >= self.until || self.is_zip {
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

/// A pair with an own end.
#[derive(Debug, Clone, Copy)]
struct Stitch {
    /// Own end, counted from the part's first vertex.
    own: usize,
    /// Local vertices of the first and the second end.
    ends: [usize; 2],
    /// 1 if the own end is the first, otherwise -1.
    side: f64,
    /// Distance of the ends at the start [m].
    gap: f64,
    closing: Closing,
    /// Stiffness [N/m].
    stiffness: f64,
    /// Damping [N s/m].
    damping: f64,
    /// Damping over squared length at the last update [N s/m³].
    scaled_damping: f64,
}

/// The stitches of one part.
struct PartSeams {
    stitches: Vec<Stitch>,
    /// Ends in other parts, ascending.
    neighbours: Vec<u32>,
}

fn build(_: &Settings, context: &BuildContext<'_>) -> Result<Effect, Problem> {
    let (scene, parts) = (context.scene, context.scene.parts());
    let seams = &scene.description().seams;
    let closings: Vec<Closing> = seams.iter().map(|seam| closing(scene, seam)).collect();
    let mut entries: Vec<(usize, Stitch)> = Vec::new();
    for sewn in scene.sewn() {
        let [Some(a), Some(b)] = sewn.ends.map(|end| parts.local(end)) else {
            let what = "the other end of a sewn vertex is not known on its rank";
            return Err(Problem::scene(format!("seam {}", sewn.seam), what, "report this"));
        };
        let (seam, ends) = (&seams[sewn.seam], [a, b]);
        let [p, q] = ends.map(|end| scene.masses()[end]);
        let damping = 2.0 * seam.damping_ratio * (seam.stiffness * p * q / (p + q)).sqrt();
        for (own, side) in [(a, 1.0), (b, -1.0)].into_iter().filter(|(own, _)| parts.own().contains(own)) {
            let part = parts.part_of(own);
            let (own, stiffness) = (own - parts.ranges()[part].start, seam.stiffness);
            let (gap, closing) = (sewn.gap, closings[sewn.seam].of_pair(sewn.share));
            entries.push((part, Stitch { own, ends, side, gap, closing, stiffness, damping, scaled_damping: 0.0 }));
        }
    }
    // The order of the seams, part by part.
    entries.sort_by_key(|(part, _)| *part);
    let mut effect = Effect::default();
    for group in entries.chunk_by(|a, b| a.0 == b.0) {
        let (part, stitches) = (group[0].0, group.iter().map(|(_, stitch)| *stitch).collect::<Vec<_>>());
        let own = parts.ranges()[part].clone();
        let mut neighbours: Vec<u32> =
            stitches.iter().flat_map(|s| s.ends).filter(|end| !own.contains(end)).map(|end| end as u32).collect();
        neighbours.sort_unstable();
        neighbours.dedup();
        effect.elements += stitches.iter().filter(|stitch| stitch.side > 0.0).count();
        effect.bytes += size_of_val(stitches.as_slice()) + size_of_val(neighbours.as_slice());
        effect.forces.push((part, Box::new(PartSeams { stitches, neighbours })));
    }
    effect.notes = notes(seams, &closings);
    Ok(effect)
}

/// Returns the closing of a seam in this scene.
fn closing(scene: &Scene, seam: &SeamDescription) -> Closing {
    let description = scene.description();
    let touches = description.effects.iter().any(|e| e.effect == "self_repulsion" || e.effect == "self_collision");
    let [a, b] = seam.garments.map(|garment| description.garments[garment].thickness);
    let rest_gap = seam.rest_gap.unwrap_or(if touches { a.max(b) } else { 0.0 });
    let opening = seam.opens.map(|opens| [opens, seam.opened.unwrap_or(opens)]);
    Closing { from: seam.from, until: seam.until, rest_gap, opening, is_zip: seam.zip }
}

/// The gaps that are left, where the scene does not say them.
fn notes(seams: &[SeamDescription], closings: &[Closing]) -> Vec<String> {
    let chosen = seams.iter().zip(closings).enumerate().filter(|(_, (seam, _))| seam.rest_gap.is_none());
    let note = |(s, (_, closing)): (usize, (_, &Closing))| {
        format!("seam {s} closes to {} mm, the thickness that layers keep", 1e3 * closing.rest_gap)
    };
    chosen.filter(|(_, (_, closing))| closing.rest_gap > 0.0).map(note).collect()
}

impl Force for PartSeams {
    fn update(&mut self, view: &PartView<'_>, _: &[Simd4], f: &mut [Simd4]) {
        for stitch in &mut self.stitches {
            let [a, b] = stitch.ends.map(|end| view.x[end]);
            let (length, rate) = stitch.closing.length(stitch.gap, view.context.time);
            let (apart, inverse) = direction(b - a);
            let hold = stitch.closing.hold(view.context.time);
            let (stiffness, damping) = (hold * stitch.stiffness, hold * stitch.damping);
            let pull = stiffness * (apart.norm() - length) - damping * rate;
            stitch.scaled_damping = damping * inverse * inverse;
            f[stitch.own] += Simd4::from(&(apart * (stitch.side * pull * inverse)));
        }
    }

    fn add_damping(&self, motion: &PartMotion<'_>, f: &mut [Simd4]) {
        for stitch in &self.stitches {
            let [a, b] = stitch.ends;
            let apart = motion.x[b] - motion.x[a];
            let along = apart.dot(&(motion.v[b] - motion.v[a]));
            f[stitch.own] += Simd4::from(&(apart * (stitch.side * stitch.scaled_damping * along)));
        }
    }

    fn add_stiffness(&self, sums: &mut [f64]) {
        self.stitches.iter().for_each(|stitch| sums[stitch.own] += stitch.stiffness);
    }

    fn neighbours(&self) -> &[u32] {
        &self.neighbours
    }

    fn energy(&self, view: &PartView<'_>) -> f64 {
        let energy = |stitch: &Stitch| {
            let [a, b] = stitch.ends.map(|end| view.x[end]);
            let stretch = (b - a).norm() - stitch.closing.length(stitch.gap, view.context.time).0;
            // Both ends count their half.
            0.25 * stitch.closing.hold(view.context.time) * stitch.stiffness * stretch * stretch
        };
        self.stitches.iter().map(energy).sum()
    }

    fn linearised(&self) -> Option<&dyn Linearised> {
        Some(self)
    }
}

impl Linearised for PartSeams {
    fn visit_elements(&self, visit: &mut dyn FnMut(&[u32])) {
        self.stitches.iter().for_each(|stitch| visit(&stitch.ends.map(|end| end as u32)));
    }

    fn add_blocks(&self, view: &PartView<'_>, factors: BlockFactors, slots: &[Slot], rows: &mut PartBlocks) {
        // A pair within the part is listed at both of its ends, and has one block.
        let own = view.start..view.start + view.masses.len();
        let is_first = |stitch: &Stitch| stitch.side > 0.0 || !own.contains(&stitch.ends[0]);
        for (stitch, slot) in self.stitches.iter().zip(slots).filter(|(stitch, _)| is_first(stitch)) {
            let [a, b] = stitch.ends.map(|end| view.x[end]);
            let (apart, inverse) = direction(b - a);
            if inverse > 0.0 {
                let (length, _) = stitch.closing.length(stitch.gap, view.context.time);
                let hold = stitch.closing.hold(view.context.time);
                let stiffness = factors.stiffness * (hold * stitch.stiffness);
                let across = stiffness * (1.0 - length * inverse).max(0.0);
                let along = stiffness + factors.damping * (hold * stitch.damping);
                rows.add_spring(*slot, &(apart * inverse), along, across);
            }
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

    const SEAM: Closing = Closing { from: -1.0, until: 1.0, rest_gap: 0.1, opening: None, is_zip: false };

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
