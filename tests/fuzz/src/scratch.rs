//! Files for readers that take a path: in memory where the system has such a folder, one per process.

use std::path::{Path, PathBuf};
use std::sync::OnceLock;

/// A folder in memory.
const MEMORY: &str = "/dev/shm";

/// The folder of this process.
pub fn folder() -> &'static Path {
    static FOLDER: OnceLock<PathBuf> = OnceLock::new();
    FOLDER.get_or_init(|| {
        let memory = Path::new(MEMORY);
        let parent = if memory.is_dir() { memory.to_owned() } else { std::env::temp_dir() };
        let folder = parent.join(format!("drapery-fuzz-{}", std::process::id()));
        std::fs::create_dir_all(&folder).expect("the folder for temporary files can be written to");
        folder
    })
}

/// Writes a file into the folder.
pub fn file(name: &str, content: &[u8]) -> PathBuf {
    let path = folder().join(name);
    std::fs::write(&path, content).expect("there is room for a small file");
    path
}
