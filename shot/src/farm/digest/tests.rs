use super::*;
use std::fs;

const VERSIONS: Versions<'static> =
    Versions { solver: 3, integrator: "semi_implicit", format: 1, application: "Drapery 0.1.0" };

const SCENE_TEXT: &str = r#"
drapery = 1
[shot]
frames = "-10-20"   # scene
name = "skirt"      # default
[gravity]
acceleration = [0, -9.8, 0.0]
[[garment]]
name = "skirt"
file = "FOLDER/skirt.obj@3"
[garment.stretch]
stiffness = 40
[[garment.pin]]
nodes = [[0, 1], [2, 3]]
[output]
format = ["abc"]
velocities = true
"#;

/// A folder with the scene's input.
fn folder(content: &str) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("skirt.obj"), content).unwrap();
    folder
}

/// Computes the fingerprint of the scene with one text replaced by another.
fn fingerprint(folder: &tempfile::TempDir, replaced: &str, by: &str) -> Fingerprint {
    assert!(SCENE_TEXT.contains(replaced), "{replaced}");
    let text = SCENE_TEXT.replace(replaced, by).replace("FOLDER", &folder.path().display().to_string());
    let scene_path = folder.path().join("scene.toml");
    let inputs = [scene_path.clone(), folder.path().join("skirt.obj")];
    Fingerprint::of(&text, &scene_path, &inputs, VERSIONS).unwrap()
}

fn changes(replaced: &str, by: &str) -> Changes {
    let folder = folder("v 0 0 0");
    compare(&fingerprint(&folder, "[shot]", "[shot]"), &fingerprint(&folder, replaced, by))
}

fn only_allowed(text: &str) -> Changes {
    Changes { allowed: vec![text.to_owned()], forbidden: Vec::new() }
}

fn only_forbidden(text: &str) -> Changes {
    Changes { allowed: Vec::new(), forbidden: vec![text.to_owned()] }
}

#[test]
fn comments_order_and_spelling_of_numbers_are_no_changes() {
    assert_eq!(changes("stiffness = 40", "stiffness = 40.0  # as before"), Changes::default());
    assert_eq!(changes("[0, -9.8, 0.0]", "[ 0.0, -9.8, 0 ]"), Changes::default());
    assert_eq!(changes("velocities = true\n", "velocities = true\n\n"), Changes::default());
    // Nor is what a scene wants to be warned of.
    assert_eq!(changes("[gravity]", "[check]\nsilence = [\"frame_rate\"]\n[gravity]"), Changes::default());
    let swapped = "name = \"skirt\"\nfile = \"FOLDER/skirt.obj@3\"";
    assert_eq!(changes(swapped, "file = \"FOLDER/skirt.obj@3\"\nname = \"skirt\""), Changes::default());
}

#[test]
fn a_default_of_the_output_that_is_written_is_no_change() {
    for line in ["shutter = [-0.25, 0.25]", "samples = 1", "preroll = false", "usd_single = false"] {
        assert_eq!(changes("velocities = true", &format!("velocities = true\n{line}")), Changes::default(), "{line}");
    }
    let other = changes("velocities = true", "velocities = true\nshutter = [-0.5, 0.25]");
    assert_eq!(other, only_forbidden("output.shutter (nothing) -> [-0.5, 0.25]"));
    let single = changes("velocities = true", "velocities = true\nusd_single = true");
    assert_eq!(single, only_allowed("output.usd_single (nothing) -> true"));
    let faces = changes("velocities = true", "velocities = true\nfaces = \"triangles\"");
    assert_eq!(faces, only_allowed("output.faces (nothing) -> \"triangles\""));
}

#[test]
fn the_end_of_the_range_the_output_and_the_name_may_change() {
    assert_eq!(changes("-10-20", "-10-30"), only_allowed("shot.last_frame 20 -> 30"));
    assert_eq!(changes("velocities = true", "velocities = false"), only_allowed("output.velocities true -> false"));
    assert_eq!(changes("[\"abc\"]", "[\"h5\"]"), only_allowed("output.format [\"abc\"] -> [\"h5\"]"));
    let renamed = changes("name = \"skirt\"      # default", "name = \"dress\"");
    assert_eq!(renamed, only_allowed("shot.name \"skirt\" -> \"dress\""));
}

#[test]
fn allowed_changes_keep_the_digest_of_the_scene() {
    let folder = folder("v 0 0 0");
    let digest = |replaced, by| fingerprint(&folder, replaced, by).digests[SCENE].clone();
    let before = digest("[shot]", "[shot]");
    assert_eq!(before, digest("-10-20", "-10-30"));
    assert_eq!(before, digest("velocities = true", "velocities = false"));
    assert_ne!(before, digest("-10-20", "-11-20"));
    assert_ne!(before, digest("stiffness = 40", "stiffness = 41"));
}

