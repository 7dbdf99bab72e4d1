//! Figures of the pages of theory that the solver's own parts compute; a test compares each with the file in `docs/pictures`.

use std::fmt::Write;
use std::path::Path;

/// A figure in SVG.
#[derive(Debug)]
pub(crate) struct Figure {
    text: String,
}

impl Figure {
    /// An empty one of this size [px], on white.
    pub(crate) fn new(title: &str, [width, height]: [f64; 2]) -> Self {
        let text = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" font-family=\"sans-serif\" font-size=\"13\">\n\
             <title>{title}</title>\n<rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>\n"
        );
        Self { text }
    }

    /// A line through these points [px].
    pub(crate) fn line(&mut self, points: &[[f64; 2]], colour: &str, width: f64) {
        let points: Vec<String> = points.iter().map(|[x, y]| format!("{x:.1},{y:.1}")).collect();
        let points = points.join(" ");
        let _ = writeln!(
            self.text,
            "<polyline points=\"{points}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"{width}\"/>"
        );
    }

    /// A filled polygon [px].
    pub(crate) fn polygon(&mut self, points: &[[f64; 2]], colour: &str) {
        let points: Vec<String> = points.iter().map(|[x, y]| format!("{x:.1},{y:.1}")).collect();
        let points = points.join(" ");
        let _ = writeln!(
            self.text,
            "<polygon points=\"{points}\" fill=\"{colour}\" fill-opacity=\"0.3\" stroke=\"{colour}\"/>"
        );
    }

    /// Words at a place [px]; `anchor` is `start`, `middle` or `end`.
    pub(crate) fn words(&mut self, [x, y]: [f64; 2], anchor: &str, colour: &str, words: &str) {
        let _ = writeln!(
            self.text,
            "<text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"{anchor}\" fill=\"{colour}\">{words}</text>"
        );
    }

    /// Fails unless the file of this name in `docs/pictures` is this figure; with `DRAPERY_BLESS` it is written first.
    pub(crate) fn assert_written(self, name: &str) {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/pictures").join(name);
        let text = self.text + "</svg>\n";
        if std::env::var_os("DRAPERY_BLESS").is_some() {
            std::fs::write(&path, &text).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
        }
        let there = std::fs::read_to_string(&path).unwrap_or_default();
        assert!(there == text, "docs/pictures/{name} is out of date\n  help: make figures");
    }
}

/// The axes of a diagram: a frame within a figure, and what its sides stand for.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Axes {
    /// Left, right, top, bottom [px].
    pub(crate) frame: [f64; 4],
    /// Values at the left and right.
    pub(crate) x: [f64; 2],
    /// Values at the bottom and top.
    pub(crate) y: [f64; 2],
}

impl Axes {
    /// Returns the place of a point of the diagram [px].
    pub(crate) fn place(&self, x: f64, y: f64) -> [f64; 2] {
        let [left, right, top, bottom] = self.frame;
        let share = |value: f64, [from, to]: [f64; 2]| (value - from) / (to - from);
        [left + share(x, self.x) * (right - left), bottom - share(y, self.y) * (bottom - top)]
    }

    /// Lines and numbers at values of x, and below them what they are.
    pub(crate) fn mark_x(&self, figure: &mut Figure, marks: &[(f64, &str)], what: &str) {
        for (value, words) in marks {
            figure.line(&[self.place(*value, self.y[0]), self.place(*value, self.y[1])], "#ddd", 1.0);
            let [x, y] = self.place(*value, self.y[0]);
            figure.words([x, y + 18.0], "middle", "#222", words);
        }
        let [left, right, _, bottom] = self.frame;
        figure.words([0.5 * (left + right), bottom + 40.0], "middle", "#222", what);
    }

    /// The same for y, to their left; what they are stands above them.
    pub(crate) fn mark_y(&self, figure: &mut Figure, marks: &[(f64, &str)], what: &str) {
        for (value, words) in marks {
            figure.line(&[self.place(self.x[0], *value), self.place(self.x[1], *value)], "#ddd", 1.0);
            let [x, y] = self.place(self.x[0], *value);
            figure.words([x - 8.0, y + 4.0], "end", "#222", words);
        }
        figure.words([self.frame[0] - 40.0, self.frame[2] - 12.0], "start", "#222", what);
    }

    /// A curve.
    pub(crate) fn curve(&self, figure: &mut Figure, points: &[[f64; 2]], colour: &str) {
        let points: Vec<[f64; 2]> = points.iter().map(|[x, y]| self.place(*x, *y)).collect();
        figure.line(&points, colour, 2.0);
    }
}
