//! Scene files, with the meshes and pins that they may name, up to a shot that is ready to run. Generated garments are
//! kept small by `cfg(fuzzing)`: that a fine mesh takes memory is no finding.

use std::sync::Once;

use crate::{memory, scratch};
use drapery_io::scene_file;
use drapery_shot::Shot;

/// A pin file for the house.
const PINS: &str = "{\"body\":\"m.obj\",\"pins\":[{\"vertex\":1,\"body_vertices\":[0,1,2],\"weights\":[0.2,0.3,0.5],\
                    \"offset_tangent_bitangent_normal\":[0,0,0.01]}]}";

/// Files that inputs may name; they are small and good.
const FILES: [(&str, &[u8]); 3] = [
    ("m.obj", include_bytes!("../../corpus/obj/house.obj")),
    ("m.abc", include_bytes!("../../corpus/alembic/small.abc")),
    ("p.json", PINS.as_bytes()),
];

/// Reads one input.
pub fn run(data: &[u8]) {
    static WRITTEN: Once = Once::new();
    WRITTEN.call_once(|| FILES.iter().for_each(|(name, content)| drop(scratch::file(name, content))));
    let Ok(text) = std::str::from_utf8(data) else { return };
    // What stands behind a line of dashes is a --set argument.
    let (text, set) = text.split_once("\n---\n").unwrap_or((text, ""));
    let overrides: Vec<(String, String)> =
        set.lines().filter_map(|line| line.split_once('=')).map(|(k, v)| (k.to_owned(), v.to_owned())).collect();
    memory::bounded(|| {
        let scene = match scene_file::parse(text, "scene.toml", scratch::folder(), &overrides) {
            Ok(scene) => scene,
            Err(error) => return drop(error.to_string()),
        };
        match scene.resolve() {
            Ok(shot) => drop(Shot::prepare(shot, None).map_err(|error| error.to_string())),
            Err(errors) => errors.iter().for_each(|error| drop(error.to_string())),
        }
    });
}
