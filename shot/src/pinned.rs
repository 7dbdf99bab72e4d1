//! Warnings about pins before anything is simulated: their motion is prescribed, and so is the motion of bodies.

use drapery_core::simulation::{PinInBody, StrainRecord};
use drapery_core::tolerances::STRETCHED_BETWEEN_PINS;

use crate::error::ShotError;
use crate::run_record::reader::{FrameRow, StrainRow};
use crate::shot::Shot;

/// The worst of the frames in which the same is found.
struct Worst<T> {
    frame: i64,
    record: T,
    first: i64,
    count: usize,
}

impl<T> Worst<T> {
    /// Adds a record of a later frame; `is_worse` compares it with the worst one so far.
    fn add(worst: &mut Option<Self>, frame: i64, record: T, is_worse: impl Fn(&T, &T) -> bool) {
        match worst {
            None => *worst = Some(Self { frame, record, first: frame, count: 1 }),
            Some(known) => {
                known.count += 1;
                if is_worse(&record, &known.record) {
                    (known.frame, known.record) = (frame, record);
                }
            }
        }
    }

    /// Text about the worst frame with the number of frames.
    fn in_words(&self, text: &str) -> String {
        format!("{text} (worst of {} frames, from frame {} on)", self.count, self.first)
    }
}

impl Shot {
    /// Follows the pins through all frames: warnings where they tear the cloth between two neighbours, and where a body covers a
    /// pinned vertex. Reads the inputs of all frames where pins can do either. For one rank.
    ///
    /// # Errors
    /// An input breaks.
    pub fn check_pins(&self) -> Result<Vec<String>, ShotError> {
        let (mut torn, mut covered) = (None, None);
        let simulation = self.simulation();
        let [may_tear, may_be_covered] = [simulation.has_pinned_neighbours(), simulation.has_pins_near_bodies()];
        if !may_tear && !may_be_covered {
            return Ok(Vec::new());
        }
        for frame in self.about.timeline.start..=self.about.last_frame {
            let input = self.inputs.at(frame)?;
            let strained = may_tear.then(|| simulation.strain_between_pins_at(&input)).flatten();
            if let Some(record) = strained.filter(|record| record.strain > STRETCHED_BETWEEN_PINS) {
                Worst::add(&mut torn, frame, record, |a, b| a.strain > b.strain);
            }
            if may_be_covered
                && let Some(record) = simulation.pins_inside_bodies_at(&input).map_err(ShotError::Problems)?
            {
                Worst::add(&mut covered, frame, record, |a, b| a.depth > b.depth);
            }
        }
        let torn = torn.map(|worst: Worst<StrainRecord>| {
            let StrainRecord { garment, vertices, strain } = &worst.record;
            worst.in_words(&torn_between_pins(worst.frame, garment, vertices.map(u64::from), *strain))
        });
        let covered = covered.map(|worst| worst.in_words(&pins_in_body(worst.frame, &worst.record)));
        Ok(torn.into_iter().chain(covered).collect())
    }
}

/// Says that a body covers pinned vertices at a frame.
fn pins_in_body(frame: i64, PinInBody { garment, vertex, body, depth, count }: &PinInBody) -> String {
    format!(
        "garment \"{garment}\", frame {frame}: body \"{body}\" covers pinned vertices ({count}, deepest is vertex \
         {vertex} with {:.1} mm): both motions are prescribed, so the cloth between these and its free vertices \
         intersects the body; pin them to the body (`to = \"body:{body}\"`), end the pin before that frame (`until`), \
         or animate them outside the body",
        1e3 * depth
    )
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
