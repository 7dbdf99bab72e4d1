//! `[[garment]]`, generated shapes and `[[garment.pin]]`.

use drapery_core::settings::{self, Dimension, Field, choice};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::FileUnits;
use super::place_schemas::{fractions, points_in_space};
use super::values::{Quantity, Rotation};

/// Finest resolution that is made; an honest scene stays far below, a slip of the keyboard does not.
pub(in crate::scene_file) const MAX_RESOLUTION: u32 = 20_000;

/// Longest leaf that is made [m]; the cells around leaves grow step by step until no two touch.
pub(in crate::scene_file) const LARGEST_LEAF: f64 = 100.0;

/// A garment: a mesh from a file or a generated one, its mass and its pins. Tables of effects
/// (`[garment.stretch]`, `[garment.bending]`) set its resistance.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(in crate::scene_file) struct Garment {
    /// Name, unique among the garments; it names the output files: letters, digits, "_", "-" and ".", up to 235 bytes.
    pub(in crate::scene_file) name: String,
    /// Rest shape from an Alembic, USD or OBJ file, as "file.abc" or "file.abc@frame".
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(in crate::scene_file) rest: Option<String>,
    /// Pattern of the path of its mesh in the file, as in "/char/skirt/*".
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(in crate::scene_file) path: Option<String>,
    /// Pose in which it starts, from a file with the same points, as "file.abc@frame"; the rest shape if left out.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(in crate::scene_file) start: Option<String>,
    /// Units of its files, if they differ from `[units]`, or if the files state wrong ones.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(in crate::scene_file) units: Option<FileUnits>,
    /// A rectangular panel.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(in crate::scene_file) panel: Option<Panel>,
    /// A flat disc.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(in crate::scene_file) disc: Option<Disc>,
    /// A closed sphere.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(in crate::scene_file) sphere: Option<Ball>,
    /// A tube open at both ends.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(in crate::scene_file) tube: Option<Tube>,
    /// Many small panels in random orientations, as one garment.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(in crate::scene_file) leaves: Option<Leaves>,
    /// A panel starts folded.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(in crate::scene_file) folds: Option<Folds>,
    /// Random displacement of the start positions.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(in crate::scene_file) jitter: Option<Jitter>,
    /// Preset material, or one from a file. Settings of the garment override it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(in crate::scene_file) material: Option<String>,
    /// Quantities that differ among the vertices, each the name of an attribute of the rest shape with one value for each
    /// point (of a colour, its red), or "file:" and a text file with one number for each vertex. Values multiply the
    /// number of the garment.
    #[serde(default, skip_serializing_if = "Maps::is_empty")]
    pub(in crate::scene_file) maps: Maps,
    /// Maps whose values replace the number of the garment, in its SI unit, instead of multiplying it.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(in crate::scene_file) absolute_maps: Vec<String>,
    /// Velocity at the start in m/s.
    #[serde(default)]
    #[schemars(inner(range(min = -1e6, max = 1e6)))]
    pub(in crate::scene_file) velocity: [f64; 3],
    /// Random velocities of the points at the start, added to `velocity`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(in crate::scene_file) random_velocity: Option<RandomVelocity>,
    /// Vertices that are held.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(in crate::scene_file) pin: Vec<Pin>,
    /// Place in the order in which garments are worn: the larger is outside, on the side to which the faces' normals point. Cloth that
    /// starts crossed is drawn to that side; garments without a layer, and layers of one garment, come apart where they can.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(max = 1000))]
    pub(in crate::scene_file) layer: Option<u32>,
    /// Elastic bands along its edges.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(in crate::scene_file) elastic: Vec<Elastic>,
    /// Parts that rules of contact name.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(in crate::scene_file) part: Vec<Part>,
    /// The mesh that is rendered instead; it follows the cloth and has its own caches.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(in crate::scene_file) render_mesh: Option<RenderMesh>,
}

