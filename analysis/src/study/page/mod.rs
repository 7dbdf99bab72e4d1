//! `report.html` of a study: what to take, error over seconds, error over time step, where the time goes, how far
//! trajectories can be told, what each effect takes and changes, what was counted, and where it all comes from.

mod charts;
mod ensemble;
mod tables;

use crate::page::text::{self, escape, millimetres};
use crate::page::{document, tile};
use crate::study::allowed;
use crate::study::analysis::{Analysis, analyse};
use crate::study::checks::checks;
use crate::study::record::Study;
use crate::study::table::{error_words, recommendation, reference_words, window_words};
use crate::study::verdict::Verdict;

/// File name of the page.
pub(super) const PAGE: &str = "report.html";

/// The page; `study.json` alone goes into it.
pub(super) fn page(study: &Study) -> String {
    let analysis = analyse(study);
    let mut body = header(study, &analysis);
    body += &tiles(study, &analysis);
    body += &tables::settings(study, &analysis);
    body += &tables::checked(study, &analysis);
    body += &charts::error_over_seconds(study, &analysis);
    body += &charts::error_over_step(&analysis);
    body += &charts::stages(study, &analysis);
    body += &charts::horizon(study, &analysis);
    body += &ensemble::section(study, &analysis);
    body += &tables::changes(study);
    body += &tables::closed_forms(study, &analysis);
    body += &tables::counters(&analysis);
    body += &tables::left_out(study);
    body += &tables::provenance(study, &analysis);
    let made = format!("Made by drapery study from {} and nothing else.", crate::study::record::RECORD);
    document(&format!("{}: what accuracy costs", study.scene.shot), &body, &made)
}

fn header(study: &Study, analysis: &Analysis<'_>) -> String {
    let scene = &study.scene;
    let mut header = format!(
        "<header><h1>{}: what accuracy costs in time</h1><p>{} triangles · frames studied {} to {} of {} to {} · {} \
         threads</p><p class=\"say\">{}</p>",
        escape(&scene.shot),
        text::count(scene.triangles),
        scene.start,
        study.compared.last().copied().unwrap_or(scene.start),
        scene.frames[0],
        scene.frames[1],
        study.machine.threads,
        escape(&capital(&recommendation(study, analysis, study.budget))),
    );
    for warning in warnings(study, analysis) {
        header += &format!("<p class=\"warn\">{}</p>", escape(&warning));
    }
    for sentence in allowed::words(study) {
        header += &format!("<p>{}</p>", escape(&sentence));
    }
    header + "</header>\n"
}

/// Lists the warnings that a reader has to know before believing the numbers.
fn warnings(study: &Study, analysis: &Analysis<'_>) -> Vec<String> {
    let mut warnings = Vec::new();
    if study.reference().is_none() {
        warnings.push("No error is known: there is no reference.".to_owned());
    } else if analysis.own.is_none() {
        warnings.push("The reference was not checked: errors are marked ~.".to_owned());
    }
    let failing = checks(study, analysis).into_iter().filter(|check| check.verdict == Verdict::Fails);
    warnings.extend(failing.map(|check| format!("This does not hold: {}: {}.", lower(check.name), check.why)));
    warnings
}

fn lower(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or(String::new(), |first| first.to_lowercase().chain(letters).collect())
}

fn capital(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or(String::new(), |first| first.to_uppercase().chain(letters).collect())
}

