//! Scenes to simulate: plain data that anyone may fill in ([`SceneDescription`]), and its checked, immutable form ([`Scene`]).
//!
//! All lengths are in metres, times in seconds, masses in kilograms. A description promises nothing; a scene promises
//! that every index is in range, every number finite and every rest edge longer than zero: what of a garment has no area takes
//! no part, and the scene says so in its warnings.

mod body;
pub(crate) mod contact_matrix;
mod contact_rule;
pub(crate) mod described;
mod elastic;
mod garment;
pub mod gather;
mod integrator;
pub mod names;
pub mod number_curves;
pub(crate) mod origin;
mod pin;
mod seam;
pub(crate) mod seam_pairs;
mod solver;
pub mod vertex_maps;

pub use body::{BodyDescription, BodyShape, RigidMotion};
pub use contact_matrix::{ContactEntry, ContactMatrix};
pub use contact_rule::{ContactRule, ContactSide};
pub use described::Described;
pub use elastic::ElasticDescription;
pub use integrator::{Integrator, IntegratorSpec, RepulsionPlace, UnusedKey};
pub use origin::{FARTHEST, coarse_place, is_possible};
pub use pin::{PinAnchor, PinDescription, PinHold, PinMode, PinTarget};
pub use seam::{FacePoint, SeamDescription};
pub use solver::{PRESET, PRESETS, SolverPreset, SolverSettings};

use std::collections::BTreeMap;
use std::sync::Arc;

use crate::Vec3;
pub use crate::geometry::attachment::SurfaceAttachment;
use crate::geometry::shape_mesh::ShapeMesh;
use crate::mesh::{MeshStream, PolygonMesh, TriangleMesh};
use crate::parallel::parts::Parts;
use crate::settings::SettingValue;
use number_curves::NumberCurves;
use seam_pairs::Sewn;
use vertex_maps::{MapCurves, PaintedMaps};

/// A scene as plain data, in SI units. Nothing in it is checked.
///
/// ```
/// use drapery_core::{EffectRequest, GarmentDescription, PolygonMesh, Scene, SceneDescription, Vec3};
/// let mesh = PolygonMesh::from_triangles(vec![Vec3::zeros(), Vec3::x(), Vec3::z()], &[[0, 2, 1]]);
/// let mut description = SceneDescription::new("fall");
/// description.garments.push(GarmentDescription::new("cloth", mesh, 0.2));
/// description.effects.push(EffectRequest::of_scene("gravity"));
/// assert!(Scene::validate(description).is_ok());
/// ```
#[derive(Debug, Clone)]
pub struct SceneDescription {
    /// Name of the shot, for messages.
    pub name: String,
    /// Frame rate and the frame from which time is counted.
    pub timeline: Timeline,
    /// Origin of the positions where single precision stores them [m]; `None` chooses it by where the garments start.
    pub origin: Option<Vec3>,
    /// Settings of the time integration.
    pub solver: SolverSettings,
    /// Garments, in the order of their output.
    pub garments: Vec<GarmentDescription>,
    /// Bodies that the garments collide with, in order of priority.
    pub bodies: Vec<BodyDescription>,
    /// Vertices whose motion is prescribed or that are held by springs.
    pub pins: Vec<PinDescription>,
    /// Elastic bands in garments.
    pub elastics: Vec<ElasticDescription>,
    /// Vertices that are drawn together.
    pub seams: Vec<SeamDescription>,
    /// Contact of pairs of garments and bodies that differs from what these say.
    pub contacts: Vec<ContactRule>,
    /// Numbers that change over time.
    pub curves: NumberCurves,
    /// Place of the grid of the wind, if the caller pushes one ([`crate::simulation::FrameInput::wind`]).
    pub wind: Option<WindGridShape>,
    /// Effects asked for. What is not here does not exist while the scene runs.
    pub effects: Vec<EffectRequest>,
    /// Effects that were asked for and then left out, for messages and `drapery plan`.
    pub left_out: Vec<String>,
}

/// Frame rate as a rational number and the frame at which time is zero.
///
/// Times are computed from integers, never accumulated: frame `f` is at `(f - origin) · denominator / numerator` s.
///
/// ```
/// use drapery_core::Timeline;
/// let ntsc = Timeline { fps_numerator: 24000, fps_denominator: 1001, origin: 1001, start: 990 };
/// assert_eq!(ntsc.time(25001), 1001.0);
/// assert!(ntsc.time(ntsc.start) < 0.0);
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Timeline {
    /// Numerator of the frames per second, for example 24 or 24000.
    pub fps_numerator: u32,
    /// Denominator of the frames per second, for example 1 or 1001.
    pub fps_denominator: u32,
    /// Frame at which solver time is zero. Bodies' motions count their seconds from here.
    pub origin: i64,
    /// Frame at which the simulation starts, at or before `origin` (earlier when there is a pre-roll).
    pub start: i64,
}

