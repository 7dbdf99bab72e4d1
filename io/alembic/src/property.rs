//! Types of property values and their little-endian byte form.

/// Plain-old-data type of one stored number, or text.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[allow(missing_docs)] // the names say all
pub enum PodType {
    Bool,
    U8,
    I8,
    U16,
    I16,
    U32,
    I32,
    U64,
    I64,
    F16,
    F32,
    F64,
    String,
    WideString,
}

use PodType::*;

/// In the order of the type codes 0..=13; name as in `podName`, bytes of one value (0 for text).
const TABLE: [(PodType, &str, usize); 14] = [
    (Bool, "bool_t", 1),
    (U8, "uint8_t", 1),
    (I8, "int8_t", 1),
    (U16, "uint16_t", 2),
    (I16, "int16_t", 2),
    (U32, "uint32_t", 4),
    (I32, "int32_t", 4),
    (U64, "uint64_t", 8),
    (I64, "int64_t", 8),
    (F16, "float16_t", 2),
    (F32, "float32_t", 4),
    (F64, "float64_t", 8),
    (String, "string", 0),
    (WideString, "wstring", 0),
];

impl PodType {
    /// The type with this code in packed headers.
    pub(crate) fn from_code(code: u32) -> Option<Self> {
        TABLE.get(code as usize).map(|row| row.0)
    }

    pub(crate) fn code(self) -> u32 {
        self as u32
    }

    /// Name used in the metadata of geometry parameters, such as `float32_t`.
    pub fn name(self) -> &'static str {
        TABLE[self as usize].1
    }

    /// Bytes of one value; 0 for text, whose length varies.
    pub fn size(self) -> usize {
        TABLE[self as usize].2
    }

    /// True for both kinds of text.
    pub fn is_text(self) -> bool {
        matches!(self, String | WideString)
    }
}

/// Type of one element: one or more values of a plain type, for example 3 × `F32` for a point.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct DataType {
    /// Type of each value.
    pub pod: PodType,
    /// Values in one element, 1..=255.
    pub extent: u8,
}

impl DataType {
    /// `extent` values of type `pod`.
    pub const fn new(pod: PodType, extent: u8) -> Self {
        Self { pod, extent }
    }

    /// Bytes of one element; 0 for text.
    pub fn element_size(self) -> usize {
        self.pod.size() * usize::from(self.extent)
    }

    /// Number of elements in a payload of this type; none when the payload is not whole.
    pub(crate) fn count_elements(self, payload: &[u8]) -> Option<usize> {
        let strings = match self.pod {
            String => {
                if payload.last().is_some_and(|&byte| byte != 0) {
                    return None;
                }
                payload.iter().filter(|&&byte| byte == 0).count()
            }
            WideString => {
                let (units, rest) = payload.as_chunks::<4>();
                if !rest.is_empty() || units.last().is_some_and(|unit| *unit != [0; 4]) {
                    return None;
                }
                units.iter().filter(|unit| **unit == [0; 4]).count()
            }
            _ => {
                let size = self.element_size();
                return (size > 0 && payload.len().is_multiple_of(size)).then(|| payload.len() / size);
            }
        };
        strings.is_multiple_of(usize::from(self.extent)).then(|| strings / usize::from(self.extent))
    }
}

mod sealed {
    pub trait Sealed {}
}

/// Numbers that can be stored. Implemented for `bool`, all fixed-size integers and both floats.
pub trait PodValue: Copy + sealed::Sealed {
    /// Its stored type.
    const POD: PodType;
    /// Appends the stored bytes.
    fn put(self, bytes: &mut Vec<u8>);
    /// Value of exactly `POD.size()` bytes.
    fn take(bytes: &[u8]) -> Self;
}

macro_rules! pod_value {
    ($($type:ty => $pod:expr),*) => {$(
        impl sealed::Sealed for $type {}
        impl PodValue for $type {
            const POD: PodType = $pod;
            #[inline]
            fn put(self, bytes: &mut Vec<u8>) {
                bytes.extend_from_slice(&self.to_le_bytes());
            }
            #[inline]
            fn take(bytes: &[u8]) -> Self {
                let mut value = [0; size_of::<$type>()];
                value.copy_from_slice(bytes);
                <$type>::from_le_bytes(value)
            }
        }
    )*};
}
pod_value!(u8 => U8, i8 => I8, u16 => U16, i16 => I16, u32 => U32, i32 => I32, u64 => U64, i64 => I64,
           f32 => F32, f64 => F64);

impl sealed::Sealed for bool {}
impl PodValue for bool {
    const POD: PodType = Bool;
    fn put(self, bytes: &mut Vec<u8>) {
        bytes.push(u8::from(self));
    }
    fn take(bytes: &[u8]) -> Self {
        bytes[0] != 0
    }
}

/// All values of `bytes`; a rest shorter than a value is dropped.
pub(crate) fn decode<T: PodValue>(bytes: &[u8]) -> Vec<T> {
    bytes.chunks_exact(T::POD.size()).map(T::take).collect()
}

/// Stored bytes of `values`.
pub(crate) fn encode<T: PodValue>(values: &[T]) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(std::mem::size_of_val(values));
    values.iter().for_each(|value| value.put(&mut bytes));
    bytes
}

/// Stored bytes of strings: each followed by a NUL; none when one contains a NUL.
pub(crate) fn encode_strings<S: AsRef<str>>(strings: &[S]) -> Option<Vec<u8>> {
    let mut bytes = Vec::new();
    for string in strings {
        if string.as_ref().contains('\0') {
            return None;
        }
        bytes.extend_from_slice(string.as_ref().as_bytes());
        bytes.push(0);
    }
    Some(bytes)
}

/// The strings of a payload; bytes that are no UTF-8 become the replacement character.
pub(crate) fn decode_strings(pod: PodType, payload: &[u8]) -> Vec<std::string::String> {
    if pod == WideString {
        let units: Vec<u32> = decode(payload);
        let text = |units: &[u32]| units.iter().map(|&u| char::from_u32(u).unwrap_or('\u{fffd}')).collect();
        return units.split_inclusive(|&u| u == 0).map(|u| text(u.strip_suffix(&[0]).unwrap_or(u))).collect();
    }
    let text = |bytes: &[u8]| std::string::String::from_utf8_lossy(bytes).into_owned();
    payload.split_inclusive(|&byte| byte == 0).map(|b| text(b.strip_suffix(&[0]).unwrap_or(b))).collect()
}
