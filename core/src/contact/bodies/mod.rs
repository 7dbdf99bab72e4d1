//! Bodies at both ends of a time step, and what a cloth vertex finds of them: analytic shapes in rigid motion and animated
//! triangle surfaces behind one interface (`docs/theory/friction.md#one-vertex-on-one-body`).
//!
//! [`collision`] holds for each vertex up to two bodies near it, [`friction`] answers one vertex on one body, [`recovery_speed`]
//! says how fast what is too deep comes out, `constraints` what bodies bear of repulsion. Every rank has all bodies and works
//! on its own vertices. Bodies move cloth; cloth never moves bodies.

pub(crate) mod active_set;
pub mod collision;
pub(crate) mod constraints;
pub(crate) mod friction;
mod part_crossings;
pub mod recovery_speed;
mod rigid;
mod samples;

use crate::Vec3;
use crate::contact::bodies::part_crossings::{DeepParts, PartCrossings, deep_points};
use crate::contact::bodies::recovery_speed::RecoverySpeed;
use crate::contact::bodies::rigid::{Bounds, Rigid};
use crate::error::{Problem, Problems};
use crate::geometry::aabb::Aabb;
use crate::geometry::attachment::{SurfaceAttachment, attach};
use crate::geometry::moving_surface::{MovingSurface, Neighbourhood, SurfacePoint};
use crate::geometry::path::{Crossings, Side};
use crate::geometry::shape_mesh::ShapeMesh;
use crate::scene::{BodyDescription, BodyShape, Scene};
use crate::snapshot::SnapshotError;
use crate::snapshot::saved_section::{Field, SavedSection, SectionId};
use crate::tolerances;

pub use samples::{Sample, Samples};

/// Identifier of the saved section with the deep parts of surfaces, which is absent without surfaces.
const DEEP_PARTS: SectionId = SectionId { name: "deep_parts", version: 1 };

/// A place of a body near a vertex, at the end of the step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BodyPoint {
    /// Signed distance from the surface to the vertex [m], negative inside.
    pub phi: f64,
    /// Outward unit direction in which that distance grows.
    pub normal: Vec3,
    /// Velocity of the material point below the vertex at the end of the step [m/s].
    pub velocity: Vec3,
    /// Displacement by which the body would have carried the vertex from its position at the start of the step [m]:
    /// the displacement of the body's material, which is the frame in which the vertex sticks or slides.
    pub displacement: Vec3,
    /// Triangle, for surfaces.
    pub triangle: u32,
}

/// Contact of cloth with a body.
#[derive(Debug, Clone, Copy)]
pub(crate) struct BodyContactProperties {
    /// Coulomb friction coefficient.
    pub friction: f64,
    /// Distance from the surface at which a vertex is in contact: thickness plus gap [m].
    pub offset: f64,
    /// Distance that cloth keeps [m].
    pub thickness: f64,
    /// Fastest speed of pushing out [m/s].
    pub max_push_speed: f64,
    /// Whether cloth and body pass through each other.
    pub is_ignored: bool,
}

#[derive(Debug)]
enum Kind {
    Rigid(Box<Rigid>),
    Surface(Box<Surface>),
}

#[derive(Debug)]
struct Surface {
    mesh: MovingSurface,
    /// The later of the two samples that the mesh moves between.
    latest: Sample,
    /// Crossings with itself at the two samples.
    crossings: [PartCrossings; 2],
    /// Parts that are deep inside others at the two samples, and at the start of the frame: these stay so for the frame.
    deep_parts: [DeepParts; 2],
    deep_at_frame: DeepParts,
    /// Parts that have passed through a surface within the frame.
    passed: DeepParts,
    /// Points of parts that lie in each other from the start of the run on.
    joined: Vec<u32>,
    /// Duration of a frame [s].
    frame: f64,
}

/// All bodies of a scene, between the ends of one step.
#[derive(Debug, Default)]
pub struct Bodies {
    list: Vec<Kind>,
    /// Contact of garments without rules with each of them.
    properties: Vec<BodyContactProperties>,
    times: [f64; 2],
    /// Time at which all motion that is given stands, while it does [s].
    standstill: Option<f64>,
}

