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
pub mod recovery_speed;
mod rigid;
mod samples;

use crate::Vec3;
use crate::contact::bodies::recovery_speed::RecoverySpeed;
use crate::contact::bodies::rigid::{Bounds, Rigid};
use crate::error::{Problem, Problems};
use crate::geometry::aabb::Aabb;
use crate::geometry::attachment::{SurfaceAttachment, attach};
use crate::geometry::moving_surface::MovingSurface;
use crate::geometry::path::{Crossings, Side};
use crate::geometry::shape_mesh::ShapeMesh;
use crate::scene::{BodyDescription, BodyShape, Scene};
use crate::tolerances;

pub use samples::{Sample, Samples};

/// Rings of triangles around those of a surface that cross each other in which cloth counts as pinched.
const CROSSING_RINGS: usize = 2;

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
    /// Boxes of the triangles that cross each other at the two samples.
    crossing_regions: [Aabb; 2],
    /// Points around those triangles at the two samples, ascending.
    crossing_points: [Vec<u32>; 2],
    /// Points inside another part of the surface, farther than an edge of cloth from where it crosses itself, at the two samples,
    /// ascending.
    deep_points: [Vec<u32>; 2],
    /// Mean length of the edges of cloth [m].
    edge: f64,
    /// Pairs of triangles that cross each other at the later sample.
    crossings: usize,
    /// Fastest point between the samples [m/s].
    speed: f64,
    /// Time between the samples [s].
    span: f64,
}

/// All bodies of a scene, between the ends of one step.
#[derive(Debug, Default)]
pub struct Bodies {
    list: Vec<Kind>,
    /// Contact of garments without rules with each of them.
    properties: Vec<BodyContactProperties>,
    times: [f64; 2],
}

impl Bodies {
    /// The bodies of a scene at its start; `samples[b]` is the first sample of each surface.
    ///
    /// # Errors
    /// A surface without a sample, or one whose sample does not fit.
    pub fn new(scene: &Scene, samples: &[Vec<Sample>], time: f64) -> Result<Self, Problems> {
        let (mut list, mut problems) = (Vec::new(), Vec::new());
        for (b, description) in scene.description().bodies.iter().enumerate() {
            let first = samples.get(b).and_then(|s| s.last());
            match Kind::new(description, scene.shape_mesh(b), first, scene.mean_edge()) {
                Ok(kind) => list.push(kind),
                Err(what) => problems.push(Problem::data(
                    format!("body \"{}\"", description.name),
                    what,
                    "look at the body's file around the first frame",
                )),
            }
        }
        let mut bodies = Self { list, properties: Vec::new(), times: [time; 2] };
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
        for body in &mut self.list {
            match body {
                Kind::Rigid(rigid) => rigid.set_step(t0, t1),
                Kind::Surface(surface) => surface.mesh.set_step(t0, t1),
            }
        }
    }

    /// Positions of the points that edges and faces of cloth meet at the end of the step [m]; empty for shapes that they do not meet.
    pub fn contact_positions(&self, body: usize) -> &[Vec3] {
        match &self.list[body] {
            Kind::Surface(surface) => surface.mesh.positions(),
            Kind::Rigid(rigid) => rigid.path()[1],
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
        self.list.iter().map(|body| if let Kind::Surface(surface) = body { surface.crossings } else { 0 })
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
                let velocity = surface.mesh.velocity(found.triangle, found.weights);
                Some(BodyPoint {
                    phi: found.distance,
                    normal: found.gradient(x),
                    velocity,
                    displacement: velocity * self.dt(),
                    triangle: found.triangle,
                })
            }
        }
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
                let [a, b] = &surface.crossing_regions;
                a.union(b).enlarged(margin).overlaps(&Aabb::of_point(x))
            }
            Kind::Rigid(_) => false,
        }
    }

    /// Whether any surface crosses itself at the sample before or after now.
    pub(crate) fn cross_themselves(&self) -> bool {
        let crosses = |surface: &Surface| surface.crossing_points.iter().any(|points| !points.is_empty());
        self.list.iter().any(|body| matches!(body, Kind::Surface(surface) if crosses(surface)))
    }

    /// Whether a point of a surface was deep inside another part of it at the sample before now.
    pub(crate) fn was_deep(&self, body: usize, point: u32) -> bool {
        match &self.list[body] {
            Kind::Surface(surface) => surface.deep_points[0].binary_search(&point).is_ok(),
            Kind::Rigid(_) => false,
        }
    }

    /// Whether a triangle of a surface has such a point.
    pub(crate) fn was_deep_at(&self, body: usize, triangle: u32) -> bool {
        match &self.list[body] {
            Kind::Surface(surface) => {
                surface.mesh.triangles()[triangle as usize].iter().any(|point| self.was_deep(body, *point))
            }
            Kind::Rigid(_) => false,
        }
    }

    /// Time between the samples of a surface [s]; infinite for rigid bodies.
    pub(crate) fn sample_span(&self, body: usize) -> f64 {
        match &self.list[body] {
            Kind::Surface(surface) => surface.span,
            Kind::Rigid(_) => f64::INFINITY,
        }
    }

    /// Whether a surface crosses itself close to one of its points, at the sample before or after now.
    pub(crate) fn crosses_itself_at(&self, body: usize, point: u32) -> bool {
        match &self.list[body] {
            Kind::Surface(surface) => surface.crossing_points.iter().any(|points| points.binary_search(&point).is_ok()),
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
            Kind::Surface(surface) => surface.speed,
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
    /// A body of a scene whose cloth has edges of a mean length of `edge` [m].
    fn new(
        description: &BodyDescription,
        mesh: Option<&ShapeMesh>,
        first: Option<&Sample>,
        edge: f64,
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
                    crossing_regions: [Aabb::EMPTY; 2],
                    crossing_points: [Vec::new(), Vec::new()],
                    deep_points: [Vec::new(), Vec::new()],
                    edge,
                    crossings: 0,
                    speed: 0.0,
                    span: 0.0,
                };
                surface.push(first.clone()).map_err(|e| e.to_string())?;
                surface.crossing_regions[0] = surface.crossing_regions[1];
                return Ok(Self::Surface(Box::new(surface)));
            }
        };
        let points = mesh.map_or_else(Vec::new, |mesh| mesh.points.clone());
        Ok(Self::Rigid(Box::new(Rigid::new(shape, description.motion.clone(), points))))
    }
}

