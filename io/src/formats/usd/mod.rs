//! USD.

mod attributes;
mod channel;
mod read;
mod read_back;
mod single;
mod stage;
mod summary;
mod write;

use drapery_usd::read::{UsdError, UsdErrorKind, answers_panics};

use super::{Format, ShotFormat};
use crate::error::IoError;

/// Layers in text or binary, and caches: a layer over value clips.
pub(super) const USD: Format = Format {
    create: Some(|path, plan| Ok(Box::new(write::UsdWriter::create(path, plan)))),
    resume: Some(|path, plan, mark| Ok(Box::new(write::UsdWriter::resume(path, plan, mark)?))),
    check: Some(write::UsdWriter::check_resume),
    read_back: Some(read_back::open),
    folder_of: Some(write::clips_of),
    shot: Some(ShotFormat { extension: "usda", write: write::write_shot }),
    ..layer("usd", "USD, text or binary: bodies and garments in; caches out, a layer over value clips")
};

/// Layers in text.
pub(super) const USDA: Format = layer("usda", "USD as text: bodies and garments in");

/// Layers in binary.
pub(super) const USDC: Format =
    Format { single: Some(single::SINGLE), ..layer("usdc", "USD, binary: bodies and garments in") };

/// Packages of layers.
pub(super) const USDZ: Format =
    Format { refers_to_others: false, ..layer("usdz", "USD as a package: bodies and garments in") };

/// A spelling of USD, which is read alike in all of them.
const fn layer(extension: &'static str, summary: &'static str) -> Format {
    Format {
        binds_materials: true,
        refers_to_others: true,
        open: Some(|path, pattern| Ok(Box::new(read::UsdMesh::open(path, pattern)?))),
        channel: Some(channel::read),
        read_back: Some(stage::open),
        answers_panics: Some(answers_panics),
        ..Format::new(extension, summary, summary::summary)
    }
}

impl From<UsdError> for IoError {
    fn from(error: UsdError) -> Self {
        let UsdError { kind, path, place, what, advice } = error;
        match kind {
            UsdErrorKind::Missing => Self::MissingPart { path, place, what, advice },
            UsdErrorKind::BadInput => Self::Data { path, place, what, advice },
        }
    }
}
