//! Digests of what caches hold of a frame, by which a frame that has changed on the disk is noticed.
//!
//! They are of the numbers as they are stored, whatever the format of the file: single precision, little-endian, x y z of each
//! point. So all caches of a garment have the same ones, a copy keeps them, and anybody can compute them again:
//! `hashlib.sha256(points.astype("<f4").tobytes())`.

use std::collections::BTreeMap;

use drapery_io::sha256::hex;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

/// Points that are turned into bytes at a time.
const BLOCK: usize = 1024;

/// Digests of the garments of a frame, by name.
pub(crate) type FrameDigests = BTreeMap<String, GarmentDigests>;

/// Digests of what is stored of a garment in a frame, SHA-256, hexadecimal.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct GarmentDigests {
    /// Digest of the positions.
    pub positions: String,
    /// Digest of the velocities, where they are stored.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub velocities: Option<String>,
}

impl GarmentDigests {
    /// Computes the digests of positions, and of velocities if there are any.
    pub fn of(positions: &[[f32; 3]], velocities: &[[f32; 3]]) -> Self {
        let velocities = (!velocities.is_empty()).then(|| digest_of(velocities));
        Self { positions: digest_of(positions), velocities }
    }
}

/// SHA-256 of vectors, hexadecimal.
fn digest_of(vectors: &[[f32; 3]]) -> String {
    let mut all = Sha256::new();
    let mut bytes = [[0_u8; size_of::<[f32; 3]>()]; BLOCK];
    for block in vectors.chunks(BLOCK) {
        for (bytes, vector) in bytes.iter_mut().zip(block) {
            let (numbers, _) = bytes.as_chunks_mut::<4>();
            numbers.iter_mut().zip(vector).for_each(|(bytes, number)| *bytes = number.to_le_bytes());
        }
        all.update(bytes[..block.len()].as_flattened());
    }
    hex(&all.finalize())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_digest_is_that_of_the_little_endian_bytes() {
        let vectors: Vec<[f32; 3]> = (0..BLOCK as u32 + 7).map(|i| [i as f32, -0.5, 1e-30]).collect();
        let bytes: Vec<u8> = vectors.iter().flatten().flat_map(|x| x.to_le_bytes()).collect();
        assert_eq!(digest_of(&vectors), hex(&Sha256::digest(bytes)));
        let of_nothing = "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855";
        assert_eq!(GarmentDigests::of(&[], &[]), GarmentDigests { positions: of_nothing.into(), velocities: None });
        assert_ne!(digest_of(&[[0.0; 3]]), digest_of(&[[-0.0, 0.0, 0.0]]), "bits count, not values");
    }
}
