//! A small software renderer for contact sheets: triangles with a depth buffer, smooth two-sided Lambert shading under
//! one lamp beside the camera, edges smoothed by four samples a pixel.

use drapery_core::Vec3;

/// Samples along each side of a pixel.
const SAMPLES: usize = 2;

/// Distance of the camera in radii of what it looks at.
const DISTANCE: f64 = 4.0;

/// Nothing nearer to the camera than this share of its distance is drawn.
const NEAREST: f64 = 0.05;

/// Room around the subject, as a share of the picture.
const MARGIN: f64 = 0.04;

/// Light that comes from everywhere.
const AMBIENT: f64 = 0.38;

/// Factor on the brightness of the far side of cloth, so that inside and outside can be told apart.
const BACK: f64 = 0.8;

/// Colours are multiples of this: such pictures are much smaller as files, and look the same.
const COLOUR_STEP: f64 = 4.0;

/// A mesh to be drawn.
#[derive(Debug, Clone, Copy)]
pub(super) struct Surface<'a> {
    /// Positions [m].
    pub(super) positions: &'a [Vec3],
    /// Triangles.
    pub(super) triangles: &'a [[u32; 3]],
    /// Red, green and blue, 0 to 255.
    pub(super) colour: [f64; 3],
    /// Whether both sides look the same.
    pub(super) solid: bool,
}

/// A picture; rows from the top, four bytes a pixel, transparent where nothing is.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Picture {
    /// Pixels across.
    pub(super) width: usize,
    /// Pixels down.
    pub(super) height: usize,
    /// Red, green, blue, opacity.
    pub(super) pixels: Vec<u8>,
}

/// Position of the camera, and scale at which things appear.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct View {
    centre: Vec3,
    /// Unit vectors to the right, up, and towards the camera.
    axes: [Vec3; 3],
    distance: f64,
    /// Pixels a unit at the distance of the centre, and the place of the centre in the picture.
    scale: f64,
    origin: [f64; 2],
    width: usize,
    height: usize,
}

impl View {
    /// A view from the front right and a little above in which all points fit into a picture `width` pixels across.
    pub(super) fn fitting(points: &[Vec3], width: usize) -> Self {
        let first = points.first().copied().unwrap_or_default();
        let (low, high) = points.iter().fold((first, first), |(low, high), p| (low.inf(p), high.sup(p)));
        let centre = (low + high) / 2.0;
        // A single point still has a surrounding.
        let radius = points.iter().map(|p| (p - centre).norm()).fold(f64::MIN_POSITIVE.sqrt(), f64::max);
        let towards = Vec3::new(0.5, 0.42, 1.0).normalize();
        let right = Vec3::y().cross(&towards).normalize();
        let axes = [right, towards.cross(&right), towards];
        let mut view =
            Self { centre, axes, distance: DISTANCE * radius, scale: 1.0, origin: [0.0; 2], width, height: width };
        let places: Vec<[f64; 2]> = points.iter().map(|p| view.place(*p)).map(|[x, y, _]| [x, y]).collect();
        let bound = |axis: usize, pick: fn(f64, f64) -> f64| places.iter().map(|p| p[axis]).reduce(pick).unwrap_or(0.0);
        let ([left, top], [far, bottom]) =
            ([bound(0, f64::min), bound(1, f64::min)], [bound(0, f64::max), bound(1, f64::max)]);
        let (across, down) = ((far - left).max(radius * MARGIN), (bottom - top).max(radius * MARGIN));
        view.height = (width as f64 * (down / across).clamp(0.6, 1.25)).round() as usize;
        let room = [width as f64, view.height as f64].map(|side| side * (1.0 - 2.0 * MARGIN));
        view.scale = (room[0] / across).min(room[1] / down);
        view.origin = [
            width as f64 / 2.0 - view.scale * (left + far) / 2.0,
            view.height as f64 / 2.0 - view.scale * (top + bottom) / 2.0,
        ];
        view
    }

    /// Middle of what is looked at, and a length of its size.
    pub(super) fn subject(&self) -> (Vec3, f64) {
        (self.centre, self.distance / DISTANCE)
    }

    /// Place in the picture, from the left and from the top, and nearness: larger is nearer, infinite or negative is
    /// behind the camera.
    fn place(&self, point: Vec3) -> [f64; 3] {
        let p = point - self.centre;
        let [x, y, z] = self.axes.map(|axis| axis.dot(&p));
        let nearness = self.distance / (self.distance - z);
        [self.origin[0] + self.scale * x * nearness, self.origin[1] - self.scale * y * nearness, nearness]
    }
}