impl Bodies {
    /// The bodies of a scene at its start; `samples[b]` is the first sample of each surface.
    ///
    /// # Errors
    /// A surface without a sample, or one whose sample does not fit.
    pub fn new(scene: &Scene, samples: &[Vec<Sample>], time: f64) -> Result<Self, Problems> {
        let (mut list, mut problems) = (Vec::new(), Vec::new());
        let frame = scene.description().timeline.frame_duration();
        for (b, description) in scene.description().bodies.iter().enumerate() {
            let first = samples.get(b).and_then(|s| s.last());
            match Kind::new(description, scene.shape_mesh(b), first, frame) {
                Ok(kind) => list.push(kind),
                Err(what) => problems.push(Problem::data(
                    format!("body \"{}\"", description.name),
                    what,
                    "look at the body's file around the first frame",
                )),
            }
        }
        let mut bodies = Self { list, properties: Vec::new(), times: [time; 2], standstill: None };
        if !problems.is_empty() {
            return Err(Problems(problems));
        }
        bodies.take_properties(scene);
        bodies.set_step(time, time);
        Ok(bodies)
    }

    /// Number of bodies.
    pub(crate) fn count(&self) -> usize {
        self.list.len()
    }

    /// Whether a body is a triangle surface.
    pub(crate) fn is_surface(&self, body: usize) -> bool {
        matches!(self.list[body], Kind::Surface(_))
    }

    /// Takes the numbers of contact from the bodies of a scene, which are the same bodies.
    pub(crate) fn take_properties(&mut self, scene: &Scene) {
        let gap = tolerances::CONTACT_GAP * scene.mean_edge();
        let of_body = |body: &BodyDescription| BodyContactProperties::of(body, gap);
        self.properties = scene.description().bodies.iter().map(of_body).collect();
    }

    /// Contact of garments without rules with each body.
    pub(crate) fn properties(&self) -> &[BodyContactProperties] {
        &self.properties
    }

    /// Takes the next sample of a surface; its motion from now on is from the last one to this one.
    ///
    /// # Errors
    /// The sample does not fit the surface.
    pub fn push_sample(&mut self, body: usize, sample: Sample) -> Result<(), String> {
        match &mut self.list[body] {
            Kind::Surface(surface) => surface.push(sample).map_err(|e| e.to_string()),
            Kind::Rigid(_) => Err("an analytic body takes no samples".into()),
        }
    }

    /// Keeps the deep parts at the start of a frame [s].
    pub(crate) fn begin_frame(&mut self, time: f64) {
        for body in &mut self.list {
            if let Kind::Surface(surface) = body
                && surface.latest.time <= time
            {
                surface.deep_at_frame = surface.deep_parts[1].clone();
                surface.passed = DeepParts::default();
            }
        }
    }

    /// Parts of surfaces that are deep inside others or were so from the start on, at the time of the last frame [s]; `cloth` is the
    /// number of the vertices of cloth, after which those of the bodies come. `None` without surfaces.
    pub(crate) fn save_deep_parts(&self, cloth: u32, frame_time: f64) -> Option<SavedSection> {
        let (mut first, mut deep, mut joined) = (cloth, Vec::new(), Vec::new());
        for body in &self.list {
            let Kind::Surface(surface) = body else { continue };
            let is_at_frame = surface.latest.time <= frame_time;
            let parts = if is_at_frame { &surface.deep_parts[1] } else { &surface.deep_at_frame };
            deep.extend(parts.points().iter().map(|point| first + point));
            joined.extend(surface.joined.iter().map(|point| first + point));
            first += surface.latest.positions.len() as u32;
        }
        (first > cloth).then(|| {
            SavedSection::new(DEEP_PARTS)
                .with("deep", Field::numbers(1, deep))
                .with("joined", Field::numbers(1, joined))
        })
    }

