//! A coat as two meshes: the cloth that is simulated, a tube, and what is rendered in its place, a shell of two layers with hems, a
//! collar that is folded over, and buttons.

use std::f64::consts::TAU;

use crate::garments::Garment;
use crate::sdf::Vec3;
use crate::surface_mesh::SurfaceMesh;

/// Height of the neck and of the lower hem \[m\].
const HEIGHTS: [f64; 2] = [1.5, 0.9];
/// Radius at the neck and at the lower hem \[m\].
const RADII: [f64; 2] = [0.14, 0.24];
/// Cells of the simulated mesh around and down.
const CELLS: [usize; 2] = [48, 32];
/// Cells of the shell for each of these, along both directions.
const FINER: usize = 2;
/// Half of the thickness of the shell \[m\].
pub const HALF_THICKNESS: f64 = 0.001;
/// Heights of the collar's layers over the cloth at the neck \[m\], where it is sewn to the shell: no gap is seen between them.
const COLLAR: [f64; 2] = [0.0012, 0.0032];
/// Reach of the collar downwards, as a share of the coat, and its added height over the cloth there \[m\].
const COLLAR_DEPTH: (f64, f64) = (0.125, 0.0068);
/// Buttons in a row down the front: how many, radius \[m\], height of lower and upper side over the cloth \[m\], corners. They are
/// sewn on: the lower side lies in the outer layer of the shell.
const BUTTONS: usize = 5;
const BUTTON_RADIUS: f64 = 0.009;
const BUTTON_SIDES: [f64; 2] = [0.0008, 0.004];
const BUTTON_CORNERS: usize = 16;

/// A place of the coat: round by the share `u` of a turn, down by the share `s`, off the cloth by `height` \[m\].
fn place(u: f64, s: f64, height: f64) -> Vec3 {
    let [top, bottom] = HEIGHTS;
    let [neck, hem] = RADII;
    let (sin, cos) = (TAU * u).sin_cos();
    let out = Vec3::new(cos, 0.0, sin);
    let down = Vec3::new(0.0, bottom - top, 0.0) + out * (hem - neck);
    let normal = (out * (top - bottom) + Vec3::y() * (hem - neck)) / down.norm();
    out * neck + Vec3::y() * top + down * s + normal * height
}

/// A mesh being put together.
#[derive(Default)]
struct Parts {
    points: Vec<Vec3>,
    faces: Vec<Vec<usize>>,
    uvs: Vec<[f64; 2]>,
    uv_corners: Vec<Vec<usize>>,
    sets: Vec<(&'static str, Vec<usize>)>,
}

impl Parts {
    /// Begins a face set; the faces that follow belong to it.
    fn set(&mut self, name: &'static str) {
        self.sets.push((name, Vec::new()));
    }

    fn point(&mut self, point: Vec3) -> usize {
        self.points.push(point);
        self.points.len() - 1
    }

    /// A face with the texture coordinate of each corner.
    fn face(&mut self, corners: Vec<usize>, uvs: Vec<[f64; 2]>) {
        let first = self.uvs.len();
        self.uv_corners.push((first..first + uvs.len()).collect());
        self.uvs.extend(uvs);
        self.sets.last_mut().expect("a set comes before its faces").1.push(self.faces.len());
        self.faces.push(corners);
    }

    /// Points of a layer of `around` by `down` cells, row after row from the neck.
    fn layer(&mut self, [around, down]: [usize; 2], at: impl Fn(f64, f64) -> Vec3) -> usize {
        let first = self.points.len();
        for row in 0..=down {
            for column in 0..around {
                self.point(at(column as f64 / around as f64, row as f64 / down as f64));
            }
        }
        first
    }

    /// Faces of such a layer, to the outside or to the inside.
    fn layer_faces(&mut self, first: usize, [around, down]: [usize; 2], outside: bool) {
        for row in 0..down {
            for column in 0..around {
                let corner = |i: usize, j: usize| first + (row + j) * around + (column + i) % around;
                let uv = |i: usize, j: usize| [(column + i) as f64 / around as f64, (row + j) as f64 / down as f64];
                // Both begin with the same corner: layers that are cut along the same diagonals stay apart where quads are bent.
                let mut turn = [(0, 0), (1, 0), (1, 1), (0, 1)];
                if !outside {
                    turn[1..].reverse();
                }
                self.face(turn.map(|(i, j)| corner(i, j)).to_vec(), turn.map(|(i, j)| uv(i, j)).to_vec());
            }
        }
    }

