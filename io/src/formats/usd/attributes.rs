//! Attributes of a mesh as USD writes them.

use drapery_usd::Interpolation;
use drapery_usd::write::{FaceSubset, Primvar, Subdivision, Values};

use super::read::TOKEN;
use crate::mesh_data::{BoundMaterial, FaceSet, MeshParam, PodType, Scope, reverse};

/// Returns the subdivision that renderers apply to the faces; none where nobody states it.
pub(super) fn subdivision(word: Option<&str>) -> Subdivision {
    match word {
        Some("catmullClark") => Subdivision::CatmullClark,
        Some("loop") => Subdivision::Loop,
        Some("bilinear") => Subdivision::Bilinear,
        _ => Subdivision::None,
    }
}

/// A face set; faces that the mesh does not have are left out.
pub(super) fn subset(set: FaceSet, faces: usize) -> FaceSubset {
    let mut there: Vec<i32> =
        set.faces.iter().filter(|face| (**face as usize) < faces).map(|face| *face as i32).collect();
    there.sort_unstable();
    there.dedup();
    FaceSubset { name: set.name, faces: there, material: set.material.map(bound) }
}

/// A binding as USD writes it.
pub(super) fn bound(material: BoundMaterial) -> drapery_usd::BoundMaterial {
    let BoundMaterial { path, source, is_stronger } = material;
    drapery_usd::BoundMaterial { path, source, is_stronger }
}

/// An attribute that is handed through; values of face corners are turned counter-clockwise.
pub(super) fn primvar(param: MeshParam, face_counts: &[u32]) -> Primvar {
    let extent = usize::from(param.data_type.extent.max(1));
    let mut values = values(&param);
    let mut indices = param.indices;
    if param.scope == Scope::FaceVarying {
        let corners = face_counts.iter().map(|count| *count as usize).sum::<usize>();
        match &mut indices {
            Some(indices) if indices.len() == corners => reverse(face_counts, indices),
            None => turn(&mut values, extent, face_counts),
            // A number of indices that fits no mesh stays what it is.
            Some(_) => {}
        }
    }
    Primvar {
        name: param.name,
        interpolation: interpolation(param.scope),
        values,
        extent,
        role: role(&param.interpretation, extent),
        indices: indices.map(|all| all.into_iter().map(|index| index as i32).collect()),
    }
}

fn interpolation(scope: Scope) -> Interpolation {
    match scope {
        Scope::Constant => Interpolation::Constant,
        Scope::Uniform => Interpolation::Uniform,
        Scope::Varying => Interpolation::Varying,
        Scope::Vertex => Interpolation::Vertex,
        Scope::FaceVarying => Interpolation::FaceVarying,
    }
}

/// Returns the role of numbers, from Alembic's words.
fn role(interpretation: &str, extent: usize) -> &'static str {
    match (interpretation, extent) {
        ("point", 3) => "point",
        ("vector", 3) => "vector",
        ("normal", 3) => "normal",
        ("rgb", 3) | ("rgba", 4) => "color",
        (TOKEN, _) => "token",
        // Alembic has it for UVs alone.
        ("vector", 2) => "texCoord",
        _ => "",
    }
}

/// Numbers of stored bytes.
fn numbers<const N: usize, T>(bytes: &[u8], number: fn([u8; N]) -> T) -> Vec<T> {
    bytes.as_chunks::<N>().0.iter().map(|bytes| number(*bytes)).collect()
}

fn values(param: &MeshParam) -> Values {
    let bytes = param.values.as_slice();
    match param.data_type.pod {
        PodType::Bool => Values::Bool(bytes.iter().map(|byte| *byte != 0).collect()),
        PodType::U8 => Values::UChar(bytes.to_vec()),
        PodType::I8 => Values::Int(bytes.iter().map(|byte| i32::from(*byte as i8)).collect()),
        PodType::U16 => Values::Int(numbers(bytes, |b| i32::from(u16::from_le_bytes(b)))),
        PodType::I16 => Values::Int(numbers(bytes, |b| i32::from(i16::from_le_bytes(b)))),
        PodType::U32 => Values::UInt(numbers(bytes, u32::from_le_bytes)),
        PodType::I32 => Values::Int(numbers(bytes, i32::from_le_bytes)),
        PodType::U64 => Values::UInt64(numbers(bytes, u64::from_le_bytes)),
        PodType::I64 => Values::Int64(numbers(bytes, i64::from_le_bytes)),
        PodType::F16 => Values::Half(numbers(bytes, u16::from_le_bytes)),
        PodType::F32 => Values::Float(numbers(bytes, f32::from_le_bytes)),
        PodType::F64 => Values::Double(numbers(bytes, f64::from_le_bytes)),
        PodType::String => Values::Text(texts(bytes)),
        PodType::WideString => {
            let letters =
                numbers(bytes, |b| char::from_u32(u32::from_le_bytes(b)).unwrap_or(char::REPLACEMENT_CHARACTER));
            Values::Text(texts(letters.into_iter().collect::<String>().as_bytes()))
        }
    }
}

