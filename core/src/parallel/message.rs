//! Messages between ranks, as bytes. There are two kinds of messages, both sent by `Ranks` and `Halo`:
//!
//! * *rows* of fixed size, of which there may be many: numbers, vectors, and structs of them with a name for each field
//!   (`#[repr(C)]` and [`Pod`], which does not compile where something lies between the fields). An array of rows goes as it is.
//! * *encoded* values, of any shape: what implements [`Codec`], nearly always by [`codec!`]. Functions that send them have names
//!   that end in `_encoded`. Commands from rank to rank in the crates above are encoded too.
//!
//! Ranks run the same program, so that a message is what was sent. One that is not is a fault of the program, and no rank may
//! go on without it: decoding gives the value or panics, which ends all ranks.

use std::collections::BTreeMap;
use std::fmt::Display;

use bytemuck::Pod;

use crate::Vec3;
use crate::parallel::communicator::Message;

/// Remainder of a message that is being decoded.
#[derive(Debug)]
pub struct Decoder<'a> {
    rest: &'a [u8],
    name: &'static str,
    rank: usize,
}

impl<'a> Decoder<'a> {
    /// A message that came to this rank; its name is for the error of a damaged one.
    pub(crate) fn new(rank: usize, name: &'static str, bytes: &'a [u8]) -> Self {
        Self { rest: bytes, name, rank }
    }

    /// The next `count` bytes.
    ///
    /// # Panics
    /// The message has fewer.
    pub fn bytes(&mut self, count: usize) -> &'a [u8] {
        let Some((next, rest)) = self.rest.split_at_checked(count) else {
            self.is_broken(format_args!("{count} bytes are to follow, and {} are left", self.rest.len()));
        };
        self.rest = rest;
        next
    }

    /// The next `count` plain values.
    ///
    /// # Panics
    /// The message has fewer.
    pub fn values<T: Pod>(&mut self, count: usize) -> Vec<T> {
        bytemuck::pod_collect_to_vec(self.bytes(count.saturating_mul(size_of::<T>())))
    }

    /// The next number, which counts something of which there are `count`.
    ///
    /// # Panics
    /// It is not below that.
    pub(crate) fn index(&mut self, count: usize) -> usize {
        index(self.rank, self.name, u32::take(self), count)
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

    /// Ends the run, for what the message holds is not what was sent.
    ///
    /// # Panics
    /// Always.
    pub fn is_broken(&self, what: impl Display) -> ! {
        is_broken(self.rank, self.name, what)
    }
}

/// Ends the run because of a message to this rank.
pub(crate) fn is_broken(rank: usize, name: &'static str, what: impl Display) -> ! {
    panic!("the message \"{name}\" to rank {rank} cannot be decoded: {what}")
}

/// A number from a message to this rank, which counts something of which there are `count`.
///
/// # Panics
/// It is not below that.
pub(crate) fn index(rank: usize, name: &'static str, number: u32, count: usize) -> usize {
    let index = number as usize;
    if index < count { index } else { is_broken(rank, name, format_args!("it names number {number} of {count}")) }
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

/// All values, one after the other, that a message to this rank holds.
///
/// # Panics
/// It ends within one.
pub(crate) fn decode_all<T: Codec>(rank: usize, name: &'static str, bytes: &[u8]) -> Vec<T> {
    let mut message = Decoder::new(rank, name, bytes);
    let mut all = Vec::new();
    while !message.is_empty() {
        all.push(T::take(&mut message));
    }
    all
}

/// Values one after the other; none are no bytes.
pub(crate) fn encode_all<T: Codec>(all: &[T]) -> Vec<u8> {
    let mut bytes = Vec::new();
    T::put_all(all, &mut bytes);
    bytes
}

/// The rows that a message to this rank holds.
///
/// # Panics
/// It ends within one.
pub(crate) fn rows<T: Pod>(rank: usize, name: &'static str, bytes: &[u8]) -> Vec<T> {
    if !bytes.len().is_multiple_of(size_of::<T>()) {
        let row = std::any::type_name::<T>();
        is_broken(rank, name, format_args!("its {} bytes are not rows of {} ({row})", bytes.len(), size_of::<T>()));
    }
    bytemuck::pod_collect_to_vec(bytes)
}

/// Puts the rows that a message to this rank holds into their place.
///
/// # Panics
/// There are not as many.
pub(crate) fn copy_rows<T: Pod>(rank: usize, name: &'static str, bytes: &[u8], to: &mut [T]) {
    let to = bytemuck::cast_slice_mut::<T, u8>(to);
    if bytes.len() != to.len() {
        is_broken(rank, name, format_args!("it has {} bytes, and {} are to follow", bytes.len(), to.len()));
    }
    to.copy_from_slice(bytes);
}

impl Message {
    /// Rows for a rank.
    pub(crate) fn of_rows<T: Pod>(to: usize, rows: &[T]) -> Self {
        Self { to, bytes: bytemuck::cast_slice(rows).to_vec() }
    }
}

/// A value that can be encoded. What was put is taken again in the same order.
pub trait Codec: Sized {
    /// Appends the value.
    fn put(&self, out: &mut Vec<u8>);

    /// Takes a value from the front of a message.
    ///
    /// # Panics
    /// The message does not begin with one.
    fn take(message: &mut Decoder<'_>) -> Self;

    /// Appends values one after the other.
    fn put_all(all: &[Self], out: &mut Vec<u8>) {
        all.iter().for_each(|value| value.put(out));
    }

    /// Takes `count` values.
    ///
    /// # Panics
    /// The message does not begin with as many.
    fn take_all(count: usize, message: &mut Decoder<'_>) -> Vec<Self> {
        // A count that is broken asks for no more room than its message has.
        let mut all = Vec::with_capacity(count.min(message.rest.len()));
        for _ in 0..count {
            all.push(Self::take(message));
        }
        all
    }

    /// The value alone.
    fn to_bytes(&self) -> Vec<u8> {
        let mut out = Vec::new();
        self.put(&mut out);
        out
    }
}

/// Makes rows something that can stand in an encoded value: arrays of them as they are.
macro_rules! codec_of_rows {
    ($($row:ty),+ $(,)?) => {$(
        impl $crate::parallel::message::Codec for $row {
            fn put(&self, out: &mut Vec<u8>) {
                out.extend_from_slice(bytemuck::bytes_of(self));
            }

            fn take(message: &mut $crate::parallel::message::Decoder<'_>) -> Self {
                bytemuck::pod_read_unaligned(message.bytes(size_of::<Self>()))
            }

            fn put_all(all: &[Self], out: &mut Vec<u8>) {
                out.extend_from_slice(bytemuck::cast_slice(all));
            }

            fn take_all(count: usize, message: &mut $crate::parallel::message::Decoder<'_>) -> Vec<Self> {
                message.values(count)
            }
        }
    )+};
}
pub(crate) use codec_of_rows;
codec_of_rows!(u8, u32, u64, u128, i64, f64, Vec3);

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
        self.len().put(out);
        out.extend_from_slice(self.as_bytes());
    }

    fn take(message: &mut Decoder<'_>) -> Self {
        Self::from_utf8(Vec::take(message)).unwrap_or_else(|error| message.is_broken(error))
    }
}

