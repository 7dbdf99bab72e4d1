//! Primvars: attributes of a mesh that are handed through, and its texture coordinates.

use openusd::sdf::{Role, Value};
use openusd::usd::{Attribute, Prim};

use super::error::UsdError;
use super::reading::Reading;
use super::values::{integers, length, number, word};
use super::{Element, Faces, Meaning, Primvar};
use crate::Interpolation;

/// Prefix of the primvars that say how a skeleton moves the mesh.
const OF_SKELETONS: &str = "skel:";

/// All primvars of a mesh that hold numbers or texts, corners in the order of the file.
pub(crate) fn read(reading: &Reading, prim: &Prim, code: f64) -> Result<Vec<Primvar>, UsdError> {
    let mut primvars = Vec::new();
    for attribute in reading.ok(prim.authored_attributes_in_namespace("primvars"), prim)? {
        if !is_primvar(attribute.name()) {
            continue;
        }
        let name = attribute.name().trim_start_matches("primvars:").to_owned();
        let Some(value) = reading.value_at(&attribute.query(), code)? else { continue };
        let Some((element, extent, values)) = bytes(&value) else { continue };
        let size = metadata(reading, &attribute, "elementSize")?.as_ref().and_then(number).unwrap_or(1.0);
        let Ok(extent) = u8::try_from(extent as u64 * (size as u64).max(1)) else { continue };
        let interpolation = metadata(reading, &attribute, "interpolation")?.as_ref().and_then(word);
        let interpolation = Interpolation::named(interpolation.as_deref().unwrap_or("constant"));
        let listed = reading.value_at(&prim.attribute(format!("primvars:{name}:indices")).query(), code)?;
        let indices = match listed.as_ref().and_then(integers) {
            Some(listed) => Some(checked(reading, &attribute, listed, pieces(element, extent, &values).len())?),
            None => None,
        };
        let meaning = match value {
            Value::Token(_) | Value::TokenVec(_) => Meaning::Token,
            _ => meaning(reading, &attribute)?,
        };
        primvars.push(Primvar { name, interpolation, element, extent, meaning, values, indices });
    }
    Ok(primvars)
}

/// Whether an attribute of this name is a primvar of its own, and none of those that skeletons need.
pub(crate) fn is_primvar(name: &str) -> bool {
    let name = name.trim_start_matches("primvars:");
    !name.starts_with(OF_SKELETONS) && !name.ends_with(":indices")
}

/// Says how many values a primvar has, and how many it should have, where that differs; faces and points are those of the file.
pub(crate) fn unfitting(primvar: &Primvar, faces: &Faces, points: usize) -> Option<String> {
    let (wanted, places) = match primvar.interpolation {
        Interpolation::Constant => return None,
        Interpolation::Uniform => (faces.counts.len(), "faces"),
        Interpolation::Vertex | Interpolation::Varying => (points, "points"),
        Interpolation::FaceVarying => (faces.indices.len(), "face corners"),
    };
    let held = primvar.indices.as_ref().map_or_else(|| primvar.pieces().len(), Vec::len);
    (held != wanted).then(|| format!("primvars:{} ({held} values for {wanted} {places})", primvar.name))
}

impl Primvar {
    /// The bytes of each value.
    pub fn pieces(&self) -> Vec<&[u8]> {
        pieces(self.element, self.extent, &self.values)
    }
}

/// The bytes of each value.
fn pieces(element: Element, extent: u8, values: &[u8]) -> Vec<&[u8]> {
    let wide = element.size() * usize::from(extent);
    if element != Element::Text {
        return values.chunks_exact(wide).collect();
    }
    let ends = values.iter().enumerate().filter(|(_, byte)| **byte == 0).map(|(at, _)| at + 1);
    let mut start = 0;
    let each_last = ends.skip(usize::from(extent) - 1).step_by(usize::from(extent));
    each_last.map(|end| &values[std::mem::replace(&mut start, end)..end]).collect()
}

/// Texts as bytes, each with a zero behind it; zeros within a text would end it, and are left out.
fn texts<'a>(all: impl Iterator<Item = &'a str>) -> Vec<u8> {
    all.flat_map(|text| text.bytes().filter(|byte| *byte != 0).chain([0])).collect()
}

/// Indices into values, each of which exists.
fn checked(reading: &Reading, attribute: &Attribute, listed: &[i32], count: usize) -> Result<Vec<u32>, UsdError> {
    let outside = |index: &&i32| usize::try_from(**index).map_or(true, |index| index >= count);
    if let Some(index) = listed.iter().find(outside) {
        let what = format!("it refers to value {index}, and has {count} values");
        return Err(reading.bad(attribute.path().as_str(), what, "export the mesh again"));
    }
    Ok(listed.iter().map(|index| index.unsigned_abs()).collect())
}

/// A field of an attribute.
pub(crate) fn metadata(reading: &Reading, attribute: &Attribute, key: &str) -> Result<Option<Value>, UsdError> {
    reading.ok(attribute.get_metadata::<Value>(key), &attribute.prim())
}

fn meaning(reading: &Reading, attribute: &Attribute) -> Result<Meaning, UsdError> {
    Ok(match reading.ok(attribute.role(), &attribute.prim())? {
        Some(Role::Color) => Meaning::Colour,
        Some(Role::Point) => Meaning::Point,
        Some(Role::Normal) => Meaning::Normal,
        Some(Role::Vector) => Meaning::Vector,
        Some(Role::TextureCoordinate) => Meaning::TextureCoordinate,
        _ => Meaning::Numbers,
    })
}

/// Returns the count of numbers or texts that make a value; `None` for other types.
pub(crate) fn numbers_of(value: &Value) -> Option<usize> {
    bytes(value).map(|(_, extent, _)| extent)
}

