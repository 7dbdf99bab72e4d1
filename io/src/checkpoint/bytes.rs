//! Arrays as little-endian bytes, and what identifies their content.

use drapery_core::snapshot::{Dataset, Values};
use sha2::{Digest, Sha256};

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

/// Number of values and of bytes that one takes.
pub(super) fn extent(values: &Values) -> (usize, usize) {
    match values {
        Values::F64(values) => (values.len(), size_of::<f64>()),
        Values::U64(values) => (values.len(), size_of::<u64>()),
        Values::I64(values) => (values.len(), size_of::<i64>()),
        Values::U32(values) => (values.len(), size_of::<u32>()),
        Values::U8(values) => (values.len(), size_of::<u8>()),
    }
}

/// Name of the type of the values, as in numpy.
pub(super) fn type_name(values: &Values) -> &'static str {
    match values {
        Values::F64(_) => "float64",
        Values::U64(_) => "uint64",
        Values::I64(_) => "int64",
        Values::U32(_) => "uint32",
        Values::U8(_) => "uint8",
    }
}

/// SHA-256 of the bytes of a dataset, in hexadecimal digits.
pub(super) fn hash(dataset: &Dataset) -> String {
    let mut hasher = Sha256::new();
    let done = for_each_block::<std::convert::Infallible>(&dataset.values, &mut |bytes| {
        hasher.update(bytes);
        Ok(())
    });
    match done {
        Ok(()) => hex(&hasher.finalize()),
    }
}

/// Bytes as hexadecimal digits.
pub(super) fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
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
    }

    #[test]
    fn the_hash_is_sha_256_of_the_bytes() {
        // FIPS 180-2, appendix B.1.
        let dataset = Dataset { name: "text".into(), shape: vec![3], values: Values::U8(b"abc".to_vec()) };
        assert_eq!(hash(&dataset), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
    }
}