#[test]
fn a_change_of_physics_is_named_with_its_place() {
    let stiffness = changes("stiffness = 40", "stiffness = 50");
    assert_eq!(stiffness, only_forbidden("garment[0].stretch.stiffness 40 -> 50"));
    assert_eq!(changes("-10-20", "-9-20"), only_forbidden("shot.first_frame -10 -> -9"));
    let added = changes("stiffness = 40", "stiffness = 40\ndamping = 0.1");
    assert_eq!(added, only_forbidden("garment[0].stretch.damping (nothing) -> 0.1"));
    assert_eq!(changes("[2, 3]]", "[2, 4]]").forbidden.len(), 1);
    assert_eq!(changes("skirt.obj@3", "skirt.obj@4").forbidden.len(), 1);
    let effect = changes("[gravity]", "[wind]");
    assert_eq!(effect.forbidden.len(), 2, "{effect:?}");
}

#[test]
fn a_changed_input_is_found_by_its_content() {
    let folder = folder("v 0 0 0");
    let before = fingerprint(&folder, "[shot]", "[shot]");
    // The same content written again is the same input.
    fs::write(folder.path().join("skirt.obj"), "v 0 0 0").unwrap();
    assert_eq!(compare(&before, &fingerprint(&folder, "[shot]", "[shot]")), Changes::default());
    fs::write(folder.path().join("skirt.obj"), "v 0 0 1").unwrap();
    let changed = compare(&before, &fingerprint(&folder, "[shot]", "[shot]"));
    let input = folder.path().join("skirt.obj");
    assert_eq!(changed, only_forbidden(&format!("input {} has changed", input.display())));
}

#[test]
fn inputs_may_be_moved_to_another_folder() {
    let (here, there, other) = (folder("v 0 0 0"), folder("v 0 0 0"), folder("v 1 0 0"));
    let [here, there, other] = [here, there, other].map(|folder| fingerprint(&folder, "[shot]", "[shot]"));
    let moved = compare(&here, &there);
    assert!(moved.forbidden.is_empty() && moved.allowed.len() == 1, "{moved:?}");
    assert!(moved.allowed[0].starts_with("garment[0].file ") && moved.allowed[0].contains("same content"));
    assert_eq!(here.digests[SCENE], there.digests[SCENE]);
    let another = compare(&here, &other);
    assert!(another.allowed.is_empty() && another.forbidden.len() == 1, "{another:?}");
}

#[test]
fn versions_of_solver_and_checkpoints_count_and_that_of_the_program_does_not() {
    let folder = folder("v 0 0 0");
    let before = fingerprint(&folder, "[shot]", "[shot]");
    let with = |name: &str, value: &str| {
        let mut after = before.clone();
        after.digests.insert(name.to_owned(), value.to_owned());
        compare(&before, &after)
    };
    assert_eq!(with("solver", "4"), only_forbidden("version of the solver 3 -> 4"));
    assert_eq!(with("format", "2"), only_forbidden("version of checkpoints 1 -> 2"));
    assert_eq!(with("application", "Drapery 0.2.0"), only_allowed("program Drapery 0.1.0 -> Drapery 0.2.0"));
}

#[test]
fn digests_alone_show_that_something_has_changed() {
    let folder = folder("v 0 0 0");
    let bare = |replaced, by| Fingerprint { scene: BTreeMap::new(), ..fingerprint(&folder, replaced, by) };
    let before = bare("[shot]", "[shot]");
    assert_eq!(compare(&before, &bare("-10-20", "-10-30")), Changes::default());
    assert_eq!(compare(&before, &bare("= 40", "= 50")), only_forbidden("the scene has changed"));
}

#[test]
fn a_digest_is_sha_256_of_all_bytes() {
    let folder = folder("abc");
    // The example of the standard, FIPS 180-4.
    let expected = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
    let name = folder.path().join("skirt.obj");
    assert_eq!(content_digest(&name).unwrap(), expected);
    // More than one block; the digest as `sha256sum` prints it for a million times "a" (FIPS 180-4, too).
    fs::write(&name, "a".repeat(1_000_000)).unwrap();
    let expected = "cdc76e5c9914fb9281a1c7e284d73e67f1809a48a497200e046d39ccc7112cd0";
    assert_eq!(content_digest(&name).unwrap(), expected);
}

#[test]
fn a_missing_input_is_named() {
    let error = Fingerprint::of("", Path::new("s.toml"), &["nowhere.abc".into()], VERSIONS).unwrap_err();
    assert!(matches!(error, IoError::Missing { .. }) && error.to_string().contains("nowhere.abc"), "{error}");
}

#[test]
#[ignore = "measures: prints MB/s"]
fn speed_of_content_digests() {
    let folder = tempfile::tempdir().unwrap();
    let name = folder.path().join("large");
    fs::write(&name, vec![7; 1 << 29]).unwrap();
    let start = std::time::Instant::now();
    content_digest(&name).unwrap();
    let seconds = start.elapsed().as_secs_f64();
    eprintln!("{:.0} MB/s", f64::from(1 << 29) / seconds / 1.0e6);
}

