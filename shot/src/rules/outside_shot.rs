//! Times of pins, seams, paths and winds of which nothing happens within the shot.

use drapery_core::Vec3;
use drapery_core::scene::{PinTarget, SeamDescription};
use drapery_core::settings::{SettingValue, short};

use super::{Facts, Finding};

pub(super) fn find(facts: &Facts<'_>) -> Vec<Finding> {
    let shot = Shot::of(facts);
    let scene = facts.scene;
    let mut findings = Vec::new();
    for (number, pin) in scene.pins.iter().enumerate() {
        let Some(garment) = scene.garments.get(pin.garment) else { continue };
        let object = format!("garment \"{}\", pin {number}", garment.name);
        if pin.from > shot.end {
            findings.push(shot.finding(&object, "from", pin.from, "it never holds"));
        } else if pin.until <= shot.start {
            findings.push(shot.finding(&object, "until", pin.until, "it never holds"));
        } else if pin.until > shot.end && pin.until.is_finite() {
            findings.push(shot.finding(&object, "until", pin.until, "it is never released"));
        }
        if let PinTarget::Path { offsets, .. } = &pin.target {
            findings.extend(shot.keys(&object, "path", offsets.iter().map(|(time, _)| *time)));
        }
    }
    for (number, seam) in scene.seams.iter().enumerate() {
        findings.extend(shot.seam(&format!("seam {number}"), seam));
    }
    for body in &scene.bodies {
        let (object, motion) = (format!("body \"{}\"", body.name), &body.motion);
        findings.extend(shot.keys(&object, "path", motion.path.iter().map(|(time, _)| *time)));
        if motion.angular_velocity != Vec3::zeros() && motion.spin_start > shot.end {
            findings.push(shot.finding(&object, "spin.from", motion.spin_start, "it never turns"));
        }
    }
    for request in &scene.effects {
        if let Some(SettingValue::Keys(keys)) = request.settings.get("keys") {
            findings.extend(shot.keys(&request.effect, "keys", keys.iter().map(|(time, _)| *time)));
        }
    }
    findings
}

/// Times of a shot.
struct Shot {
    /// Start of the simulation [s].
    start: f64,
    /// Last frame [s].
    end: f64,
    /// First and last frame.
    frames: [i64; 2],
    /// Frame rate [1/s].
    fps: f64,
}

impl Shot {
    fn of(facts: &Facts<'_>) -> Self {
        let (timeline, last) = (facts.inputs.timeline, facts.last_frame);
        Self {
            start: timeline.time(timeline.start),
            end: timeline.time(last),
            frames: [timeline.origin, last],
            fps: timeline.fps(),
        }
    }

    /// Event of a seam that never happens, or has happened before the start.
    fn seam(&self, object: &str, seam: &SeamDescription) -> Option<Finding> {
        let opened = seam.opened.map(|opened| ("opened", opened)).or(seam.opens.map(|opens| ("opens", opens)));
        if let Some((key, time)) = opened.filter(|(_, time)| *time <= self.start) {
            return Some(self.finding(object, key, time, "it is open from the start and never holds"));
        }
        if !seam.keeps_gap && seam.from > self.end {
            return Some(self.finding(object, "start", seam.from, "it never closes"));
        }
        if !seam.keeps_gap && seam.until < self.start {
            return Some(self.finding(object, "closed", seam.until, "it is closed at once"));
        }
        let opens = seam.opens.filter(|opens| *opens > self.end)?;
        Some(self.finding(object, "opens", opens, "it never opens"))
    }

    /// Keys of a motion of which none lies in the shot; one alone is a place and no motion.
    fn keys(&self, object: &str, key: &str, times: impl Iterator<Item = f64>) -> Option<Finding> {
        let times: Vec<f64> = times.collect();
        let [first, .., last] = times.as_slice() else { return None };
        let unmoved = "nothing moves in the shot";
        if *first > self.end {
            Some(self.finding(object, key, *first, unmoved))
        } else {
            (*last < self.start).then(|| self.finding(object, key, *last, unmoved))
        }
    }

    /// A time [s] that is not in the shot, and what follows.
    fn finding(&self, object: &str, key: &str, time: f64, follows: &str) -> Finding {
        let place = if time > self.end { "after the last frame" } else { "before the first simulated instant" };
        let message = format!(
            "{follows}: `{key}` is at {} s, {place}; the shot is simulated from {} to {} s. Times are seconds since the \
             first frame, {}",
            short(time),
            rounded(self.start),
            rounded(self.end),
            self.frames[0]
        );
        // Who counts in frames writes a number of the range of frames.
        let [first, last] = self.frames;
        let is_frame = time.fract() == 0.0 && (first as f64..=last as f64).contains(&time);
        let line = if is_frame {
            let seconds = rounded((time - first as f64) / self.fps);
            format!("{seconds} in `{key}` for frame {time}")
        } else {
            format!("a time from {} to {} in `{key}`, or leave it out", rounded(self.start), rounded(self.end))
        };
        Finding { object: object.to_owned(), message, line }
    }
}

fn rounded(seconds: f64) -> f64 {
    (seconds * 1e4).round() / 1e4
}