/// The mesh that is rendered in the place of a garment: finer, with thickness, seams, buttons and layers, modelled on the rest shape
/// of the garment. Every point is bound to the closest point of the cloth at rest. It follows the cloth with a frame that turns smoothly
/// from point to point (docs/howto/render_mesh.md). It takes no part in the simulation. Its caches are called "GARMENT_render", in every
/// format of `[output]`, with normals; other attributes of the mesh are copied to the caches.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(in crate::scene_file) struct RenderMesh {
    /// An Alembic, USD or OBJ file, as "file.abc" or "file.abc@frame".
    pub(in crate::scene_file) file: String,
    /// Pattern of the path of its mesh in the file, as in "/char/skirt_render/*"; several meshes are merged into one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(in crate::scene_file) path: Option<String>,
    /// Units of the file, if they differ from `[units]`, or if the file states wrong ones.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(in crate::scene_file) units: Option<FileUnits>,
    /// Points that are farther from the cloth at rest give a warning, in metres or as "2 cm".
    #[serde(default = "default_max_distance")]
    #[schemars(range(min = 1e-9, max = 1e3))]
    pub(in crate::scene_file) max_distance: Quantity,
    /// Face sets that do not bend, such as ["button*", "buckle"]: every connected piece of them moves as one.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(in crate::scene_file) rigid: Vec<String>,
}

fn default_max_distance() -> Quantity {
    Quantity::Text("2 cm".to_owned())
}

/// Painted maps, one for each quantity that can differ from place to place. Painting 0 switches the quantity off at that
/// vertex; exception: a limit of 0 allows no strain. There are no maps for quantities that belong to a whole:
/// `[garment.pressure]` (gas has one pressure), gravity, the velocity of the air, `poisson` (a map of the membrane multiplies
/// all its moduli), and each single drag of the wind (a map is a share of all three). Nor for what chooses how to calculate:
/// `short_edges`, `thin_triangles`, `compressed_by`, `flat`, `sweeps`, `max_steps` and the numbers of `[self_repulsion]`
/// besides thickness and friction. Each `[[seam]]` has numbers of its own. Bodies are not painted. Poses and velocities at the
/// start come from files.
#[derive(Debug, Clone, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub(in crate::scene_file) struct Maps {
    /// Mass per area.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(in crate::scene_file) density: Option<String>,
    /// Distance that `self_repulsion` keeps.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(in crate::scene_file) thickness: Option<String>,
    /// Friction of `self_repulsion`; where layers touch, the mean of both.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(in crate::scene_file) self_friction: Option<String>,
    /// Friction on bodies.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(in crate::scene_file) friction: Option<String>,
    /// Stiffness of `[garment.stretch]`; a spring has the mean of its ends.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(in crate::scene_file) stretch: Option<String>,
    /// Stiffness of `[garment.shear]`; the spring of an altitude has the mean of the ends of its edge.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(in crate::scene_file) shear: Option<String>,
    /// Share of the stiffness of `[garment.membrane]`; a triangle has the mean of its corners.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(in crate::scene_file) membrane: Option<String>,
    /// `grain_angle` of `[garment.membrane]`, for example of every panel its own; a triangle has the mean of its corners. In radians
    /// where it is in `absolute_maps`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(in crate::scene_file) grain_angle: Option<String>,
    /// Stiffness of `[garment.bending]`; a spring has the mean of its ends.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(in crate::scene_file) bending: Option<String>,
    /// Rigidity of `[garment.dihedral_bending]`; a triangle has the mean of its corners.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(in crate::scene_file) dihedral_bending: Option<String>,
    /// `damping_ratio` of `[garment.stretch]`; a spring has the mean of its ends.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(in crate::scene_file) stretch_damping: Option<String>,
    /// `damping_ratio` of `[garment.shear]`; the spring of an altitude has the mean of the ends of its edge.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(in crate::scene_file) shear_damping: Option<String>,
    /// `damping_ratio` of `[garment.membrane]`; a triangle has the mean of its corners.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(in crate::scene_file) membrane_damping: Option<String>,
    /// `damping_ratio` of `[garment.bending]`; a spring has the mean of its ends.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(in crate::scene_file) bending_damping: Option<String>,
    /// `damping_ratio` of `[garment.dihedral_bending]`; an angle has the mean of its four vertices.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(in crate::scene_file) dihedral_bending_damping: Option<String>,
    /// `yield_radius` of `[garment.plastic_wrinkles]`, below which bends stay; an angle has the mean of its four
    /// vertices. Where it is zero, none stays.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(in crate::scene_file) yield_radius: Option<String>,
    /// `hardening` of `[garment.plastic_wrinkles]`; an angle has the mean of its four vertices.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(in crate::scene_file) hardening: Option<String>,
    /// `largest_angle` of `[garment.plastic_wrinkles]`; an angle has the mean of its four vertices.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(in crate::scene_file) largest_angle: Option<String>,
    /// `limit` of `[garment.strain_limit]`; an edge has the mean of its ends.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(in crate::scene_file) strain_limit: Option<String>,
    /// `compression` of `[garment.strain_limit]`; an edge has the mean of its ends.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(in crate::scene_file) compression: Option<String>,
    /// Stiffness of pins with `mode = "spring"`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(in crate::scene_file) pins: Option<String>,
    /// `damping_ratio` of pins with `mode = "spring"`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(in crate::scene_file) pin_damping: Option<String>,
    /// `break_force` of pins with `mode = "spring"`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(in crate::scene_file) break_force: Option<String>,
    /// Share of the wind that is felt.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(in crate::scene_file) wind: Option<String>,
    /// Rate of `[ether_drag]`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(in crate::scene_file) ether_drag: Option<String>,
}

