//! Properties that the motion promises.

use drapery_assets::mannequin::Mannequin;
use drapery_assets::motion::{Channel, Motion, Pose};
use drapery_assets::skeleton::{Bone, Side, pose_bones};
use nalgebra::Point3;

const FPS: f64 = 24.0;
const FRAMES: usize = 97;
const DURATION: f64 = (FRAMES - 1) as f64 / FPS;

#[test]
fn the_first_frame_is_the_rest_pose() {
    let mannequin = Mannequin::new(0.5, DURATION, 3);
    let off = mannequin.points(0.0).iter().zip(&mannequin.rest.points).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max);
    assert!(off < 1e-12, "{off} m");
}

#[test]
fn joint_curves_have_no_kinks() {
    let motion = Motion::new(DURATION, 0);
    let h = 1e-5;
    for i in 0..4_100 {
        let time = f64::from(i) * 1e-3;
        let [before, now, after] = [time - h, time, time + h].map(|time| *motion.pose(time).angles());
        for channel in 0..Channel::COUNT {
            let curvature = (after[channel] - 2.0 * now[channel] + before[channel]) / (h * h);
            // Joints accelerate by up to 1e4 degrees/s2; a kink of 1 degree/s would show as 1e5.
            assert!(curvature.abs() < 3e4, "channel {channel} at {time} s: {curvature}");
        }
    }
}

#[test]
fn the_walk_starts_gently_and_covers_ground() {
    let motion = Motion::new(DURATION, 0);
    assert_eq!(motion.pose(0.0), Pose::REST);
    let early = motion.pose(0.5 / FPS);
    assert!(early.angles().iter().all(|angle| angle.abs() < 0.1), "{early:?}");
    let speed = (motion.root(1.5).over_floor[1] - motion.root(0.5).over_floor[1]) / 1.0;
    assert!((0.8..1.8).contains(&speed), "walks at {speed} m/s");
}

#[test]
fn feet_stay_near_the_floor_and_peak_speed_is_that_of_a_dance() {
    let mannequin = Mannequin::new(0.5, DURATION, 0);
    let frames: Vec<_> = (0..FRAMES).map(|frame| mannequin.points(frame as f64 / FPS)).collect();
    let mut peak: f64 = 0.0;
    for (i, points) in frames.iter().enumerate() {
        let lowest = points.iter().map(|p| p.y).fold(f64::INFINITY, f64::min);
        assert!((-0.02..0.02).contains(&lowest), "frame {i}: {lowest} m");
        if let Some(next) = frames.get(i + 1) {
            peak = points.iter().zip(next).map(|(a, b)| (b - a).norm() * FPS).fold(peak, f64::max);
        }
    }
    assert!((3.5..5.5).contains(&peak), "{peak} m/s");
}

#[test]
fn the_dance_raises_both_hands_over_the_head_and_crosses_the_legs_both_ways() {
    let motion = Motion::new(DURATION, 0);
    let (mut raised, mut crossed) = (false, [false; 2]);
    for frame in 0..FRAMES {
        let bones = pose_bones(&motion.pose(frame as f64 / FPS).rotations());
        let at = |bone: Bone| bones[bone.index()] * Point3::from(bone.rest_joint());
        let crown = bones[Bone::Head.index()] * Point3::new(0.0, 1.70, 0.0);
        raised |= Side::BOTH.iter().all(|side| at(Bone::Hand(*side)).y > crown.y);
        let [left, right] = Side::BOTH.map(|side| at(Bone::Foot(side)));
        if left.x < right.x {
            crossed[usize::from(left.z < right.z)] = true;
        }
    }
    assert!(raised && crossed == [true, true], "raised {raised}, crossed {crossed:?}");
}

#[test]
fn a_standing_foot_does_not_slide() {
    let motion = Motion::new(DURATION, 0);
    let joint = Bone::Foot(Side::Left).rest_joint();
    let world = |time: f64| {
        let bones = pose_bones(&motion.pose(time).rotations());
        motion.root(time).transform() * (bones[Bone::Foot(Side::Left).index()] * Point3::from(joint))
    };
    let ankle = |time: f64| world(time).coords;
    // The left foot is flat at 15 to 35 percent of its walk cycle, which starts at 0.25 s and takes 1.1 s.
    let (flat, lifting) = (0.25 + 0.15 * 1.1, 0.25 + 0.35 * 1.1);
    let slid = (ankle(lifting) - ankle(flat)).norm();
    let walked = motion.root(lifting).over_floor[1] - motion.root(flat).over_floor[1];
    assert!(slid < 0.15 * walked, "slid {slid} m of {walked} m");
}

#[test]
fn seeds_change_the_dance_only() {
    let (a, b) = (Motion::new(DURATION, 1), Motion::new(DURATION, 2));
    assert_eq!(a.pose(1.2), b.pose(1.2));
    assert_ne!(a.pose(3.0), b.pose(3.0));
}
