//! Membrane: triangles of constant strain with the measured stiffness of cloth along its warp, along its weft and in shear
//! (`docs/theory/step.md#membranes-altitudes-ether`). It takes the place of the springs of `stretch`.
//!
//! ```toml
//! [garment.membrane]
//! warp = "219 N/m"            # force per width of a strip cut along the warp, by its strain
//! weft = "1037 N/m"
//! shear = "68 N/m"            # force per width by change of the angle between warp and weft
//! poisson = 0.2
//! grain = [0, 1, 0]           # the warp in the rest shape
//! damping_ratio = 1.0
//! ```
//!
//! A triangle's deformation gradient `F = R U` is split into a turned frame R and a stretch U; the strain is `ε = U − 1` in
//! the frame of warp and weft, so turning costs nothing and stress is linear in the relative change of length, as testing
//! machines report it: `σ = C ε`, energy `½ ε·C ε` by rest area, forces its slope. `C` is that of an orthotropic sheet with
//! the three moduli and the geometric mean `poisson` of Poisson's two ratios, and positive for any allowed values. Damping is
//! `β C` on the rate of ε, implicit; β makes `damping_ratio` the fraction of critical damping of a triangle's stiffest motion
//! with the masses of its corners.
//!
//! With `extension` warp and weft stiffen as they are pulled ([`tensile_curve`]): the curve's part beyond the
//! linear one is added to the stress of each, so that a strip cut along either has that curve exactly. Shear stays linear.
//!
//! The warp of a triangle is `grain` projected onto its plane in the rest shape, turned by `grain_angle` about its normal.
//! The next axis takes the place of the grain where the grain stands upright on a triangle (z for y, x for z, y for
//! x), so that a sheet that lies flat and says nothing has its warp along z.
//!
//! Limits: a triangle that is pressed to a line or a point resists with finite forces and may turn over, as cloth may. The
//! stiffest triangle sets the time step; the thinnest `thin_triangles` of them are softened.

#![cfg(feature = "effects")]

mod element;
mod part_membrane;

use std::ops::Range;

use crate::Vec3;
use crate::effects::spec::{BuildContext, Cost, Effect, EffectSpec, MapSpec, Need, Scope, Study};
use crate::effects::springs::smallest_but;
use crate::effects::tensile_curve::{self, TensileCurve};
use crate::error::Problem;
use crate::settings::{Default, Dimension, Field, Settings};
use element::{Gradients, Law, Moduli, gradients, largest_stiffness};

/// Registry entry.
pub(crate) static SPEC: EffectSpec = EffectSpec {
    name: "membrane",
    summary: "finite elements resist stretching along warp and weft, and shear, each with its own stiffness",
    scope: Scope::Garment,
    example: r#"[garment.membrane]
warp = "50 N/m""#,
    fields: &[
        Field {
            name: "warp",
            dimension: Dimension::Stiffness,
            default: Default::Required,
            range: (0.0, 1e10),
            help: "force per width and strain of a strip along the warp; cloth has 30 to 3000 N/m",
        },
        Field {
            name: "weft",
            dimension: Dimension::Stiffness,
            default: Default::Absent,
            range: (0.0, 1e10),
            help: "the same along the weft; as along the warp if it is left out",
        },
        Field {
            name: "shear",
            dimension: Dimension::Stiffness,
            default: Default::Absent,
            range: (0.0, 1e10),
            help: "force per width by change of the angle between warp and weft; woven cloth has a tenth of its stretch \
                   stiffness; that of an isotropic sheet if it is left out",
        },
        Field {
            name: "poisson",
            dimension: Dimension::None,
            default: Default::Number(0.2),
            range: (-0.95, 0.95),
            help: "Poisson's ratio, geometric mean of warp and weft: how much a stretched strip narrows, by its strain",
        },
        Field {
            name: "damping_ratio",
            dimension: Dimension::None,
            default: Default::Number(1.0),
            range: (0.0, 1e3),
            help: "damping of each triangle; 1 is critical for its stiffest motion with its corners' masses, 0 rings \
                   for ever",
        },
        Field {
            name: "grain",
            dimension: Dimension::None,
            default: Default::Vector([0.0, 1.0, 0.0]),
            range: (-1e9, 1e9),
            help: "direction of the warp in the rest shape, in solver axes (y up); its length does not matter",
        },
        Field {
            name: "grain_angle",
            dimension: Dimension::Angle,
            default: Default::Number(0.0),
            range: (-10.0, 10.0),
            help: "turns the warp in the cloth's plane, counter-clockwise seen from where the faces point; 45 deg is a \
                   cut on the bias",
        },
        Field {
            name: "thin_triangles",
            dimension: Dimension::None,
            default: Default::Number(0.05),
            range: (0.0, 0.5),
            help: "fraction of the triangles, the thinnest ones, that are softened to the time step of the thickest \
                   among them, so that a few slivers do not limit that of all",
        },
        tensile_curve::FIELDS[0],
        tensile_curve::FIELDS[1],
        tensile_curve::FIELDS[2],
    ],
    needs: &[Need::State],
    elements: "triangles",
    maps: &[
        MapSpec::fraction("membrane", &["warp", "weft", "shear"]),
        MapSpec::of("grain_angle", &["grain_angle"]),
        MapSpec::of("membrane_damping", &["damping_ratio"]),
    ],
    study: Study { is_essential: true, ..Study::INTERNAL },
    cost: Cost { bytes_of_point: 380.0, update: 40.0, product: 15.0 },
    build,
    ..EffectSpec::BARE
};

