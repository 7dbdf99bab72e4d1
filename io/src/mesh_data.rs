//! A mesh with its attributes as the rest of the program knows it, and a reader that can be asked for it at any time.
//!
//! Readers speak the file's own units and axes; [`crate::mesh_source::MeshSource`] converts at the door. Faces are
//! counter-clockwise seen from outside everywhere in the program; formats that store them the other way round are
//! reversed on reading and again on writing.

use std::path::PathBuf;

pub use drapery_alembic::{DataType, PodType, Scope};
use drapery_core::Vec3;
use drapery_core::mesh::PolygonMesh;

use crate::error::IoError;
use crate::normals::SplitNormals;
use crate::units::{InputUnits, StatedUnits};

/// Texture coordinates: a list of values, and for every face corner which value it has.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Uvs {
    /// Name of the UV set in the source file; empty when it has none.
    pub name: String,
    /// Texture coordinates.
    pub values: Vec<[f32; 2]>,
    /// Value of each face corner, in the order of the mesh's face indices.
    pub indices: Vec<u32>,
}

/// A named set of faces, such as a panel or the faces of one material.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FaceSet {
    /// Its name.
    pub name: String,
    /// Face numbers, ascending.
    pub faces: Vec<u32>,
    /// The material that they are bound to, in a format that has such bindings.
    pub material: Option<BoundMaterial>,
}

/// A material that a mesh or a face set is bound to.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct BoundMaterial {
    /// Its path.
    pub path: String,
    /// Path of the other material that it only stands for, if it does, in the file that the mesh was first read from.
    pub source: Option<String>,
    /// Whether it wins over what is bound further down.
    pub is_stronger: bool,
}

/// An attribute of a mesh that is handed through from the source file to the output, value by value.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct MeshParam {
    /// Its name.
    pub name: String,
    /// Kind of element that one value belongs to. Values of face corners are in Alembic's order, clockwise seen from
    /// outside.
    pub scope: Scope,
    /// Type of one value.
    pub data_type: DataType,
    /// Meaning of the numbers, in Alembic's words; empty for plain numbers.
    pub interpretation: String,
    /// Name of a UV set, when it is one and has one.
    pub source_name: Option<String>,
    /// The values as stored bytes.
    pub values: Vec<u8>,
    /// Value used at each place, when values are shared.
    pub indices: Option<Vec<u32>>,
}

/// A mesh with everything that is handed through to the output.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct MeshData {
    /// Full path of the object in its file (`/hero/geo/skirt/skirtShape`); empty when the format has no paths.
    pub object_path: String,
    /// Points and polygons.
    pub mesh: PolygonMesh,
    /// Texture coordinates, if there are any.
    pub uvs: Option<Uvs>,
    /// Normals that hard edges split; none where the mesh is smooth, or says nothing of its edges.
    pub split_normals: Option<SplitNormals>,
    /// Face sets in the order of the file.
    pub face_sets: Vec<FaceSet>,
    /// Other attributes, passed through as they are but for unit and axes.
    pub params: Vec<MeshParam>,
    /// Unit and axes of positions, vectors and normals among them; `None` where nothing says it, as of a mesh of no file.
    pub params_in: Option<InputUnits>,
    /// The material that the mesh is bound to, in a format that has such bindings.
    pub material: Option<BoundMaterial>,
    /// Purpose of the mesh, in USD's words (`render`, `proxy`, `guide`), where a cache states it.
    pub purpose: Option<String>,
    /// Whether both sides of the mesh are rendered, in a format that says so.
    pub double_sided: Option<bool>,
    /// The garment that the mesh follows to be rendered in its place, where a cache says so.
    pub render_mesh_of: Option<String>,
    /// Subdivision of the mesh where it is rendered, in USD's words (`none`, `catmullClark`, …); `None` where the
    /// format does not state it.
    pub subdivision: Option<String>,
    /// The triangles that faces with more corners were cut into, where that is known; by the solver's rule otherwise.
    pub triangles: Option<Vec<[u32; 3]>>,
}

impl MeshData {
    /// A mesh without attributes.
    pub fn new(mesh: PolygonMesh) -> Self {
        Self { mesh, ..Self::default() }
    }

