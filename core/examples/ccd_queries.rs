//! Answers continuous collision queries for the judges in `tests/oracle/test_ccd.py`, and says how fast.
//!
//!     cargo run --release -p drapery-core --example ccd_queries -- point_triangle queries.f64 GAP > answers.csv
//!
//! The file holds 24 little-endian `f64` a query: four points at time 0, the same four at time 1. The first line of
//! the answer is the number of queries a second (best of some passes), the others are `hit,time`. It looks into a room of the solver,
//! `contact::ccd`, which is not part of the facade.

use std::error::Error;
use std::hint::black_box;
use std::io::Write;
use std::time::Instant;

use drapery_core::Vec3;
use drapery_core::contact::ccd::{edge_edge, point_triangle};

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().collect();
    let [_, kind, path, gap] = arguments.as_slice() else {
        return Err("usage: ccd_queries point_triangle|edge_edge FILE GAP".into());
    };
    let ask = match kind.as_str() {
        "point_triangle" => point_triangle,
        "edge_edge" => edge_edge,
        _ => return Err(format!("{kind} is no kind of query; use point_triangle or edge_edge").into()),
    };
    let gap: f64 = gap.parse()?;
    let bytes = std::fs::read(path)?;
    let numbers: Vec<f64> = bytes
        .chunks_exact(size_of::<f64>())
        .map(|b| f64::from_le_bytes(b.try_into().expect("a chunk has the size of an f64")))
        .collect();
    let points: Vec<Vec3> = numbers.chunks_exact(3).map(Vec3::from_column_slice).collect();
    let queries: Vec<[[Vec3; 4]; 2]> =
        points.chunks_exact(8).map(|x| [[x[0], x[1], x[2], x[3]], [x[4], x[5], x[6], x[7]]]).collect();
    let mut fastest = f64::INFINITY;
    for _ in 0..5 {
        let begin = Instant::now();
        queries.iter().for_each(|[start, end]| {
            black_box(ask(start, end, gap));
        });
        fastest = fastest.min(begin.elapsed().as_secs_f64());
    }
    let mut out = std::io::BufWriter::new(std::io::stdout().lock());
    writeln!(out, "{}", queries.len() as f64 / fastest)?;
    for [start, end] in &queries {
        match ask(start, end, gap) {
            Some(contact) => writeln!(out, "1,{:?}", contact.time)?,
            None => writeln!(out, "0,")?,
        }
    }
    Ok(())
}
