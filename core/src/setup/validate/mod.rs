//! From a description to a scene: every problem is reported. Elements that cannot be simulated are left out
//! (`crate::setup::mesh_checks::degenerate`), and nothing is repaired.

mod contacts;
mod curves;
mod maps_and_seams;
pub(crate) mod unused;

use std::collections::BTreeSet;
use std::ops::Range;
use std::sync::Arc;

use crate::Vec3;
use crate::effects;
use crate::effects::inputs::{EffectInput, INPUTS};
use crate::effects::spec::Scope;
use crate::error::{Problem, Problems};
use crate::mesh::TriangleMesh;
use crate::parallel::parts::Parts;
use crate::parallel::problems::{LISTED, agree};
use crate::parallel::ranks::Ranks;
use crate::scene::names;
use crate::scene::origin::check_origin;
use crate::scene::seam_pairs::Sewn;
use crate::scene::vertex_maps::PaintedMaps;
use crate::scene::{
    BodyDescription, BodyShape, Described, EffectRequest, FARTHEST, GarmentDescription, Mass, PinHold, PinTarget,
    Scene, SceneDescription, is_possible,
};
use crate::settings::{Field, Settings, Written, nearest};
use crate::setup::distribute::scatter::SceneScatter;
use crate::setup::distribute::submesh;
use crate::setup::shape_meshes::shape_meshes;
use contacts::{check_contacts, check_parts};
use curves::check_curves;
pub(crate) use curves::check_number;
use maps_and_seams::{check_elastics, check_maps, check_maps_are_used, check_seams};
use unused::check_unused;

impl Scene {
    /// Returns the problems of a description that can be found without the elements of its meshes: before they are built, and soon.
    pub fn problems_of(description: &SceneDescription) -> Vec<Problem> {
        check_description(description)
    }

    /// Checks a description and derives what does not change: triangulation, masses, parts; on one rank.
    ///
    /// # Errors
    /// All problems at once, each with its place and what to do.
    pub fn validate(description: SceneDescription) -> Result<Self, Problems> {
        Self::distribute(&Ranks::default(), Some(description))
    }

    /// The same over ranks: rank 0 gives the description, which it hands out piece by piece. All ranks call it together.
    ///
    /// # Errors
    /// All problems at once, the same on every rank.
    pub fn distribute(ranks: &Ranks, description: Option<SceneDescription>) -> Result<Self, Problems> {
        let description = description.filter(|_| ranks.is_first());
        let mut problems = description.as_ref().map_or_else(Vec::new, check_description);
        let description = description.map(SceneDescription::with_numbers_at_start);
        let handed = SceneScatter::begin(ranks, description, &mut problems);
        agree(ranks, problems)?;
        let mut scene = handed.finish(ranks).derive();
        scene.shape_meshes = Arc::new(shape_meshes(&scene.description));
        agree(ranks, check_isolated(&scene.description, &scene.parts, &scene.sewn, scene.isolated()))?;
        scene.settle_origin();
        Ok(scene)
    }

    /// The scene with another assignment of the parts to the ranks (first part of every rank, and the number of all). All ranks
    /// call it together.
    pub(crate) fn reassigned(&self, assignment: Vec<usize>) -> Self {
        submesh::migrate(self, assignment).derive()
    }

    /// Adds what follows from a rank's pieces.
    pub(crate) fn derive(mut self) -> Self {
        // Masses and tolerances are those of the shape as it was modelled.
        let meshes = std::mem::take(&mut self.meshes).into_iter();
        self.meshes = meshes.map(|mesh| mesh.scaled(1.0)).collect();
        let Self { description, parts, meshes, painted, .. } = &self;
        let isolated = isolated(parts, meshes);
        let masses = masses(description, parts, meshes, painted, isolated.as_deref());
        self.mean_edge = mean_edge(parts, meshes);
        (self.masses, self.isolated) = (masses, isolated);
        let meshes = std::mem::take(&mut self.meshes).into_iter().zip(&self.description.garments);
        self.meshes = meshes.map(|(mesh, garment)| mesh.scaled(garment.rest_scale)).collect();
        self
    }
}

