//! The text layers: what an artist opens.

use std::fmt::Write;

use super::Units;
use super::mesh::{CROSSINGS, EXTENT, Members, NORMALS, NUMBERS, POINTS, VELOCITIES, primvar_of};
use super::names::{Distinct, MeshPath};

/// The layer of a garment's cache.
#[derive(Debug)]
pub struct CacheLayer<'a> {
    /// Meaning of its numbers.
    pub units: Units,
    /// Path of the mesh in the layer.
    pub path: &'a MeshPath,
    /// One line about it.
    pub documentation: &'a str,
    /// Provenance, as name and text: how it was made.
    pub properties: &'a [(&'a str, String)],
    /// Folder of topology, manifest and clips, relative to the layer.
    pub folder: &'a str,
    /// First and last frame that are there.
    pub frames: [i64; 2],
    /// Positions of the samples between a frame and the next, as fractions of a frame.
    pub sub_frames: &'a [f64],
    /// Number of them that are there behind the last frame.
    pub last_sub_frame: usize,
}

/// The layer of a shot.
#[derive(Debug)]
pub struct ShotLayer<'a> {
    /// Meaning of the numbers of its layers.
    pub units: Units,
    /// Name of the shot.
    pub shot: &'a str,
    /// Its garments.
    pub garments: &'a [GarmentReference],
    /// First and last frame that are there.
    pub frames: [i64; 2],
}

/// A garment of a shot.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct GarmentReference {
    /// Its name.
    pub name: String,
    /// Its cache, relative to the shot's layer.
    pub file: String,
    /// Purpose, if it is not for everything: `render` or `proxy`.
    pub purpose: Option<&'static str>,
}

/// Name of the clip of a frame in the folder of a cache, or of a sample behind it.
fn clip_name(frame: i64, sub_frame: usize) -> String {
    if sub_frame == 0 { format!("{frame:04}.usdc") } else { format!("{frame:04}_{sub_frame}.usdc") }
}

impl CacheLayer<'_> {
    /// Names in the folder of a cache: topology, manifest, and the clip of a frame.
    pub const TOPOLOGY: &'static str = "topology.usdc";
    /// The list of what clips hold.
    pub const MANIFEST: &'static str = "manifest.usda";

    /// The clip of a frame, or of a sample behind it, counted from 1.
    pub fn clip(frame: i64, sub_frame: usize) -> String {
        clip_name(frame, sub_frame)
    }

    /// The frame and sample of a clip; `None` for other files.
    pub fn frame_of(name: &str) -> Option<(i64, usize)> {
        let stem = name.strip_suffix(".usdc")?;
        let (frame, sub_frame) = stem.split_once('_').unwrap_or((stem, "0"));
        let sample = (frame.parse().ok()?, sub_frame.parse().ok()?);
        (clip_name(sample.0, sample.1) == name).then_some(sample)
    }

    /// All samples that are there, in their order: frame, number behind it, time code.
    fn samples(&self) -> impl Iterator<Item = (i64, usize, f64)> {
        let [first, last] = self.frames;
        let of_frame = move |frame: i64| {
            let behind = if frame == last { self.last_sub_frame } else { self.sub_frames.len() };
            let fractions = [0.0].into_iter().chain(self.sub_frames.iter().copied()).take(behind + 1);
            fractions.enumerate().map(move |(number, fraction)| (frame, number, frame as f64 + fraction))
        };
        (first..=last).flat_map(of_frame)
    }
}

/// The layer of a garment's cache: its topology, and a clip for each frame.
pub fn cache_layer(cache: &CacheLayer<'_>) -> String {
    let asset = |name: &str| asset(&format!("./{}/{name}", cache.folder));
    let mut text = String::from("#usda 1.0\n(\n    customLayerData = {\n        dictionary drapery = {\n");
    for (name, value) in cache.properties {
        let _ = writeln!(text, "            string {name} = {}", quoted(value));
    }
    text.push_str("        }\n    }\n");
    write_header(&mut text, cache.units, cache.path.root(), (cache.documentation, Some(cache.frames)));
    let _ = write!(text, "    subLayers = [\n        {}\n    ]\n)\n\n", asset(CacheLayer::TOPOLOGY));
    let listed = |all: Vec<String>| all.join(", ");
    let active = listed(cache.samples().enumerate().map(|(index, (.., time))| format!("({time}, {index})")).collect());
    let times = listed(cache.samples().map(|(.., time)| format!("({time}, {time})")).collect());
    let clips = listed(cache.samples().map(|(frame, number, _)| asset(&clip_name(frame, number))).collect());
    let _ = write!(
        text,
        "over \"{root}\" (\n    clips = {{\n        dictionary default = {{\n            double2[] active = [{active}]\n            \
         asset[] assetPaths = [{clips}]\n            asset manifestAssetPath = {manifest}\n            \
         string primPath = \"/{root}\"\n            double2[] times = [{times}]\n        }}\n    }}\n)\n{{\n}}\n",
        root = cache.path.root(),
        manifest = asset(CacheLayer::MANIFEST),
    );
    text
}

/// Returns the layer that declares the content of a cache's clips, without values.
pub fn clip_manifest(units: Units, path: &MeshPath, members: Members<'_>) -> String {
    let mut text = String::from("#usda 1.0\n(\n");
    write_header(&mut text, units, path.root(), ("What the clips of this cache hold.", None));
    text.push_str(")\n\n");
    let indent = |level: usize| "    ".repeat(level);
    for (level, prim) in path.prims().iter().enumerate() {
        let _ = write!(text, "{0}over \"{prim}\"\n{0}{{\n", indent(level));
    }
    let velocities = members.velocities.then_some((VELOCITIES, ""));
    let normals = members.normals.then_some((NORMALS, ""));
    let crossings = members.crossings.then_some((CROSSINGS, "custom "));
    let held = [Some((POINTS, "")), velocities, normals, Some((EXTENT, "")), crossings];
    let levels = path.prims().len();
    for ((name, kind), custom) in held.into_iter().flatten() {
        let _ = writeln!(text, "{}{custom}{kind} {name}", indent(levels));
    }
    for name in members.numbers {
        let _ = writeln!(text, "{}{NUMBERS} {}", indent(levels), primvar_of(name));
    }
    for level in (0..levels).rev() {
        let _ = writeln!(text, "{}}}", indent(level));
    }
    text
}