impl Timeline {
    /// Solver time of a frame [s].
    pub fn time(&self, frame: i64) -> f64 {
        (frame - self.origin) as f64 * f64::from(self.fps_denominator) / f64::from(self.fps_numerator)
    }

    /// Time of a frame in files [s]: frame / fps, computed from integers.
    pub fn file_time(&self, frame: i64) -> f64 {
        frame as f64 * f64::from(self.fps_denominator) / f64::from(self.fps_numerator)
    }

    /// Frames per second.
    pub fn fps(&self) -> f64 {
        f64::from(self.fps_numerator) / f64::from(self.fps_denominator)
    }

    /// Length of one frame [s].
    pub fn frame_duration(&self) -> f64 {
        f64::from(self.fps_denominator) / f64::from(self.fps_numerator)
    }
}

impl Default for Timeline {
    /// 24 frames per second from frame 0.
    fn default() -> Self {
        Self { fps_numerator: 24, fps_denominator: 1, origin: 0, start: 0 }
    }
}

/// A garment: its mesh at rest, where it starts, and what it weighs.
///
/// ```
/// use drapery_core::{GarmentDescription, PolygonMesh, Vec3};
/// let mesh = PolygonMesh::from_triangles(vec![Vec3::zeros(), Vec3::x(), Vec3::z()], &[[0, 2, 1]]);
/// let silk = GarmentDescription { thickness: 0.0002, ..GarmentDescription::new("scarf", mesh, 0.06) };
/// assert_eq!((silk.point_count(), silk.face_count()), (3, 1));
/// ```
#[derive(Debug, Clone)]
pub struct GarmentDescription {
    /// Name, unique among the garments; it names the output files.
    pub name: String,
    /// Rest shape with the artist's polygons; a fixed triangulation of it is simulated.
    pub mesh: PolygonMesh,
    /// Rest shape that is read piece by piece, in place of `mesh`, which is then ignored.
    pub stream: Option<Arc<dyn MeshStream>>,
    /// Positions at the start [m] when they differ from the rest shape; one per point.
    pub start: Option<Vec<Vec3>>,
    /// Velocity of every point at the start [m/s].
    pub velocity: Vec3,
    /// Velocities at the start [m/s] when they differ among the points, instead of `velocity`; one per point.
    pub start_velocities: Option<Vec<Vec3>>,
    /// Mass of the points, by area or in total.
    pub mass: Mass,
    /// Distance that repulsions keep between its layers, and from other garments [m]; short edges lower it
    /// (`self_repulsion`).
    pub thickness: f64,
    /// Lengths at rest over those of the rest shape; the mass is that of the rest shape.
    pub rest_scale: f64,
    /// Place in the order in which garments are worn: the larger is outside, which is where the faces' normals point. It decides
    /// to which side cloth that starts crossed is drawn.
    pub layer: Option<u32>,
    /// Parts that rules of contact name, each with its vertices; no vertex is in two of them.
    pub parts: BTreeMap<String, Vec<u32>>,
    /// Quantities that differ among the vertices.
    pub maps: PaintedMaps,
    /// Maps that change over time, in the place of those of the same names in `maps`.
    pub map_curves: MapCurves,
}

/// Mass of a garment's points.
///
/// ```
/// use drapery_core::{GarmentDescription, Mass, PolygonMesh, Scene, SceneDescription, Vec3};
/// let mesh = PolygonMesh::from_triangles(vec![Vec3::zeros(), Vec3::x(), Vec3::z()], &[[0, 2, 1]]);
/// let mut description = SceneDescription::new("half a square metre");
/// description.garments.push(GarmentDescription { mass: Mass::Density(0.3), ..GarmentDescription::new("sheet", mesh, 0.0) });
/// let total: f64 = Scene::validate(description).expect("a valid scene").masses().iter().sum();
/// assert!((total - 0.15).abs() < 1e-15);
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Mass {
    /// Areal density [kg/m²]: a point gets a third of the rest area of its triangles.
    Density(f64),
    /// The same mass for each point, adding up to this [kg] (the authors' panels).
    UniformTotal(f64),
}