impl Maps {
    /// The maps that the garment has, each by its key and name.
    pub(in crate::scene_file) fn written(&self) -> Vec<(String, String)> {
        // The names are those of the fields, which serde knows.
        let Ok(serde_json::Value::Object(all)) = serde_json::to_value(self) else { return Vec::new() };
        let text = |(of, name): (String, serde_json::Value)| name.as_str().map(|name| (of, name.to_owned()));
        all.into_iter().filter_map(text).collect()
    }

    fn is_empty(&self) -> bool {
        self.written().is_empty()
    }
}

/// A rectangular panel of right triangles with herring-bone diagonals.
#[derive(Debug, Clone, Copy, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(in crate::scene_file) struct Panel {
    /// Cells along the side (z). There are floor(aspect · resolution) along x.
    #[schemars(range(min = 1, max = MAX_RESOLUTION))]
    pub(in crate::scene_file) resolution: u32,
    /// Length along z in metres.
    #[serde(default = "one")]
    #[schemars(range(min = 1e-6, max = 1e6))]
    pub(in crate::scene_file) side: f64,
    /// Length along x over length along z.
    #[serde(default = "default_aspect")]
    #[schemars(range(min = 1e-6, max = 1e6))]
    pub(in crate::scene_file) aspect: f64,
    /// Flat in the plane y = const, or bent along a parabola.
    #[serde(default)]
    pub(in crate::scene_file) shape: PanelShape,
    /// Position of the centre of its bounding box. Left out, with no rotation: one corner is at (0, 0.5, 0).
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(inner(range(min = -1e9, max = 1e9)))]
    pub(in crate::scene_file) center: Option<[f64; 3]>,
    /// Rotation about its centre.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(in crate::scene_file) rotation: Option<Rotation>,
}

fn one() -> f64 {
    1.0
}

fn default_aspect() -> f64 {
    1.7
}

/// Shape of a panel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub(in crate::scene_file) enum PanelShape {
    /// Flat.
    #[default]
    Flat,
    /// Along y = 1.5 x² for x from -1 to 1, in equal arc lengths, scaled by 0.25; `aspect` only sets the cells along x.
    Parabola,
}

/// A flat disc of rings of triangles in the plane y = const.
#[derive(Debug, Clone, Copy, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(in crate::scene_file) struct Disc {
    /// Number of rings.
    #[schemars(range(min = 1, max = MAX_RESOLUTION))]
    pub(in crate::scene_file) resolution: u32,
    /// Radius in metres.
    #[schemars(range(min = 1e-6, max = 1e6))]
    pub(in crate::scene_file) radius: f64,
    /// Centre.
    #[serde(default)]
    #[schemars(inner(range(min = -1e9, max = 1e9)))]
    pub(in crate::scene_file) center: [f64; 3],
    /// Rotation about its centre.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(in crate::scene_file) rotation: Option<Rotation>,
}

/// A closed sphere.
#[derive(Debug, Clone, Copy, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(in crate::scene_file) struct Ball {
    /// Rows of triangles from a pole to the equator.
    #[schemars(range(min = 1, max = MAX_RESOLUTION))]
    pub(in crate::scene_file) resolution: u32,
    /// Radius in metres.
    #[schemars(range(min = 1e-6, max = 1e6))]
    pub(in crate::scene_file) radius: f64,
    /// Centre.
    #[serde(default)]
    #[schemars(inner(range(min = -1e9, max = 1e9)))]
    pub(in crate::scene_file) center: [f64; 3],
}

/// A tube along y, open at both ends.
#[derive(Debug, Clone, Copy, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(in crate::scene_file) struct Tube {
    /// Cells around.
    #[schemars(range(min = 3, max = MAX_RESOLUTION))]
    pub(in crate::scene_file) resolution: u32,
    /// Radius in metres.
    #[schemars(range(min = 1e-6, max = 1e6))]
    pub(in crate::scene_file) radius: f64,
    /// Length in metres.
    #[schemars(range(min = 1e-6, max = 1e6))]
    pub(in crate::scene_file) length: f64,
    /// Centre.
    #[serde(default)]
    #[schemars(inner(range(min = -1e9, max = 1e9)))]
    pub(in crate::scene_file) center: [f64; 3],
    /// Rotation about its centre.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(in crate::scene_file) rotation: Option<Rotation>,
}

