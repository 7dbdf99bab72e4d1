//! The seal at the front of a checkpoint: how long the file is and the hash of all that follows.
//!
//! It is the user block of the HDF5 file, which HDF5 programs pass over. Because it is checked before anything else is
//! looked at, no damaged byte ever reaches the HDF5 library.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::Path;

use sha2::{Digest, Sha256};

use crate::error::IoError;
use crate::sha256::hex;

/// Length of the user block [bytes], the smallest that HDF5 has.
pub(super) const LENGTH: usize = 512;

/// Version of the layout that is written. The one before it will stay readable when it is raised.
pub const FORMAT_VERSION: u32 = 1;

/// First word of the file.
const MAGIC: &str = "Drapery checkpoint ";

/// Number of bytes that are read at a time.
const BLOCK: usize = 1 << 16;

/// The advice when a checkpoint cannot be used but an earlier one may.
pub(super) const USE_EARLIER: &str =
    "continue from an earlier checkpoint with --resume FRAME, or start over with --overwrite";

/// Seals a file whose remaining content has been written.
///
/// # Errors
/// The disk refuses.
pub(super) fn put(file: &mut File) -> std::io::Result<()> {
    let (bytes, hash) = measure(file)?;
    file.seek(SeekFrom::Start(0))?;
    file.write_all(&text(FORMAT_VERSION, bytes, &hash))
}

/// Checks the seal of a file; what passes is, bit for bit, what was written.
///
/// # Errors
/// The file is shorter than a seal, is no checkpoint, was written by a newer program, or was changed since.
pub(super) fn check(path: &Path, file: &mut File) -> Result<(), IoError> {
    let reading = |e| IoError::reading(path, e);
    let length = file.metadata().map_err(reading)?.len();
    if length < LENGTH as u64 {
        return Err(damaged(path, "start", format!("the file holds only {length} bytes")));
    }
    let mut found = [0; LENGTH];
    file.seek(SeekFrom::Start(0)).and_then(|_| file.read_exact(&mut found)).map_err(reading)?;
    let version = version(&found).ok_or_else(|| damaged(path, "start", "not a checkpoint".into()))?;
    if version > FORMAT_VERSION {
        return Err(IoError::data(
            path,
            "format version",
            format!("it has version {version}; this program reads up to {FORMAT_VERSION}"),
            "continue with the newer program that wrote it, or start over with --overwrite",
        ));
    }
    let (bytes, hash) = measure(file).map_err(reading)?;
    if found == text(version, bytes, &hash) {
        return Ok(());
    }
    let what = match recorded_length(&found) {
        Some(recorded) if recorded != bytes => format!("it has {bytes} bytes, but {recorded} were written"),
        _ => "its content differs from what was written (SHA-256)".into(),
    };
    Err(damaged(path, "content", what))
}

/// Content that cannot be used, and what to do.
pub fn damaged(path: &Path, place: &str, what: String) -> IoError {
    IoError::data(path, place, what, USE_EARLIER)
}

/// Number in the first line.
fn version(seal: &[u8]) -> Option<u32> {
    let digits = seal.strip_prefix(MAGIC.as_bytes())?.split(|byte| *byte == b'\n').next()?;
    std::str::from_utf8(digits).ok()?.parse().ok()
}

/// Number in the second line.
fn recorded_length(seal: &[u8]) -> Option<u64> {
    let line = seal.split(|byte| *byte == b'\n').nth(1)?;
    std::str::from_utf8(line.strip_prefix(b"bytes ")?).ok()?.parse().ok()
}

/// Length of the file and SHA-256 of what follows the seal.
fn measure(file: &mut File) -> std::io::Result<(u64, String)> {
    file.seek(SeekFrom::Start(LENGTH as u64))?;
    let (mut hasher, mut bytes) = (Sha256::new(), LENGTH as u64);
    let mut buffer = vec![0; BLOCK];
    loop {
        match file.read(&mut buffer) {
            Ok(0) => return Ok((bytes, hex(&hasher.finalize()))),
            Ok(count) => {
                bytes += count as u64;
                hasher.update(&buffer[..count]);
            }
            Err(e) if e.kind() == std::io::ErrorKind::Interrupted => {}
            Err(e) => return Err(e),
        }
    }
}

/// The seal, filled up with zeros.
fn text(version: u32, bytes: u64, hash: &str) -> [u8; LENGTH] {
    let mut seal = [0; LENGTH];
    let text = format!("{MAGIC}{version}\nbytes {bytes}\nsha256 {hash}\n");
    seal[..text.len()].copy_from_slice(text.as_bytes());
    seal
}