/// A regular grid of velocities of the air; it does not move.
///
/// ```
/// use drapery_core::{Vec3, WindGridShape};
/// let grid = WindGridShape { origin: Vec3::zeros(), spacing: Vec3::repeat(0.5), counts: [5, 3, 5] };
/// assert_eq!(grid.counts.iter().product::<usize>(), 75);
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WindGridShape {
    /// Place of the first node [m].
    pub origin: Vec3,
    /// Distance between nodes along x, y and z [m].
    pub spacing: Vec3,
    /// Number of nodes along x, y and z.
    pub counts: [usize; 3],
}

/// An effect that the scene asks for.
///
/// ```
/// use drapery_core::{EffectRequest, SettingValue};
/// let gravity = EffectRequest::of_scene("gravity").with_vector("acceleration", [0.0, -1.62, 0.0]);
/// let stretch = EffectRequest::of_garment("stretch", 0).with("stiffness", 200.0);
/// assert_eq!(gravity.settings["acceleration"], SettingValue::Vector([0.0, -1.62, 0.0]));
/// assert_eq!((gravity.garment, stretch.garment), (None, Some(0)));
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct EffectRequest {
    /// Name in the registry.
    pub effect: String,
    /// Garment it acts on; `None` for the whole scene.
    pub garment: Option<usize>,
    /// Settings by name, as written; what is left out takes the default of the effect.
    pub settings: BTreeMap<String, SettingValue>,
    /// Source of each of these settings in words, where it is known (`material denim_11oz`), for `drapery plan`.
    pub sources: BTreeMap<String, String>,
    /// Reason for it, for `drapery plan`.
    pub because: String,
}

impl EffectRequest {
    /// An effect on the whole scene with default settings.
    pub fn of_scene(effect: &str) -> Self {
        Self {
            effect: effect.into(),
            garment: None,
            settings: BTreeMap::new(),
            sources: BTreeMap::new(),
            because: "the scene asks for it".into(),
        }
    }

    /// An effect on one garment with default settings.
    pub fn of_garment(effect: &str, garment: usize) -> Self {
        Self { garment: Some(garment), ..Self::of_scene(effect) }
    }

    /// The same with a number set (in the setting's SI unit).
    pub fn with(mut self, setting: &str, value: f64) -> Self {
        self.settings.insert(setting.into(), SettingValue::Number(value));
        self
    }

    /// The same with a flag set.
    pub fn with_flag(mut self, setting: &str, value: bool) -> Self {
        self.settings.insert(setting.into(), SettingValue::Flag(value));
        self
    }

    /// The same with keys set (seconds, and vectors in the setting's SI unit).
    pub fn with_keys(mut self, setting: &str, keys: Vec<(f64, [f64; 3])>) -> Self {
        self.settings.insert(setting.into(), SettingValue::Keys(keys));
        self
    }

    /// The same with a vector set (in the setting's SI unit).
    pub fn with_vector(mut self, setting: &str, value: [f64; 3]) -> Self {
        self.settings.insert(setting.into(), SettingValue::Vector(value));
        self
    }
}

impl SceneDescription {
    /// Whether a body moves; deforming ones are taken to.
    pub(crate) fn moves_body(&self, body: usize) -> bool {
        let body = &self.bodies[body];
        let turns = body.motion.angular_velocity != Vec3::zeros();
        matches!(body.shape, BodyShape::Surface { .. }) || body.motion.path.len() > 1 || turns
    }

    /// Whether some seam can break.
    pub(crate) fn seams_can_break(&self) -> bool {
        self.seams.iter().any(|seam| seam.break_force.is_some())
    }

    /// Whether what some pin follows moves.
    pub(crate) fn moves_pins(&self) -> bool {
        self.pins.iter().any(|pin| match &pin.target {
            PinTarget::Path { offsets, .. } => offsets.windows(2).any(|pair| pair[0].1 != pair[1].1),
            PinTarget::Track { .. } => true,
            PinTarget::Body { body, .. } | PinTarget::BodyNearest { body, .. } => self.moves_body(*body),
        })
    }

    /// An empty scene at 24 frames per second.
    pub fn new(name: &str) -> Self {
        Self {
            name: name.into(),
            timeline: Timeline::default(),
            origin: None,
            solver: SolverSettings::default(),
            garments: Vec::new(),
            bodies: Vec::new(),
            pins: Vec::new(),
            elastics: Vec::new(),
            seams: Vec::new(),
            contacts: Vec::new(),
            curves: NumberCurves::new(),
            wind: None,
            effects: Vec::new(),
            left_out: Vec::new(),
        }
    }
}

