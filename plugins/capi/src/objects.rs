//! Objects behind handles that only this interface has: errors and simulations, with their texts as C has them.

use std::ffi::CString;

use drapery_io::mesh_data::MeshData;
use drapery_shot::fault::Fault;
use drapery_shot::session::Session;

/// An error with its texts as C has them.
pub(crate) struct ErrorParts {
    pub(crate) fault: Fault,
    pub(crate) message: CString,
    pub(crate) object: Option<CString>,
}

/// A text for C: what has a zero inside ends there.
pub(crate) fn c_text(text: &str) -> CString {
    let end = text.find('\0').unwrap_or(text.len());
    CString::new(&text[..end]).unwrap_or_default()
}

/// A session, and what C looks at of it.
pub(crate) struct Simulation {
    pub(crate) session: Session,
    pub(crate) garments: Vec<CString>,
    pub(crate) bodies: Vec<CString>,
    pub(crate) warnings: Vec<CString>,
    /// Meshes of garments whose faces were asked for.
    pub(crate) meshes: Vec<Option<MeshData>>,
    /// Counts of the last frame.
    pub(crate) counts: Vec<(CString, u64)>,
}

impl Simulation {
    pub(crate) fn new(session: Session) -> Result<Self, Fault> {
        let shot = session.shot()?;
        let description = shot.simulation().scene().description();
        let garments: Vec<CString> = description.garments.iter().map(|garment| c_text(&garment.name)).collect();
        let bodies = description.bodies.iter().map(|body| c_text(&body.name)).collect();
        let warnings = shot.warnings().iter().map(|warning| c_text(&warning.to_string())).collect();
        let meshes = garments.iter().map(|_| None).collect();
        Ok(Self { session, garments, bodies, warnings, meshes, counts: Vec::new() })
    }

    /// Takes note of what was counted up to the present frame.
    pub(crate) fn count(&mut self) {
        let counts = self.session.summary().map(|summary| summary.metrics.counts()).unwrap_or_default();
        self.counts = counts.iter().map(|(name, amount)| (c_text(name), *amount)).collect();
    }
}
