//! Pins: vertices whose motion is prescribed. Hard pins replace the motion of their vertices; the `attachments` effect
//! holds by springs instead. Both follow the same targets: the start position (moved along a path), an animated track, or
//! a place on a body's surface.
//!
//! ```toml
//! [[garment.pin]]
//! vertices = [0, 40]
//! to = "start"          # or "body:hero"
//! ```

use std::collections::BTreeMap;

use crate::Vec3;
use crate::contact::bodies::recovery_speed::CatchUp;
use crate::contact::bodies::{Bodies, Sample, Samples};
use crate::effects::{BuildContext, Cost, Effect, EffectSpec, Need, Scope, Section};
use crate::error::Problem;
use crate::parallel::parts::Parts;
use crate::remembered::{Field, Remembered};
use crate::scene::{FARTHEST, PinAnchor, PinHold, PinTarget, Pinned, Scene, SurfaceAttachment, is_possible};
use crate::settings::Settings;
use crate::snapshot::{SnapshotError, Values};

/// Registry entry.
pub static SPEC: EffectSpec = EffectSpec {
    name: "pins",
    summary: "vertices that move as prescribed",
    scope: Scope::Implied,
    fields: &[],
    needs: &[Need::State, Need::PinTargets],
    requires: &[],
    cost: Cost { elements: "vertices", step: 40.0, iteration: 2.0 },
    section: Some(SECTION),
    counts: &[BEHIND, STRETCHED],
    build,
};

/// Count of held vertices that do not reach their targets in a step.
pub(crate) const BEHIND: &str = "pins_behind";

/// Count of edges that are torn apart between two held vertices at the end of a frame.
pub(crate) const STRETCHED: &str = "pins_stretched";

fn build(_: &Settings, context: &BuildContext<'_>) -> Result<Effect, Problem> {
    let pins = HardPins::new(context.scene);
    let bytes = pins.entries.len() * size_of::<HardPin>() + pins.rows.len() * size_of::<usize>();
    Ok(Effect { elements: pins.entries.len(), pins: Some(pins), bytes, ..Effect::default() })
}

/// What pins and attachments remember together.
pub(crate) const SECTION: Section = Section { name: "pins", version: 1 };

/// What one pinned vertex follows.
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

/// Where pinned vertices have to be at both ends of the current step.
#[derive(Debug, Default)]
pub struct PinTargets {
    targets: Vec<Target>,