/// Numbers or texts as bytes: the type of one, how many make a value. `None` for what is neither.
fn bytes(value: &Value) -> Option<(Element, usize, Vec<u8>)> {
    fn all<T: Copy, const N: usize, const B: usize>(
        values: &[T],
        parts: impl Fn(T) -> [[u8; B]; N],
        element: Element,
    ) -> Option<(Element, usize, Vec<u8>)> {
        Some((element, N, values.iter().flat_map(|value| parts(*value)).flatten().collect()))
    }
    use Element::{Bool, F16, F32, F64, I32, I64, Text, U8, U32, U64};
    match value {
        Value::Bool(v) => all(&[*v], |v| [[u8::from(v)]], Bool),
        Value::BoolVec(v) => all(v, |v| [[u8::from(v)]], Bool),
        Value::Uchar(v) => all(&[*v], |v| [[v]], U8),
        Value::UcharVec(v) => all(v, |v| [[v]], U8),
        Value::Int(v) => all(&[*v], |v| [v.to_le_bytes()], I32),
        Value::IntVec(v) => all(v, |v| [v.to_le_bytes()], I32),
        Value::Uint(v) => all(&[*v], |v| [v.to_le_bytes()], U32),
        Value::UintVec(v) => all(v, |v| [v.to_le_bytes()], U32),
        Value::Int64(v) => all(&[*v], |v| [v.to_le_bytes()], I64),
        Value::Int64Vec(v) => all(v, |v| [v.to_le_bytes()], I64),
        Value::Uint64(v) => all(&[*v], |v| [v.to_le_bytes()], U64),
        Value::Uint64Vec(v) => all(v, |v| [v.to_le_bytes()], U64),
        Value::Half(v) => all(&[*v], |v| [v.to_le_bytes()], F16),
        Value::HalfVec(v) => all(v, |v| [v.to_le_bytes()], F16),
        Value::Float(v) => all(&[*v], |v| [v.to_le_bytes()], F32),
        Value::FloatVec(v) => all(v, |v| [v.to_le_bytes()], F32),
        Value::Double(v) => all(&[*v], |v| [v.to_le_bytes()], F64),
        Value::DoubleVec(v) => all(v, |v| [v.to_le_bytes()], F64),
        Value::Vec2f(v) => all(&[*v], |v| [v.x, v.y].map(f32::to_le_bytes), F32),
        Value::Vec4f(v) => all(&[*v], |v| [v.x, v.y, v.z, v.w].map(f32::to_le_bytes), F32),
        Value::Vec3d(v) => all(&[*v], |v| [v.x, v.y, v.z].map(f64::to_le_bytes), F64),
        Value::Vec4iVec(v) => all(v, |v| [v.x, v.y, v.z, v.w].map(i32::to_le_bytes), I32),
        Value::Vec4hVec(v) => all(v, |v| [v.x, v.y, v.z, v.w].map(|x| x.to_le_bytes()), F16),
        Value::Matrix4d(v) => all(&[*v], |v| v.0.map(f64::to_le_bytes), F64),
        Value::Matrix4dVec(v) => all(v, |v| v.0.map(f64::to_le_bytes), F64),
        Value::Vec2fVec(v) => all(v, |v| [v.x, v.y].map(f32::to_le_bytes), F32),
        Value::Vec2dVec(v) => all(v, |v| [v.x, v.y].map(f64::to_le_bytes), F64),
        Value::Vec2hVec(v) => all(v, |v| [v.x, v.y].map(|x| x.to_le_bytes()), F16),
        Value::Vec2iVec(v) => all(v, |v| [v.x, v.y].map(i32::to_le_bytes), I32),
        Value::Vec3f(v) => all(&[*v], |v| [v.x, v.y, v.z].map(f32::to_le_bytes), F32),
        Value::Vec3fVec(v) => all(v, |v| [v.x, v.y, v.z].map(f32::to_le_bytes), F32),
        Value::Vec3dVec(v) => all(v, |v| [v.x, v.y, v.z].map(f64::to_le_bytes), F64),
        Value::Vec3hVec(v) => all(v, |v| [v.x, v.y, v.z].map(|x| x.to_le_bytes()), F16),
        Value::Vec3iVec(v) => all(v, |v| [v.x, v.y, v.z].map(i32::to_le_bytes), I32),
        Value::Vec4fVec(v) => all(v, |v| [v.x, v.y, v.z, v.w].map(f32::to_le_bytes), F32),
        Value::Vec4dVec(v) => all(v, |v| [v.x, v.y, v.z, v.w].map(f64::to_le_bytes), F64),
        Value::String(text) => Some((Text, 1, texts([text.as_str()].into_iter()))),
        Value::StringVec(v) => Some((Text, 1, texts(v.iter().map(String::as_str)))),
        Value::Token(word) => Some((Text, 1, texts([word.as_str()].into_iter()))),
        Value::TokenVec(v) => Some((Text, 1, texts(v.iter().map(|word| word.as_str())))),
        _ => None,
    }
    .filter(|_| length(value) != Some(0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_of_texts_are_cut_behind_each_zero() {
        let bytes = texts(["front", "", "a\0b"].into_iter());
        assert_eq!(bytes, b"front\0\0ab\0");
        assert_eq!(pieces(Element::Text, 1, &bytes), [b"front\0".as_slice(), b"\0", b"ab\0"]);
        assert_eq!(pieces(Element::Text, 2, b"a\0b\0c\0d\0"), [b"a\0b\0".as_slice(), b"c\0d\0"]);
        assert_eq!(pieces(Element::U8, 2, b"abcd"), [b"ab", b"cd"]);
    }
}
