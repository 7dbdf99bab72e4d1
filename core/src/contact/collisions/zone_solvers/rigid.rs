//! A zone that moves as one rigid body.

use nalgebra::{Matrix3, Quaternion, Rotation3, SVD, SymmetricEigen, UnitQuaternion};

use crate::Vec3;
use crate::contact::tolerances::{NO_INERTIA, ZONE_ROTATION};
use crate::geometry::rotation::{rotation_between, rotation_by};

/// Iterations of the 3 × 3 decompositions; they take about ten.
const DECOMPOSITION_ITERATIONS: usize = 100;

/// Roundings in the distance of a node from the centre of its zone, at the size of its coordinates.
const ROUNDINGS: f64 = 16.0;

/// Corrections of a rotation. Each leaves 1 − cos of the angle of the error, so a right angle is where they end.
const ROTATION_CORRECTIONS: usize = 100;

/// A node of a rigid zone.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct ZoneNode {
    /// Position in the collision-free state [m].
    pub start: Vec3,
    /// Position now [m].
    pub end: Vec3,
    /// Inverse mass per axis [1/kg]; zero in directions that are prescribed, equal in the others.
    pub mobility: Vec3,
}

impl ZoneNode {
    /// Puts the end at a position, along the axes that are not prescribed; returns the largest distance along the others [m].
    pub(super) fn move_to(&mut self, position: &Vec3) -> f64 {
        let mut distance = 0.0_f64;
        for axis in 0..3 {
            if self.mobility[axis] > 0.0 {
                self.end[axis] = position[axis];
            } else {
                distance = distance.max((self.end[axis] - position[axis]).abs());
            }
        }
        distance
    }
}

/// The motion of a rigid zone as a field over its collision-free positions, linear in the turn: not the chords end − start
/// of the turned positions, but the part of the zone's average motion that a rigid body can have, which keeps momentum
/// without adding energy.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct RigidMotion {
    /// The point that the zone turns about, in the collision-free state [m].
    pub centre: Vec3,
    /// Displacement of the centre [m].
    pub displacement: Vec3,
    /// Axis of the turn times its angle [rad].
    pub turn: Vec3,
}

/// Replaces the ends of all nodes by the rigid motion of their starts that has the same linear and angular momentum
/// over a collision step (`docs/theory/self_contact.md#impact-zones`), and returns that motion.
///
/// Angular momentum times the length of the step is Σ m start × (end − start); the turned positions keep it exactly up to
/// turns of somewhat less than a right angle, where no rotation has more of it; beyond, the turn is the angular velocity
/// times the length of the step.
/// Nodes that cannot move keep their ends and lead: one carries the others, which turn about it; several give the
/// zone the rigid motion nearest to theirs (those on a line leave the turn about the line to the others). Nodes
/// with some directions prescribed are moved like free ones, except along these. Inertia has no inverse where the
/// nodes lie on a line: there is no turn about it then.
pub(crate) fn rigid(nodes: &mut [ZoneNode]) -> RigidMotion {
    let Some(turned) = Turned::of(nodes) else {
        return RigidMotion { centre: Vec3::zeros(), displacement: Vec3::zeros(), turn: Vec3::zeros() };
    };
    let Turned { frame, spin, displacement } = turned;
    for node in nodes.iter_mut() {
        let arm = frame.rotation * (node.start - frame.centre);
        node.move_to(&(frame.centre_end + arm + displacement * arm));
    }
    // The turn that prescribed nodes impose is a finite one, the angular momentum of the others was taken after it.
    let spin = frame.rotation.inverse() * spin + frame.rotation.scaled_axis();
    RigidMotion { centre: frame.centre, displacement: frame.centre_end - frame.centre, turn: spin }
}

/// The rigid motion of a zone: the turn that prescribed nodes impose, then the one by the momentum of the others.
pub(super) struct Turned {
    pub(super) frame: Frame,
    /// Axis of the second turn times its angle to first order [rad].
    spin: Vec3,
    /// The second turn, less the identity.
    displacement: Matrix3<f64>,
}

impl Turned {
    /// `None` for no nodes at all.
    pub(super) fn of(nodes: &[ZoneNode]) -> Option<Self> {
        let frame = Frame::of(nodes)?;
        let (second_moment, momentum) = frame.moments(nodes);
        let inertia = Matrix3::identity() * second_moment.trace() - second_moment;
        let none = rounding(nodes) * nodes.iter().map(mass).sum::<f64>();
        let inverse = pseudo_inverse(&(frame.free_axes * inertia * frame.free_axes), none);
        let spin = inverse * momentum;
        let rotation = turn_with_momentum(&second_moment, &inverse, &(frame.free_axes * momentum), &spin);
        Some(Self { frame, spin, displacement: displacement_of(&rotation) })
    }

