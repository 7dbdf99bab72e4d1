//! Points attached to the triangles of a body, and points moved along piecewise linear paths.

use crate::Vec3;

/// A vertex attached to a triangle of a body: barycentric point plus an offset in the triangle's frame.
///
/// The frame is tangent = direction of the first edge, bitangent = normal × tangent, normal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurfaceAttachment {
    /// Vertex number in the garment's own order.
    pub vertex: u32,
    /// Points of the body that form the triangle.
    pub body_points: [u32; 3],
    /// Barycentric weights, adding up to one.
    pub weights: [f64; 3],
    /// Offset along tangent, bitangent and normal [m].
    pub offset: Vec3,
}

/// Piecewise linear value at `time`, held before the first and after the last key; zero without keys.
pub(crate) fn along_path(keys: &[(f64, Vec3)], time: f64) -> Vec3 {
    let next = keys.partition_point(|(t, _)| *t <= time);
    match (next.checked_sub(1).map(|i| keys[i]), keys.get(next)) {
        (None, None) => Vec3::zeros(),
        (None, Some((_, first))) => *first,
        (Some((_, last)), None) => last,
        (Some((ta, a)), Some((tb, b))) => a.lerp(b, (time - ta) / (tb - ta)),
    }
}

/// Frame of a triangle: tangent along the first edge, bitangent = normal × tangent, normal.
fn triangle_frame([a, b, c]: [Vec3; 3]) -> [Vec3; 3] {
    let tangent = (b - a).try_normalize(0.0).unwrap_or_else(Vec3::x);
    let normal = (b - a).cross(&(c - a)).try_normalize(0.0).unwrap_or_else(Vec3::y);
    [tangent, normal.cross(&tangent), normal]
}

/// Place of an attachment on its triangle's current corners [m].
pub(crate) fn attached_position(attachment: &SurfaceAttachment, corners: [Vec3; 3]) -> Vec3 {
    let frame = triangle_frame(corners);
    let on_surface: Vec3 = (0..3).map(|i| corners[i] * attachment.weights[i]).sum();
    on_surface + (0..3).map(|i| frame[i] * attachment.offset[i]).sum::<Vec3>()
}

/// The attachment that puts a vertex at `place` [m], given a triangle and the weights of the point below it.
pub(crate) fn attach(
    vertex: u32,
    place: Vec3,
    body_points: [u32; 3],
    weights: [f64; 3],
    corners: [Vec3; 3],
) -> SurfaceAttachment {
    let on_surface: Vec3 = (0..3).map(|i| corners[i] * weights[i]).sum();
    let frame = triangle_frame(corners);
    let apart = place - on_surface;
    SurfaceAttachment { vertex, body_points, weights, offset: Vec3::from(frame.map(|axis| axis.dot(&apart))) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_attachment_rebuilds_its_place_and_follows_a_turned_triangle() {
        let corners = [Vec3::new(0.0, 0.0, 0.0), Vec3::new(2.0, 0.0, 0.0), Vec3::new(0.0, 0.0, -1.0)];
        let place = Vec3::new(0.5, 0.3, -0.2);
        let attachment = attach(7, place, [0, 1, 2], [0.6, 0.2, 0.2], corners);
        assert!((attached_position(&attachment, corners) - place).norm() < 1e-15);
        let turn = nalgebra::Rotation3::from_axis_angle(&Vec3::z_axis(), 1.1);
        let moved = attached_position(&attachment, corners.map(|c| turn * c + Vec3::x()));
        assert!((moved - (turn * place + Vec3::x())).norm() < 1e-15);
    }

    #[test]
    fn a_path_is_held_at_its_ends() {
        let keys = [(1.0, Vec3::x()), (3.0, 3.0 * Vec3::x())];
        for (time, x) in [(0.0, 1.0), (1.0, 1.0), (2.0, 2.0), (3.0, 3.0), (9.0, 3.0)] {
            assert_eq!(along_path(&keys, time).x, x);
        }
    }
}
