//! Prescribed positions of pinned vertices: the start position (moved along a path), an animated track, or a point on
//! a body's surface.

use std::collections::BTreeMap;

use crate::Vec3;
use crate::contact::bodies::recovery_speed::RecoverySpeed;
use crate::contact::bodies::{Bodies, Sample, Samples};
use crate::error::Problem;
use crate::geometry::attachment::{SurfaceAttachment, along_path, attached_position};
use crate::scene::{FARTHEST, PinAnchor, PinTarget, Pinned, Scene, is_possible};
use crate::snapshot::SnapshotError;
use crate::snapshot::saved_section::{Field, SavedSection, SectionId};

/// Section with the common memory of pins and attachments.
pub(crate) const SECTION: SectionId = SectionId { name: "pins", version: 1 };

/// Source that one pinned vertex follows.
#[derive(Debug, Clone)]
enum Source {
    /// A place, moved along a piecewise linear path of offsets.
    Path { place: Vec3, pin: usize },
    /// A row of a track.
    Track { track: usize, row: usize },
    /// A place on a body.
    Surface { body: usize, attachment: SurfaceAttachment },
}

#[derive(Debug, Clone)]
struct Target {
    /// Number of the pin in the scene.
    pin: usize,
    /// Number of the target in the scene.
    number: u32,
    /// The pinned vertex, own.
    vertex: usize,
    /// Whether the place is taken anew when the pin takes hold.
    taken_when_held: bool,
    source: Source,
}

/// Prescribed positions of pinned vertices at both ends of the current step.
#[derive(Debug, Default)]
pub struct PinTargets {
    targets: Vec<Target>,

    paths: Vec<Vec<(f64, Vec3)>>,
    windows: Vec<(f64, f64)>,
    at_t0: Vec<Vec3>,
    pub(super) at_t1: Vec<Vec3>,
    active: Vec<bool>,
    /// Whether some pin of the scene can break: alike on all ranks, also where none is pinned.
    breakable: bool,
    /// Largest distance of each target from its vertex before it breaks [m]; empty if none can.
    reaches: Vec<f64>,
    /// When each target broke [s], infinite for those that hold; empty if none can.
    broken_at: Vec<f64>,
    dt: f64,
}

impl PinTargets {
    /// Targets of the pins of own vertices at the start: `x` are the start positions of local vertices, `bodies` stand at the
    /// start time, tracks have the rows of own vertices.
    ///
    /// # Errors
    /// A vertex that is to be bound to the nearest place of a body finds none.
    pub(crate) fn new(
        scene: &Scene,
        x: &[Vec3],
        bodies: &Bodies,
        tracks: &[Samples],
        time: f64,
    ) -> Result<Self, Problem> {
        let mut built = Self::default();
        let mut rows = BTreeMap::new();
        for pin in &scene.description().pins {
            built.windows.push((pin.from, pin.until));
            built.paths.push(match &pin.target {
                PinTarget::Path { offsets, .. } => offsets.clone(),
                _ => Vec::new(),
            });
        }
        for pinned in scene.pinned() {
            let (vertex, place) = (pinned.vertex as usize, x[pinned.vertex as usize]);
            let mut taken_when_held = false;
            let source = match &scene.description().pins[pinned.pin].target {
                PinTarget::Path { anchor, .. } => {
                    taken_when_held = *anchor == PinAnchor::WhenHeld;
                    Source::Path { place, pin: pinned.pin }
                }
                PinTarget::Track { track, .. } => {
                    // The rows of a track are those of own vertices, in order.
                    let row = rows.entry(*track).or_insert(0);
                    *row += 1;
                    Source::Track { track: *track, row: *row - 1 }
                }
                PinTarget::Body { body, .. } | PinTarget::BodyNearest { body, .. } => {
                    let (garment, own) = scene.parts().own_vertex(vertex);
                    let attachment = pinned.attachment.or_else(|| bodies.bind(*body, own, place));
                    let attachment = attachment.ok_or_else(|| {
                        let name = &scene.description().garments[garment].name;
                        let place = format!("garment \"{name}\", pin {}, vertex {own}", pinned.pin);
                        Problem::data(
                            place,
                            "the body has no surface to bind to",
                            "bind to a body read from a mesh file",
                        )
                    })?;
                    Source::Surface { body: *body, attachment }
                }
            };
            built.targets.push(Target { pin: pinned.pin, number: pinned.number, vertex, taken_when_held, source });
        }
        built.at_t1 = built.targets.iter().map(|t| built.evaluate(t, bodies, tracks, time)).collect();
        built.at_t0 = built.at_t1.clone();
        built.active = vec![false; built.targets.len()];
        built.breakable = scene.description().pins.iter().any(|pin| pin.hold.break_force().is_some());
        if built.breakable {
            let reach = |pinned: &Pinned| scene.pin_break_force(pinned) / scene.pin_stiffness(pinned);
            built.reaches = scene.pinned().iter().map(reach).collect();
            built.broken_at = vec![f64::INFINITY; built.targets.len()];
        }
        Ok(built)
    }

