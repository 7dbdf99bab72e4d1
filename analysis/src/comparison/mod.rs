//! Runs side by side: one table of their figures, the settings in which their scenes differ, their course, and their pictures
//! from one camera. The page of `drapery wedge`, and of `drapery report` for several folders.

mod charts;
mod csv;
mod differences;
mod figures;

use std::path::{Path, PathBuf};

use drapery_io::atomic_file;
use drapery_io::error::IoError;
use drapery_shot::run_record::folder::RunFolder;

use crate::page::document;
use crate::page::table::{Cell, number, section, words};
use crate::page::text::{self, escape};
use crate::wedge::WedgeRun;
use crate::{contact_sheet, report};
use figures::RunFigures;

/// File name of the page, unless another is asked for.
pub const PAGE: &str = "comparison.html";

/// A figure, or a dash where there is none.
fn or_dash(figure: String) -> String {
    if figure.is_empty() { "-".to_owned() } else { figure }
}

/// State of a run that has written nothing.
const NOT_RUN: &str = "not run";

/// State of a run whose folder holds something else, such as a run of another scene: what is there has no place in the table.
const REFUSED: &str = "refused: see its log";

/// Several runs to be compared.
#[derive(Debug, Clone, Default)]
pub struct Comparison {
    /// The name of each run, and its folder.
    runs: Vec<(String, RunFolder)>,
    /// The figures of each.
    figures: Vec<RunFigures>,
    /// Keys and values that each sets in the scene, the same keys in all; empty where they are not known.
    settings: Vec<Vec<(String, String)>>,
}

impl Comparison {
    /// Reads runs by the names of their folders, or by the folders as given where names are the same.
    ///
    /// # Errors
    /// A folder holds no run, or its manifest or record cannot be read.
    pub fn of(folders: &[PathBuf]) -> Result<Self, IoError> {
        let short = |path: &PathBuf| path.file_name().map(|name| name.to_string_lossy().into_owned());
        let is_alone = |name: &String| folders.iter().filter(|other| short(other).as_ref() == Some(name)).count() == 1;
        let name = |path: &PathBuf| short(path).filter(is_alone).unwrap_or_else(|| path.display().to_string());
        let read = |path: &PathBuf| Ok((name(path), RunFolder::read(path)?));
        folders.iter().map(read).collect::<Result<Vec<_>, IoError>>().map(Self::of_runs)
    }

    /// Reads the runs of a wedge in its folder; a run that has written nothing is listed as such, and so is one of those that were `refused`
    /// because their folders hold something else.
    ///
    /// # Errors
    /// The manifest or the record of a run cannot be read.
    pub fn of_wedge(folder: &Path, runs: &[WedgeRun], refused: &[String]) -> Result<Self, IoError> {
        let read = |WedgeRun { name, .. }: &WedgeRun| {
            let without_figures = |path: PathBuf, state: &'static str| {
                let mut run = RunFolder { path, ..RunFolder::default() };
                run.manifest.state = state.into();
                // Of no frames, as far as anybody knows.
                (run.manifest.first_frame, run.manifest.last_frame) = (1, 0);
                run
            };
            let path = folder.join(name);
            if refused.contains(name) {
                return Ok((name.clone(), without_figures(path, REFUSED)));
            }
            let run = match RunFolder::read(&path) {
                Err(IoError::NoRun { path, .. }) => without_figures(path, NOT_RUN),
                other => other?,
            };
            Ok((name.clone(), run))
        };
        let settings = runs.iter().map(|run| run.settings.clone()).collect();
        Ok(Self { settings, ..Self::of_runs(runs.iter().map(read).collect::<Result<_, IoError>>()?) })
    }

    fn of_runs(runs: Vec<(String, RunFolder)>) -> Self {
        let figures = runs.iter().map(|(_, run)| RunFigures::of(run, &runs[0].1)).collect();
        let settings = vec![Vec::new(); runs.len()];
        Self { runs, figures, settings }
    }

    /// Writes the page, and the table as CSV beside it; returns the two paths. The name is the page's, or the table's if it ends in `.csv`.
    ///
    /// # Errors
    /// A file is there that is no page or table of Drapery, or cannot be written.
    pub fn write(&self, name: &Path) -> Result<[PathBuf; 2], IoError> {
        let is_table = name.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("csv"));
        let (page, table) = if is_table {
            (name.with_extension("html"), name.to_owned())
        } else {
            (name.to_owned(), name.with_extension("csv"))
        };
        crate::page::check(&page)?;
        atomic_file::check_own(&table, "table", csv::is_table)?;
        atomic_file::replace(&table, csv::csv(&self.runs, &self.figures, &self.settings).as_bytes())?;
        crate::page::write(&page, &self.page(page.parent().unwrap_or(Path::new(""))))?;
        Ok([page, table])
    }

    /// The table of figures, as text; a dash stands for what a run does not have.
    pub fn table(&self) -> String {
        let heads = RunFigures::HEADS.map(str::to_owned);
        let mut rows = vec![[vec!["run".to_owned()], heads.to_vec()].concat()];
        rows.extend(
            self.runs
                .iter()
                .zip(&self.figures)
                .map(|((name, _), run)| [vec![name.clone()], run.cells().map(or_dash).to_vec()].concat()),
        );
        let width = |column: usize| rows.iter().map(|row| row[column].chars().count()).max().unwrap_or(0);
        let widths: Vec<usize> = (0..rows[0].len()).map(width).collect();
        let line = |row: &Vec<String>| {
            let cell = |(index, (text, width)): (usize, (&String, &usize))| match index {
                // Names and states are words.
                0 | 1 => format!("{text:<width$}"),
                _ => format!("{text:>width$}"),
            };
            let cells: Vec<String> = row.iter().zip(&widths).enumerate().map(cell).collect();
            format!("{}\n", cells.join("  ").trim_end())
        };
        rows.iter().map(line).collect()
    }

    /// The page in a folder, which links lead away from.
    fn page(&self, folder: &Path) -> String {
        let shots: Vec<&str> =
            self.runs.iter().map(|(_, run)| run.manifest.shot.as_str()).filter(|shot| !shot.is_empty()).collect();
        let title = match shots.split_first() {
            Some((first, rest)) if rest.iter().all(|shot| shot == first) => (*first).to_owned(),
            _ => "Runs".to_owned(),
        };
        let count = self.runs.len();
        let done = self.runs.iter().filter(|(_, run)| run.manifest.state == "done").count();
        let mut body = format!(
            "<header><h1>{}: {count} runs side by side</h1><p>{done} of {count} done</p></header>\n",
            escape(&title)
        );
        body += &self.figures_table(folder);
        body += &contact_sheet::of_runs(&self.runs);
        body += &charts::charts(&self.runs);
        body += &differences::table(&self.runs);
        document(&format!("{title}: {count} Drapery runs"), &body, "Generated by drapery from the folders of the runs.")
    }

    fn figures_table(&self, folder: &Path) -> String {
        let row = |((name, run), figures): (&(String, RunFolder), &RunFigures)| {
            let mut cells: Vec<Cell> = vec![(link(name, run, folder), false)];
            let [state, numbers @ ..] = figures.cells();
            cells.push(words(state));
            cells.extend(numbers.iter().map(number));
            cells
        };
        let rows: Vec<Vec<Cell>> = self.runs.iter().zip(&self.figures).map(row).collect();
        let [state, numbers @ ..] = RunFigures::HEADS;
        let mut heads = vec![words("run"), words(state)];
        heads.extend(numbers.iter().map(number));
        let note = format!(
            "<p>Strain: the 99.9th percentile of the edges' strains in the worst frame, of the garment where it is largest, and \
             the limit of its fabric. Distance: of each vertex from its like in {}, root mean square and largest over the frames \
             that both have.</p>",
            self.runs.first().map_or("the first run".to_owned(), |(name, _)| format!("<code>{}</code>", escape(name)))
        );
        section("Figures", &note, &heads, &rows)
    }
}

