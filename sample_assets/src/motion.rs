//! A walk that turns into a dance: joint angles as functions of time, and the path of the pelvis that follows from
//! them.
//!
//! All curves have a continuous second derivative: periodic cubic splines, mixed by quintic weights. The height of the
//! pelvis keeps the lowest sole at the floor, and its path keeps the supporting foot in place.

use drapery_core::geometry::random::SplitMix64;
use nalgebra::{Isometry3, Point3, Translation3, Unit, UnitQuaternion};

use crate::anatomy::sole;
use crate::sdf::Vec3;
use crate::skeleton::{Bone, REST_ARM_ANGLE, Side, arm_direction, pose_bones};
use crate::splines::PeriodicSpline;

/// Joint angles in degrees; all zero is the rest pose.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose {
    angles: [f64; Channel::COUNT],
}

/// One joint angle. Paired channels are symmetric: the same value on both sides gives a symmetric pose.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Channel {
    /// Turn of the whole character about the vertical.
    Heading,
    /// Pelvis: forward tilt, turn to the left, lean to the right.
    PelvisTilt,
    /// Turn of the pelvis to the left.
    PelvisTurn,
    /// Lean of the pelvis to the right.
    PelvisLean,
    /// Spine forward, shared by abdomen and chest.
    SpineBend,
    /// Spine turn to the left, shared by abdomen and chest.
    SpineTwist,
    /// Spine lean to the right, shared by abdomen and chest.
    SpineLean,
    /// Head down.
    HeadNod,
    /// Head to the left.
    HeadTurn,
    /// Clavicle up.
    Shrug(Side),
    /// Arm away from the body, sideways and up.
    ArmRaise(Side),
    /// Arm forward.
    ArmSwing(Side),
    /// Upper arm about its own axis, palm to the front.
    ArmTwist(Side),
    /// Elbow bend.
    Elbow(Side),
    /// Thigh forward.
    Hip(Side),
    /// Thigh away from the other.
    HipSpread(Side),
    /// Knee bend.
    Knee(Side),
    /// Toes up.
    Ankle(Side),
}

impl Channel {
    /// Number of channels.
    pub const COUNT: usize = 27;

    fn index(self) -> usize {
        let paired = |pair: usize, side: Side| 9 + 2 * pair + usize::from(side == Side::Right);
        match self {
            Channel::Heading => 0,
            Channel::PelvisTilt => 1,
            Channel::PelvisTurn => 2,
            Channel::PelvisLean => 3,
            Channel::SpineBend => 4,
            Channel::SpineTwist => 5,
            Channel::SpineLean => 6,
            Channel::HeadNod => 7,
            Channel::HeadTurn => 8,
            Channel::Shrug(side) => paired(0, side),
            Channel::ArmRaise(side) => paired(1, side),
            Channel::ArmSwing(side) => paired(2, side),
            Channel::ArmTwist(side) => paired(3, side),
            Channel::Elbow(side) => paired(4, side),
            Channel::Hip(side) => paired(5, side),
            Channel::HipSpread(side) => paired(6, side),
            Channel::Knee(side) => paired(7, side),
            Channel::Ankle(side) => paired(8, side),
        }
    }
}

impl Pose {
    /// The rest pose.
    pub const REST: Pose = Pose { angles: [0.0; Channel::COUNT] };

    /// The angle of a channel \[degrees\].
    pub fn angle(&self, channel: Channel) -> f64 {
        self.angles[channel.index()]
    }

    fn set(&mut self, channel: Channel, degrees: f64) {
        self.angles[channel.index()] = degrees;
    }

    fn mix(&self, other: &Pose, weight: f64) -> Pose {
        Pose { angles: std::array::from_fn(|i| self.angles[i] + weight * (other.angles[i] - self.angles[i])) }
    }

    /// All joint angles in the order of their indices \[degrees\].
    pub fn angles(&self) -> &[f64; Channel::COUNT] {
        &self.angles
    }

