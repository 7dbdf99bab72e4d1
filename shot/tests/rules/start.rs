//! Rules about the start of the cloth.

use std::path::Path;

use super::{BALL, HERO, SHEET, round_hero, rule, sheets, with, without_file};

#[test]
fn garments_that_start_crossed_are_told_with_how_often_and_where() {
    let second = |center: &str| {
        with(&format!(
            "[[garment]]\nname = \"scarf\"\nmaterial = \"cotton_shirting\"\n\
             panel = {{ resolution = 7, center = {center}, rotation = {{ axis = [1, 0, 0], degrees = 90 }} }}\n"
        ))
    };
    // Three layers of a strip that are closer than an edge, and pushed through each other.
    let folded = with("folds = { layers = 3, gap = 0.01 }\njitter = { axis = \"y\", amplitude = 0.03, seed = 1 }\n")
        .replace("resolution = 12", "resolution = 12, aspect = 3.0");
    rule(
        "start_crossed",
        without_file,
        &[
            (
                &second("[5.013, 1.017, 0.021]"),
                &[
                    "garment \"s",
                    "it intersects garment \"s",
                    " pairs of an edge and a triangle; the first is edge ",
                    "move them apart",
                    "give both a `layer`",
                    "help: write layer = 1 at the inner garment",
                ],
            ),
            (&folded, &["garment \"sheet\": it intersects itself at the start, in ", "unfold it at the start"]),
        ],
        &[
            &second("[5.013, 2.1, 0.021]"),
            &format!("{}[effects]\nwithout = [\"self_collision\"]\n", second("[5.013, 1.017, 0.021]")),
        ],
    );
}

#[test]
fn garments_that_start_partly_inside_a_body_are_told() {
    let at = |height: &str| SHEET.replace("center = [5, 1, 0]", &format!("center = [0, {height}, 0]")) + BALL;
    let inside = [
        "garment \"sheet\", vertex ",
        " of its vertices start inside body \"ball\"; this one is deepest, at ",
        " mm. The body draws them out",
    ];
    rule("start_inside", without_file, &[(&at("0.2"), &inside)], &[&at("0.3")]);
}

#[test]
fn layers_that_contradict_the_model_are_told() {
    let layers = |of_sheet: u32, of_scarf: u32| {
        SHEET.to_owned()
            + &format!(
                "layer = {of_sheet}\n[[garment]]\nname = \"scarf\"\nmaterial = \"cotton_shirting\"\nlayer = {of_scarf}\n\
                 panel = {{ resolution = 12, center = [5, 1.01, 0] }}\n"
            )
    };
    let words = [
        "garment \"scarf\": its `layer` is larger than that of garment \"sheet\", but ",
        " points where they are close lie on the inside",
        "swap the layers, or flip the faces",
    ];
    // Panels look down.
    rule("start_layers", without_file, &[(&layers(1, 2), &words)], &[&layers(2, 1), &layers(1, 1)]);
}

#[test]
fn edges_that_start_far_too_long_or_without_length_are_told() {
    // Heights of the points differ by up to half a metre, where edges are 8 cm long.
    let jittered = |amplitude: &str| with(&format!("jitter = {{ axis = \"y\", amplitude = {amplitude}, seed = 1 }}\n"));
    let poses = |folder: &Path| {
        let write = |name: &str, text: String| std::fs::write(folder.join(name), text).expect("a file");
        let rest = sheets(5, &[(1.0, false)]);
        // The corner has come upon its neighbour.
        write("pose.obj", rest.replace("v 0 1 0\n", "v 0.25 1 0\n"));
        write("small.obj", rest.replace("v 0 1 0\n", "v 0.05 1 0\n"));
        write("rest.obj", rest);
    };
    let from_files = |start: &str| {
        format!(
            "drapery = 1\n[shot]\nframes = \"2-3\"\n[units]\nlength = \"m\"\n[gravity]\n[[garment]]\nname = \"sheet\"\n\
             rest = \"rest.obj\"\nstart = \"{start}\"\nmaterial = \"cotton_shirting\"\n"
        )
    };
    rule(
        "start_lengths",
        poses,
        &[
            (&jittered("0.5"), &[" edges, of which ", " are too long, edge ", " times as long as at rest"]),
            (&from_files("pose.obj"), &["garment \"sheet\": 56 edges, of which 1 have no length at the start"]),
        ],
        &[&jittered("0.05"), &from_files("small.obj"), &from_files("rest.obj")],
    );
}

#[test]
fn a_garment_that_starts_closer_to_a_body_than_its_thickness_is_told_with_both_remedies() {
    // The body is a ball with its top at 0.8 m; the middle of the sheet is above it.
    let over = |height: &str, keys: &str| {
        let sheet = format!("resolution = 4, aspect = 1.0, side = 0.4, center = [0, {height}, 0]");
        SHEET.replace("resolution = 12, center = [5, 1, 0]", &sheet) + &HERO.replace("hero.abc", "hero.obj") + keys
    };
    // The middle of the sheet is 1 mm above a ball. The nine vertices in its middle are a part.
    let on_ball = |keys: &str| {
        let sheet = "resolution = 4, aspect = 1.0, side = 0.4, center = [0, 0.251, 0]";
        let part = "[[garment.part]]\nname = \"middle\"\nwhere = { box = { min = [-0.11, 0, -0.11], max = [0.11, 1, 0.11] } }\n";
        let part = if keys.contains("sheet.middle") { part } else { "" };
        SHEET.replace("resolution = 12, center = [5, 1, 0]", sheet) + part + BALL + keys
    };
    let rule_of = |object: &str, key: &str| format!("[[contact]]\nbetween = [\"{object}\", \"ball\"]\n{key}\n");
    let how = " of its 25 free vertices start closer to body \"hero\" than its thickness of ";
    rule(
        "start_close",
        round_hero,
        &[
            (
                &over("0.801", ""),
                &["garment \"sheet\", vertex 12: ", how, " mm, chosen automatically", "at 1.00 mm", "rule `thin_body`"],
            ),
            (
                &over("0.801", "thickness = \"40 mm\"\n"),
                &[
                    "vertex 12: ",
                    "of 40.00 mm, which the scene sets",
                    "model it at least 40.00 mm off",
                    "help: write thickness = \"",
                    "with silence = [\"thin_body\"] in [check]",
                ],
            ),
            (
                &on_ball("thickness = \"40 mm\"\n"),
                &["start closer to body \"ball\"", "of 40.00 mm, which the scene sets; this one", "rule `thin_body`"],
            ),
            (
                &on_ball(&rule_of("sheet", "thickness = 2")),
                &["vertex 12: 25 of", "2000.00 mm, which its `[[contact]]` sets"],
            ),
            (&on_ball(&rule_of("sheet.middle", "thickness = \"60 mm\"")), &["vertex 12: 9 of", "60.00 mm, which its"]),
        ],
        &[
            &over("1.5", ""),
            &over("0.801", "[[contact]]\nbetween = [\"sheet\", \"hero\"]\nignore = true\n"),
            &on_ball(""),
            &on_ball(&("thickness = \"40 mm\"\n".to_owned() + &rule_of("sheet", "ignore = true"))),
            &on_ball(&("thickness = \"11 mm\"\n".to_owned() + &rule_of("sheet.middle", "ignore = true"))),
        ],
    );
}
