//! USD stages, text, binary or package: what `info` looks at, and meshes as bodies and garments use them.
//!
//! A panic of the library that composes stages is an answer (`io/usd/src/read/worker.rs`), so only those elsewhere are findings,
//! and every demand for too much memory.

use std::sync::Once;

use crate::{memory, scratch};
use drapery_io::formats;

/// Panics that are answered do not end the process.
pub(super) fn let_answers_pass() {
    static DONE: Once = Once::new();
    DONE.call_once(|| {
        let ends = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |panic| {
            if !formats::answers_panics() || panic.to_string().contains(memory::REFUSAL) {
                ends(panic);
            }
        }));
    });
}

/// Reads one input.
pub fn run(data: &[u8]) {
    let_answers_pass();
    let name = if data.starts_with(b"PK") { "stage.usdz" } else { "stage.usd" };
    let path = scratch::file(name, data);
    memory::bounded(|| {
        let _ = formats::inspect(&path);
        let Ok(mesh) = formats::open_mesh(&path, None) else { return };
        let mut positions = Vec::new();
        for time in [-1.0, 0.0, 0.05, 1.0 / 24.0, 1e9] {
            let read = mesh.mesh_at(time);
            let _ = mesh.connectivity_at(time);
            if let Ok(data) = read {
                let _ = data.mesh.triangulate();
                let mut corners = Vec::new();
                mesh.positions_at(time, &mut positions).expect("points of a mesh that was read");
                mesh.faces_at(time, &mut |_, piece| corners.extend_from_slice(piece))
                    .expect("faces of a mesh that was read");
                assert_eq!((positions.len(), corners), (data.mesh.points.len(), data.mesh.face_indices.clone()));
            }
        }
        let _ = (mesh.stated_units(), mesh.other_files(), mesh.notes());
    });
}
