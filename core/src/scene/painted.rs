//! Painted maps: a value for each vertex of a garment, for a quantity that otherwise is the same everywhere.

use std::collections::BTreeMap;

use crate::scene::Scene;

/// What can be painted, and the effects of which one has to look at it; none for what every garment has.
pub const MAPS: &[(&str, &[&str])] = &[
    ("density", &[]),
    ("thickness", &["self_repulsion"]),
    ("self_friction", &["self_repulsion"]),
    ("friction", &["body_collision"]),
    ("stretch", &["stretch"]),
    ("shear", &["shear"]),
    ("membrane", &["membrane"]),
    ("bending", &["bending"]),
    ("dihedral_bending", &["dihedral_bending"]),
    ("strain_limit", &["strain_limit"]),
    ("pins", &["attachments"]),
    ("wind", &["wind"]),
    ("ether_drag", &["ether_drag"]),
];

/// Maps of what has several numbers: they can only be shares of what the effect does.
pub const SHARES: &[&str] = &["membrane", "wind"];

/// Values of one quantity over the vertices of a garment.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct PaintedMap {
    /// One for each vertex in the garment's own order; not negative.
    pub values: Vec<f64>,
    /// Whether values take the place of the number for the whole garment, in its SI unit; otherwise they multiply it.
    pub absolute: bool,
}

/// Maps of a garment by what they are of.
pub type PaintedMaps = BTreeMap<String, PaintedMap>;

impl PaintedMap {
    /// The quantity at a vertex, of which the whole garment has `of_garment`.
    pub fn at(&self, vertex: usize, of_garment: f64) -> f64 {
        if self.absolute { self.values[vertex] } else { of_garment * self.values[vertex] }
    }

    /// The mean of the quantity at some vertices.
    pub fn mean(&self, vertices: &[u32], of_garment: f64) -> f64 {
        vertices.iter().map(|v| self.at(*v as usize, of_garment)).sum::<f64>() / vertices.len() as f64
    }
}

impl Scene {
    /// A map of a garment over the vertices of this rank's piece of its mesh, if it is painted.
    pub fn painted(&self, garment: usize, of: &str) -> Option<&PaintedMap> {
        self.painted[garment].get(of)
    }

    /// What turns a quantity of all garments into that of each local vertex: it is multiplied by the first number, and the second
    /// is added. `None` if no garment has it painted.
    pub fn painted_everywhere(&self, of: &str) -> Option<Vec<[f64; 2]>> {
        if self.painted.iter().all(|maps| !maps.contains_key(of)) {
            return None;
        }
        let mut all = vec![[1.0, 0.0]; self.parts.local_count()];
        for (garment, maps) in self.painted.iter().enumerate() {
            let Some(map) = maps.get(of) else { continue };
            for (vertex, value) in self.parts.garment(garment).zip(&map.values) {
                all[vertex] = if map.absolute { [0.0, *value] } else { [*value, 0.0] };
            }
        }
        Some(all)
    }
}
