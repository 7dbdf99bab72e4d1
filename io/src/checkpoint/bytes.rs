//! Arrays as little-endian bytes, and what identifies their content.

use drapery_core::snapshot::{SnapshotSink, ValueKind, Values};
use sha2::{Digest, Sha256};

use crate::sha256::hex;

/// Number of values that are converted at a time; small enough for the processor's cache.
const BLOCK: usize = 8192;

/// Calls `visit` with the little-endian bytes of the values, block by block.
///
/// # Errors
/// The first that `visit` returns.
pub(super) fn for_each_block<E>(values: &Values, visit: &mut dyn FnMut(&[u8]) -> Result<(), E>) -> Result<(), E> {
    match values {
        Values::F64(values) => blocks(values, f64::to_le_bytes, visit),
        Values::U64(values) => blocks(values, u64::to_le_bytes, visit),
        Values::I64(values) => blocks(values, i64::to_le_bytes, visit),
        Values::U32(values) => blocks(values, u32::to_le_bytes, visit),
        Values::U8(values) if values.is_empty() => Ok(()),
        Values::U8(values) => visit(values),
    }
}

fn blocks<T: Copy, E, const N: usize>(
    values: &[T],
    to_bytes: fn(T) -> [u8; N],
    visit: &mut dyn FnMut(&[u8]) -> Result<(), E>,
) -> Result<(), E> {
    let mut buffer = vec![0; values.len().min(BLOCK) * N];
    for chunk in values.chunks(BLOCK) {
        let filled = &mut buffer[..chunk.len() * N];
        for (place, value) in filled.as_chunks_mut::<N>().0.iter_mut().zip(chunk) {
            *place = to_bytes(*value);
        }
        visit(filled)?;
    }
    Ok(())
}

/// The values whose little-endian bytes these are; a rest that is no value is left out.
pub(super) fn values_of(kind: ValueKind, bytes: &[u8]) -> Values {
    match kind {
        ValueKind::F64 => Values::F64(bytes.as_chunks().0.iter().map(|b| f64::from_le_bytes(*b)).collect()),
        ValueKind::U64 => Values::U64(bytes.as_chunks().0.iter().map(|b| u64::from_le_bytes(*b)).collect()),
        ValueKind::I64 => Values::I64(bytes.as_chunks().0.iter().map(|b| i64::from_le_bytes(*b)).collect()),
        ValueKind::U32 => Values::U32(bytes.as_chunks().0.iter().map(|b| u32::from_le_bytes(*b)).collect()),
        ValueKind::U8 => Values::U8(bytes.to_vec()),
    }
}

/// Name of the type of values, as in numpy.
fn type_name(kind: ValueKind) -> &'static str {
    match kind {
        ValueKind::F64 => "float64",
        ValueKind::U64 => "uint64",
        ValueKind::I64 => "int64",
        ValueKind::U32 => "uint32",
        ValueKind::U8 => "uint8",
    }
}

/// SHA-256 of a checkpoint's content, array by array: the hash of a text with a line for the head, each section and each array
/// in order, see `docs/reference/checkpoint.md`.
#[derive(Debug)]
pub(super) struct ContentHash {
    text: String,
    section: String,
    /// The array begun last: its line without the hash, and the hash so far.
    open: Option<(String, Sha256)>,
}

impl ContentHash {
    /// Begins the hash of a checkpoint with this head.
    pub(super) fn new(head: &str) -> Self {
        let text = format!("head {}\n", hex(&Sha256::digest(head.as_bytes())));
        Self { text, section: String::new(), open: None }
    }

    /// The next bytes of the array begun last.
    pub(super) fn bytes(&mut self, bytes: &[u8]) {
        if let Some((_, hasher)) = &mut self.open {
            hasher.update(bytes);
        }
    }

    /// The hash of all, in hexadecimal digits.
    pub(super) fn finish(mut self) -> String {
        self.end_array();
        hex(&Sha256::digest(self.text.as_bytes()))
    }

    fn end_array(&mut self) {
        if let Some((line, hasher)) = self.open.take() {
            self.text += &format!("{line} {}\n", hex(&hasher.finalize()));
        }
    }
}

impl SnapshotSink for ContentHash {
    fn section(&mut self, name: &str, version: u32) {
        self.end_array();
        self.text += &format!("{name} {version}\n");
        name.clone_into(&mut self.section);
    }

    fn dataset(&mut self, name: &str, shape: &[usize], kind: ValueKind) {
        self.end_array();
        let extents: Vec<String> = shape.iter().map(usize::to_string).collect();
        let line = format!("{}/{name} {} ({})", self.section, type_name(kind), extents.join(","));
        self.open = Some((line, Sha256::new()));
    }

    fn rows(&mut self, values: Values) {
        let done = for_each_block::<std::convert::Infallible>(&values, &mut |bytes| {
            self.bytes(bytes);
            Ok(())
        });
        match done {
            Ok(()) => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_become_little_endian_bytes_whatever_the_block() {
        let many: Vec<u32> = (0..u32::try_from(2 * BLOCK + 3).unwrap()).collect();
        let mut bytes = Vec::new();
        let visit = &mut |block: &[u8]| {
            bytes.extend_from_slice(block);
            Ok::<(), ()>(())
        };
        for_each_block(&Values::U32(many.clone()), visit).unwrap();
        let expected: Vec<u8> = many.iter().flat_map(|v| v.to_le_bytes()).collect();
        assert_eq!(bytes, expected);
        assert_eq!(values_of(ValueKind::U32, &bytes), Values::U32(many));
    }

    #[test]
    fn the_hash_is_sha_256_of_lines_with_the_sha_256_of_each_array() {
        // FIPS 180-2, appendix B.1: the message "abc", here in two pieces.
        let abc = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
        let mut hash = ContentHash::new("abc");
        hash.section("s", 2);
        hash.dataset("text", &[3, 1], ValueKind::U8);
        hash.rows(Values::U8(b"a".to_vec()));
        hash.rows(Values::U8(b"bc".to_vec()));
        let text = format!("head {abc}\ns 2\ns/text uint8 (3,1) {abc}\n");
        assert_eq!(hash.finish(), hex(&Sha256::digest(text.as_bytes())));
    }
}
