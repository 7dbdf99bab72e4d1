//! H47 to H52: ranks, disks, ranges and limits.

use drapery_core::Vec3;
use drapery_core::mesh::PolygonMesh;
use drapery_core::scene::GarmentDescription;

use crate::bench::Trial;
use crate::case::{Case, Figure};
use crate::files::SHEET;
use crate::scenes::*;

pub(super) const H47: Case = Case {
    id: "H47",
    title: "7 ranks for 2 triangles",
    must: "ranks without work change nothing",
    judge: |bench| {
        let points = [[0.0, 0.3, 0.0], [0.1, 0.3, 0.0], [0.0, 0.3, 0.1], [0.1, 0.3, 0.1]].map(Vec3::from).to_vec();
        let mesh = PolygonMesh::from_triangles(points, &[[0, 2, 1], [1, 2, 3]]);
        let mut description = scene_of(GarmentDescription::new("leaf", mesh, 0.2), 24);
        add_cloth(&mut description, 0, 50.0);
        add_self_contact(&mut description);
        add_weight(&mut description);
        add_floor(&mut description, 0.3);
        // The bench compares 1, 4 and 7 ranks to the last bit.
        let record = bench.simulate(&Trial::still(description, 12))?;
        let lowest = record.last().positions[0].iter().map(|x| x.y).fold(f64::INFINITY, f64::min);
        Ok(vec![Figure::at_least("lowest vertex on the floor [m]", lowest, 0.0)])
    },
};

pub(super) const H50: Case = Case {
    id: "H50",
    title: "a range of one frame, no pre-roll, a run that is already done",
    must: "one frame or nothing to do, exit code 0",
    judge: |bench| {
        let mut figures = Vec::new();
        bench.write("one.toml", &SHEET.replace("1001-1004", "1001-1001"))?;
        let one = bench.command(&["run", "one.toml", "--out", "one"])?;
        figures.push(Figure::exactly("exit code of one frame", one.code(), 0.0));
        let preroll = "[shot]\npreroll = { settle = 0, blend = 0 }";
        bench.write("none.toml", &SHEET.replace("[shot]", preroll))?;
        let first = bench.command(&["run", "none.toml", "--out", "none"])?;
        figures.push(Figure::exactly("exit code without pre-roll", first.code(), 0.0));
        let read = || std::fs::read(bench.folder().join("none/sheet.abc")).map_err(|e| e.to_string());
        let before = read()?;
        let again = bench.command(&["run", "none.toml", "--out", "none"])?;
        figures.push(Figure::exactly("exit code of a run that is done", again.code(), 0.0));
        figures.push(Figure::exactly("its cache stays as it was", f64::from(u8::from(read()? == before)), 1.0));
        let lacking = again.missing(&["nothing to do"]);
        figures.push(Figure::exactly("expected words missing from the message", lacking, 0.0));
        Ok(figures)
    },
};

pub(super) const H48: Case = Case {
    id: "H48",
    title: "cloth that starts squeezed into a hundredth of its area",
    must: "it spreads; ranks come to the same bits and none waits for ever",
    judge: |bench| {
        let cells = bench.by_tier(16, 100);
        let mut description = cloth(cells, 0.02, 50.0);
        add_self_contact(&mut description);
        let points = &description.garments[0].mesh.points;
        description.garments[0].start = Some(points.iter().map(|p| p * 0.1).collect());
        let record = bench.simulate(&Trial::still(description, 6))?;
        let size = |frame: &crate::bench::Frame| frame.positions[0].iter().map(|x| x.norm()).fold(0.0, f64::max);
        Ok(vec![Figure::at_least("size at the end over the start", size(record.last()) / size(&record.frames[0]), 2.0)])
    },
};

pub(super) const H49: Case = Case {
    id: "H49",
    title: "a disk that is full in the middle of a run, and a folder that cannot be made",
    must: "exit codes 74 and 73; the run resumes from what is good when there is room",
    judge: |bench| {
        bench.write(
            "scene.toml",
            &SHEET.replace("1001-1004", "1001-1060").replace("resolution = 6", "resolution = 12"),
        )?;
        // A limit on the size of files stands for the full disk: writing beyond it is an ordinary error.
        let script = "trap '' XFSZ; ulimit -f 100; drapery run scene.toml --out out --checkpoint-every 5f -q";
        let full = bench.shell(script)?;
        let again = bench.command(&["run", "scene.toml", "--out", "out", "-q"])?;
        bench.write("file", "not a folder")?;
        let nowhere = bench.command(&["run", "scene.toml", "--out", "file/out", "-q"])?;
        let whole = bench.command(&["run", "scene.toml", "--out", "whole", "-q"])?;
        let same = bench.command(&["diff", "out/sheet.abc", "whole/sheet.abc"])?;
        Ok(vec![
            Figure::exactly("exit code, full", full.code(), 74.0),
            Figure::exactly("exit code, room again", again.code(), 0.0),
            Figure::exactly("exit code, no folder", nowhere.code(), 73.0),
            Figure::exactly("exit code of a run with room", whole.code(), 0.0),
            Figure::exactly("exit code of the comparison with it", same.code(), 0.0),
        ])
    },
};

pub(super) const H51: Case = Case {
    id: "H51",
    title: "ten runs in a row",
    must: "the same bytes",
    judge: |bench| {
        let runs = if bench.tier() == crate::case::Tier::Soak { 100 } else { 10 };
        bench.write("scene.toml", SHEET)?;
        let mut different = 0;
        let mut first = Vec::new();
        for run in 0..runs {
            let out = format!("out{run}");
            let threads = (1 + run % 3).to_string();
            let ended = bench.command(&["run", "scene.toml", "--out", &out, "--threads", &threads, "-q"])?;
            if ended.code != Some(0) {
                return Err(format!("run {run}: exit code {:?}\n{}", ended.code, ended.stderr));
            }
            let bytes = std::fs::read(bench.folder().join(&out).join("sheet.abc")).map_err(|e| e.to_string())?;
            if run == 0 {
                first = bytes;
            } else {
                different += i32::from(bytes != first);
            }
        }
        Ok(vec![Figure::exactly("runs that differ from the first", f64::from(different), 0.0)])
    },
};

pub(super) const H52: Case = Case {
    id: "H52",
    title: "less memory than the shot needs",
    must: "an exit code of its own, no signal and no panic",
    judge: |bench| {
        bench.write("scene.toml", &SHEET.replace("resolution = 6", "resolution = 400"))?;
        let ended = bench.shell("ulimit -v 400000; drapery run scene.toml --out out --threads 1 -q")?;
        Ok(vec![
            Figure::at_most("exit code; above 125 a signal has ended it", ended.code(), 125.0),
            Figure::at_least("exit code", ended.code(), 1.0),
        ])
    },
};
