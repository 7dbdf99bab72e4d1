//! The thickness of curved bodies, where a scene does not say it.

use drapery_core::geometry::coarseness::{FaceSizes, Ridges};
use drapery_core::mesh::MeshStream;
use drapery_core::scene::{BodyDescription, SceneDescription};

use crate::garment_mesh::GarmentMesh;
use crate::shot_description::BodyThickness;

use super::SceneFile;
use super::tree::{Node, Origin, Path, Value};

/// Thicknesses are whole numbers of these parts of a metre.
const STEPS: f64 = 1e5;

/// The key.
const KEY: &str = "thickness";

/// Finds the thickness that the faces of each body and of the garments ask for; takes it where the scene says no
/// thickness, and the fabrics are no thicker. `ridges` holds the ridges of meshes and of round shapes. Garments are
/// read once more, one after the other, where there is such a body.
pub(super) fn of_bodies(
    root: &Node,
    ridges: Vec<Option<Ridges>>,
    garments: &[GarmentMesh],
    bodies: &mut [BodyDescription],
) -> Vec<Option<BodyThickness>> {
    if ridges.iter().all(Option::is_none) {
        return vec![None; ridges.len()];
    }
    // A garment that cannot be read is reported where it is handed out.
    let sizes: Vec<f64> = garments.iter().filter_map(face_size).collect();
    let mut found = Vec::new();
    for (index, ridges) in ridges.into_iter().enumerate() {
        let is_written = written(root, index);
        found.push(ridges.map(|ridges| {
            let needed = sizes.iter().map(|size| ridges.needed(*size)).fold(0.0, f64::max);
            BodyThickness { needed: (needed * STEPS).ceil() / STEPS, is_written }
        }));
    }
    for (body, found) in bodies.iter_mut().zip(&found) {
        if let Some(BodyThickness { needed, is_written: false }) = found {
            body.thickness = body.thickness.max(*needed);
        }
    }
    found
}

/// The scene with the thicknesses of bodies that were found.
pub(super) fn root(scene: &SceneFile, resolved: &SceneDescription, found: &[Option<BodyThickness>]) -> Node {
    let mut root = scene.root.clone();
    let Some(Value::Array(bodies)) = root.as_table_mut().and_then(|t| t.get_mut("body")).map(|node| &mut node.value)
    else {
        return root;
    };
    for ((node, body), found) in bodies.iter_mut().zip(&resolved.bodies).zip(found) {
        let is_found = found.is_some_and(|found| !found.is_written && found.needed == body.thickness);
        if let Some(node) = node.as_table_mut().and_then(|table| table.get_mut(KEY)).filter(|_| is_found) {
            (node.value, node.origin) = (Value::Float(body.thickness), Origin::Meshes);
        }
    }
    root
}

/// Whether a scene says the thickness of a body itself.
fn written(root: &Node, body: usize) -> bool {
    let node = Path::default().key("body").index(body).find(root).as_table().and_then(|table| table.get(KEY));
    node.is_some_and(|node| !matches!(node.origin, Origin::Default | Origin::Material(_)))
}

/// The diameter of the faces of a garment [m].
fn face_size(garment: &GarmentMesh) -> Option<f64> {
    let (points, mut sizes) = (garment.positions().ok()?, FaceSizes::default());
    garment.faces(&mut |counts, corners| sizes.add(counts, corners, &points)).ok()?;
    Some(sizes.largest())
}
