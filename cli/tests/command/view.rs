//! `view` on a tiny run: answers to the page, what becomes of a run that is deleted, written pages, bad input.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::path::Path;
use std::process::{Child, Stdio};
use std::time::SystemTime;

use drapery_analysis::view::{LARGEST_PAGE, has_library};
use drapery_io::cache_frames::CacheFrames;
use drapery_selftest::files::SHEET;
use drapery_shot::farm::lock::RunLock;
use drapery_shot::farm::process::Owner;
use serde_json::Value;

use crate::{command, drapery, folder_with};

/// The page of a run, served until the test ends.
struct Served {
    process: Child,
    port: u16,
}

impl Drop for Served {
    fn drop(&mut self) {
        self.process.kill().expect("the page ends");
        self.process.wait().expect("it has ended");
    }
}

impl Served {
    fn start(folder: &Path) -> Self {
        Self::start_while(folder, || panic!("a run is there"))
    }

    /// The same, with something that happens while it waits for a run.
    fn start_while(folder: &Path, waits: impl FnOnce()) -> Self {
        let mut process =
            command(folder, &["view", "out", "--no-browser"]).stdout(Stdio::piped()).spawn().expect("it starts");
        let mut lines = BufReader::new(process.stdout.take().expect("its output")).lines();
        let mut line = || lines.next().expect("a line").expect("text");
        let mut address = line();
        if address.starts_with("waiting for a run") {
            waits();
            address = line();
        }
        let port = address.strip_prefix("http://127.0.0.1:").and_then(|rest| rest.split('/').next());
        let port = port.and_then(|port| port.parse().ok()).unwrap_or_else(|| panic!("no address: {address}"));
        Self { process, port }
    }

    /// Status and body of an answer.
    fn ask(&self, request: &str, host: &str) -> (u16, Vec<u8>) {
        let mut stream = TcpStream::connect(("127.0.0.1", self.port)).expect("somebody listens");
        write!(stream, "{request} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n").expect("it hears");
        let mut answer = Vec::new();
        stream.read_to_end(&mut answer).expect("it answers");
        let end = answer.windows(4).position(|part| part == b"\r\n\r\n").expect("a header");
        let status = String::from_utf8_lossy(&answer[9..12]).parse().expect("a status");
        (status, answer.split_off(end + 4))
    }

    fn get(&self, path: &str) -> (u16, Vec<u8>) {
        self.ask(&format!("GET /{path}"), &format!("127.0.0.1:{}", self.port))
    }

    fn state(&self) -> Value {
        let (status, body) = self.get("run.json");
        assert_eq!(status, 200, "{}", String::from_utf8_lossy(&body));
        serde_json::from_slice(&body).expect("JSON")
    }

    /// An array of 32-bit numbers.
    fn numbers(&self, path: &str) -> Vec<f32> {
        let (status, body) = self.get(path);
        assert_eq!(status, 200, "{path}: {}", String::from_utf8_lossy(&body));
        let words: Vec<[u8; 4]> = body.chunks(4).map(|word| word.try_into().expect("whole words")).collect();
        assert_eq!(u32::from_le_bytes(words[0]), 0, "full precision");
        assert_eq!(words.len(), 3 + (u32::from_le_bytes(words[1]) * u32::from_le_bytes(words[2])) as usize);
        words[3..].iter().map(|word| f32::from_le_bytes(*word)).collect()
    }
}

/// A sheet beside a ball, after its run; `None` in a build without the library of the page, where `view` says how to get it.
fn after_a_run() -> Option<tempfile::TempDir> {
    let folder = folder_with(SHEET);
    let run = drapery(folder.path(), &["run", "scene.toml", "--out", "out", "-q"]);
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    if has_library() {
        return Some(folder);
    }
    for arguments in [&["view", "out"][..], &["view", "out", "--page", "page.html"]] {
        let refused = drapery(folder.path(), arguments);
        assert_eq!(refused.code, Some(2), "{}", refused.stderr);
        assert!(refused.stderr.contains("analysis/viewer/library/build.sh"), "{}", refused.stderr);
    }
    None
}

