//! Contact of one vertex with one body and accurate friction (`docs/theory/friction.md#one-vertex-on-one-body`).
//!
//! The position correction never feeds a velocity back. The velocity of the vertex and its average velocity over the step
//! are corrected separately, each with its own normal impulse, so a vertex at rest on a body feels no friction on the
//! velocity it came with, and exactly the Coulomb bound of the load of this step on the motion of this step.
//!
//! Two velocities of the body are used: the mean over the step for the average velocity (a vertex that sticks then stays on
//! its material point also where the body turns), and the one at the end of the step for the vertex's own velocity. With
//! the end velocity for both, cloth on a turntable drifts outwards by half a step's turn, and slips from half the critical
//! centripetal acceleration on.

use crate::Vec3;
use crate::contact::bodies::recovery_speed::RecoverySpeed;
use crate::contact::bodies::{BodyContactProperties, BodyPoint};
use crate::tolerances::NO_DIRECTION;

/// Correction of a vertex by a contact.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Response {
    /// Corrected position [m].
    pub position: Vec3,
    /// Corrected velocity [m/s].
    pub velocity: Vec3,
    /// Normal component that the average velocity has after the correction [m/s]: the constraint of the second solve.
    pub normal_velocity: f64,
}

/// Velocity after an inelastic impact with Coulomb friction in impulse form: the normal component does not approach, the
/// tangential one changes by at most the friction coefficient times the change of the normal one.
pub(crate) fn coulomb(velocity: &Vec3, body_velocity: &Vec3, normal: &Vec3, friction: f64) -> Vec3 {
    let relative = velocity - body_velocity;
    let approach = relative.dot(normal);
    let tangential = relative - normal * approach;
    let stopped = -approach.min(0.0);
    let speed = tangential.norm();
    let bound = friction * stopped;
    let kept = if speed <= NO_DIRECTION || bound >= speed { 0.0 } else { 1.0 - bound / speed };
    // Without an impulse the velocity has to come back bit for bit, not by adding what was subtracted.
    if stopped == 0.0 { *velocity } else { body_velocity + normal * approach.max(0.0) + tangential * kept }
}

/// Place where a vertex comes too close to a body.
#[derive(Debug, Clone, Copy)]
pub(crate) struct SurfaceContact<'a> {
    /// The body.
    pub body: &'a BodyContactProperties,
    /// Its nearest point.
    pub at: &'a BodyPoint,
    /// Coefficient of friction of this vertex on the body.
    pub friction: f64,
}

/// Motion of a vertex in a step.
#[derive(Debug, Clone, Copy)]
pub(crate) struct VertexMotion<'a> {
    /// Position at the start [m].
    pub x_old: &'a Vec3,
    /// Position at the end [m].
    pub x: &'a Vec3,
    /// Velocity [m/s].
    pub velocity: &'a Vec3,
    /// Length of the step [s].
    pub dt: f64,
}

/// Moves a vertex that ended a step too close to a body, and corrects its velocity.
///
/// The position is corrected in the frame that the body's material carries along: what is left of the relative motion after
/// friction is the slip, and a vertex that sticks ends exactly where the body carried it.
pub(crate) fn respond(
    contact: &SurfaceContact<'_>,
    motion: &VertexMotion<'_>,
    recovery_speed: RecoverySpeed,
) -> Response {
    let SurfaceContact { body, at, friction } = *contact;
    let VertexMotion { x_old, x, velocity, dt } = *motion;
    let n = &at.normal;
    let carried = x_old + at.displacement;
    let depth = body.offset - at.phi;
    let relative = (x - carried) / dt;
    let depth_at_start = depth + dt * relative.dot(n);
    let (fraction, contact) = if depth_at_start < 0.0 {
        let fraction = depth_at_start / (depth_at_start - depth);
        (fraction, carried.lerp(x, fraction))
    } else {
        // What was too deep before this step comes out at a limited speed; what this step added is undone at once, so that
        // a vertex pulled hard against a body does not sink in.
        (0.0, carried + n * body.depenetration(depth_at_start, dt, recovery_speed))
    };
    let slip = coulomb(&relative, &Vec3::zeros(), n, friction);
    let normal_slip = slip.dot(n);
    Response {
        position: contact + (slip - n * normal_slip) * ((1.0 - fraction) * dt),
        velocity: coulomb(velocity, &at.velocity, n, friction),
        normal_velocity: normal_slip + at.displacement.dot(n) / dt,
    }
}