    /// Rotation of every bone relative to its parent; the heading is left to the root.
    pub fn rotations(&self) -> [UnitQuaternion<f64>; Bone::COUNT] {
        let about = |axis: Unit<Vec3>, degrees: f64| UnitQuaternion::from_axis_angle(&axis, degrees.to_radians());
        let (x, y, z) = (Vec3::x_axis(), Vec3::y_axis(), Vec3::z_axis());
        let angle = |channel| self.angle(channel);
        let mut rotations = [UnitQuaternion::identity(); Bone::COUNT];
        let mut set = |bone: Bone, rotation| rotations[bone.index()] = rotation;
        let turned = |turn: f64, bend: f64, lean: f64| about(y, turn) * about(x, bend) * about(z, -lean);
        let spine = |share: f64| {
            let part = |channel| share * angle(channel);
            turned(part(Channel::SpineTwist), part(Channel::SpineBend), part(Channel::SpineLean))
        };
        set(Bone::Pelvis, turned(angle(Channel::PelvisTurn), angle(Channel::PelvisTilt), angle(Channel::PelvisLean)));
        set(Bone::Abdomen, spine(0.45));
        set(Bone::Chest, spine(0.55));
        set(Bone::Neck, turned(0.4 * angle(Channel::HeadTurn), 0.4 * angle(Channel::HeadNod), 0.0));
        set(Bone::Head, turned(0.6 * angle(Channel::HeadTurn), 0.6 * angle(Channel::HeadNod), 0.0));
        for side in Side::BOTH {
            let sign = side.sign();
            let along = Unit::new_normalize(arm_direction(side));
            let elbow = Unit::new_normalize(along.cross(&Vec3::z()));
            let twist = about(along, -sign * angle(Channel::ArmTwist(side)));
            let raise = about(z, sign * angle(Channel::ArmRaise(side)));
            set(Bone::Clavicle(side), about(z, sign * angle(Channel::Shrug(side))));
            set(Bone::UpperArm(side), about(x, -angle(Channel::ArmSwing(side))) * raise * twist);
            set(Bone::Forearm(side), about(elbow, angle(Channel::Elbow(side))));
            let spread = about(z, sign * angle(Channel::HipSpread(side)));
            set(Bone::Thigh(side), spread * about(x, -angle(Channel::Hip(side))));
            set(Bone::Shin(side), about(x, angle(Channel::Knee(side))));
            set(Bone::Foot(side), about(x, -angle(Channel::Ankle(side))));
        }
        rotations
    }
}

/// Placement of the character: the path of the pelvis over the floor, its height change and its heading.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Root {
    /// Displacement over the floor since the rest pose, x and z \[m\].
    pub over_floor: [f64; 2],
    /// Height of the pelvis joint over its rest height \[m\].
    pub rise: f64,
    /// Turn to the left about the vertical through the pelvis \[radians\].
    pub heading: f64,
}

impl Root {
    /// The motion of the body's root in the world.
    pub fn transform(&self) -> Isometry3<f64> {
        let at = Translation3::new(self.over_floor[0], self.rise, self.over_floor[1]);
        at * UnitQuaternion::from_axis_angle(&Vec3::y_axis(), self.heading)
    }
}

/// Seconds in which the rest pose turns into the walk.
const EASE_IN: f64 = 0.5;
/// The walk turns into the dance between these times \[s\].
const TO_DANCE: [f64; 2] = [1.5, 2.4];
/// Turn of the character during the walk \[degrees\]; the dance goes on from there.
const WALK_TURN: f64 = 14.0;
/// One walk cycle, two steps \[s\].
const WALK_PERIOD: f64 = 1.1;
/// One round of the dance \[s\].
const DANCE_PERIOD: f64 = 2.8;
/// Samples of the root path per second.
const PATH_RATE: f64 = 240.0;
/// Half width of the window that smooths the root's velocity \[s\]: it hides the change of the supporting foot.
const PATH_WINDOW: f64 = 0.07;
/// Height difference at which a sole point stops to support \[m\].
const SUPPORT_HEIGHT: f64 = 0.004;

/// The whole motion: joint curves, and the sampled path of the root from 0 to its duration.
#[derive(Debug, Clone)]
pub struct Motion {
    walk: Vec<(Channel, PeriodicSpline)>,
    dance: Vec<(Channel, PeriodicSpline)>,
    path: Vec<Root>,
}

