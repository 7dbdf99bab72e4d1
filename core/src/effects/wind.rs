//! Wind and the drag of the air (`docs/theory/step.md#the-air`): what moves relative to the air feels it.
//!
//! With R = W − V the wind W relative to the cloth's velocity V, there are three forces, each only if it is asked for:
//!
//! * *tangential*: friction of the air along the surface. Each triangle of area A, unit normal N and mean velocity V gives
//!   `ν (R − (R·N) N) A/3` to each corner.
//! * *pressure*: the air that the cloth stops. Each triangle gives `ρ |R·N| (R·N) N A/3` to each corner. A plate across the
//!   wind has a drag coefficient of 2 with the density of air, twice what is measured: `density` is that of the air times
//!   half the drag coefficient wanted (0.77 kg/m³ for a plate in air).
//! * *normal*: each vertex of mass m and normal n feels `c m (R·n) n`, the authors' linear form. It does not depend on how
//!   heavy the cloth is.
//!
//! The part with W is explicit and the part with −V implicit, so that drag of any strength sets no limit to the time step
//! and none is counted twice. The factor `|R·N|` is that of the velocity known before the solve, which in B.5 is the one
//! foreseen for the middle of the step: second order in dt like everything else. In the authors' code this term is explicit
//! as a whole, which blows light cloth up.
//!
//! ```toml
//! [wind]
//! velocity = [4, 0, 1]            # or keys = [[0, [0, 0, 0]], [2, [6, 0, 0]]]
//! density = "0.77 kg/m³"
//! tangential = "0.02 N s/m³"
//! file = "gusts.h5"               # added to the velocity; docs/reference/wind_grid.md
//! ```
//!
//! Limits: the air does not feel the cloth. There is no lee behind a body or a layer, no lift of streamlines and no mass of
//! air that is carried along.

#![cfg(feature = "effects")]

use std::sync::Arc;

use nalgebra::Matrix3;

use crate::Vec3;
use crate::block_matrix::{PartBlocks, Slot};
use crate::effects::force::{BlockFactors, Force, ForceContext, Linearised, PartMotion, PartView};
use crate::effects::spec::{BuildContext, Cost, Effect, EffectSpec, MapSpec, Need, Scope};
use crate::elements::at_corners;
use crate::elements::part_triangles::{PartTriangles, area_vector};
use crate::error::Problem;
use crate::geometry::attachment::along_path;
use crate::parallel::simd4::Simd4;
use crate::scene::Scene;
use crate::settings::{Default, Dimension, Field, Settings};

/// Registry entry.
pub(crate) static SPEC: EffectSpec = EffectSpec {
    name: "wind",
    summary: "wind and air resistance: drag by the velocity of cloth relative to the air",
    scope: Scope::Scene,
    example: r"[wind]
density = 1.2
velocity = [0, 2, 0]",
    fields: FIELDS,
    needs: &[Need::State],
    elements: "triangles",
    maps: &[MapSpec::fraction("wind", &["tangential", "density", "normal"])],
    cost: Cost { bytes_of_point: 100.0, update: 20.0, product: 6.0 },
    looks_at_sides: |request| request.settings.contains_key("normal").then_some("`normal` of the wind"),
    build,
    ..EffectSpec::BARE
};

