//! Pressure inside a closed garment: balloons, cushions, quilted jackets.
//!
//! Every triangle of area A and outward normal N pushes each of its corners with `p A N/3`: exactly the gradient of the
//! enclosed volume, so momentum is kept and `−p V` is the energy. `overpressure` is what the inside has more than the outside.
//! With `gas = true` the amount of gas stays instead: at the rest shape's volume V₀ it has that overpressure, and at volume V
//!
//! ```text
//! p = (p_ambient + overpressure) V₀ / V − p_ambient
//! ```
//!
//! so that squeezing raises it. V is a sum over all triangles, found once before the forces of each solve.
//!
//! ```toml
//! [garment.pressure]
//! overpressure = "500 Pa"
//! gas = true
//! ```
//!
//! Limits: the gas has no weight and no flow; one volume for each garment, so a garment of several closed pieces shares its
//! gas. Gas is stiff (the earth's air has 100 kPa): semi-implicit steps of light cloth are short. Long steps take the gas into their
//! matrix ([`crate::solve::volume_terms`]), and repeat their solves for pressure that turns with its triangles. `open = true` lets the surface
//! have edges, which then feel a net force, as a parachute does.

#![cfg(feature = "effects")]

use crate::Vec3;
use crate::effects::force::{Enclosing, Force, ForceContext, PartView};
use crate::effects::spec::{BuildContext, Cost, Effect, EffectSpec, Need, Scope, Study};
use crate::elements::at_corners;
use crate::elements::part_triangles::{PartTriangles, area_vector};
use crate::error::Problem;
use crate::mesh::unpaired_edges;
use crate::parallel::problems::listed;
use crate::parallel::simd4::Simd4;
use crate::scene::Scene;
use crate::settings::{Default, Dimension, Field, Settings};
use crate::volumes::{Gas, Volume, own_in_mesh, volume_of};

/// Registry entry.
pub(crate) static SPEC: EffectSpec = EffectSpec {
    name: "pressure",
    summary: "pressure inside a closed garment pushes outwards",
    scope: Scope::Garment,
    example: r"[garment.pressure]
overpressure = 1.0
open = true",
    fields: FIELDS,
    needs: &[Need::State],
    elements: "triangles",
    // Gas and overpressure have an energy of their own.
    study: Study { does_work: Some(|_| false), ..Study::OUTSIDE },
    cost: Cost { update: 20.0, ..Cost::NONE },
    looks_at_sides: |_| Some("`pressure`"),
    build,
    ..EffectSpec::BARE
};

const FIELDS: &[Field] = &[
    Field {
        name: "overpressure",
        dimension: Dimension::Pressure,
        default: Default::Number(0.0),
        range: (-1e6, 1e6),
        help: "pressure inside minus pressure outside; a cushion has 100 Pa, a toy balloon 2 kPa; negative sucks",
    },
    Field {
        name: "gas",
        dimension: Dimension::None,
        default: Default::Flag(false),
        range: (0.0, 0.0),
        help: "true: a fixed amount of gas, so that squeezing raises the pressure; false: constant pressure",
    },
    Field {
        name: "ambient",
        dimension: Dimension::Pressure,
        default: Default::Number(101_325.0),
        range: (1.0, 1e7),
        help: "with `gas`: pressure outside; the larger it is, the stiffer the gas and the shorter the steps of `semi_implicit`",
    },
    Field {
        name: "open",
        dimension: Dimension::None,
        default: Default::Flag(false),
        range: (0.0, 0.0),
        help: "true: the garment may have open edges; not with `gas`",
    },
];

/// The pressure on one part.
struct PartPressure {
    garment: usize,
    triangles: PartTriangles,
    /// Inside less outside at rest [Pa].
    overpressure: f64,
    /// 1, or -1 if the faces look inwards.
    side: f64,
    /// If the amount of gas stays.
    gas: Option<Gas>,
    /// Contributions of each vertex to the limit of short steps [N/m]: of pressure that turns with its triangles, and of gas.
    turning: Vec<f64>,
    breathing: Option<Vec<f64>>,
}

fn build(settings: &Settings, context: &BuildContext<'_>) -> Result<Effect, Problem> {
    let (scene, garment) = (context.scene, context.garment.unwrap_or(0));
    let (parts, mesh) = (scene.parts(), &scene.meshes()[garment]);
    let place = format!("garment \"{}\", pressure", scene.description().garments[garment].name);
    let (open, has_gas) = (settings.flag("open"), settings.flag("gas"));
    if open && has_gas {
        return Err(Problem::scene(place, "an open garment cannot hold gas", "leave `gas` or `open` out"));
    }
    let own = own_in_mesh(parts, garment);
    let number = |v: u32| parts.own_vertex(parts.garment(garment).start + v as usize).1;
    let unpaired = unpaired_edges(mesh.triangles(), |v| own.contains(&v)).into_iter().map(|edge| {
        let [a, b] = edge.map(number);
        [a.min(b), a.max(b)]
    });
    let unpaired = listed(parts.ranks(), unpaired.collect());
    if let Some(edges) = unpaired.filter(|_| !open) {
        let what = format!("it is not closed, or not all its faces point outwards: edges {edges}");
        let advice = "close the holes, make the normals consistent, or write open = true";
        return Err(Problem::data(place, what, advice));
    }
    let of_parts = PartTriangles::of(scene, garment..garment + 1);
    let x = scene.rest_positions();
    let mut volume = Volume::new(parts, garment, &of_parts);
    volume.update(parts, &x);
    let rest_volume = volume.value();
    // Faces that all look inwards are as good as ones that look outwards.
    let side = if rest_volume < 0.0 && !open { -1.0 } else { 1.0 };
    let overpressure = settings.number("overpressure");
    let gas = has_gas.then(|| Gas { ambient: settings.number("ambient"), overpressure, rest_volume });
    gas.into_iter().for_each(|gas| volume.fill(gas));
    let mut effect = Effect { bytes: if has_gas { volume.bytes() } else { 0 }, ..Effect::default() };
    let breathing = gas.map_or(0.0, |gas| breathing(scene, &of_parts, gas, &x));
    for (part, triangles) in of_parts {
        let turning = turning_stiffness(scene, part, &triangles, overpressure.abs(), &x);
        effect.elements += triangles.counted();
        effect.bytes += triangles.bytes() + size_of_val(turning.as_slice());
        let breathing = gas.map(|_| breathing_stiffness(&scene.masses()[parts.ranges()[part].clone()], breathing));
        effect.bytes += breathing.as_deref().map_or(0, size_of_val);
        let force = PartPressure { garment, triangles, overpressure, side, gas, turning, breathing };
        effect.forces.push((part, Box::new(force)));
    }
    effect.volume = has_gas.then_some(volume);
    Ok(effect)
}

