//! Render meshes: bound to the garments that they follow before anything runs, and placed in every frame.

use std::collections::BTreeSet;

use drapery_core::Vec3;
use drapery_core::geometry::surface_binding::SurfaceBinding;
use drapery_core::mesh::{MeshStream, PolygonMesh, sides};
use drapery_core::scene::{FARTHEST, is_possible};
use drapery_io::error::IoError;
use drapery_io::garment_mesh::{GarmentMesh, triangles_of};
use drapery_io::mesh_data::{Connectivity, MeshData};
use drapery_io::normals::{self, SplitNormals};
use drapery_io::shot_description::RenderMeshDescription;
use drapery_io::units::{LengthUnit, Units, UpAxis, likely_unit};

/// Share of a mesh's area that faces against the cloth above which it is taken to be turned inside out; of a shell it is a half.
const TURNED: f64 = 0.9;

/// A render mesh bound to its garment.
pub(crate) struct RenderMesh {
    /// The garment that it follows.
    pub(crate) garment: usize,
    /// Its name, by which its caches are called.
    pub(crate) name: String,
    /// The mesh, for its caches.
    pub(crate) mesh: GarmentMesh,
    faces: Connectivity,
    split_normals: Option<SplitNormals>,
    binding: SurfaceBinding,
}

/// Possible faults of a binding.
#[derive(Debug)]
pub(crate) struct JudgedBinding {
    /// Object that it is about, for messages.
    pub(crate) object: String,
    /// Number of points.
    pub(crate) points: usize,
    /// Distance from the cloth at rest above which points are counted [m].
    pub(crate) max_distance: f64,
    /// Number of points that are farther.
    pub(crate) far: usize,
    /// The farthest of them, and its distance [m].
    pub(crate) farthest: Option<(usize, f64)>,
    /// The unit in which it would have the size of the garment, where it is far from that.
    pub(crate) unit: Option<(LengthUnit, UpAxis)>,
    /// Edges whose ends are bound to different layers of the cloth.
    pub(crate) torn: Vec<[u32; 2]>,
    /// Whether its faces look to the other side than those of the cloth.
    pub(crate) is_flipped: bool,
    /// Points that belong to no face.
    pub(crate) loose: usize,
}

impl JudgedBinding {
    /// Returns the message about points that belong to no face, if there are any.
    pub(crate) fn loose_in_words(&self) -> Option<String> {
        (self.loose > 0).then(|| format!("{}: {} points belong to no face", self.object, self.loose))
    }
}

/// Data that caches store of a render mesh in a frame.
pub(crate) struct Positioned {
    pub(crate) positions: Vec<[f32; 3]>,
    /// Empty where none are asked for.
    pub(crate) velocities: Vec<[f32; 3]>,
    pub(crate) normals: Vec<[f32; 3]>,
}

impl RenderMesh {
    /// Binds a render mesh to the rest shape of `garment`, which has this name, and looks at the binding.
    ///
    /// # Errors
    /// One of the meshes cannot be read; a point is at no possible place; the garment has no triangle.
    pub(crate) fn bind(
        described: RenderMeshDescription,
        (garment, name): (&GarmentMesh, &str),
    ) -> Result<(Self, JudgedBinding), IoError> {
        let broken = |what: String| {
            // An OBJ has no paths.
            let object = Some(described.mesh.object_path()).filter(|path| !path.is_empty()).unwrap_or("render mesh");
            IoError::data(&described.file, object, what, "export the render mesh again")
        };
        let cloth = garment.read()?;
        let MeshData { mesh, split_normals, .. } = described.mesh.read()?;
        if let Some(point) = mesh.points.iter().position(|point| !is_possible(point)) {
            return Err(broken(format!("the position of point {point} is not finite, or beyond {FARTHEST:e} m")));
        }
        let triangles = triangles_of(&cloth);
        let bind = |rigid: &[Vec<u32>]| {
            SurfaceBinding::new(cloth.mesh.points.clone(), triangles.clone(), &mesh.points, rigid)
                .ok_or_else(|| broken(format!("garment \"{name}\" has no triangle with an area to follow")))
        };
        // Judged is where each point is, also those that move with the middle of their part.
        let own = bind(&[])?;
        let judged = judged(&described, (&mesh, name), (&own, &cloth.mesh.points));
        let binding = if described.rigid.is_empty() { own } else { bind(&described.rigid)? };
        let faces = Connectivity { face_counts: mesh.face_counts, face_indices: mesh.face_indices };
        let RenderMeshDescription { garment, name, mesh, .. } = described;
        Ok((Self { garment, name, mesh, faces, split_normals, binding }, judged))
    }

