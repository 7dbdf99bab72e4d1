//! A mesh with the triangles that are simulated in the place of its faces, and what is handed through of these.

use drapery_alembic::{PodType, Scope};
use drapery_core::mesh::PolygonMesh;

use crate::mesh_data::{MeshData, MeshParam, Uvs};
use crate::normals::SplitNormals;

/// A triangle: its face, and which corners of that it has, counted within the face.
struct Piece {
    face: usize,
    corners: [usize; 3],
}

/// The mesh with its faces cut into these triangles, in the order of the faces. Points, and values at them, stay; values of corners and faces go to the
/// triangles that have them, face sets to the triangles of their faces, and nothing is subdivided. Faces
/// without area, of which nothing is simulated, are gone.
pub(crate) fn into_triangles(mut data: MeshData, mut triangles: Vec<[u32; 3]>) -> MeshData {
    let pieces = pieces(&data.mesh, &triangles).unwrap_or_else(|| {
        // Triangles of another order of faces than this program's.
        triangles = data.mesh.triangulate().0;
        self::pieces(&data.mesh, &triangles).unwrap_or_default()
    });
    let starts = starts(&data.mesh.face_counts);
    let at = |piece: &Piece| piece.corners.map(|corner| starts[piece.face] + corner);
    if let Some(Uvs { indices, .. }) = &mut data.uvs {
        let of = |corner: usize| indices.get(corner).copied().unwrap_or(0);
        *indices = pieces.iter().flat_map(|piece| at(piece).map(of)).collect();
    }
    if let Some(split) = &mut data.split_normals {
        let of = |corner: usize| split.indices.get(corner).copied().unwrap_or(0);
        *split = SplitNormals::counted(pieces.iter().flat_map(|piece| at(piece).map(of)).collect());
    }
    let counts = &data.mesh.face_counts;
    data.params = data.params.into_iter().filter_map(|param| of_triangles(param, &pieces, (&starts, counts))).collect();
    for set in &mut data.face_sets {
        let mut chosen = vec![false; counts.len()];
        for face in &set.faces {
            chosen.get_mut(*face as usize).into_iter().for_each(|chosen| *chosen = true);
        }
        set.faces = pieces.iter().zip(0..).filter(|(piece, _)| chosen[piece.face]).map(|(_, number)| number).collect();
    }
    data.mesh.face_counts = vec![3; triangles.len()];
    data.mesh.face_indices = triangles.concat();
    data.triangles = None;
    // Subdivided they would be another surface again.
    data.subdivision = data.subdivision.map(|_| "none".to_owned());
    data
}

/// Returns the index of the first corner of each face.
fn starts(counts: &[u32]) -> Vec<usize> {
    let begin = |sum: &mut usize, count: &u32| Some(std::mem::replace(sum, *sum + *count as usize));
    counts.iter().scan(0, begin).collect()
}

/// Finds the corners of each triangle; `None` if the triangles do not come in the order of their faces.
fn pieces(mesh: &PolygonMesh, triangles: &[[u32; 3]]) -> Option<Vec<Piece>> {
    let mut faces = mesh.faces().enumerate();
    let (mut face, mut corners) = faces.next()?;
    let mut pieces = Vec::with_capacity(triangles.len());
    for triangle in triangles {
        let found = loop {
            let places = triangle.map(|point| corners.iter().position(|corner| *corner == point));
            match places {
                [Some(a), Some(b), Some(c)] => break [a, b, c],
                _ => (face, corners) = faces.next()?,
            }
        };
        pieces.push(Piece { face, corners: found });
    }
    Some(pieces)
}

/// An attribute with its values at triangles; `None` for one that does not fit its mesh.
fn of_triangles(mut param: MeshParam, pieces: &[Piece], (starts, counts): (&[usize], &[u32])) -> Option<MeshParam> {
    // What is at each place of the new mesh, by the places of the old one.
    let (places, sources): (usize, Vec<usize>) = match param.scope {
        Scope::Constant | Scope::Varying | Scope::Vertex => return Some(param),
        Scope::Uniform => (starts.len(), pieces.iter().map(|piece| piece.face).collect()),
        Scope::FaceVarying => {
            // Both clockwise, as Alembic has them.
            let clockwise = |piece: &Piece| {
                let (start, count) = (starts[piece.face], counts[piece.face] as usize);
                let [a, b, c] = piece.corners.map(|corner| start + count - 1 - corner);
                [c, b, a]
            };
            (counts.iter().map(|count| *count as usize).sum(), pieces.iter().flat_map(clockwise).collect())
        }
    };
    let held = param.indices.as_ref().map_or_else(|| value_count(&param), Vec::len);
    let of = |indices: &Vec<u32>| sources.iter().map(|source| indices[*source]).collect();
    let indices = (held == places).then(|| match &param.indices {
        Some(indices) => of(indices),
        // Values are shared, so that texts need no copies either.
        None => sources.iter().map(|source| *source as u32).collect(),
    })?;
    param.indices = Some(indices);
    Some(param)
}

