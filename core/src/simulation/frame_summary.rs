//! Summary of a frame: what is measured at its end, over all ranks.

use std::cmp::Ordering;
use std::sync::Arc;

use super::overstretched::Overstretched;
use super::recovery::{Recovery, is_finite};
use super::{Simulation, StrainRecord};
use crate::contact::self_contact::SelfContact;
use crate::effects::force::{ForceContext, PartView};
use crate::error::StepError;
use crate::mesh::TriangleMesh;
use crate::metrics::Metrics;
use crate::parallel::message::codec;
use crate::parallel::reduce::weighted_dot;
use crate::scene::Integrator;
use crate::state::State;
use crate::step::Dynamics;

/// Strains of a garment's edges at the end of a frame.
#[derive(Debug, Clone, PartialEq)]
pub struct GarmentStrains {
    /// Name of the garment.
    pub garment: String,
    /// Relative change of length of its most stretched edge.
    pub largest: f64,
    /// The same of the edge that one in a thousand exceeds.
    pub p99_9: f64,
}

/// Summary of one frame: steps, counts, strains and energies.
///
/// ```
/// # use drapery_core::{EffectRequest, GarmentDescription, PolygonMesh, SceneDescription, Vec3};
/// # let mesh = PolygonMesh::from_triangles(vec![Vec3::zeros(), Vec3::x(), Vec3::z()], &[[0, 2, 1]]);
/// # let mut description = SceneDescription::new("fall");
/// # description.garments.push(GarmentDescription::new("cloth", mesh, 0.2));
/// # description.effects.push(EffectRequest::of_scene("gravity"));
/// use drapery_core::{FrameInput, Scene, Simulation};
/// let scene = Scene::validate(description).expect("a valid scene");
/// let mut simulation = Simulation::new(scene, &FrameInput::to_frame(0)).expect("a valid start");
/// let summary = simulation.advance(&FrameInput::to_frame(1)).expect("a step of free fall");
/// // ½ m (g t)² of 0.1 kg.
/// assert!((summary.kinetic_energy - 0.05 * (9.81_f64 / 24.0).powi(2)).abs() < 1e-12);
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct FrameSummary {
    /// The frame reached.
    pub frame: i64,
    /// Time steps.
    pub steps: u64,
    /// Shortest step [s].
    pub dt_min: f64,
    /// Longest step [s].
    pub dt_max: f64,
    /// Iterations of all damping solves.
    pub cg_iterations: u64,
    /// Seconds by stage, and counts.
    pub metrics: Metrics,
    /// The most stretched edge at the end of the frame.
    pub max_strain: Option<StrainRecord>,
    /// Strains of each garment's edges at the end of the frame, if any effect resists stretching.
    pub strains: Vec<GarmentStrains>,
    /// The most stretched edge between two vertices that hard pins hold in all directions, likewise.
    pub between_pins: Option<StrainRecord>,
    /// Cloth that is longer than cloth can be at the end of the frame.
    pub overstretched: Option<Overstretched>,
    /// Kinetic energy at the end of the frame [J].
    pub kinetic_energy: f64,
    /// Potential energy at the end of the frame [J].
    pub potential_energy: f64,
    /// Pairs of body triangles that cross each other at the frame.
    pub body_self_crossings: u64,
    /// The first of the steps that went wrong, and what was done about them.
    pub recoveries: Vec<Recovery>,
    /// Attachments that broke on the way to the frame, by their vertices.
    pub broken: Vec<BrokenHold>,
    /// The integrator of the frames behind this one, if it is another from there on ([`Integrator::Auto`]).
    pub next_integrator: Option<Integrator>,
}

impl FrameSummary {
    /// Nothing done yet on the way to a frame.
    pub fn empty(frame: i64) -> Self {
        Self {
            frame,
            steps: 0,
            dt_min: f64::INFINITY,
            dt_max: 0.0,
            cg_iterations: 0,
            metrics: Metrics::default(),
            max_strain: None,
            strains: Vec::new(),
            between_pins: None,
            overstretched: None,
            kinetic_energy: 0.0,
            potential_energy: 0.0,
            body_self_crossings: 0,
            recoveries: Vec::new(),
            broken: Vec::new(),
            next_integrator: None,
        }
    }