    paths: Vec<Vec<(f64, Vec3)>>,
    windows: Vec<(f64, f64)>,
    at_t0: Vec<Vec3>,
    at_t1: Vec<Vec3>,
    active: Vec<bool>,
    /// Whether some pin of the scene can break: alike on all ranks, also where none is pinned.
    breakable: bool,
    /// How far each target may be from its vertex before it breaks [m]; empty if none can.
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
    pub fn new(scene: &Scene, x: &[Vec3], bodies: &Bodies, tracks: &[Samples], time: f64) -> Result<Self, Problem> {
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
    pub fn set_step(&mut self, bodies: &Bodies, tracks: &[Samples], x: &[Vec3], (t0, t1): (f64, f64)) {
        self.dt = t1 - t0;
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

    /// What the pins remember: the places taken when they took hold, and where their vertices were bound to bodies.
    pub(crate) fn remember(&self) -> Remembered {
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
        let vectors = |values: Vec<Vec3>| Field::Targets(3, Values::F64(bytemuck::cast_slice(&values).to_vec()));
        let active = self.active.iter().map(|active| u8::from(*active)).collect();
        let memory = Remembered::new(SECTION)
            .with("places", vectors(self.targets.iter().map(place).collect()))
            .with("body_points", Field::Targets(3, Values::U32(attachments().flat_map(|a| a.body_points).collect())))
            .with("weights", Field::Targets(3, Values::F64(attachments().flat_map(|a| a.weights).collect())))
            .with("offsets", vectors(attachments().map(|a| a.offset).collect()))
            .with("at_end", vectors(self.at_t1.clone()))
            .with("active", Field::Targets(1, Values::U8(active)));
        // Scenes in which nothing can break have no such field.
        match self.breakable {
            false => memory,
            true => memory.with("broken_at", Field::Targets(1, Values::F64(self.broken_at.clone()))),
        }
    }

    /// Goes on from what was remembered.
    ///
    /// # Errors
    /// It is of another scene, or its numbers are none.
    pub(crate) fn go_on(&mut self, memory: &Remembered, bodies: &Bodies) -> Result<(), SnapshotError> {
        let error = |what: String| SnapshotError { section: memory.name.to_owned(), what };
        let reals = |name: &str| match memory.targets(name) {
            Values::F64(values) => values.as_slice(),
            _ => unreachable!("`{name}` was declared as numbers"),
        };
        let rows = |name: &str| reals(name).as_chunks::<3>().0;
        let (places, weights, offsets, at_end) = (rows("places"), rows("weights"), rows("offsets"), rows("at_end"));
        let (Values::U32(points), Values::U8(active)) = (memory.targets("body_points"), memory.targets("active"))
        else {
            unreachable!("points and marks were declared as such")
        };
        let points = points.as_chunks::<3>().0;
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
                    let of_body = bodies.surface_positions(*body).len();
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
        self.active = active.iter().map(|mark| *mark != 0).collect();
        if self.breakable {
            self.broken_at = reals("broken_at").to_vec();
        }
        Ok(())
    }

    /// Where a target is at a time [s] to which these samples of bodies and tracks lead [m]; `None` if it does not hold then, or
    /// if its place is known only when it takes hold.
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
    pub fn is_empty(&self) -> bool {
        self.targets.is_empty()
    }

    /// Whether the target holds during this step.
    pub fn is_active(&self, target: usize) -> bool {
        self.active[target]
    }

    /// Position at a fraction of the step [m].
    pub fn position(&self, target: usize, fraction: f64) -> Vec3 {
        self.at_t0[target].lerp(&self.at_t1[target], fraction)
    }

    /// Mean velocity over the step [m/s].
    pub fn velocity(&self, target: usize) -> Vec3 {
        if self.dt > 0.0 { (self.at_t1[target] - self.at_t0[target]) / self.dt } else { Vec3::zeros() }
    }

    /// What is left of the way to the target along an axis after a step from `x` [m].
    fn rest_of_lag(&self, target: usize, catch_up: CatchUp, x: Vec3, axis: usize) -> f64 {
        let lag = self.at_t0[target][axis] - x[axis];
        (lag.abs() - catch_up.of(lag.abs())).copysign(lag)
    }

    /// Times at which some pin starts or stops holding [s].
    pub fn window_times(&self) -> impl Iterator<Item = f64> + '_ {
        self.windows.iter().flat_map(|(from, until)| [*from, *until]).filter(|t| t.is_finite())
    }

    fn evaluate(&self, target: &Target, bodies: &Bodies, tracks: &[Samples], time: f64) -> Vec3 {
        match &target.source {
            Source::Path { place, pin } => place + along_path(&self.paths[*pin], time),
            Source::Track { track, row } => tracks[*track].position(*row, time),
            Source::Surface { body, attachment } => {
                let points = bodies.surface_positions(*body);
                attached_position(attachment, attachment.body_points.map(|p| points[p as usize]))
            }
        }
    }
}

/// Positions of one of several meshes at the last of its samples [m].
fn last(all: &[Vec<Sample>], mesh: usize) -> Option<&[Vec3]> {
    all.get(mesh)?.last().map(|sample| sample.positions.as_slice())
}

/// Piecewise linear value at `time`, held before the first and after the last key; zero without keys.
pub(crate) fn along_path(keys: &[(f64, Vec3)], time: f64) -> Vec3 {
    let next = keys.partition_point(|(t, _)| *t <= time);
    match (next.checked_sub(1).map(|i| keys[i]), keys.get(next)) {
        (None, None) => Vec3::zeros(),
        (None, Some((_, first))) => *first,
        (Some((_, last)), None) => last,
        (Some((ta, a)), Some((tb, b))) => a.lerp(b, (time - ta) / (tb - ta)),
    }
}

/// Frame of a triangle: tangent along the first edge, bitangent = normal × tangent, normal.
fn triangle_frame([a, b, c]: [Vec3; 3]) -> [Vec3; 3] {
    let tangent = (b - a).try_normalize(0.0).unwrap_or_else(Vec3::x);
    let normal = (b - a).cross(&(c - a)).try_normalize(0.0).unwrap_or_else(Vec3::y);
    [tangent, normal.cross(&tangent), normal]
}

/// Place of an attachment on its triangle's current corners [m].
fn attached_position(attachment: &SurfaceAttachment, corners: [Vec3; 3]) -> Vec3 {
    let frame = triangle_frame(corners);
    let on_surface: Vec3 = (0..3).map(|i| corners[i] * attachment.weights[i]).sum();
    on_surface + (0..3).map(|i| frame[i] * attachment.offset[i]).sum::<Vec3>()
}

/// The attachment that puts a vertex at `place` [m], given a triangle and the weights of the point below it.
pub(crate) fn attach(
    vertex: u32,
    place: Vec3,
    body_points: [u32; 3],
    weights: [f64; 3],
    corners: [Vec3; 3],
) -> SurfaceAttachment {
    let on_surface: Vec3 = (0..3).map(|i| corners[i] * weights[i]).sum();
    let frame = triangle_frame(corners);
    let apart = place - on_surface;
    SurfaceAttachment { vertex, body_points, weights, offset: Vec3::from(frame.map(|axis| axis.dot(&apart))) }
}

#[derive(Debug, Clone, Copy)]
struct HardPin {
    vertex: usize,
    target: usize,
    axes: [bool; 3],
}

/// Vertices whose position and velocity are prescribed, sorted by solver index.
#[derive(Debug)]
pub struct HardPins {
    entries: Vec<HardPin>,
    /// First entry of each part; one more at the end.
    rows: Vec<usize>,
}

impl HardPins {
    fn new(scene: &Scene) -> Self {
        let parts: &Parts = scene.parts();
        let pins = &scene.description().pins;
        let hard = scene.pinned().iter().enumerate().filter(|(_, pinned)| pins[pinned.pin].hold == PinHold::Hard);
        let entry = |(target, pinned): (usize, &Pinned)| HardPin {
            vertex: pinned.vertex as usize,
            target,
            axes: pins[pinned.pin].axes,
        };
        let mut entries: Vec<HardPin> = hard.map(entry).collect();
        entries.sort_unstable_by_key(|e| (e.vertex, e.target));
        let mut rows: Vec<usize> =
            parts.ranges().iter().map(|r| entries.partition_point(|e| e.vertex < r.start)).collect();
        rows.push(entries.len());
        Self { entries, rows }
    }

