//! MurmurHash3 x64-128 (public-domain algorithm by A. Appleby), seed 0: the digest of sample payloads.

const C1: u64 = 0x87c3_7b91_1142_53d5;
const C2: u64 = 0x4cf5_ad43_2745_937f;

/// The 16 digest bytes of `payload` in file order: h1, then h2, both little-endian.
pub fn murmur3_x64_128(payload: &[u8]) -> [u8; 16] {
    let (blocks, tail) = payload.as_chunks::<16>();
    let (mut h1, mut h2) = (0_u64, 0_u64);
    for block in blocks {
        let [k1, k2] = halves(block);
        h1 ^= k1.wrapping_mul(C1).rotate_left(31).wrapping_mul(C2);
        h1 = h1.rotate_left(27).wrapping_add(h2).wrapping_mul(5).wrapping_add(0x52dc_e729);
        h2 ^= k2.wrapping_mul(C2).rotate_left(33).wrapping_mul(C1);
        h2 = h2.rotate_left(31).wrapping_add(h1).wrapping_mul(5).wrapping_add(0x3849_5ab5);
    }
    // Missing tail bytes count as zero, and a zero half mixes to zero: no test for its presence is needed.
    let mut rest = [0_u8; 16];
    rest[..tail.len()].copy_from_slice(tail);
    let [k1, k2] = halves(&rest);
    h2 ^= k2.wrapping_mul(C2).rotate_left(33).wrapping_mul(C1);
    h1 ^= k1.wrapping_mul(C1).rotate_left(31).wrapping_mul(C2);

    let length = payload.len() as u64;
    (h1, h2) = (h1 ^ length, h2 ^ length);
    h1 = h1.wrapping_add(h2);
    h2 = h2.wrapping_add(h1);
    (h1, h2) = (mix(h1), mix(h2));
    h1 = h1.wrapping_add(h2);
    h2 = h2.wrapping_add(h1);
    let mut digest = [0; 16];
    digest[..8].copy_from_slice(&h1.to_le_bytes());
    digest[8..].copy_from_slice(&h2.to_le_bytes());
    digest
}

fn halves(block: &[u8; 16]) -> [u64; 2] {
    let both = u128::from_le_bytes(*block);
    [both as u64, (both >> 64) as u64]
}

fn mix(mut k: u64) -> u64 {
    k ^= k >> 33;
    k = k.wrapping_mul(0xff51_afd7_ed55_8ccd);
    k ^= k >> 33;
    k = k.wrapping_mul(0xc4ce_b9fe_1a85_ec53);
    k ^ (k >> 33)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn hex(digest: [u8; 16]) -> String {
        digest.iter().map(|byte| format!("{byte:02x}")).collect()
    }

    #[test]
    fn digests_equal_those_of_the_official_library() {
        let three: Vec<u8> = [1.0_f64, 2.0, 3.0].iter().flat_map(|x| x.to_le_bytes()).collect();
        assert_eq!(hex(murmur3_x64_128(&[0x01])), "16fe7483905cce7a85670e43e4678877");
        assert_eq!(hex(murmur3_x64_128(&[0x10])), "03723414eef19cc12f17d39bad9fba32");
        assert_eq!(hex(murmur3_x64_128(&4_i32.to_le_bytes())), "f05783c945e9c31c8a9c42083615d38b");
        assert_eq!(hex(murmur3_x64_128(&three)), "715f49c2e26036e859c9a5bb9c4ffd7a");
    }
}
