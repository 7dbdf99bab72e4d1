//! The table of figures as CSV, in SI units: one line a run.

use drapery_shot::run_record::folder::RunFolder;

use super::figures::RunFigures;

const FIGURES: &str = "state,frames_done,frames_total,seconds,median_seconds_a_frame,strain_garment,strain_p99_9,strain_limit,\
degradations,retries,distance_rms_m,distance_max_m";

/// The whole table; every key that the runs set is a column behind their names.
pub(super) fn csv(runs: &[(String, RunFolder)], figures: &[RunFigures], settings: &[Vec<(String, String)>]) -> String {
    let quoted = |text: &str| format!("\"{}\"", text.replace('"', "\"\""));
    let optional = |value: Option<f64>| value.map_or(String::new(), |value| value.to_string());
    let line = |name: &str, run: &RunFigures, settings: &[(String, String)]| {
        let strain = run.strain.as_ref();
        let mut fields = vec![quoted(name)];
        fields.extend(settings.iter().map(|(_, value)| quoted(value)));
        fields.extend([
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
        ]);
        fields.join(",")
    };
    let rows = runs.iter().zip(figures).zip(settings);
    let lines: Vec<String> = rows.map(|(((name, _), run), settings)| line(name, run, settings)).collect();
    let keys: String = settings.iter().take(1).flatten().map(|(key, _)| format!("{},", quoted(key))).collect();
    format!("run,{keys}{FIGURES}\n{}\n", lines.join("\n"))
}

/// Whether a file that starts like this is such a table.
pub(super) fn is_table(start: &[u8]) -> bool {
    let start = String::from_utf8_lossy(start);
    start.starts_with("run,") && start.lines().next().is_some_and(|head| head.ends_with(FIGURES))
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
        let figures = [RunFigures::default(), full];
        let fields = |text: &str| text.lines().map(|line| line.split(',').count()).collect::<Vec<_>>();
        let text = csv(&runs, &figures, &[vec![], vec![]]);
        assert_eq!(fields(&text), [13; 3], "{text}");
        let set = |cfl: &str| vec![("solver.cfl".to_owned(), cfl.to_owned()), ("fabric".to_owned(), "wool".to_owned())];
        let text = csv(&runs, &figures, &[set("4"), set("2")]);
        assert_eq!(fields(&text), [15; 3], "{text}");
        assert!(text.starts_with("run,\"solver.cfl\",\"fabric\",state,"), "{text}");
        assert!(text.contains("\"b\",\"2\",\"wool\","), "{text}");
    }
}