/// Largest share of the grain's length that lies in the plane of a triangle on which it counts as upright.
const UPRIGHT: f64 = 0.1;

/// One triangle before it is sorted into parts.
#[derive(Debug, Clone, Copy)]
struct TriangleElement {
    /// Local vertices.
    corners: [usize; 3],
    gradients: Gradients,
    /// Rest area, less where the triangle is softened [m²].
    weight: f64,
    /// Largest stiffness that a motion of the corners meets [N/m].
    stiffness: f64,
    /// Damping as a fraction of critical.
    damping_ratio: f64,
}

fn build(settings: &Settings, context: &BuildContext<'_>) -> Result<Effect, Problem> {
    let Some(garment) = context.garment else {
        let advice = "move its table under a [[garment]]";
        return Err(Problem::scene("membrane", "this effect acts on one garment", advice));
    };
    let description = context.scene.description();
    let place = format!("garment \"{}\", membrane", description.garments[garment].name);
    if description.effects.iter().any(|e| e.effect == "stretch" && e.garment == Some(garment)) {
        let what = "`stretch` and `membrane` are both requested, and both resist the same stretching";
        return Err(Problem::scene(place, what, "remove one of the two tables"));
    }
    let grain = Vec3::from(settings.vector("grain"));
    if grain == Vec3::zeros() {
        return Err(Problem::scene(place, "`grain` is a zero vector", "write for example grain = [0, 1, 0]"));
    }
    let (threads, moduli) = moduli(settings);
    let curves = TensileCurve::of_garment(settings, context, SPEC.name, threads)?;
    let warp = |corners, angle| turned(warp_at_rest(grain, corners), corners, angle);
    let mut elements = elements(settings, context, garment, &moduli, warp);
    let (count, notes) = soften(&mut elements, context, settings.number("thin_triangles"));
    weigh(&mut elements, context, garment);
    let (forces, bytes) =
        part_membrane::build(context.scene, &elements, Law { moduli, curves: paired(threads, curves) });
    Ok(Effect { forces, elements: count, bytes, notes, ..Effect::default() })
}

/// Curves with the stiffness that each is over.
fn paired(threads: [f64; 2], curves: [Option<TensileCurve>; 2]) -> [Option<(f64, TensileCurve)>; 2] {
    [0, 1].map(|axis| Some((threads[axis], curves[axis]?)))
}

/// The stiffness along warp and weft [N/m], and the moduli.
fn moduli(settings: &Settings) -> ([f64; 2], Moduli) {
    let (warp, poisson) = (settings.number("warp"), settings.number("poisson"));
    let weft = settings.optional("weft").unwrap_or(warp);
    let shear = settings.optional("shear").unwrap_or((warp * weft).sqrt() / (2.0 * (1.0 + poisson)));
    ([warp, weft], Moduli::new([warp, weft, shear], poisson))
}

