//! Pins: which vertices, and what they follow.

use std::path::Path as FilePath;

use drapery_core::Vec3;
use drapery_core::scene::{
    BodyShape, Described, ElasticDescription, PinAnchor, PinDescription, PinHold, PinTarget, SurfaceAttachment,
};
use drapery_core::settings::{Member, Origin, Settings};
use serde::Deserialize;

use crate::error::IoError;
use crate::input_file;
use crate::input_motion::InputMotion;
use crate::units::Units;

use super::deserialize::suggestion;
use super::raw::{BIND, Bind, Corner, Elastic, Pin, Region};
use super::resolve::{ReadGarment, Resolver, written};
use super::tree::Path;

/// A JSON file of pins.
#[derive(Debug, Clone, Deserialize)]
struct PinFile {
    /// File name of the body that the attachments refer to.
    #[serde(default)]
    body: String,
    /// One attachment per vertex.
    pins: Vec<FilePin>,
}

/// One attachment of a pin file.
#[derive(Debug, Clone, Deserialize)]
struct FilePin {
    vertex: u32,
    body_vertices: [u32; 3],
    weights: [f64; 3],
    #[serde(default)]
    offset_tangent_bitangent_normal: [f64; 3],
}

/// Reads a pin file.
///
/// # Errors
/// It is missing, or not what a pin file looks like.
fn read_file(path: &FilePath) -> Result<PinFile, IoError> {
    let text = input_file::text(path)?;
    serde_json::from_str(&text).map_err(|error| {
        let place = format!("line {}, column {}", error.line(), error.column());
        let advice = "a pin file holds {\"body\": name, \"pins\": [{\"vertex\": …, \"body_vertices\": [a, b, c], \
                      \"weights\": […], \"offset_tangent_bitangent_normal\": […]}, …]}";
        IoError::data(path, place, error.to_string(), advice)
    })
}

/// Ways of naming vertices of a garment; exactly one is to be used.
pub(super) struct Named<'a> {
    pub(super) vertices: Option<&'a [u32]>,
    pub(super) corners: Option<&'a [Corner]>,
    pub(super) nodes: Option<&'a [[f64; 2]]>,
    pub(super) region: Option<Region>,
    pub(super) map: Option<&'a str>,
}

impl Named<'_> {
    /// Returns the number of ways that are used.
    pub(super) fn ways(&self) -> usize {
        let lists = [self.vertices.is_some(), self.corners.is_some(), self.nodes.is_some()];
        lists.into_iter().chain([self.region.is_some(), self.map.is_some()]).filter(|way| *way).count()
    }

    /// The vertices in the order in which they are named, but for those of a map; only a region looks at where they start.
    ///
    /// # Errors
    /// Names that fit no panel.
    pub(super) fn find(&self, start: &[Vec3], grid: Option<[u32; 2]>) -> Result<Vec<u32>, String> {
        if let Some(vertices) = self.vertices {
            return Ok(vertices.to_vec());
        }
        if let Some(region) = self.region {
            return Ok((0..start.len() as u32).filter(|v| inside(region, start[*v as usize])).collect());
        }
        let [m, n] = grid.ok_or("`corners` and `nodes` need a `panel`; use `vertices` or `where` here")?;
        let node = |u: f64, v: f64| {
            let along = |t: f64, count: u32| (t.clamp(0.0, 1.0) * f64::from(count - 1)).round() as u32;
            along(u, m) + m * along(v, n)
        };
        Ok(match (self.corners, self.nodes) {
            (Some(corners), _) => corners.iter().map(|c| corner(*c)).map(|[u, v]| node(u, v)).collect(),
            (_, nodes) => nodes.iter().copied().flatten().map(|[u, v]| node(*u, *v)).collect(),
        })
    }
}

/// Fractions along x and z.
fn corner(corner: Corner) -> [f64; 2] {
    match corner {
        Corner::I0j0 => [0.0, 0.0],
        Corner::Inj0 => [1.0, 0.0],
        Corner::I0jn => [0.0, 1.0],
        Corner::Injn => [1.0, 1.0],
    }
}

fn inside(region: Region, point: Vec3) -> bool {
    let Region::Box { min, max } = region;
    (0..3).all(|axis| (min[axis]..=max[axis]).contains(&point[axis]))
}

