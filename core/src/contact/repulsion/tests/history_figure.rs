//! The figure of the history in `docs/theory/self_contact.md`: a corner that has passed through a triangle.

use super::{LAWS, Passes, Pushed, THICKNESS, scenes};
use crate::testing::{Axes, Figure};

/// Time step [s], and steps that are drawn.
const DT: f64 = 0.01;
const STEPS: usize = 18;

/// Time [s] and height of the corner over the plane of the triangle [thicknesses], which starts at `start` [m] with its side
/// taken 25 mm above, or, without history, where it starts.
fn heights(has_history: bool, start: f64) -> Vec<[f64; 2]> {
    let mut pushed = Pushed::new(&scenes()[0], LAWS);
    pushed.shift(start - 0.025);
    if !has_history {
        pushed.record();
    }
    let height = |pushed: &Pushed| {
        let [a, b, c, corner] = [0, 1, 2, 3].map(|node| pushed.x[node]);
        (b - a).cross(&(c - a)).normalize().dot(&(corner - a)) / THICKNESS
    };
    let mut curve = vec![[0.0, height(&pushed)]];
    for step in 1..=STEPS {
        pushed.step(DT);
        curve.push([step as f64 * DT, height(&pushed)]);
    }
    assert!(pushed.apply(Passes::WithoutSprings, DT).counted("repulsions") < 3);
    curve
}

#[test]
fn the_figure_of_the_history_is_what_repulsion_does() {
    let mut figure = Figure::new("Height of a corner over a triangle, with and without history", [760.0, 380.0]);
    let axes = Axes { frame: [70.0, 740.0, 40.0, 320.0], x: [0.0, STEPS as f64 * DT], y: [-2.0, 2.5] };
    let seconds = [(0.0, "0"), (0.05, "0.05"), (0.1, "0.1"), (0.15, "0.15")];
    axes.mark_x(&mut figure, &seconds, "time [s]");
    let heights_of = [(-1.0, "−H"), (0.0, "0"), (1.0, "H"), (2.0, "2 H")];
    axes.mark_y(&mut figure, &heights_of, "height of the corner over the triangle, on the side that it belongs on");
    figure.line(&[axes.place(0.0, 0.0), axes.place(axes.x[1], 0.0)], "#444", 1.0);
    let above = heights(true, 0.025);
    let back = heights(true, -0.5 * THICKNESS);
    let lost = heights(false, -0.5 * THICKNESS);
    for (curve, colour, words, x, y) in [
        (&above, "#2f8f4e", "starts above", axes.x[1], 1.1),
        (&back, "#1c5fa8", "has passed through: pulled back", 0.14, 2.2),
        (&lost, "#b03030", "has passed through, without history: pushed on", axes.x[1], -0.8),
    ] {
        axes.curve(&mut figure, curve, colour);
        figure.words(axes.place(x, y), "end", colour, words);
    }
    let last = |curve: &[[f64; 2]]| curve[STEPS][1];
    assert!(last(&above) > 0.9 && last(&back) > 0.9 && last(&lost) < -0.9);
    figure.assert_written("repulsion_history.svg");
}
