//! Part of a study that its time allowed, and time that the rest would take.

use crate::page::text;
use crate::study::record::Study;

/// Room in the times that are foretold: frames of a shot do not all cost the same.
const ROOM: f64 = 1.25;

/// In words: which frames were studied and why no more, what was left out, and how to get it.
pub(super) fn words(study: &Study) -> Vec<String> {
    let mut words = Vec::new();
    let Some(&last) = study.compared.last() else { return words };
    let [first, end] = study.scene.frames;
    let missing: f64 = study.omitted.iter().map(|omission| omission.seconds).sum();
    if study.reference().is_none() && !study.omitted.is_empty() {
        words.push(format!(
            "The time limit left no room for a reference run, so no errors are known. Run the study again with --max-wall {} \
             to resume it.",
            argument(ROOM * missing)
        ));
    } else if !study.omitted.is_empty() {
        words.push(format!(
            "{} skipped because of the time limit, see below. Run the study again with --max-wall {} to resume it.",
            runs(study),
            argument(ROOM * missing)
        ));
    }
    if last < end {
        let share = (end - study.scene.start) as f64 / (last - study.scene.start).max(1) as f64;
        let done: f64 = study.samples.iter().map(|sample| sample.cost.with_overhead).sum();
        let why = match study.asked.frames {
            Some(_) => "as requested".to_owned(),
            None => format!("as many as --max-wall {} allows", argument(study.limit)),
        };
        words.push(format!(
            "Studied: {} of {first} to {end}, {why}. The figures do not cover later frames. To study all frames: \
             --frames {first}-{end} --max-wall {} --overwrite.",
            text::frames(study.scene.start + 1, last),
            argument(ROOM * (done + missing) * share)
        ));
    }
    words
}

/// Returns the number of missing runs, as the start of a sentence.
fn runs(study: &Study) -> String {
    match study.omitted.iter().filter(|omission| !omission.are_repeats).count() {
        0 => "Repeats that measure the spread of times were".to_owned(),
        1 => "One run was".to_owned(),
        some => format!("{some} runs were"),
    }
}

/// A time as `--max-wall` takes it, rounded up.
fn argument(seconds: f64) -> String {
    match seconds.max(1.0) {
        s if s < 120.0 => format!("{:.0}s", (s / 10.0).ceil() * 10.0),
        s if s <= 7200.0 => format!("{:.0}m", (s / 60.0).ceil()),
        s => format!("{:.0}h", (s / 3600.0).ceil()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::study::analysis::tests::convergent;
    use crate::study::record::Omission;

    #[test]
    fn what_is_missing_is_told_with_the_time_that_it_takes() {
        let mut study = convergent();
        study.limit = 120.0;
        study.omitted.push(Omission {
            label: "cfl 0.5".into(),
            why: "no time".into(),
            seconds: 100.0,
            are_repeats: false,
        });
        let said = words(&study);
        // A quarter more than 100 s; ten of a hundred frames were studied.
        assert!(said[0].contains("One run") && said[0].contains("--max-wall 3m"), "{said:?}");
        assert!(said[1].contains("frames 1 to 10 of 0 to 100, as many as --max-wall 2m"), "{said:?}");
        study.compared.push(100);
        study.omitted.clear();
        assert!(words(&study).is_empty());
        assert_eq!([5.0, 121.0, 7201.0].map(argument), ["10s", "3m", "3h"]);
    }
}
