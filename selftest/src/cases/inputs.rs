//! H17 and H42 to H46: what comes in from files.

use crate::bench::{Bench, Ended};
use crate::case::{Case, Figure};
use crate::files::{BODY, FROM_FILES, SKIRT};

/// Runs a scene of files with these texts.
fn run(bench: &Bench<'_>, scene: &str, body: &str, skirt: &str) -> Result<Ended, String> {
    bench.write("scene.toml", scene)?;
    bench.write("body.obj", body)?;
    bench.write("skirt.obj", skirt)?;
    bench.command(&["run", "scene.toml", "--out", "out", "--overwrite", "-q"])
}

/// Exit code, and how many words the message lacks.
fn judged(what: &str, ended: &Ended, code: f64, words: &[&str]) -> [Figure; 2] {
    [
        Figure::exactly(format!("exit code, {what}"), ended.code(), code),
        Figure::exactly(format!("words that the message lacks, {what}"), ended.missing(words), 0.0),
    ]
}

pub(super) const H17: Case = Case {
    id: "H17",
    title: "no mass, negative mass, a point that is not a number",
    must: "an error that names what and where",
    judge: |bench| {
        let mut figures = Vec::new();
        for density in ["0.0", "-0.1", "nan"] {
            let scene = FROM_FILES.replace("\"0.15 kg/m²\"", density);
            let ended = run(bench, &scene, BODY, SKIRT)?;
            figures.extend(judged(&format!("density {density}"), &ended, 78.0, &["skirt", "density"]));
        }
        let broken = run(bench, FROM_FILES, BODY, &SKIRT.replace("v 3 1 1", "v 3 nan 1"))?;
        figures.extend(judged("a point", &broken, 65.0, &["garment \"skirt\"", "vertices 2", "not finite"]));
        Ok(figures)
    },
};