const FIELDS: &[Field] = &[
    Field {
        name: "velocity",
        dimension: Dimension::Speed,
        default: Default::Vector([0.0, 0.0, 0.0]),
        range: (-1e3, 1e3),
        help: "velocity of the air in solver axes (y up); left out, it stands still and only drags",
    },
    Field {
        name: "keys",
        dimension: Dimension::Speed,
        default: Default::Keys,
        range: (-1e3, 1e3),
        help: "velocity over time instead, [[seconds since the first frame, [x, y, z]], …], joined by straight lines",
    },
    Field {
        name: "file",
        dimension: Dimension::None,
        default: Default::File,
        range: (0.0, 0.0),
        help: "an HDF5 file of velocities on a grid, added to the above; its layout is in wind_grid.md",
    },
    Field {
        name: "density",
        dimension: Dimension::Density,
        default: Default::Absent,
        range: (0.0, 1e4),
        help: "drag normal to the surface, by the square of the speed; 0.77 for a plate in air, 1.2 at most",
    },
    Field {
        name: "tangential",
        dimension: Dimension::Drag,
        default: Default::Absent,
        range: (0.0, 1e6),
        help: "drag along the surface, proportional to the speed; about 0.01 for cloth in a breeze",
    },
    Field {
        name: "normal",
        dimension: Dimension::Rate,
        default: Default::Absent,
        range: (0.0, 1e6),
        help: "drag normal to the surface, by mass and speed, as in the scenes of Selle et al. (2009), where it is 2",
    },
];

/// Properties that are the same for all parts.
struct Air {
    velocity: Vec3,
    keys: Vec<(f64, Vec3)>,
    /// ν [N s/m³].
    tangential: f64,
    /// ρ [kg/m³].
    density: f64,
    /// c [1/s].
    normal: f64,
}

impl Air {
    /// Velocity of the air at a place [m/s]; `steady` is that which does not depend on the place.
    fn at(context: &ForceContext<'_>, steady: &Vec3, place: &Vec3) -> Vec3 {
        if context.wind.exists() { steady + context.wind.velocity(place, context.time) } else { *steady }
    }
}

/// The wind on one part, with what the last update found.
struct PartWind {
    air: Arc<Air>,
    triangles: PartTriangles,
    /// Painted share of the wind of each triangle, and of each own vertex; empty if none is painted.
    shares: [Vec<f64>; 2],
    /// For each triangle its unit normal, and the drag [N s/m] of a corner in all directions and more along the normal; empty
    /// if triangles feel nothing.
    drags: Vec<(Vec3, [f64; 2])>,
    /// For each own vertex its unit normal times the root of its drag [(N s/m)^½]; empty if vertices feel nothing.
    normals: Vec<Vec3>,
}

fn build(settings: &Settings, context: &BuildContext<'_>) -> Result<Effect, Problem> {
    let [tangential, density, normal] =
        ["tangential", "density", "normal"].map(|name| settings.optional(name).unwrap_or(0.0));
    let keys: Vec<(f64, Vec3)> = settings.keys("keys").iter().map(|(time, v)| (*time, Vec3::from(*v))).collect();
    let velocity = Vec3::from(settings.vector("velocity"));
    let is_idle = tangential == 0.0 && density == 0.0 && normal == 0.0;
    if is_idle && !context.changes(&["wind.tangential", "wind.density", "wind.normal"]) {
        let advice = "give `density`, `tangential` or `normal` a value above zero, or leave the table out";
        return Err(Problem::scene("wind", "no effect: `density`, `tangential` and `normal` are all zero", advice));
    }
    if !keys.is_empty() && velocity != Vec3::zeros() {
        return Err(Problem::scene("wind", "`velocity` and `keys` exclude each other", "leave one of them out"));
    }
    if settings.text("file").is_some() != context.scene.description().wind.is_some() {
        return Err(Problem::scene(
            "wind",
            "a wind grid requires `file`, and `file` requires the grid",
            "give both or none",
        ));
    }
    let air = Arc::new(Air { velocity, keys, tangential, density, normal });
    let scene = context.scene;
    let painted = scene.painted_everywhere("wind");
    let mut effect = Effect { sees_velocities: density > 0.0, ..Effect::default() };
    for (part, triangles) in PartTriangles::of(scene, 0..scene.meshes().len()) {
        let by_area = tangential > 0.0 || density > 0.0;
        let drags = vec![(Vec3::zeros(), [0.0; 2]); if by_area { triangles.count() } else { 0 }];
        let normals = vec![Vec3::zeros(); if normal > 0.0 { scene.parts().ranges()[part].len() } else { 0 }];
        let shares =
            painted.as_ref().map_or_else(<[Vec<f64>; 2]>::default, |painted| shares(scene, part, &triangles, painted));
        effect.elements += triangles.counted();
        effect.bytes += triangles.bytes() + size_of_val(drags.as_slice()) + size_of_val(normals.as_slice());
        effect.bytes += shares.iter().map(|share| size_of_val(share.as_slice())).sum::<usize>();
        effect.forces.push((part, Box::new(PartWind { air: Arc::clone(&air), triangles, shares, drags, normals })));
    }
    Ok(effect)
}