/// Returns the problems that can be found without the elements of the meshes.
fn check_description(description: &SceneDescription) -> Vec<Problem> {
    let mut problems = Vec::new();
    check_solver(description, &mut problems);
    check_origin(description, &mut problems);
    check_names(description, &mut problems);
    for garment in &description.garments {
        check_garment(garment, &mut problems);
    }
    for body in &description.bodies {
        check_body(body, &mut problems);
    }
    check_pins(description, &mut problems);
    check_elastics(description, &mut problems);
    check_seams(description, &mut problems);
    check_parts(description, &mut problems);
    check_contacts(description, &mut problems);
    check_curves(description, &mut problems);
    check_effects(description, &mut problems);
    check_unused(description, &mut problems);
    problems
}

/// Own vertices that no triangle has, ascending, if any rank has such.
fn isolated(parts: &Parts, meshes: &[TriangleMesh]) -> Option<Vec<u32>> {
    let mut is_isolated = vec![true; parts.local_count()];
    for (g, mesh) in meshes.iter().enumerate() {
        let of_garment = &mut is_isolated[parts.garment(g)];
        mesh.triangles().iter().flatten().for_each(|v| of_garment[*v as usize] = false);
    }
    let isolated: Vec<u32> = parts.own().filter(|v| is_isolated[*v]).map(|v| v as u32).collect();
    parts.ranks().any(!isolated.is_empty()).then_some(isolated)
}

/// Mass of each local vertex [kg]. What takes no part has none of the garment's, and formally that of a vertex in the mean.
fn masses(
    description: &SceneDescription,
    parts: &Parts,
    meshes: &[TriangleMesh],
    painted: &[PaintedMaps],
    isolated: Option<&[u32]>,
) -> Vec<f64> {
    let mut masses = vec![0.0; parts.local_count()];
    for (g, (garment, mesh)) in description.garments.iter().zip(meshes).enumerate() {
        let of_garment = &mut masses[parts.garment(g)];
        match garment.mass {
            Mass::UniformTotal(total) => of_garment.fill(total / parts.partition().garments()[g].len() as f64),
            Mass::Density(density) => {
                let map = painted[g].get("density");
                let of = |v: u32| map.map_or(density, |map| map.at(v as usize, density));
                for (triangle, area) in mesh.triangles().iter().zip(mesh.rest_areas()) {
                    triangle.iter().for_each(|v| of_garment[*v as usize] += of(*v) * area / 3.0);
                }
            }
        }
    }
    if let Some(isolated) = isolated {
        share_among_the_rest(description, parts, isolated, &mut masses);
    }
    // Ghosts have triangles that are not here.
    parts.halo().update(parts.ranks(), &mut masses);
    masses
}

/// Gives a total mass to the vertices that take part alone, and the others the mean of these.
fn share_among_the_rest(description: &SceneDescription, parts: &Parts, isolated: &[u32], masses: &mut [f64]) {
    let takes_part = |v: usize| isolated.binary_search(&(v as u32)).is_err();
    for (g, garment) in description.garments.iter().enumerate() {
        let own = parts.own_of_garment(g);
        let in_part =
            |part: &Range<usize>| part.clone().filter(|v| own.contains(v) && takes_part(*v)).collect::<Vec<_>>();
        let parts_of: Vec<Vec<usize>> = parts.ranges().iter().map(in_part).collect();
        let counts: Vec<f64> = parts_of.iter().map(|part| part.len() as f64).collect();
        let sums: Vec<f64> = parts_of.iter().map(|part| part.iter().map(|v| masses[*v]).sum()).collect();
        let [count, sum] = parts.join_parts(&[&counts, &sums]);
        let mean = match garment.mass {
            // Without cloth any mass will do.
            _ if count == 0.0 => 1.0,
            Mass::UniformTotal(total) => total / count,
            Mass::Density(_) => sum / count,
        };
        let uniform = matches!(garment.mass, Mass::UniformTotal(_));
        own.filter(|v| uniform || !takes_part(*v)).for_each(|v| masses[v] = mean);
    }
}

/// Mean rest length of all edges [m], one metre if there are none; each belongs to the part of its first vertex.
fn mean_edge(parts: &Parts, meshes: &[TriangleMesh]) -> f64 {
    let (mut sums, mut count) = (vec![0.0; parts.count()], 0);
    for (g, mesh) in meshes.iter().enumerate() {
        let first = parts.garment(g).start;
        for edge in mesh.edges() {
            let vertex = first + edge.vertices[0] as usize;
            if parts.own().contains(&vertex) {
                sums[parts.part_of(vertex)] += mesh.rest_length(*edge);
                count += 1;
            }
        }
    }
    let ([sum], [count]) = (parts.join_parts(&[&sums]), parts.ranks().sum_of([count]));
    if count > 0 { sum / count as f64 } else { 1.0 }
}