    /// Goes on from what was saved.
    ///
    /// # Errors
    /// A point that no surface has.
    pub(crate) fn restore_deep_parts(
        &mut self,
        cloth: u32,
        frame_time: f64,
        section: &SavedSection,
    ) -> Result<(), SnapshotError> {
        let [mut deep, mut joined] = ["deep", "joined"].map(|name| section.values::<u32>(name).to_vec());
        deep.sort_unstable();
        joined.sort_unstable();
        let mut range = cloth..cloth;
        for body in &mut self.list {
            let Kind::Surface(surface) = body else { continue };
            range = range.end..range.end + surface.latest.positions.len() as u32;
            let own = |all: &mut Vec<u32>| -> Vec<u32> {
                all.extract_if(.., |number| range.contains(number)).map(|number| number - range.start).collect()
            };
            surface.joined = own(&mut joined);
            surface.deep_at_frame = DeepParts::with_points(&surface.latest.positions, own(&mut deep));
            if surface.latest.time <= frame_time {
                surface.deep_parts[1] = surface.deep_at_frame.clone();
            }
        }
        let unknown = deep.first().or(joined.first());
        let what = |number: &u32| format!("it names point {number}, which no body has");
        unknown.map_or(Ok(()), |number| Err(SnapshotError { section: DEEP_PARTS.name.to_owned(), what: what(number) }))
    }

    /// Time of the latest sample of a surface [s].
    pub(crate) fn sampled_until(&self, body: usize) -> f64 {
        match &self.list[body] {
            Kind::Surface(surface) => surface.latest.time,
            Kind::Rigid(_) => f64::INFINITY,
        }
    }

    /// Puts all bodies at the ends of a step [s].
    pub fn set_step(&mut self, t0: f64, t1: f64) {
        self.times = [t0, t1];
        let [start, end] = self.times.map(|time| self.time_of_motion(time));
        for body in &mut self.list {
            match body {
                Kind::Rigid(rigid) => rigid.set_step(start, end),
                Kind::Surface(surface) => surface.mesh.set_step(start, end),
            }
        }
    }

    /// Stops all motion that is given at a time [s], or lets it go on. Steps keep their length: the cloth moves on.
    pub(crate) fn stand_still(&mut self, at: Option<f64>) {
        self.standstill = at;
    }

    /// Whether motion that is given stands.
    pub(crate) fn stands_still(&self) -> bool {
        self.standstill.is_some()
    }

    /// Time of bodies, pins, seams and wind at a time of the cloth [s].
    pub(crate) fn time_of_motion(&self, time: f64) -> f64 {
        self.standstill.unwrap_or(time)
    }

    /// Positions of the points that edges and faces of cloth meet at the end of the step [m]; empty for shapes that they do not meet.
    pub fn contact_positions(&self, body: usize) -> &[Vec3] {
        match &self.list[body] {
            Kind::Surface(surface) => surface.mesh.positions(),
            Kind::Rigid(rigid) => rigid.path()[1],
        }
    }

    /// Adds the same at a time [s] not after the latest sample to `all` [m].
    pub(crate) fn extend_with_contact_positions_at(&self, body: usize, time: f64, all: &mut Vec<Vec3>) {
        let time = self.time_of_motion(time);
        match &self.list[body] {
            Kind::Surface(surface) => surface.mesh.extend_with_positions_at(time, all),
            Kind::Rigid(rigid) => rigid.extend_with_points_at(time, all),
        }
    }

    /// The same at the start and at the end of the step [m].
    pub(crate) fn contact_path(&self, body: usize) -> [&[Vec3]; 2] {
        match &self.list[body] {
            Kind::Surface(surface) => surface.mesh.path(),
            Kind::Rigid(rigid) => rigid.path(),
        }
    }