/// Draws surfaces.
pub(super) fn render(view: &View, surfaces: &[Surface<'_>]) -> Picture {
    let mut canvas = Canvas::new(view.width * SAMPLES, view.height * SAMPLES);
    surfaces.iter().for_each(|surface| canvas.draw(view, surface));
    canvas.picture(view.width, view.height)
}

/// Samples of a picture.
struct Canvas {
    width: usize,
    height: usize,
    nearness: Vec<f32>,
    colours: Vec<[f32; 3]>,
}

impl Canvas {
    fn new(width: usize, height: usize) -> Self {
        Self { width, height, nearness: vec![0.0; width * height], colours: vec![[0.0; 3]; width * height] }
    }

    fn draw(&mut self, view: &View, surface: &Surface<'_>) {
        let normals = normals(surface);
        let samples = SAMPLES as f64;
        let place = |p: &Vec3| {
            let [x, y, nearness] = view.place(*p);
            [x * samples, y * samples, nearness]
        };
        let places: Vec<[f64; 3]> = surface.positions.iter().map(place).collect();
        let is_before_camera = |p: &[f64; 3]| p.iter().all(|x| x.is_finite()) && p[2] > 0.0 && p[2] < 1.0 / NEAREST;
        for triangle in surface.triangles {
            let corners = triangle.map(|v| v as usize);
            // A triangle of points that are not there or not numbers is left out.
            if corners.iter().all(|&v| places.get(v).is_some_and(is_before_camera)) {
                let shades = corners.map(|v| normals[v]);
                self.fill(view, corners.map(|v| places[v]), shades, surface);
            }
        }
    }

    fn fill(&mut self, view: &View, [a, b, c]: [[f64; 3]; 3], normals: [Vec3; 3], surface: &Surface<'_>) {
        let area = (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1]);
        if area == 0.0 {
            return;
        }
        // Faces are counter-clockwise seen from outside; downwards in a picture is positive, so the sign turns.
        let is_front = area < 0.0;
        let span = |axis: usize, limit: usize| {
            let values = [a[axis], b[axis], c[axis]];
            let low = values.into_iter().fold(f64::INFINITY, f64::min).max(0.0).floor() as usize;
            let high = values.into_iter().fold(0.0, f64::max).ceil() as usize;
            low..high.min(limit)
        };
        let (columns, rows) = (span(0, self.width), span(1, self.height));
        for row in rows {
            for column in columns.clone() {
                let (x, y) = (column as f64 + 0.5, row as f64 + 0.5);
                let weight =
                    |p: [f64; 3], q: [f64; 3]| ((q[0] - p[0]) * (y - p[1]) - (q[1] - p[1]) * (x - p[0])) / area;
                let (u, v, w) = (weight(b, c), weight(c, a), weight(a, b));
                let nearness = (u * a[2] + v * b[2] + w * c[2]) as f32;
                let index = row * self.width + column;
                if u >= 0.0 && v >= 0.0 && w >= 0.0 && nearness > self.nearness[index] {
                    let normal = normals[0] * u + normals[1] * v + normals[2] * w;
                    self.nearness[index] = nearness;
                    self.colours[index] = shade(view, normal, is_front || surface.solid, surface.colour);
                }
            }
        }
    }

    /// Pixels from samples.
    fn picture(&self, width: usize, height: usize) -> Picture {
        let mut pixels = Vec::with_capacity(width * height * 4);
        for (row, column) in (0..height).flat_map(|row| (0..width).map(move |column| (row, column))) {
            let (mut sum, mut covered) = ([0.0; 3], 0);
            for (y, x) in (0..SAMPLES).flat_map(|y| (0..SAMPLES).map(move |x| (y, x))) {
                let index = (row * SAMPLES + y) * self.width + column * SAMPLES + x;
                if self.nearness[index] > 0.0 {
                    covered += 1;
                    (0..3).for_each(|i| sum[i] += f64::from(self.colours[index][i]));
                }
            }
            let colour =
                |x: f64| ((x / f64::from(covered.max(1)) / COLOUR_STEP).round() * COLOUR_STEP).min(255.0) as u8;
            pixels.extend(sum.map(colour));
            pixels.push((covered as usize * 255 / (SAMPLES * SAMPLES)) as u8);
        }
        Picture { width, height, pixels }
    }
}