    /// Calls `set(vertex in the part, axis, target)` for every held component of a part.
    fn held(&self, part: usize, start: usize, targets: &PinTargets, mut set: impl FnMut(usize, usize, usize)) {
        for pin in &self.entries[self.rows[part]..self.rows[part + 1]] {
            if targets.is_active(pin.target) {
                (0..3).filter(|axis| pin.axes[*axis]).for_each(|axis| set(pin.vertex - start, axis, pin.target));
            }
        }
    }

    /// Puts the part's held components where their targets are at the end of the step.
    pub fn start_at(&self, part: usize, start: usize, targets: &PinTargets, x: &mut [Vec3]) {
        self.held(part, start, targets, |vertex, axis, target| x[vertex][axis] = targets.at_t1[target][axis]);
    }

    /// Puts the part's held components where they have to be at the end of the step: at their targets, or, where their
    /// vertices were too far behind in `x` [m], as much closer as `catch_up` allows.
    pub fn set_positions(
        &self,
        part: usize,
        start: usize,
        targets: &PinTargets,
        catch_up: CatchUp,
        (x, x_new): (&[Vec3], &mut [Vec3]),
    ) {
        self.held(part, start, targets, |vertex, axis, target| {
            let rest = targets.rest_of_lag(target, catch_up, x[vertex], axis);
            x_new[vertex][axis] = targets.at_t1[target][axis] - rest;
        });
    }

    /// How many own vertices stay behind their targets in the step from `x` [m].
    pub fn behind(&self, targets: &PinTargets, catch_up: CatchUp, x: &[Vec3]) -> u64 {
        let is_late = |pin: &&HardPin| {
            let late =
                |axis: usize| pin.axes[axis] && targets.rest_of_lag(pin.target, catch_up, x[pin.vertex], axis) != 0.0;
            targets.is_active(pin.target) && (0..3).any(late)
        };
        self.entries.iter().filter(is_late).count() as u64
    }

    /// Gives the part's held components their prescribed velocity.
    pub fn set_velocities(&self, part: usize, start: usize, targets: &PinTargets, v: &mut [Vec3]) {
        self.held(part, start, targets, |vertex, axis, target| v[vertex][axis] = targets.velocity(target)[axis]);
    }

    /// Removes the part's held components from a residual or search direction.
    pub fn project(&self, part: usize, start: usize, targets: &PinTargets, r: &mut [Vec3]) {
        self.held(part, start, targets, |vertex, axis, _| r[vertex][axis] = 0.0);
    }

    /// Every held vertex with its target and the axes in which it is held, in solver order.
    pub fn axes(&self) -> impl Iterator<Item = (usize, usize, [bool; 3])> + '_ {
        self.entries.iter().map(|e| (e.vertex, e.target, e.axes))
    }

    /// Vertices that are held in all directions by one pin at some time, in solver order.
    pub fn fully_held(&self) -> impl Iterator<Item = (usize, usize)> + '_ {
        self.entries.iter().filter(|e| e.axes == [true; 3]).map(|e| (e.vertex, e.target))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_attachment_rebuilds_its_place_and_follows_a_turned_triangle() {
        let corners = [Vec3::new(0.0, 0.0, 0.0), Vec3::new(2.0, 0.0, 0.0), Vec3::new(0.0, 0.0, -1.0)];
        let place = Vec3::new(0.5, 0.3, -0.2);
        let attachment = attach(7, place, [0, 1, 2], [0.6, 0.2, 0.2], corners);
        assert!((attached_position(&attachment, corners) - place).norm() < 1e-15);
        let turn = nalgebra::Rotation3::from_axis_angle(&Vec3::z_axis(), 1.1);
        let moved = attached_position(&attachment, corners.map(|c| turn * c + Vec3::x()));
        assert!((moved - (turn * place + Vec3::x())).norm() < 1e-15);
    }

    #[test]
    fn a_path_is_held_at_its_ends() {
        let keys = [(1.0, Vec3::x()), (3.0, 3.0 * Vec3::x())];
        for (time, x) in [(0.0, 1.0), (1.0, 1.0), (2.0, 2.0), (3.0, 3.0), (9.0, 3.0)] {
            assert_eq!(along_path(&keys, time).x, x);
        }
    }
}