impl Motion {
    /// The motion from 0 to `duration` \[s\]. Each `seed` dances with other amplitudes (within 8 percent).
    pub fn new(duration: f64, seed: u64) -> Motion {
        let mut random = SplitMix64::new(seed);
        let walk = walk_curves();
        let dance = DANCE
            .iter()
            .map(|(channel, degrees)| {
                let gain = if seed == 0 { 1.0 } else { 1.0 + 0.08 * (2.0 * random.unit() - 1.0) };
                (*channel, PeriodicSpline::through(&degrees.map(|angle| gain * angle)))
            })
            .collect();
        let mut motion = Motion { walk, dance, path: Vec::new() };
        motion.path = motion.sample_path(duration.max(0.0));
        motion
    }

    /// Joint angles at `time` \[s\]; before 0 the rest pose.
    pub fn pose(&self, time: f64) -> Pose {
        let ease = quintic(time / EASE_IN);
        if ease == 0.0 {
            return Pose::REST;
        }
        let mut walk = Pose::REST;
        // The phase starts at a double support and gathers speed with the ease.
        for (channel, curve) in &self.walk {
            walk.set(*channel, curve.value((time - 0.5 * EASE_IN) / WALK_PERIOD));
        }
        let to_dance = quintic((time - TO_DANCE[0]) / (TO_DANCE[1] - TO_DANCE[0]));
        let mut pose = Pose::REST.mix(&walk, ease);
        pose.set(Channel::Heading, WALK_TURN * quintic(time / TO_DANCE[0]));
        if to_dance > 0.0 {
            let mut dance = Pose::REST;
            for (channel, curve) in &self.dance {
                dance.set(*channel, curve.value((time - TO_DANCE[0]) / DANCE_PERIOD));
            }
            pose = pose.mix(&dance, to_dance);
        }
        pose
    }

    /// Place of the root at `time` \[s\], held outside the sampled duration.
    pub fn root(&self, time: f64) -> Root {
        let at = (time * PATH_RATE).clamp(0.0, (self.path.len() - 1) as f64);
        let i = (at as usize).min(self.path.len().saturating_sub(2));
        let (a, b) = (self.path[i], self.path[(i + 1).min(self.path.len() - 1)]);
        let mix = |a: f64, b: f64| a + (at - i as f64) * (b - a);
        Root {
            over_floor: [mix(a.over_floor[0], b.over_floor[0]), mix(a.over_floor[1], b.over_floor[1])],
            rise: mix(a.rise, b.rise),
            heading: mix(a.heading, b.heading),
        }
    }

    fn sample_path(&self, duration: f64) -> Vec<Root> {
        let count = (duration * PATH_RATE).ceil() as usize + 2;
        let half = (PATH_WINDOW * PATH_RATE).round() as usize;
        let rest_height = soft_lowest(&self.sole_points(-1.0));
        let samples: Vec<[f64; 3]> = (0..count + 2 * half)
            .map(|i| self.root_velocity_and_rise((i as f64 - half as f64) / PATH_RATE, rest_height))
            .collect();
        let weights: Vec<f64> = (0..=2 * half)
            .map(|i| (std::f64::consts::PI * (i + 1) as f64 / (2 * half + 2) as f64).sin().powi(2))
            .collect();
        let total: f64 = weights.iter().sum();
        let smooth = |i: usize, part: usize| -> f64 {
            weights.iter().zip(&samples[i..]).map(|(w, sample)| w * sample[part]).sum::<f64>() / total
        };
        let start_rise = smooth(0, 2);
        let mut over_floor = [0.0; 2];
        (0..count)
            .map(|i| {
                let time = i as f64 / PATH_RATE;
                let heading = self.pose(time).angle(Channel::Heading).to_radians();
                let root = Root { over_floor, rise: smooth(i, 2) - start_rise, heading };
                over_floor = [0, 1].map(|axis| over_floor[axis] + smooth(i, axis) / PATH_RATE);
                root
            })
            .collect()
    }

    /// Horizontal velocity \[m/s\] that keeps the supporting points in place, and rise \[m\] that keeps them at the
    /// floor.
    fn root_velocity_and_rise(&self, time: f64, rest_height: f64) -> [f64; 3] {
        let step = 0.5 / PATH_RATE;
        let (before, now, after) =
            (self.sole_points(time - step), self.sole_points(time), self.sole_points(time + step));
        let lowest = now.iter().map(|p| p.y).fold(f64::INFINITY, f64::min);
        let weights = now.map(|p| ((lowest - p.y) / SUPPORT_HEIGHT).exp());
        let total: f64 = weights.iter().sum();
        let mut velocity = Vec3::zeros();
        for i in 0..now.len() {
            velocity -= (after[i] - before[i]) * (weights[i] / (total * 2.0 * step));
        }
        [velocity.x, velocity.z, rest_height - soft_lowest(&now)]
    }