    /// Both turns.
    pub(super) fn rotation(&self) -> Matrix3<f64> {
        (Matrix3::identity() + self.displacement) * self.frame.rotation.to_rotation_matrix().matrix()
    }
}

/// Part of the motion that is known before the angular momentum of the free nodes is looked at.
pub(super) struct Frame {
    /// Place that the zone turns about, at the start and now [m].
    pub(super) centre: Vec3,
    pub(super) centre_end: Vec3,
    /// Turn imposed by prescribed nodes.
    rotation: UnitQuaternion<f64>,
    /// Projector on the axes, after that turn, that the zone may still turn about.
    free_axes: Matrix3<f64>,
}

impl Frame {
    /// `None` for no nodes at all.
    fn of(nodes: &[ZoneNode]) -> Option<Self> {
        let prescribed = || nodes.iter().filter(|node| mass(node) == 0.0).map(|node| (1.0, node));
        if let Some((centre, centre_end)) = mean(prescribed()) {
            let none = rounding(nodes) * prescribed().count() as f64;
            let (rotation, free_axes) = imposed_turn(prescribed().map(|(_, node)| node), &centre, &centre_end, none);
            return Some(Self { centre, centre_end, rotation, free_axes });
        }
        let (centre, centre_end) = mean(nodes.iter().map(|node| (mass(node), node)))?;
        Some(Self { centre, centre_end, rotation: UnitQuaternion::identity(), free_axes: Matrix3::identity() })
    }

    /// Second moment Σ m r rᵀ [kg m²] of the free nodes after the imposed turn, and Σ m r × end about the centre:
    /// their angular momentum times the length of the step [kg m²].
    fn moments(&self, nodes: &[ZoneNode]) -> (Matrix3<f64>, Vec3) {
        let mut second_moment = Matrix3::zeros();
        let mut momentum = Vec3::zeros();
        for node in nodes {
            let arm = self.rotation * (node.start - self.centre);
            second_moment += arm * arm.transpose() * mass(node);
            momentum += arm.cross(&(node.end - self.centre_end - arm)) * mass(node);
        }
        (second_moment, momentum)
    }
}

/// Mass of a node [kg]; zero stands for one that is prescribed in all directions.
pub(super) fn mass(node: &ZoneNode) -> f64 {
    let mobility = node.mobility.max();
    if mobility > 0.0 { 1.0 / mobility } else { 0.0 }
}

/// Square of a length that may be rounding of the starts [m²].
fn rounding(nodes: &[ZoneNode]) -> f64 {
    let farthest = nodes.iter().map(|node| node.start.amax()).fold(0.0, f64::max);
    (ROUNDINGS * f64::EPSILON * farthest).powi(2).max(f64::MIN_POSITIVE)
}

/// Weighted means of the starts and of the ends.
fn mean<'a>(nodes: impl Iterator<Item = (f64, &'a ZoneNode)>) -> Option<(Vec3, Vec3)> {
    let (mut sum, mut start, mut end) = (0.0, Vec3::zeros(), Vec3::zeros());
    for (weight, node) in nodes {
        sum += weight;
        start += node.start * weight;
        end += node.end * weight;
    }
    (sum > 0.0).then(|| (start / sum, end / sum))
}

/// Σ r rᵀ and Σ r' rᵀ [m²] of nodes whose starts and ends are at r and r' from these centres.
pub(super) fn spread_and_covariance<'a>(
    nodes: impl Iterator<Item = &'a ZoneNode>,
    centre: &Vec3,
    centre_end: &Vec3,
) -> (Matrix3<f64>, Matrix3<f64>) {
    let (mut spread, mut covariance) = (Matrix3::zeros(), Matrix3::zeros());
    for node in nodes {
        let arm = node.start - centre;
        spread += arm * arm.transpose();
        covariance += (node.end - centre_end) * arm.transpose();
    }
    (spread, covariance)
}

