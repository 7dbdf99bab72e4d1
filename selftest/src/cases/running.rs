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
        let lacking = again.missing(&["nothing was done"]);
        figures.push(Figure::exactly("words that the message lacks", lacking, 0.0));
        Ok(figures)
    },
};
