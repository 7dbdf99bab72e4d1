//! Plain data as bytes, for what rank 0 tells the others once. Large arrays go as they are (`Ranks`).

use std::collections::BTreeMap;

use crate::Vec3;

/// A value that can be sent. What was put is taken again in the same order.
pub(crate) trait Wire: Sized {
    /// Appends the value.
    fn put(&self, out: &mut Vec<u8>);

    /// Takes a value from the front; `None` if the bytes hold none.
    fn take(bytes: &mut &[u8]) -> Option<Self>;

    /// The value alone.
    fn to_bytes(&self) -> Vec<u8> {
        let mut out = Vec::new();
        self.put(&mut out);
        out
    }
}

macro_rules! wire_numbers {
    ($($number:ty),+) => {$(
        impl Wire for $number {
            fn put(&self, out: &mut Vec<u8>) {
                out.extend_from_slice(&self.to_le_bytes());
            }

            fn take(bytes: &mut &[u8]) -> Option<Self> {
                let (own, rest) = bytes.split_first_chunk()?;
                *bytes = rest;
                Some(Self::from_le_bytes(*own))
            }
        }
    )+};
}
wire_numbers!(u8, u32, u64, i64, f64);

impl Wire for usize {
    fn put(&self, out: &mut Vec<u8>) {
        (*self as u64).put(out);
    }

    fn take(bytes: &mut &[u8]) -> Option<Self> {
        usize::try_from(u64::take(bytes)?).ok()
    }
}

impl Wire for bool {
    fn put(&self, out: &mut Vec<u8>) {
        u8::from(*self).put(out);
    }

    fn take(bytes: &mut &[u8]) -> Option<Self> {
        Some(u8::take(bytes)? != 0)
    }
}

impl Wire for String {
    fn put(&self, out: &mut Vec<u8>) {
        self.as_bytes().to_vec().put(out);
    }

    fn take(bytes: &mut &[u8]) -> Option<Self> {
        Self::from_utf8(Vec::take(bytes)?).ok()
    }
}

impl<T: Wire> Wire for Vec<T> {
    fn put(&self, out: &mut Vec<u8>) {
        self.len().put(out);
        self.iter().for_each(|item| item.put(out));
    }

    fn take(bytes: &mut &[u8]) -> Option<Self> {
        let count = usize::take(bytes)?;
        (0..count).map(|_| T::take(bytes)).collect()
    }
}

impl<T: Wire> Wire for Option<T> {
    fn put(&self, out: &mut Vec<u8>) {
        self.is_some().put(out);
        self.iter().for_each(|item| item.put(out));
    }

    fn take(bytes: &mut &[u8]) -> Option<Self> {
        if bool::take(bytes)? { T::take(bytes).map(Some) } else { Some(None) }
    }
}

impl<T: Wire + Copy + Default, const N: usize> Wire for [T; N] {
    fn put(&self, out: &mut Vec<u8>) {
        self.iter().for_each(|item| item.put(out));
    }

    fn take(bytes: &mut &[u8]) -> Option<Self> {
        let mut all = [T::default(); N];
        for item in &mut all {
            *item = T::take(bytes)?;
        }
        Some(all)
    }
}

impl Wire for Vec3 {
    fn put(&self, out: &mut Vec<u8>) {
        <[f64; 3]>::from(*self).put(out);
    }

    fn take(bytes: &mut &[u8]) -> Option<Self> {
        <[f64; 3]>::take(bytes).map(Self::from)
    }
}

impl<A: Wire, B: Wire> Wire for (A, B) {
    fn put(&self, out: &mut Vec<u8>) {
        self.0.put(out);
        self.1.put(out);
    }

    fn take(bytes: &mut &[u8]) -> Option<Self> {
        Some((A::take(bytes)?, B::take(bytes)?))
    }
}

impl<K: Wire + Ord, V: Wire> Wire for BTreeMap<K, V> {
    fn put(&self, out: &mut Vec<u8>) {
        self.len().put(out);
        self.iter().for_each(|(key, value)| {
            key.put(out);
            value.put(out);
        });
    }

    fn take(bytes: &mut &[u8]) -> Option<Self> {
        Some(Vec::<(K, V)>::take(bytes)?.into_iter().collect())
    }
}

/// A vector as words, for rows that hold numbers beside it.
pub(crate) fn words_of(vector: &Vec3) -> [u64; 3] {
    [vector.x, vector.y, vector.z].map(f64::to_bits)
}

/// The vector of such words.
pub(crate) fn vector_of(words: [u64; 3]) -> Vec3 {
    Vec3::from(words.map(f64::from_bits))
}

/// Makes a struct, or an enum with a number for each of its variants, something that can be sent. A field that is left out
/// does not compile.
macro_rules! wire {
    (struct $name:path { $($field:ident),* $(,)? }) => {
        impl $crate::parallel::wire::Wire for $name {
            fn put(&self, out: &mut Vec<u8>) {
                let Self { $($field),* } = self;
                $($crate::parallel::wire::Wire::put($field, out);)*
            }

            fn take(bytes: &mut &[u8]) -> Option<Self> {
                $(let $field = $crate::parallel::wire::Wire::take(bytes)?;)*
                Some(Self { $($field),* })
            }
        }
    };
    (enum $name:ident { $($tag:literal => $variant:ident
        $({ $($field:ident),* })? $(( $($item:ident),* ))?),* $(,)? }) => {
        impl $crate::parallel::wire::Wire for $name {
            fn put(&self, out: &mut Vec<u8>) {
                match self {
                    $($name::$variant $({ $($field),* })? $(( $($item),* ))? => {
                        out.push($tag);
                        $($($crate::parallel::wire::Wire::put($field, out);)*)?
                        $($($crate::parallel::wire::Wire::put($item, out);)*)?
                    })*
                }
            }

            fn take(bytes: &mut &[u8]) -> Option<Self> {
                match u8::take(bytes)? {
                    $($tag => {
                        $($(let $field = $crate::parallel::wire::Wire::take(bytes)?;)*)?
                        $($(let $item = $crate::parallel::wire::Wire::take(bytes)?;)*)?
                        Some($name::$variant $({ $($field),* })? $(( $($item),* ))?)
                    })*
                    _ => None,
                }
            }
        }
    };
}
pub(crate) use wire;