    /// Two layers joined along both hems; `heights` \[m\] of the inner and the outer one over the cloth at the share `s`.
    fn shell(
        &mut self,
        cells: [usize; 2],
        (name, hems): (&'static str, &'static str),
        at: impl Fn(f64, f64, usize) -> Vec3,
    ) {
        let [inner, outer] = [0, 1].map(|layer| self.layer(cells, |u, s| at(u, s, layer)));
        self.set(name);
        self.layer_faces(outer, cells, true);
        self.layer_faces(inner, cells, false);
        self.set(hems);
        let [around, down] = cells;
        for (row, is_neck) in [(0, true), (down, false)] {
            for column in 0..around {
                let next = (column + 1) % around;
                let [a, b] = [column, next].map(|column| row * around + column);
                let corners = if is_neck {
                    [inner + a, inner + b, outer + b, outer + a]
                } else {
                    [outer + a, outer + b, inner + b, inner + a]
                };
                let v = row as f64 / down as f64;
                let [left, right] = [column, column + 1].map(|column| column as f64 / around as f64);
                self.face(corners.to_vec(), vec![[left, v], [right, v], [right, v], [left, v]]);
            }
        }
    }

    /// A button: a flat cylinder on the front.
    fn button(&mut self, s: f64) {
        let [low, high] = BUTTON_SIDES.map(|height| place(0.0, s, height));
        let out = (high - low).normalize();
        let across = Vec3::z();
        let up = out.cross(&across);
        let ring = |corner: usize| {
            let (sin, cos) = (TAU * corner as f64 / BUTTON_CORNERS as f64).sin_cos();
            (across * cos + up * sin) * BUTTON_RADIUS
        };
        let uv = |corner: usize| {
            let (sin, cos) = (TAU * corner as f64 / BUTTON_CORNERS as f64).sin_cos();
            [0.5 + 0.5 * cos, 0.5 + 0.5 * sin]
        };
        let lower: Vec<usize> = (0..BUTTON_CORNERS).map(|corner| self.point(low + ring(corner))).collect();
        let upper: Vec<usize> = (0..BUTTON_CORNERS).map(|corner| self.point(high + ring(corner))).collect();
        self.face(upper.clone(), (0..BUTTON_CORNERS).map(uv).collect());
        self.face(lower.iter().rev().copied().collect(), (0..BUTTON_CORNERS).map(uv).collect());
        for corner in 0..BUTTON_CORNERS {
            let next = (corner + 1) % BUTTON_CORNERS;
            self.face(
                vec![lower[corner], lower[next], upper[next], upper[corner]],
                [corner, next, next, corner].map(uv).to_vec(),
            );
        }
    }

    fn garment(self, name: &'static str) -> Garment {
        let mesh = SurfaceMesh { points: self.points, faces: self.faces };
        Garment { name, mesh, uvs: self.uvs, uv_corners: self.uv_corners, face_sets: self.sets, waist_ring: Vec::new() }
    }
}

/// The cloth that is simulated.
pub fn coat() -> Garment {
    let mut parts = Parts::default();
    let first = parts.layer(CELLS, |u, s| place(u, s, 0.0));
    parts.set("cloth");
    parts.layer_faces(first, CELLS, true);
    parts.garment("coat")
}

/// Returns the garment rendered in its place: `shell` with its `hems`, `collar` with `collar_hems`, and `buttons`.
pub fn coat_render() -> Garment {
    let mut parts = Parts::default();
    let cells = CELLS.map(|cells| cells * FINER);
    parts.shell(cells, ("shell", "hems"), |u, s, layer| place(u, s, [-HALF_THICKNESS, HALF_THICKNESS][layer]));
    let (depth, off) = COLLAR_DEPTH;
    let rows = (cells[1] as f64 * depth).ceil() as usize;
    let collar = |u: f64, s: f64, layer: usize| place(u, s * depth, COLLAR[layer] + off * s);
    parts.shell([cells[0], rows], ("collar", "collar_hems"), collar);
    parts.set("buttons");
    (0..BUTTONS).for_each(|button| parts.button(0.2 + 0.15 * button as f64));
    parts.garment("coat_render")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_shell_is_closed_and_holds_the_cloth_between_its_layers() {
        let [cloth, rendered] = [coat(), coat_render()];
        assert_eq!(cloth.mesh.boundary_loops().len(), 2, "neck and hem");
        assert!(rendered.mesh.boundary_loops().is_empty());
        assert!(rendered.mesh.edges().iter().all(|(_, faces)| *faces == 2));
        // Closed pieces that face outwards enclose a positive volume: cloth of 2 mm, the collar of 2 mm, and the buttons.
        let area = |from: f64, to: f64| {
            let [neck, hem] = RADII;
            let mean = neck + (hem - neck) * (from + to) / 2.0;
            let length = (HEIGHTS[0] - HEIGHTS[1]).hypot(hem - neck) * (to - from);
            TAU * mean * length
        };
        let buttons = BUTTONS as f64 * BUTTON_RADIUS * BUTTON_RADIUS * TAU / 2.0 * (BUTTON_SIDES[1] - BUTTON_SIDES[0]);
        let expected = 0.002 * (area(0.0, 1.0) + area(0.0, COLLAR_DEPTH.0)) + buttons;
        let volume = rendered.mesh.volume();
        assert!((volume / expected - 1.0).abs() < 0.03, "{volume} instead of {expected}");
        let faces: usize = rendered.face_sets.iter().map(|(_, faces)| faces.len()).sum();
        assert_eq!(faces, rendered.mesh.faces.len(), "every face is in one set");
    }
}