/// Returns the painted shares of the wind, on the triangles of a part and on its vertices.
fn shares(scene: &Scene, part: usize, triangles: &PartTriangles, painted: &[[f64; 2]]) -> [Vec<f64>; 2] {
    let of_triangle = |corners: &[u32; 3]| corners.iter().map(|v| painted[*v as usize][0]).sum::<f64>() / 3.0;
    let own = scene.parts().ranges()[part].clone();
    [triangles.corners().iter().map(of_triangle).collect(), painted[own].iter().map(|share| share[0]).collect()]
}

/// Mean of what belongs to the corners.
fn mean(of: &[Vec3; 3]) -> Vec3 {
    (of[0] + of[1] + of[2]) / 3.0
}

impl PartWind {
    /// Tangential drag and pressure.
    fn push_triangles(&mut self, view: &PartView<'_>, steady: &Vec3, f: &mut [Simd4]) {
        let Self { air, triangles, shares, drags, .. } = self;
        for (t, (corners, (normal, drag))) in triangles.corners().iter().zip(drags).enumerate() {
            let x = at_corners(corners, view.x);
            let across = area_vector(&x);
            let area = across.norm();
            // A triangle without area stops no air.
            *normal = if area > 0.0 { across / area } else { Vec3::zeros() };
            let wind = Air::at(&view.context, steady, &mean(&x));
            let mut along_normal = -air.tangential;
            if air.density > 0.0 {
                let relative = wind - mean(&at_corners(corners, view.context.v));
                along_normal += air.density * relative.dot(normal).abs();
            }
            // A third of the triangle for each corner, and of that what is painted.
            let share = shares[0].get(t).map_or(area / 3.0, |share| share * area / 3.0);
            *drag = [air.tangential * share, along_normal * share];
            triangles.add(corners, &dragged(&wind, normal, drag), f);
        }
    }

    /// Drag across the surface at the vertices.
    fn push_vertices(&mut self, view: &PartView<'_>, steady: &Vec3, f: &mut [Simd4]) {
        self.normals.fill(Vec3::zeros());
        for corners in self.triangles.corners() {
            let across = area_vector(&at_corners(corners, view.x));
            for vertex in corners {
                if let Some(sum) = self.normals.get_mut((*vertex as usize).wrapping_sub(view.start)) {
                    *sum += across;
                }
            }
        }
        for (i, (normal, mass)) in self.normals.iter_mut().zip(view.masses).enumerate() {
            let length = normal.norm();
            let drag = self.shares[1].get(i).map_or(mass * self.air.normal, |share| share * mass * self.air.normal);
            *normal *= if length > 0.0 { drag.sqrt() / length } else { 0.0 };
            let wind = Air::at(&view.context, steady, &view.x[view.start + i]);
            f[i] += Simd4::from(&*normal) * wind.dot(normal);
        }
    }
}

/// Drag of a triangle's corner at this relative velocity [N].
#[inline]
fn dragged(v: &Vec3, normal: &Vec3, [all, along]: &[f64; 2]) -> Vec3 {
    v * *all + normal * (along * v.dot(normal))
}

