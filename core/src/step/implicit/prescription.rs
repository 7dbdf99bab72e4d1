//! Velocities and positions that pins, contacts and held vertices prescribe in a stage of an implicit step.

use crate::Vec3;
use crate::contact::bodies::active_set::{ActiveContact, ActiveSet};
use crate::contact::bodies::recovery_speed::RecoverySpeed;
use crate::parallel::for_each_part::PerVertex;
use crate::parallel::parts::Parts;
use crate::pins::{HardPins, PinTargets};
use crate::solve::implicit_velocity::stop_held;
use crate::solve::preconditioned_cg::Projection;

/// Motion prescribed in a stage.
pub(in crate::step) struct Prescription<'a> {
    pub(super) parts: &'a Parts,
    pub(super) pins: Option<&'a HardPins>,
    pub(super) targets: &'a PinTargets,
    pub(super) recovery_speed: RecoverySpeed,
    pub(super) held: &'a [u32],
    pub(super) active: &'a ActiveSet,
}

impl Prescription<'_> {
    /// Gives the velocities that are prescribed.
    pub(in crate::step) fn set_velocities(
        &self,
        v: &mut [Vec3],
        of_contact: impl Fn(&ActiveContact, &mut Vec3) + Sync,
    ) {
        self.set_own_velocities(v, of_contact);
        self.parts.halo().update(self.parts.ranks(), v);
    }

    /// The same of own vertices alone.
    pub(in crate::step) fn set_own_velocities(
        &self,
        v: &mut [Vec3],
        of_contact: impl Fn(&ActiveContact, &mut Vec3) + Sync,
    ) {
        self.parts.for_each(PerVertex(&mut v[self.parts.own()]), &|part, v| {
            let start = self.parts.ranges()[part].start;
            self.active.of_part(part).iter().for_each(|contact| of_contact(contact, &mut v.0[contact.vertex - start]));
            if let Some(pins) = self.pins {
                pins.set_velocities(part, start, self.targets, v.0);
            }
            stop_held(self.held, start, v.0);
        });
    }

    /// Gives own vertices the positions that are prescribed at a fraction of the step that began at `x`, and ghosts the positions and
    /// velocities of their owners.
    pub(in crate::step) fn set_positions(&self, fraction: f64, x: &[Vec3], [x_stage, v_stage]: [&mut Vec<Vec3>; 2]) {
        self.parts.for_each(PerVertex(&mut x_stage[self.parts.own()]), &|part, x_stage| {
            let range = self.parts.ranges()[part].clone();
            for contact in self.active.of_part(part) {
                let value = &mut x_stage.0[contact.vertex - range.start];
                contact.prescribe_position(value, &x[contact.vertex], fraction);
            }
            if let Some(pins) = self.pins {
                let (start, speed) = (range.start, self.recovery_speed);
                pins.set_stage_positions(part, start, self.targets, speed, fraction, (&x[range], x_stage.0));
            }
        });
        self.parts.halo().update_all(self.parts.ranks(), &mut [x_stage, v_stage]);
    }
}

impl Projection for Prescription<'_> {
    fn project(&self, part: usize, r: &mut [Vec3]) {
        let start = self.parts.ranges()[part].start;
        self.active.project(part, start, r);
        if let Some(pins) = self.pins {
            pins.project(part, start, self.targets, r);
        }
        stop_held(self.held, start, r);
    }
}