/// Thickness of a garment that does not say it [m]: a shirt's.
pub(crate) const DEFAULT_THICKNESS: f64 = 0.0005;

/// Largest thickness that a scene may write [m].
pub const LARGEST_THICKNESS: f64 = 1e3;

/// Smallest and largest density that a scene may write [kg/m²].
pub const SMALLEST_DENSITY: f64 = 1.0 / LARGEST_DENSITY;
/// See [`SMALLEST_DENSITY`].
pub const LARGEST_DENSITY: f64 = 1e6;

/// A checked scene: indices in range, numbers finite, rest edges longer than zero, effects known. On many ranks this is what
/// one of them has: its own vertices and what lies around them.
///
/// ```
/// use drapery_core::{GarmentDescription, PolygonMesh, Scene, SceneDescription, Vec3};
/// let square = PolygonMesh { points: vec![Vec3::zeros(), Vec3::z(), Vec3::x() + Vec3::z(), Vec3::x()],
///     face_counts: vec![4], face_indices: vec![0, 1, 2, 3] };
/// let mut description = SceneDescription::new("square");
/// description.garments.push(GarmentDescription::new("cloth", square, 0.2));
/// let scene = Scene::validate(description).expect("a valid scene");
/// assert_eq!((scene.meshes()[0].triangles().len(), scene.meshes()[0].edges().len()), (2, 5));
/// ```
#[derive(Debug, Clone)]
pub struct Scene {
    /// Description that the scene was made from, without the arrays of garments and pins.
    pub(crate) description: SceneDescription,
    /// This rank's piece of each garment, of its present rest scale. Vertex v of it is the local vertex
    /// `parts.garment(g).start + v`.
    pub(crate) meshes: Vec<TriangleMesh>,
    /// Fixed split of all vertices, the order in which the solver stores them, and this rank's share.
    pub(crate) parts: Parts,
    /// Mass of each local vertex [kg].
    pub(crate) masses: Vec<f64>,
    /// Mean rest edge length over all garments [m]: the length that tolerances scale with.
    pub(crate) mean_edge: f64,
    pub(crate) start: Option<Vec<Vec3>>,
    pub(crate) velocities: Option<Vec<Vec3>>,
    pub(crate) pinned: Vec<Pinned>,
    pub(crate) pin_targets: usize,
    pub(crate) sewn: Vec<Sewn>,
    /// Own vertices that no triangle has, ascending, if any rank has such: they are held where they are.
    pub(crate) isolated: Option<Vec<u32>>,
    /// Vertices of all ranks that take no part and go with another vertex in the output.
    pub(crate) merged_vertices: Vec<MergedVertex>,
    /// Warnings about elements of garments that take no part, and about single precision far from the origin; on rank 0.
    pub(crate) warnings: Vec<String>,
    /// Maps of each garment, over the vertices of this rank's piece of its mesh.
    pub(crate) painted: Vec<PaintedMaps>,
    /// Triangles of each analytic body that edges and faces of cloth meet; empty until they are known.
    pub(crate) shape_meshes: Arc<Vec<Option<ShapeMesh>>>,
    /// Expected CPU seconds of a frame with each of [`Integrator::ALL`], in scenes whose integrator may change between frames.
    pub(crate) integrator_costs: Option<[f64; 2]>,
    /// Shared by all forms of the scene: with other numbers, and with parts on other ranks.
    pub(crate) identity: Arc<()>,
}

/// A vertex that takes no part and goes with another.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct MergedVertex {
    /// Its number in the scene, and that of the vertex that it follows.
    pub(crate) vertex: u32,
    pub(crate) leader: u32,
    /// From there to it, at the start [m].
    pub(crate) offset: Vec3,
}

/// A vertex that a pin holds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Pinned {
    /// Number of the target among all of the scene.
    pub(crate) number: u32,
    /// Number of the pin.
    pub(crate) pin: usize,
    /// Place among the vertices of the pin.
    pub(crate) row: usize,
    /// Local vertex.
    pub(crate) vertex: u32,
    /// Point of a surface that it is attached to, if the description gives one.
    pub(crate) attachment: Option<SurfaceAttachment>,
}

