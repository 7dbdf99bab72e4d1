//! Layers with bytes that were changed, cut off or taken from elsewhere are answered like any other file: with a mesh or an error.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use drapery_usd::read::{Stage, UsdError};

/// A stream of numbers, the same every time (xorshift).
struct Numbers(u64);

impl Numbers {
    fn below(&mut self, count: usize) -> usize {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 % count.max(1) as u64) as usize
    }
}

fn seeds() -> Vec<PathBuf> {
    let folder = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../tests/fuzz/corpus/usd"));
    let mut paths: Vec<PathBuf> = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    paths.sort();
    assert!(paths.len() >= 5, "{paths:?}");
    paths
}

fn damaged(good: &[u8], numbers: &mut Numbers) -> Vec<u8> {
    let mut bytes = good.to_vec();
    for _ in 0..=numbers.below(4) {
        let at = numbers.below(bytes.len());
        match numbers.below(6) {
            0 => bytes[at] ^= 1 << numbers.below(8),
            1 => bytes[at] = [0, 1, 0x7f, 0x80, 0xff][numbers.below(5)],
            2 => bytes.truncate(at.max(1)),
            3 => {
                let value = [0, 1, u64::MAX, 1 << 32, 1 << 47, i64::MIN as u64][numbers.below(6)];
                let end = (at + 8).min(bytes.len());
                bytes[at..end].copy_from_slice(&value.to_le_bytes()[..end - at]);
            }
            4 => {
                let from = numbers.below(bytes.len());
                let count = numbers.below(32).min(bytes.len() - from.max(at));
                bytes.copy_within(from..from + count, at);
            }
            _ => drop(bytes.remove(at)),
        }
        if bytes.len() < 2 {
            break;
        }
    }
    bytes
}

/// Everything that is asked of a stage.
fn read(path: &Path) -> Result<(), UsdError> {
    let stage = Stage::open(path)?;
    for mesh in 0..stage.about().meshes.len() {
        let chosen = stage.choose(&[mesh])?;
        for code in chosen.codes.iter().take(3).copied().chain([0.5]) {
            let whole = stage.mesh(0, code)?;
            assert_eq!((stage.points(0, code)?.len(), stage.faces(0, code)?), (whole.points.len(), whole.faces));
            stage.stored(0, code)?;
        }
    }
    Ok(())
}

#[test]
fn damaged_layers_are_read_or_refused_in_bounded_time() {
    const EACH: usize = 100;
    let folder = tempfile::tempdir().unwrap();
    let (mut read_well, mut refused, mut gave_up) = (0, 0, Vec::new());
    let mut slowest = Duration::ZERO;
    for seed in seeds() {
        let good = fs::read(&seed).unwrap();
        let path = folder.path().join(seed.file_name().unwrap());
        let mut numbers = Numbers(0x9e37_79b9_7f4a_7c15);
        for _ in 0..EACH {
            fs::write(&path, damaged(&good, &mut numbers)).unwrap();
            let start = Instant::now();
            match read(&path) {
                Ok(()) => read_well += 1,
                Err(error) if error.what.contains("gave up") => gave_up.push(error.what),
                Err(error) => {
                    refused += 1;
                    assert!(!error.what.is_empty() && !error.advice.is_empty() && error.path == path, "{error}");
                }
            }
            slowest = slowest.max(start.elapsed());
        }
    }
    println!(
        "{read_well} read, {refused} refused, {} gave up, the slowest took {slowest:?}: {gave_up:#?}",
        gave_up.len()
    );
    // Damage that leaves a layer readable, damage that does not: both are there.
    assert!(read_well > 10 && refused > 100, "{read_well} read, {refused} refused");
    assert!(slowest < Duration::from_secs(10), "{slowest:?}");
}
