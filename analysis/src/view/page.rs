//! The page: markup, style and scripts of `analysis/viewer`, with three.js, in one text. A written page also holds a run: the answers
//! to everything that it will ask for.

use std::collections::HashMap;
use std::path::Path;

use super::arrays::Precision;
use super::opened::About;
use super::{Field, ViewError, Viewer};
use crate::page::base64::encode;

/// Markup, with a place for each of the other texts.
const MARKUP: &str = include_str!("../../viewer/page.html");

const STYLE: &str = include_str!("../../viewer/style.css");

/// Scripts, in the order in which they are needed.
const SCRIPTS: [&str; 4] = [
    include_str!("../../viewer/arrays.js"),
    include_str!("../../viewer/colours.js"),
    include_str!("../../viewer/stage.js"),
    include_str!("../../viewer/main.js"),
];

/// three.js as `analysis/viewer/library/build.sh` has made it; empty in a build without it.
const LIBRARY: &str = include_str!(concat!(env!("OUT_DIR"), "/three.js"));

/// Largest page that is written [bytes]: mail takes attachments of 25 MB, and makes each a third longer.
pub const LARGEST_PAGE: usize = 18_000_000;

/// Whether this build has the library that the page needs.
pub fn has_library() -> bool {
    !LIBRARY.is_empty()
}

/// The page that asks for a run where it was loaded from.
///
/// # Errors
/// The build has no library.
pub fn page() -> Result<String, ViewError> {
    page_with("null")
}

/// The page with a run as JSON inside, or `null`.
fn page_with(run: &str) -> Result<String, ViewError> {
    if !has_library() {
        return Err(ViewError::NoLibrary);
    }
    let texts = HashMap::from([
        ("STYLE", STYLE.to_owned()),
        ("LIBRARY", LIBRARY.to_owned()),
        ("SCRIPT", SCRIPTS.concat()),
        // In a script nothing may look like its end.
        ("RUN", run.replace('<', "\\u003c")),
    ]);
    let mut parts = MARKUP.split("{{");
    let mut page = parts.next().unwrap_or_default().to_owned();
    for part in parts {
        let (name, rest) = part.split_once("}}").unwrap_or((part, ""));
        page += texts.get(name).map_or("", String::as_str);
        page += rest;
    }
    Ok(page)
}

/// A page that was written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Written {
    /// Frames in it.
    pub frames: usize,
    /// Frames that the run has.
    pub of: usize,
    /// Length of the file.
    pub bytes: usize,
}

/// Writes a page with the frames of a run, every second or third of them where they would be more than [`LARGEST_PAGE`].
///
/// # Errors
/// The run cannot be read, has no frames, one frame is too large, the build has no library, the file is there and is no page, or cannot be
/// written.
pub fn write_page(folder: &Path, file: &Path) -> Result<Written, ViewError> {
    let viewer = Viewer::new(folder)?;
    crate::page::check(file)?;
    let mut state = viewer.state()?;
    let all = std::mem::take(&mut state.frames);
    if all.is_empty() {
        return Err(ViewError::NoFrames(folder.to_owned()));
    }
    let mut stride = 1;
    let held = loop {
        let chosen: Vec<i64> = all.iter().step_by(stride).copied().collect();
        let mut held = Held::new(&viewer, &state.objects)?;
        match chosen.iter().try_for_each(|frame| held.add(&viewer, &state.objects, *frame)) {
            Ok(()) => {
                state.frames = chosen;
                break held;
            }
            // As many frames as have gone in are about as many as go in.
            Err(ViewError::TooLarge(bytes)) if held.frames == 0 => return Err(ViewError::TooLarge(bytes)),
            Err(ViewError::TooLarge(_)) => stride = (stride + 1).max(all.len().div_ceil(held.frames)),
            Err(error) => return Err(error),
        }
    };
    state.frames_of_run = Some(all.len());
    // The page does not change any more: how the process is doing says nothing.
    state.status.process = None;
    let frames = state.frames.len();
    let run = serde_json::json!({ "state": state, "places": held.places, "arrays": held.arrays });
    let page = page_with(&run.to_string())?;
    crate::page::write(file, &page)?;
    Ok(Written { frames, of: all.len(), bytes: page.len() })
}

/// Arrays that go into a page, equal ones once.
struct Held {
    /// In base64.
    arrays: Vec<String>,
    /// The array of each path.
    places: HashMap<String, usize>,
    known: HashMap<Vec<u8>, usize>,
    bytes: usize,
    frames: usize,
}

impl Held {
    fn new(viewer: &Viewer, objects: &[About]) -> Result<Self, ViewError> {
        let bytes = LIBRARY.len();
        let mut held = Self { arrays: Vec::new(), places: HashMap::new(), known: HashMap::new(), bytes, frames: 0 };
        for object in 0..objects.len() {
            held.hold(viewer, format!("object/{object}/triangles"))?;
        }
        Ok(held)
    }

    /// Adds all arrays of a frame.
    fn add(&mut self, viewer: &Viewer, objects: &[About], frame: i64) -> Result<(), ViewError> {
        for (object, about) in objects.iter().enumerate() {
            let fields = Field::NAMES.iter().filter(|(_, field)| about.has_fields || *field == Field::Points);
            for (name, _) in fields {
                self.hold(viewer, format!("object/{object}/frame/{frame}/{name}"))?;
            }
        }
        self.frames += 1;
        Ok(())
    }

    fn hold(&mut self, viewer: &Viewer, path: String) -> Result<(), ViewError> {
        let bytes = viewer.answer_in(&path, Precision::Short)?.bytes;
        let place = match self.known.get(&bytes) {
            Some(place) => *place,
            None => {
                let text = encode(&bytes);
                self.bytes += text.len();
                self.arrays.push(text);
                self.known.insert(bytes, self.arrays.len() - 1);
                self.arrays.len() - 1
            }
        };
        self.places.insert(path, place);
        if self.bytes > LARGEST_PAGE { Err(ViewError::TooLarge(self.bytes)) } else { Ok(()) }
    }
}
