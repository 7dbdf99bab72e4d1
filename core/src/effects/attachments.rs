//! Attachments: springs of zero length that pull vertices to the place where a pin would hold them
//! (`docs/theory/step.md#pins`).
//!
//! ```toml
//! [[garment.pin]]
//! vertices = [0, 40]
//! to = "body:hero"
//! mode = "spring"
//! stiffness = "200 N/m"
//! damping_ratio = 1.0
//! break_force = "60 N"
//! ```
//!
//! An attachment whose spring pulls with more than `break_force` at a state free of collisions lets its vertex go for good: it
//! is counted (`attachments_broken`) and named with its vertex in the record of that frame.

#![cfg(feature = "effects")]

use crate::block_matrix::{PartBlocks, Slot};
use crate::effects::force::{BlockFactors, Force, Linearised, PartMotion, PartView};
use crate::effects::spec::{BuildContext, Cost, Effect, EffectSpec, MapSpec, Need, Report, Scope, Study};
use crate::error::Problem;
use crate::parallel::simd4::Simd4;
use crate::pins;
use crate::scene::PinHold;
use crate::scene::SceneDescription;
use crate::settings::Settings;

/// Registry entry.
pub(crate) static SPEC: EffectSpec = EffectSpec {
    name: "attachments",
    summary: "soft pins: springs pull vertices to target positions",
    scope: Scope::Implied,
    example: r#"[[garment.pin]]
corners = ["injn"]
mode = "spring"
stiffness = "20 N/m""#,
    fields: &[],
    needs: &[Need::State, Need::PinTargets],
    elements: "springs",
    section: Some(pins::SECTION),
    maps: &[
        MapSpec::of("pins", &["stiffness"]),
        MapSpec::of("pin_damping", &["damping_ratio"]),
        MapSpec { varies: Some(can_break), ..MapSpec::of("break_force", &["break_force"]) },
    ],
    report: Report { shared_stages: &["bodies and pins"], counts: &["attachments_broken"], ..Report::NONE },
    study: Study { is_essential: true, does_work: Some(SceneDescription::moves_pins), ..Study::OUTSIDE },
    cost: Cost { update: 15.0, product: 3.0, ..Cost::NONE },
    build,
    ..EffectSpec::BARE
};

#[derive(Debug, Clone, Copy)]
struct Attachment {
    /// Vertex counted from the part's first.
    vertex: usize,
    target: usize,
    /// Stiffness [N/m].
    stiffness: f64,
    /// Damping [N s/m].
    damping: f64,
    /// Whether it holds during this step.
    active: bool,
}

/// The attachments of one part.
struct PartAttachments {
    start: usize,
    springs: Vec<Attachment>,
}

/// Whether some pin of a garment has a force at which it breaks, which a map varies.
fn can_break(description: &SceneDescription, garment: usize) -> bool {
    description.pins.iter().any(|pin| pin.garment == garment && pin.hold.break_force().is_some())
}

fn build(_: &Settings, context: &BuildContext<'_>) -> Result<Effect, Problem> {
    let (scene, parts) = (context.scene, context.scene.parts());
    let mut entries = Vec::new();
    for (target, pinned) in scene.pinned().iter().enumerate() {
        if let PinHold::Spring { .. } = scene.description().pins[pinned.pin].hold {
            let stiffness = scene.pin_stiffness(pinned);
            let own = pinned.vertex as usize;
            let part = parts.part_of(own);
            let damping = 2.0 * scene.pin_damping_ratio(pinned) * (stiffness * scene.masses()[own]).sqrt();
            let vertex = own - parts.ranges()[part].start;
            entries.push((part, Attachment { vertex, target, stiffness, damping, active: false }));
        }
    }
    entries.sort_by_key(|(part, a)| (*part, a.vertex, a.target));
    let (elements, bytes) = (entries.len(), entries.len() * size_of::<Attachment>());
    let forces = entries
        .chunk_by(|a, b| a.0 == b.0)
        .map(|group| {
            let springs = group.iter().map(|(_, a)| *a).collect();
            let force = PartAttachments { start: parts.ranges()[group[0].0].start, springs };
            (group[0].0, Box::new(force) as Box<dyn Force>)
        })
        .collect();
    Ok(Effect { forces, elements, bytes, ..Effect::default() })
}

impl Force for PartAttachments {
    fn update(&mut self, view: &PartView<'_>, _: &[Simd4], f: &mut [Simd4]) {
        for a in &mut self.springs {
            a.active = view.context.targets.is_active(a.target);
            if a.active {
                let apart = view.context.targets.position(a.target, view.fraction) - view.x[self.start + a.vertex];
                // The target's own velocity is part of the damping force that does not depend on the unknown.
                f[a.vertex] +=
                    Simd4::from(&(apart * a.stiffness + view.context.targets.velocity(a.target) * a.damping));
            }
        }
    }

    fn add_damping(&self, motion: &PartMotion<'_>, f: &mut [Simd4]) {
        for a in self.springs.iter().filter(|a| a.active) {
            f[a.vertex] -= motion.own_v[a.vertex] * a.damping;
        }
    }

    fn add_stiffness(&self, sums: &mut [f64]) {
        for a in &self.springs {
            sums[a.vertex] += a.stiffness;
        }
    }

    fn energy(&self, view: &PartView<'_>) -> f64 {
        let active = self.springs.iter().filter(|a| view.context.targets.is_active(a.target));
        let apart =
            |a: &Attachment| view.context.targets.position(a.target, view.fraction) - view.x[self.start + a.vertex];
        active.map(|a| 0.5 * a.stiffness * apart(a).norm_squared()).sum()
    }

    fn linearised(&self) -> Option<&dyn Linearised> {
        Some(self)
    }
}

impl Linearised for PartAttachments {
    fn add_blocks(&self, _: &PartView<'_>, factors: BlockFactors, _: &[Slot], rows: &mut PartBlocks) {
        for a in self.springs.iter().filter(|a| a.active) {
            rows.add_scalar(a.vertex, factors.stiffness * a.stiffness + factors.damping * a.damping);
        }
    }
}
