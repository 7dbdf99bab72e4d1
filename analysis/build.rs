//! Puts the library of the page of `drapery view` into the crate: `viewer/library/three.js`, which `viewer/library/build.sh` makes.
//! Without it the crate builds all the same, and `drapery view` says how to get it.

use std::path::{Path, PathBuf};

fn main() -> std::io::Result<()> {
    // The folder and not the file: a file that is not there would build the crate again every time.
    println!("cargo::rerun-if-changed=viewer/library");
    let library = Path::new("viewer/library/three.js");
    let text = if library.is_file() { std::fs::read_to_string(library)? } else { String::new() };
    let folder = PathBuf::from(std::env::var_os("OUT_DIR").unwrap_or_default());
    std::fs::write(folder.join("three.js"), text)
}