/// Colour of a place with this normal under the lamp, which stands at the left above the camera.
fn shade(view: &View, normal: Vec3, is_front: bool, colour: [f64; 3]) -> [f32; 3] {
    let [right, up, towards] = view.axes;
    let lamp = (towards * 0.75 + up * 0.55 - right * 0.45).normalize();
    let normal = normal.try_normalize(0.0).unwrap_or(towards);
    // Seen from behind, cloth shows its other side.
    let normal = if normal.dot(&towards) < 0.0 { -normal } else { normal };
    let light = AMBIENT + (1.0 - AMBIENT) * normal.dot(&lamp).max(0.0);
    let side = if is_front { 1.0 } else { BACK };
    colour.map(|c| (c * light * side) as f32)
}

/// Normals of vertices: those of their triangles, weighted by area.
fn normals(surface: &Surface<'_>) -> Vec<Vec3> {
    let mut normals = vec![Vec3::zeros(); surface.positions.len()];
    for triangle in surface.triangles {
        let corners = triangle.map(|v| v as usize);
        let [Some(a), Some(b), Some(c)] = corners.map(|v| surface.positions.get(v)) else { continue };
        let normal = (b - a).cross(&(c - a));
        corners.iter().for_each(|&v| normals[v] += normal);
    }
    normals
}

#[cfg(test)]
mod tests {
    use super::*;

    const RED: [f64; 3] = [200.0, 0.0, 0.0];
    const BLUE: [f64; 3] = [0.0, 0.0, 200.0];

    /// A square of side 2 that faces the camera, `towards` it by an amount.
    fn square(view: &View, towards: f64, side: f64) -> Vec<Vec3> {
        let [right, up, axis] = view.axes;
        [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]
            .map(|[x, y]| right * x * side + up * y * side + axis * towards)
            .to_vec()
    }

    fn unit_view() -> View {
        let corners: Vec<Vec3> =
            (0..8).map(|i| Vec3::new(f64::from(i & 1), f64::from(i >> 1 & 1), f64::from(i >> 2)) * 2.0).collect();
        let corners: Vec<Vec3> = corners.into_iter().map(|p| p - Vec3::repeat(1.0)).collect();
        View::fitting(&corners, 64)
    }

    fn middle(picture: &Picture) -> [u8; 4] {
        let index = 4 * (picture.height / 2 * picture.width + picture.width / 2);
        [0, 1, 2, 3].map(|i| picture.pixels[index + i])
    }

    #[test]
    fn the_nearer_surface_hides_the_other_whatever_is_drawn_first() {
        let view = unit_view();
        let (near, far) = (square(&view, 0.3, 0.5), square(&view, -0.3, 0.5));
        let triangles = [[0, 1, 2], [0, 2, 3]];
        let surface = |positions, colour| Surface { positions, triangles: &triangles, colour, solid: false };
        let (red, blue) = (surface(&near, RED), surface(&far, BLUE));
        for order in [[red, blue], [blue, red]] {
            let [r, _, b, opacity] = middle(&render(&view, &order));
            assert!(r > 100 && b == 0 && opacity == 255, "{r} {b}");
        }
    }

    #[test]
    fn both_sides_of_cloth_are_lit_and_the_far_one_is_darker() {
        let view = unit_view();
        let positions = square(&view, 0.0, 0.5);
        let draw = |triangles: &[[u32; 3]]| {
            let surface = Surface { positions: &positions, triangles, colour: RED, solid: false };
            middle(&render(&view, &[surface]))[0]
        };
        let (front, back) = (draw(&[[0, 1, 2], [0, 2, 3]]), draw(&[[0, 2, 1], [0, 3, 2]]));
        assert!(front > back && back > 60, "{front} {back}");
    }

    #[test]
    fn all_points_fit_into_the_picture_and_the_rest_is_transparent() {
        let view = unit_view();
        for x in [-1.0, 1.0] {
            let [left, top, _] = view.place(Vec3::new(x, x, -x));
            assert!((0.0..=view.width as f64).contains(&left) && (0.0..=view.height as f64).contains(&top));
        }
        let picture = render(&view, &[]);
        assert!(picture.pixels.iter().all(|byte| *byte == 0));
        // Points that are not numbers, and triangles of points that do not exist, are left out.
        let broken = [Vec3::repeat(f64::NAN), Vec3::zeros(), Vec3::x()];
        let surface = Surface { positions: &broken, triangles: &[[0, 1, 2], [1, 2, 9]], colour: RED, solid: true };
        assert!(render(&view, &[surface]) == picture);
    }
}
