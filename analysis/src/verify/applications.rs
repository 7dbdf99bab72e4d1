//! Interpretation of a file by applications: the frame of theirs that shows a sample, and the meaning of a unit and
//! an axis of the file to them.
//!
//! Statements about Blender agree with the imports in the tests (`tests/oracle/test_blender.py`,
//! `tests/oracle/test_usd.py`).

use drapery_alembic::{Archive, PolyMesh};
use drapery_io::cache_frames::CacheFrames;
use drapery_io::units::LengthUnit;

/// Frame rates differ by less than this from the whole number that they are.
const WHOLE: f64 = 1e-9;

/// Returns the meaning of an Alembic file to applications: it counts time in seconds, and they look at neither unit
/// nor axis.
pub(super) fn of_archive(archive: &Archive, meshes: &[PolyMesh], prefix: &str) -> Vec<String> {
    let mut facts = Vec::new();
    let first = meshes.iter().find(|mesh| mesh.sample_count() > 1).map(|mesh| mesh.time(0));
    match (first, archive.frames_per_second_hint()) {
        (Some(time), Some(fps)) => {
            let frame = (time * fps * 1e3).round() / 1e3;
            let rate = rate(fps);
            facts.push(format!(
                "{prefix}frame {frame} is at {time:.6} s; Blender shows it at scene frame {frame} if its rate is {rate} fps"
            ));
        }
        (Some(time), None) => facts.push(format!(
            "{prefix}the first sample is at {time:.6} s; Blender shows it at scene frame {time:.6} times its frame rate"
        )),
        (None, _) => {}
    }
    let word = |key: &str| archive.metadata().get(key);
    facts.push(match (word("lengthUnit"), word("upAxis")) {
        (Some(length), Some(up)) => {
            let turned = if up == "Y" { "" } else { " and rotate by -90 degrees about X" };
            let unit = LengthUnit::ALL.into_iter().find(|unit| unit.word() == length);
            let scale = unit.map_or("the length of a unit in metres".to_owned(), |unit| unit.metres().to_string());
            format!(
                "{prefix}one unit is 1 {length}, {up} is up; applications read neither from Alembic: in Blender, import with \
                 scale {scale}{turned}"
            )
        }
        _ => format!("{prefix}the file states neither unit nor up axis; Blender assumes metres and Y up"),
    });
    facts
}

/// Returns the meaning of a stage to applications: time codes are their frames, and they read unit and axis.
pub(super) fn of_stage(stage: &CacheFrames, prefix: &str) -> String {
    let rate = stage.fps.map_or_else(String::new, |fps| format!("{} frames a second; ", rate(fps)));
    format!(
        "{prefix}{rate}in {}, which applications read from USD; Blender converts to metres with Z up, and shows each time \
         code at the frame of the same number",
        stage.input_units
    )
}

/// A frame rate, as people write it.
fn rate(fps: f64) -> String {
    if (fps - fps.round()).abs() < WHOLE * fps { format!("{}", fps.round()) } else { format!("{fps:.3}") }
}
