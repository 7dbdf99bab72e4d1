//! Which frames the samples of a cache are.

/// A frame number that lies this close to a whole number is that number: programs round frame / fps differently.
const WHOLE_FRAME: f64 = 1e-3;

/// Frame numbers of samples, or sample numbers where times are not those of whole frames.
pub(super) fn frame_numbers(times: &[f64], fps: Option<f64>) -> Vec<i64> {
    let numbers: Option<Vec<i64>> = times.iter().map(|time| whole_frame(*time, fps?)).collect();
    numbers.unwrap_or_else(|| (0..times.len() as i64).collect())
}

/// The samples that are whole frames, and their numbers; all samples by their numbers where none is.
pub(super) fn whole_frames(times: &[f64], fps: f64) -> (Vec<i64>, Vec<usize>) {
    let whole = times.iter().enumerate().filter_map(|(sample, time)| Some((whole_frame(*time, fps)?, sample)));
    let (frames, samples): (Vec<i64>, Vec<usize>) = whole.unzip();
    if frames.is_empty() { ((0..times.len() as i64).collect(), (0..times.len()).collect()) } else { (frames, samples) }
}

/// The frame that a time [s] is, if it is one.
fn whole_frame(time: f64, fps: f64) -> Option<i64> {
    let frame = time * fps;
    ((frame - frame.round()).abs() < WHOLE_FRAME).then_some(frame.round() as i64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_are_whole_numbers_or_else_samples_are_counted() {
        let times = [1001.0 / 24.0, 1002.0 / 24.0];
        assert_eq!(frame_numbers(&times, Some(24.0)), [1001, 1002]);
        assert_eq!(frame_numbers(&times, None), [0, 1]);
        assert_eq!(frame_numbers(&[0.0, 0.25 / 24.0], Some(24.0)), [0, 1]);
        let shutter = [10.0, 10.25, 10.75, 11.0, 11.25].map(|frame: f64| frame / 24.0);
        assert_eq!(whole_frames(&shutter, 24.0), (vec![10, 11], vec![0, 3]));
        assert_eq!(whole_frames(&shutter[1..3], 24.0), (vec![0, 1], vec![0, 1]));
    }
}
