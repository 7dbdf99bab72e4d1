//! Frame rates of files beside that of the shot.

use drapery_io::mesh_source::FrameRate;

/// Rates that differ by less than this share are one: 24000/1001 in a few digits is, 24 is not.
const SAME: f64 = 2e-4;

/// The frame rate of a file where it is not the rate of the shot: the source of the rate, and the line to write.
pub(crate) fn other_rate(rate: Option<FrameRate>, fps: f64) -> Option<(String, String)> {
    let (rate, how) = match rate? {
        FrameRate::Stated(rate) if is_same(rate / fps, 1.0) => return None,
        FrameRate::Stated(rate) => (rate, "the file states"),
        // Several samples to a frame, or one to several frames.
        FrameRate::Sampled(rate) if is_whole(rate / fps) || is_whole(fps / rate) => return None,
        FrameRate::Sampled(rate) => (rate, "the samples of the file are at"),
    };
    Some((format!("{how} {}", shown(rate)), format!("fps = \"{}\" in [shot]", shown(rate))))
}

fn is_same(a: f64, b: f64) -> bool {
    (a - b).abs() <= SAME * b
}

fn is_whole(ratio: f64) -> bool {
    ratio.round() >= 1.0 && is_same(ratio, ratio.round())
}

/// A rate as a scene writes it.
pub(crate) fn shown(rate: f64) -> String {
    let whole = rate.round();
    let ntsc = (rate * 1.001).round();
    if is_same(rate, whole) && whole > 0.0 {
        whole.to_string()
    } else if is_same(rate, ntsc / 1.001) && ntsc > 0.0 {
        format!("{}/1001", ntsc * 1e3)
    } else {
        ((rate * 1e3).round() / 1e3).to_string()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rates_are_shown_as_a_scene_writes_them() {
        let shown: Vec<String> = [24.0, 24_000.0 / 1001.0, 23.976, 59.94, 12.5].map(shown).into();
        assert_eq!(shown, ["24", "24000/1001", "24000/1001", "60000/1001", "12.5"]);
        assert!(!is_same(24_000.0 / 1001.0, 24.0) && is_whole(48.0 / 24.0) && !is_whole(25.0 / 24.0) && !is_whole(0.4));
    }
}
