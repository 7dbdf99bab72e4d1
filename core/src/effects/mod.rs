//! Effects: everything that can act on cloth. An effect exists only when the scene asks for it.
//!
//! Each effect is one file that holds its manual page, its [`EffectSpec`], what it builds, and its tests. To add one,
//! write the file and list it below; the order there is the order of execution.

pub mod attachments;
pub mod bending;
pub mod body_collision;
pub mod corners;
pub mod cost;
pub mod dihedral_bending;
pub mod ether_drag;
pub mod gravity;
pub mod membrane;
pub mod part_triangles;
pub mod pins;
pub mod plastic_wrinkles;
pub mod pressure;
pub mod seams;
pub mod self_collision;
pub mod self_repulsion;
pub mod shear;
pub mod springs;
pub mod strain_limit;
pub mod stretch;
pub mod wind;

use std::ops::Range;

use crate::Vec3;
use crate::contact::repulsion::Laws;
use crate::contact::self_contact::CollisionSettings;
use crate::error::{Problem, Problems};
use crate::mesh::TriangleMesh;
use crate::metrics::Metrics;
use crate::parallel::lanes::{Lanes, PartLanes};
use crate::parallel::parts::{PART_SIZE, Parts};
use crate::scene::Scene;
use crate::settings::{Field, Settings};
use crate::time_step;
use crate::volumes::{Volume, Volumes};
use crate::wind_grid::WindGrid;

pub use crate::remembered::ElementRows;

pub use cost::Cost;

/// Whether effects sleep where they have nothing to do. They do but for measurements of what that saves (`docs/effects.md`).
pub(crate) const SLEEPS: bool = !cfg!(feature = "always-awake");

/// Lists all effects, each by its module, an optional one with the feature of the build that brings it.
macro_rules! effects {
    ($($module:ident $(if $feature:literal)?,)*) => {
        /// All effects of this build, in the order of execution.
        pub static REGISTRY: &[&EffectSpec] = &[$($(#[cfg(feature = $feature)])? &$module::SPEC),*];

        /// All effects of the program, in the order of execution: name, and the feature that a build needs to have it.
        pub static LISTED: &[(&str, Option<&str>)] = &[$((stringify!($module), optional!($($feature)?))),*];
    };
}

macro_rules! optional {
    () => {
        None
    };
    ($feature:literal) => {
        Some($feature)
    };
}

// The method itself is in every build: gravity and springs along edges, prescribed vertices, and contact. All others are
// features, named after them, which the modules repeat as their own condition.
effects! {
    gravity,
    stretch,
    shear if "effect-shear",
    membrane if "effect-membrane",
    bending if "effect-bending",
    dihedral_bending if "effect-dihedral_bending",
    plastic_wrinkles if "effect-plastic_wrinkles",
    wind if "effect-wind",
    ether_drag if "effect-ether_drag",
    pressure if "effect-pressure",
    seams if "effect-seams",
    attachments if "effect-attachments",
    pins,
    strain_limit if "effect-strain_limit",
    body_collision,
    self_repulsion,
    self_collision,
}

/// Where an effect is asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scope {
    /// By a table of the scene.
    Scene,
    /// By a table under a garment.
    Garment,
    /// By pins or bodies; it has no table of its own.
    Implied,
}

/// Structures that effects share; a scene builds only those that some effect needs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Need {
    /// Masses and the split into parts: always there.
    State,
    /// Where pinned vertices have to be at the ends of a step.
    PinTargets,
    /// Bodies at both ends of a step, with trees over the triangles of deforming surfaces.
    Bodies,
    /// Triangles of all garments and of deforming bodies, with trees over them.
    ClothSurface,
    /// The list of pairs that are close.
    PairList,
    /// On each rank the triangles two edges away from those that have one of its vertices.
    SecondRing,
}

/// A section of a snapshot, and hence of a checkpoint.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Section {
    /// Its name; several effects may share one.
    pub name: &'static str,
    /// Version of its layout.
    pub version: u32,
}

/// What the registry knows of an effect.
#[derive(Debug)]
pub struct EffectSpec {
    /// The word in the scene file, and the file's name.
    pub name: &'static str,
    /// One line for help and the reference page.
    pub summary: &'static str,
    /// Where it is asked for.
    pub scope: Scope,
    /// Its settings.
    pub fields: &'static [Field],
    /// Structures that it needs.
    pub needs: &'static [Need],
    /// Effects without which it has no meaning, on the same garment or in the whole scene.
    pub requires: &'static [&'static str],
    /// What it costs.
    pub cost: Cost,
    /// The section of a snapshot with what time changes in it; `None` if nothing does.
    pub section: Option<Section>,
    /// What it counts, besides the iterations of the solves; docs/reference/counts.md explains each.
    pub counts: &'static [&'static str],
    /// Makes the effect for one garment or for the whole scene.
    pub build: fn(&Settings, &BuildContext<'_>) -> Result<Effect, Problem>,
}

