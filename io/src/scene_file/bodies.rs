//! Bodies of a scene file.

use drapery_core::Vec3;
use drapery_core::geometry::coarseness::Ridges;
use drapery_core::geometry::moving_surface::enclosed_share;
use drapery_core::geometry::rotation::rotation_by;
use drapery_core::geometry::shapes::Shape;
use drapery_core::mesh::PolygonMesh;
use drapery_core::scene::{BodyDescription, BodyShape, Described, RigidMotion};
use drapery_core::settings::Dimension;
use nalgebra::{Unit, UnitQuaternion};

use crate::belt::{BeltReader, BeltShape};
use crate::input_motion::InputMotion;
use crate::mesh_source::MeshSource;

use super::deserialize::suggestion;
use super::fields::SHAPE;
use super::raw::{Belt, Body, BodyPath, Quantity, Rotation};
use super::resolve::Resolver;
use super::shape;
use super::tree::Path;

/// Shape and motion of a body that is a mesh, whether its faces look inwards, and its edges.
type MeshBody = (BodyShape, InputMotion, bool, Ridges);

/// The mesh of a body from a file.
struct MeshOfBody {
    source: MeshSource,
    /// The mesh in the first frame of the shot.
    first: PolygonMesh,
    /// Points of the rest pose, if there is one [m].
    rest: Option<Vec<Vec3>>,
}