    /// Goes on to the step from `t0` to `t1`; `bodies` stand at `t1`, `x` are the positions at `t0` in solver order.
    pub(crate) fn set_step(&mut self, bodies: &Bodies, tracks: &[Samples], x: &[Vec3], (t0, t1): (f64, f64)) {
        self.dt = t1 - t0;
        let [t0, t1] = [t0, t1].map(|time| bodies.time_of_motion(time));
        std::mem::swap(&mut self.at_t0, &mut self.at_t1);
        for i in 0..self.targets.len() {
            let (from, until) = self.windows[self.targets[i].pin];
            let holds = from <= t0 && t0 < until && !self.is_broken(i);
            if holds && !self.active[i] && self.targets[i].taken_when_held {
                self.take_place(i, x, t0);
            }
            self.active[i] = holds;
            self.at_t1[i] = self.evaluate(&self.targets[i], bodies, tracks, t1);
        }
    }

    /// Whether the target has let go for good.
    fn is_broken(&self, target: usize) -> bool {
        self.broken_at.get(target).is_some_and(|time| time.is_finite())
    }

    /// Lets go, at the end of a step, what is farther from its vertex than its spring can hold; returns how many.
    pub(crate) fn break_overloaded(&mut self, x: &[Vec3], time: f64) -> u64 {
        let mut broken = 0;
        for i in 0..self.reaches.len() {
            let overloaded = (self.at_t1[i] - x[self.targets[i].vertex]).norm() > self.reaches[i];
            if self.active[i] && overloaded {
                (self.active[i], self.broken_at[i]) = (false, time);
                broken += 1;
            }
        }
        broken
    }

    /// Own vertices that were let go after `start` and up to `end` [s], each with the number of its pin.
    pub(crate) fn broken_between(&self, start: f64, end: f64) -> Vec<(usize, usize)> {
        let then = |(_, time): &(&Target, &f64)| **time > start && **time <= end;
        self.targets.iter().zip(&self.broken_at).filter(then).map(|(t, _)| (t.vertex, t.pin)).collect()
    }

    /// Moves a target's place so that it is where its vertex is now.
    fn take_place(&mut self, i: usize, x: &[Vec3], time: f64) {
        let here = x[self.targets[i].vertex];
        if let Source::Path { place, pin } = &mut self.targets[i].source {
            *place = here - along_path(&self.paths[*pin], time);
            self.at_t0[i] = here;
        }
    }

    /// Saves the memory of the pins: the places taken when they took hold, and the places at which their vertices
    /// were bound to bodies.
    pub(crate) fn save(&self) -> SavedSection {
        let place = |target: &Target| match &target.source {
            Source::Path { place, .. } => *place,
            _ => Vec3::zeros(),
        };
        let none = SurfaceAttachment { vertex: 0, body_points: [0; 3], weights: [0.0; 3], offset: Vec3::zeros() };
        let attachment = |target: &Target| match &target.source {
            Source::Surface { attachment, .. } => *attachment,
            _ => none,
        };
        let attachments = || self.targets.iter().map(attachment);
        let vectors = |values: Vec<Vec3>| Field::targets::<f64>(3, bytemuck::cast_slice(&values).to_vec());
        let active: Vec<u8> = self.active.iter().map(|active| u8::from(*active)).collect();
        let memory = SavedSection::new(SECTION)
            .with("places", vectors(self.targets.iter().map(place).collect()))
            .with("body_points", Field::targets::<u32>(3, attachments().flat_map(|a| a.body_points).collect()))
            .with("weights", Field::targets::<f64>(3, attachments().flat_map(|a| a.weights).collect()))
            .with("offsets", vectors(attachments().map(|a| a.offset).collect()))
            .with("at_end", vectors(self.at_t1.clone()))
            .with("active", Field::targets(1, active));
        // Scenes in which nothing can break have no such field.
        match self.breakable {
            false => memory,
            true => memory.with("broken_at", Field::targets(1, self.broken_at.clone())),
        }
    }