    /// Lowest points of the sole spheres with the root turned but not moved \[m\].
    fn sole_points(&self, time: f64) -> [Vec3; 6] {
        let pose = self.pose(time);
        let posed = pose_bones(&pose.rotations());
        let turn = UnitQuaternion::from_axis_angle(&Vec3::y_axis(), pose.angle(Channel::Heading).to_radians());
        std::array::from_fn(|i| {
            let side = Side::BOTH[i / 3];
            let (center, radius) = sole(side)[i % 3];
            turn * (posed[Bone::Foot(side).index()] * Point3::from(center)).coords - Vec3::y() * radius
        })
    }
}

/// Smooth minimum of the heights: the minimum or at most SUPPORT_HEIGHT ln 6, 7 mm, below it.
fn soft_lowest(points: &[Vec3; 6]) -> f64 {
    let lowest = points.iter().map(|p| p.y).fold(f64::INFINITY, f64::min);
    let sum: f64 = points.iter().map(|p| ((lowest - p.y) / SUPPORT_HEIGHT).exp()).sum();
    lowest - SUPPORT_HEIGHT * sum.ln()
}

/// 0 before 0, 1 after 1, with continuous second derivative.
fn quintic(t: f64) -> f64 {
    let t = t.clamp(0.0, 1.0);
    t * t * t * (t * (6.0 * t - 15.0) + 10.0)
}

/// A channel of either leg, and its angle \[degrees\] at every tenth of a cycle from heel strike.
type LegCurve = (fn(Side) -> Channel, [f64; 10]);

/// Joint angles of level walking in the sagittal plane, rounded from textbook gait curves.
const WALK_LEG: [LegCurve; 3] = [
    (Channel::Hip, [27.0, 23.0, 14.0, 4.0, -6.0, -11.0, -3.0, 14.0, 26.0, 29.0]),
    (Channel::Knee, [4.0, 15.0, 14.0, 7.0, 5.0, 12.0, 36.0, 56.0, 46.0, 15.0]),
    (Channel::Ankle, [1.0, -4.0, 3.0, 7.0, 10.0, 6.0, -14.0, -6.0, 0.0, 1.0]),
];

fn walk_curves() -> Vec<(Channel, PeriodicSpline)> {
    let wave = |mean: f64, amplitude: f64, harmonic: f64, phase: f64| {
        let turn = 2.0 * std::f64::consts::PI;
        PeriodicSpline::through(&std::array::from_fn::<f64, 20, _>(|i| {
            mean + amplitude * (turn * (harmonic * i as f64 / 20.0 + phase)).cos()
        }))
    };
    let mut curves = vec![
        (Channel::PelvisTurn, wave(0.0, -5.0, 1.0, 0.0)),
        (Channel::PelvisLean, wave(0.0, 3.0, 1.0, -0.30)),
        (Channel::PelvisTilt, wave(3.0, 1.0, 2.0, 0.0)),
        (Channel::SpineTwist, wave(0.0, 12.0, 1.0, 0.0)),
        (Channel::SpineLean, wave(0.0, -3.0, 1.0, -0.30)),
        (Channel::HeadTurn, wave(0.0, -6.0, 1.0, 0.0)),
    ];
    for side in Side::BOTH {
        let shift = if side == Side::Left { 0.0 } else { 0.5 };
        let shifted = |degrees: &[f64; 10]| {
            PeriodicSpline::through(&std::array::from_fn::<f64, 10, _>(|i| degrees[(i + (10.0 * shift) as usize) % 10]))
        };
        curves.extend(WALK_LEG.iter().map(|(channel, degrees)| (channel(side), shifted(degrees))));
        curves.push((Channel::HipSpread(side), wave(0.5, 0.0, 1.0, 0.0)));
        curves.push((Channel::ArmSwing(side), wave(2.0, -24.0, 1.0, shift)));
        curves.push((Channel::ArmRaise(side), wave(17.0 - REST_ARM_ANGLE, 0.0, 1.0, 0.0)));
        curves.push((Channel::Elbow(side), wave(24.0, -10.0, 1.0, shift)));
    }
    curves
}