    /// Converts positions, vectors and normals among what is handed through to another unit and other axes.
    pub(crate) fn convert_params(&mut self, to: InputUnits) {
        let Some(from) = self.params_in.replace(to).filter(|from| *from != to) else { return };
        for param in &mut self.params {
            match param.interpretation.as_str() {
                "point" | "vector" => param.convert(|v| to.from_si(from.to_si(v))),
                // They keep their length.
                "normal" => {
                    let [from, to] = [from, to].map(|units| InputUnits { metres: 1.0, ..units });
                    param.convert(|v| to.from_si(from.to_si(v)));
                }
                _ => {}
            }
        }
    }
}

impl MeshParam {
    /// Converts values of three numbers in single or double precision.
    fn convert(&mut self, convert: impl Fn(Vec3) -> Vec3) {
        if self.data_type.extent != 3 {
            return;
        }
        match self.data_type.pod {
            PodType::F32 => {
                for number in self.values.as_chunks_mut::<4>().0.as_chunks_mut::<3>().0 {
                    let converted = convert(Vec3::from(number.map(|bytes| f64::from(f32::from_le_bytes(bytes)))));
                    *number = [converted.x, converted.y, converted.z].map(|x| (x as f32).to_le_bytes());
                }
            }
            PodType::F64 => {
                for number in self.values.as_chunks_mut::<8>().0.as_chunks_mut::<3>().0 {
                    let converted = convert(Vec3::from(number.map(f64::from_le_bytes)));
                    *number = [converted.x, converted.y, converted.z].map(f64::to_le_bytes);
                }
            }
            _ => {}
        }
    }
}

/// Number of corners of each face, and the point of each corner.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Connectivity {
    /// Number of corners of each face.
    pub face_counts: Vec<u32>,
    /// Point of each corner, face by face.
    pub face_indices: Vec<u32>,
}

/// An opened mesh, in the units and axes of its file, transforms of all parents applied.
pub trait MeshReader: Send {
    /// Paths of the objects that were chosen, in the order in which they are merged.
    fn objects(&self) -> Vec<String>;

    /// Times at which anything of the chosen objects or their parents is stored [s], ascending; empty when nothing
    /// moves.
    fn sample_times(&self) -> &[f64];

    /// The mesh at a time [s]; between samples as [`MeshReader::positions_at`].
    ///
    /// # Errors
    /// The file cannot be read or contradicts itself.
    fn mesh_at(&self, time: f64) -> Result<MeshData, IoError>;

    /// Positions at a time [s], linear between the samples around it, held before the first and after the last.
    ///
    /// # Errors
    /// The file cannot be read or contradicts itself.
    fn positions_at(&self, time: f64, positions: &mut Vec<Vec3>) -> Result<(), IoError>;

    /// Gives the positions at a time [s] piece by piece, as [`MeshReader::positions_at`] has them.
    ///
    /// # Errors
    /// The file cannot be read or contradicts itself.
    fn points_at(&self, time: f64, take: &mut dyn FnMut(&[Vec3])) -> Result<(), IoError>;

    /// Gives the faces at a time [s] piece by piece: the number of corners of each, and the point of each corner.
    ///
    /// # Errors
    /// The file cannot be read or contradicts itself.
    fn faces_at(&self, time: f64, take: &mut dyn FnMut(&[u32], &[u32])) -> Result<(), IoError>;

    /// Reads what is handed through at a time [s], one attribute after the other, and keeps nothing.
    ///
    /// # Errors
    /// The file cannot be read or contradicts itself.
    fn check_attributes_at(&self, time: f64) -> Result<(), IoError>;

    /// Returns the connectivity of faces and points at a time [s], or `None` when the file promises that it never
    /// changes.
    ///
    /// # Errors
    /// The file cannot be read or contradicts itself.
    fn connectivity_at(&self, time: f64) -> Result<Option<Connectivity>, IoError>;

    /// Returns the units that the file states; `None` for formats that have no place for them.
    fn stated_units(&self) -> Option<StatedUnits> {
        None
    }

    /// Frames per second that the file says it was made for.
    fn frame_rate(&self) -> Option<f64> {
        None
    }