/// The direction in a triangle at rest that `grain` means: itself, or the next axis where it stands upright.
fn warp_at_rest(grain: Vec3, corners: [Vec3; 3]) -> Vec3 {
    let normal = (corners[1] - corners[0]).cross(&(corners[2] - corners[0])).normalize();
    let mut warp = grain;
    // Of three axes at right angles no more than one stands upright.
    while (warp - normal * normal.dot(&warp)).norm() < UPRIGHT * warp.norm() {
        warp = Vec3::new(warp.y, warp.z, warp.x);
    }
    warp - normal * normal.dot(&warp)
}

/// A direction in a triangle turned about its normal by `angle` [rad].
fn turned(direction: Vec3, corners: [Vec3; 3], angle: f64) -> Vec3 {
    let normal = (corners[1] - corners[0]).cross(&(corners[2] - corners[0])).normalize();
    let (sin, cos) = libm::sincos(angle);
    direction * cos + normal.cross(&direction) * sin
}

/// The triangles with a vertex of this rank.
fn elements(
    settings: &Settings,
    context: &BuildContext<'_>,
    garment: usize,
    moduli: &Moduli,
    warp: impl Fn([Vec3; 3], f64) -> Vec3,
) -> Vec<TriangleElement> {
    let (parts, mesh) = (context.scene.parts(), &context.scene.meshes()[garment]);
    let first = parts.garment(garment).start;
    let [angle, damping] = ["grain_angle", "damping_ratio"].map(|name| settings.number(name));
    let element = |corners: &[u32; 3]| {
        let painted = |of: &str, of_garment| context.scene.painted_mean(garment, of, corners, of_garment);
        let rest = corners.map(|v| mesh.rest_positions()[v as usize]);
        let (gradients, area) = gradients(rest, warp(rest, painted("grain_angle", angle)));
        let stiffness = area * largest_stiffness(&gradients, moduli);
        let damping_ratio = painted("membrane_damping", damping);
        TriangleElement {
            corners: corners.map(|v| first + v as usize),
            gradients,
            weight: area,
            stiffness,
            damping_ratio,
        }
    };
    let is_near = |corners: &&[u32; 3]| corners.iter().any(|v| parts.own().contains(&(first + *v as usize)));
    mesh.triangles().iter().filter(is_near).map(element).collect()
}

/// Softens the thinnest triangles, those with the most stiffness by area, to the `share`-th of them. Returns how many triangles
/// count at this rank, and a note on those that were softened.
fn soften(elements: &mut [TriangleElement], context: &BuildContext<'_>, share: f64) -> (usize, Vec<String>) {
    let parts = context.scene.parts();
    let own: Range<usize> = parts.own();
    // Each triangle counts at the rank that owns its first vertex.
    let counts = |e: &&TriangleElement| e.corners.iter().min().is_some_and(|first| own.contains(first));
    let thickness = |e: &TriangleElement| e.weight / e.stiffness;
    let all: Vec<f64> = elements.iter().filter(counts).map(thickness).collect();
    let [count] = parts.ranks().sum_of([all.len() as u64]);
    let place = (share * count as f64) as u64;
    let thinnest = if place > 0 && place < count { smallest_but(place, &all, parts.ranks()) } else { 0.0 };
    let [softened] = parts.ranks().sum_of([all.iter().filter(|t| **t < thinnest).count() as u64]);
    for element in elements {
        let share = thickness(element) / thinnest;
        if share < 1.0 {
            (element.weight, element.stiffness) = (element.weight * share, element.stiffness * share);
        }
    }
    let note = format!("the {softened} thinnest triangles are softened, so that they do not set the time step");
    (all.len(), if softened > 0 { vec![note] } else { Vec::new() })
}

/// Gives every triangle the share of the stiffness that is painted on its corners, on average.
fn weigh(elements: &mut [TriangleElement], context: &BuildContext<'_>, garment: usize) {
    let Some(map) = context.scene.painted(garment, SPEC.name) else { return };
    let first = context.scene.parts().garment(garment).start;
    for element in elements {
        let share = map.mean(&element.corners.map(|corner| (corner - first) as u32), 1.0);
        (element.weight, element.stiffness) = (element.weight * share, element.stiffness * share);
    }
}
