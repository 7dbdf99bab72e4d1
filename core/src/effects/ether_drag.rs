//! Ether drag: every vertex is pulled towards the velocity of a medium that fills space
//! (`docs/theory/step.md#membranes-altitudes-ether`).
//!
//! ```toml
//! [ether_drag]
//! rate = 2.0                  # 1/s; a motion without other forces loses 63 % of its speed in 1/rate seconds
//! velocity = [0, 0, 1.5]      # of the medium, m/s in solver axes; at rest if it is left out
//! ```
//!
//! The force on a vertex of mass m is `rate · m · (W − v)`. The part of the cloth's own velocity v is implicit, so that no rate
//! limits the time step. A free fall ends at `W + g / rate`, whatever the cloth weighs and however it is turned: that is the
//! limit of this model. Air that streams along cloth and presses against it is another effect.

#![cfg(feature = "effects")]

use crate::Vec3;
use crate::effects::force::{Force, PartView};
use crate::effects::spec::{BuildContext, Cost, Effect, EffectSpec, MapSpec, Need, Scope};
use crate::error::Problem;
use crate::parallel::simd4::Simd4;
use crate::settings::{Default, Dimension, Field, Settings};

/// Registry entry.
pub(crate) static SPEC: EffectSpec = EffectSpec {
    name: "ether_drag",
    summary: "global drag: slows all motion relative to the air, in proportion to the speed",
    scope: Scope::Scene,
    example: r"[ether_drag]
rate = 1.0",
    fields: &[
        Field {
            name: "rate",
            dimension: Dimension::Rate,
            default: Default::Required,
            range: (0.0, 1e6),
            help: "drag coefficient: fraction of the relative velocity that is lost per second; 0.5 calms, 5 is like \
                   water",
        },
        Field {
            name: "velocity",
            dimension: Dimension::Speed,
            default: Default::Vector([0.0; 3]),
            range: (-1e4, 1e4),
            help: "velocity of the air in solver axes (y up), for this drag",
        },
    ],
    needs: &[Need::State],
    elements: "vertices",
    maps: &[MapSpec::of("ether_drag", &["rate"])],
    cost: Cost { update: 2.0, ..Cost::NONE },
    build,
    ..EffectSpec::BARE
};

/// The drag on one part.
struct EtherDrag {
    /// Rate times mass of each vertex [kg/s].
    drag: Vec<f64>,
    /// Velocity of the medium [m/s].
    velocity: Vec3,
}

fn build(settings: &Settings, context: &BuildContext<'_>) -> Result<Effect, Problem> {
    let (rate, velocity) = (settings.number("rate"), Vec3::from(settings.vector("velocity")));
    let (parts, masses) = (context.scene.parts(), context.scene.masses());
    let painted = context.scene.painted_everywhere(SPEC.name);
    let rate_at = |vertex: usize| painted.as_ref().map_or(rate, |all| all[vertex][0] * rate + all[vertex][1]);
    let drag = |part: &std::ops::Range<usize>| EtherDrag {
        drag: part.clone().map(|vertex| rate_at(vertex) * masses[vertex]).collect(),
        velocity,
    };
    let forces = parts.ranges().iter().map(drag).map(|drag| Box::new(drag) as Box<dyn Force>).enumerate().collect();
    let bytes = parts.own().len() * size_of::<f64>() + parts.count() * size_of::<EtherDrag>();
    Ok(Effect { forces, elements: parts.own().len(), bytes, ..Effect::default() })
}

impl Force for EtherDrag {
    fn update(&mut self, _: &PartView<'_>, _: &[Simd4], f: &mut [Simd4]) {
        let velocity = Simd4::from(&self.velocity);
        for (f, drag) in f.iter_mut().zip(&self.drag) {
            *f += velocity * *drag;
        }
    }

    fn vertex_drag(&self) -> &[f64] {
        &self.drag
    }
}