/// Values against the rows of their table.
fn check_values<T: Described>(place: &str, described: &T, problems: &mut Vec<Problem>) {
    check_fields(place, T::FIELDS, &described.written(), problems);
}

fn check_fields(place: &str, fields: &[Field], written: &Written, problems: &mut Vec<Problem>) {
    let wrong = Settings::check(fields, written).err().unwrap_or_default();
    problems.extend(wrong.into_iter().map(|what| Problem::scene(place, what, "correct it in the scene file")));
}

fn check_solver(description: &SceneDescription, problems: &mut Vec<Problem>) {
    let timeline = &description.timeline;
    if timeline.fps_numerator == 0 || timeline.fps_denominator == 0 {
        problems.push(Problem::scene("shot.fps", "the frame rate is zero", "write for example fps = \"24\""));
    }
    if timeline.start > timeline.origin {
        problems.push(Problem::scene(
            "shot",
            "the simulation starts after the first frame",
            "let it start at or before it",
        ));
    }
    check_values("solver", &description.solver, problems);
    if description.garments.is_empty() {
        problems.push(Problem::scene("scene", "there is no garment to simulate", "add a [[garment]]"));
    }
}

/// Longest name of a garment or body [bytes]: file systems allow 255, of which the endings of a cache take up to 20 while it is
/// written anew.
const LONGEST_NAME: usize = 235;

fn check_names(description: &SceneDescription, problems: &mut Vec<Problem>) {
    let kinds: [(&str, Vec<&str>); 2] = [
        ("garment", description.garments.iter().map(|g| g.name.as_str()).collect()),
        ("body", description.bodies.iter().map(|b| b.name.as_str()).collect()),
    ];
    for (kind, names) in kinds {
        let mut seen = BTreeSet::new();
        for name in names {
            if let Some(why) = names::why_unusable(name) {
                let what = format!("{name:?} is not a valid name for files and objects: {why}");
                problems.push(Problem::scene(kind, what, "use letters, digits, _ and -"));
            }
            if name.len() > LONGEST_NAME {
                let what = format!("a name of {} bytes is too long for files and objects", name.len());
                let advice = format!("use at most {LONGEST_NAME} bytes; letters without accents take one each");
                problems.push(Problem::scene(format!("{kind} {name:?}"), what, advice));
            }
            if !seen.insert(name) {
                problems.push(Problem::scene(
                    format!("{kind} \"{name}\""),
                    "this name is used twice",
                    "rename one of them",
                ));
            }
        }
    }
}

fn check_garment(garment: &GarmentDescription, problems: &mut Vec<Problem>) {
    let place = |what: &str| format!("garment \"{}\"{what}", garment.name);
    if garment.point_count() == 0 {
        problems.push(Problem::data(place(""), "it has no points", "export a mesh with polygons; its file is empty"));
    }
    check_values(&place(""), garment, problems);
    if !is_possible(&garment.velocity) {
        problems.push(Problem::scene(
            place(", velocity"),
            format!("it is not finite, or above {FARTHEST:e} m/s"),
            "write three numbers in m/s",
        ));
    }
    if let Some(velocities) = &garment.start_velocities {
        if velocities.len() != garment.point_count() {
            let what = format!("{} velocities are given for {} points", velocities.len(), garment.point_count());
            problems.push(Problem::data(place(", start velocities"), what, "give one for each point"));
        }
        finite_points(&place(", start velocities"), velocities, problems);
    }
    check_maps(garment, problems);
    if let Some(start) = &garment.start {
        if start.len() != garment.point_count() {
            let what = format!("the start pose has {} points, the rest shape {}", start.len(), garment.point_count());
            problems.push(Problem::data(place(""), what, "use a start pose of the same mesh"));
        }
        finite_points(&place(", start pose"), start, problems);
        if let [first, second, rest @ ..] = start.as_slice()
            && second == first
            && rest.iter().all(|point| point == first)
        {
            let what = format!("all {} points are in one place, {:?}", start.len(), <[f64; 3]>::from(*first));
            let advice = "export the pose in which the garment starts; leave `start` out to start at rest";
            problems.push(Problem::data(place(", start pose"), what, advice));
        }
    }
}

