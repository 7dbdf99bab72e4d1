//! What pins ask of the cloth between them, known before anything is simulated: they are prescribed.

use drapery_core::simulation::StrainRecord;
use drapery_core::tolerances::STRETCHED_BETWEEN_PINS;

use crate::error::ShotError;
use crate::run_record::reader::{FrameRow, StrainRow};
use crate::shot::Shot;

impl Shot {
    /// Follows the pins through all frames, and says where they tear the cloth between two of them most; `None` where they do
    /// nowhere. Reads the inputs of all frames where two neighbours are pinned. For one rank.
    ///
    /// # Errors
    /// An input breaks.
    pub fn check_pins(&self) -> Result<Option<String>, ShotError> {
        let timeline = self.about.timeline;
        let (mut worst, mut torn): (Option<(i64, StrainRecord)>, Vec<i64>) = (None, Vec::new());
        if !self.simulation().has_pinned_neighbours() {
            return Ok(None);
        }
        for frame in timeline.start..=self.about.last_frame {
            let Some(record) = self.simulation().strain_between_pins_at(&self.inputs.at(frame)?) else { continue };
            if record.strain > STRETCHED_BETWEEN_PINS {
                torn.push(frame);
                if worst.as_ref().is_none_or(|(_, known)| record.strain > known.strain) {
                    worst = Some((frame, record));
                }
            }
        }
        Ok(worst.map(|(frame, record)| {
            let text = torn_between_pins(frame, &record.garment, record.vertices.map(u64::from), record.strain);
            let (first, count) = (torn[0], torn.len());
            format!("{text} (worst of {count} frames, from frame {first} on)")
        }))
    }
}

/// Growth of the strain between pins since it was reported last that is worth reporting again.
pub(crate) const MUCH_WORSE: f64 = 1.5;

/// Says of a frame of a run where pins tear the cloth between them apart: for the first time, and where it has become much worse
/// than was `reported`.
pub(super) fn news(reported: &mut f64, frame: &FrameRow) -> Option<String> {
    let StrainRow { garment, vertices, strain } = frame.strain_between_pins.as_ref()?;
    let &[a, b] = vertices.as_slice() else { return None };
    let is_news = *strain > STRETCHED_BETWEEN_PINS.max(MUCH_WORSE * *reported);
    is_news.then(|| {
        *reported = *strain;
        torn_between_pins(frame.frame, garment, [a, b], *strain)
    })
}

/// Says how far pins tear the cloth between two vertices apart at a frame.
fn torn_between_pins(frame: i64, garment: &str, [a, b]: [u64; 2], strain: f64) -> String {
    format!(
        "garment \"{garment}\", frame {frame}: vertices {a} and {b} are neighbours, and pins pull them to {:.2} times their distance \
         at rest (strain {strain:.2}): cloth cannot follow; bind them to places that move together, or leave one of them out of \
         the pin",
        1.0 + strain
    )
}
