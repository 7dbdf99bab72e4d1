//! `docs/pictures/materials.svg`: force by strain of the preset materials, from the same numbers that garments take.

use std::fmt::Write;

use drapery_io::materials::{Material, PRESETS};

/// Size of the picture, and of its frame: left, right, top, bottom [px].
const SIZE: [f64; 2] = [760.0, 420.0];
const FRAME: [f64; 4] = [60.0, 580.0, 20.0, 370.0];

/// Largest strain [%] and force [N/m] that are drawn.
const MOST: [f64; 2] = [14.0, 200.0];

/// Points of a curve.
const POINTS: u32 = 60;

const COLOURS: [&str; 10] =
    ["#1c5fa8", "#2f8f4e", "#c0711f", "#b03030", "#8a5fb0", "#5b4636", "#0f8b8d", "#777777", "#c2418a", "#94a000"];

fn place(percent: f64, force: f64) -> [f64; 2] {
    let along = |share: f64, from: f64, to: f64| from + share * (to - from);
    [along(percent / MOST[0], FRAME[0], FRAME[1]), along(force / MOST[1], FRAME[3], FRAME[2])]
}

/// Points of a material's curve, up to its largest strain or the top of the frame.
fn curve(material: &Material) -> String {
    let stiffening = material.curve().ok().flatten();
    let mut points = String::new();
    for step in 0..=POINTS {
        let strain = material.strain_limit * f64::from(step) / f64::from(POINTS);
        let factor = stiffening.as_ref().map_or(1.0, |curve| curve.factor(strain));
        let force = material.stretch_stiffness * strain * factor;
        if force > MOST[1] {
            break;
        }
        let [x, y] = place(100.0 * strain, force);
        // Writing to a String cannot fail.
        let _ = write!(points, "{x:.1},{y:.1} ");
    }
    points.trim_end().to_owned()
}

/// The picture.
pub(crate) fn picture() -> String {
    let [left, right, top, bottom] = FRAME;
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {} {}\" font-family=\"sans-serif\" font-size=\"13\">\n\
         <title>Force by strain of the preset materials</title>\n<rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>\n",
        SIZE[0], SIZE[1]
    );
    for percent in (0..=14).step_by(2) {
        let [x, _] = place(f64::from(percent), 0.0);
        let below = bottom + 18.0;
        let _ = writeln!(
            out,
            "<path d=\"M{x:.1} {top}V{bottom}\" stroke=\"#ddd\"/><text x=\"{x:.1}\" y=\"{below}\" \
             text-anchor=\"middle\">{percent} %</text>"
        );
    }
    for force in (0..=200).step_by(50) {
        let [_, y] = place(0.0, f64::from(force));
        let (before, middle) = (left - 8.0, y + 4.0);
        let _ = writeln!(
            out,
            "<path d=\"M{left} {y:.1}H{right}\" stroke=\"#ddd\"/><text x=\"{before}\" y=\"{middle:.1}\" \
             text-anchor=\"end\">{force}</text>"
        );
    }
    let caption = bottom + 38.0;
    let _ = writeln!(out, "<text x=\"{left}\" y=\"{caption}\">force [N/m] by strain, up to the largest strain</text>");
    for ((material, colour), line) in PRESETS.iter().zip(COLOURS).zip(0_u32..) {
        let (x, y) = (right + 16.0, top + 14.0 + 22.0 * f64::from(line));
        let _ = writeln!(
            out,
            "<polyline points=\"{}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"2\"/>\n<text x=\"{x}\" y=\"{y}\" \
             fill=\"{colour}\">{}</text>",
            curve(material),
            material.name
        );
    }
    out + "</svg>\n"
}
