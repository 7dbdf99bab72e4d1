//! Positions of moving inputs for each frame: the file's samples from the shot's first frame on, and the pre-roll
//! that is made up before it.
//!
//! Pre-roll: over the first `settle` frames the input keeps its rest pose while the cloth comes to rest on it; over the
//! next `blend` frames every point moves on a straight line from the rest pose to the pose of the first frame, starting
//! and ending without a jerk.

use drapery_core::Vec3;
use drapery_core::scene::Timeline;
use drapery_core::simulation::Sample;

use crate::error::IoError;
use crate::mesh_source::MeshSource;

/// Frames before the shot's first one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Preroll {
    /// Frames on the rest pose.
    pub settle: u32,
    /// Frames from the rest pose to the first pose.
    pub blend: u32,
}

impl Preroll {
    /// Number of frames.
    pub fn frames(self) -> i64 {
        i64::from(self.settle) + i64::from(self.blend)
    }

    /// Share of the first pose, `before` frames before the first frame: 0 on the rest pose, 1 on the first frame.
    fn share(self, before: i64) -> f64 {
        if before <= 0 {
            return 1.0;
        }
        let share = (1.0 - before as f64 / f64::from(self.blend.max(1))).max(0.0);
        share * share * (3.0 - 2.0 * share)
    }
}

/// A body or a pin target that moves by the samples of a file.
#[derive(Debug)]
pub struct InputMotion {
    /// Kind and name of it in the scene, for messages: `body "hero"`.
    pub label: String,
    /// Its file.
    pub source: MeshSource,
    /// Rest pose for the pre-roll [m], as many points as the file has; the first sample of the file when `None`.
    pub rest: Option<Vec<Vec3>>,
    /// Points of the file that are used, in this order; all of them when `None`.
    pub rows: Option<Vec<u32>>,
    /// Whether the scene states units for this very file, so that an unusual size is believed.
    pub own_units: bool,
    /// Whether the program makes it, as a belt, so that nobody else has its mesh.
    pub is_made: bool,
}

impl InputMotion {
    /// Samples that lead from the frame before to `frame`, in solver time: those of the file inside the frame, and one
    /// exactly at its end. For the frame at which the simulation starts, only the last is of use.
    ///
    /// # Errors
    /// The file is damaged.
    pub fn samples(&self, timeline: Timeline, preroll: Preroll, frame: i64) -> Result<Vec<Sample>, IoError> {
        let mut samples = Vec::new();
        if frame > timeline.origin {
            let (from, to) = (timeline.file_time(frame - 1), timeline.file_time(frame));
            let origin = timeline.file_time(timeline.origin);
            for &time in self.source.times_between(from, to) {
                samples.push(Sample { time: time - origin, positions: self.chosen(self.pose(time)?) });
            }
        }
        let positions = self.chosen(self.pose_at_frame(timeline, preroll, frame)?);
        samples.push(Sample { time: timeline.time(frame), positions });
        Ok(samples)
    }

    /// Pose at a frame [m]; before the shot's first frame, that of the pre-roll.
    fn pose_at_frame(&self, timeline: Timeline, preroll: Preroll, frame: i64) -> Result<Vec<Vec3>, IoError> {
        let share = preroll.share(timeline.origin - frame);
        if share == 1.0 {
            return self.pose(timeline.file_time(frame.max(timeline.origin)));
        }
        let rest = match &self.rest {
            Some(rest) => rest.clone(),
            None => self.pose(self.source.first_time())?,
        };
        if share == 0.0 {
            return Ok(rest);
        }
        let first = self.pose(timeline.file_time(timeline.origin))?;
        Ok(rest.iter().zip(&first).map(|(a, b)| a + (b - a) * share).collect())
    }

    fn chosen(&self, pose: Vec<Vec3>) -> Vec<Vec3> {
        match &self.rows {
            None => pose,
            // A row that the file does not have is reported when the number of samples does not fit.
            Some(rows) => rows.iter().filter_map(|row| pose.get(*row as usize).copied()).collect(),
        }
    }

    fn pose(&self, time: f64) -> Result<Vec<Vec3>, IoError> {
        let mut positions = Vec::new();
        self.source.positions_at(time, &mut positions)?;
        Ok(positions)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::units::Units;

    #[test]
    fn the_preroll_rests_then_blends_without_a_jerk() {
        let preroll = Preroll { settle: 10, blend: 4 };
        assert_eq!(preroll.frames(), 14);
        let shares: Vec<f64> = (0..=14).rev().map(|before| preroll.share(before)).collect();
        assert!(shares[..=10].iter().all(|s| *s == 0.0));
        // Smoothstep at quarters: 3s² - 2s³.
        assert_eq!(shares[11..], [0.15625, 0.5, 0.84375, 1.0]);
        assert_eq!(Preroll { settle: 5, blend: 0 }.share(1), 0.0);
    }

    #[test]
    fn a_rest_pose_moves_on_straight_lines_to_the_first_pose() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("body.obj");
        std::fs::write(&path, "v 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\n").unwrap();
        let motion = InputMotion {
            label: "body \"b\"".into(),
            source: MeshSource::open(&path, None, Units::SI).unwrap(),
            rest: Some(vec![Vec3::zeros(); 3]),
            rows: None,
            own_units: false,
            is_made: false,
        };
        let timeline = Timeline { origin: 1001, start: 991, ..Timeline::default() };
        let preroll = Preroll { settle: 6, blend: 4 };
        let at = |frame| motion.samples(timeline, preroll, frame).unwrap();
        assert_eq!(at(995)[0].positions[0], Vec3::zeros());
        assert_eq!(at(999)[0].positions[0], Vec3::new(0.5, 0.0, 0.0));
        assert_eq!(at(999)[0].time, -2.0 / 24.0);
        assert_eq!(at(1001)[0].positions[0], Vec3::x());
        assert_eq!(at(1002).len(), 1);
    }
}
