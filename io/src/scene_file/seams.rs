//! Seams: which vertices of which garments, and when they close.

use drapery_core::Vec3;
use drapery_core::geometry::surface_binding::SurfaceBinding;
use drapery_core::scene::{Described, FacePoint, SeamDescription};
use drapery_core::settings::Member;

use super::deserialize::suggestion;
use super::pins::Named;
use super::raw::{PAIRING, Pairing, Seam, SeamSide};
use super::resolve::Resolver;
use super::tree::Path;

/// Seconds over which a seam closes that does not say when, in a shot without a pre-roll.
const CLOSING: f64 = 1.0;

/// A second garment, pairs of vertices, and points on its faces.
type Stitches = (usize, Vec<[u32; 2]>, Vec<FacePoint>);

/// Vertices of one side, and where they start.
struct Side {
    garment: usize,
    vertices: Vec<u32>,
    start: Vec<Vec3>,
}

impl Resolver<'_> {
    /// Resolves one seam. Problems are recorded, and the seam is then left out.
    pub(super) fn seam(&mut self, seam: &Seam, path: &Path) {
        let settings = self.settings(path, SeamDescription::FIELDS);
        let pairing = Pairing::of(&self.settings(path, &[PAIRING]), PAIRING.name);
        let Some(from) = self.seam_side(&seam.from, &path.clone().key("from")) else { return };
        let zip = settings.flag("zip");
        let sorted = |side: Side, written: &SeamSide| if zip && written.region.is_some() { side.along() } else { side };
        let from = sorted(from, &seam.from);
        let stitches = if pairing == Pairing::Surface {
            self.surface_stitches(&from, &seam.to, &path.clone().key("to"))
        } else {
            let to = self.seam_side(&seam.to, &path.clone().key("to")).map(|to| sorted(to, &seam.to));
            to.and_then(|to| self.vertex_stitches(&from, &to, (seam, pairing), path))
        };
        let Some((to, pairs, faces)) = stitches else { return };
        let timeline = self.description.timeline;
        let start = timeline.time(timeline.start);
        let closed = if timeline.start < timeline.origin { 0.0 } else { CLOSING };
        let starts = settings.optional("start").unwrap_or(start);
        let (key, ends) = settings.optional("closed").map_or(("start", closed), |closed| ("closed", closed));
        if ends < starts {
            let left_out = if key == "start" { ", as `closed` is left out" } else { "" };
            let what = format!("this seam is closed at {ends} s{left_out}, before it starts to close at {starts} s");
            let help = "write a `closed` after its start, or the same time for a seam that closes at once".to_owned();
            self.error_with(&path.clone().key(key), what, help);
        }
        self.description.seams.push(SeamDescription {
            garments: [from.garment, to],
            pairs,
            faces,
            keeps_gap: settings.flag("keep_gap"),
            from: starts,
            until: ends,
            opens: settings.optional("opens"),
            opened: settings.optional("opened"),
            zip,
            rest_gap: settings.optional("rest_gap"),
            stiffness: settings.number("strength"),
            damping_ratio: settings.number("damping_ratio"),
            break_force: settings.optional("break_force"),
        });
    }

    /// The second garment, and the pairs of vertices.
    fn vertex_stitches(
        &mut self,
        from: &Side,
        to: &Side,
        (seam, pairing): (&Seam, Pairing),
        path: &Path,
    ) -> Option<Stitches> {
        let both_listed = seam.from.vertices.is_some() && seam.to.vertices.is_some();
        let in_order = pairing == Pairing::Order || (pairing == Pairing::Auto && both_listed);
        if in_order && from.vertices.len() != to.vertices.len() {
            let (a, b) = (from.vertices.len(), to.vertices.len());
            let help = "give both sides as many vertices, or write pairing = \"nearest\"".to_owned();
            self.error_with(path, format!("one side of this seam has {a} vertices, the other {b}"), help);
            return None;
        }
        let pairs = if in_order { in_turn(from, to) } else { to_nearest(from, to) };
        Some((to.garment, pairs, Vec::new()))
    }

    /// The second garment, and the nearest point of its faces for each vertex.
    fn surface_stitches(&mut self, from: &Side, to: &SeamSide, path: &Path) -> Option<Stitches> {
        let garment = self.seam_garment(to, path)?;
        if named(to).ways() != 0 {
            let what = "with `pairing = \"surface\"` this side names the garment alone";
            self.error_with(path, what, "leave its vertices out, or write pairing = \"nearest\"".to_owned());
            return None;
        }
        if garment == from.garment {
            let what = "a garment cannot be sewn to its own surface: the nearest face is the vertex's own";
            self.error_with(path, what, "name another garment, or vertices".to_owned());
            return None;
        }
        let mesh = self.garments[garment].clone();
        let data = self.of_file(path, mesh.read())?;
        let start = self.description.garments[garment].start.clone();
        let places = start.unwrap_or_else(|| data.mesh.points.clone());
        let Some(bound) = SurfaceBinding::new(places, data.mesh.triangulate().0, &from.start, &[]) else {
            self.error(path, format!("garment \"{}\" has no face with an area to sew to", to.garment));
            return None;
        };
        let points = from.vertices.iter().zip(bound.places());
        let faces = points.map(|(vertex, (corners, weights))| FacePoint { vertex: *vertex, corners, weights });
        Some((garment, Vec::new(), faces.collect()))
    }

    /// The garment of a side.
    fn seam_garment(&mut self, side: &SeamSide, path: &Path) -> Option<usize> {
        let names: Vec<&str> = self.description.garments.iter().map(|garment| garment.name.as_str()).collect();
        let found = names.iter().position(|name| *name == side.garment);
        if found.is_none() {
            // A garment that could not be read has been reported already.
            let written: Vec<&str> = self.scene.document.garment.iter().map(|g| g.name.as_str()).collect();
            if !written.contains(&side.garment.as_str()) {
                let help = suggestion(&side.garment, &written);
                let what = format!("there is no garment \"{}\"", side.garment);
                self.error_with(&path.clone().key("garment"), what, help);
            }
        }
        found
    }

    fn seam_side(&mut self, side: &SeamSide, path: &Path) -> Option<Side> {
        let garment = self.seam_garment(side, path)?;
        let named = named(side);
        if named.ways() != 1 {
            let help =
                "name the vertices; with `pairing = \"surface\"` the side `to` names its garment alone".to_owned();
            self.error_with(
                path,
                "a side of a seam needs exactly one of `vertices`, `corners`, `nodes` and `where`",
                help,
            );
            return None;
        }
        let description = &self.description.garments[garment];
        let start = description.start.clone();
        let mesh = self.garments[garment].clone();
        let all = self.places(path, &mesh, start.as_deref(), true)?;
        let chosen = self.check(path, named.find(&all, self.grids[garment]))?;
        let vertices = self.existing((path, "seam"), chosen, all.len(), (side.region, &all))?;
        let start = vertices.iter().map(|v| all[*v as usize]).collect();
        Some(Side { garment, vertices, start })
    }
}