/// Number of values of an attribute without indices.
fn value_count(param: &MeshParam) -> usize {
    let ends = |width: usize| param.values.chunks_exact(width).filter(|letter| letter.iter().all(|b| *b == 0)).count();
    let bytes = match param.data_type.pod {
        PodType::String => return ends(1),
        PodType::WideString => return ends(4),
        PodType::Bool | PodType::U8 | PodType::I8 => 1,
        PodType::U16 | PodType::I16 | PodType::F16 => 2,
        PodType::U32 | PodType::I32 | PodType::F32 => 4,
        PodType::U64 | PodType::I64 | PodType::F64 => 8,
    };
    param.values.len() / (bytes * usize::from(param.data_type.extent.max(1)))
}

#[cfg(test)]
mod tests {
    use drapery_core::Vec3;

    use super::*;
    use crate::mesh_data::{DataType, FaceSet};

    /// A quad, a triangle beside it, and a quad above both.
    fn mesh() -> PolygonMesh {
        let at = [[0.0, 0.0], [1.0, 0.0], [1.1, 1.1], [0.0, 1.0], [2.0, 0.5], [1.0, 2.0], [0.0, 2.0]];
        PolygonMesh {
            points: at.map(|[x, y]| Vec3::new(x, y, 0.0)).into(),
            face_counts: vec![4, 3, 4],
            face_indices: vec![0, 1, 2, 3, 1, 4, 2, 3, 2, 5, 6],
        }
    }

    fn param(scope: Scope, data_type: DataType, values: Vec<u8>, indices: Option<Vec<u32>>) -> MeshParam {
        let (name, interpretation, source_name) = ("p".into(), String::new(), None);
        MeshParam { name, scope, data_type, interpretation, source_name, values, indices }
    }

    #[test]
    fn corners_faces_and_sets_go_to_the_triangles_that_have_them() {
        let data = MeshData {
            uvs: Some(Uvs { values: vec![[0.0; 2]; 20], indices: (0..11).collect(), ..Uvs::default() }),
            split_normals: Some(SplitNormals { indices: (0..11).collect(), count: 11 }),
            face_sets: vec![FaceSet { name: "front".into(), faces: vec![1, 2], material: None }],
            params: vec![
                // Clockwise within each face, each value the point of its corner.
                param(Scope::FaceVarying, DataType::new(PodType::U8, 1), vec![3, 2, 1, 0, 2, 4, 1, 6, 5, 2, 3], None),
                param(Scope::Uniform, DataType::new(PodType::String, 1), b"a\0\0c\0".to_vec(), None),
                param(Scope::Uniform, DataType::new(PodType::F32, 2), vec![0; 16], Some(vec![1, 0, 1])),
                param(Scope::Vertex, DataType::new(PodType::F64, 1), vec![0; 56], None),
                param(Scope::Uniform, DataType::new(PodType::F64, 1), vec![0; 56], None),
            ],
            ..MeshData::new(mesh())
        };
        let cut = into_triangles(data, mesh().triangulate().0);
        // Along the shorter diagonals: from 1 to 3, and from 3 to 5 in the upper quad.
        assert_eq!(cut.mesh.face_counts, [3; 5]);
        let mut corners: Vec<Vec<u32>> = cut.mesh.faces().map(<[u32]>::to_vec).collect();
        for (corners, uvs) in corners.iter().zip(cut.uvs.unwrap().indices.chunks(3)) {
            let points: Vec<u32> = uvs.iter().map(|uv| mesh().face_indices[*uv as usize]).collect();
            assert_eq!(*corners, points);
        }
        let split = cut.split_normals.unwrap();
        let is_of_one_point = SplitNormals::numbered(split.indices.clone(), 11, &cut.mesh.face_indices);
        assert_eq!((is_of_one_point.as_ref(), split.count), (Some(&split), 11));
        assert_eq!(cut.face_sets[0].faces, [2, 3, 4]);
        let at_corners = &cut.params[0];
        for (corners, indices) in corners.iter().zip(at_corners.indices.as_ref().unwrap().chunks(3)) {
            let values: Vec<u32> = indices.iter().rev().map(|i| u32::from(at_corners.values[*i as usize])).collect();
            assert_eq!(*corners, values);
        }
        assert_eq!(cut.params[1].indices.as_deref(), Some(&[0, 0, 1, 2, 2][..]));
        assert_eq!(cut.params[2].indices.as_deref(), Some(&[1, 1, 0, 1, 1][..]));
        assert_eq!((cut.params[3].indices.as_ref(), cut.params.len()), (None, 4), "the last one fits no mesh");
        corners.iter_mut().for_each(|corners| corners.sort_unstable());
        assert_eq!(corners, [vec![1, 2, 3], vec![0, 1, 3], vec![1, 2, 4], vec![2, 3, 5], vec![3, 5, 6]]);
    }
}