    /// Puts what was done before a pause in front of this.
    #[must_use]
    pub fn after(mut self, earlier: &Self) -> Self {
        self.steps += earlier.steps;
        self.dt_min = self.dt_min.min(earlier.dt_min);
        self.dt_max = self.dt_max.max(earlier.dt_max);
        self.cg_iterations += earlier.cg_iterations;
        let later = std::mem::replace(&mut self.metrics, earlier.metrics.clone());
        self.metrics.add(&later);
        self.recoveries.splice(..0, earlier.recoveries.iter().cloned());
        self
    }
}

/// Number of edges of which one is left out of [`GarmentStrains::p99_9`].
const EDGES_FOR_ONE: u64 = 1000;

/// A vertex that a pin or a seam has let go for good.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct BrokenHold {
    /// Name of the garment.
    pub garment: String,
    /// Its vertex in the garment's own order.
    pub vertex: u32,
    /// The pin or the seam.
    pub of: HoldOwner,
}

/// The owner of a hold that broke.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum HoldOwner {
    /// Number of the pin in the scene.
    Pin(usize),
    /// Number of the seam in the scene.
    Seam(usize),
}

/// A vertex that was let go; ordered by the pin, then by the seam.
#[derive(PartialEq, Eq, PartialOrd, Ord)]
struct BrokenVertexHold {
    is_seam: bool,
    /// Number of the pin or of the seam.
    owner: usize,
    garment: usize,
    /// Number in the garment.
    vertex: u32,
}

/// A stretched edge.
struct StrainedEdge {
    /// Relative change of its length.
    strain: f64,
    /// Its vertices in the scene, ascending.
    numbers: [u32; 2],
    garment: usize,
    /// Its vertices in the garment, ascending.
    vertices: [u32; 2],
}

impl StrainedEdge {
    /// Compares by strain; of edges with equal strain, the one with the smallest numbers is the last.
    fn order(&self, other: &Self) -> Ordering {
        self.strain.total_cmp(&other.strain).then(other.numbers.cmp(&self.numbers))
    }
}

/// A vertex whose numbers are no longer finite.
struct BrokenVertex {
    /// Number in the scene.
    number: u32,
    garment: usize,
    /// Number in the garment.
    vertex: u32,
}

/// Strain of an edge that is among the most stretched.
struct LargeStrain {
    strain: f64,
}

codec!(struct LargeStrain { strain });
codec!(struct BrokenVertexHold { is_seam, owner, garment, vertex });
codec!(struct StrainedEdge { strain, numbers, garment, vertices });
codec!(struct BrokenVertex { number, garment, vertex });

