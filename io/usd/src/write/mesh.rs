//! The layers of a mesh: what stays, and what moves.

use openusd::gf;
use openusd::sdf::Value;

use super::Units;
use super::binary::{BinaryLayer, Declared, Prim, WriteError, token};
use super::names::{Distinct, MeshPath};
use super::primvars::{self, Primvar, Values};
use super::subsets::{self, FaceSubset};
use crate::Interpolation;
use crate::RENDER_MESH_OF;
use crate::material::BoundMaterial;

/// Attributes that move, with their types; [`super::clip_manifest`] declares the same.
pub(super) const POINTS: (&str, &str) = ("points", "point3f[]");
pub(super) const VELOCITIES: (&str, &str) = ("velocities", "vector3f[]");
pub(super) const NORMALS: (&str, &str) = ("normals", "normal3f[]");
pub(super) const EXTENT: (&str, &str) = ("extent", "float3[]");

/// Number of edges of cloth that pass through triangles of cloth, in all garments of the shot.
pub(super) const CROSSINGS: (&str, &str) = ("drapery:crossings", "uint");

/// The triangles that were simulated, three points each; only in meshes with other faces.
const TRIANGLES: (&str, &str) = ("drapery:triangles", "int3[]");

/// Words for the attributes at the points that are this program's: a mesh may have others of the same names.
const ATTRIBUTES: (&str, &str) = ("drapery:attributes", "string");

/// Number of the normal of each face corner, where hard edges split them.
pub(crate) const NORMAL_INDICES: (&str, &str) = ("drapery:normalIndices", "int[]");

/// Type of numbers at the points.
pub(super) const NUMBERS: &str = "float[]";

/// Name of the primvar with numbers at the points.
pub(crate) fn primvar_of(name: &str) -> String {
    format!("primvars:{name}")
}

/// Interpretation of the faces by a renderer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Subdivision {
    /// As they are.
    #[default]
    None,
    /// As the cage of a Catmull-Clark surface.
    CatmullClark,
    /// As the cage of a Loop surface.
    Loop,
    /// Cut finer without being smoothed.
    Bilinear,
}

impl Subdivision {
    fn word(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::CatmullClark => "catmullClark",
            Self::Loop => "loop",
            Self::Bilinear => "bilinear",
        }
    }
}

/// Everything of a mesh that does not move. Faces are counter-clockwise seen from outside.
#[derive(Debug)]
pub struct StillMesh<'a> {
    /// Path of the mesh in its layer.
    pub path: &'a MeshPath,
    /// Origin that its points are counted from, if not the origin of the world: a translation of the prim above the
    /// mesh, or of the mesh itself where there is no prim above it.
    pub origin: Option<[f64; 3]>,
    /// Number of corners of each face.
    pub face_counts: Vec<i32>,
    /// Point of each corner.
    pub face_indices: Vec<i32>,
    /// Interpretation of the faces by renderers.
    pub subdivision: Subdivision,
    /// Texture coordinates, and the one of each face corner.
    pub uvs: Option<(Vec<[f32; 2]>, Vec<i32>)>,
    /// Other attributes.
    pub primvars: Vec<Primvar>,
    /// Face sets.
    pub subsets: Vec<FaceSubset>,
    /// The material of the whole mesh, if one is bound.
    pub material: Option<BoundMaterial>,
    /// Purpose, if it is stated: `render`, `proxy` or `guide`.
    pub purpose: Option<String>,
    /// Whether both sides of it are rendered, where that is said.
    pub double_sided: Option<bool>,
    /// The garment that it follows to be rendered in its place, if it does.
    pub render_mesh_of: Option<String>,
    /// The triangles that were simulated, where they are not just the faces.
    pub triangles: Option<Vec<[i32; 3]>>,
    /// Whether frames have velocities.
    pub velocities: bool,
    /// Whether frames have normals, one for each point or each face corner.
    pub normals: bool,
    /// Number of the normal of each face corner, where hard edges split them; frames then have one for each corner.
    pub normal_indices: Option<Vec<i32>>,
    /// Whether frames have a number of intersections.
    pub crossings: bool,
    /// Names of numbers at the points that frames have.
    pub numbers: Vec<&'static str>,
    /// Words for the attributes at the points that are this program's, if there are any.
    pub attributes: Option<String>,
}

