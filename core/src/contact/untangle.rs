//! Getting out of crossings that were there at the start, or that a body has pinched into the cloth: the edge and the
//! triangle that cross are pushed, gently, the way that shortens the line along which the surfaces meet.
//!
//! Which side cloth belongs on cannot be told where it crosses; which way the line of intersection gets shorter can
//! (P. Volino, N. Magnenat-Thalmann, "Resolving surface collisions through intersection contour minimization", SIGGRAPH
//! 2006). With e the direction of the edge, N the normal of the triangle, and R_i the unit directions of the line of intersection
//! from the edge into the triangles that have it, a shift d of the edge moves the point where it crosses by
//! d − (d·N)/(e·N) e, so the line gets shorter by d · Σ_i (R_i − (R_i·e)/(e·N) N).

use crate::Vec3;
use crate::contact::surface::ContactSurface;
use crate::contact::tolerances::ALONG_TRIANGLE;
use crate::geometry::crossings::Crossing;

/// Edge lengths per second at which cloth that crosses cloth is pushed apart [1/s].
const PUSH_RATE: f64 = 10.0;

/// The same for cloth that crosses a body: it was pinched, and has to be out soon after the body lets go [1/s].
const RELEASE_RATE: f64 = 60.0;

/// Gives every crossing a relative velocity out of itself, at least [m/s]; positions `x` [m] of all nodes, `velocity` of the
/// bodies' nodes [m/s], inverse masses per axis [1/kg].
pub fn push_apart(
    surface: &ContactSurface,
    crossings: &[Crossing],
    x: &[Vec3],
    velocity: impl Fn(u32) -> Vec3,
    mobility: &[Vec3],
    v: &mut [Vec3],
) {
    for crossing in crossings {
        let Some(push) = Push::new(surface, crossing, x) else { continue };
        let nodes = push.nodes.iter().zip(&push.weights);
        let speed_of = |node: u32, v: &[Vec3]| v.get(node as usize).copied().unwrap_or_else(|| velocity(node));
        let speed: f64 = nodes.clone().map(|(&node, w)| speed_of(node, v).dot(&push.direction) * w).sum();
        let rate = if surface.is_cloth(crossing) { PUSH_RATE } else { RELEASE_RATE };
        let wanted = rate * surface.edge_length()[crossing.edge[0] as usize];
        let squares = push.direction.component_mul(&push.direction);
        let response: f64 = nodes.clone().map(|(&node, w)| w * w * mobility[node as usize].dot(&squares)).sum();
        if speed >= wanted || response <= 0.0 {
            continue;
        }
        let impulse = push.direction * ((wanted - speed) / response);
        for (&node, w) in nodes {
            if let Some(v) = v.get_mut(node as usize) {
                *v += mobility[node as usize].component_mul(&impulse) * *w;
            }
        }
    }
}

/// Where and how one crossing is pushed.
struct Push {
    nodes: [u32; 5],
    /// Weights of the relative displacement: of the edge at the point where it crosses, less that of the triangle.
    weights: [f64; 5],
    direction: Vec3,
}

impl Push {
    fn new(surface: &ContactSurface, crossing: &Crossing, x: &[Vec3]) -> Option<Self> {
        let Crossing { edge: [p, q], triangle: [a, b, c] } = *crossing;
        let at = |node: u32| x[node as usize];
        let across = (at(b) - at(a)).cross(&(at(c) - at(a)));
        let normal = across.try_normalize(0.0)?;
        let along = at(q) - at(p);
        let e = along.try_normalize(0.0)?;
        let steep = e.dot(&normal);
        if steep.abs() < ALONG_TRIANGLE {
            return None;
        }
        let share = ((at(a) - at(p)).dot(&normal) / along.dot(&normal)).clamp(0.0, 1.0);
        let point = at(p) + along * share;
        let area = across.norm_squared();
        let wb = (point - at(a)).cross(&(at(c) - at(a))).dot(&across) / area;
        let wc = (at(b) - at(a)).cross(&(point - at(a))).dot(&across) / area;
        let mut gradient = Vec3::zeros();
        for triangle in surface.triangles_of_edge([p, q]) {
            let Some(opposite) = triangle.iter().find(|&&node| node != p && node != q) else { continue };
            let inwards = at(*opposite) - point;
            let own_normal = along.cross(&inwards);
            let Some(line) = own_normal.cross(&normal).try_normalize(0.0) else { continue };
            // From the edge into the triangle that has it.
            let into = inwards - e * inwards.dot(&e);
            let line = if line.dot(&into) < 0.0 { -line } else { line };
            gradient += line - normal * (line.dot(&e) / steep);
        }
        let direction = gradient.try_normalize(ALONG_TRIANGLE)?;
        Some(Self { nodes: [p, q, a, b, c], weights: [1.0 - share, share, wb + wc - 1.0, -wb, -wc], direction })
    }
}
