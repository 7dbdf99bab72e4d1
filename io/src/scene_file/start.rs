//! Start positions and start velocities of the points of a garment.

use drapery_core::Vec3;
use drapery_core::mesh::{MeshStream, faces};
use drapery_core::settings::Dimension;

use crate::garment_mesh::GarmentMesh;

use super::random::Random;
use super::raw::{Axis, Folds, Garment, Jitter, PanelShape};
use super::resolve::Resolver;
use super::tree::Path;

impl Resolver<'_> {
    /// Start positions, or `Some(None)` if they are those at rest; `None` after a problem, which is recorded.
    pub(super) fn start(
        &mut self,
        garment: &Garment,
        path: &Path,
        mesh: &GarmentMesh,
        grid: Option<[u32; 2]>,
    ) -> Option<Option<Vec<Vec3>>> {
        let posed = match (&garment.start, garment.folds) {
            (Some(start), None) => Some(self.start_pose(garment, start, path, mesh)?),
            (None, Some(folds)) => {
                let points = self.of_file(path, mesh.positions())?;
                Some(self.folded(garment, folds, path, &points, grid)?)
            }
            (None, None) => None,
            (Some(_), Some(_)) => {
                self.error(&path.clone().key("folds"), "a garment starts folded or from a file, not both".to_owned());
                return None;
            }
        };
        let Some(jitter) = garment.jitter else { return Some(posed) };
        let places = self.places(path, mesh, posed.as_deref(), true)?;
        Some(Some(displaced(&places, jitter)))
    }

    fn start_pose(&mut self, garment: &Garment, start: &str, path: &Path, mesh: &GarmentMesh) -> Option<Vec<Vec3>> {
        let here = path.clone().key("start");
        let (file, time) = self.file_at(&here, start)?;
        let source = self.open(&here, &file, garment.path.as_deref(), garment.units)?;
        let time = self.time_in(&here, &source, time)?;
        let points = self.mesh(&here, &source, Some(time))?.mesh.points;
        self.same_count(&here, "the start pose", points.len(), "the rest shape", mesh.point_count())?;
        let at_rest = self.of_file(path, mesh.positions())?;
        let [long, short] = [&points, &at_rest].map(|places| all_edges(mesh, places));
        let times = long / short;
        // Nothing is known of a mesh without edges.
        if times.is_finite() && times > 0.0 && !(1.0 / OTHER_UNIT..=OTHER_UNIT).contains(&times) {
            let (times, size) = if times > 1.0 { (times, "large") } else { (times.recip(), "small") };
            let what = format!(
                "the start pose is {times:.0} times as {size} as at rest: one of the two files is in another unit"
            );
            let help = "export both in the same unit, or let each file state its own".to_owned();
            self.data_error(&here, what, help);
            return None;
        }
        Some(points)
    }

    fn folded(
        &mut self,
        garment: &Garment,
        folds: Folds,
        path: &Path,
        points: &[Vec3],
        grid: Option<[u32; 2]>,
    ) -> Option<Vec<Vec3>> {
        let here = path.clone().key("folds");
        let flat = garment.panel.is_some_and(|panel| panel.shape == PanelShape::Flat);
        let (Some([nodes, _]), true) = (grid, flat) else {
            self.error(&here, "only a flat `panel` can start folded".to_owned());
            return None;
        };
        let (cells, Folds { layers, gap }) = (nodes - 1, folds);
        if layers < 2 || u64::from(cells) < 3 * u64::from(layers) {
            let text =
                format!("{layers} layers are out of range with {cells} cells along x; 2 to {} are allowed", cells / 3);
            self.error_with(&here.key("layers"), text, "raise the panel's resolution or its aspect".to_owned());
            return None;
        }
        let cell = (points[1] - points[0]).norm();
        if !(gap > 0.0 && gap < 2.0 * cell) {
            let text = format!("a gap of {gap} m is out of range; it has to be positive and below {:.6} m", 2.0 * cell);
            self.error_with(&here.key("gap"), text, "two cells of the panel make a fold".to_owned());
            return None;
        }
        Some(folded(points, nodes as usize, folds))
    }

    /// Start velocities [m/s], or `Some(None)` if all are alike; `None` after a problem, which is recorded.
    pub(super) fn start_velocities(
        &mut self,
        garment: &Garment,
        path: &Path,
        count: usize,
    ) -> Option<Option<Vec<Vec3>>> {
        let Some(random) = &garment.random_velocity else {
            return Some(None);
        };
        let here = path.clone().key("random_velocity").key("speed");
        let speed = self.quantity(&here, &random.speed, Dimension::Speed)?;
        let mut stream = Random::new(random.seed);
        Some(Some((0..count).map(|_| Vec3::from(garment.velocity) + stream.direction() * speed).collect()))
    }
}

/// Ratio of the edges at the start and at rest from which no strain explains it: a little less than that of centimetres and decimetres.
const OTHER_UNIT: f64 = 8.0;

