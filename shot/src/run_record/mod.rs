//! Files that a run leaves beside its caches: `manifest.json` (the inventory, replaced as a whole after every frame)
//! and `run.jsonl` (one line a frame with everything that was measured), written and read again.

pub mod folder;
pub mod manifest;
pub mod reader;
pub mod strains;
pub(crate) mod writer;

/// File name of the manifest; a folder that has one holds a run.
pub const MANIFEST: &str = "manifest.json";

/// File name of the record.
pub const RECORD: &str = "run.jsonl";

/// File name of the scene with every default written out.
pub const RESOLVED: &str = "resolved.toml";

/// File name of what the run depends on, by which a changed scene or input is noticed.
pub(crate) const FINGERPRINT: &str = "fingerprint.json";
