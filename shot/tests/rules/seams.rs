//! Rules of seams.

use super::{BALL, rule, with, without_file};

#[test]
fn patches_far_from_the_surface_that_they_are_sewn_to_are_told() {
    // Cells of the sheet are 9 cm, so that 5 cm are the limit.
    let patch = |height: &str, keys: &str| {
        with(&format!(
            "[[garment]]\nname = \"patch\"\nmaterial = \"cotton_shirting\"\n\
             panel = {{ resolution = 2, side = 0.2, center = [5, {height}, 0] }}\n\
             [[seam]]\nfrom = {{ garment = \"patch\", corners = [\"i0j0\", \"injn\"] }}\n\
             to = {{ garment = \"sheet\" }}\npairing = \"surface\"\nstrength = 1\n{keys}\n"
        ))
    };
    rule(
        "seam_gap",
        without_file,
        &[
            (
                &patch("1.3", ""),
                &["seam 0: 2 of its 2 vertices of ", "vertex 0 with a gap of 0.300 m, which the seam closes"],
            ),
            (&patch("1.06", "keep_gap = true"), &["a gap of 0.060 m, which the seam keeps"]),
        ],
        &[&patch("1.04", "")],
    );
}

#[test]
fn a_seam_that_gathers_is_told_with_its_line_and_both_lengths() {
    // Two sheets side by side, sewn at edges of 1 m with 13 vertices.
    let zip = |low: &str, keys: &str| {
        let side = |name: &str, low: &str| {
            format!("{{ garment = \"{name}\", where = {{ box = {{ min = [5.84, 0, {low}], max = [5.9, 2, 1] }} }} }}")
        };
        with(&format!(
            "[[garment]]\nname = \"right\"\nmaterial = \"cotton_shirting\"\n\
             panel = {{ resolution = 12, center = [6.742, 1, 0] }}\n\
             [[seam]]\nfrom = {}\nto = {}\nstrength = 1\n{keys}\n",
            side("sheet", "-1"),
            side("right", low)
        ))
    };
    rule(
        "seam_lengths",
        without_file,
        &[(
            &zip("-0.1", "zip = true"),
            &[
                "seam_lengths: scene.toml:15: garment \"sheet\" and garment \"right\", seam 0: the side `from`, 13 vertices of ",
                "garment \"sheet\", is 1.000 m long at rest, and the side `to`, 8 vertices of garment \"right\", is 0.583 m",
                "silence this rule",
                "help: write regions with the same ends",
            ],
        )],
        &[&zip("-1", "zip = true"), &zip("-0.35", "")],
    );
}

#[test]
fn a_button_through_a_body_is_told_with_the_length_and_depth_of_its_way() {
    // A ball of half a metre between two sheets, sewn above and below its centre or beside it.
    let sewn = |height: &str, vertex: &str, keys: &str| {
        with(&format!(
            "{BALL}position = [4.15, {height}, -0.1667]\n[[garment]]\nname = \"lower\"\nmaterial = \"cotton_shirting\"\n\
             panel = {{ resolution = 12, center = [5, 0.4, 0] }}\n[[seam]]\n\
             from = {{ garment = \"sheet\", vertices = [{vertex}] }}\nto = {{ garment = \"lower\", vertices = [{vertex}] }}\n\
             strength = 1\n{keys}\n"
        ))
    };
    let ignore = |garment: &str| format!("[[contact]]\nbetween = [\"{garment}\", \"ball\"]\nignore = true");
    rule(
        "seam_through_body",
        without_file,
        &[(
            &sewn("0.7", "84", ""),
            &[
                "garment \"sheet\" and garment \"lower\", seam 0: 1 of 1 stitches",
                "with body \"ball\" between their ends",
                "from vertex 84 of garment \"sheet\" to garment \"lower\", is inside it over 0.49",
                "up to 0.250 m deep",
            ],
        )],
        &[
            &sewn("0.7", "0", ""),
            &sewn("0.1", "84", ""),
            &sewn("0.7", "84", "keep_gap = true"),
            &sewn("0.7", "84", &ignore("sheet")),
        ],
    );
}