    /// The mesh where the garment's points are at `x` [m] with the velocities `v` [m/s], which are left out where none are stored;
    /// as caches in `units` store it, positions counted from `origin` [m].
    pub(crate) fn placed(&self, x: &[Vec3], v: Option<&[Vec3]>, (units, origin): (Units, Vec3)) -> Positioned {
        let (positions, velocities) = match v {
            Some(v) => self.binding.motion(x, v),
            None => (self.binding.positions(x), Vec::new()),
        };
        let positions: Vec<[f32; 3]> = positions.iter().map(|p| units.stored_from(origin, *p)).collect();
        let normals = self.normals(&positions);
        Positioned { positions, velocities: units.stored_all(&velocities), normals }
    }

    /// The binding of its points to the cloth.
    pub(crate) fn binding(&self) -> &SurfaceBinding {
        &self.binding
    }

    /// Number of triangles that its faces are cut into.
    pub(crate) fn triangle_count(&self) -> usize {
        self.faces.face_counts.iter().map(|corners| (*corners as usize).saturating_sub(2)).sum()
    }

    /// Returns the size of a sample in a cache: positions, normals, and velocities where they are stored [bytes].
    pub(crate) fn bytes_per_sample(&self, velocities: bool) -> usize {
        let normals = self.split_normals.as_ref().map_or(self.mesh.point_count(), |split| split.count);
        (self.mesh.point_count() * (1 + usize::from(velocities)) + normals) * size_of::<[f32; 3]>()
    }

    /// Normals that belong to positions as they are stored.
    fn normals(&self, positions: &[[f32; 3]]) -> Vec<[f32; 3]> {
        let faces = (&self.faces.face_counts[..], &self.faces.face_indices[..]);
        normals::of_faces(faces, self.split_normals.as_ref(), positions)
    }
}

/// Looks at a binding.
fn judged(
    described: &RenderMeshDescription,
    (mesh, garment): (&PolygonMesh, &str),
    (binding, cloth): (&SurfaceBinding, &[Vec3]),
) -> JudgedBinding {
    let limit = described.max_distance;
    let distances = judged_distances(described, binding);
    let far = distances.iter().filter(|distance| **distance > limit).count();
    let worst = distances.iter().copied().enumerate().max_by(|a, b| a.1.total_cmp(&b.1));
    let triangles = triangulated(mesh);
    let edges: BTreeSet<[u32; 2]> = sides(triangles.iter().copied()).map(|[a, b, _]| [a.min(b), a.max(b)]).collect();
    let is_near = |edge: &[u32; 2]| edge.iter().all(|point| distances[*point as usize] <= limit);
    let used: BTreeSet<u32> = mesh.face_indices.iter().copied().collect();
    JudgedBinding {
        object: format!("garment \"{garment}\", render mesh ({})", described.file.display()),
        points: mesh.points.len(),
        max_distance: limit,
        far,
        farthest: worst.filter(|_| far > 0),
        unit: likely_unit(size(&mesh.points), described.units, size(cloth)).map(|unit| (unit, described.units.up)),
        torn: binding.torn(&mesh.points, edges.into_iter().filter(is_near)),
        is_flipped: binding.facing_against(&mesh.points, &triangles) > TURNED,
        loose: mesh.points.len() - used.len(),
    }
}

/// Largest extent of points [m].
fn size(points: &[Vec3]) -> f64 {
    let first = points.first().copied().unwrap_or_default();
    let (low, high) = points.iter().fold((first, first), |(low, high), p| (low.inf(p), high.sup(p)));
    (high - low).max()
}

/// Distance of each point from the cloth; of a point of a rigid part that of its closest point, however large the part is.
fn judged_distances(described: &RenderMeshDescription, binding: &SurfaceBinding) -> Vec<f64> {
    let mut distances: Vec<f64> = binding.distances().collect();
    for part in &described.rigid {
        let closest = part.iter().map(|point| distances[*point as usize]).fold(f64::INFINITY, f64::min);
        part.iter().for_each(|point| distances[*point as usize] = closest);
    }
    distances
}

/// The faces cut into triangles; points and lines among them are none.
fn triangulated(mesh: &PolygonMesh) -> Vec<[u32; 3]> {
    let mut polygons = PolygonMesh { points: mesh.points.clone(), ..PolygonMesh::default() };
    for face in mesh.faces().filter(|face| face.len() > 2) {
        polygons.face_counts.push(face.len() as u32);
        polygons.face_indices.extend(face);
    }
    polygons.triangulate().0
}
