//! What is measured at the end of a frame, over all ranks.

use std::sync::Arc;

use super::recovery::is_finite;
use super::{BrokenAttachment, FrameSummary, Simulation, StrainRecord};
use crate::contact::self_contact::SelfContact;
use crate::effects::force::{ForceContext, PartView};
use crate::error::StepError;
use crate::parallel::reduce::weighted_dot;
use crate::state::State;
use crate::step::Dynamics;

impl Simulation {
    /// Fills in what is measured at the end of a frame, and makes sure that everything is finite.
    pub(super) fn measure(&mut self, summary: &mut FrameSummary) -> Result<(), StepError> {
        let (scene, ranks) = (Arc::clone(&self.scene), self.ranks().clone());
        let parts = scene.parts();
        if ranks.any(!parts.own().all(|i| is_finite(&self.cloth.state.x[i]) && is_finite(&self.cloth.state.v[i]))) {
            return Err(self.not_finite("end of frame", summary.frame, summary.dt_max));
        }
        let masses = scene.masses();
        self.dynamics.volumes.update(parts, &self.cloth.state.x);
        let around = self.surroundings();
        let (mut kinetic, mut potential) = (Vec::new(), Vec::new());
        for (range, forces) in parts.ranges().iter().zip(&self.dynamics.forces) {
            let (own, v) = (&masses[range.clone()], &self.cloth.state.v[range.clone()]);
            kinetic.push(0.5 * weighted_dot(own, v, v));
            let view = PartView { start: range.start, masses: own, x: &self.cloth.state.x, fraction: 1.0, around };
            potential.push(forces.iter().map(|f| f.energy(&view)).sum());
        }
        [summary.kinetic_energy, summary.potential_energy] = parts.join_parts(&[&kinetic, &potential]);
        summary.max_strain = self.largest_strain();
        summary.between_pins = self.strain_between_pins();
        self.crossings = self.find_crossings();
        if self.contacts.cloth.as_ref().is_some_and(SelfContact::keeps_free) {
            self.metrics.count_once(&ranks, "crossings", self.crossings.len() as u64);
        }
        summary.broken = self.broken_in(summary.frame);
        summary.body_self_crossings = self.prescribed.bodies.self_crossings() as u64;
        let turned = self.prescribed.bodies.turned() as u64;
        if turned > 0 {
            self.metrics.count_once(&ranks, "body_inside_out", turned);
        }
        self.count_traffic();
        self.take_counts();
        summary.metrics = self.metrics.take().over_ranks(&ranks);
        summary.recoveries = std::mem::take(&mut self.retry.events);
        Ok(())
    }