/// The layer of a shot: a group with a reference to each garment.
pub fn shot_layer(shot: &ShotLayer<'_>) -> String {
    let root = super::identifier(shot.shot);
    let mut text = String::from("#usda 1.0\n(\n");
    let documentation = format!("Shot {}", shot.shot);
    write_header(&mut text, shot.units, &root, (&documentation, Some(shot.frames)));
    let name = |name: &str, identifier: &str| {
        if name == identifier { String::new() } else { format!("displayName = {}\n", quoted(name)) }
    };
    let display = name(shot.shot, &root);
    let display = if display.is_empty() { display } else { format!("    {display}") };
    let _ = write!(text, ")\n\ndef Xform \"{root}\" (\n{display}    kind = \"assembly\"\n)\n{{\n");
    let mut names = Distinct::default();
    for (index, garment) in shot.garments.iter().enumerate() {
        let identifier = names.identifier(&garment.name);
        let display = name(&garment.name, &identifier);
        let display = if display.is_empty() { display } else { format!("        {display}") };
        let file = asset(&format!("./{}", garment.file));
        let space = if index == 0 { "" } else { "\n" };
        let purpose = garment.purpose.map(|purpose| format!("        uniform token purpose = \"{purpose}\"\n"));
        let purpose = purpose.unwrap_or_default();
        let _ = write!(
            text,
            "{space}    def \"{identifier}\" (\n{display}        kind = \"component\"\n        prepend references = {file}\n    )\n    {{\n{purpose}    }}\n",
        );
    }
    text.push_str("}\n");
    text
}

/// The fields that every layer has, with its times where it has frames.
fn write_header(text: &mut String, units: Units, root: &str, (documentation, frames): (&str, Option<[i64; 2]>)) {
    let _ = writeln!(text, "    defaultPrim = \"{root}\"\n    doc = {}", quoted(documentation));
    if let Some([_, last]) = frames {
        let _ = writeln!(text, "    endTimeCode = {last}");
    }
    let rate = units.time_codes_per_second;
    let _ = writeln!(text, "    framesPerSecond = {rate}\n    metersPerUnit = {}", units.metres_per_unit);
    if let Some([first, _]) = frames {
        let _ = writeln!(text, "    startTimeCode = {first}");
    }
    let _ = writeln!(text, "    timeCodesPerSecond = {rate}\n    upAxis = \"{}\"", units.up_axis());
}

/// A text between quotes.
fn quoted(text: &str) -> String {
    let mut quoted = String::from("\"");
    for c in text.chars() {
        match c {
            '"' => quoted.push_str("\\\""),
            '\\' => quoted.push_str("\\\\"),
            '\n' => quoted.push_str("\\n"),
            '\r' => quoted.push_str("\\r"),
            '\t' => quoted.push_str("\\t"),
            c if c.is_ascii_control() => {
                let _ = write!(quoted, "\\x{:02x}", c as u32);
            }
            c => quoted.push(c),
        }
    }
    quoted.push('"');
    quoted
}

/// The path of a file as an asset. Three marks where the path holds one.
fn asset(path: &str) -> String {
    if path.contains('@') { format!("@@@{}@@@", path.replace("@@@", "\\@@@")) } else { format!("@{path}@") }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn units() -> Units {
        Units { metres_per_unit: 0.01, z_up: false, time_codes_per_second: 24000.0 / 1001.0 }
    }

    #[test]
    fn clips_are_known_by_their_names() {
        for sample in [(1001, 0), (0, 0), (-12, 1), (123_456, 12)] {
            assert_eq!(CacheLayer::frame_of(&CacheLayer::clip(sample.0, sample.1)), Some(sample));
        }
        for other in ["topology.usdc", "1001.usdc.part", "+1001.usdc", "01001.usdc", "1001_0.usdc", "1001.usda"] {
            assert_eq!(CacheLayer::frame_of(other), None, "{other}");
        }
    }

    #[test]
    fn texts_and_paths_are_quoted() {
        assert_eq!(quoted("a \"b\"\\\n\u{1}ö"), "\"a \\\"b\\\"\\\\\\n\\x01ö\"");
        assert_eq!([asset("./a b.usd"), asset("./a@b.usd")], ["@./a b.usd@", "@@@./a@b.usd@@@"]);
    }

    #[test]
    fn a_shot_references_its_garments_under_names_that_differ() {
        let of = |name: &str, purpose| GarmentReference { name: name.into(), file: format!("{name}.usd"), purpose };
        let garments = [of("a b", None), of("a-b", Some("render"))];
        let text = shot_layer(&ShotLayer { units: units(), shot: "sq 10", garments: &garments, frames: [1001, 1010] });
        for line in [
            "defaultPrim = \"sq_10\"",
            "displayName = \"sq 10\"",
            "def \"a_b\" (",
            "def \"a_b_2\" (",
            "references = @./a-b.usd@",
            "uniform token purpose = \"render\"",
            "timeCodesPerSecond = 23.976023976023978",
            "metersPerUnit = 0.01",
            "endTimeCode = 1010",
        ] {
            assert!(text.contains(line), "{line} in {text}");
        }
    }
}