    /// Goes on from what was remembered.
    ///
    /// # Errors
    /// It is of another scene, or its numbers are none.
    pub(crate) fn restore(&mut self, memory: &SavedSection, bodies: &Bodies) -> Result<(), SnapshotError> {
        let error = |what: String| SnapshotError { section: memory.id.name.to_owned(), what };
        let rows = |name: &str| memory.values::<f64>(name).as_chunks::<3>().0;
        let (places, weights, offsets, at_end) = (rows("places"), rows("weights"), rows("offsets"), rows("at_end"));
        let points = memory.values::<u32>("body_points").as_chunks::<3>().0;
        for (name, rows) in [("places", places), ("weights", weights), ("offsets", offsets), ("at_end", at_end)] {
            if let Some(i) = rows.iter().position(|row| !is_possible(&Vec3::from(*row))) {
                return Err(error(format!(
                    "`{name}` of pin target {} is not finite, or beyond {FARTHEST:e}",
                    self.targets[i].number
                )));
            }
        }
        for (i, target) in self.targets.iter_mut().enumerate() {
            match &mut target.source {
                Source::Path { place, .. } => *place = places[i].into(),
                Source::Track { .. } => {}
                Source::Surface { body, attachment } => {
                    let of_body = bodies.contact_positions(*body).len();
                    let points = points.get(i).filter(|points| points.iter().all(|p| (*p as usize) < of_body));
                    attachment.body_points = *points.ok_or_else(|| {
                        error(format!("pin target {} is bound to no place of its body", target.number))
                    })?;
                    attachment.weights = weights[i];
                    attachment.offset = offsets[i].into();
                }
            }
        }
        self.at_t1 = at_end.iter().map(|place| Vec3::from(*place)).collect();
        self.active = memory.values::<u8>("active").iter().map(|mark| *mark != 0).collect();
        if self.breakable {
            self.broken_at = memory.values("broken_at").to_vec();
        }
        Ok(())
    }

    /// Returns the place of a target at a time [s] to which these samples of bodies and tracks lead [m]; `None` if it
    /// does not hold then, or if its place is known only when it takes hold.
    pub(crate) fn place_at(&self, target: usize, time: f64, [bodies, tracks]: [&[Vec<Sample>]; 2]) -> Option<Vec3> {
        let target = &self.targets[target];
        let (from, until) = self.windows[target.pin];
        if target.taken_when_held || !(from..until).contains(&time) {
            return None;
        }
        match &target.source {
            Source::Path { place, pin } => Some(place + along_path(&self.paths[*pin], time)),
            Source::Track { track, row } => last(tracks, *track)?.get(*row).copied(),
            Source::Surface { body, attachment } => {
                let points = last(bodies, *body)?;
                Some(attached_position(attachment, attachment.body_points.map(|p| points[p as usize])))
            }
        }
    }

    /// Own vertices that were bound to the nearest place of a body: the pin, the vertex, the body and the distance [m].
    pub(crate) fn nearest_bound<'a>(
        &'a self,
        scene: &'a Scene,
    ) -> impl Iterator<Item = (usize, usize, usize, f64)> + 'a {
        let pins = &scene.description().pins;
        self.targets.iter().filter_map(|target| match (&pins[target.pin].target, &target.source) {
            (PinTarget::BodyNearest { body, .. }, Source::Surface { attachment, .. }) => {
                Some((target.pin, target.vertex, *body, attachment.offset.norm()))
            }
            _ => None,
        })
    }

    /// Numbers of own targets in the scene, ascending.
    pub(crate) fn numbers(&self) -> Vec<u32> {
        self.targets.iter().map(|target| target.number).collect()
    }

    /// Whether there is nothing to follow.
    pub(crate) fn is_empty(&self) -> bool {
        self.targets.is_empty()
    }

    /// Whether the target holds during this step.
    pub(crate) fn is_active(&self, target: usize) -> bool {
        self.active[target]
    }

    /// Position at a fraction of the step [m].
    #[cfg(feature = "effects")]
    pub(crate) fn position(&self, target: usize, fraction: f64) -> Vec3 {
        self.at_t0[target].lerp(&self.at_t1[target], fraction)
    }

    /// Mean velocity over the step [m/s].
    pub(crate) fn velocity(&self, target: usize) -> Vec3 {
        if self.dt > 0.0 { (self.at_t1[target] - self.at_t0[target]) / self.dt } else { Vec3::zeros() }
    }

    /// Returns the remaining displacement to the target along an axis after a step from `x` [m].
    pub(super) fn rest_of_lag(&self, target: usize, recovery_speed: RecoverySpeed, x: Vec3, axis: usize) -> f64 {
        let lag = self.at_t0[target][axis] - x[axis];
        (lag.abs() - recovery_speed.of(lag.abs())).copysign(lag)
    }

    /// Times at which some pin starts or stops holding [s].
    pub(crate) fn window_times(&self) -> impl Iterator<Item = f64> + '_ {
        self.windows.iter().flat_map(|(from, until)| [*from, *until]).filter(|t| t.is_finite())
    }

    fn evaluate(&self, target: &Target, bodies: &Bodies, tracks: &[Samples], time: f64) -> Vec3 {
        match &target.source {
            Source::Path { place, pin } => place + along_path(&self.paths[*pin], time),
            Source::Track { track, row } => tracks[*track].position(*row, time),
            Source::Surface { body, attachment } => {
                let points = bodies.contact_positions(*body);
                attached_position(attachment, attachment.body_points.map(|p| points[p as usize]))
            }
        }
    }
}

/// Positions of one of several meshes at the last of its samples [m].
fn last(all: &[Vec<Sample>], mesh: usize) -> Option<&[Vec3]> {
    all.get(mesh)?.last().map(|sample| sample.positions.as_slice())
}