/// The vertices that a side names.
fn named(side: &SeamSide) -> Named<'_> {
    Named {
        vertices: side.vertices.as_deref(),
        corners: side.corners.as_deref(),
        nodes: side.nodes.as_deref(),
        region: side.region,
        map: None,
    }
}

impl Side {
    /// The vertices of a region in the order of their places along the axis on which it is longest; of equal places the lower number first.
    fn along(self) -> Self {
        let extent = |axis: usize| {
            let places = || self.start.iter().map(|place| place[axis]);
            places().fold(f64::NEG_INFINITY, f64::max) - places().fold(f64::INFINITY, f64::min)
        };
        let axis = (0..3).fold(0, |longest, axis| if extent(axis) > extent(longest) { axis } else { longest });
        let mut both: Vec<(u32, Vec3)> = self.vertices.into_iter().zip(self.start).collect();
        both.sort_by(|(a, x), (b, y)| x[axis].total_cmp(&y[axis]).then(a.cmp(b)));
        let (vertices, start) = both.into_iter().unzip();
        Self { vertices, start, ..self }
    }
}

/// The first with the first, and so on.
fn in_turn(from: &Side, to: &Side) -> Vec<[u32; 2]> {
    from.vertices.iter().zip(&to.vertices).map(|(a, b)| [*a, *b]).collect()
}

/// Each vertex of one side with the nearest of the other; of equally near ones the first.
fn to_nearest(from: &Side, to: &Side) -> Vec<[u32; 2]> {
    let nearest = |place: &Vec3| {
        let distance = |k: &usize| (to.start[*k] - place).norm_squared();
        (0..to.vertices.len()).min_by(|a, b| distance(a).total_cmp(&distance(b))).map(|k| to.vertices[k])
    };
    from.vertices.iter().zip(&from.start).filter_map(|(vertex, place)| Some([*vertex, nearest(place)?])).collect()
}