impl Force for PartWind {
    fn update(&mut self, view: &PartView<'_>, _: &[Simd4], f: &mut [Simd4]) {
        let steady = self.air.velocity + along_path(&self.air.keys, view.context.time);
        if !self.drags.is_empty() {
            self.push_triangles(view, &steady, f);
        }
        if !self.normals.is_empty() {
            self.push_vertices(view, &steady, f);
        }
    }

    fn add_damping(&self, motion: &PartMotion<'_>, f: &mut [Simd4]) {
        for (corners, (normal, drag)) in self.triangles.corners().iter().zip(&self.drags) {
            let v = mean(&at_corners(corners, motion.v));
            self.triangles.add(corners, &-dragged(&v, normal, drag), f);
        }
        for ((f, normal), v) in f.iter_mut().zip(&self.normals).zip(motion.own_v) {
            let normal = Simd4::from(normal);
            *f -= normal * normal.dot(*v);
        }
    }

    fn neighbours(&self) -> &[u32] {
        self.triangles.neighbours()
    }

    fn linearised(&self) -> Option<&dyn Linearised> {
        Some(self)
    }
}

impl Linearised for PartWind {
    fn visit_elements(&self, visit: &mut dyn FnMut(&[u32])) {
        if !self.drags.is_empty() {
            self.triangles.corners().iter().for_each(|corners| visit(corners));
        }
    }

    fn add_blocks(&self, view: &PartView<'_>, factors: BlockFactors, slots: &[Slot], rows: &mut PartBlocks) {
        for ((corners, slots), (normal, [all, along])) in
            self.triangles.corners().iter().zip(slots.as_chunks::<3>().0).zip(&self.drags)
        {
            // Each corner feels a third of what every corner's velocity makes: what it feels of its own is all, less what it
            // does not feel of the others.
            let drag = (Matrix3::identity() * *all + normal * normal.transpose() * *along) * factors.damping;
            slots.iter().for_each(|slot| rows.add_coupling(*slot, &(drag / -3.0)));
            for vertex in corners {
                let vertex = (*vertex as usize).wrapping_sub(view.start);
                if vertex < view.masses.len() {
                    rows.add_diagonal(vertex, &drag);
                }
            }
        }
        for (vertex, normal) in self.normals.iter().enumerate() {
            rows.add_diagonal(vertex, &(normal * normal.transpose() * factors.damping));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::registry::build_all;
    use crate::mesh::PolygonMesh;
    use crate::parallel::parts::PART_SIZE;
    use crate::pins::PinTargets;
    use crate::scene::{EffectRequest, GarmentDescription, Scene, SceneDescription};
    use crate::volumes::Volumes;
    use crate::wind_grid::WindGrid;

    /// A strip of two triangles, bent along their common edge.
    fn strip(request: EffectRequest) -> Scene {
        let points = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.2], [0.1, 0.1, 1.0], [1.2, 0.5, 0.9]].map(Vec3::from);
        let mesh = PolygonMesh::from_triangles(points.to_vec(), &[[0, 2, 1], [1, 2, 3]]);
        let mut description = SceneDescription::new("strip");
        description.garments.push(GarmentDescription::new("strip", mesh, 0.2));
        description.effects.push(request);
        Scene::validate(description).unwrap_or_else(|problems| panic!("{problems}"))
    }

    /// The explicit force and the damping force at these velocities.
    fn forces(scene: &Scene, v: &[Vec3]) -> (Vec<Vec3>, Vec<Vec3>) {
        let x = scene.start_state()[0].clone();
        let (targets, wind) = (PinTargets::default(), WindGrid::default());
        let context = ForceContext { time: 0.0, targets: &targets, v, wind: &wind, volumes: &Volumes::default() };
        let view = PartView { start: 0, masses: scene.masses(), x: &x, fraction: 0.0, context };
        let effects = build_all(scene).unwrap_or_else(|problems| panic!("{problems}"));
        let mut all: Vec<Box<dyn Force>> =
            effects.into_iter().flat_map(|(_, effect)| effect.forces).map(|(_, force)| force).collect();
        let mut f = [Simd4::ZERO; PART_SIZE];
        let explicit = view.update(&mut all, &mut f).iter().map(|f| Vec3::from(*f)).collect();
        let mut damping = vec![Simd4::ZERO; x.len()];
        PartMotion::with(0..x.len(), &x, v, |motion| all.iter().for_each(|f| f.add_damping(motion, &mut damping)));
        (explicit, damping.into_iter().map(Vec3::from).collect())
    }

