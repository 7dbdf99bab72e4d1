//! Pins of a garment's waist ring to the surface of the body, and their JSON file.

use std::fmt::Write;

use crate::sdf::Vec3;
use crate::surface_mesh::SurfaceMesh;

/// Holds one cloth vertex at a place that moves with a triangle of body vertices.
#[derive(Debug, Clone, PartialEq)]
pub struct Pin {
    /// Vertex of the garment.
    pub vertex: usize,
    /// Vertices of the body, counter-clockwise seen from outside.
    pub body_vertices: [usize; 3],
    /// Barycentric weights of the body vertices, for the nearest point of the body.
    pub weights: [f64; 3],
    /// From the nearest point to the cloth vertex, in the frame of [`tangent_frame`] \[m\].
    pub offset: [f64; 3],
}

impl Pin {
    /// Returns the position at which the pin holds its vertex for these body positions \[m\].
    pub fn position(&self, body: &[Vec3]) -> Vec3 {
        let corners = self.body_vertices.map(|v| body[v]);
        let frame = tangent_frame(corners);
        (0..3).map(|i| corners[i] * self.weights[i] + frame[i] * self.offset[i]).sum()
    }
}

/// Tangent along the first edge, bitangent = normal x tangent, and normal of a triangle.
pub fn tangent_frame([a, b, c]: [Vec3; 3]) -> [Vec3; 3] {
    let tangent = (b - a).normalize();
    let normal = (b - a).cross(&(c - a)).normalize();
    [tangent, normal.cross(&tangent), normal]
}

/// Pins for the vertices of `ring` at their rest positions, each to the nearest triangle of the body.
pub fn pin_ring(garment: &SurfaceMesh, ring: &[usize], body: &SurfaceMesh) -> Vec<Pin> {
    let triangles = body.triangles();
    ring.iter()
        .map(|&vertex| {
            let p = garment.points[vertex];
            let nearest = triangles
                .iter()
                .map(|&triangle| {
                    let corners = triangle.map(|v| body.points[v]);
                    let weights = nearest_weights(&p, corners);
                    let on: Vec3 = (0..3).map(|i| corners[i] * weights[i]).sum();
                    ((p - on).norm_squared(), triangle, weights, p - on)
                })
                .min_by(|a, b| a.0.total_cmp(&b.0));
            let (_, body_vertices, weights, off) = nearest.expect("the body has triangles");
            let offset = tangent_frame(body_vertices.map(|v| body.points[v])).map(|axis| axis.dot(&off));
            Pin { vertex, body_vertices, weights, offset }
        })
        .collect()
}

/// Barycentric weights of the point of a triangle that is nearest to `p`.
fn nearest_weights(p: &Vec3, corners: [Vec3; 3]) -> [f64; 3] {
    let [a, b, c] = corners;
    let normal = (b - a).cross(&(c - a));
    let part = |from: Vec3, to: Vec3| (to - from).cross(&(p - from)).dot(&normal) / normal.norm_squared();
    let inside = [part(b, c), part(c, a), part(a, b)];
    if inside.iter().all(|weight| *weight >= 0.0) {
        return inside;
    }
    let on_edge = |i: usize| {
        let j = (i + 1) % 3;
        let along = corners[j] - corners[i];
        let t = ((p - corners[i]).dot(&along) / along.norm_squared()).clamp(0.0, 1.0);
        let mut weights = [0.0; 3];
        (weights[i], weights[j]) = (1.0 - t, t);
        ((corners[i].lerp(&corners[j], t) - p).norm_squared(), weights)
    };
    let edges = [on_edge(0), on_edge(1), on_edge(2)];
    edges.into_iter().min_by(|a, b| a.0.total_cmp(&b.0)).map_or(inside, |(_, weights)| weights)
}

/// The pin file: JSON with one pin a line, numbers in the shortest form that reads back the same.
pub fn pins_json(garment: &str, pins: &[Pin]) -> String {
    let mut text = format!(
        "{{\"what\": \"waist ring of {garment}.obj attached to the body surface\", \"body\": \"body.abc\", \
         \"pins\": [\n"
    );
    for (i, pin) in pins.iter().enumerate() {
        let end = if i + 1 < pins.len() { "," } else { "" };
        writeln!(
            text,
            "{{\"vertex\": {}, \"body_vertices\": {:?}, \"weights\": {:?}, \
             \"offset_tangent_bitangent_normal\": {:?}}}{end}",
            pin.vertex, pin.body_vertices, pin.weights, pin.offset
        )
        .expect("a string takes any text");
    }
    text + "]}\n"
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_point_is_found_over_faces_edges_and_corners() {
        let corners = [Vec3::zeros(), Vec3::x(), Vec3::y()];
        let cases = [
            (Vec3::new(0.25, 0.25, 3.0), [0.5, 0.25, 0.25]),
            (Vec3::new(0.5, -1.0, 1.0), [0.5, 0.5, 0.0]),
            (Vec3::new(1.0, 1.0, -1.0), [0.0, 0.5, 0.5]),
            (Vec3::new(-1.0, -1.0, 0.5), [1.0, 0.0, 0.0]),
        ];
        for (p, expected) in cases {
            let weights = nearest_weights(&p, corners);
            assert!((0..3).all(|i| (weights[i] - expected[i]).abs() < 1e-12), "{p:?} {weights:?}");
        }
    }
}
