//! The picture of the amplification in `docs/theory/tr_bdf2.md`, made by steps of the solver. `DRAPERY_BLESS=1 cargo test -p
//! drapery-tests --test physics` writes it again.

use std::fmt::Write;
use std::path::Path;

use drapery_core::scene::Integrator;

use crate::long_steps::{amplification, spectral_radius};

const PICTURE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/pictures/amplification.svg");

/// Size of the picture, and of its frame: left, right, top, bottom [px].
const SIZE: [f64; 2] = [760.0, 400.0];
const FRAME: [f64; 4] = [60.0, 740.0, 20.0, 340.0];

/// Powers of ten of dt ω at the ends, points in each, and the largest amplification.
const POWERS: [i32; 2] = [-1, 4];
const POINTS: i32 = 16;
const HIGHEST: f64 = 1.2;

/// Curves of the picture: name, colour, integrator, damping ratio.
const CURVES: [(&str, &str, Integrator, f64); 5] = [
    ("long steps, ζ = 0", "#1c5fa8", Integrator::TrBdf2, 0.0),
    ("long steps, ζ = 0.1", "#2f8f4e", Integrator::TrBdf2, 0.1),
    ("long steps, ζ = 1", "#c0711f", Integrator::TrBdf2, 1.0),
    ("short steps, ζ = 0", "#b03030", Integrator::SemiImplicit, 0.0),
    ("short steps, ζ = 0.1", "#8a5fb0", Integrator::SemiImplicit, 0.1),
];

fn x(dt_omega: f64) -> f64 {
    let share = (dt_omega.log10() - f64::from(POWERS[0])) / f64::from(POWERS[1] - POWERS[0]);
    FRAME[0] + share * (FRAME[1] - FRAME[0])
}

fn y(radius: f64) -> f64 {
    FRAME[3] - radius / HIGHEST * (FRAME[3] - FRAME[2])
}

/// Points of a curve up to where it leaves the frame.
fn curve(integrator: Integrator, damping_ratio: f64) -> String {
    let mut points = String::new();
    for step in 0..=(POWERS[1] - POWERS[0]) * POINTS {
        let dt_omega = 10.0_f64.powf(f64::from(POWERS[0]) + f64::from(step) / f64::from(POINTS));
        let radius = spectral_radius(&amplification(integrator, dt_omega, damping_ratio));
        let _ = write!(points, "{:.1},{:.1} ", x(dt_omega), y(radius.min(HIGHEST)));
        if radius > HIGHEST {
            break;
        }
    }
    points.trim_end().to_owned()
}

fn picture() -> String {
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {} {}\" font-family=\"sans-serif\" font-size=\"13\">\n\
         <title>Amplification of a mode in a step, by dt ω</title>\n<rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>\n",
        SIZE[0], SIZE[1]
    );
    let mut line = |from: [f64; 2], to: [f64; 2], stroke: &str| {
        let _ = writeln!(
            out,
            "<line x1=\"{:.1}\" y1=\"{:.1}\" x2=\"{:.1}\" y2=\"{:.1}\" stroke=\"{stroke}\"/>",
            from[0], from[1], to[0], to[1]
        );
    };
    let powers = || POWERS[0]..=POWERS[1];
    powers().for_each(|power| {
        let at = x(10.0_f64.powi(power));
        line([at, FRAME[2]], [at, FRAME[3]], "#ddd");
    });
    let heights = [0.0, 0.2, 0.4, 0.6, 0.8, 1.0];
    heights.iter().for_each(|height| {
        line([FRAME[0], y(*height)], [FRAME[1], y(*height)], if *height == 1.0 { "#444" } else { "#ddd" });
    });
    let periods = [32.0, 16.0, 8.0];
    periods.iter().for_each(|steps| {
        let at = x(std::f64::consts::TAU / steps);
        line([at, y(0.0)], [at, y(0.06)], "#444");
    });
    let mut text = |[at, height]: [f64; 2], anchor: &str, colour: &str, words: &str| {
        let _ = writeln!(
            out,
            "<text x=\"{at:.1}\" y=\"{height:.1}\" text-anchor=\"{anchor}\" fill=\"{colour}\">{words}</text>"
        );
    };
    powers().for_each(|power| {
        let words = 10.0_f64.powi(power).to_string();
        text([x(10.0_f64.powi(power)), FRAME[3] + 18.0], "middle", "#222", &words);
    });
    heights.iter().for_each(|height| text([FRAME[0] - 8.0, y(*height) + 4.0], "end", "#222", &height.to_string()));
    periods.iter().for_each(|steps| {
        text([x(std::f64::consts::TAU / steps), y(0.06) - 5.0], "middle", "#444", &steps.to_string());
    });
    text([x(std::f64::consts::TAU / 16.0), y(0.06) - 22.0], "middle", "#444", "steps a period");
    let middle = 0.5 * (FRAME[0] + FRAME[1]);
    text([middle, FRAME[3] + 42.0], "middle", "#222", "dt ω; by how much a step multiplies a mode of this frequency");
    for (row, (name, colour, ..)) in CURVES.iter().enumerate() {
        text([FRAME[1] - 12.0, FRAME[2] + 80.0 + 20.0 * row as f64], "end", colour, name);
    }
    for (name, colour, integrator, damping_ratio) in CURVES {
        let points = curve(integrator, damping_ratio);
        let _ = writeln!(
            out,
            "<polyline points=\"{points}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"2\"><title>{name}</title></polyline>"
        );
    }
    out + "</svg>\n"
}

#[test]
fn the_picture_of_the_amplification_is_what_steps_of_the_solver_do() {
    let (picture, path) = (picture(), Path::new(PICTURE));
    if std::env::var_os("DRAPERY_BLESS").is_some() {
        std::fs::write(path, &picture).unwrap_or_else(|error| panic!("{PICTURE}: {error}"));
    }
    let there = std::fs::read_to_string(path).unwrap_or_default();
    assert!(
        there == picture,
        "{PICTURE} is out of date\n  help: DRAPERY_BLESS=1 cargo test -p drapery-tests --test physics amplification"
    );
}
