//! Runs the commands of the tour's pages and of the how-to pages, and looks for the lines that the pages show.
//!
//! Rules by which a page is read:
//!
//! * A fenced block with the info string `sh run` holds commands, one a line (a line that ends with `\` goes on in the next
//!   one). Each begins with `drapery`, `mpirun … drapery` or `drapery-assets`, is run without a shell, and has to succeed. All commands of a page
//!   run in one temporary folder that holds a copy of `sample_assets/scenes` and `sample_assets/howto`. The how-to pages share
//!   one, in which `drapery-assets` makes the same files once.
//! * A fenced block with the info string `text expect` holds lines that the commands of the last `sh run` block have to
//!   print, in this order; others may stand between them. `…` in a line stands for anything.
//! * A fenced block with the info string `toml scene PATH` is the scene at that path, but for comments and empty lines.
//! * Other blocks are for reading.
//!
//! The programs are those that the environment variables `DRAPERY` and `DRAPERY_ASSETS` name, or those beside this test's
//! own executable; if there are none, the test says so and ends.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::Command;

/// The pages of the tour, in `docs/start`.
const PAGES: [&str; 4] = ["first_run", "cloth_on_a_ball", "dressed_character", "stop_and_continue"];

/// Something that a page asks for.
#[derive(Debug, PartialEq, Eq)]
enum Block {
    /// Commands to run.
    Run(Vec<String>),
    /// Lines that they print.
    Expect(Vec<String>),
    /// A scene file and its lines.
    Scene(String, Vec<String>),
}

/// The blocks of a page in their order.
fn blocks(page: &str) -> Vec<Block> {
    let mut found = Vec::new();
    let mut lines = page.lines();
    while let Some(line) = lines.next() {
        let Some(info) = line.strip_prefix("```") else { continue };
        let inside: Vec<String> = lines.by_ref().take_while(|l| !l.starts_with("```")).map(str::to_owned).collect();
        match (info.trim(), info.trim().strip_prefix("toml scene ")) {
            ("sh run", _) => found.push(Block::Run(joined(&inside))),
            ("text expect", _) => found.push(Block::Expect(inside)),
            (_, Some(path)) => found.push(Block::Scene(path.to_owned(), without_comments(&inside.join("\n")))),
            _ => {}
        }
    }
    found
}

/// The lines of a scene without comments, empty lines and spare blanks. No text of a sample scene holds a `#`.
fn without_comments(scene: &str) -> Vec<String> {
    let code = |line: &str| line.split('#').next().unwrap_or_default().split_whitespace().collect::<Vec<_>>().join(" ");
    scene.lines().map(code).filter(|line| !line.is_empty()).collect()
}

/// Lines that end with a backslash joined with the next.
fn joined(lines: &[String]) -> Vec<String> {
    let mut commands: Vec<String> = Vec::new();
    let mut goes_on = false;
    for line in lines.iter().filter(|line| !line.trim().is_empty()) {
        let (text, more) = line.trim().strip_suffix('\\').map_or((line.trim(), false), |t| (t.trim_end(), true));
        match commands.last_mut().filter(|_| goes_on) {
            Some(command) => *command += &format!(" {text}"),
            None => commands.push(text.to_owned()),
        }
        goes_on = more;
    }
    commands
}

/// Whether a printed line is what a page shows.
fn fits(shown: &str, printed: &str) -> bool {
    let shown = shown.trim_end();
    let mut pieces = shown.split('…');
    let Some(mut rest) = pieces.next().and_then(|first| printed.trim_end().strip_prefix(first)) else { return false };
    let pieces: Vec<&str> = pieces.collect();
    let Some((last, middle)) = pieces.split_last() else { return rest.is_empty() };
    for piece in middle {
        let Some(at) = rest.find(piece) else { return false };
        rest = &rest[at + piece.len()..];
    }
    rest.ends_with(last)
}

/// The first shown line that is not printed after the ones before it.
fn missing<'a>(shown: &'a [String], printed: &str) -> Option<&'a str> {
    let mut lines = printed.lines();
    shown.iter().find(|line| !lines.any(|p| fits(line, p))).map(String::as_str)
}