    /// Pairs of triangles that cross each other at the latest samples, of each body.
    pub(crate) fn self_crossings(&self) -> impl Iterator<Item = usize> + '_ {
        self.list.iter().map(|body| if let Kind::Surface(surface) = body { surface.crossings[1].pairs() } else { 0 })
    }

    /// Number of bodies that are inside out at the end of the step.
    pub(crate) fn turned(&self) -> usize {
        let is_turned = |body: &&Kind| matches!(body, Kind::Surface(surface) if surface.mesh.is_turned());
        self.list.iter().filter(is_turned).count()
    }

    /// The attachment of a garment's vertex at `place` [m] to the nearest place of a surface at the end of the step.
    pub(crate) fn bind(&self, body: usize, vertex: u32, place: Vec3) -> Option<SurfaceAttachment> {
        let Kind::Surface(surface) = &self.list[body] else { return None };
        let found = surface.mesh.closest(&place, f64::MAX.sqrt(), None)?;
        let points = surface.mesh.triangles()[found.triangle as usize];
        let corners = points.map(|p| surface.mesh.positions()[p as usize]);
        Some(attach(vertex, place, points, found.weights, corners))
    }

    /// Length of the step [s].
    pub(crate) fn dt(&self) -> f64 {
        self.times[1] - self.times[0]
    }

    /// The place of a body closest to `x` [m] at the end of the step, if it is within `reach` [m]; `from` is where the vertex
    /// was at its start.
    pub fn closest(&self, body: usize, from: &Vec3, x: &Vec3, reach: f64, hint: Option<u32>) -> Option<BodyPoint> {
        match &self.list[body] {
            Kind::Rigid(rigid) => {
                let local = rigid.local(1, x);
                let (phi, normal) = rigid.shape.signed_distance(&local);
                (phi <= reach).then(|| rigid.point(from, &local, phi, &normal))
            }
            Kind::Surface(surface) => {
                let found = surface.mesh.closest(x, reach, hint)?;
                Some(surface.body_point(&found, x, self.dt()))
            }
        }
    }

    /// The answer of [`Bodies::closest`] for a surface, from a neighbourhood if it holds it; otherwise by a search, which makes the
    /// neighbourhood anew with a margin. `None` for other bodies.
    pub(crate) fn closest_near(
        &self,
        body: usize,
        x: &Vec3,
        (reach, margin): (f64, f64),
        hint: Option<u32>,
        around: &mut Neighbourhood,
    ) -> Option<BodyPoint> {
        let Kind::Surface(surface) = &self.list[body] else { return None };
        let found = surface.mesh.closest_among(around, x, reach).unwrap_or_else(|| {
            let (found, anew) = surface.mesh.closest_and_around(x, reach, hint, margin);
            *around = anew;
            found
        });
        found.map(|found| surface.body_point(&found, x, self.dt()))
    }

    /// The place through which a vertex enters a body when it moves straight from `from` at the start of the step to `to`
    /// at its end, as seen from `to`: the distance is that to the tangent plane of the entry. It is to keep `thickness` [m] from the body.
    pub(crate) fn entry(&self, body: usize, from: &Vec3, to: &Vec3, thickness: f64) -> Option<BodyPoint> {
        match &self.list[body] {
            Kind::Rigid(rigid) => {
                let (local_from, local_to) = (rigid.local(0, from), rigid.local(1, to));
                let share = rigid.shape.first_entry(&local_from, &local_to, thickness)?;
                let entry = local_from.lerp(&local_to, share);
                let (phi, normal) = rigid.shape.signed_distance(&entry);
                let phi = phi + normal.dot(&(local_to - entry));
                Some(rigid.point(from, &entry, phi, &normal))
            }
            Kind::Surface(surface) => {
                let hit = surface.mesh.path_hit(from, to, surface.crossings_that_count())?;
                let corners =
                    surface.mesh.triangles()[hit.triangle as usize].map(|p| surface.mesh.positions()[p as usize]);
                let normal = (corners[1] - corners[0]).cross(&(corners[2] - corners[0])).try_normalize(0.0)?;
                let normal = if hit.side == Side::Front { normal } else { -normal };
                let velocity = surface.mesh.velocity(hit.triangle, hit.weights);
                Some(BodyPoint {
                    phi: normal.dot(&(to - surface.mesh.point_at(hit.triangle, hit.weights, 1.0))),
                    normal,
                    velocity,
                    displacement: velocity * self.dt(),
                    triangle: hit.triangle,
                })
            }
        }
    }

    /// Whether a body may pass through itself around `x` [m] during the step: inside the boxes of its crossings at the two
    /// samples, joined and enlarged by `margin` [m].
    pub(crate) fn may_cross_itself(&self, body: usize, x: &Vec3, margin: f64) -> bool {
        match &self.list[body] {
            Kind::Surface(surface) => {
                let [a, b] = surface.crossings.each_ref().map(PartCrossings::region);
                a.union(b).enlarged(margin).overlaps(&Aabb::of_point(x))
            }
            Kind::Rigid(_) => false,
        }
    }

    /// Whether a part of any surface is deep inside another one at the sample before or after now.
    pub(crate) fn have_deep_parts(&self) -> bool {
        let has = |surface: &Surface| !surface.all_deep_parts().all(DeepParts::is_empty);
        self.list.iter().any(|body| matches!(body, Kind::Surface(surface) if has(surface)))
    }

    /// Whether a point of a surface belongs to a part that is deep inside another one at the sample before or after now.
    pub(crate) fn is_deep(&self, body: usize, point: u32) -> bool {
        match &self.list[body] {
            Kind::Surface(surface) => surface.all_deep_parts().any(|parts| parts.contains(point)),
            Kind::Rigid(_) => false,
        }
    }

    /// Whether a vertex at `x` [m] that has touched a triangle of a surface, and that the surface carried from `carried` [m], is where a
    /// part of the surface goes deep into another one or comes out of it: on that part, or inside the surface.
    pub(crate) fn is_in_deep_part(&self, body: usize, triangle: u32, [x, carried]: [&Vec3; 2], margin: f64) -> bool {
        let Kind::Surface(surface) = &self.list[body] else { return false };
        let corners = surface.mesh.triangles().get(triangle as usize);
        let is_on_it = || corners.is_some_and(|corners| corners.iter().any(|point| self.is_deep(body, *point)));
        let region = surface.all_deep_parts().fold(Aabb::EMPTY, |all, parts| all.union(parts.region()));
        let is_near = region.enlarged(margin).overlaps(&Aabb::of_point(x));
        is_near && (is_on_it() || self.contains(body, carried))
    }

    /// Whether a part of a surface passes through another one fast, or has just done so.
    pub(crate) fn has_passing_part(&self, body: usize) -> bool {
        match &self.list[body] {
            Kind::Surface(surface) => {
                let passes = surface.deep_parts.iter().any(DeepParts::has_passing) || !surface.passed.is_empty();
                passes || (surface.crossings[0].pairs() == 0 && !surface.deep_at_frame.is_empty())
            }
            Kind::Rigid(_) => false,
        }
    }

    /// Whether a surface crosses itself close to one of its points, at the sample before or after now.
    pub(crate) fn crosses_itself_at(&self, body: usize, point: u32) -> bool {
        match &self.list[body] {
            Kind::Surface(surface) => surface.crossings.iter().any(|crossings| crossings.is_near(point)),
            Kind::Rigid(_) => false,
        }
    }

    /// Whether `x` [m] lies inside a body at the end of the step, also where the body's surfaces pass through one another.
    pub(crate) fn contains(&self, body: usize, x: &Vec3) -> bool {
        match &self.list[body] {
            Kind::Rigid(rigid) => rigid.shape.signed_distance(&rigid.local(1, x)).0 < 0.0,
            Kind::Surface(surface) => surface.mesh.is_closed() && surface.mesh.winding_number(x) > 0,
        }
    }

    /// Signed distance of `x` from a rigid body at the start of the step [m]; zero for surfaces, which keep no tree there.
    pub(crate) fn distance_at_start(&self, body: usize, x: &Vec3) -> f64 {
        match &self.list[body] {
            Kind::Rigid(rigid) => rigid.shape.signed_distance(&rigid.local(0, x)).0,
            Kind::Surface(_) => 0.0,
        }
    }

    /// Bounds on a rigid body around `x` [m] at the start of the step, cheap and safe from rounding; none on surfaces.
    pub(crate) fn bounds(&self, body: usize, x: &Vec3) -> Option<Bounds> {
        match &self.list[body] {
            Kind::Rigid(rigid) => Some(rigid.bounds(x)),
            Kind::Surface(_) => None,
        }
    }

    /// Fastest point of a surface between its samples [m/s]; infinite for rigid bodies, whose distances are cheap.
    pub(crate) fn fastest(&self, body: usize) -> f64 {
        match &self.list[body] {
            Kind::Surface(surface) => surface.mesh.fastest(),
            Kind::Rigid(_) => f64::INFINITY,
        }
    }
}

