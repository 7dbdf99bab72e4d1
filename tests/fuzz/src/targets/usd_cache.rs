//! Our own caches in USD, layer by layer: the text of a garment, what does not move, and the clips of its samples, one behind the
//! other with [`BETWEEN`] in between. They are read without composition, so no panic is an answer but those of the stages that a
//! layer of somebody else is read as.

use std::fs;

use super::usd::let_answers_pass;
use crate::{memory, scratch};
use drapery_analysis::verify::verify;
use drapery_io::cache_frames::CacheFrames;

/// Separator of the layers of an input.
pub const BETWEEN: &[u8] = b"\0--\0";

/// Folder of what does not move and of clips, as the text of a seed names it.
pub const FOLDER: &str = "cloth.clips/d";

/// Layers in [`FOLDER`]: static data, a frame, a sample behind the frame. Inputs may end before the last.
pub const LAYERS: [&str; 3] = ["topology.usdc", "0001.usdc", "0001_1.usdc"];

/// Reads one input.
pub fn run(data: &[u8]) {
    let_answers_pass();
    let mut layers = split(data).into_iter();
    let path = scratch::file("cloth.usd", layers.next().unwrap_or_default());
    let folder = scratch::folder().join(FOLDER);
    fs::create_dir_all(&folder).expect("the folder for temporary files can be written to");
    for name in LAYERS {
        fs::write(folder.join(name), layers.next().unwrap_or_default()).expect("there is room for a small file");
    }
    memory::bounded(|| {
        let _ = verify(&[path.as_path()], None);
        let Ok(cache) = CacheFrames::open(&path) else { return };
        for (mesh, described) in cache.meshes.iter().enumerate() {
            let _ = cache.attributes(mesh);
            for sample in 0..(described.frames.len() + described.between.len()).min(4) {
                let _ = (cache.positions(mesh, sample), cache.velocities(mesh, sample));
                if let (Ok(stored), Ok(Some(shifted))) =
                    (cache.samples.frame(mesh, sample), cache.stored_positions(mesh, sample))
                {
                    assert_eq!(stored.positions.len(), shifted.points.len());
                }
            }
        }
        let _ = (cache.samples.check_constants(), cache.samples.check_complete(None));
    });
}

fn split(data: &[u8]) -> Vec<&[u8]> {
    let (mut layers, mut rest) = (Vec::new(), data);
    while let Some(at) = rest.windows(BETWEEN.len()).position(|window| window == BETWEEN) {
        layers.push(&rest[..at]);
        rest = &rest[at + BETWEEN.len()..];
    }
    layers.push(rest);
    layers
}