/// Advice about a region without any of these places: its own fault, or the place nearest to it and the bounds of all.
fn beside(region: Region, places: &[Vec3]) -> String {
    let Region::Box { min, max } = region;
    if let Some(axis) = (0..3).find(|axis| min[*axis] > max[*axis]) {
        let (axis, low, high) = (["x", "y", "z"][axis], min[axis], max[axis]);
        return format!("exchange `min` and `max` along {axis}: {low} is above {high}");
    }
    let [min, max] = [min, max].map(Vec3::from);
    let distance = |place: &Vec3| (place - place.sup(&min).inf(&max)).norm();
    let nearest = places.iter().enumerate().min_by(|a, b| distance(a.1).total_cmp(&distance(b.1)));
    let Some((vertex, place)) = nearest else { return "the garment has no vertices".to_owned() };
    let (low, high) = places.iter().fold((*place, *place), |(low, high), place| (low.inf(place), high.sup(place)));
    let shown = |place: &Vec3| format!("[{:.3}, {:.3}, {:.3}]", place.x, place.y, place.z);
    format!(
        "the garment starts from {} to {} m; its vertex nearest to the box is {vertex} at {}, {:.3} m away",
        shown(&low),
        shown(&high),
        shown(place),
        distance(place)
    )
}

impl Resolver<'_> {
    /// Vertices that a pin, band or seam at a path has chosen, if there are any and the garment has them. `region` is the one that
    /// chose among these places, if one did. Problems are recorded.
    pub(super) fn existing(
        &mut self,
        (path, what): (&Path, &str),
        chosen: Vec<u32>,
        count: usize,
        (region, places): (Option<Region>, &[Vec3]),
    ) -> Option<Vec<u32>> {
        if let Some(vertex) = chosen.iter().find(|v| **v as usize >= count) {
            let what = format!("vertex {vertex} does not exist: the garment has {count} vertices, numbered from 0");
            self.error(path, what);
            return None;
        }
        if !chosen.is_empty() {
            return Some(chosen);
        }
        let nothing = format!("this {what} holds no vertex");
        match region {
            Some(region) => {
                let in_files = self.scene.document.units.is_some_and(|units| written(units) != Units::SI);
                let units =
                    if in_files { "; its box is in metres with Y up: [units] applies to files only" } else { "" };
                self.error_with(&path.clone().key("where"), nothing + units, beside(region, places));
            }
            None => self.error(path, nothing),
        }
        None
    }

    /// Vertices that a pin or band at a path names, at least one. Problems are recorded.
    pub(super) fn chosen(
        &mut self,
        (path, what): (&Path, &str),
        named: &Named<'_>,
        garment: &ReadGarment<'_>,
    ) -> Option<Vec<u32>> {
        if let Some(name) = named.map {
            return self.painted_vertices((&path.clone().key("map"), what), name, garment.mesh);
        }
        let chosen = self.check(path, named.find(garment.places, garment.grid))?;
        self.existing((path, what), chosen, garment.points, (named.region, garment.places))
    }

    /// Resolves one elastic band of a garment. Problems are recorded, and the band is then left out.
    pub(super) fn elastic(
        &mut self,
        band: &Elastic,
        path: &Path,
        index: usize,
        garment: &ReadGarment<'_>,
    ) -> Option<ElasticDescription> {
        let Elastic { vertices, nodes, region, map } = band;
        let (vertices, nodes, map) = (vertices.as_deref(), nodes.as_deref(), map.as_deref());
        let named = Named { vertices, corners: None, nodes, region: *region, map };
        if named.ways() != 1 {
            self.error(path, "an elastic band needs exactly one of `vertices`, `nodes`, `where` and `map`");
            return None;
        }
        let vertices = self.chosen((path, "elastic band"), &named, garment)?;
        let settings = self.settings(path, ElasticDescription::FIELDS);
        Some(ElasticDescription {
            garment: index,
            vertices,
            stiffness: settings.number("stiffness"),
            rest_scale: settings.number("rest_scale"),
            damping_ratio: settings.number("damping_ratio"),
        })
    }

    /// Resolves one pin of a garment. Problems are recorded, and the pin is then left out.
    pub(super) fn pin(
        &mut self,
        pin: &Pin,
        path: &Path,
        index: usize,
        garment: &ReadGarment<'_>,
    ) -> Option<PinDescription> {
        let named = Named {
            vertices: pin.vertices.as_deref(),
            corners: pin.corners.as_deref(),
            nodes: pin.nodes.as_deref(),
            region: pin.region,
            map: pin.map.as_deref(),
        };
        if named.ways() + usize::from(pin.file.is_some()) != 1 {
            self.error(path, "a pin needs exactly one of `vertices`, `corners`, `nodes`, `where`, `map` and `file`");
            return None;
        }
        let file = match &pin.file {
            Some(name) => {
                let file = self.scene.folder.join(name);
                let read = read_file(&file);
                if !self.input_files.contains(&file) {
                    self.input_files.push(file);
                }
                Some(self.of_file(&path.clone().key("file"), read)?)
            }
            None => None,
        };
        let vertices = match &file {
            Some(file) => {
                let vertices = file.pins.iter().map(|pin| pin.vertex).collect();
                self.existing((path, "pin"), vertices, garment.points, (None, garment.places))?
            }
            None => {
                let mut vertices = self.chosen((path, "pin"), &named, garment)?;
                vertices.sort_unstable();
                vertices.dedup();
                vertices
            }
        };
        let target = if let Some(body) = pin.to.strip_prefix("body:") {
            self.body_target(path, body, vertices, file.as_ref())?
        } else if pin.to == "track" {
            self.track_target(pin, path, vertices, garment)?
        } else if let Some(anchor) = anchor(&pin.to) {
            let offsets = pin.path.iter().map(|(time, offset)| (*time, Vec3::from(*offset))).collect();
            PinTarget::Path { anchor, vertices, offsets }
        } else {
            let help = match pin.to.strip_prefix("garment:") {
                Some(name) => {
                    format!("sew it: a [[seam]] with to = {{ garment = \"{name}\" }} and pairing = \"surface\"")
                }
                None => "use \"start\", \"here\", \"track\", or \"body:\" and the name of a body".to_owned(),
            };
            self.error_with(&path.clone().key("to"), format!("a pin cannot follow \"{}\"", pin.to), help);
            return None;
        };
        self.what_it_follows(pin, path);
        let axes = axes(&pin.axes).ok_or_else(|| {
            format!("\"{}\" is not a set of the axes x, y and z: write each of them once, as in \"xz\"", pin.axes)
        });
        let axes = self.check(&path.clone().key("axes"), axes)?;
        let settings = self.settings(path, PinDescription::FIELDS);
        let hold = self.hold(&settings, path)?;
        if hold != PinHold::Hard && axes != [true; 3] {
            let help = "leave `axes` out, or hold the vertices hard".to_owned();
            self.error_with(&path.clone().key("axes"), "a spring pulls along all axes", help);
        }
        let (from, until) = (settings.number("from"), settings.number("until"));
        Some(PinDescription { garment: index, target, axes, from, until, hold })
    }

    /// Refuses keys of a pin that say nothing of what it follows, and a path that runs backwards.
    fn what_it_follows(&mut self, pin: &Pin, path: &Path) {
        if pin.path.windows(2).any(|points| points[0].0 >= points[1].0) {
            let help = "sort its points by their times".to_owned();
            self.error_with(&path.clone().key("path"), "the times of a path have to increase", help);
        }
        let binds = Bind::of(&self.settings(path, &[BIND]), BIND.name) != Bind::Auto;
        let of_others = [
            ("path", "`to = \"start\"` or `to = \"here\"`", !pin.path.is_empty() && anchor(&pin.to).is_none()),
            ("track", "`to = \"track\"`", pin.track.is_some() && pin.to != "track"),
            (BIND.name, "`to = \"body:…\"`", binds && !pin.to.starts_with("body:")),
        ];
        for (key, needed, is_idle) in of_others {
            if is_idle {
                let what = format!("`{key}` applies only with {needed}, but this pin has `to = \"{}\"`", pin.to);
                self.error_with(&path.clone().key(key), what, format!("write {needed}, or leave `{key}` out"));
            }
        }
    }

    fn hold(&mut self, settings: &Settings, path: &Path) -> Option<PinHold> {
        let of_springs = ["stiffness", "damping_ratio", "break_force"];
        let is_written = |(name, _, origin)| origin == Origin::Scene && of_springs.contains(&name);
        let hold = PinHold::of(settings);
        if hold == Some(PinHold::Hard) && settings.iter().any(is_written) {
            let help = "add mode = \"spring\", or leave stiffness, damping_ratio and break_force out".to_owned();
            self.error_with(path, "a hard pin has no stiffness, no damping and no force at which it breaks", help);
        }
        if hold.is_none() {
            let help = "add for example stiffness = \"200 N/m\"".to_owned();
            self.error_with(path, "a spring pin requires `stiffness`", help);
        }
        hold
    }

    fn track_target(
        &mut self,
        pin: &Pin,
        path: &Path,
        vertices: Vec<u32>,
        garment: &ReadGarment<'_>,
    ) -> Option<PinTarget> {
        let Some(track) = &pin.track else {
            let help = "add track = \"file.abc\" or track = \"file.abc@/path/of/mesh\"".to_owned();
            self.error_with(path, "`to = \"track\"` needs a `track`", help);
            return None;
        };
        let here = path.clone().key("track");
        let (file, pattern) = match track.split_once("@/") {
            Some((file, pattern)) => (file, Some(format!("/{pattern}"))),
            None => (track.as_str(), None),
        };
        let source = self.open(&here, file, pattern.as_deref(), garment.units)?;
        let points = self.mesh(&here, &source, None)?.mesh.points.len();
        self.same_count(&here, "this mesh", points, "the garment", garment.points)?;
        let label = format!("pin track {track}");
        let rows = Some(vertices.clone());
        self.tracks.push(InputMotion {
            label,
            source,
            rest: None,
            rows,
            own_units: garment.units.is_some(),
            is_made: false,
        });
        Some(PinTarget::Track { vertices, track: self.tracks.len() - 1 })
    }

    fn body_target(
        &mut self,
        path: &Path,
        name: &str,
        vertices: Vec<u32>,
        file: Option<&PinFile>,
    ) -> Option<PinTarget> {
        let here = path.clone().key("to");
        let names: Vec<&str> = self.scene.document.body.iter().map(|b| b.name.as_str()).collect();
        let Some(body) = names.iter().position(|n| *n == name) else {
            let help = match names.is_empty() {
                true => "add it under [[body]]; a pin to = \"start\" needs none".to_owned(),
                false => suggestion(name, &names),
            };
            self.error_with(&here, format!("there is no body \"{name}\""), help);
            return None;
        };
        // The file name is compared, not the path: the pin file was written next to a copy of the body.
        let body_file = self.scene.document.body[body].file.as_deref().map(FilePath::new).and_then(FilePath::file_name);
        let made_for_it = file.is_some_and(|f| FilePath::new(&f.body).file_name() == body_file);
        let bind = Bind::of(&self.settings(path, &[BIND]), BIND.name);
        let from_file = file.filter(|_| bind == Bind::File || (bind == Bind::Auto && made_for_it));
        let Some(input) = self.bodies.get(body).and_then(Option::as_ref) else {
            // A body that could not be read has been reported already.
            if self.shape(&Path::default().key("body").index(body)).is_some() {
                let help = "use to = \"start\" with a `path` that moves as the body does".to_owned();
                self.error_with(
                    &here,
                    format!("body \"{name}\" is an analytic shape; pins can only follow bodies from files"),
                    help,
                );
            }
            return None;
        };
        let Some(file) = from_file else {
            if bind == Bind::File {
                let help = "name the file with `file`, or use bind = \"nearest\"".to_owned();
                self.error_with(path, "`bind = \"file\"` needs a pin file", help);
                return None;
            }
            return Some(PinTarget::BodyNearest { body, vertices });
        };
        let metres_per_unit = input.source.units().metres;
        let points = match self.description.bodies.get(body).map(|b| &b.shape) {
            Some(BodyShape::Surface { point_count, .. }) => *point_count,
            _ => return None,
        };
        let attachments = self.check(path, from_pin_file(file, points, metres_per_unit))?;
        Some(PinTarget::Body { body, attachments })
    }
}

