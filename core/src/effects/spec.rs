//! Description of an effect in the registry, and contributions of an effect to the step.

use crate::contact::bodies::collision::BodyCollision;
use crate::contact::repulsion::Laws;
use crate::contact::self_contact::CollisionSettings;
use crate::effects::force::{PartForce, VelocityFilter};
use crate::error::Problem;
use crate::mesh::TriangleMesh;
use crate::pins::HardPins;
use crate::scene::{EffectRequest, Scene, SceneDescription};
use crate::settings::{Field, Settings};
use crate::snapshot::saved_section::SectionId;
use crate::volumes::Volume;

/// Place in which an effect is asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scope {
    /// A table of the scene.
    Scene,
    /// A table under a garment.
    Garment,
    /// Pins or bodies; the effect has no table of its own.
    Implied,
}

/// Structures that effects share; a scene builds only those that some effect needs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Need {
    /// Masses and the split into parts: always there.
    State,
    /// Prescribed positions of pinned vertices at the ends of a step.
    PinTargets,
    /// Bodies at both ends of a step, with trees over the triangles of deforming surfaces.
    Bodies,
    /// Triangles of all garments and of bodies, with trees over them.
    ClothSurface,
    /// The list of pairs that are close.
    PairList,
    /// On each rank the triangles two edges away from those that have one of its vertices.
    SecondRing,
}

/// Nanoseconds in a second.
pub(crate) const NANOSECONDS: f64 = 1e9;

/// Row of an effect in the table [`REGISTRY`](crate::REGISTRY).
///
/// ```
/// use drapery_core::{EffectSpec, REGISTRY};
/// let gravity: &EffectSpec = REGISTRY.iter().find(|spec| spec.name == "gravity").expect("it is in every build");
/// let settings: Vec<&str> = gravity.fields.iter().map(|field| field.name).collect();
/// assert_eq!(settings, ["acceleration"]);
/// ```
#[derive(Debug)]
pub struct EffectSpec {
    /// The word in the scene file, and the file's name.
    pub name: &'static str,
    /// One line for help and the reference page.
    pub summary: &'static str,
    /// Place where a scene asks for it.
    pub scope: Scope,
    /// Lines of a scene that ask for it, for the reference page: on a square sheet called "sheet", under its `[[garment]]`.
    pub example: &'static str,
    /// Its settings.
    pub fields: &'static [Field],
    /// Structures that it needs.
    pub needs: &'static [Need],
    /// Effects without which it has no meaning, on the same garment or in the whole scene.
    pub requires: &'static [&'static str],
    /// Elements that it works on, as in "springs"; many or few.
    pub elements: &'static str,
    /// Painted maps that it looks at.
    pub maps: &'static [MapSpec],
    /// Its part of the report of a run.
    pub report: Report,
    /// Its properties for studies and checks of motion.
    pub study: Study,
    /// Expected memory and time.
    pub cost: Cost,
    /// Setting of a request that takes the side of the faces for a side of the cloth, in words.
    pub(crate) looks_at_sides: fn(&EffectRequest) -> Option<&'static str>,
    /// Surfaces with friction between them, in words; `None` for an effect without friction.
    pub friction: Option<fn(&Settings, &SceneDescription) -> Vec<String>>,
    /// The section of a snapshot with what time changes in it; `None` if nothing does.
    pub section: Option<SectionId>,
    /// Makes the effect for one garment or for the whole scene.
    pub(crate) build: fn(&Settings, &BuildContext<'_>) -> Result<Effect, Problem>,
}

/// Part of an effect in the report of a run.
#[derive(Debug, Clone, Copy)]
pub struct Report {
    /// Stages of a step that are its own work.
    pub stages: &'static [&'static str],
    /// Stages that are its work where no other effect of the scene has them as its own.
    pub(crate) shared_stages: &'static [&'static str],
    /// Its counts, besides the iterations of the solves; docs/reference/counts.md explains each.
    pub counts: &'static [&'static str],
}

impl Report {
    /// No stages and no counts.
    pub(crate) const NONE: Self = Self { stages: &[], shared_stages: &[], counts: &[] };
}

/// Properties of an effect for studies and checks of motion.
#[derive(Debug, Clone, Copy)]
pub struct Study {
    /// Whether it moves no centre of mass but as gravity does: it acts between vertices of cloth, or on all alike.
    pub is_internal: bool,
    /// Whether a shot without it is no longer one to look at: cloth without weight, without springs along its edges, without
    /// what holds it or what it lies on.
    pub is_essential: bool,
    /// Whether it does work on the cloth of a scene from outside; `None` if it does unless it is internal.
    pub does_work: Option<fn(&SceneDescription) -> bool>,
}

impl Study {
    /// Effects that push cloth from outside, and that a shot can do without.
    pub(crate) const OUTSIDE: Self = Self { is_internal: false, is_essential: false, does_work: None };

    /// Effects that act between vertices of cloth, or on all alike.
    pub(crate) const INTERNAL: Self = Self { is_internal: true, ..Self::OUTSIDE };
}