    /// Other files that were read with it.
    fn other_files(&self) -> Vec<PathBuf> {
        Vec::new()
    }

    /// Returns notes on the chosen objects that may interest the user, a sentence each.
    fn notes(&self) -> Vec<String> {
        Vec::new()
    }

    /// Lists the data of the chosen objects that [`MeshReader::mesh_at`] does not hand through, a sentence each.
    fn left_out(&self) -> Vec<String> {
        Vec::new()
    }
}

/// Two meshes as one; attributes other than UVs and face sets belong to single objects and are dropped.
pub(crate) fn merge(mut a: MeshData, b: MeshData) -> MeshData {
    let (points, faces) = (a.mesh.points.len() as u32, a.mesh.face_counts.len() as u32);
    if a.split_normals.is_some() || b.split_normals.is_some() {
        let of = |data: &MeshData| {
            let smooth = || SplitNormals::at_points(&data.mesh.face_indices, data.mesh.points.len());
            data.split_normals.clone().unwrap_or_else(smooth)
        };
        let (mut all, others) = (of(&a), of(&b));
        all.indices.extend(others.indices.iter().map(|index| index + all.count as u32));
        all.count += others.count;
        a.split_normals = Some(all);
    }
    a.mesh.points.extend(b.mesh.points);
    a.mesh.face_counts.extend(b.mesh.face_counts);
    a.mesh.face_indices.extend(b.mesh.face_indices.iter().map(|i| i + points));
    a.uvs = a.uvs.zip(b.uvs).map(|(mut u, v)| {
        let values = u.values.len() as u32;
        u.values.extend(v.values);
        u.indices.extend(v.indices.iter().map(|i| i + values));
        u
    });
    for set in b.face_sets {
        let moved = set.faces.iter().map(|face| face + faces);
        match a.face_sets.iter_mut().find(|known| known.name == set.name) {
            Some(known) => known.faces.extend(moved),
            None => a.face_sets.push(FaceSet { faces: moved.collect(), ..set }),
        }
    }
    a.params.clear();
    a.material = a.material.filter(|material| b.material.as_ref() == Some(material));
    a.subdivision = a.subdivision.filter(|scheme| b.subdivision.as_ref() == Some(scheme));
    a
}

/// Puts the corners of every face in the opposite order: clockwise from counter-clockwise and back.
pub(crate) fn reverse<T>(face_counts: &[u32], corners: &mut [T]) {
    let mut rest = corners;
    for count in face_counts {
        let (face, after) = rest.split_at_mut(*count as usize);
        face.reverse();
        rest = after;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::units::UpAxis;

    #[test]
    fn positions_vectors_and_normals_that_are_handed_through_get_the_unit_and_the_axes_of_the_cache() {
        let param = |interpretation: &str| MeshParam {
            name: "P".into(),
            scope: Scope::Vertex,
            data_type: DataType::new(PodType::F32, 3),
            interpretation: interpretation.into(),
            source_name: None,
            values: [100.0_f32, 200.0, 300.0].into_iter().flat_map(f32::to_le_bytes).collect(),
            indices: None,
        };
        let centimetres = InputUnits { metres: 0.01, up: UpAxis::Z };
        let metres = InputUnits { metres: 1.0, up: UpAxis::Y };
        let kinds = ["point", "vector", "normal", "rgb", ""];
        let mut data =
            MeshData { params: kinds.map(param).into(), params_in: Some(centimetres), ..MeshData::default() };
        let untouched = data.params.clone();
        data.convert_params(centimetres);
        assert_eq!(data.params, untouched);
        data.convert_params(metres);
        let numbers = |param: &MeshParam| -> Vec<f32> {
            param.values.as_chunks().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect()
        };
        let found: Vec<Vec<f32>> = data.params.iter().map(numbers).collect();
        let (turned, same) = (vec![100.0, 300.0, -200.0], vec![100.0, 200.0, 300.0]);
        assert_eq!(found, [vec![1.0, 3.0, -2.0], vec![1.0, 3.0, -2.0], turned, same.clone(), same]);
        // They are converted once.
        data.convert_params(metres);
        assert_eq!(data.params.iter().map(numbers).collect::<Vec<_>>(), found);
    }
}
