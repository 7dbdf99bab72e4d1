//! Values of attributes as plain numbers, whatever precision they are stored in.

use openusd::sdf::Value;

use super::matrix::{Matrix, Quaternion};

/// A number.
pub(crate) fn number(value: &Value) -> Option<f64> {
    Some(match value {
        Value::Half(x) => x.to_f64(),
        Value::Float(x) => f64::from(*x),
        Value::Double(x) => *x,
        Value::Int(x) => f64::from(*x),
        _ => return None,
    })
}

/// Three numbers.
pub(crate) fn vector(value: &Value) -> Option<[f64; 3]> {
    Some(match value {
        Value::Vec3h(v) => [v.x.to_f64(), v.y.to_f64(), v.z.to_f64()],
        Value::Vec3f(v) => [v.x, v.y, v.z].map(f64::from),
        Value::Vec3d(v) => [v.x, v.y, v.z],
        _ => return None,
    })
}

/// A list of three numbers each.
pub(crate) fn vectors(value: &Value) -> Option<Vec<[f64; 3]>> {
    Some(match value {
        Value::Vec3hVec(all) => all.iter().map(|v| [v.x.to_f64(), v.y.to_f64(), v.z.to_f64()]).collect(),
        Value::Vec3fVec(all) => all.iter().map(|v| [v.x, v.y, v.z].map(f64::from)).collect(),
        Value::Vec3dVec(all) => all.iter().map(|v| [v.x, v.y, v.z]).collect(),
        _ => return None,
    })
}

/// A rotation.
pub(crate) fn quaternion(value: &Value) -> Option<Quaternion> {
    Some(match value {
        Value::Quath(q) => [q.w.to_f64(), q.x.to_f64(), q.y.to_f64(), q.z.to_f64()],
        Value::Quatf(q) => [q.w, q.x, q.y, q.z].map(f64::from),
        Value::Quatd(q) => [q.w, q.x, q.y, q.z],
        _ => return None,
    })
}

/// A list of rotations.
pub(crate) fn quaternions(value: &Value) -> Option<Vec<Quaternion>> {
    Some(match value {
        Value::QuathVec(all) => all.iter().map(|q| [q.w, q.x, q.y, q.z].map(|x| x.to_f64())).collect(),
        Value::QuatfVec(all) => all.iter().map(|q| [q.w, q.x, q.y, q.z].map(f64::from)).collect(),
        Value::QuatdVec(all) => all.iter().map(|q| [q.w, q.x, q.y, q.z]).collect(),
        _ => return None,
    })
}

/// A matrix.
pub(crate) fn matrix(value: &Value) -> Option<Matrix> {
    match value {
        Value::Matrix4d(m) => Some(m.0),
        _ => None,
    }
}

/// A list of matrices.
pub(crate) fn matrices(value: &Value) -> Option<Vec<Matrix>> {
    match value {
        Value::Matrix4dVec(all) => Some(all.iter().map(|m| m.0).collect()),
        _ => None,
    }
}

/// A list of numbers.
pub(crate) fn numbers(value: &Value) -> Option<Vec<f64>> {
    Some(match value {
        Value::HalfVec(all) => all.iter().map(|x| x.to_f64()).collect(),
        Value::FloatVec(all) => all.iter().map(|x| f64::from(*x)).collect(),
        Value::DoubleVec(all) => all.clone(),
        _ => return None,
    })
}

/// A list of numbers in single precision, those of vectors one after the other.
pub(crate) fn floats(value: Value) -> Option<Vec<f32>> {
    match value {
        Value::FloatVec(all) => Some(all),
        Value::Vec3fVec(all) => Some(all.iter().flat_map(|v| [v.x, v.y, v.z]).collect()),
        _ => None,
    }
}

/// A list of whole numbers.
pub(crate) fn integers(value: &Value) -> Option<&[i32]> {
    match value {
        Value::IntVec(all) => Some(all),
        _ => None,
    }
}

/// Whole numbers of any kind, those of vectors one after the other.
pub(crate) fn all_integers(value: &Value) -> Option<Vec<i64>> {
    Some(match value {
        Value::Int(x) => vec![i64::from(*x)],
        Value::Uint(x) => vec![i64::from(*x)],
        Value::Int64(x) => vec![*x],
        Value::IntVec(all) => all.iter().map(|x| i64::from(*x)).collect(),
        Value::UintVec(all) => all.iter().map(|x| i64::from(*x)).collect(),
        Value::Int64Vec(all) => all.clone(),
        Value::Vec3iVec(all) => all.iter().flat_map(|v| [v.x, v.y, v.z]).map(i64::from).collect(),
        _ => return None,
    })
}

/// A word.
pub(crate) fn word(value: &Value) -> Option<String> {
    match value {
        Value::Token(token) => Some(token.as_str().to_owned()),
        Value::String(text) => Some(text.clone()),
        _ => None,
    }
}

/// A list of words.
pub(crate) fn words(value: &Value) -> Option<Vec<String>> {
    match value {
        Value::TokenVec(all) => Some(all.iter().map(|token| token.as_str().to_owned()).collect()),
        Value::StringVec(all) => Some(all.clone()),
        _ => None,
    }
}

/// Puts the corners of every face in the opposite order.
pub(crate) fn reverse<T>(face_counts: &[u32], corners: &mut [T]) {
    let mut rest = corners;
    for count in face_counts {
        let (face, after) = rest.split_at_mut(*count as usize);
        face.reverse();
        rest = after;
    }
}

/// A value that is a list, by its length.
pub(crate) fn length(value: &Value) -> Option<usize> {
    value.array_len()
}
