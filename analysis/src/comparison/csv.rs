//! The table of figures as CSV, in SI units: one line a run.

use drapery_shot::run_record::folder::RunFolder;

use super::figures::RunFigures;

const HEAD: &str = "run,state,frames_done,frames_total,seconds,median_seconds_a_frame,strain_garment,strain_p99_9,strain_limit,\
degradations,retries,distance_rms_m,distance_max_m";

/// The whole table.
pub(super) fn csv(runs: &[(String, RunFolder)], figures: &[RunFigures]) -> String {
    let quoted = |text: &str| format!("\"{}\"", text.replace('"', "\"\""));
    let optional = |value: Option<f64>| value.map_or(String::new(), |value| value.to_string());
    let line = |((name, _), run): (&(String, RunFolder), &RunFigures)| {
        let strain = run.strain.as_ref();
        [
            quoted(name),
            run.state.clone(),
            run.frames.0.to_string(),
            run.frames.1.to_string(),
            run.seconds.to_string(),
            optional(run.median),
            strain.map_or(String::new(), |(garment, ..)| quoted(garment)),
            optional(strain.map(|(_, strain, _)| *strain)),
            optional(strain.and_then(|(_, _, limit)| *limit)),
            run.degradations.to_string(),
            run.retries.to_string(),
            optional(run.distance.map(|[rms, _]| rms)),
            optional(run.distance.map(|[_, most]| most)),
        ]
        .join(",")
    };
    let lines: Vec<String> = runs.iter().zip(figures).map(line).collect();
    format!("{HEAD}\n{}\n", lines.join("\n"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_line_has_as_many_fields_as_the_head() {
        let full = RunFigures {
            median: Some(2.0),
            strain: Some(("skirt".into(), 0.1, Some(0.2))),
            distance: Some([1e-3, 2e-3]),
            ..RunFigures::default()
        };
        let runs = ["a", "b"].map(|name| (name.to_owned(), RunFolder::default()));
        let text = csv(&runs, &[RunFigures::default(), full]);
        let fields: Vec<usize> = text.lines().map(|line| line.split(',').count()).collect();
        assert_eq!(fields, [13; 3], "{text}");
    }
}