fn finite_points(place: &str, points: &[Vec3], problems: &mut Vec<Problem>) {
    let broken = points.iter().enumerate().filter(|(_, p)| !is_possible(p)).map(|(i, _)| i);
    report(broken, problems, |list| {
        Problem::data(
            place,
            format!("vertices {list} are not finite numbers, or beyond {FARTHEST:e}"),
            "repair these points and export the mesh again",
        )
    });
}

/// Seams at vertices that take no part: nothing would draw the cloth there.
fn check_isolated(
    description: &SceneDescription,
    parts: &Parts,
    sewn: &[Sewn],
    isolated: Option<&[u32]>,
) -> Vec<Problem> {
    let mut ends: Vec<u32> = sewn.iter().flat_map(Sewn::vertices).collect();
    ends.sort_unstable();
    let isolated =
        isolated.unwrap_or_default().iter().filter(|v| ends.binary_search(&parts.number(**v as usize)).is_ok());
    let problem = |local: &u32| {
        let (garment, vertex) = parts.own_vertex(*local as usize);
        let place = format!("garment \"{}\", vertex {vertex}", description.garments[garment].name);
        Problem::data(place, "it is sewn, but belongs to no face that has an area", "sew a vertex of the cloth instead")
    };
    isolated.take(LISTED).map(problem).collect()
}

/// Adds one problem for a list of elements, if there are any; long lists are cut.
fn report<T: ToString>(
    elements: impl Iterator<Item = T>,
    problems: &mut Vec<Problem>,
    make: impl FnOnce(String) -> Problem,
) {
    let mut names = Vec::new();
    let mut count = 0;
    for element in elements {
        count += 1;
        if names.len() < LISTED {
            names.push(element.to_string());
        }
    }
    if count > 0 {
        let more = if count > LISTED { format!(" and {} more", count - LISTED) } else { String::new() };
        problems.push(make(format!("{}{more}", names.join(", "))));
    }
}

fn check_body(body: &BodyDescription, problems: &mut Vec<Problem>) {
    let place = format!("body \"{}\"", body.name);
    match &body.shape {
        BodyShape::Rigid(shape) => {
            let (spec, sizes) = shape.written();
            check_fields(&place, spec.fields, &sizes, problems);
        }
        BodyShape::Surface { triangles, .. } if triangles.is_empty() => {
            problems.push(Problem::data(&place, "it has no faces", "choose an object path that holds a mesh"));
        }
        BodyShape::Surface { .. } => {}
    }
    check_values(&place, body, problems);
    check_path(&place, &body.motion.path, problems);
}

/// Times that do not ascend, and places that are none.
fn check_path(place: &str, path: &[(f64, Vec3)], problems: &mut Vec<Problem>) {
    let ascending = path.windows(2).all(|w| w[0].0 < w[1].0);
    let finite = path.iter().all(|(t, x)| t.is_finite() && is_possible(x));
    if !ascending || !finite {
        problems.push(Problem::scene(place, "its path needs ascending times and finite positions", "correct `path`"));
    }
}