impl Simulation {
    /// Fills in what is measured at the end of a frame, and makes sure that everything is finite.
    pub(super) fn measure(&mut self, summary: &mut FrameSummary) -> Result<(), StepError> {
        let (scene, ranks) = (Arc::clone(&self.scene), self.ranks().clone());
        let parts = scene.parts();
        if ranks.any(!parts.own().all(|i| is_finite(&self.cloth.state.x[i]) && is_finite(&self.cloth.state.v[i]))) {
            return Err(self.not_finite("the end of the frame", summary.frame, summary.dt_max));
        }
        let masses = scene.masses();
        self.dynamics.volumes.update(parts, &self.cloth.state.x);
        let context = self.force_context();
        let (mut kinetic, mut potential) = (Vec::new(), Vec::new());
        for (range, forces) in parts.ranges().iter().zip(&self.dynamics.forces) {
            let (own, v) = (&masses[range.clone()], &self.cloth.state.v[range.clone()]);
            kinetic.push(0.5 * weighted_dot(own, v, v));
            let view = PartView { start: range.start, masses: own, x: &self.cloth.state.x, fraction: 1.0, context };
            potential.push(forces.iter().map(|f| f.energy(&view)).sum());
        }
        [summary.kinetic_energy, summary.potential_energy] = parts.join_parts(&[&kinetic, &potential]);
        summary.max_strain = self.largest_strain();
        if summary.max_strain.is_some() {
            summary.strains = self.garment_strains();
        }
        summary.overstretched = self.overstretched(summary.max_strain.as_ref());
        summary.between_pins = self.strain_between_pins();
        self.crossings = self.find_crossings();
        if self.contacts.cloth.as_ref().is_some_and(SelfContact::keeps_free) {
            self.metrics.count_once(&ranks, "crossings", self.crossings.len() as u64);
        }
        summary.broken = self.broken_in(summary.frame);
        summary.body_self_crossings = self.prescribed.bodies.self_crossings().sum::<usize>() as u64;
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

    /// Context of forces besides positions, now.
    pub(super) fn force_context(&self) -> ForceContext<'_> {
        let (State { time, v, .. }, Dynamics { wind, volumes, .. }) = (&self.cloth.state, &self.dynamics);
        ForceContext { time: *time, targets: &self.prescribed.targets, v, wind, volumes }
    }

    /// Takes what forces have counted.
    pub(super) fn take_counts(&mut self) {
        let Self { dynamics: Dynamics { forces, .. }, metrics, .. } = self;
        let mut add = |name, amount| metrics.count(name, amount);
        forces.iter_mut().flatten().for_each(|force| force.take_counts(&mut add));
    }

    /// Attachments and stitches of all ranks that broke on the way to a frame, by pin or seam and vertex.
    fn broken_in(&self, frame: i64) -> Vec<BrokenHold> {
        let description = self.scene.description();
        if description.pins.iter().all(|pin| pin.hold.break_force().is_none()) && !description.seams_can_break() {
            return Vec::new();
        }
        let (parts, timeline) = (self.scene.parts(), description.timeline);
        let (start, end) = (timeline.time(frame - 1), timeline.time(frame));
        let mut here = Vec::new();
        let mut add = |is_seam: bool, owner: usize, vertex: usize| {
            let (garment, vertex) = parts.own_vertex(vertex);
            here.push(BrokenVertexHold { is_seam, owner, garment, vertex });
        };
        self.prescribed
            .targets
            .broken_between(start, end)
            .into_iter()
            .for_each(|(vertex, pin)| add(false, pin, vertex));
        for force in self.dynamics.forces.iter().flatten().filter_map(|force| force.breakable()) {
            force.visit_broken(&mut |element| {
                if element.counts && element.time > start && element.time <= end {
                    add(true, element.owner, element.vertices[0] as usize);
                }
            });
        }
        let mut all = self.ranks().all_gather_encoded("attachments and stitches that broke", here);
        all.sort_unstable();
        let named = |BrokenVertexHold { is_seam, owner, garment, vertex }: BrokenVertexHold| BrokenHold {
            garment: description.garments[garment].name.clone(),
            vertex,
            of: if is_seam { HoldOwner::Seam(owner) } else { HoldOwner::Pin(owner) },
        };
        all.into_iter().map(named).collect()
    }

    /// The most stretched edge of all ranks; among equal ones that with the smallest numbers.
    pub(super) fn largest_strain(&self) -> Option<StrainRecord> {
        let strained = self.dynamics.forces.iter().flatten().filter_map(|force| force.strained());
        self.largest_of(strained.filter_map(|force| force.largest_strain(&self.cloth.state.x)))
    }