/// Texts that each end with a zero.
fn texts(bytes: &[u8]) -> Vec<String> {
    let whole = bytes.strip_suffix(&[0]).unwrap_or(bytes);
    if bytes.is_empty() {
        return Vec::new();
    }
    whole.split(|byte| *byte == 0).map(|text| String::from_utf8_lossy(text).into_owned()).collect()
}

/// Puts the values of every face in the opposite order, if there is one for each corner.
fn turn(values: &mut Values, extent: usize, face_counts: &[u32]) {
    match values {
        Values::Bool(all) => turn_all(all, extent, face_counts),
        Values::UChar(all) => turn_all(all, extent, face_counts),
        Values::Int(all) => turn_all(all, extent, face_counts),
        Values::UInt(all) => turn_all(all, extent, face_counts),
        Values::Int64(all) => turn_all(all, extent, face_counts),
        Values::UInt64(all) => turn_all(all, extent, face_counts),
        Values::Half(all) => turn_all(all, extent, face_counts),
        Values::Float(all) => turn_all(all, extent, face_counts),
        Values::Double(all) => turn_all(all, extent, face_counts),
        Values::Text(all) => turn_all(all, extent, face_counts),
    }
}

fn turn_all<T>(values: &mut [T], extent: usize, face_counts: &[u32]) {
    let corners = face_counts.iter().map(|count| *count as usize).sum::<usize>();
    if values.len() != corners * extent {
        return;
    }
    let mut rest = values;
    for count in face_counts {
        let (face, after) = rest.split_at_mut(*count as usize * extent);
        // The whole face backwards, then each value forwards again.
        face.reverse();
        face.chunks_exact_mut(extent).for_each(<[T]>::reverse);
        rest = after;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh_data::DataType;

    fn param(scope: Scope, pod: PodType, extent: u8, values: Vec<u8>) -> MeshParam {
        MeshParam {
            name: "N".into(),
            scope,
            data_type: DataType::new(pod, extent),
            interpretation: "vector".into(),
            source_name: None,
            values,
            indices: None,
        }
    }

    #[test]
    fn values_of_corners_are_turned_with_their_faces() {
        let bytes: Vec<u8> = (0..14_u16).flat_map(|number| f32::from(number).to_le_bytes()).collect();
        let turned = primvar(param(Scope::FaceVarying, PodType::F32, 2, bytes), &[3, 4]);
        let expected = [4, 5, 2, 3, 0, 1, 12, 13, 10, 11, 8, 9, 6, 7_u16].map(f32::from);
        assert_eq!(turned.values, Values::Float(expected.to_vec()));
        let indexed = MeshParam {
            indices: Some(vec![0, 1, 2, 3, 3, 2, 1]),
            ..param(Scope::FaceVarying, PodType::F32, 2, vec![0; 32])
        };
        assert_eq!(primvar(indexed, &[3, 4]).indices, Some(vec![2, 1, 0, 1, 2, 3, 3]));
    }

    #[test]
    fn texts_keep_their_number_and_empty_ones_too() {
        let of = |bytes: &[u8]| primvar(param(Scope::Uniform, PodType::String, 1, bytes.to_vec()), &[3]).values;
        assert_eq!(of(b"front\0\0back\0"), Values::Text(vec!["front".into(), String::new(), "back".into()]));
        assert_eq!(of(b""), Values::Text(Vec::new()));
        let wide: Vec<u8> = "ab\0".chars().flat_map(|c| (c as u32).to_le_bytes()).collect();
        let values = primvar(param(Scope::Constant, PodType::WideString, 1, wide), &[3]).values;
        assert_eq!(values, Values::Text(vec!["ab".into()]));
    }

    #[test]
    fn face_sets_name_only_faces_that_are_there() {
        let material = BoundMaterial { path: "/m".into(), is_stronger: true, ..BoundMaterial::default() };
        let set = FaceSet { name: "hem".into(), faces: vec![2, 0, 9, 2], material: Some(material.clone()) };
        let material = Some(bound(material));
        assert_eq!(subset(set, 3), FaceSubset { name: "hem".into(), faces: vec![0, 2], material });
    }
}