fn check_pins(description: &SceneDescription, problems: &mut Vec<Problem>) {
    // Hard holds by (garment, vertex, axis): two at the same time contradict each other.
    let mut holds: Vec<(usize, u32, usize, f64, f64, usize)> = Vec::new();
    for (p, pin) in description.pins.iter().enumerate() {
        let Some(garment) = description.garments.get(pin.garment) else {
            problems.push(Problem::scene(
                format!("pin {p}"),
                "it names a garment that does not exist",
                "correct its garment",
            ));
            continue;
        };
        let place = format!("garment \"{}\", pin {p}", garment.name);
        let count = garment.point_count();
        let vertices: Vec<u32> = match &pin.target {
            PinTarget::Path { vertices, offsets, .. } => {
                check_path(&place, offsets, problems);
                vertices.clone()
            }
            PinTarget::Track { vertices, .. } => vertices.clone(),
            PinTarget::BodyNearest { vertices, body } => {
                check_pin_body(description, *body, &place, problems);
                vertices.clone()
            }
            PinTarget::Body { body, attachments } => {
                if let Some(points) = check_pin_body(description, *body, &place, problems) {
                    let bad = attachments.iter().filter(|a| a.body_points.iter().any(|b| *b as usize >= points));
                    report(bad.map(|a| a.vertex), problems, |list| {
                        let what =
                            format!("vertices {list} are attached to body points that do not exist ({points} points)");
                        Problem::data(&place, what, "use the attachments made for this body")
                    });
                }
                attachments.iter().map(|a| a.vertex).collect()
            }
        };
        let missing = vertices.iter().filter(|v| **v as usize >= count);
        report(missing, problems, |list| {
            let what = format!("vertices {list} do not exist: the garment has {count}, numbered from 0");
            Problem::data(&place, what, "use vertex numbers of this mesh")
        });
        check_values(&place, pin, problems);
        if pin.from >= pin.until {
            problems.push(Problem::scene(&place, "it ends before it starts", "make `from` smaller than `until`"));
        }
        if pin.axes == [false; 3] {
            problems.push(Problem::scene(&place, "it has no axes", "write `axes`, as in \"xyz\""));
        }
        if pin.hold == PinHold::Hard {
            let axes = (0..3).filter(|axis| pin.axes[*axis]);
            holds.extend(
                axes.flat_map(|axis| vertices.iter().map(move |v| (pin.garment, *v, axis, pin.from, pin.until, p))),
            );
        }
    }
    holds.sort_unstable_by(|a, b| (a.0, a.1, a.2).cmp(&(b.0, b.1, b.2)).then(a.3.total_cmp(&b.3)));
    let clashes = holds.windows(2).filter(|w| (w[0].0, w[0].1, w[0].2) == (w[1].0, w[1].1, w[1].2) && w[1].3 < w[0].4);
    let clashes: BTreeSet<_> = clashes.map(|w| (w[0].0, w[0].1, w[0].5, w[1].5)).collect();
    for (garment, vertex, a, b) in clashes.into_iter().take(LISTED) {
        let place = format!("garment \"{}\", vertex {vertex}", description.garments[garment].name);
        let what = format!("pins {a} and {b} hold it at the same time");
        problems.push(Problem::scene(place, what, "end one of them before the other starts, or make one a spring"));
    }
}

/// Number of points of the body a pin is attached to, if it is a surface.
fn check_pin_body(
    description: &SceneDescription,
    body: usize,
    place: &str,
    problems: &mut Vec<Problem>,
) -> Option<usize> {
    match description.bodies.get(body).map(|b| &b.shape) {
        Some(BodyShape::Surface { point_count, .. }) => Some(*point_count),
        _ => {
            let what = "it is attached to a body that is not a mesh";
            problems.push(Problem::scene(place, what, "attach it to a body read from a file"));
            None
        }
    }
}