fn tiles(study: &Study, analysis: &Analysis<'_>) -> String {
    let mut tiles = String::new();
    if let Some(base) = analysis.rows.first() {
        tiles += &tile("", &text::seconds(base.seconds), "a frame of the scene as it is");
        tiles += &tile("", &error_words(base.error.as_ref()), "its error, area-weighted RMS");
    }
    if let Some(own) = analysis.own {
        tiles += &tile("", &millimetres(own), "own error of the reference");
    }
    let horizon = match (analysis.has_horizon, study.compared.get(analysis.predictable)) {
        (true, Some(frame)) => format!("{} s", text::digits(study.time(*frame))),
        _ if analysis.floor.is_empty() => "not measured".to_owned(),
        _ => format!("> {} s", text::digits(study.compared.last().map_or(0.0, |frame| study.time(*frame)))),
    };
    tiles += &tile("", &horizon, "predictability horizon");
    let order = analysis.ladders.iter().max_by_key(|ladder| ladder.points.len());
    if let Some(ladder) = order {
        let half = ladder.fit.uncertainty.map_or(String::new(), |half| format!(" ± {half:.2}"));
        tiles += &tile("", &format!("{:.2}{half}", ladder.fit.order), "order of convergence in dt");
    }
    let faults = analysis.rows.iter().filter(|row| !row.is_sound).count();
    tiles += &match faults {
        0 => tile("fine", "0", "settings with intersections or unconverged solves"),
        some => tile("alarm", &some.to_string(), "settings with intersections or unconverged solves"),
    };
    format!(
        "<div class=\"tiles\">{tiles}</div>\n<p>Reference: {}. {}.</p>",
        escape(&reference_words(study, analysis)),
        escape(&window_words(study, analysis))
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::study::analysis::tests::convergent;
    use crate::study::record::{Distance, Figures, Omission, Role};

    /// A study with something in every part of the page.
    fn full() -> Study {
        let mut study = convergent();
        study.scene.shot = "a <b> & \"c\"".into();
        study.budget = Some(2.5);
        let mut copy = study.samples[0].clone();
        copy.copy = 1;
        copy.from_base =
            (0..10).map(|frame| Distance { rms: 1e-12 * 10.0_f64.powi(frame), ..Distance::default() }).collect();
        study.samples.push(copy);
        let mut without = study.samples[1].clone();
        (without.role, without.setting.label) = (Role::Without, "without wind".into());
        study.samples.push(without);
        study.samples.iter_mut().for_each(|sample| sample.figures = vec![Figures::default(); 10]);
        let (label, why) = ("cfl 0.5".into(), "no time".into());
        study.omitted.push(Omission { label, why, ..Omission::default() });
        study
    }

    #[test]
    fn the_page_needs_nothing_else_and_is_made_of_closed_elements() {
        let page = page(&full());
        for word in ["http", "<script", "javascript", "url(", "@import", "NaN", "inf"] {
            assert!(!page.contains(word), "{word}");
        }
        assert!(page.contains("a &lt;b&gt; &amp; &quot;c&quot;") && !page.contains("a <b>"));
        for element in
            ["main", "section", "figure", "div", "svg", "table", "tr", "td", "g", "text", "title", "span", "i"]
        {
            let opened = page.matches(&format!("<{element}>")).count() + page.matches(&format!("<{element} ")).count();
            assert_eq!(opened, page.matches(&format!("</{element}>")).count(), "{element}");
        }
    }

    #[test]
    fn the_page_has_all_its_parts_and_recommends_what_the_table_does() {
        let study = full();
        let page = page(&study);
        for title in [
            "Settings",
            "Validity checks",
            "Error over seconds",
            "Error over time step",
            "Where the time goes",
            "Predictability horizon",
            "What each effect and choice takes, and what it changes",
            "Losses of quality",
            "Runs that failed or are missing",
            "Provenance",
        ] {
            assert!(page.contains(&format!("<h2>{title}</h2>")), "{title}");
        }
        let printed = crate::study::table::table(&study, &analyse(&study), study.budget);
        assert!(
            page.contains("<b>cfl 2</b> ← recommended") && printed.contains("\"cfl 2\", error 0.5 mm rms"),
            "{printed}"
        );
    }

    #[test]
    fn a_study_in_which_nothing_has_run_has_a_page() {
        assert!(page(&Study::default()).contains("No error is known"));
    }
}