use Channel::{
    Ankle, ArmRaise, ArmSwing, ArmTwist, Elbow, HeadNod, HeadTurn, Heading, Hip, HipSpread, Knee, PelvisLean,
    PelvisTilt, PelvisTurn, Shrug, SpineBend, SpineLean, SpineTwist,
};
use Side::{Left, Right};

/// The dance, in degrees at every eighth of a round: both arms rise over the head while the left leg crosses in front,
/// open with a twist, and rise again one after the other while the right leg crosses.
#[rustfmt::skip]
const DANCE: [(Channel, [f64; 8]); 27] = [
    (Heading,         [ 14.0,   4.0, -10.0, -22.0, -16.0,   0.0,  18.0,  24.0]),
    (PelvisTilt,      [  2.0,   0.0,  -2.0,   4.0,   4.0,   0.0,  -2.0,   4.0]),
    (PelvisTurn,      [  0.0,   8.0,  12.0,   0.0, -10.0, -14.0,  -4.0,   4.0]),
    (PelvisLean,      [  0.0,   7.0,   3.0,  -7.0,  -3.0,   7.0,   3.0,  -7.0]),
    (SpineBend,       [  0.0,  -4.0,  -8.0,   6.0,   8.0,  -4.0,  -8.0,   6.0]),
    (SpineTwist,      [  0.0, -16.0, -22.0,  18.0,  34.0,  20.0, -12.0, -26.0]),
    (SpineLean,       [  0.0,  -9.0,  -4.0,  10.0,   5.0, -10.0,  -6.0,  10.0]),
    (HeadNod,         [  0.0,  -6.0, -12.0,   6.0,   8.0,  -4.0, -10.0,   4.0]),
    (HeadTurn,        [  0.0,  10.0,  14.0, -12.0, -24.0, -10.0,  10.0,  16.0]),
    (Shrug(Left),     [  0.0,  10.0,  16.0,   8.0,   2.0,   6.0,  16.0,   8.0]),
    (Shrug(Right),    [  0.0,  10.0,  16.0,   8.0,   6.0,  16.0,  10.0,   2.0]),
    (ArmRaise(Left),  [ 14.0,  62.0, 114.0,  88.0,  18.0,  30.0,  96.0,  66.0]),
    (ArmRaise(Right), [ 14.0,  62.0, 114.0,  88.0,  60.0, 106.0,  70.0,  10.0]),
    (ArmSwing(Left),  [ 14.0,  10.0,   4.0,   6.0,  18.0,  14.0,   4.0,   8.0]),
    (ArmSwing(Right), [ 14.0,  10.0,   4.0,   6.0,   2.0,   4.0,  10.0,  18.0]),
    (ArmTwist(Left),  [  0.0,  20.0,  45.0,  20.0,   0.0,  10.0,  45.0,  20.0]),
    (ArmTwist(Right), [  0.0,  20.0,  45.0,  20.0,  10.0,  45.0,  25.0,   0.0]),
    (Elbow(Left),     [ 30.0,  28.0,  34.0,  22.0,  44.0,  36.0,  30.0,  24.0]),
    (Elbow(Right),    [ 30.0,  28.0,  34.0,  22.0,  20.0,  30.0,  28.0,  46.0]),
    (Hip(Left),       [ 12.0,  38.0,  27.0,   6.0,   4.0,   0.0,  -6.0,   4.0]),
    (Hip(Right),      [  4.0,   0.0,  -6.0,   4.0,  14.0,  38.0,  27.0,   6.0]),
    (HipSpread(Left), [ -2.0, -14.0, -22.0,  -2.0,   6.0,   4.0,  -5.0,   2.0]),
    (HipSpread(Right),[  6.0,   4.0,  -5.0,   2.0,  -2.0, -14.0, -22.0,  -2.0]),
    (Knee(Left),      [ 22.0,  60.0,  32.0,  14.0,  18.0,  12.0,  14.0,  16.0]),
    (Knee(Right),     [ 18.0,  12.0,  14.0,  16.0,  22.0,  60.0,  32.0,  14.0]),
    (Ankle(Left),     [  6.0,   0.0,  -8.0,   6.0,  10.0,   8.0,   8.0,   8.0]),
    (Ankle(Right),    [ 10.0,   8.0,   8.0,   8.0,   6.0,   0.0,  -8.0,   6.0]),
];