impl<T: Codec> Codec for Vec<T> {
    fn put(&self, out: &mut Vec<u8>) {
        self.len().put(out);
        T::put_all(self, out);
    }

    fn take(message: &mut Decoder<'_>) -> Self {
        T::take_all(usize::take(message), message)
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

impl<T: Codec, E: Codec> Codec for Result<T, E> {
    fn put(&self, out: &mut Vec<u8>) {
        self.is_ok().put(out);
        match self {
            Ok(value) => value.put(out),
            Err(error) => error.put(out),
        }
    }

    fn take(message: &mut Decoder<'_>) -> Self {
        if bool::take(message) { Ok(T::take(message)) } else { Err(E::take(message)) }
    }
}

impl<T: Codec, const N: usize> Codec for [T; N] {
    fn put(&self, out: &mut Vec<u8>) {
        T::put_all(self, out);
    }

    fn take(message: &mut Decoder<'_>) -> Self {
        [(); N].map(|()| T::take(message))
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

/// Makes a struct, or an enum with a number for each of its variants, something that can be encoded. A field that is left out
/// does not compile.
#[doc(hidden)]
#[macro_export]
macro_rules! codec {
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
                match <u8 as $crate::parallel::message::Codec>::take(message) {
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
pub(crate) use codec;

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
        comes_back(&[Ok(vec![Vec3::y(); 3]), Err(String::from("it is missing"))]);
    }

    /// Returns the error message about a rank that gets these bytes as texts, while the other two wait for it.
    fn said_of(bytes: &[u8]) -> String {
        let ended = LocalRanks::run(3, 1, |communicator| {
            let ranks = Ranks::new(communicator);
            if ranks.rank() == 1 {
                drop(decode::<Vec<String>>(ranks.rank(), "names of garments", bytes));
            }
            ranks.barrier();
        });
        ended.map(|_| ()).expect_err("a rank without its message does not continue").to_string()
    }

    #[test]
    fn a_message_that_cannot_be_decoded_ends_all_ranks_and_is_named() {
        let whole = vec![String::from("skirt")].to_bytes();
        let (short, long) = (&whole[..whole.len() - 1], [whole.as_slice(), &[0]].concat());
        let (mut no_text, endless) = (whole.clone(), u64::MAX.to_bytes());
        no_text[16] = 0xff;
        let broken = [
            (&[][..], "8 bytes are to follow, and 0 are left"),
            (short, "5 bytes are to follow, and 4 are left"),
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
    fn rows_fill_their_message() {
        let ended = std::panic::catch_unwind(|| rows::<u64>(0, "numbers", &[0; 12]));
        let said = ended.expect_err("half a row is none").downcast::<String>().expect("a panic with words");
        assert!(said.contains("the message \"numbers\" to rank 0") && said.contains("rows of 8 (u64)"), "{said}");
        assert_eq!(rows::<u32>(0, "numbers", &[0; 12]), [0; 3]);
        assert!(std::panic::catch_unwind(|| copy_rows(0, "numbers", &[0; 12], &mut [0_u64])).is_err());
    }

    #[test]
    fn numbers_of_a_message_are_below_the_count_of_what_they_name() {
        assert_eq!(index(0, "places", 3, 4), 3);
        let ended = std::panic::catch_unwind(|| index(0, "places", 4, 4));
        let said = ended.expect_err("there are four").downcast::<String>().expect("a panic with words");
        assert!(said.contains("\"places\" to rank 0 cannot be decoded: it names number 4 of 4"), "{said}");
    }

    #[test]
    fn values_one_after_the_other_are_as_many_as_there_were() {
        let all = [vec![1_u32, 2], Vec::new(), vec![3]];
        assert_eq!(decode_all::<Vec<u32>>(0, "lists", &encode_all(&all)), all);
        assert_eq!(decode_all::<Vec<u32>>(0, "lists", &[]), [[0_u32; 0]; 0]);
    }
}
