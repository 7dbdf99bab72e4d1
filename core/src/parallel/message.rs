//! Plain data as bytes, for what rank 0 tells the others once. Large arrays go as they are (`Ranks`).
//!
//! Ranks run the same program, so that a message is what was sent. One that is not is a fault of the program, and no rank may
//! go on without what it was told: decoding gives the value or panics, which ends all ranks.

use std::collections::BTreeMap;
use std::fmt::Display;

use bytemuck::Pod;

use crate::Vec3;

/// What is left of a message that is being decoded.
#[derive(Debug)]
pub(crate) struct Decoder<'a> {
    rest: &'a [u8],
    name: &'static str,
    rank: usize,
}

impl<'a> Decoder<'a> {
    /// A message that came to this rank; its name is for the report of a broken one.
    pub(crate) fn new(rank: usize, name: &'static str, bytes: &'a [u8]) -> Self {
        Self { rest: bytes, name, rank }
    }

    /// The next so many bytes.
    ///
    /// # Panics
    /// The message has fewer.
    pub(crate) fn bytes(&mut self, count: usize) -> &'a [u8] {
        let Some((next, rest)) = self.rest.split_at_checked(count) else {
            self.is_broken(format_args!("{count} bytes are to follow, and {} are left", self.rest.len()));
        };
        self.rest = rest;
        next
    }

    /// The next so many plain values.
    ///
    /// # Panics
    /// The message has fewer.
    pub(crate) fn values<T: Pod>(&mut self, count: usize) -> Vec<T> {
        bytemuck::pod_collect_to_vec(self.bytes(count.saturating_mul(size_of::<T>())))
    }

    /// All plain values that are left.
    ///
    /// # Panics
    /// The message ends within one.
    pub(crate) fn all_values<T: Pod>(mut self) -> Vec<T> {
        let values = self.values(self.rest.len() / size_of::<T>());
        self.end();
        values
    }

    /// Whether nothing is left.
    pub(crate) fn is_empty(&self) -> bool {
        self.rest.is_empty()
    }

    /// Makes sure that nothing is left.
    ///
    /// # Panics
    /// Something is.
    pub(crate) fn end(self) {
        if !self.rest.is_empty() {
            self.is_broken(format_args!("{} bytes are left behind its end", self.rest.len()));
        }
    }

    fn array<const N: usize>(&mut self) -> [u8; N] {
        *self.bytes(N).first_chunk().expect("so many bytes were asked for")
    }

    /// Ends the run.
    pub(crate) fn is_broken(&self, what: impl Display) -> ! {
        panic!("the message \"{}\" to rank {} cannot be decoded: {what}", self.name, self.rank)
    }
}

/// The value that a message to this rank holds.
///
/// # Panics
/// It holds none, or more than that.
pub(crate) fn decode<T: Codec>(rank: usize, name: &'static str, bytes: &[u8]) -> T {
    let mut message = Decoder::new(rank, name, bytes);
    let value = T::take(&mut message);
    message.end();
    value
}

/// The plain values that a message to this rank holds.
///
/// # Panics
/// It ends within one.
pub(crate) fn values<T: Pod>(rank: usize, name: &'static str, bytes: &[u8]) -> Vec<T> {
    Decoder::new(rank, name, bytes).all_values()
}

/// A value that can be sent. What was put is taken again in the same order.
pub(crate) trait Codec: Sized {
    /// Appends the value.
    fn put(&self, out: &mut Vec<u8>);

    /// Takes a value from the front of a message.
    ///
    /// # Panics
    /// The message does not begin with one.
    fn take(message: &mut Decoder<'_>) -> Self;

    /// The value alone.
    fn to_bytes(&self) -> Vec<u8> {
        let mut out = Vec::new();
        self.put(&mut out);
        out
    }
}

macro_rules! wire_numbers {
    ($($number:ty),+) => {$(
        impl Codec for $number {
            fn put(&self, out: &mut Vec<u8>) {
                out.extend_from_slice(&self.to_le_bytes());
            }

            fn take(message: &mut Decoder<'_>) -> Self {
                Self::from_le_bytes(message.array())
            }
        }
    )+};
}
wire_numbers!(u8, u32, u64, i64, f64);

impl Codec for usize {
    fn put(&self, out: &mut Vec<u8>) {
        (*self as u64).put(out);
    }

    fn take(message: &mut Decoder<'_>) -> Self {
        let number = u64::take(message);
        Self::try_from(number).unwrap_or_else(|_| message.is_broken(format_args!("{number} is no count")))
    }
}

impl Codec for bool {
    fn put(&self, out: &mut Vec<u8>) {
        u8::from(*self).put(out);
    }

    fn take(message: &mut Decoder<'_>) -> Self {
        match u8::take(message) {
            0 => false,
            1 => true,
            other => message.is_broken(format_args!("{other} is no flag")),
        }
    }
}

impl Codec for String {
    fn put(&self, out: &mut Vec<u8>) {
        self.as_bytes().to_vec().put(out);
    }

    fn take(message: &mut Decoder<'_>) -> Self {
        Self::from_utf8(Vec::take(message)).unwrap_or_else(|error| message.is_broken(error))
    }
}

impl<T: Codec> Codec for Vec<T> {
    fn put(&self, out: &mut Vec<u8>) {
        self.len().put(out);
        self.iter().for_each(|item| item.put(out));
    }

