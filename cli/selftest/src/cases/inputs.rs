//! H17 and H42 to H46: what comes in from files.

use drapery_alembic::IDENTITY;
use drapery_core::Vec3;

use crate::bench::{Bench, Ended, Trial};
use crate::case::{Case, Figure};
use crate::cases::contact::add_mesh_body;
use crate::files::{ArchiveFrame, BODY, FROM_FILES, SKIRT, write_archive};
use crate::scenes::*;

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
        Figure::exactly(format!("expected words missing from the message, {what}"), ended.missing(words), 0.0),
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

/// Runs the scene of files with an archive of these frames as its body.
fn run_archive(bench: &Bench<'_>, frames: &[ArchiveFrame], out: &str) -> Result<Ended, String> {
    write_archive(&bench.folder().join("body.abc"), frames)?;
    bench.write("scene.toml", &FROM_FILES.replace("body.obj", "body.abc"))?;
    bench.write("skirt.obj", SKIRT)?;
    bench.command(&["run", "scene.toml", "--out", out, "--overwrite", "-q"])
}

/// A box of the size of a person at the origin, and the frame in which it stands there.
fn person() -> ArchiveFrame {
    let (points, triangles) = box_mesh(Vec3::new(0.25, 0.85, 0.15), 2);
    ArchiveFrame::of(&triangles, points.into_iter().map(|p| p + Vec3::y() * 0.85).collect())
}

pub(super) const H42: Case = Case {
    id: "H42",
    title: "a point of a body that is not a number in one frame",
    must: "the frame and the vertex are named",
    judge: |bench| {
        let mut frames = vec![person(); 3];
        frames[1].points[5].y = f64::NAN;
        let ended = run_archive(bench, &frames, "out")?;
        Ok(judged("a broken point", &ended, 65.0, &["body \"hero\"", "frame 2", "vertex 5", "finite"]).into())
    },
};

pub(super) const H43: Case = Case {
    id: "H43",
    title: "a body that changes its faces, and one that changes their order",
    must: "the frame is named",
    judge: |bench| {
        let mut fewer = vec![person(); 3];
        fewer[1].triangles.pop();
        let mut order = vec![person(); 3];
        order[2].triangles.swap(0, 1);
        let mut figures = Vec::new();
        for (what, frames, frame) in [("fewer faces", fewer, "frame 2"), ("another order", order, "frame 3")] {
            let ended = run_archive(bench, &frames, "out")?;
            figures.extend(judged(what, &ended, 65.0, &["body \"hero\"", frame, "topology"]));
        }
        Ok(figures)
    },
};

pub(super) const H44: Case = Case {
    id: "H44",
    title: "a body with fewer frames than the shot",
    must: "both ranges are named",
    judge: |bench| {
        // Frames that are alike would be one that holds for ever.
        let mut moved = person();
        moved.points.iter_mut().for_each(|p| p.x += 0.01);
        let ended = run_archive(bench, &[person(), moved], "out")?;
        let words = ["body \"hero\"", "frames 1 to 2", "frames 1 to 3"];
        Ok(judged("two frames of three", &ended, 65.0, &words).into())
    },
};

pub(super) const H45: Case = Case {
    id: "H45",
    title: "a body that stands still, one that grows threefold, one that turns inside out",
    must: "cloth stays outside the first two; the third leaves it whole",
    judge: |bench| {
        let mut figures = Vec::new();
        for (what, growth) in [("still", 0.0), ("growing", 2.0), ("inside out", -2.4)] {
            let (triangles, unit) = unit_ball(12, 24);
            let place =
                move |time: f64| -> Vec<Vec3> { unit.iter().map(|p| p * (0.1 * (1.0 + growth * time))).collect() };
            let mut description = cloth(10, 0.04, 100.0);
            description.garments[0].mesh.points.iter_mut().for_each(|p| p.y = 0.11);
            add_weight(&mut description);
            add_self_contact(&mut description);
            let input = add_mesh_body(&mut description, triangles, place);
            (description.bodies[0].thickness, description.bodies[0].max_push_speed) = (0.002, 1.0);
            let inside_out = what == "inside out";
            let trial = Trial { input, may_cross: inside_out, ..Trial::still(description, 20) };
            let record = bench.simulate(&trial)?;
            figures.push(Figure::at_most(format!("strain, {what}"), record.strain(), 0.5));
            if inside_out {
                let counted = record.counted("body_inside_out");
                figures.push(Figure::at_least("frames that count it", counted, 1.0));
            } else {
                // The facets lie inside the ball.
                let radius = 0.1 * (1.0 + growth * 20.0 / 24.0) * (std::f64::consts::PI / 24.0).cos().powi(2);
                let nearest = record.last().positions[0].iter().map(|x| x.norm()).fold(f64::INFINITY, f64::min);
                figures.push(Figure::at_least(
                    format!("distance from the centre over the radius, {what}"),
                    nearest / radius,
                    1.0,
                ));
            }
        }
        let mut turned = person();
        turned.points.iter_mut().for_each(|p| *p = -*p);
        figures.push(Figure::exactly(
            "exit code, inside out from frame 2 on",
            run_archive(bench, &[person(), turned.clone(), turned], "out")?.code(),
            0.0,
        ));
        let check = bench.command(&["check", "scene.toml"])?;
        figures.extend(judged("check of it", &check, 0.0, &["body \"hero\"", "frame 2", "inside out"]));
        Ok(figures)
    },
};

pub(super) const H46: Case = Case {
    id: "H46",
    title: "a body that moves by its transform alone",
    must: "the same motion as with points that move",
    judge: |bench| {
        let way = |frame: usize| 0.05 * frame as f64;
        let by_transform = |frame: usize| {
            let mut matrix = IDENTITY;
            matrix[12] = way(frame);
            ArchiveFrame { matrix, ..person() }
        };
        let by_points = |frame: usize| {
            let ArchiveFrame { triangles, points, .. } = person();
            ArchiveFrame::of(&triangles, points.iter().map(|p| p + Vec3::x() * way(frame)).collect())
        };
        let near = SKIRT.replace("v 2 1 0", "v 0.3 1 0").replace("v 2 1 1", "v 0.3 1 1");
        let mut codes = Vec::new();
        for (out, frames) in
            [("a", (0..3).map(by_transform).collect::<Vec<_>>()), ("b", (0..3).map(by_points).collect())]
        {
            write_archive(&bench.folder().join("body.abc"), &frames)?;
            bench.write("scene.toml", &FROM_FILES.replace("body.obj", "body.abc"))?;
            bench.write("skirt.obj", &near)?;
            codes.push(bench.command(&["run", "scene.toml", "--out", out, "-q"])?.code());
        }
        let same = bench.command(&["diff", "a/skirt.abc", "b/skirt.abc", "--tolerance", "1e-6"])?;
        Ok(vec![
            Figure::exactly("exit code, transform", codes[0], 0.0),
            Figure::exactly("exit code, points", codes[1], 0.0),
            Figure::exactly("exit code of the comparison to a micrometre", same.code(), 0.0),
        ])
    },
};