/// Expected memory and time of an effect.
#[derive(Debug, Clone, Copy)]
pub struct Cost {
    /// Memory for each point of the garments that have it, measured with `drapery check` on panels of 40,000 and 250,000 points
    /// [bytes].
    pub bytes_of_point: f64,
    /// Its forces in the semi-implicit step, once in a solve, by `make measure NAME=plan` [ns by element].
    pub update: f64,
    /// The same in each iteration [ns by element].
    pub product: f64,
}

impl Cost {
    /// None that counts.
    pub(crate) const NONE: Self = Self { bytes_of_point: 0.0, update: 0.0, product: 0.0 };
}

impl EffectSpec {
    /// An effect without maps, section, stages or counts.
    pub(crate) const BARE: Self = Self {
        name: "",
        summary: "",
        scope: Scope::Scene,
        example: "",
        fields: &[],
        needs: &[Need::State],
        requires: &[],
        elements: "vertices",
        maps: &[],
        report: Report::NONE,
        study: Study::OUTSIDE,
        cost: Cost::NONE,
        looks_at_sides: |_| None,
        friction: None,
        section: None,
        build: |_, _| Ok(Effect::default()),
    };
}

/// A quantity that can be painted on a garment.
#[derive(Debug)]
pub struct MapSpec {
    /// Its name under `maps` of a garment.
    pub name: &'static str,
    /// The rows of the numbers that it varies: what it makes of one of these may not be larger than a scene may write there. Empty
    /// for what every garment has.
    pub rows: &'static [&'static str],
    /// Whether it can only be a share of the effect, because the effect has several numbers.
    pub(crate) is_share: bool,
    /// Whether there is a number in the scene that it varies on a garment; `None` if there always is one.
    pub(crate) varies: Option<fn(&SceneDescription, usize) -> bool>,
}

impl MapSpec {
    /// A map of a number that the effect always has, by one of these rows.
    pub(crate) const fn of(name: &'static str, rows: &'static [&'static str]) -> Self {
        Self { name, rows, is_share: false, varies: None }
    }

    /// A map of what has several numbers, by these rows.
    #[cfg(feature = "effects")]
    pub(crate) const fn fraction(name: &'static str, rows: &'static [&'static str]) -> Self {
        Self { name, rows, is_share: true, varies: None }
    }
}

/// Inputs that an effect may look at while it is made.
pub(crate) struct BuildContext<'a> {
    /// The checked scene.
    pub(crate) scene: &'a Scene,
    /// The garment it acts on; `None` for the whole scene.
    pub(crate) garment: Option<usize>,
    /// Whether the simulation is running, and numbers change.
    pub(crate) is_running: bool,
}

impl BuildContext<'_> {
    /// Whether one of these numbers changes over time, by its path, or has been changed while the simulation runs.
    #[cfg_attr(not(feature = "effects"), expect(dead_code, reason = "the effects that ask have this feature"))]
    pub(crate) fn changes(&self, paths: &[&str]) -> bool {
        self.is_running || paths.iter().any(|path| self.scene.description().curves.contains_key(*path))
    }
}

/// Contributions of an effect to the step.
#[derive(Default)]
pub struct Effect {
    /// Forces, each on one part.
    pub forces: Vec<PartForce>,
    /// Whether hard pins are to be imposed.
    pub(crate) pins: Option<HardPins>,
    /// Changes of velocities between the solves.
    pub(crate) filters: Vec<Box<dyn VelocityFilter>>,
    /// Whether cloth collides with bodies.
    pub body_collision: Option<BodyCollision>,
    /// Laws of repulsion between cloth and cloth, and the largest thickness as a fraction of the edges around a vertex.
    pub(crate) self_repulsion: Option<(Laws, f64)>,
    /// Settings by which geometric collisions are resolved.
    pub(crate) self_collision: Option<CollisionSettings>,
    /// A volume that its forces look at in [`crate::effects::force::ForceContext::volumes`].
    pub(crate) volume: Option<Volume>,
    /// Whether its forces look at [`crate::effects::force::ForceContext::v`].
    pub(crate) sees_velocities: bool,
    /// The section with what forces remember of elements that have yielded.
    pub(crate) yields: Option<SectionId>,
    /// The section with elements that have broken, if any can break.
    pub(crate) breaks: Option<SectionId>,
    /// Number of elements that the rank owns, of the kind that the registry names.
    pub(crate) elements: usize,
    /// Memory held [bytes].
    pub(crate) bytes: usize,
    /// Changes that the effect had to make to run well, for `drapery plan`.
    pub(crate) notes: Vec<String>,
}

/// Number of triangles of cloth that the rank owns, each with its first vertex.
pub(crate) fn own_triangles(scene: &Scene) -> usize {
    let parts = scene.parts();
    let of_garment = |(g, mesh): (usize, &TriangleMesh)| {
        let first = parts.garment(g).start;
        let is_own = |t: &&[u32; 3]| t.iter().min().is_some_and(|v| parts.own().contains(&(first + *v as usize)));
        mesh.triangles().iter().filter(is_own).count()
    };
    scene.meshes().iter().enumerate().map(of_garment).sum()
}
