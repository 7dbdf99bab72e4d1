//! Painted maps: a value for each vertex of a garment, for a quantity that otherwise is the same everywhere.

use std::collections::BTreeMap;

use crate::scene::{GarmentDescription, PinHold, Pinned, Scene};

/// Values of one quantity over the vertices of a garment.
///
/// ```
/// use drapery_core::PaintedMap;
/// let share = PaintedMap { values: vec![0.0, 0.5, 1.0], absolute: false };
/// let number = PaintedMap { absolute: true, ..share.clone() };
/// assert_eq!((share.at(1, 200.0), number.at(1, 200.0)), (100.0, 0.5));
/// ```
#[derive(Debug, Clone, PartialEq, Default)]
pub struct PaintedMap {
    /// One for each vertex in the garment's own order; not negative.
    pub values: Vec<f64>,
    /// Whether values take the place of the number for the whole garment, in its SI unit; otherwise they multiply it.
    pub absolute: bool,
}

/// Maps of a garment by what they are of.
pub type PaintedMaps = BTreeMap<String, PaintedMap>;

/// Frames and maps, ascending: values are straight between keys, constant before the first and after the last.
pub type MapCurve = Vec<(f64, PaintedMap)>;

/// Maps of a garment that change over time, by what they are of.
pub type MapCurves = BTreeMap<String, MapCurve>;

/// Name under which ranks are handed a key of a map that changes over time.
pub(crate) fn column(of: &str, key: usize) -> String {
    format!("{of} {key}")
}

/// The keys of a curve before and after a frame, and the share of the second: both the same where the frame is at a key or beyond all.
fn around(curve: &MapCurve, frame: f64) -> Option<([usize; 2], f64)> {
    let last = curve.len().checked_sub(1)?;
    let next = curve.partition_point(|(key, _)| *key <= frame);
    Some(match next {
        0 => ([0, 0], 0.0),
        _ if next > last => ([last, last], 0.0),
        _ => ([next - 1, next], (frame - curve[next - 1].0) / (curve[next].0 - curve[next - 1].0)),
    })
}

/// A map between two keys.
fn between(before: &PaintedMap, after: &PaintedMap, share: f64) -> PaintedMap {
    let values = before.values.iter().zip(&after.values).map(|(a, b)| a + (b - a) * share).collect();
    PaintedMap { values, absolute: before.absolute }
}

impl PaintedMap {
    /// The quantity at a vertex, of which the whole garment has `of_garment`.
    pub fn at(&self, vertex: usize, of_garment: f64) -> f64 {
        if self.absolute { self.values[vertex] } else { of_garment * self.values[vertex] }
    }

    /// The mean of the quantity at some vertices.
    pub(crate) fn mean(&self, vertices: &[u32], of_garment: f64) -> f64 {
        vertices.iter().map(|v| self.at(*v as usize, of_garment)).sum::<f64>() / vertices.len() as f64
    }
}

impl GarmentDescription {
    /// Puts the maps that change over time to a frame, of a description whose keys have their values.
    pub(crate) fn set_maps_at(&mut self, frame: f64) {
        for (of, curve) in &self.map_curves {
            let Some(([a, b], share)) = around(curve, frame) else { continue };
            self.maps.insert(of.clone(), between(&curve[a].1, &curve[b].1, share));
        }
    }
}

impl Scene {
    /// Puts the maps that change over time to a frame; returns whether that changes some of any rank.
    pub(crate) fn set_maps_at(&mut self, frame: f64) -> bool {
        let mut changes = false;
        for (garment, painted) in self.description.garments.iter().zip(&mut self.painted) {
            for (of, curve) in &garment.map_curves {
                let Some((keys, share)) = around(curve, frame) else { continue };
                let [Some(a), Some(b)] = keys.map(|key| painted.get(&column(of, key))) else { continue };
                let map = between(a, b, share);
                changes |= painted.get(of) != Some(&map);
                painted.insert(of.clone(), map);
            }
        }
        self.parts.ranks().any(changes)
    }

    /// A map of a garment over the vertices of this rank's piece of its mesh, if it is painted.
    pub(crate) fn painted(&self, garment: usize, of: &str) -> Option<&PaintedMap> {
        self.painted[garment].get(of)
    }

    /// The mean of a garment's quantity at some vertices of its mesh, or what the whole garment has if it is not painted.
    #[cfg(feature = "effects")]
    pub(crate) fn painted_mean(&self, garment: usize, of: &str, vertices: &[u32], of_garment: f64) -> f64 {
        self.painted(garment, of).map_or(of_garment, |map| map.mean(vertices, of_garment))
    }

    /// Returns a factor and an offset for each local vertex: a quantity of all garments, multiplied by the factor and increased
    /// by the offset, is the quantity of the vertex. `None` if no garment has it painted.
    pub(crate) fn painted_everywhere(&self, of: &str) -> Option<Vec<[f64; 2]>> {
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

    /// Stiffness of the spring of a pinned vertex [N/m]; zero for one that is held hard.
    pub(crate) fn pin_stiffness(&self, pinned: &Pinned) -> f64 {
        let PinHold::Spring { stiffness, .. } = self.description().pins[pinned.pin].hold else { return 0.0 };
        self.painted_at_pin(pinned, "pins", stiffness)
    }

    /// Damping of the spring of a pinned vertex as a fraction of critical; zero for one that is held hard.
    #[cfg(feature = "effects")]
    pub(crate) fn pin_damping_ratio(&self, pinned: &Pinned) -> f64 {
        let PinHold::Spring { damping_ratio, .. } = self.description().pins[pinned.pin].hold else { return 0.0 };
        self.painted_at_pin(pinned, "pin_damping", damping_ratio)
    }

    /// Force at which the spring of a pinned vertex breaks [N]; infinite for one that never does.
    pub(crate) fn pin_break_force(&self, pinned: &Pinned) -> f64 {
        let force = self.description().pins[pinned.pin].hold.break_force();
        force.map_or(f64::INFINITY, |force| self.painted_at_pin(pinned, "break_force", force))
    }

    /// A quantity of a pin, as painted at one of its vertices if it is.
    fn painted_at_pin(&self, pinned: &Pinned, of: &str, of_pin: f64) -> f64 {
        let garment = self.description().pins[pinned.pin].garment;
        let vertex = pinned.vertex as usize - self.parts().garment(garment).start;
        self.painted(garment, of).map_or(of_pin, |map| map.at(vertex, of_pin))
    }
}