/// Members that frames have beside points and extent.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Members<'a> {
    /// Velocities.
    pub velocities: bool,
    /// Normals.
    pub normals: bool,
    /// A number of crossings.
    pub crossings: bool,
    /// Names of numbers at the points.
    pub numbers: &'a [&'static str],
}

/// Moving data of a mesh at one frame.
#[derive(Debug, Clone, Copy)]
pub struct Moving<'a> {
    /// Time code, which is the frame.
    pub time_code: f64,
    /// Positions.
    pub points: &'a [[f32; 3]],
    /// Velocities per second.
    pub velocities: Option<&'a [[f32; 3]]>,
    /// Normals at the points, or at the face corners where hard edges split them.
    pub normals: Option<&'a [[f32; 3]]>,
    /// Crossings of the shot.
    pub crossings: Option<u32>,
    /// Numbers at the points, with their names.
    pub numbers: &'a [(&'static str, &'a [f32])],
}

/// The layer with everything of a mesh that does not move: prims, faces, attributes, face sets. What moves is declared in it
/// without a value.
///
/// # Errors
/// A name or a material's path is none that USD accepts.
pub fn topology(units: Units, still: StillMesh<'_>) -> Result<Vec<u8>, WriteError> {
    let mut layer = BinaryLayer::new(units, still.path.root());
    let root = layer.prim(&layer.root(), still.path.root(), Some(kind_of(still.path, 0)))?;
    layer.field(&root, "kind", token("component"));
    let shifted = still.path.prims().len().saturating_sub(2);
    add_prims(&mut layer, still, shifted)?;
    layer.bytes()
}

/// Type of a prim on the way to a mesh.
fn kind_of(path: &MeshPath, level: usize) -> &'static str {
    if level + 1 == path.prims().len() { "Mesh" } else { "Xform" }
}

/// Adds a mesh and the prims above it that are not there yet; what its points are counted from stands at the level `shifted`.
pub(super) fn add_prims(layer: &mut BinaryLayer, still: StillMesh<'_>, shifted: usize) -> Result<Prim, WriteError> {
    let prims = still.path.prims();
    let mut parent = layer.root();
    for (level, name) in prims.iter().enumerate() {
        let prim = layer.prim(&parent, name, Some(kind_of(still.path, level)))?;
        if let Some(origin) = still.origin.filter(|_| level == shifted) {
            let double = |value| Some(Value::Vec3d(value));
            layer.attribute(&prim, ("xformOp:translate", "double3"), Declared::default(), double(origin.into()))?;
            let order = primvars::tokens(&["xformOp:translate"]);
            layer.attribute(&prim, ("xformOpOrder", "token[]"), uniform(), Some(order))?;
        }
        parent = prim;
    }
    add_mesh(layer, &parent, still)?;
    Ok(parent)
}

fn uniform() -> Declared<'static> {
    Declared { uniform: true, ..Declared::default() }
}

/// One value for each point.
fn at_points() -> Declared<'static> {
    Declared { interpolation: Some(Interpolation::Vertex.word()), ..Declared::default() }
}

/// One value for each face corner.
fn at_corners() -> Declared<'static> {
    Declared { interpolation: Some(Interpolation::FaceVarying.word()), ..Declared::default() }
}

fn custom() -> Declared<'static> {
    Declared { custom: true, ..Declared::default() }
}