/// The rotation that carries the starts of prescribed nodes nearest to their ends in the sum of squares (W. Kabsch,
/// Acta Crystallographica A32, 1976), and the projector on the axes about which they leave the zone free to turn.
fn imposed_turn<'a>(
    nodes: impl Iterator<Item = &'a ZoneNode>,
    centre: &Vec3,
    centre_end: &Vec3,
    none: f64,
) -> (UnitQuaternion<f64>, Matrix3<f64>) {
    let (spread, covariance) = spread_and_covariance(nodes, centre, centre_end);
    let (sizes, axes) = eigen(&spread);
    if sizes[2] <= none {
        return (UnitQuaternion::identity(), Matrix3::identity());
    }
    if sizes[1] > NO_INERTIA * sizes[2] {
        return (nearest_rotation(&covariance), Matrix3::zeros());
    }
    let line: Vec3 = axes.column(2).into();
    let line_end = (covariance * line).try_normalize(0.0).unwrap_or(line);
    (rotation_between(&line, &line_end), line_end * line_end.transpose())
}

/// Eigenvalues in ascending order, and their eigenvectors as columns, right-handed; zeros and the axes for a matrix
/// that is not finite.
fn eigen(symmetric: &Matrix3<f64>) -> (Vec3, Matrix3<f64>) {
    let Some(found) = SymmetricEigen::try_new(*symmetric, f64::EPSILON, DECOMPOSITION_ITERATIONS) else {
        return (Vec3::zeros(), Matrix3::identity());
    };
    let mut order = [0, 1, 2];
    order.sort_by(|&i, &j| found.eigenvalues[i].total_cmp(&found.eigenvalues[j]));
    let [first, second, _] = order.map(|i| found.eigenvectors.column(i).into_owned());
    // Right-handed, so that turns can be written in them.
    let axes = Matrix3::from_columns(&[first, second, first.cross(&second)]);
    (Vec3::from(order.map(|i| found.eigenvalues[i])), axes)
}

/// Inverse on the axes that have inertia, more than `none` and than their share; zero on the others.
fn pseudo_inverse(inertia: &Matrix3<f64>, none: f64) -> Matrix3<f64> {
    let (moments, axes) = eigen(inertia);
    let mut inverse = Matrix3::zeros();
    for (moment, axis) in moments.iter().zip(axes.column_iter()) {
        if *moment > none.max(NO_INERTIA * moments[2]) {
            inverse += axis * axis.transpose() / *moment;
        }
    }
    inverse
}

/// The rotation R that maximises tr(Rᵀ covariance).
fn nearest_rotation(covariance: &Matrix3<f64>) -> UnitQuaternion<f64> {
    let found = SVD::try_new(*covariance, true, true, f64::EPSILON, DECOMPOSITION_ITERATIONS);
    let Some((u, v_t)) = found.and_then(|svd| Some((svd.u?, svd.v_t?))) else {
        return UnitQuaternion::identity();
    };
    // A mirror image may fit better than any rotation; the least of the singular values, which come in descending
    // order, then counts against it.
    let handed = Vec3::new(1.0, 1.0, (u * v_t).determinant().signum());
    UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(u * Matrix3::from_diagonal(&handed) * v_t))
}

/// R − 1, to full relative precision also for small turns.
fn displacement_of(rotation: &UnitQuaternion<f64>) -> Matrix3<f64> {
    let cross = rotation.imag().cross_matrix();
    (cross * rotation.w + cross * cross) * 2.0
}

/// The rotation R with Σ m r × R r = `momentum` where there is one near the first guess `spin`, otherwise the turn
/// by `spin`.
///
/// To first order in the angle the sum is inertia · `spin`; what the sine leaves out is put in by corrections with
/// the same `inverse` of the inertia.
fn turn_with_momentum(
    second_moment: &Matrix3<f64>,
    inverse: &Matrix3<f64>,
    momentum: &Vec3,
    spin: &Vec3,
) -> UnitQuaternion<f64> {
    // In the frame of the axes of inertia the moments of a long thin zone do not drown one another.
    let (moments, axes) = eigen(second_moment);
    let spread = Matrix3::from_diagonal(&moments);
    let inverse = axes.transpose() * inverse * axes;
    let momentum = axes.transpose() * momentum;
    let mut rotation = rotation_by(&(axes.transpose() * spin));
    for _ in 0..ROTATION_CORRECTIONS {
        let sum = displacement_of(&rotation) * spread;
        let reached = Vec3::new(sum[(2, 1)] - sum[(1, 2)], sum[(0, 2)] - sum[(2, 0)], sum[(1, 0)] - sum[(0, 1)]);
        let correction = inverse * (momentum - reached);
        if correction.norm() <= ZONE_ROTATION * spin.norm() {
            let imaginary = axes * rotation.imag();
            return UnitQuaternion::new_unchecked(Quaternion::from_parts(rotation.w, imaginary));
        }
        rotation = UnitQuaternion::new_normalize((rotation_by(&correction) * rotation).into_inner());
    }
    rotation_by(spin)
}