/// Small panels in a block of cells, each turned at random; the cells are as small as they can be without panels
/// touching.
#[derive(Debug, Clone, Copy, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(in crate::scene_file) struct Leaves {
    /// Panels along x, y and z.
    #[schemars(inner(range(min = 1, max = 2000)))]
    pub(in crate::scene_file) count: [u32; 3],
    /// Cells along the side of each panel.
    #[schemars(range(min = 1, max = MAX_RESOLUTION))]
    pub(in crate::scene_file) resolution: u32,
    /// Length of a panel along its z in metres.
    #[serde(default = "one")]
    #[schemars(range(min = 1e-6, max = LARGEST_LEAF))]
    pub(in crate::scene_file) side: f64,
    /// Length of a panel along its x over its side.
    #[serde(default = "default_aspect")]
    #[schemars(range(min = 1e-6, max = 1e6))]
    pub(in crate::scene_file) aspect: f64,
    /// Height of the centres of the lowest layer in metres.
    #[schemars(range(min = -1e9, max = 1e9))]
    pub(in crate::scene_file) base_height: f64,
    /// Seed of the random orientations.
    pub(in crate::scene_file) seed: u64,
    /// Largest angle of a panel from the horizontal, in degrees.
    #[schemars(range(min = -360.0, max = 360.0))]
    pub(in crate::scene_file) max_angle: f64,
}

/// Random displacement of the start positions along one axis; the rest shape stays as it is.
#[derive(Debug, Clone, Copy, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(in crate::scene_file) struct Jitter {
    /// Axis of the displacement.
    pub(in crate::scene_file) axis: Axis,
    /// Displacements are uniform between zero and this, in metres.
    #[schemars(range(min = -1e6, max = 1e6))]
    pub(in crate::scene_file) amplitude: f64,
    /// Seed of the random numbers.
    pub(in crate::scene_file) seed: u64,
}

/// A panel starts folded to and fro along its x, every edge along x as long as at rest. The bounding box of the stack
/// has the centre that the panel has at rest.
#[derive(Debug, Clone, Copy, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(in crate::scene_file) struct Folds {
    /// Layers, one over the other along the panel's y; at least 2, each of at least 3 cells along x.
    #[schemars(range(min = 2, max = MAX_RESOLUTION))]
    pub(in crate::scene_file) layers: u32,
    /// Distance between layers in metres; less than two cells, because two cells make a fold.
    #[schemars(range(min = 1e-9, max = 1e6))]
    pub(in crate::scene_file) gap: f64,
}

/// Velocities of one speed in random directions.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(in crate::scene_file) struct RandomVelocity {
    /// Speed of every point, in m/s or as "100 m/s".
    #[schemars(range(min = 1e-9, max = 1e6))]
    pub(in crate::scene_file) speed: Quantity,
    /// Seed of the random directions.
    pub(in crate::scene_file) seed: u64,
}

/// An axis of the world.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub(in crate::scene_file) enum Axis {
    /// To the side.
    X,
    /// Up.
    Y,
    /// To the front.
    Z,
}

/// Vertices that are held. One of `vertices`, `corners`, `nodes`, `where`, `map` and `file` selects them, `to` their target.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(in crate::scene_file) struct Pin {
    /// Vertex numbers, from 0, in the order of the garment's file.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(in crate::scene_file) vertices: Option<Vec<u32>>,
    /// Corners of a panel: "i0j0", "inj0", "i0jn", "injn" (i along x, j along z).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(in crate::scene_file) corners: Option<Vec<Corner>>,
    /// Nodes of a panel nearest to fractions of its length along x and z: [[0.5, 0], …].
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(transform = fractions)]
    pub(in crate::scene_file) nodes: Option<Vec<[f64; 2]>>,
    /// A region: vertices that start inside are held.
    #[serde(rename = "where", skip_serializing_if = "Option::is_none")]
    pub(in crate::scene_file) region: Option<Region>,
    /// A painted map: vertices where it is above one half are held. The name of an attribute of the rest shape with one value for
    /// each point (a primvar, without `primvars:`), or `"file:pins.txt"`, as in `maps` of the garment.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(in crate::scene_file) map: Option<String>,
    /// A JSON file of pins: vertices, and where on a body they are attached.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(in crate::scene_file) file: Option<String>,
    /// "start": the place where a vertex starts. "here": the place where it is when the pin becomes active. "body:NAME":
    /// the surface of a body from a file. "track": positions from the file in `track`.
    #[serde(default = "default_to")]
    pub(in crate::scene_file) to: String,
    /// With `to = "track"`: a mesh with as many points as the garment, as "file.abc" or "file.abc@/path/of/mesh".
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(in crate::scene_file) track: Option<String>,
    /// Axes in which the vertices are held, as "xyz" or "xy", each letter once; springs hold in all.
    #[serde(default = "default_axes")]
    pub(in crate::scene_file) axes: String,
    /// With `to = "start"` or `to = "here"`: offsets from that place, [[seconds since the first frame, [dx, dy, dz]],
    /// …], in the order of their times.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    #[schemars(transform = points_in_space)]
    pub(in crate::scene_file) path: Vec<(f64, [f64; 3])>,
}