#[test]
fn the_page_gets_the_points_of_the_cache_and_the_strains_of_the_record() {
    let Some(folder) = after_a_run() else { return };
    let served = Served::start(folder.path());
    let (status, page) = served.get("");
    let page = String::from_utf8(page).expect("text");
    assert!(status == 200 && page.contains("three.js") && page.contains("<canvas") && !page.contains("{{"), "{status}");
    for outside in ["src=", "@import", "url(", "<link"] {
        assert!(!page.replace("three.js", "").split("<script>var").next().unwrap_or("").contains(outside), "{outside}");
    }
    let state = served.state();
    assert_eq!(state["frames"], serde_json::json!([1001, 1002, 1003, 1004]), "{state}");
    assert_eq!((state["state"].as_str(), state["reason"].as_str()), (Some("done"), Some("done")));
    let objects = state["objects"].as_array().expect("objects");
    let names: Vec<_> = objects.iter().map(|object| (object["name"].as_str(), object["kind"].as_str())).collect();
    assert_eq!(names, [(Some("sheet"), Some("cloth")), (Some("ball"), Some("body"))]);

    let cache = CacheFrames::open(&folder.path().join("out/sheet.abc")).expect("a cache");
    let record = std::fs::read_to_string(folder.path().join("out/run.jsonl")).expect("a record");
    for (sample, frame) in (1001..=1004).enumerate() {
        let points = served.numbers(&format!("object/0/frame/{frame}/points"));
        let stored: Vec<f32> =
            cache.positions(0, sample).expect("a frame").iter().flat_map(|p| p.map(|x| x as f32).data.0[0]).collect();
        assert_eq!(points, stored, "frame {frame}");
        let row = record.lines().map(|line| serde_json::from_str::<Value>(line).expect("JSON"));
        let row = row.filter(|row| row["record"] == "frame").find(|row| row["frame"] == frame);
        let strains = served.numbers(&format!("object/0/frame/{frame}/strain"));
        let largest = strains.iter().copied().fold(f32::NEG_INFINITY, f32::max);
        if let Some(expected) = row.and_then(|row| row["max_strain"]["strain"].as_f64()) {
            // Positions are stored with 24 bits.
            assert!((f64::from(largest) - expected).abs() < 1e-6, "frame {frame}: {largest} {expected}");
        }
    }
    // The ball is a sphere around its centre.
    let ball = served.numbers("object/1/frame/1001/points");
    for point in ball.chunks(3) {
        let from_centre = [point[0] - 0.8, point[1], point[2] - 0.5];
        let radius = from_centre.iter().map(|x| x * x).sum::<f32>().sqrt();
        assert!((radius - 0.2).abs() < 1e-5, "{point:?}");
    }
    let thickness = served.numbers("object/0/frame/1001/thickness");
    assert!(thickness.len() == cache.meshes[0].points && thickness.iter().all(|t| *t == thickness[0] && *t > 0.0));
    assert_eq!(served.numbers("object/0/frame/1004/contact").len(), cache.meshes[0].points);
}

#[test]
fn a_run_that_is_deleted_is_named_and_shown_again_when_it_is_back() {
    let Some(folder) = after_a_run() else { return };
    let served = Served::start(folder.path());
    served.state();
    let (out, elsewhere) = (folder.path().join("out"), folder.path().join("elsewhere"));
    std::fs::rename(&out, &elsewhere).expect("the folder goes away");
    for path in ["run.json", "object/0/frame/1001/points"] {
        let (status, body) = served.get(path);
        let text = String::from_utf8_lossy(&body).into_owned();
        assert!(status == 503 && text.contains("out") && text.contains("no manifest.json"), "{status} {text}");
    }
    std::fs::rename(&elsewhere, &out).expect("it comes back");
    assert_eq!(served.state()["frames"].as_array().map(Vec::len), Some(4));
    // Its cache alone is gone: the rest of the page stays, and the cache is named.
    std::fs::remove_file(out.join("sheet.abc")).expect("a cache");
    let state = served.state();
    assert!(state["frames"].as_array().is_some_and(Vec::is_empty), "{state}");
    assert!(state["notices"][0].as_str().is_some_and(|notice| notice.contains("sheet.abc")), "{state}");
}