    /// What forces may look at besides positions, now.
    pub(super) fn surroundings(&self) -> ForceContext<'_> {
        let (State { time, v, .. }, Dynamics { wind, volumes, .. }) = (&self.cloth.state, &self.dynamics);
        ForceContext { time: *time, targets: &self.prescribed.targets, v, wind, volumes }
    }

    /// Takes what forces have counted.
    pub(super) fn take_counts(&mut self) {
        let Self { dynamics: Dynamics { forces, .. }, metrics, .. } = self;
        let mut add = |name, amount| metrics.count(name, amount);
        forces.iter_mut().flatten().for_each(|force| force.take_counts(&mut add));
    }

    /// Attachments of all ranks that broke on the way to a frame, by pin and vertex.
    fn broken_in(&self, frame: i64) -> Vec<BrokenAttachment> {
        let description = self.scene.description();
        if description.pins.iter().all(|pin| pin.hold.break_force().is_none()) {
            return Vec::new();
        }
        let (parts, timeline) = (self.scene.parts(), description.timeline);
        let here = self.prescribed.targets.broken_between(timeline.time(frame - 1), timeline.time(frame)).into_iter();
        let here: Vec<[u64; 3]> = here
            .map(|(vertex, pin)| {
                let (garment, own) = parts.own_vertex(vertex);
                [pin as u64, garment as u64, own.into()]
            })
            .collect();
        let mut all = self.ranks().all_gather_v(&here).concat();
        all.sort_unstable();
        let named = |[pin, garment, vertex]: [u64; 3]| BrokenAttachment {
            garment: description.garments[garment as usize].name.clone(),
            vertex: vertex as u32,
            pin: pin as usize,
        };
        all.into_iter().map(named).collect()
    }

    /// The most stretched edge of all ranks; among equal ones that with the smallest numbers.
    pub(super) fn largest_strain(&self) -> Option<StrainRecord> {
        self.largest_of(self.dynamics.forces.iter().flatten().filter_map(|f| f.largest_strain(&self.cloth.state.x)))
    }

    /// The most stretched of these edges of all ranks, given by strain and local vertices; likewise.
    pub(super) fn largest_of(&self, all: impl Iterator<Item = (f64, [usize; 2])>) -> Option<StrainRecord> {
        let (parts, ranks) = (self.scene.parts(), self.ranks());
        let numbered = all.map(|(strain, ends)| {
            let mut numbers = ends.map(|local| parts.number(local));
            numbers.sort_unstable();
            (strain, numbers, ends)
        });
        let larger =
            |a: &(f64, [u32; 2], [usize; 2]), b: &(f64, [u32; 2], [usize; 2])| a.0.total_cmp(&b.0).then(b.1.cmp(&a.1));
        let here = numbered.max_by(larger).map(|(strain, numbers, ends)| {
            let (garment, a) = parts.own_vertex(ends[0]);
            let (_, b) = parts.own_vertex(ends[1]);
            // Bits of the strain, and what orders and names it.
            [strain.to_bits(), numbers[0].into(), numbers[1].into(), garment as u64, a.min(b).into(), a.max(b).into()]
        });
        let all = ranks.all_gather_v(here.as_slice()).concat();
        let strain = |found: &[u64; 6]| f64::from_bits(found[0]);
        let order = |a: &[u64; 6], b: &[u64; 6]| strain(a).total_cmp(&strain(b)).then(b[1..3].cmp(&a[1..3]));
        let found = all.into_iter().max_by(order)?;
        let garment = &self.scene.description().garments[found[3] as usize];
        let vertices = [found[4] as usize, found[5] as usize].map(|v| v as u32);
        Some(StrainRecord { garment: garment.name.clone(), vertices, strain: strain(&found) })
    }

    /// Counts what this rank has sent since the last frame.
    fn count_traffic(&mut self) {
        let sent = self.ranks().sent();
        let before = std::mem::replace(&mut self.sent, sent);
        if !self.ranks().is_alone() {
            self.metrics.count("messages", sent.messages - before.messages);
            self.metrics.count("bytes_sent", sent.bytes - before.bytes);
            self.metrics.count_once(
                &self.scene.parts().ranks().clone(),
                "collectives",
                sent.collectives - before.collectives,
            );
        }
    }

    /// The first vertex of all ranks whose numbers are no longer finite. All ranks call it together.
    pub(super) fn not_finite(&self, stage: &'static str, frame: i64, dt: f64) -> StepError {
        let parts = self.scene.parts();
        let broken = parts.own().find(|&i| !is_finite(&self.cloth.state.x[i]) || !is_finite(&self.cloth.state.v[i]));
        let here = broken.map(|i| {
            let (garment, vertex) = parts.own_vertex(i);
            [u64::from(parts.number(i)), garment as u64, vertex.into()]
        });
        let all = self.ranks().all_gather_v(here.as_slice()).concat();
        let [_, garment, vertex] = all.into_iter().min().unwrap_or_default();
        StepError::NotFinite {
            garment: self.scene.description().garments[garment as usize].name.clone(),
            vertex: vertex as usize,
            frame,
            time: self.cloth.state.time,
            stage,
            dt,
        }
    }
}
