//! Crossings of the frames as they are stored: rounded to the file's `f32` in the file's unit, cloth that is free of
//! crossings in the solver's doubles might touch.

use drapery_core::Vec3;
use drapery_core::geometry::crossings::{CrossingSearch, find};
use drapery_core::simulation::Simulation;

use crate::units::Units;

/// Effect whose promise this check proves; without it nothing is looked at.
const EFFECT: &str = "self_collision";

/// Counts crossings of all garments of a scene, each with itself and with the others.
#[derive(Debug)]
pub(super) struct WrittenCrossings {
    units: Units,
    search: CrossingSearch,
    positions: Vec<Vec3>,
}

impl WrittenCrossings {
    /// The check for caches in `units`, if the scene promises cloth without crossings.
    pub(super) fn new(simulation: &Simulation, units: Units) -> Option<Self> {
        let scene = simulation.scene();
        if !scene.description().effects.iter().any(|request| request.effect == EFFECT) {
            return None;
        }
        let (mut triangles, mut all, mut positions) = (Vec::new(), Vec::new(), Vec::new());
        for (garment, mesh) in scene.meshes().iter().enumerate() {
            let first = all.len() as u32;
            triangles.extend(mesh.triangles().iter().map(|t| t.map(|v| v + first)));
            simulation.garment_positions(garment, &mut positions);
            all.extend_from_slice(&positions);
        }
        Some(Self { units, search: CrossingSearch::new(triangles, all), positions })
    }

    /// Number of pairs of an edge and a triangle that meet in the frame that the simulation stands at, as it is stored.
    pub(super) fn crossings_of_written(&mut self, simulation: &Simulation) -> u32 {
        let mut all = Vec::with_capacity(self.search.surface().positions.len());
        for garment in 0..simulation.scene().meshes().len() {
            simulation.garment_positions(garment, &mut self.positions);
            all.extend(self.positions.iter().map(|p| Vec3::from(self.units.stored(*p).map(f64::from))));
        }
        self.search.place(all);
        u32::try_from(find(&self.search.surface()).len()).unwrap_or(u32::MAX)
    }
}