impl BodyContactProperties {
    /// Contact with a body at this gap [m] beyond its thickness.
    fn of(body: &BodyDescription, gap: f64) -> Self {
        let BodyDescription { friction, thickness, max_push_speed, .. } = *body;
        Self { friction, offset: thickness + gap, thickness, max_push_speed, is_ignored: false }
    }

    /// Friction on a vertex with this painted friction: what multiplies the body's, and what is added.
    pub(crate) fn friction_on(&self, painted: Option<&[f64; 2]>) -> f64 {
        painted.map_or(self.friction, |[times, more]| times * self.friction + more)
    }

    /// Returns the part of a depth [m] by which cloth comes out in a step of `dt` [s].
    pub(crate) fn depenetration(&self, depth: f64, dt: f64, recovery_speed: RecoverySpeed) -> f64 {
        recovery_speed.of(depth).min(dt * self.max_push_speed)
    }
}

impl Kind {
    /// The body with its first sample, in frames that take this long [s].
    fn new(
        description: &BodyDescription,
        mesh: Option<&ShapeMesh>,
        first: Option<&Sample>,
        frame: f64,
    ) -> Result<Self, String> {
        let shape = match &description.shape {
            BodyShape::Rigid(shape) => *shape,
            BodyShape::Surface { triangles, point_count } => {
                let first = first.ok_or("there is no sample of its positions at the start")?;
                let mut surface = Surface {
                    mesh: MovingSurface::new(triangles.clone(), *point_count)
                        .map_err(|e| e.to_string())?
                        .facing(description.faces_inwards),
                    latest: first.clone(),
                    crossings: [PartCrossings::default(), PartCrossings::default()],
                    deep_parts: [DeepParts::default(), DeepParts::default()],
                    deep_at_frame: DeepParts::default(),
                    passed: DeepParts::default(),
                    joined: Vec::new(),
                    frame,
                };
                surface.push(first.clone()).map_err(|e| e.to_string())?;
                surface.crossings[0] = surface.crossings[1].clone();
                surface.joined = deep_points(&surface.mesh, &surface.crossings[0], &first.positions);
                surface.deep_parts = [DeepParts::default(), DeepParts::default()];
                return Ok(Self::Surface(Box::new(surface)));
            }
        };
        let points = mesh.map_or_else(Vec::new, |mesh| mesh.points.clone());
        Ok(Self::Rigid(Box::new(Rigid::new(shape, description.motion.clone(), points))))
    }
}