impl Surface {
    fn push(&mut self, sample: Sample) -> Result<(), crate::geometry::moving_surface::SurfaceError> {
        let (a, b) = (&self.latest, &sample);
        self.mesh.set_samples(a.time, &a.positions, b.time, &b.positions)?;
        let span = b.time - a.time;
        let farthest =
            a.positions.iter().zip(&b.positions).map(|(a, b)| (a - b).norm_squared()).fold(0.0, f64::max).sqrt();
        self.speed = if span > 0.0 { farthest / span } else { 0.0 };
        self.span = span;
        let found = self.mesh.self_crossing(&b.positions);
        self.crossings = found.pairs.len();
        let corners = found.pairs.iter().flatten().flat_map(|t| self.mesh.triangles()[*t as usize]);
        let region = corners.fold(Aabb::EMPTY, |r, c| r.union(&Aabb::of_point(&b.positions[c as usize])));
        self.crossing_regions.swap(0, 1);
        self.crossing_points.swap(0, 1);
        self.crossing_points[1] = points_around(self.mesh.triangles(), &found.triangles());
        let covered = self.covered_points(&region);
        let crossing: Vec<Vec3> = found
            .triangles()
            .iter()
            .flat_map(|t| self.mesh.triangles()[*t as usize])
            .map(|point| b.positions[point as usize])
            .collect();
        let is_deep = |point: &u32| {
            let place = b.positions[*point as usize];
            crossing.iter().all(|other| (other - place).norm() > self.edge)
        };
        self.deep_points.swap(0, 1);
        self.deep_points[1] = covered.iter().copied().filter(is_deep).collect();
        let around = |region: Aabb, point: &u32| region.union(&Aabb::of_point(&b.positions[*point as usize]));
        self.crossing_regions[1] = covered.iter().fold(region, around);
        self.crossing_points[1].extend(covered);
        self.crossing_points[1].sort_unstable();
        self.crossing_points[1].dedup();
        self.latest = sample;
        Ok(())
    }

    /// Points of a closed surface that lie inside another part of it, at the latest positions: those in `region`, which holds the
    /// triangles that cross, and all that the surface joins to them inside.
    fn covered_points(&self, region: &Aabb) -> Vec<u32> {
        let (triangles, x) = (self.mesh.triangles(), self.mesh.positions());
        if !self.mesh.is_closed() || self.crossings == 0 {
            return Vec::new();
        }
        // A little outside of the surface around the point: inside only if another part of the body is there.
        let mut outwards = vec![Vec3::zeros(); x.len()];
        let mut edges = Vec::with_capacity(3 * triangles.len());
        for corners in triangles {
            let [a, b, c] = corners.map(|point| x[point as usize]);
            let normal = (b - a).cross(&(c - a));
            corners.iter().for_each(|&point| outwards[point as usize] += normal);
            // Each edge of a closed surface is an edge of another triangle, the other way round.
            edges.extend((0..3).map(|corner| [corners[corner], corners[(corner + 1) % 3]]));
        }
        edges.sort_unstable();
        let is_covered = |point: u32| {
            let (place, across) = (x[point as usize], outwards[point as usize]);
            let length = across.norm().sqrt();
            let outside = across.try_normalize(0.0).map(|n| place + n * (tolerances::BESIDE_SURFACE * length));
            outside.is_some_and(|p| self.mesh.winding_number(&p) > 0)
        };
        let mut found = vec![false; x.len()];
        let within = |point: &u32| region.overlaps(&Aabb::of_point(&x[*point as usize]));
        let mut next: Vec<u32> = (0..x.len() as u32).filter(within).collect();
        let mut is_asked = vec![false; x.len()];
        next.iter().for_each(|point| is_asked[*point as usize] = true);
        while let Some(point) = next.pop() {
            if !is_covered(point) {
                continue;
            }
            found[point as usize] = true;
            let first = edges.partition_point(|[from, _]| *from < point);
            for [_, to] in edges[first..].iter().take_while(|[from, _]| *from == point) {
                if !std::mem::replace(&mut is_asked[*to as usize], true) {
                    next.push(*to);
                }
            }
        }
        (0..x.len() as u32).filter(|point| found[*point as usize]).collect()
    }

    /// A closed body can only be entered; an open surface is met from both sides.
    fn crossings_that_count(&self) -> Crossings {
        if self.mesh.is_closed() { Crossings::Entering } else { Crossings::Any }
    }
}

/// The points of some triangles and of their neighbours, ascending.
fn points_around(triangles: &[[u32; 3]], some: &[u32]) -> Vec<u32> {
    let mut points: Vec<u32> = some.iter().flat_map(|&t| triangles[t as usize]).collect();
    for _ in 0..CROSSING_RINGS {
        points.sort_unstable();
        points.dedup();
        let touches = |t: &&[u32; 3]| t.iter().any(|point| points.binary_search(point).is_ok());
        let more: Vec<u32> =
            if points.is_empty() { Vec::new() } else { triangles.iter().filter(touches).flatten().copied().collect() };
        points.extend(more);
    }
    points.sort_unstable();
    points.dedup();
    points
}