impl Resolver<'_> {
    /// Resolves one body. Problems are recorded; the body then stays in its place with what could be read.
    pub(super) fn body(&mut self, body: &Body, path: &Path) {
        let still = || RigidMotion::at(Vec3::zeros());
        let shape = self.shape(path);
        let mut ridges = shape.as_ref().and_then(Ridges::of_shape);
        let of_mesh = match (&body.file, &body.belt) {
            (Some(file), None) => Some(self.file_body(body, file, path)),
            (None, Some(belt)) => Some(self.belt_body(body, belt, path)),
            _ => None,
        };
        let (shape, motion, input, faces_inwards) = match (of_mesh, shape) {
            (Some(of_mesh), None) => match of_mesh {
                Some((shape, input, faces_inwards, of_mesh)) => {
                    ridges = Some(of_mesh);
                    (shape, still(), Some(input), faces_inwards)
                }
                None => (BodyShape::Rigid(Shape::HalfSpace), still(), None, false),
            },
            (None, Some(shape)) if body.file.is_none() => {
                (BodyShape::Rigid(shape), self.motion(body, path), None, false)
            }
            _ => {
                let help = "for example shape = { sphere = { radius = 0.25 } }, or file = \"hero.abc\"".to_owned();
                self.error_with(path, format!("body \"{}\" needs one of `file`, `shape` and `belt`", body.name), help);
                // Bodies are found by their number, so a broken one keeps its place.
                (BodyShape::Rigid(Shape::HalfSpace), still(), None, false)
            }
        };
        self.bodies.push(input);
        self.ridges.push(ridges);
        let settings = self.settings(path, BodyDescription::FIELDS);
        self.description.bodies.push(BodyDescription {
            name: body.name.clone(),
            shape,
            motion,
            friction: settings.number("friction"),
            thickness: settings.number("thickness"),
            max_push_speed: settings.number("max_push_speed"),
            faces_inwards,
        });
    }

    /// The ideal shape of the body at a path, if it has one.
    pub(super) fn shape(&self, path: &Path) -> Option<Shape> {
        let node = path.find(&self.scene.root).as_table()?.get(SHAPE)?;
        shape::read(node, &path.clone().key(SHAPE), &self.scene.sources).ok()
    }

    fn motion(&mut self, body: &Body, path: &Path) -> RigidMotion {
        for (key, written) in [("rest", body.rest.is_some()), ("units", body.units.is_some())] {
            if written {
                self.error(&path.clone().key(key), format!("`{key}` applies only to bodies from files"));
            }
        }
        let mut motion = RigidMotion::at(Vec3::from(body.position.unwrap_or_default()));
        match &body.path {
            Some(BodyPath::Motion(points)) => {
                let here = path.clone().key("path");
                if body.position.is_some() {
                    self.error(&here, "a body takes either a `position` or a `path`, not both");
                }
                if points.is_empty() || points.windows(2).any(|w| w[0].0 >= w[1].0) {
                    self.error(&here, "a path needs at least one point, and increasing times");
                }
                motion.path = points.iter().map(|(time, position)| (*time, Vec3::from(*position))).collect();
            }
            Some(BodyPath::Objects(_)) => {
                let help = "write points: path = [[0.0, [0, 1, 0]], [2.0, [1, 1, 0]]]".to_owned();
                self.error_with(
                    &path.clone().key("path"),
                    "the `path` of a `shape` is a list of points, not an object path",
                    help,
                );
            }
            None => {}
        }
        if let Some(rotation) = body.rotation {
            motion.rotation = self.rotation(rotation, &path.clone().key("rotation"));
        }
        if let Some(spin) = body.spin {
            motion.angular_velocity = Vec3::from(spin.angular_velocity);
            motion.spin_start = spin.from;
        }
        motion
    }

    /// A rotation; an axis without direction is recorded.
    pub(super) fn rotation(&mut self, rotation: Rotation, path: &Path) -> UnitQuaternion<f64> {
        match Unit::try_new(Vec3::from(rotation.axis), 0.0) {
            Some(axis) => rotation_by(&(*axis * rotation.degrees.to_radians())),
            None => {
                self.error(&path.clone().key("axis"), "an axis of length zero has no direction");
                UnitQuaternion::identity()
            }
        }
    }

    fn file_body(&mut self, body: &Body, file: &str, path: &Path) -> Option<MeshBody> {
        self.only_of_shapes(body, path, "the points of a file have their own positions");
        let MeshOfBody { source, first, rest } = self.mesh_of_body(body, file, path)?;
        let (triangles, _) = first.triangulate();
        let point_count = first.points.len();
        let label = format!("body \"{}\"", body.name);
        let input = InputMotion { label, source, rest, rows: None, own_units: body.units.is_some(), is_made: false };
        let faces_inwards = enclosed_share(&triangles, &first.points) < 0.0;
        let ridges = Ridges::of(&first);
        Some((BodyShape::Surface { triangles, point_count }, input, faces_inwards, ridges))
    }

    /// A belt around another body.
    fn belt_body(&mut self, body: &Body, belt: &Belt, path: &Path) -> Option<MeshBody> {
        self.only_of_shapes(body, path, "a belt follows its body");
        let here = path.clone().key("belt");
        for (key, written) in
            [("rest", body.rest.is_some()), ("units", body.units.is_some()), ("path", body.path.is_some())]
        {
            if written {
                self.error(&path.clone().key(key), format!("`{key}` applies only to bodies from files"));
            }
        }
        if self.scene.document.garment.iter().any(|garment| garment.name == body.name) {
            let what = format!("a garment is called \"{}\", too, and the cache of a belt has its name", body.name);
            self.error_with(&path.clone().key("name"), what, "rename the belt".to_owned());
        }
        let bodies = &self.scene.document.body;
        let names: Vec<&str> = bodies.iter().map(|b| b.name.as_str()).collect();
        let Some(followed) = bodies.iter().position(|b| b.name == belt.around) else {
            let what = format!("there is no body \"{}\"", belt.around);
            self.error_with(&here.clone().key("around"), what, suggestion(&belt.around, &names));
            return None;
        };
        let (followed, at) = (&bodies[followed], Path::default().key("body").index(followed));
        let Some(file) = &followed.file else {
            let what = format!("body \"{}\" is not from a file", belt.around);
            let help = "put the belt around a body from a file; around a `shape`, model it".to_owned();
            self.error_with(&here.clone().key("around"), what, help);
            return None;
        };
        let length = |resolver: &mut Self, key: &str, quantity: &Quantity| {
            resolver.quantity(&here.clone().key(key), quantity, Dimension::Length)
        };
        let width = length(self, "width", &belt.width);
        let depth = length(self, "depth", &belt.depth);
        let gap = length(self, "gap", &belt.gap);
        let Some(axis) = Unit::try_new(Vec3::from(belt.axis), 0.0) else {
            self.error(&here.key("axis"), "an axis of length zero has no direction");
            return None;
        };
        let (at_middle, resolution) = (Vec3::from(belt.at), belt.resolution as usize);
        let shape = BeltShape { at: at_middle, axis: *axis, width: width?, depth: depth?, gap: gap?, resolution };
        let MeshOfBody { source, first, rest } = self.mesh_of_body(followed, file, &at)?;
        let band = self.check(&here.clone().key("at"), shape.around(&first))?;
        let (triangles, _) = band.triangulate();
        let (point_count, ridges) = (band.points.len(), Ridges::of(&band));
        let mut rest_of_belt = None;
        let source = source.followed_by(|source| {
            let reader = BeltReader::new(source, &first, band)?;
            rest_of_belt = rest.map(|rest| reader.positions(&rest));
            Ok(reader)
        });
        let source = self.check(&here, source)?;
        let label = format!("body \"{}\"", body.name);
        let input = InputMotion { label, source, rest: rest_of_belt, rows: None, own_units: true, is_made: true };
        Some((BodyShape::Surface { triangles, point_count }, input, false, ridges))
    }

    /// Refuses keys of ideal shapes.
    fn only_of_shapes(&mut self, body: &Body, path: &Path, because: &str) {
        let of_shapes = [
            ("position", body.position.is_some()),
            ("rotation", body.rotation.is_some()),
            ("spin", body.spin.is_some()),
        ];
        for (key, _) in of_shapes.iter().filter(|(_, written)| *written) {
            let text = format!("`{key}` applies only to bodies with a `shape`; {because}");
            self.error(&path.clone().key(key), text);
        }
    }

    /// Opens the mesh of a body from a file.
    fn mesh_of_body(&mut self, body: &Body, file: &str, path: &Path) -> Option<MeshOfBody> {
        let here = path.clone().key("file");
        let pattern = match &body.path {
            Some(BodyPath::Objects(pattern)) => Some(pattern.as_str()),
            Some(BodyPath::Motion(_)) => {
                let help = "write the paths of its meshes, as in path = \"/hero/*\"".to_owned();
                self.error_with(
                    &path.clone().key("path"),
                    "the motion of a body from a file comes from the file",
                    help,
                );
                return None;
            }
            None => None,
        };
        let source = self.open(&here, file, pattern, body.units)?;
        let first = self.mesh(&here, &source, Some(self.first_file_time()))?.mesh;
        let point_count = first.points.len();
        let rest = match &body.rest {
            Some(rest) => {
                let here = path.clone().key("rest");
                let (file, time) = self.file_at(&here, rest)?;
                let rest = self.open(&here, &file, pattern, body.units)?;
                let time = self.time_in(&here, &rest, time)?;
                let points = self.mesh(&here, &rest, Some(time))?.mesh.points;
                self.same_count(&here, "the rest pose", points.len(), "the body", point_count)?;
                Some(points)
            }
            None => None,
        };
        Some(MeshOfBody { source, first, rest })
    }

    /// Refuses two meshes that should be one.
    pub(super) fn same_count(&mut self, path: &Path, a: &str, found: usize, b: &str, count: usize) -> Option<()> {
        if found == count {
            return Some(());
        }
        let help = "export both from the same mesh, with the same order of points".to_owned();
        self.data_error(path, format!("{a} has {found} points, but {b} has {count}"), help);
        None
    }
}