fn default_to() -> String {
    "start".to_owned()
}

fn default_axes() -> String {
    "xyz".to_owned()
}

/// An elastic band: edges with both ends among the chosen vertices pull as elastic sewn along them (docs/howto/elastic.md). One of
/// `vertices`, `nodes`, `where` and `map` chooses them.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(in crate::scene_file) struct Elastic {
    /// Vertex numbers, from 0, in the order of the garment's file.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(in crate::scene_file) vertices: Option<Vec<u32>>,
    /// Nodes of a panel nearest to fractions of its length along x and z: [[0.5, 0], …].
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(transform = fractions)]
    pub(in crate::scene_file) nodes: Option<Vec<[f64; 2]>>,
    /// A region: vertices that start inside are chosen.
    #[serde(rename = "where", skip_serializing_if = "Option::is_none")]
    pub(in crate::scene_file) region: Option<Region>,
    /// A painted map: vertices where it is above one half are chosen, as in `map` of a pin.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(in crate::scene_file) map: Option<String>,
}

/// A part of a garment, for rules of contact: `between = ["coat.pocket", "coat"]` is the part `pocket` and the rest of `coat`. One of `faces`,
/// `map`, `vertices` and `where` chooses its vertices; faces are of the part if all of their corners are.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(in crate::scene_file) struct Part {
    /// Name, unique in the garment.
    pub(in crate::scene_file) name: String,
    /// Face sets of the rest shape, such as ["pocket*"]; of OBJ files, groups or materials.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(in crate::scene_file) faces: Vec<String>,
    /// A painted map: vertices where it is above one half are chosen, as in `map` of a pin.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(in crate::scene_file) map: Option<String>,
    /// Vertex numbers, from 0, in the order of the garment's file.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(in crate::scene_file) vertices: Option<Vec<u32>>,
    /// A region: vertices that start inside are chosen.
    #[serde(rename = "where", skip_serializing_if = "Option::is_none")]
    pub(in crate::scene_file) region: Option<Region>,
}

/// A corner of a panel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub(in crate::scene_file) enum Corner {
    /// Smallest x, smallest z.
    I0j0,
    /// Largest x, smallest z.
    Inj0,
    /// Smallest x, largest z.
    I0jn,
    /// Largest x, largest z.
    Injn,
}

/// A region of space.
#[derive(Debug, Clone, Copy, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, rename_all = "lowercase")]
pub(in crate::scene_file) enum Region {
    /// A box with edges along the axes.
    Box {
        /// Smallest coordinates in metres.
        min: [f64; 3],
        /// Largest coordinates in metres.
        max: [f64; 3],
    },
}

choice! {
    /// Binding of pinned vertices to a body.
    pub(in crate::scene_file) enum Bind {
        /// To the attachments of the JSON file, if it was made for a body of the same file name; otherwise to the nearest point.
        Auto = "auto",
        /// To the attachments of the JSON file.
        File = "file",
        /// To the nearest point of the body's surface at the start.
        Nearest = "nearest",
    }
}

/// The row of `bind`, which becomes the target of a pin.
pub(in crate::scene_file) const BIND: Field = Field {
    name: "bind",
    dimension: Dimension::None,
    default: settings::Default::Choice("auto", Bind::WORDS),
    range: (0.0, 0.0),
    help: "with `to = \"body:…\"`: its binding; a vertex that is farther from the body than three of its edges and ten \
           thicknesses, or than 5 cm, gives a warning",
};
