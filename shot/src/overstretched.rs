//! Cloth that is longer than cloth can be, as a run tells of it.

use drapery_core::tolerances::OVERSTRETCHED;

use crate::pinned::MUCH_WORSE;
use crate::run_record::reader::{FrameRow, OverstretchedRow, StrainRow};

/// Says of a frame of a run where cloth is more than twice as long as at rest: for the first time, and where it has become much
/// worse than was `reported`.
pub(super) fn news(reported: &mut f64, frame: &FrameRow) -> Option<String> {
    let OverstretchedRow { most: StrainRow { garment, vertices, strain }, edges, pinched, bodies } =
        frame.overstretched.as_ref()?;
    let &[a, b] = vertices.as_slice() else { return None };
    if *strain <= OVERSTRETCHED.max(MUCH_WORSE * *reported) {
        return None;
    }
    *reported = *strain;
    let names = || bodies.iter().map(|name| format!("\"{name}\"")).collect::<Vec<_>>().join(", ");
    let (why, advice) = match (bodies.is_empty(), *pinched) {
        (true, 0) => (
            String::new(),
            "take shorter steps for fast motion (solver.preset = \"hero\"), or limit the strain with \
             [garment.strain_limit]",
        ),
        (true, pinched) => (
            format!("; {pinched} vertices are pinched between bodies"),
            "leave room for the cloth between the bodies there, or take shorter steps (solver.preset = \"hero\")",
        ),
        (false, pinched) => (
            format!("; {pinched} vertices are pinched, body {} intersects itself", names()),
            "correct the animation there, or take shorter steps (solver.preset = \"hero\")",
        ),
    };
    Some(format!(
        "garment \"{garment}\", frame {}: the edge between vertices {a} and {b} is {:.2} times as long as at rest (strain {strain:.2}), \
         {edges} edges are more than twice as long{why}: {advice}",
        frame.frame,
        1.0 + strain
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(number: i64, strain: f64, pinched: u64, bodies: &[&str]) -> FrameRow {
        let most = StrainRow { garment: "skirt".into(), vertices: vec![7, 9], strain };
        let bodies = bodies.iter().map(|name| (*name).to_owned()).collect();
        let overstretched = Some(OverstretchedRow { most, edges: 3, pinched, bodies });
        FrameRow { frame: number, overstretched, ..FrameRow::default() }
    }

    #[test]
    fn overstretched_cloth_is_named_once_and_again_where_it_is_much_worse() {
        let mut reported = 0.0;
        let first = news(&mut reported, &frame(38, 2.0, 18, &["woman"])).expect("it is new");
        for part in
            ["\"skirt\"", "frame 38", "vertices 7 and 9", "3.00 times", "18 vertices", "\"woman\" intersects itself"]
        {
            assert!(first.contains(part), "{part}: {first}");
        }
        assert_eq!(news(&mut reported, &frame(39, 2.9, 18, &["woman"])), None);
        assert!(news(&mut reported, &frame(40, 4.7, 2, &[])).is_some_and(|text| text.contains("between bodies")));
        assert_eq!(news(&mut reported, &FrameRow::default()), None);
    }
}