fn root() -> &'static Path {
    // The manifest's folder has a parent: it is a member of the workspace.
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("the tests live in a folder of the project")
}

/// A program of the workspace.
fn program(variable: &str, name: &str) -> Option<PathBuf> {
    if let Some(path) = std::env::var_os(variable).map(PathBuf::from).filter(|path| path.is_file()) {
        return Some(path);
    }
    // target/PROFILE/deps/tour-… lies beside target/PROFILE/drapery.
    let folder = std::env::current_exe().ok()?.parent()?.parent()?.to_owned();
    let path = folder.join(format!("{name}{}", std::env::consts::EXE_SUFFIX));
    path.is_file().then_some(path)
}

/// Runs one command; returns what it printed.
fn run(command: &str, folder: &Path) -> Result<String, String> {
    let (launcher, command) = match command.split_once(" drapery ") {
        Some((launcher, arguments)) if launcher.starts_with("mpirun ") => (launcher, format!("drapery {arguments}")),
        _ => ("", command.to_owned()),
    };
    let mut words = command.split_whitespace();
    let program = match words.next() {
        Some("drapery") => program("DRAPERY", "drapery"),
        Some("drapery-assets") => program("DRAPERY_ASSETS", "drapery-assets"),
        other => panic!("the tour runs drapery, also by mpirun, and drapery-assets only, not {other:?}"),
    };
    let program = program.ok_or("it has not been built")?;
    let mut line: Vec<&OsStr> = launcher.split_whitespace().map(OsStr::new).collect();
    line.push(program.as_os_str());
    let mut command = Command::new(line[0]);
    command.args(&line[1..]).args(words).current_dir(folder).env_remove("DRAPERY_PROGRESS");
    // Open MPI asks before it starts as root, as in a container.
    command.env("OMPI_ALLOW_RUN_AS_ROOT", "1").env("OMPI_ALLOW_RUN_AS_ROOT_CONFIRM", "1");
    let output = command.output();
    let output = output.map_err(|e| e.to_string())?;
    let printed = format!("{}{}", String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    if output.status.success() { Ok(printed) } else { Err(format!("{}\n{printed}", output.status)) }
}

/// Copies the sample scenes, which name their files relative to themselves.
fn copy_scenes(folder: &Path) {
    for scenes in ["sample_assets/scenes", "sample_assets/howto"] {
        let to = folder.join(scenes);
        std::fs::create_dir_all(&to).expect("the temporary folder can be written");
        for entry in std::fs::read_dir(root().join(scenes)).expect("there are sample scenes").flatten() {
            std::fs::copy(entry.path(), to.join(entry.file_name())).expect("the temporary folder can be written");
        }
    }
}

/// Whether the programs are there; says so if they are not.
fn are_built() -> bool {
    let built = program("DRAPERY", "drapery").is_some() && program("DRAPERY_ASSETS", "drapery-assets").is_some();
    if !built {
        println!("skipped: drapery and drapery-assets have not been built");
    }
    built
}

/// Runs a page of the tour.
fn follow(name: &str) {
    if are_built() {
        let folder = tempfile::tempdir().expect("there is a temporary folder");
        copy_scenes(folder.path());
        follow_in(folder.path(), &format!("docs/start/{name}.md"), &mut Vec::new());
    }
}

/// Runs a page in a folder where `made` says which files of `drapery-assets` are there.
fn follow_in(folder: &Path, name: &str, made: &mut Vec<String>) {
    let page = std::fs::read_to_string(root().join(name)).expect("the page is there");
    let mut printed = String::new();
    for block in blocks(&page) {
        match block {
            Block::Run(commands) => {
                printed.clear();
                for command in commands {
                    if made.contains(&command) {
                        continue;
                    }
                    printed += &run(&command, folder).unwrap_or_else(|e| panic!("{name}: {command}: {e}"));
                    if command.starts_with("drapery-assets") {
                        made.push(command);
                    }
                }
            }
            Block::Expect(shown) => {
                if let Some(line) = missing(&shown, &printed) {
                    panic!("{name}: not printed, or not in this place: {line}\nprinted:\n{printed}");
                }
            }
            Block::Scene(path, shown) => {
                let scene =
                    std::fs::read_to_string(root().join(&path)).unwrap_or_else(|e| panic!("{name}: {path}: {e}"));
                assert_eq!(without_comments(&scene), shown, "{name}: {path} has changed");
            }
        }
    }
}

#[test]
fn the_page_of_the_hanging_sheet_tells_the_truth() {
    follow(PAGES[0]);
}

#[test]
fn the_page_of_cloth_on_a_ball_tells_the_truth() {
    follow(PAGES[1]);
}

#[test]
fn the_page_of_the_dressed_character_tells_the_truth() {
    follow(PAGES[2]);
}

#[test]
fn the_page_of_stopping_and_continuing_tells_the_truth() {
    follow(PAGES[3]);
}

/// Names of how-to pages without a scene that this test runs: another test does, or they ask for programs that are not here.
const HOWTO_ELSEWHERE: [&str; 3] = ["README", "blender", "from_python"];

#[test]
fn the_scenes_of_the_how_to_pages_run() {
    let pages = pages_in("docs/howto").into_iter().filter(|page| !HOWTO_ELSEWHERE.contains(&page.as_str()));
    let folder = tempfile::tempdir().expect("there is a temporary folder");
    copy_scenes(folder.path());
    let mut made = Vec::new();
    for page in pages {
        let name = format!("docs/howto/{page}.md");
        let text = std::fs::read_to_string(root().join(&name)).expect("the page is there");
        assert!(blocks(&text).iter().any(|block| matches!(block, Block::Run(_))), "{name} runs nothing");
        if are_built() {
            follow_in(folder.path(), &name, &mut made);
        }
    }
}

#[test]
fn every_how_to_scene_is_on_a_page() {
    let pages: String = pages_in("docs/howto")
        .iter()
        .map(|page| std::fs::read_to_string(root().join(format!("docs/howto/{page}.md"))).expect("a page"))
        .collect();
    for entry in std::fs::read_dir(root().join("sample_assets/howto")).expect("there are scenes").flatten() {
        let name = entry.file_name().to_string_lossy().into_owned();
        assert!(!name.ends_with(".toml") || pages.contains(&format!("sample_assets/howto/{name}")), "{name}");
    }
}

/// The names of the pages in a folder, sorted.
fn pages_in(folder: &str) -> Vec<String> {
    let files = std::fs::read_dir(root().join(folder)).expect("there are pages").flatten().map(|entry| entry.path());
    let pages = files.filter(|path| path.extension().is_some_and(|ending| ending == "md"));
    let mut names: Vec<String> =
        pages.filter_map(|path| path.file_stem().map(|stem| stem.to_string_lossy().into_owned())).collect();
    names.sort();
    names
}

#[test]
fn every_page_of_the_tour_is_followed() {
    // These build the program, and speak of the reader's own files.
    let others = ["install", "load_caches", "your_character"];
    let mut there = pages_in("docs/start");
    there.retain(|page| !others.contains(&page.as_str()));
    let mut followed = PAGES.map(str::to_owned).to_vec();
    followed.sort();
    assert_eq!(there, followed);
}

#[test]
fn a_page_is_read_as_the_convention_says() {
    let page = "a\n```sh run\ndrapery x \\\n  y\ndrapery z\n```\n```text expect\n1 … 3\n```\n```sh\nls\n```\n";
    let run = Block::Run(vec!["drapery x y".to_owned(), "drapery z".to_owned()]);
    assert_eq!(blocks(page), [run, Block::Expect(vec!["1 … 3".to_owned()])]);
    assert!(fits("1 … 3", "1 2 3") && fits("…3", "1 2 3") && fits("1 2 3", "1 2 3  ") && !fits("1 2", "1 2 3"));
    assert!(!fits("1 … 4", "1 2 3"));
    let shown = ["b".to_owned(), "a".to_owned()];
    assert_eq!(missing(&shown, "a\nb\n"), Some("a"));
}
