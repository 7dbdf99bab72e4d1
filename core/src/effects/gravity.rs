//! Gravity: every vertex feels its mass times a constant acceleration.
//!
//! ```toml
//! [gravity]
//! acceleration = [0, -9.81, 0]
//! ```

use crate::Vec3;
use crate::effects::force::{Force, PartView};
use crate::effects::spec::{BuildContext, Cost, Effect, EffectSpec, Need, Scope, Study};
use crate::error::Problem;
use crate::parallel::simd4::Simd4;
use crate::settings::{Default, Dimension, Field, Settings};

/// Registry entry.
pub static SPEC: EffectSpec = EffectSpec {
    name: "gravity",
    summary: "a constant acceleration of every vertex",
    scope: Scope::Scene,
    example: r"[gravity]
acceleration = [0, -9.81, 0]",
    fields: &[Field {
        name: "acceleration",
        dimension: Dimension::Acceleration,
        default: Default::Vector([0.0, -9.81, 0.0]),
        range: (-1e4, 1e4),
        help: "acceleration in solver axes (y up); the earth's is [0, -9.81, 0] m/s²",
    }],
    needs: &[Need::State],
    elements: "vertices",
    study: Study { is_essential: true, ..Study::INTERNAL },
    cost: Cost { update: 1.0, ..Cost::NONE },
    build,
    ..EffectSpec::BARE
};

struct Gravity {
    acceleration: Vec3,
}

fn build(settings: &Settings, context: &BuildContext<'_>) -> Result<Effect, Problem> {
    let acceleration = Vec3::from(settings.vector("acceleration"));
    let parts = context.scene.parts().count();
    let forces = (0..parts).map(|part| (part, Box::new(Gravity { acceleration }) as Box<dyn Force>)).collect();
    let (elements, bytes) = (context.scene.parts().own().len(), parts * size_of::<Gravity>());
    Ok(Effect { forces, elements, bytes, ..Effect::default() })
}

impl Force for Gravity {
    fn update(&mut self, view: &PartView<'_>, _: &[Simd4], f: &mut [Simd4]) {
        let acceleration = Simd4::from(&self.acceleration);
        for (f, m) in f.iter_mut().zip(view.masses) {
            *f += acceleration * *m;
        }
    }

    fn energy(&self, view: &PartView<'_>) -> f64 {
        let own = &view.x[view.start..view.start + view.masses.len()];
        own.iter().zip(view.masses).map(|(x, m)| -m * self.acceleration.dot(x)).sum()
    }
}
