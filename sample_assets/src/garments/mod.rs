//! Garments cut from offset surfaces of the body in its rest pose. The rest shape is the shape at the first frame.

mod skirt;
mod trousers;
mod tshirt;

pub use skirt::{Skirt, skirt};
pub use trousers::trousers;
pub use tshirt::tshirt;

use std::collections::BTreeMap;

use crate::sdf::Vec3;
use crate::surface_mesh::SurfaceMesh;

/// Distance of the skirt's and the trousers' waist from the body \[m\].
pub const WAIST_GAP: f64 = 0.006;
/// Height of the waist ring of skirt and trousers in the rest pose \[m\].
pub const WAIST_HEIGHT: f64 = 1.035;

/// A garment as an artist hands it over.
#[derive(Debug, Clone)]
pub struct Garment {
    /// Name of the object and of its files.
    pub name: &'static str,
    /// The cloth \[m\], counter-clockwise seen from outside.
    pub mesh: SurfaceMesh,
    /// Texture coordinates; 1 unit is 1 m of cloth.
    pub uvs: Vec<[f64; 2]>,
    /// Texture coordinate of each corner of each face.
    pub uv_corners: Vec<Vec<usize>>,
    /// Named sets of faces; every face is in one of them.
    pub face_sets: Vec<(&'static str, Vec<usize>)>,
    /// Vertices of the waist ring that hold to the body; empty if the garment hangs by itself.
    pub waist_ring: Vec<usize>,
}

/// Face set and chart that a face gets from its place.
struct Panel {
    /// Its face set.
    set: usize,
    /// Its chart of texture coordinates.
    chart: usize,
}

/// Sorts the faces into panels by their centres and lays the panels flat: corners of one vertex in one chart share a
/// coordinate, and charts meet in seams.
fn panelled(
    name: &'static str,
    mesh: SurfaceMesh,
    sets: &[&'static str],
    panel: impl Fn(&Vec3) -> Panel,
    flatten: impl Fn(usize, &Vec3) -> [f64; 2],
) -> Garment {
    let mut uvs = Vec::new();
    let mut known: BTreeMap<(usize, usize), usize> = BTreeMap::new();
    let mut face_sets: Vec<(&'static str, Vec<usize>)> = sets.iter().map(|set| (*set, Vec::new())).collect();
    let mut uv_corners = Vec::new();
    for (i, face) in mesh.faces.iter().enumerate() {
        let center = face.iter().map(|&v| mesh.points[v]).sum::<Vec3>() / face.len() as f64;
        let Panel { set, chart } = panel(&center);
        face_sets[set].1.push(i);
        let mut corner = |&v: &usize| {
            *known.entry((chart, v)).or_insert_with(|| {
                uvs.push(flatten(chart, &mesh.points[v]));
                uvs.len() - 1
            })
        };
        uv_corners.push(face.iter().map(&mut corner).collect());
    }
    Garment { name, mesh, uvs, uv_corners, face_sets, waist_ring: Vec::new() }
}

/// Vertices of the opening whose mean height is greatest: the waist of skirt and trousers.
fn highest_ring(mesh: &SurfaceMesh) -> Vec<usize> {
    let height = |ring: &Vec<usize>| ring.iter().map(|&v| mesh.points[v].y).sum::<f64>() / ring.len() as f64;
    mesh.boundary_loops().into_iter().max_by(|a, b| height(a).total_cmp(&height(b))).unwrap_or_default()
}