    fn take(message: &mut Decoder<'_>) -> Self {
        let count = usize::take(message);
        // A count that is broken asks for no more room than its message has.
        let mut all = Self::with_capacity(count.min(message.rest.len()));
        for _ in 0..count {
            all.push(T::take(message));
        }
        all
    }
}

impl<T: Codec> Codec for Option<T> {
    fn put(&self, out: &mut Vec<u8>) {
        self.is_some().put(out);
        self.iter().for_each(|item| item.put(out));
    }

    fn take(message: &mut Decoder<'_>) -> Self {
        bool::take(message).then(|| T::take(message))
    }
}

impl<T: Codec, const N: usize> Codec for [T; N] {
    fn put(&self, out: &mut Vec<u8>) {
        self.iter().for_each(|item| item.put(out));
    }

    fn take(message: &mut Decoder<'_>) -> Self {
        [(); N].map(|()| T::take(message))
    }
}

impl Codec for Vec3 {
    fn put(&self, out: &mut Vec<u8>) {
        <[f64; 3]>::from(*self).put(out);
    }

    fn take(message: &mut Decoder<'_>) -> Self {
        <[f64; 3]>::take(message).into()
    }
}

impl<A: Codec, B: Codec> Codec for (A, B) {
    fn put(&self, out: &mut Vec<u8>) {
        self.0.put(out);
        self.1.put(out);
    }

    fn take(message: &mut Decoder<'_>) -> Self {
        (A::take(message), B::take(message))
    }
}

impl<K: Codec + Ord, V: Codec> Codec for BTreeMap<K, V> {
    fn put(&self, out: &mut Vec<u8>) {
        self.len().put(out);
        self.iter().for_each(|(key, value)| {
            key.put(out);
            value.put(out);
        });
    }

    fn take(message: &mut Decoder<'_>) -> Self {
        Vec::<(K, V)>::take(message).into_iter().collect()
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
        impl $crate::parallel::message::Codec for $name {
            fn put(&self, out: &mut Vec<u8>) {
                let Self { $($field),* } = self;
                $($crate::parallel::message::Codec::put($field, out);)*
            }

            fn take(message: &mut $crate::parallel::message::Decoder<'_>) -> Self {
                $(let $field = $crate::parallel::message::Codec::take(message);)*
                Self { $($field),* }
            }
        }
    };
    (enum $name:ident { $($tag:literal => $variant:ident
        $({ $($field:ident),* })? $(( $($item:ident),* ))?),* $(,)? }) => {
        impl $crate::parallel::message::Codec for $name {
            fn put(&self, out: &mut Vec<u8>) {
                match self {
                    $($name::$variant $({ $($field),* })? $(( $($item),* ))? => {
                        out.push($tag);
                        $($($crate::parallel::message::Codec::put($field, out);)*)?
                        $($($crate::parallel::message::Codec::put($item, out);)*)?
                    })*
                }
            }

            fn take(message: &mut $crate::parallel::message::Decoder<'_>) -> Self {
                match u8::take(message) {
                    $($tag => {
                        $($(let $field = $crate::parallel::message::Codec::take(message);)*)?
                        $($(let $item = $crate::parallel::message::Codec::take(message);)*)?
                        $name::$variant $({ $($field),* })? $(( $($item),* ))?
                    })*
                    other => message.is_broken(format_args!("{other} is no {}", stringify!($name))),
                }
            }
        }
    };
}
pub(crate) use wire;

#[cfg(test)]
mod tests {
    use std::fmt::Debug;

    use super::*;
    use crate::parallel::local_ranks::LocalRanks;
    use crate::parallel::ranks::Ranks;

    fn comes_back<T: Codec + PartialEq + Debug>(value: &T) {
        assert_eq!(&decode::<T>(0, "value", &value.to_bytes()), value);
    }

    #[test]
    fn what_was_put_is_taken_again() {
        comes_back(&(vec![(7_usize, -0.0_f64), (usize::MAX, f64::MIN)], String::from("skirt")));
        comes_back(&([Some(Vec3::x()), None], BTreeMap::from([(2_u32, true), (5, false)])));
    }

    /// What is said of a rank that gets these bytes as texts, while the other two wait for it.
    fn said_of(bytes: &[u8]) -> String {
        let ended = LocalRanks::run(3, 1, |communicator| {
            let ranks = Ranks::new(communicator);
            if ranks.rank() == 1 {
                drop(decode::<Vec<String>>(ranks.rank(), "names of garments", bytes));
            }
            ranks.barrier();
        });
        ended.map(|_| ()).expect_err("a rank that was not told does not go on").to_string()
    }

    #[test]
    fn a_message_that_cannot_be_decoded_ends_all_ranks_and_is_named() {
        let whole = vec![String::from("skirt")].to_bytes();
        let (short, long) = (&whole[..whole.len() - 1], [whole.as_slice(), &[0]].concat());
        let (mut no_text, endless) = (whole.clone(), u64::MAX.to_bytes());
        no_text[16] = 0xff;
        let broken = [
            (&[][..], "8 bytes are to follow, and 0 are left"),
            (short, "1 bytes are to follow, and 0 are left"),
            (&long, "1 bytes are left behind its end"),
            (&no_text, "invalid utf-8"),
            (&endless, "8 bytes are to follow"),
        ];
        for (bytes, what) in broken {
            let said = said_of(bytes);
            for part in ["rank 1:", "the message \"names of garments\" to rank 1", what] {
                assert!(said.contains(part), "{part}: {said}");
            }
        }
    }

    #[test]
    fn plain_values_fill_their_message() {
        let ended = std::panic::catch_unwind(|| values::<u64>(0, "numbers", &[0; 12]));
        assert!(ended.is_err());
        assert_eq!(values::<u32>(0, "numbers", &[0; 12]), [0; 3]);
    }
}