fn add_mesh(layer: &mut BinaryLayer, mesh: &Prim, still: StillMesh<'_>) -> Result<(), WriteError> {
    let plain = Declared::default();
    layer.attribute(mesh, ("faceVertexCounts", "int[]"), plain, Some(Value::IntVec(still.face_counts)))?;
    layer.attribute(mesh, ("faceVertexIndices", "int[]"), plain, Some(Value::IntVec(still.face_indices)))?;
    layer.attribute(mesh, ("orientation", "token"), uniform(), Some(token("rightHanded")))?;
    layer.attribute(mesh, ("subdivisionScheme", "token"), uniform(), Some(token(still.subdivision.word())))?;
    layer.attribute(mesh, POINTS, plain, None)?;
    if still.velocities {
        layer.attribute(mesh, VELOCITIES, plain, None)?;
    }
    if still.normals {
        let declared = if still.normal_indices.is_some() { at_corners() } else { at_points() };
        layer.attribute(mesh, NORMALS, declared, None)?;
    }
    if let Some(indices) = still.normal_indices {
        layer.attribute(mesh, NORMAL_INDICES, custom(), Some(Value::IntVec(indices)))?;
    }
    layer.attribute(mesh, EXTENT, plain, None)?;
    if still.crossings {
        layer.attribute(mesh, CROSSINGS, custom(), None)?;
    }
    for name in &still.numbers {
        layer.attribute(mesh, (&primvar_of(name), NUMBERS), at_points(), None)?;
    }
    if let Some(words) = still.attributes {
        let declared = Declared { custom: true, uniform: true, ..Declared::default() };
        layer.attribute(mesh, ATTRIBUTES, declared, Some(Value::String(words)))?;
    }
    if let Some(triangles) = still.triangles {
        let triangles = triangles.into_iter().map(Into::into).collect();
        layer.attribute(mesh, TRIANGLES, custom(), Some(Value::Vec3iVec(triangles)))?;
    }
    let uvs = still.uvs.map(|(values, indices)| Primvar {
        name: "st".to_owned(),
        interpolation: Interpolation::FaceVarying,
        values: Values::Float(values.into_flattened()),
        extent: 2,
        role: "texCoord",
        indices: Some(indices),
    });
    let mut names = Distinct::default();
    for primvar in uvs.into_iter().chain(still.primvars) {
        let identifier = names.identifier(&primvar.name);
        primvars::add(layer, mesh, &identifier, primvar)?;
    }
    if let Some(material) = &still.material {
        subsets::bind(layer, (mesh, still.path), material)?;
    }
    if let Some(both) = still.double_sided {
        layer.attribute(mesh, ("doubleSided", "bool"), uniform(), Some(Value::Bool(both)))?;
    }
    if let Some(garment) = still.render_mesh_of {
        let declared = Declared { custom: true, uniform: true, ..Declared::default() };
        layer.attribute(mesh, (RENDER_MESH_OF, "string"), declared, Some(Value::String(garment)))?;
    }
    if let Some(purpose) = &still.purpose {
        layer.attribute(mesh, ("purpose", "token"), uniform(), Some(token(purpose)))?;
    }
    subsets::add(layer, (mesh, still.path), &still.subsets)
}

/// The layer with one frame of what moves: a time sample of each attribute at the time code of the frame.
///
/// # Errors
/// Never with a path of [`MeshPath::of`].
pub fn clip(units: Units, path: &MeshPath, frame: &Moving<'_>) -> Result<Vec<u8>, WriteError> {
    let mut layer = BinaryLayer::new(units, path.root());
    let mut mesh = layer.root();
    for name in path.prims() {
        mesh = layer.prim(&mesh, name, None)?;
    }
    let time = frame.time_code;
    let plain = Declared::default();
    layer.sample(&mesh, POINTS, plain, (time, vectors(frame.points)))?;
    if let Some(velocities) = frame.velocities {
        layer.sample(&mesh, VELOCITIES, plain, (time, vectors(velocities)))?;
    }
    if let Some(normals) = frame.normals {
        layer.sample(&mesh, NORMALS, plain, (time, vectors(normals)))?;
    }
    layer.sample(&mesh, EXTENT, plain, (time, vectors(&extent(frame.points))))?;
    if let Some(crossings) = frame.crossings {
        layer.sample(&mesh, CROSSINGS, custom(), (time, Value::Uint(crossings)))?;
    }
    for (name, numbers) in frame.numbers {
        layer.sample(&mesh, (&primvar_of(name), NUMBERS), plain, (time, Value::FloatVec(numbers.to_vec())))?;
    }
    layer.bytes()
}

/// Vectors as the value of an attribute.
pub(super) fn vectors(all: &[[f32; 3]]) -> Value {
    Value::Vec3fVec(all.iter().map(|v| gf::Vec3f::from(*v)).collect())
}

/// Smallest and largest coordinates; of no points, as USD writes it, the largest number before the smallest.
pub(super) fn extent(points: &[[f32; 3]]) -> [[f32; 3]; 2] {
    let mut extent = [[f32::MAX; 3], [-f32::MAX; 3]];
    for point in points {
        for axis in 0..3 {
            extent[0][axis] = extent[0][axis].min(point[axis]);
            extent[1][axis] = extent[1][axis].max(point[axis]);
        }
    }
    extent
}
