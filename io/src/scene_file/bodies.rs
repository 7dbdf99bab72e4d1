//! Bodies of a scene file.

use drapery_core::Vec3;
use drapery_core::geometry::coarseness::Ridges;
use drapery_core::geometry::moving_surface::enclosed_share;
use drapery_core::geometry::shapes::Shape;
use drapery_core::scene::{BodyDescription, BodyShape, Described, RigidMotion};
use nalgebra::{Unit, UnitQuaternion};

use crate::input_motion::InputMotion;

use super::fields::SHAPE;
use super::raw::{Body, BodyPath, Rotation};
use super::resolve::Resolver;
use super::shape;
use super::tree::Path;

impl Resolver<'_> {
    /// Resolves one body. Problems are recorded; the body then stays in its place with what could be read.
    pub(super) fn body(&mut self, body: &Body, path: &Path) {
        let still = || RigidMotion::at(Vec3::zeros());
        let mut ridges = None;
        let (shape, motion, input, faces_inwards) = match (&body.file, self.shape(path)) {
            (Some(file), None) => match self.file_body(body, file, path) {
                Some((shape, input, faces_inwards, of_mesh)) => {
                    ridges = Some(of_mesh);
                    (shape, still(), Some(input), faces_inwards)
                }
                None => (BodyShape::Rigid(Shape::HalfSpace), still(), None, false),
            },
            (None, Some(shape)) => (BodyShape::Rigid(shape), self.motion(body, path), None, false),
            _ => {
                let help = "for example shape = { sphere = { radius = 0.25 } }, or file = \"hero.abc\"".to_owned();
                self.error_with(path, format!("body \"{}\" needs either a `shape` or a `file`", body.name), help);
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
            Some(axis) => UnitQuaternion::from_axis_angle(&axis, rotation.degrees.to_radians()),
            None => {
                self.error(&path.clone().key("axis"), "an axis of length zero has no direction");
                UnitQuaternion::identity()
            }
        }
    }

    fn file_body(&mut self, body: &Body, file: &str, path: &Path) -> Option<(BodyShape, InputMotion, bool, Ridges)> {
        let of_shapes = [
            ("position", body.position.is_some()),
            ("rotation", body.rotation.is_some()),
            ("spin", body.spin.is_some()),
        ];
        for (key, _) in of_shapes.iter().filter(|(_, written)| *written) {
            let text =
                format!("`{key}` applies only to bodies with a `shape`; the points of a file have their own positions");
            self.error(&path.clone().key(key), text);
        }
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
        let (triangles, _) = first.triangulate();
        let point_count = first.points.len();
        let rest = match &body.rest {
            Some(rest) => {
                let here = path.clone().key("rest");
                let (file, time) = self.file_at(&here, rest)?;
                let rest = self.open(&here, &file, pattern, body.units)?;
                let points = self.mesh(&here, &rest, time)?.mesh.points;
                self.same_count(&here, "the rest pose", points.len(), "the body", point_count)?;
                Some(points)
            }
            None => None,
        };
        let label = format!("body \"{}\"", body.name);
        let input = InputMotion { label, source, rest, rows: None, own_units: body.units.is_some() };
        let faces_inwards = enclosed_share(&triangles, &first.points) < 0.0;
        let ridges = Ridges::of(&first);
        Some((BodyShape::Surface { triangles, point_count }, input, faces_inwards, ridges))
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