/// What an effect may look at while it is made.
pub struct BuildContext<'a> {
    /// The checked scene.
    pub scene: &'a Scene,
    /// The garment it acts on; `None` for the whole scene.
    pub garment: Option<usize>,
}

/// A force, and the part of the cloth that it acts on.
pub type PartForce = (usize, Box<dyn Force>);

/// What an effect puts into the step.
#[derive(Default)]
pub struct Effect {
    /// Forces, each on one part.
    pub forces: Vec<PartForce>,
    /// Whether hard pins are to be imposed.
    pub pins: Option<pins::HardPins>,
    /// What changes velocities between the solves.
    pub filters: Vec<Box<dyn VelocityFilter>>,
    /// Whether cloth collides with bodies.
    pub body_collision: Option<body_collision::BodyCollision>,
    /// Laws of repulsion between cloth and cloth, and the largest thickness as a fraction of the edges around a vertex.
    pub self_repulsion: Option<(Laws, f64)>,
    /// How geometric collisions are resolved.
    pub self_collision: Option<CollisionSettings>,
    /// A volume that its forces look at in [`Surroundings::volumes`].
    pub volume: Option<Volume>,
    /// Whether its forces look at [`Surroundings::v`].
    pub sees_velocities: bool,
    /// The section with what forces remember of elements that have yielded.
    pub yields: Option<Section>,
    /// Number of elements that the rank owns, of the kind that its cost names.
    pub elements: usize,
    /// Memory held [bytes].
    pub bytes: usize,
    /// What the effect had to change to run well, for `drapery plan`.
    pub notes: Vec<String>,
}

/// What forces see beside the positions of the cloth.
#[derive(Clone, Copy)]
pub struct Surroundings<'a> {
    /// Solver time of the positions [s].
    pub time: f64,
    /// Where pinned vertices have to be during the step.
    pub targets: &'a pins::PinTargets,
    /// Velocities of all vertices that are known before the solve [m/s], for the factors of drag that are not linear: at the
    /// start of the step in B.1, foreseen for its middle in B.5. Empty there if no effect asks for them.
    pub v: &'a [Vec3],
    /// The wind of a file.
    pub wind: &'a WindGrid,
    /// Volumes that garments enclose in these positions.
    pub volumes: &'a Volumes,
}

/// One part of the cloth as a force sees it.
#[derive(Clone, Copy)]
pub struct PartView<'a> {
    /// First vertex of the part in solver order.
    pub start: usize,
    /// Masses of the part's vertices [kg].
    pub masses: &'a [f64],
    /// Positions of all vertices [m].
    pub x: &'a [Vec3],
    /// Fraction of the step at which the force is evaluated: 0 at its start, ½ at its middle.
    pub fraction: f64,
    /// Everything else.
    pub around: Surroundings<'a>,
}

impl PartView<'_> {
    /// Updates all forces of the part and returns their sums [N] in `f`, which is zero before.
    pub fn update<'a>(&self, forces: &mut [Box<dyn Force>], f: &'a mut PartLanes) -> &'a [Lanes] {
        let mut own_x = [Lanes::ZERO; PART_SIZE];
        let own_x = Lanes::copy(&self.x[self.start..self.start + self.masses.len()], &mut own_x);
        let f = &mut f[..own_x.len()];
        forces.iter_mut().for_each(|force| force.update(self, own_x, f));
        f
    }
}

/// Positions and velocities of one part and of its neighbours, as damping sees them.
#[derive(Clone, Copy)]
pub struct PartMotion<'a> {
    /// Positions of all vertices [m].
    pub x: &'a [Vec3],
    /// Velocities of all vertices [m/s].
    pub v: &'a [Vec3],
    /// Positions of the part's vertices [m].
    pub own_x: &'a [Lanes],
    /// Velocities of the part's vertices [m/s].
    pub own_v: &'a [Lanes],
}