impl Scene {
    /// The description that this scene was made from, without the arrays of garments and pins.
    pub fn description(&self) -> &SceneDescription {
        &self.description
    }

    /// Whether the integrator may change between frames: the scene leaves it to the solver ([`Integrator::Auto`]), and both can have it.
    /// Known once a simulation was made of it.
    pub fn may_change_integrator(&self) -> bool {
        self.integrator_costs.is_some()
    }

    /// Whether the other is this scene, perhaps with other numbers or with parts on other ranks.
    pub fn is_form_of(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.identity, &other.identity)
    }

    /// Triangles of an analytic body that edges and faces of cloth meet, in its own frame.
    pub(crate) fn shape_mesh(&self, body: usize) -> Option<&ShapeMesh> {
        self.shape_meshes[body].as_ref()
    }

    /// Number of the points of a body whose edges and faces touch cloth.
    pub(crate) fn contact_points(&self, body: usize) -> usize {
        match &self.description.bodies[body].shape {
            BodyShape::Surface { point_count, .. } => *point_count,
            BodyShape::Rigid(_) => self.shape_mesh(body).map_or(0, |mesh| mesh.points.len()),
        }
    }

    /// This rank's piece of each garment, all of it if there is no other rank: the triangles with an own vertex and those that
    /// share an edge with one of them. Vertex v is the local vertex `parts().garment(g).start + v`.
    pub fn meshes(&self) -> &[TriangleMesh] {
        &self.meshes
    }

    /// The fixed split of all vertices, and this rank's share.
    pub fn parts(&self) -> &Parts {
        &self.parts
    }

    /// Mass of each local vertex [kg].
    pub fn masses(&self) -> &[f64] {
        &self.masses
    }

    /// Mean rest edge length over all garments [m].
    pub fn mean_edge(&self) -> f64 {
        self.mean_edge
    }

    /// Own vertices that pins hold, in the order of their targets.
    pub(crate) fn pinned(&self) -> &[Pinned] {
        &self.pinned
    }

    /// Pairs of sewn vertices with an own one, in the order of the seams.
    pub fn sewn(&self) -> &[Sewn] {
        &self.sewn
    }

    /// Rows of a track that own vertices follow, ascending.
    pub(crate) fn track_rows(&self, track: usize) -> Vec<u32> {
        let follows = |pinned: &&Pinned| matches!(&self.description.pins[pinned.pin].target, PinTarget::Track { track: t, .. } if *t == track);
        self.pinned.iter().filter(follows).map(|pinned| pinned.row as u32).collect()
    }

    /// Number of all pin targets of the scene.
    pub(crate) fn pin_targets(&self) -> usize {
        self.pin_targets
    }

    /// Rest positions of the local vertices [m].
    pub fn rest_positions(&self) -> Vec<Vec3> {
        self.meshes.iter().flat_map(|mesh| mesh.rest_positions()).copied().collect()
    }

    /// Positions [m] and velocities [m/s] of the local vertices at the start.
    pub(crate) fn start_state(&self) -> [Vec<Vec3>; 2] {
        let uniform = || {
            let of_garment = |(g, garment): (usize, &GarmentDescription)| {
                std::iter::repeat_n(garment.velocity, self.parts.garment(g).len())
            };
            self.description.garments.iter().enumerate().flat_map(of_garment).collect()
        };
        let modelled = || self.meshes.iter().flat_map(|mesh| mesh.modelled_positions()).copied().collect();
        let x = self.start.clone().unwrap_or_else(modelled);
        let mut v = self.velocities.clone().unwrap_or_else(uniform);
        self.stop_isolated(&mut v);
        [x, v]
    }

    /// Warnings of elements of garments that take no part, a sentence each: on rank 0, nothing elsewhere.
    pub fn warnings(&self) -> &[String] {
        &self.warnings
    }

    /// Own vertices that no triangle has, ascending, if any rank has such.
    pub(crate) fn isolated(&self) -> Option<&[u32]> {
        self.isolated.as_deref()
    }

    /// Vertices of all ranks that take no part and go with another in the output.
    pub(crate) fn merged_vertices(&self) -> &[MergedVertex] {
        &self.merged_vertices
    }

    /// Sets the velocities of isolated vertices to zero, halo included.
    fn stop_isolated(&self, v: &mut [Vec3]) {
        if let Some(isolated) = &self.isolated {
            isolated.iter().for_each(|vertex| v[*vertex as usize] = Vec3::zeros());
            self.parts.halo().update(self.parts.ranks(), v);
        }
    }
}