    /// The largest strain of each garment's edges, and that which one edge in a thousand exceeds.
    fn garment_strains(&self) -> Vec<GarmentStrains> {
        let (scene, ranks, x) = (&self.scene, self.ranks(), &self.cloth.state.x);
        let parts = scene.parts();
        let strains = |(garment, mesh): (usize, &TriangleMesh)| {
            let first = parts.garment(garment).start;
            // Each edge counts at the rank that owns its first vertex.
            let ends = mesh.edges().iter().map(|edge| (edge, edge.vertices.map(|v| first + v as usize)));
            let own = ends.filter(|(_, ends)| parts.own().contains(&ends[0].min(ends[1])));
            let strain = |(edge, [a, b]): (&_, [usize; 2])| (x[b] - x[a]).norm() / mesh.rest_length(*edge) - 1.0;
            let mut here: Vec<f64> = own.map(strain).collect();
            let [count] = ranks.sum_of([here.len() as u64]);
            // Those that exceed the quantile, and itself.
            let exceeding = (count / EDGES_FOR_ONE) as usize;
            here.sort_unstable_by(|a, b| b.total_cmp(a));
            here.truncate(exceeding + 1);
            let here = here.into_iter().map(|strain| LargeStrain { strain }).collect();
            let all = ranks.all_gather_encoded("largest strains", here);
            let mut all: Vec<f64> = all.into_iter().map(|LargeStrain { strain }| strain).collect();
            all.sort_unstable_by(|a, b| b.total_cmp(a));
            let garment = scene.description().garments[garment].name.clone();
            Some(GarmentStrains { garment, largest: *all.first()?, p99_9: *all.get(exceeding)? })
        };
        scene.meshes().iter().enumerate().filter_map(strains).collect()
    }

    /// The most stretched of these edges of all ranks, given by strain and local vertices; likewise.
    pub(super) fn largest_of(&self, all: impl Iterator<Item = (f64, [usize; 2])>) -> Option<StrainRecord> {
        let (parts, ranks) = (self.scene.parts(), self.ranks());
        let numbered = all.map(|(strain, ends)| {
            let mut numbers = ends.map(|local| parts.number(local));
            numbers.sort_unstable();
            let (garment, a) = parts.own_vertex(ends[0]);
            let (_, b) = parts.own_vertex(ends[1]);
            StrainedEdge { strain, numbers, garment, vertices: [a.min(b), a.max(b)] }
        });
        let here = numbered.max_by(StrainedEdge::order).into_iter().collect();
        let found = ranks.all_gather_encoded("most stretched edges", here).into_iter().max_by(StrainedEdge::order)?;
        let garment = self.scene.description().garments[found.garment].name.clone();
        Some(StrainRecord { garment, vertices: found.vertices, strain: found.strain })
    }

    /// Counts what this rank has sent since the last frame.
    fn count_traffic(&mut self) {
        let sent = self.ranks().sent();
        let before = std::mem::replace(&mut self.sent, sent);
        if !self.ranks().is_alone() {
            self.metrics.count("messages", sent.messages - before.messages);
            self.metrics.count("exchanges", sent.exchanges - before.exchanges);
            self.metrics.count("bytes_sent", sent.bytes - before.bytes);
            self.metrics.count_once(
                &self.scene.parts().ranks().clone(),
                "collectives",
                sent.collectives - before.collectives,
            );
        }
    }

    /// The first vertex of all ranks whose numbers are no longer finite; there is one. All ranks call it together.
    pub(super) fn not_finite(&self, stage: &'static str, frame: i64, dt: f64) -> StepError {
        let parts = self.scene.parts();
        let broken = parts.own().find(|&i| !is_finite(&self.cloth.state.x[i]) || !is_finite(&self.cloth.state.v[i]));
        let here = broken.map(|i| {
            let (garment, vertex) = parts.own_vertex(i);
            BrokenVertex { number: parts.number(i), garment, vertex }
        });
        let all = self.ranks().all_gather_encoded("vertices that are not finite", here.into_iter().collect());
        let first = all.into_iter().min_by_key(|vertex| vertex.number).expect("some rank has found one");
        StepError::NotFinite {
            garment: self.scene.description().garments[first.garment].name.clone(),
            vertex: first.vertex as usize,
            frame,
            time: self.time_of_shot(),
            stage,
            dt,
        }
    }
}
