//! Rules about units of files.

use std::path::Path;

use super::{BALL, HERO, hero, rule, sheets};

#[test]
fn a_garment_in_a_wrong_unit_is_told_whether_or_not_the_body_states_its_own() {
    // The body ends above the garment as it is read, so that neither is inside the other.
    let files = |folder: &Path| {
        hero(folder, [[-0.8, 0.5, -0.15], [0.8, 2.2, 0.15]], 24.0, true);
        let write = |name: &str, text: String| std::fs::write(folder.join(name), text).expect("a file");
        write("metres.obj", sheets(5, &[(1.0, false)]));
        // A patch of 3 cm in front of the body, in centimetres.
        write("patch.obj", "v 0 160 100\nv 0 163 100\nv 3 163 100\nv 3 160 100\nf 1 2 3 4\n".to_owned());
    };
    let scene = |file: &str, unit: &str| {
        format!(
            "drapery = 1\n[shot]\nframes = \"2-3\"\n[gravity]\n{HERO}[[garment]]\nname = \"shirt\"\nrest = \"{file}\"\n\
             units = {{ length = \"{unit}\", up = \"Y\" }}\nmaterial = \"cotton_shirting\"\n"
        )
    };
    rule(
        "garment_units",
        files,
        &[(
            &scene("metres.obj", "cm"),
            &[
                "garment \"shirt\": its bounding box has a diagonal of 1.41e-2 m when read in centimetres, Y up",
                "body \"hero\" one of 2.35",
                "In metres the garment would",
                "help: write length = \"m\" in [units], or units = { length = \"m\", up = \"Y\" }",
            ],
        )],
        &[&scene("patch.obj", "cm")],
    );
}

#[test]
fn a_garment_in_a_wrong_unit_is_told_by_a_ball_and_not_by_ground() {
    let files = |folder: &Path| {
        let write = |name: &str, text: String| std::fs::write(folder.join(name), text).expect("a file");
        write("metres.obj", sheets(5, &[(1.0, false)]));
    };
    let scene = |body: &str, unit: &str| {
        format!(
            "drapery = 1\n[shot]\nframes = \"2-3\"\n[gravity]\n{body}[[garment]]\nname = \"shirt\"\nrest = \"metres.obj\"\n\
             units = {{ length = \"{unit}\", up = \"Y\" }}\nmaterial = \"cotton_shirting\"\n"
        )
    };
    let ball = format!("{BALL}position = [0.5, 1.2, 0.5]\n");
    let floor =
        "[[body]]\nname = \"floor\"\nshape = { box = { half_extents = [20, 0.1, 20] } }\nposition = [0, -1, 0]\n";
    rule(
        "garment_units",
        files,
        &[(&scene(&ball, "cm"), &["body \"ball\" one of 0.866 m", "In metres the garment would", "length = \"m\""])],
        &[&scene(floor, "cm")],
    );
}