impl<'a> PartMotion<'a> {
    /// Calls `work` with the motion of a part that holds these vertices.
    pub fn with<R>(part: Range<usize>, x: &'a [Vec3], v: &'a [Vec3], work: impl FnOnce(&PartMotion<'_>) -> R) -> R {
        let (mut own_x, mut own_v) = ([Lanes::ZERO; PART_SIZE], [Lanes::ZERO; PART_SIZE]);
        let own_x = Lanes::copy(&x[part.clone()], &mut own_x);
        let own_v = Lanes::copy(&v[part], &mut own_v);
        work(&PartMotion { x, v, own_x, own_v })
    }
}

/// A force on the vertices of one part. Elastic parts are explicit, damping parts implicit.
///
/// An element that crosses a border is evaluated by both parts, with the same operands.
pub trait Force: Send + Sync {
    /// Remembers what damping products at these positions need, and adds the forces that do not depend on velocity to
    /// `f` [N]; `own_x` and `f` are the part's own vertices.
    fn update(&mut self, view: &PartView<'_>, own_x: &[Lanes], f: &mut [Lanes]);

    /// Adds the damping force to `f`, the part's own slice [N]. Linear in the velocities, symmetric, never adding energy;
    /// the positions are those of the last `update`.
    fn add_damping(&self, _motion: &PartMotion<'_>, _f: &mut [Lanes]) {}

    /// Makes the force implicit until the next `update`, which came just before with the same view: the damping products
    /// get `over · dF/dx` as well, made negative semidefinite, `over` in s. A force that does not know its derivative stays
    /// explicit.
    fn linearise(&mut self, _view: &PartView<'_>, _over: f64) {}

    /// Whether `linearise` makes the force implicit, so that it sets no limit on the time step.
    fn can_be_implicit(&self) -> bool {
        false
    }

    /// Adds to each vertex the sum of the stiffnesses of its springs [N/m], for the choice of the time step.
    fn add_stiffness(&self, _sums: &mut [f64]) {}

    /// Vertices of other parts that the force looks at: a part without such on other ranks need not wait for them.
    fn neighbours(&self) -> &[u32] {
        &[]
    }

    /// A rate of relative change of length [1/s] that no element of the part exceeds, from the velocities `v` [m/s] of all
    /// vertices; `part` are the part's own.
    fn strain_rate_bound(&self, _part: Range<usize>, _v: &[Vec3]) -> f64 {
        0.0
    }

    /// Largest rate of relative change of length [1/s].
    fn strain_rate(&self, _motion: &PartMotion<'_>) -> f64 {
        0.0
    }

    /// Potential energy [J]; an element that crosses a border counts with half its energy in each part.
    fn energy(&self, _view: &PartView<'_>) -> f64 {
        0.0
    }

    /// Takes over from the positions `x` [m] of all vertices, at a state free of collisions, what stays for good.
    fn yield_to(&mut self, _x: &[Vec3]) {}

    /// Adds what [`Force::yield_to`] has changed in the elements that count at this part, by their vertices in solver order.
    fn remember(&self, _rows: &mut ElementRows) {}

    /// Takes what was remembered of all elements whose vertices are on this rank.
    fn recall(&mut self, _rows: &ElementRows) {}

    /// Hands out what was counted since it was asked last, under names of the effect's `counts`; each event at one part only.
    fn take_counts(&mut self, _count: &mut dyn FnMut(&'static str, u64)) {}

    /// The most stretched edge: strain and vertices in solver order.
    fn largest_strain(&self, _x: &[Vec3]) -> Option<(f64, [usize; 2])> {
        None
    }
}

/// What a velocity is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Purpose {
    /// v½ in B.2: it takes the positions to the end of the step.
    Positions,
    /// v' in B.8: the velocity at the end of the step.
    Motion,
}

/// A change of velocities after self-repulsion, in B.2 and B.8.
pub trait VelocityFilter: Send + Sync {
    /// Names of its stages in B.2 and in B.8.
    fn stages(&self) -> [&'static str; 2];

    /// Takes note of the vertices that pins hold in this step.
    fn set_held(&mut self, parts: &Parts, masses: &[f64], pins: &pins::HardPins, targets: &pins::PinTargets);

    /// Changes the velocities `v` [m/s] of a step of `dt` [s] from positions `x` [m]. Ghosts of `x` are those of their owners;
    /// those of `v` need not be, before or after.
    fn apply(
        &mut self,
        parts: &Parts,
        motion: (&[Vec3], &mut [Vec3]),
        dt: f64,
        purpose: Purpose,
        metrics: &mut Metrics,
    );
}

/// An effect that runs, for `drapery plan`.
#[derive(Debug, Clone, PartialEq)]
pub struct PlannedEffect {
    /// Name in the registry.
    pub name: &'static str,
    /// Garment it acts on; `None` for the whole scene.
    pub garment: Option<String>,
    /// Why it is there.
    pub because: String,
    /// Checked settings.
    pub settings: Settings,
    /// Structures that it needs.
    pub needs: &'static [Need],
    /// What it costs per element.
    pub cost: Cost,
    /// Number of elements of the kind that its cost names.
    pub elements: usize,
    /// Memory held [bytes].
    pub bytes: usize,
    /// What the effect had to change to run well.
    pub notes: Vec<String>,
    /// Longest time step that its forces allow by themselves [s]; infinite if they set no limit.
    pub longest_step: f64,
}

/// The effect of this name.
pub fn find(name: &str) -> Option<&'static EffectSpec> {
    REGISTRY.iter().copied().find(|spec| spec.name == name)
}

/// Of an effect that this build lacks: what is wrong, and what to do. `None` if it is here, or if there is no such effect.
pub fn lacking(name: &str) -> Option<(String, String)> {
    let (name, feature) = LISTED.iter().find(|(listed, _)| *listed == name && find(listed).is_none())?;
    let feature = (*feature)?;
    let what = format!("this drapery was built without the effect `{name}`");
    Some((what, format!("build it with `--features {feature}`, or do without the effect")))
}

/// Number of triangles of cloth that the rank owns, each with its first vertex.
fn own_triangles(scene: &Scene) -> usize {
    let parts = scene.parts();
    let of_garment = |(g, mesh): (usize, &TriangleMesh)| {
        let first = parts.garment(g).start;
        let is_own = |t: &&[u32; 3]| t.iter().min().is_some_and(|v| parts.own().contains(&(first + *v as usize)));
        mesh.triangles().iter().filter(is_own).count()
    };
    scene.meshes().iter().enumerate().map(of_garment).sum()
}

/// Builds what the scene asks for, in the order of the registry, then in that of the garments.
///
/// # Errors
/// All problems of all effects: unknown names, settings out of range, contradictions.
pub fn build_all(scene: &Scene) -> Result<Vec<(PlannedEffect, Effect)>, Problems> {
    let mut requests: Vec<_> = scene.description().effects.iter().collect();
    let rank = |name: &str| REGISTRY.iter().position(|spec| spec.name == name);
    requests.sort_by_key(|r| (rank(&r.effect), r.garment));
    let mut built = Vec::new();
    let mut problems = Vec::new();
    for request in requests {
        let garment = request.garment.map(|g| scene.description().garments[g].name.clone());
        let place = garment.as_ref().map_or(request.effect.clone(), |g| format!("garment \"{g}\", {}", request.effect));
        // Scene::validate has refused unknown names.
        let Some(spec) = find(&request.effect) else { continue };
        let settings = match Settings::check(spec.fields, &request.settings) {
            Ok(settings) => settings,
            Err(texts) => {
                problems.extend(texts.into_iter().map(|t| Problem::scene(&place, t, "correct it in the scene file")));
                continue;
            }
        };
        match (spec.build)(&settings, &BuildContext { scene, garment: request.garment }) {
            Ok(effect) => {
                let (because, bytes, notes) = (request.because.clone(), effect.bytes, effect.notes.clone());
                let (needs, cost, elements) = (spec.needs, spec.cost, effect.elements);
                let (name, longest_step) = (spec.name, longest_step(scene, &effect.forces));
                let planned = PlannedEffect {
                    name,
                    garment,
                    because,
                    settings,
                    needs,
                    cost,
                    elements,
                    bytes,
                    notes,
                    longest_step,
                };
                built.push((planned, effect));
            }
            Err(problem) => problems.push(problem),
        }
    }
    if problems.is_empty() { Ok(built) } else { Err(Problems(problems)) }
}

/// Longest step that these forces allow by themselves on this rank [s].
fn longest_step(scene: &Scene, forces: &[PartForce]) -> f64 {
    let (ranges, solver) = (scene.parts().ranges(), &scene.description().solver);
    let mut sums = Vec::new();
    forces.iter().fold(f64::INFINITY, |longest, (part, force)| {
        let range = ranges[*part].clone();
        sums.clear();
        sums.resize(range.len(), 0.0);
        time_step::limit(std::slice::from_ref(force), solver, &scene.masses()[range], &mut sums).min(longest)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_effect_is_listed_under_its_name_and_its_feature_is_called_after_it() {
        let here: Vec<&str> = LISTED.iter().map(|(name, _)| *name).filter(|name| find(name).is_some()).collect();
        assert_eq!(here, REGISTRY.iter().map(|spec| spec.name).collect::<Vec<_>>());
        for (name, feature) in LISTED {
            assert!(feature.is_none_or(|feature| feature == format!("effect-{name}")), "{name}: {feature:?}");
            assert!(feature.is_some() || find(name).is_some(), "{name} is in every build");
        }
    }

    #[test]
    fn of_an_effect_that_the_build_lacks_the_feature_is_named() {
        for (name, feature) in LISTED {
            match lacking(name) {
                Some((what, advice)) => {
                    assert!(what.contains(name) && advice.contains(feature.unwrap_or("none")), "{what}: {advice}");
                }
                None => assert!(find(name).is_some(), "{name}"),
            }
        }
        assert_eq!(lacking("no such effect"), None);
    }
}