/// Sum of the lengths of the edges of all faces at these places [m].
fn all_edges(mesh: &GarmentMesh, places: &[Vec3]) -> f64 {
    let at = |corner: &u32| places.get(*corner as usize).copied().unwrap_or_default();
    let mut sum = 0.0;
    // A file that cannot be read is reported elsewhere.
    let _ = mesh.faces(&mut |counts, corners| {
        for face in faces(counts, corners) {
            let next = face.iter().cycle().skip(1);
            sum += face.iter().zip(next).map(|(a, b)| (at(a) - at(b)).norm()).sum::<f64>();
        }
    });
    sum
}

/// Start positions displaced at random along an axis.
fn displaced(points: &[Vec3], jitter: Jitter) -> Vec<Vec3> {
    let mut random = Random::new(jitter.seed);
    let axis = match jitter.axis {
        Axis::X => Vec3::x(),
        Axis::Y => Vec3::y(),
        Axis::Z => Vec3::z(),
    };
    points.iter().map(|p| p + axis * (jitter.amplitude * random.unit())).collect()
}

/// A flat panel of rows of `nodes` points along x, folded to and fro; each fold is two cells that meet in its tip.
fn folded(points: &[Vec3], nodes: usize, folds: Folds) -> Vec<Vec3> {
    let (along, across) = (points[1] - points[0], points[nodes] - points[0]);
    let cell = along.norm();
    let (x, y) = (along / cell, across.cross(&along).normalize());
    let profile = zigzag(nodes - 1, cell, folds);
    let middle = |axis: usize| {
        let range = profile.iter().fold((f64::INFINITY, -f64::INFINITY), |r, p| (r.0.min(p[axis]), r.1.max(p[axis])));
        (range.0 + range.1) / 2.0
    };
    // The panel's middle along x is that of every row.
    let center = (nodes - 1) as f64 * cell / 2.0;
    let shifts: Vec<Vec3> = profile.iter().map(|p| x * (p[0] - middle(0) + center) + y * (p[1] - middle(1))).collect();
    points.chunks(nodes).flat_map(|row| shifts.iter().map(|shift| row[0] + shift)).collect()
}

/// Points of a line of `cells` pieces of length `cell` [m], folded to and fro into layers that differ by at most one
/// cell.
fn zigzag(cells: usize, cell: f64, folds: Folds) -> Vec<[f64; 2]> {
    let layers = folds.layers as usize;
    let flat = cells - 2 * (layers - 1);
    let reach = (cell * cell - folds.gap * folds.gap / 4.0).sqrt();
    let mut line = vec![[0.0, 0.0]];
    for layer in 0..layers {
        let forward = if layer % 2 == 0 { 1.0 } else { -1.0 };
        let [mut x, y] = line[line.len() - 1];
        for _ in flat * layer / layers..flat * (layer + 1) / layers {
            x += forward * cell;
            line.push([x, y]);
        }
        if layer + 1 < layers {
            line.push([x + forward * reach, y + folds.gap / 2.0]);
            line.push([x, y + folds.gap]);
        }
    }
    line
}

#[cfg(test)]
mod tests {
    use super::super::raw::Panel;
    use super::super::shapes;
    use super::*;

    #[test]
    fn a_folded_panel_keeps_its_edges_along_x_and_the_distance_of_its_layers() {
        let rotation = Some(super::super::raw::Rotation { axis: [1.0, 2.0, 3.0], degrees: 50.0 });
        let panel = Panel {
            resolution: 2,
            side: 0.1,
            aspect: 5.5,
            shape: PanelShape::Flat,
            center: Some([1.0, 2.0, 3.0]),
            rotation,
        };
        let rest = shapes::Form::Panel(panel).shape().mesh.points;
        let folds = Folds { layers: 3, gap: 0.02 };
        let start = folded(&rest, 12, folds);
        assert_eq!(start.len(), rest.len());
        for (rows, rest_row) in start.chunks(12).zip(rest.chunks(12)) {
            for (now, then) in rows.windows(2).zip(rest_row.windows(2)) {
                assert!(((now[1] - now[0]).norm() - (then[1] - then[0]).norm()).abs() < 1e-14);
            }
        }
        let up = (rest[12] - rest[0]).cross(&(rest[1] - rest[0])).normalize();
        // 11 cells: layers of 2, 2 and 3 cells, and two folds of 2.
        let heights = [0.0, 0.0, 0.0, 0.5, 1.0, 1.0, 1.0, 1.5, 2.0, 2.0, 2.0, 2.0];
        for (point, height) in start.iter().zip(heights) {
            assert!(((point - start[0]).dot(&up) - 0.02 * height).abs() < 1e-14);
        }
        let middle = |points: &[Vec3], axis: Vec3| {
            let along = points.iter().map(|p| p.dot(&axis));
            (along.clone().fold(f64::INFINITY, f64::min) + along.fold(-f64::INFINITY, f64::max)) / 2.0
        };
        for axis in [up, (rest[1] - rest[0]).normalize(), (rest[12] - rest[0]).normalize()] {
            assert!((middle(&start, axis) - middle(&rest, axis)).abs() < 1e-14);
        }
    }
}