/// The square of the frequency at which gas lets a garment breathe [1/s²]: `P/V Σ |g|²/m` with g the area of each vertex.
fn breathing(scene: &Scene, of_parts: &[(usize, PartTriangles)], gas: Gas, x: &[Vec3]) -> f64 {
    let parts = scene.parts();
    let mut sums = vec![0.0; parts.count()];
    for (part, triangles) in of_parts {
        let range = parts.ranges()[*part].clone();
        let mut areas = vec![Simd4::ZERO; range.len()];
        for corners in triangles.corners() {
            triangles.add(corners, &(area_vector(&at_corners(corners, x)) / 3.0), &mut areas);
        }
        sums[*part] = areas.iter().zip(&scene.masses()[range]).map(|(g, m)| g.dot(*g) / m).sum();
    }
    let [sum] = parts.join_parts(&[&sums]);
    (gas.ambient + gas.overpressure).abs() / gas.rest_volume.abs() * sum
}

/// Returns the contribution of the turning of pressure to the step limit for each vertex of a part [N/m]: a triangle that moves turns
/// the pressure on it, and a corner feels at most p/6 times its perimeter per way of the others, which is doubled for what inflates.
fn turning_stiffness(scene: &Scene, part: usize, triangles: &PartTriangles, pressure: f64, x: &[Vec3]) -> Vec<f64> {
    let range = scene.parts().ranges()[part].clone();
    let mut sums = vec![0.0; range.len()];
    for corners in triangles.corners() {
        let [a, b, c] = at_corners(corners, x);
        let perimeter = (b - a).norm() + (c - b).norm() + (a - c).norm();
        for vertex in corners {
            if let Some(sum) = sums.get_mut((*vertex as usize).wrapping_sub(range.start)) {
                *sum += pressure * perimeter / 6.0;
            }
        }
    }
    sums
}

/// Returns the contribution of gas to the step limit for each vertex of a part with these masses [N/m], from the square of the frequency at
/// which the garment breathes [1/s²]. Gas moves all vertices together: with `2 m ω²` at each the limit is 1.4/ω at the CFL number 4, where
/// 2/ω is stable.
fn breathing_stiffness(masses: &[f64], breathing: f64) -> Vec<f64> {
    masses.iter().map(|mass| 2.0 * mass * breathing).collect()
}

impl PartPressure {
    /// Inside less outside [Pa].
    fn pressure(&self, context: &ForceContext<'_>) -> f64 {
        self.gas.map_or(self.overpressure, |gas| gas.pressure(context.volumes.of(self.garment)))
    }
}

impl Force for PartPressure {
    fn update(&mut self, view: &PartView<'_>, _: &[Simd4], f: &mut [Simd4]) {
        let share = self.side * self.pressure(&view.context) / 3.0;
        for corners in self.triangles.corners() {
            self.triangles.add(corners, &(area_vector(&at_corners(corners, view.x)) * share), f);
        }
    }

    fn add_stiffness(&self, sums: &mut [f64]) {
        sums.iter_mut().zip(&self.turning).for_each(|(sum, own)| *sum += own);
        sums.iter_mut().zip(self.breathing.iter().flatten()).for_each(|(sum, own)| *sum += own);
    }

    // The turning couples two corners of a triangle by p/6 times a side: no block of it is positive, and what bounds it from above would
    // let the cloth follow it late. The tension that pressure causes, which is in the matrix, outweighs it.
    fn is_iterated(&self) -> bool {
        true
    }

    fn enclosing(&self) -> Option<&dyn Enclosing> {
        self.gas.is_some().then_some(self)
    }

    fn neighbours(&self) -> &[u32] {
        self.triangles.neighbours()
    }

    fn energy(&self, view: &PartView<'_>) -> f64 {
        let here = volume_of(self.triangles.corners(), |corners| self.triangles.counts(corners), view.x);
        match self.gas {
            None => -self.overpressure * self.side * here,
            // Shared out by what each part has of the volume.
            Some(gas) => {
                let all = view.context.volumes.of(self.garment);
                gas.energy(all) * here / all
            }
        }
    }
}

impl Enclosing for PartPressure {
    fn add_volume_gradient(&self, x: &[Vec3], gradient: &mut [Simd4]) {
        for corners in self.triangles.corners() {
            self.triangles.add(corners, &(area_vector(&at_corners(corners, x)) / 3.0), gradient);
        }
    }
}