impl Surface {
    /// A place of the surface as a vertex at `x` [m] finds it, in a step of length `dt` [s].
    fn body_point(&self, found: &SurfacePoint, x: &Vec3, dt: f64) -> BodyPoint {
        let velocity = self.mesh.velocity(found.triangle, found.weights);
        BodyPoint {
            phi: found.distance,
            normal: found.gradient(x),
            velocity,
            displacement: velocity * dt,
            triangle: found.triangle,
        }
    }

    fn push(&mut self, sample: Sample) -> Result<(), crate::geometry::moving_surface::SurfaceError> {
        let (a, b) = (&self.latest, &sample);
        self.mesh.set_samples(a.time, &a.positions, b.time, &b.positions)?;
        let span = b.time - a.time;
        self.crossings.swap(0, 1);
        self.crossings[1] = PartCrossings::of(&self.mesh, &b.positions);
        let [x, y] = [&a.positions, &b.positions];
        let share = if span > 0.0 { self.frame / span } else { 0.0 };
        let moved = |point: u32| (y[point as usize] - x[point as usize]) * share;
        let [before, now] = &self.crossings;
        let deep = |crossings, x| DeepParts::of(&self.mesh, crossings, x, &moved, &self.joined);
        let at_start = deep(before, x);
        self.passed = self.passed.and_passing(&at_start, y);
        let at_end = deep(now, y).and(&self.passed);
        self.deep_parts = [at_start.and(&self.deep_parts[1]), at_end];
        self.deep_at_frame.up_to(y);
        self.latest = sample;
        Ok(())
    }

    /// Parts that are deep inside others between the samples.
    fn all_deep_parts(&self) -> impl Iterator<Item = &DeepParts> {
        self.deep_parts.iter().chain([&self.deep_at_frame])
    }

    /// A closed body can only be entered; an open surface is met from both sides.
    fn crossings_that_count(&self) -> Crossings {
        if self.mesh.is_closed() { Crossings::Entering } else { Crossings::Any }
    }
}
