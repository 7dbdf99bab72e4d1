//! Record of a commit, kept to go on after it.

/// A commit of an archive: enough to return to it, whatever was written after it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ArchiveMark {
    /// Position of the root group [bytes from the start of the file].
    pub root: u64,
    /// First byte behind the commit.
    pub end: u64,
    /// Digest of the tables, and through the digests in them of all samples.
    pub digest: [u8; 16],
}
