//! Attributes of a mesh that are handed through, as primvars.

use openusd::gf;
use openusd::sdf::Value;
use openusd::tf::Token;

use super::binary::{BinaryLayer, Declared, Prim, WriteError};
use crate::Interpolation;

/// The numbers of a primvar, value after value.
#[derive(Debug, Clone, PartialEq)]
pub enum Values {
    /// Truth values.
    Bool(Vec<bool>),
    /// Bytes.
    UChar(Vec<u8>),
    /// 32 bits.
    Int(Vec<i32>),
    /// 32 bits without sign.
    UInt(Vec<u32>),
    /// 64 bits.
    Int64(Vec<i64>),
    /// 64 bits without sign.
    UInt64(Vec<u64>),
    /// The bits of numbers in half precision.
    Half(Vec<u16>),
    /// Single precision.
    Float(Vec<f32>),
    /// Double precision.
    Double(Vec<f64>),
    /// Texts.
    Text(Vec<String>),
}

/// An attribute of the mesh.
#[derive(Debug, Clone, PartialEq)]
pub struct Primvar {
    /// Its name; what USD does not accept in names is replaced.
    pub name: String,
    /// Part of the mesh that one value belongs to.
    pub interpolation: Interpolation,
    /// The numbers.
    pub values: Values,
    /// Count of them in one value.
    pub extent: usize,
    /// Meaning of three or four of them: `point`, `vector`, `normal`, `color`, `texCoord` or nothing; `token` for
    /// texts that are words.
    pub role: &'static str,
    /// The value of each place, where values are shared.
    pub indices: Option<Vec<i32>>,
}

/// Adds a primvar under this identifier.
pub(super) fn add(layer: &mut BinaryLayer, mesh: &Prim, identifier: &str, primvar: Primvar) -> Result<(), WriteError> {
    let Primvar { interpolation, values, extent, role, indices, .. } = primvar;
    let (kind, value) = typed(values, extent, role);
    let declared = Declared {
        interpolation: Some(interpolation.word()),
        // Texts and numbers that no type of USD groups.
        element_size: (extent > 1 && groups(&value) == 1).then(|| i32::try_from(extent).unwrap_or(i32::MAX)),
        ..Declared::default()
    };
    let name = format!("primvars:{identifier}");
    layer.attribute(mesh, (&name, &kind), declared, Some(value))?;
    if let Some(indices) = indices {
        let name = format!("{name}:indices");
        layer.attribute(mesh, (&name, "int[]"), Declared::default(), Some(Value::IntVec(indices)))?;
    }
    Ok(())
}

/// Returns the count of numbers in one element of an array.
fn groups(value: &Value) -> usize {
    match value {
        Value::Vec2fVec(_) | Value::Vec2dVec(_) | Value::Vec2hVec(_) | Value::Vec2iVec(_) => 2,
        Value::Vec3fVec(_) | Value::Vec3dVec(_) | Value::Vec3hVec(_) | Value::Vec3iVec(_) => 3,
        Value::Vec4fVec(_) | Value::Vec4dVec(_) | Value::Vec4hVec(_) | Value::Vec4iVec(_) => 4,
        Value::Matrix4dVec(_) => 16,
        _ => 1,
    }
}

/// The type's name and the array.
fn typed(values: Values, extent: usize, role: &str) -> (String, Value) {
    let vectors = |base: &str, letter: &str| match (extent, role) {
        (2, "texCoord") => format!("texCoord2{letter}[]"),
        (3, "point" | "vector" | "normal" | "color" | "texCoord") => format!("{role}3{letter}[]"),
        (4, "color") => format!("color4{letter}[]"),
        (2..=4, _) => format!("{base}{extent}[]"),
        _ => format!("{base}[]"),
    };
    match values {
        Values::Float(all) => (vectors("float", "f"), grouped_floats(all, extent)),
        Values::Double(all) if extent == 16 && all.len() % 16 == 0 => {
            let matrices = all.chunks_exact(16).map(|m| gf::Matrix4d(std::array::from_fn(|i| m[i])));
            ("matrix4d[]".to_owned(), Value::Matrix4dVec(matrices.collect()))
        }
        Values::Double(all) => (vectors("double", "d"), grouped_doubles(all, extent)),
        Values::Half(bits) => {
            let all = bits.into_iter().map(gf::f16::from_bits).collect();
            (vectors("half", "h"), grouped_halves(all, extent))
        }
        Values::Int(all) => {
            let kind = if (2..=4).contains(&extent) { format!("int{extent}[]") } else { "int[]".to_owned() };
            (kind, grouped_ints(all, extent))
        }
        Values::Bool(all) => ("bool[]".to_owned(), Value::BoolVec(all)),
        Values::UChar(all) => ("uchar[]".to_owned(), Value::UcharVec(all)),
        Values::UInt(all) => ("uint[]".to_owned(), Value::UintVec(all)),
        Values::Int64(all) => ("int64[]".to_owned(), Value::Int64Vec(all)),
        Values::UInt64(all) => ("uint64[]".to_owned(), Value::Uint64Vec(all)),
        Values::Text(all) if role == "token" => {
            let words = all.iter().map(|text| Token::from(text.as_str()));
            ("token[]".to_owned(), Value::TokenVec(words.collect()))
        }
        Values::Text(all) => ("string[]".to_owned(), Value::StringVec(all)),
    }
}

/// Numbers in groups of two, three or four where that is their extent.
macro_rules! grouped {
    ($name:ident, $number:ty, $one:ident, $two:ident, $three:ident, $four:ident) => {
        fn $name(all: Vec<$number>, extent: usize) -> Value {
            match extent {
                2 => Value::$two(all.as_chunks::<2>().0.iter().map(|v| (*v).into()).collect()),
                3 => Value::$three(all.as_chunks::<3>().0.iter().map(|v| (*v).into()).collect()),
                4 => Value::$four(all.as_chunks::<4>().0.iter().map(|v| (*v).into()).collect()),
                _ => Value::$one(all),
            }
        }
    };
}

grouped!(grouped_floats, f32, FloatVec, Vec2fVec, Vec3fVec, Vec4fVec);
grouped!(grouped_doubles, f64, DoubleVec, Vec2dVec, Vec3dVec, Vec4dVec);
grouped!(grouped_halves, gf::f16, HalfVec, Vec2hVec, Vec3hVec, Vec4hVec);
grouped!(grouped_ints, i32, IntVec, Vec2iVec, Vec3iVec, Vec4iVec);

/// Texts as tokens of an attribute's value.
pub(super) fn tokens(names: &[&str]) -> Value {
    Value::TokenVec(names.iter().map(|name| Token::from(*name)).collect())
}