    #[test]
    fn every_term_is_symmetric_takes_energy_and_depends_on_the_relative_velocity_alone() {
        let wave = |seed: f64| -> Vec<Vec3> {
            let at = |k: usize| (seed + 1.7 * k as f64).sin();
            (0..4).map(|k| Vec3::new(at(k), at(k + 5), at(k + 11))).collect()
        };
        let product = |a: &[Vec3], b: &[Vec3]| -> f64 { a.iter().zip(b).map(|(a, b)| a.dot(b)).sum() };
        for term in ["tangential", "density", "normal"] {
            let scene = strip(EffectRequest::of_scene("wind").with(term, 3.0));
            let (v, u) = (wave(0.3), wave(2.0));
            // The pressure's factor is that of the velocities seen: the product has to be taken with the same ones.
            if term != "density" {
                let (_, of_v) = forces(&scene, &v);
                let (_, of_u) = forces(&scene, &u);
                assert!((product(&u, &of_v) - product(&v, &of_u)).abs() < 1e-14, "{term}");
            }
            assert!(product(&v, &forces(&scene, &v).1) < 0.0, "{term}");
            let blown =
                strip(EffectRequest::of_scene("wind").with(term, 3.0).with_vector("velocity", [0.4, -1.0, 2.0]));
            let carried: Vec<Vec3> = vec![Vec3::new(0.4, -1.0, 2.0); 4];
            let (explicit, damping) = forces(&blown, &carried);
            for (a, b) in explicit.iter().zip(&damping) {
                assert!((a + b).norm() < 1e-15, "{term}: cloth that the wind carries feels none");
            }
        }
    }

    #[test]
    fn a_flat_triangle_feels_what_the_formulas_say() {
        let mut scene = SceneDescription::new("triangle");
        let points = [[0.0, 0.0, 0.0], [0.0, 0.0, 2.0], [1.0, 0.0, 0.0]].map(Vec3::from);
        let mesh = PolygonMesh::from_triangles(points.to_vec(), &[[0, 1, 2]]);
        scene.garments.push(GarmentDescription::new("triangle", mesh, 0.3));
        let wind = [3.0, -2.0, 0.5];
        for (term, expected) in [
            ("tangential", Vec3::new(3.0, 0.0, 0.5) * 0.7 / 3.0),
            ("density", Vec3::new(0.0, -4.0, 0.0) * 0.7 / 3.0),
            ("normal", Vec3::new(0.0, -2.0, 0.0) * 0.7 * 0.1),
        ] {
            let mut scene = scene.clone();
            scene.effects.push(EffectRequest::of_scene("wind").with(term, 0.7).with_vector("velocity", wind));
            let scene = Scene::validate(scene).unwrap_or_else(|problems| panic!("{problems}"));
            for force in forces(&scene, &[Vec3::zeros(); 3]).0 {
                assert!((force - expected).norm() < 1e-15, "{term}: {force:?}, not {expected:?}");
            }
        }
    }

    #[test]
    fn wind_that_nothing_feels_and_two_velocities_are_refused() {
        for request in [
            EffectRequest::of_scene("wind").with_vector("velocity", [1.0, 0.0, 0.0]),
            EffectRequest::of_scene("wind")
                .with("density", 1.0)
                .with_vector("velocity", [1.0, 0.0, 0.0])
                .with_keys("keys", vec![(0.0, [0.0; 3])]),
        ] {
            assert!(build_all(&strip(request)).is_err());
        }
    }
}