fn check_effects(description: &SceneDescription, problems: &mut Vec<Problem>) {
    let mut seen = BTreeSet::new();
    for request in &description.effects {
        let name = request.effect.as_str();
        let Some(spec) = effects::find(name) else {
            if let Some((what, advice)) = effects::lacking(name) {
                problems.push(Problem::scene(name, what, advice));
                continue;
            }
            let names = effects::REGISTRY.iter().map(|s| s.name);
            let advice = nearest(name, names)
                .map_or_else(|| "see the list of effects".to_owned(), |n| format!("did you mean `{n}`?"));
            problems.push(Problem::scene(name, "unknown effect", advice));
            continue;
        };
        let fits = match spec.scope {
            Scope::Scene => request.garment.is_none(),
            Scope::Garment => request.garment.is_some_and(|g| g < description.garments.len()),
            Scope::Implied => true,
        };
        if !fits {
            problems.push(Problem::scene(name, "this table does not belong here", "see the reference page of effects"));
        }
        for required in spec.requires {
            let meets = |e: &&EffectRequest| {
                e.effect == *required && (e.garment.is_none() || request.garment.is_none_or(|g| e.garment == Some(g)))
            };
            if !description.effects.iter().any(|e| meets(&e)) {
                let left_out = description.left_out.iter().any(|out| out == required);
                let how = if left_out { "left out" } else { "missing" };
                let what = format!("it requires `{required}`, which is {how}");
                problems.push(Problem::scene(name, what, "ask for both or neither"));
            }
        }
        if !seen.insert((name, request.garment)) {
            problems.push(Problem::scene(name, "it is requested twice", "remove one of the tables"));
        }
    }
    let has = |name: &str| description.effects.iter().any(|e| e.effect == name);
    check_maps_are_used(description, problems);
    for EffectInput { effect: name, one, asks, .. } in &INPUTS {
        let Some(needed) = asks.map(|asks| asks(description)) else { continue };
        if needed != has(name) && !description.left_out.iter().any(|out| out == name) {
            let what = if needed { format!("{one} needs this effect") } else { format!("it needs {one}") };
            problems.push(Problem::scene(*name, what, "ask for both or neither"));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::shapes::Shape;
    use crate::mesh::PolygonMesh;
    use crate::scene::{PinAnchor, PinDescription, RigidMotion, SeamDescription};

    /// A triangle on a spring, sewn to itself beside a ball.
    fn scene() -> SceneDescription {
        let mut description = SceneDescription::new("values");
        let mesh = PolygonMesh::from_triangles(vec![Vec3::x(), Vec3::y(), Vec3::z()], &[[0, 1, 2]]);
        description.garments.push(GarmentDescription::new("flag", mesh, 0.2));
        let shape = BodyShape::Rigid(Shape::Sphere { radius: 0.1 });
        description.bodies.push(BodyDescription::new("ball", shape, RigidMotion::at(Vec3::zeros())));
        let target = PinTarget::Path { anchor: PinAnchor::Start, vertices: vec![0], offsets: Vec::new() };
        let hold = PinHold::Spring { stiffness: 1.0, damping_ratio: 1.0, break_force: None };
        let (from, until) = (f64::NEG_INFINITY, f64::INFINITY);
        description.pins.push(PinDescription { garment: 0, target, axes: [true; 3], from, until, hold });
        description.seams.push(SeamDescription {
            until: 1.0,
            damping_ratio: 0.0,
            ..SeamDescription::new([0, 0], vec![[1, 2]], 1.0)
        });
        // Builds without these effects check values as well.
        description.left_out = ["attachments", "seams", "body_collision"].map(str::to_owned).into();
        description
    }

    #[test]
    fn values_outside_their_rows_are_refused_with_their_place_also_without_a_scene_file() {
        let problems_of = |change: fn(&mut SceneDescription)| {
            let mut description = scene();
            change(&mut description);
            let problems = check_description(&description);
            problems.iter().map(|problem| format!("{}: {}", problem.place, problem.what)).collect::<Vec<_>>().join("; ")
        };
        assert_eq!(problems_of(|_| {}), "");
        for (text, words) in [
            (
                problems_of(|scene| scene.solver.cfl = f64::NAN),
                "solver: `cfl` = NaN is outside 1e-6 to 1e6: CFL number",
            ),
            (problems_of(|scene| scene.solver.max_dt = Some(0.0)), "solver: `max_dt` = 0 s is outside 1e-9 to 1000 s"),
            (problems_of(|scene| scene.solver.cg_max_iterations = 0), "solver: `cg_max_iterations` = 0 is outside"),
            (
                problems_of(|scene| scene.bodies[0].max_push_speed = 0.0),
                "body \"ball\": `max_push_speed` = 0 m/s has to be above 0",
            ),
            (
                problems_of(|scene| {
                    scene.bodies[0].shape = BodyShape::Rigid(Shape::Box { half_extents: [1.0, -1.0, 1.0] })
                }),
                "body \"ball\": `half_extents` = -1 m is outside",
            ),
            (problems_of(|scene| scene.pins[0].from = f64::NAN), "pin 0: `from` = NaN s has to be a number"),
            (
                problems_of(|scene| {
                    scene.pins[0].hold = PinHold::Spring { stiffness: 1.0, damping_ratio: -1.0, break_force: None };
                }),
                "garment \"flag\", pin 0: `damping_ratio` = -1 is outside 0 to 1000",
            ),
            (problems_of(|scene| scene.seams[0].stiffness = 0.0), "seam 0: `strength` = 0 N/m is outside"),
            (problems_of(|scene| scene.seams[0].until = f64::INFINITY), "seam 0: `closed` = inf s is outside"),
            (
                problems_of(|scene| scene.garments[0].start = Some(vec![Vec3::x(); 3])),
                "garment \"flag\", start pose: all 3 points are in one place, [1.0, 0.0, 0.0]",
            ),
            (problems_of(|scene| scene.pins[0].axes = [false; 3]), "garment \"flag\", pin 0: it has no axes"),
            (
                problems_of(|scene| {
                    let PinTarget::Path { offsets, .. } = &mut scene.pins[0].target else { panic!("a path") };
                    offsets.extend([(1.0, Vec3::zeros()), (0.5, Vec3::x())]);
                }),
                "garment \"flag\", pin 0: its path needs ascending times and finite positions",
            ),
        ] {
            assert!(text.contains(words), "{words}\n{text}");
        }
    }
}
