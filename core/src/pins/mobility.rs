//! Inverse masses per axis, with what pins hold: one for all that gives impulses to vertices.

use crate::Vec3;
use crate::parallel::parts::Parts;
use crate::pins::hard::HardPins;
use crate::pins::targets::PinTargets;

/// Inverse masses of the local vertices by axis [1/kg], zero where hard pins hold in the present step. Empty where nobody
/// looks.
#[derive(Debug, Default)]
pub(crate) struct Mobility(Vec<Vec3>);

impl Mobility {
    /// Returns the mobility of vertices with these masses [kg] that nothing holds.
    pub(crate) fn new(masses: &[f64]) -> Self {
        Self(masses.iter().map(|mass| Vec3::repeat(1.0 / mass)).collect())
    }

    /// Returns the inverse masses by axis, over the local vertices [1/kg].
    pub(crate) fn of_vertices(&self) -> &[Vec3] {
        &self.0
    }

    /// Takes what pins hold in the present step, of own vertices.
    pub(crate) fn set_step(&mut self, masses: &[f64], pins: &HardPins, targets: &PinTargets) {
        if self.0.is_empty() {
            return;
        }
        pins.vertices().for_each(|vertex| self.0[vertex] = Vec3::repeat(1.0 / masses[vertex]));
        for (vertex, _, axes) in pins.axes().filter(|(_, target, _)| targets.is_active(*target)) {
            (0..3).filter(|axis| axes[*axis]).for_each(|axis| self.0[vertex][axis] = 0.0);
        }
    }

    /// Gives ghosts those of their owners. All ranks call it together.
    pub(crate) fn update_ghosts(&mut self, parts: &Parts) {
        parts.halo().update(parts.ranks(), &mut self.0);
    }
}