/// The name of a run, leading to its own page where it has one in a folder below.
fn link(name: &str, run: &RunFolder, folder: &Path) -> String {
    let page = run.path.join(report::PAGE);
    let below = page.strip_prefix(folder).ok().and_then(Path::to_str).filter(|_| page.is_file());
    match below {
        Some(below) => format!("<a href=\"{}\">{}</a>", escape(&text::address(below)), escape(name)),
        None => escape(name),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use drapery_shot::run_record::reader::FrameRow;

    fn run(state: &'static str, crossings: u64) -> RunFolder {
        let mut run = RunFolder::default();
        run.manifest.shot = "a <b>".into();
        run.manifest.state = state.into();
        (run.manifest.first_frame, run.manifest.last_frame) = (1, 4);
        run.manifest.last_complete_frame = Some(4);
        for frame in 1..=4 {
            let counts = [("crossings".to_owned(), crossings)].into();
            run.record.frames.push(FrameRow { frame, seconds: 2.0, steps: 8, counts, ..FrameRow::default() });
        }
        run
    }

    #[test]
    fn the_page_lists_every_run_and_is_made_of_closed_elements() {
        let runs = vec![("silk".to_owned(), run("done", 0)), ("<wool>".to_owned(), run("failed", 2))];
        let page = Comparison::of_runs(runs).page(Path::new(""));
        assert!(page.contains("2 runs side by side") && page.contains("1 of 2 done"), "{page}");
        assert!(page.contains("&lt;wool&gt;") && !page.contains("<wool>") && !page.contains("a <b>"), "{page}");
        for element in ["main", "section", "figure", "div", "svg", "table", "tr", "td", "details"] {
            let opened = page.matches(&format!("<{element}>")).count() + page.matches(&format!("<{element} ")).count();
            assert_eq!(opened, page.matches(&format!("</{element}>")).count(), "{element}");
        }
    }

    #[test]
    fn degradations_are_counted_for_each_run() {
        let runs = vec![("a".to_owned(), run("done", 0)), ("b".to_owned(), run("done", 2))];
        let table = Comparison::of_runs(runs).table();
        let lines: Vec<Vec<&str>> = table.lines().map(|line| line.split_whitespace().collect()).collect();
        let column = lines[0].iter().position(|head| *head == "degradations").unwrap();
        // State, frames, times and strain stand before it, each a word or two.
        assert!(lines[1].contains(&"0") && lines[2].contains(&"8"), "{table} {column}");
    }

    #[test]
    fn a_run_that_has_written_nothing_is_listed() {
        let folder = tempfile::tempdir().unwrap();
        let vary = [("solver.cfl".to_owned(), vec!["4".to_owned(), "2".to_owned()])];
        let compared = Comparison::of_wedge(folder.path(), &crate::wedge::runs(&vary).unwrap(), &[]).unwrap();
        assert_eq!(compared.table().matches(NOT_RUN).count(), 2);
        let name = crate::wedge::runs(&vary).unwrap()[1].name.clone();
        let compared = Comparison::of_wedge(folder.path(), &crate::wedge::runs(&vary).unwrap(), &[name]).unwrap();
        assert_eq!((compared.table().matches(NOT_RUN).count(), compared.table().matches(REFUSED).count()), (1, 1));
        let refused = Comparison::of(&[folder.path().join("cfl=4")]).unwrap_err();
        assert!(refused.to_string().contains("cfl=4"), "{refused}");
    }
}
