//! The small files of a run and of a site: manifest, record, lock, site file, material file, durations. The
//! first byte says which one the rest is.

use std::time::{Duration, SystemTime};

use crate::{memory, scratch};
use drapery_analysis::report;
use drapery_analysis::report::status::Status;
use drapery_io::site_file::SiteFile;
use drapery_io::{duration, scene_file};
use drapery_shot::farm::lock;
use drapery_shot::run_record::folder::RunFolder;
use drapery_shot::run_record::manifest::listed_files;
use drapery_shot::run_record::reader::frame_counts;
use drapery_shot::run_record::{MANIFEST, RECORD};

/// A manifest for records of any content.
const PLAIN: &str = "{\"shot\":\"s\",\"state\":\"running\",\"first_frame\":1,\"last_frame\":4,\"fps\":\"24/1\"}";

/// Reads one input.
pub fn run(data: &[u8]) {
    let Some((kind, text)) = data.split_first() else { return };
    memory::bounded(|| match kind % 6 {
        0 => page(text, b""),
        1 => page(PLAIN.as_bytes(), text),
        2 => {
            scratch::file(lock::LOCK, text);
            let _ = lock::holder(scratch::folder(), now()).map(|holder| holder.map(|holder| holder.to_string()));
        }
        3 => drop(SiteFile::read(&scratch::file("site.toml", text)).map_err(|error| error.to_string())),
        4 => drop(scene_file::read_material(&scratch::file("cloth.toml", text)).map_err(|error| error.to_string())),
        _ => {
            let Ok(text) = std::str::from_utf8(text) else { return };
            let _ = duration::parse_duration(text).map_err(|error| error.to_string());
            let _ = duration::parse_epoch(text).map_err(|error| error.to_string());
            let _ = text.parse::<drapery_io::checkpoint::Every>();
        }
    });
}

/// Reads a manifest and a record as `drapery report` and `drapery status` do.
fn page(manifest: &[u8], record: &[u8]) {
    scratch::file(MANIFEST, manifest);
    let record = scratch::file(RECORD, record);
    let _ = listed_files(scratch::folder());
    let _ = frame_counts(&record, "crossings");
    let _ = RunFolder::read(scratch::folder()).map(|run| report::page(&run));
    let _ = Status::of(scratch::folder(), now()).map_err(|error| error.to_string());
}

fn now() -> SystemTime {
    SystemTime::UNIX_EPOCH + Duration::from_secs(2_000_000_000)
}