fn anchor(to: &str) -> Option<PinAnchor> {
    match to {
        "start" => Some(PinAnchor::Start),
        "here" => Some(PinAnchor::WhenHeld),
        _ => None,
    }
}

fn axes(text: &str) -> Option<[bool; 3]> {
    let axes = ['x', 'y', 'z'].map(|axis| text.contains(axis));
    let named = axes.iter().filter(|named| **named).count();
    // As many letters as axes: none is there twice, and none is another letter.
    (named > 0 && named == text.chars().count()).then_some(axes)
}

/// Attachments as the pin file says them; `metres_per_unit` is that of the body.
fn from_pin_file(file: &PinFile, body_points: usize, metres_per_unit: f64) -> Result<Vec<SurfaceAttachment>, String> {
    let attachment = |pin: &FilePin| {
        let vertex = pin.vertex;
        if let Some(point) = pin.body_vertices.iter().find(|p| **p as usize >= body_points) {
            return Err(format!("pin of vertex {vertex}: the body has no point {point}, only {body_points} points"));
        }
        let sum: f64 = pin.weights.iter().sum();
        if !sum.is_finite() || (sum - 1.0).abs() > 1e-3 {
            return Err(format!("pin of vertex {vertex}: its weights add up to {sum}, not to 1"));
        }
        // Weights in text are rounded; what is missing to one would pull the vertex towards the origin.
        let weights = pin.weights.map(|w| w / sum);
        let offset = Vec3::from(pin.offset_tangent_bitangent_normal) * metres_per_unit;
        Ok(SurfaceAttachment { vertex, body_points: pin.body_vertices, weights, offset })
    };
    file.pins.iter().map(attachment).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_are_named_once_each() {
        assert_eq!(axes("xyz"), Some([true; 3]));
        assert_eq!(axes("zx"), Some([true, false, true]));
        for wrong in ["", "xyzzy", "xx", "w", "xw", "XYZ", "x y"] {
            assert_eq!(axes(wrong), None, "{wrong}");
        }
    }
}