#[test]
fn nobody_but_this_machine_reads_a_run_and_nothing_is_written() {
    let Some(folder) = after_a_run() else { return };
    let before: Vec<_> =
        std::fs::read_dir(folder.path().join("out")).unwrap().map(|e| e.unwrap().file_name()).collect();
    let served = Served::start(folder.path());
    assert_eq!(served.ask("GET /run.json", "elsewhere.example:80").0, 403);
    assert_eq!(served.ask("POST /run.json", &format!("localhost:{}", served.port)).0, 405);
    for path in
        ["../scene.toml", "manifest.json", "object/7/triangles", "object/0/frame/9999/mass", "object/-1/triangles"]
    {
        assert_eq!(served.get(path).0, 404, "{path}");
    }
    let (status, body) = served.get("object/0/frame/9999/points");
    assert!(status == 503 && String::from_utf8_lossy(&body).contains("there is no frame 9999"), "{status}");
    let after: Vec<_> = std::fs::read_dir(folder.path().join("out")).unwrap().map(|e| e.unwrap().file_name()).collect();
    assert_eq!(before, after, "view only reads");
}

#[test]
fn a_written_page_holds_the_run_and_says_how_large_it_is() {
    let Some(folder) = after_a_run() else { return };
    let written = drapery(folder.path(), &["view", "out", "--page", "page.html"]);
    assert_eq!(written.code, Some(0), "{}", written.stderr);
    assert!(written.stdout.starts_with("wrote page.html: 4 frames, "), "{}", written.stdout);
    // A page is replaced, and nothing else.
    assert_eq!(drapery(folder.path(), &["view", "out", "--page", "page.html"]).code, Some(0));
    let refused = drapery(folder.path(), &["view", "out", "--page", "scene.toml"]);
    assert!(
        refused.code == Some(73) && refused.stderr.contains("scene.toml: this file exists already and is no page"),
        "{}",
        refused.stderr
    );
    assert_eq!(std::fs::read_to_string(folder.path().join("scene.toml")).expect("the scene"), SHEET);
    let page = std::fs::read_to_string(folder.path().join("page.html")).expect("a page");
    assert!(page.len() < LARGEST_PAGE);
    let run = page.split("id=\"run\">").nth(1).and_then(|rest| rest.split("</script>").next()).expect("a run");
    let run: Value = serde_json::from_str(run).expect("JSON");
    assert_eq!(run["state"]["frames"].as_array().map(Vec::len), Some(4));
    assert!(run["places"]["object/0/frame/1003/strain"].is_u64() && run["places"]["object/1/triangles"].is_u64());
    // The ball stands still, so its points are there once.
    assert_eq!(run["places"]["object/1/frame/1001/points"], run["places"]["object/1/frame/1004/points"]);
}

#[test]
fn a_run_that_is_being_launched_is_waited_for() {
    if !has_library() {
        return;
    }
    let folder = folder_with(SHEET);
    let out = folder.path().join("out");
    let lock = RunLock::take(&out, &Owner::this_process(), false, SystemTime::now()).expect("a free folder");
    let served = Served::start_while(folder.path(), || {
        drop(lock);
        let run = drapery(folder.path(), &["run", "scene.toml", "--out", "out", "-q"]);
        assert_eq!(run.code, Some(0), "{}", run.stderr);
    });
    assert_eq!(served.state()["objects"][0]["name"], "sheet");
}

#[test]
fn folders_without_a_run_or_frames_and_ports_in_use_are_named() {
    let folder = folder_with(SHEET);
    for arguments in [&["view", "."][..], &["view", "nowhere"], &["view", ".", "--page", "page.html"]] {
        let refused = drapery(folder.path(), arguments);
        assert_eq!(refused.code, Some(66), "{}", refused.stderr);
        assert!(refused.stderr.contains("no manifest.json") && refused.stderr.contains("--out"), "{}", refused.stderr);
    }
    let Some(folder) = after_a_run() else { return };
    let taken = TcpListener::bind(("127.0.0.1", 0)).expect("a port");
    let port = taken.local_addr().expect("its address").port().to_string();
    let refused = drapery(folder.path(), &["view", "out", "--no-browser", "--port", &port]);
    assert_eq!(refused.code, Some(73), "{}", refused.stderr);
    assert!(refused.stderr.contains(&format!("port {port} is in use")), "{}", refused.stderr);
    std::fs::remove_file(folder.path().join("out/sheet.abc")).expect("a cache");
    let refused = drapery(folder.path(), &["view", "out", "--page", "page.html"]);
    assert_eq!(refused.code, Some(66), "{}", refused.stderr);
    assert!(
        refused.stderr.contains("no frames yet") && !folder.path().join("page.html").exists(),
        "{}",
        refused.stderr
    );
}