/// A scene with a table of every kind, and what a run of it depended on at commit 336fa90, before some keys of today.
const EVERY_TABLE: &str = include_str!("every_table.toml");
const OF_EARLIER_PROGRAM: &str = include_str!("every_table.json");

/// Computes the fingerprint of the scene with a table of every kind, with these lines in the place of one.
fn of_every_table(line: &str, by: &str) -> Fingerprint {
    assert!(EVERY_TABLE.contains(line), "{line}");
    let text = EVERY_TABLE.replacen(line, by, 1);
    let scene = drapery_io::scene_file::parse(&text, "every_table.toml", Path::new(""), &[]).unwrap();
    let resolved = scene.resolve().unwrap().resolved;
    Fingerprint::of(&resolved, Path::new("every_table.toml"), &[], VERSIONS).unwrap()
}

#[test]
fn a_run_of_an_earlier_program_goes_on_and_its_checkpoints_have_the_same_digest() {
    let earlier: Fingerprint = serde_json::from_str(OF_EARLIER_PROGRAM).unwrap();
    let now = of_every_table("[gravity]", "[gravity]");
    assert_eq!(compare(&earlier, &now), Changes::default());
    // A new key with a default belongs into `YOUNGER`.
    assert_eq!(earlier.digests[SCENE], now.digests[SCENE]);
    assert_ne!(earlier.scene, now.scene);
}

#[test]
fn the_integrator_that_was_taken_stands_in_the_place_of_auto() {
    let of = |word: &str, taken: &str| {
        let resolved = format!("[solver]\nintegrator = \"{word}\"\n");
        let versions = Versions { integrator: taken, ..VERSIONS };
        Fingerprint::of(&resolved, Path::new("s.toml"), &[], versions).unwrap()
    };
    assert_eq!(of("auto", "tr_bdf2"), of("tr_bdf2", "tr_bdf2"));
    let changed = compare(&of("semi_implicit", "semi_implicit"), &of("auto", "tr_bdf2"));
    assert_eq!(changed, only_forbidden("solver.integrator \"semi_implicit\" -> \"tr_bdf2\""));
    // One that may change between frames is neither.
    let changed = compare(&of("tr_bdf2", "tr_bdf2"), &of("auto", "auto"));
    assert_eq!(changed, only_forbidden("solver.integrator \"tr_bdf2\" -> \"auto\""));
}

#[test]
fn a_key_that_only_one_program_knows_is_no_change_at_its_default_in_every_table() {
    let now = of_every_table("[gravity]", "[gravity]");
    let mut seen = 0;
    let defaults = Defaults::default();
    for (key, value) in &now.scene {
        let Some(default) = defaults.of(key).filter(|default| text(default) == *value) else { continue };
        // What keeps the table there, if anything else does.
        let table = key.rsplit_once('.').unwrap().0;
        let is_alone = now.scene.keys().filter(|other| other.starts_with(&format!("{table}."))).count() == 1;
        if is_alone && !defaults.is_always_there(table) {
            continue;
        }
        let (mut earlier, mut other) = (now.clone(), now.clone());
        earlier.scene.remove(key);
        earlier.digests.insert(SCENE.to_owned(), "another".to_owned());
        assert_eq!(compare(&earlier, &now), Changes::default(), "{key} = {default}");
        assert_eq!(compare(&now, &earlier), Changes::default(), "{key} = {default}");
        other.scene.insert(key.clone(), "\"something else\"".to_owned());
        let changed = compare(&earlier, &other);
        let named =
            [&changed.forbidden, &changed.allowed].into_iter().flatten().filter(|text| text.starts_with(key.as_str()));
        assert_eq!(named.count(), 1, "{key}: {changed:?}");
        seen += 1;
    }
    assert!(seen > 40, "{seen}");
    // Where nothing explains other digests, something else has changed.
    let mut other = now.clone();
    other.digests.insert(SCENE.to_owned(), "another".to_owned());
    assert_eq!(compare(&other, &now), only_forbidden("the scene has changed"));
}

#[test]
fn a_default_that_is_written_is_no_change_and_an_effect_with_defaults_alone_is_one() {
    let earlier: Fingerprint = serde_json::from_str(OF_EARLIER_PROGRAM).unwrap();
    let said = of_every_table("[gravity]", "[solver]\nsteps_per_frame = 8\n[gravity]");
    assert_eq!(compare(&earlier, &said), Changes::default());
    let other = of_every_table("[gravity]", "[solver]\nstrain_per_step = 0.2\n[gravity]");
    assert_eq!(compare(&earlier, &other), only_forbidden("solver.strain_per_step 0.1 -> 0.2"));
    let without = of_every_table("[self_collision]", "");
    let added = compare(&without, &of_every_table("[gravity]", "[gravity]"));
    assert!(added.forbidden.iter().any(|change| change.starts_with("self_collision.")), "{added:?}");
}
