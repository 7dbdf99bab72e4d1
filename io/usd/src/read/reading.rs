//! An opened stage as everything reads it: values, and errors that say file, prim and what helps.

use std::error::Error as _;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

use openusd::sdf::Value;
use openusd::usd::{Attribute, AttributeQuery, Prim, Stage, TimeCode};

use super::error::{UsdError, UsdErrorKind};
use super::guard::{Log, seen};
use super::values::word;

/// A stage and what everything that is read from it needs: values, and errors that name the file.
pub(crate) struct Reading {
    pub(super) path: PathBuf,
    pub(crate) stage: Stage,
    pub(super) log: Arc<Mutex<Log>>,
}

impl Reading {
    /// Content that cannot be used.
    pub(crate) fn bad(&self, place: impl Into<String>, what: impl Into<String>, advice: impl Into<String>) -> UsdError {
        UsdError::bad(&self.path, place, what, advice)
    }

    /// The library's answer about a prim.
    pub(crate) fn ok<T>(&self, answer: openusd::Result<T>, prim: &Prim) -> Result<T, UsdError> {
        answer.map_err(|error| usd_error(&self.path, prim.path().as_str(), &error, &self.log))
    }

    /// A value that does not move: the default, or else the first sample.
    pub(crate) fn value(&self, attribute: &Attribute) -> Result<Option<Value>, UsdError> {
        let prim = attribute.prim();
        if let Some(value) = self.ok(attribute.get::<Value>(), &prim)? {
            return Ok(Some(value));
        }
        let first = self.ok(attribute.time_sample_times(), &prim)?.first().copied();
        first.map_or(Ok(None), |code| self.ok(attribute.get_at(TimeCode::new(code)), &prim))
    }

    /// The value at a time code.
    pub(crate) fn value_at(&self, query: &AttributeQuery, code: f64) -> Result<Option<Value>, UsdError> {
        self.ok(query.get_at(TimeCode::new(code)), &query.attribute().prim())
    }

    /// Codes of its samples; none when there is but one, as it then does not move.
    pub(crate) fn times(&self, query: &AttributeQuery) -> Result<Vec<f64>, UsdError> {
        let times = self.ok(query.time_sample_times(), &query.attribute().prim())?;
        if let Some(code) = times.iter().find(|code| !code.is_finite()) {
            let what = format!("a sample has the time code {code}");
            return Err(self.bad(query.attribute().path().as_str(), what, "export it again"));
        }
        Ok(if times.len() > 1 { times } else { Vec::new() })
    }

    /// Paths that a relationship points to.
    pub(crate) fn targets(&self, prim: &Prim, name: &str) -> Result<Vec<openusd::sdf::Path>, UsdError> {
        self.ok(prim.relationship(name).targets(), prim)
    }

    /// The type of a prim; empty when it has none.
    pub(crate) fn kind(&self, prim: &Prim) -> Result<String, UsdError> {
        Ok(self.ok(prim.type_name(), prim)?.map(|kind| kind.as_str().to_owned()).unwrap_or_default())
    }

    /// Declares attributes that value clips over a prim may hold and that no layer declares: the library looks for declared ones
    /// alone. It is done in memory, and no file changes.
    pub(crate) fn declare(&self, prim: &Prim, attributes: &[(&str, &str)]) -> Result<(), UsdError> {
        let mut above = Some(prim.clone());
        while let Some(prim) = &above
            && self.ok(prim.get_metadata::<Value>("clips"), prim)?.is_none()
        {
            above = prim.parent().filter(|prim| prim.path().as_str() != "/");
        }
        for (name, kind) in attributes.iter().filter(|_| above.is_some()) {
            let attribute = prim.attribute(*name);
            if self.ok(attribute.property_stack(), prim)?.is_empty() {
                // A value that cannot be declared, below an instance, is missed later, where it is needed.
                let _ = self.stage.create_attribute(attribute.path().clone(), *kind);
            }
        }
        Ok(())
    }

    /// The word that an attribute holds.
    pub(crate) fn word(&self, prim: &Prim, name: &str) -> Result<Option<String>, UsdError> {
        Ok(self.value(&prim.attribute(name))?.as_ref().and_then(word))
    }
}

/// The library's error with all its causes; what the guard refused is the better reason.
pub(super) fn usd_error(path: &Path, place: &str, error: &openusd::Error, log: &Mutex<Log>) -> UsdError {
    let log = seen(log);
    if let Some((layer, what)) = log.refused.first() {
        return refused(path, layer, what);
    }
    let mut what = error.to_string();
    let mut cause = error.source();
    while let Some(next) = cause {
        let text = next.to_string();
        if !what.contains(&text) {
            what = format!("{what}: {text}");
        }
        cause = next.source();
    }
    let what = in_plain_words(&what);
    let advice =
        if begins_with_point(&what) { WRITE_ZERO } else { "the file is damaged, or of another kind; export it again" };
    UsdError::bad(path, place, what, advice)
}

/// The library's words where a number of a text layer begins with its point, which USD allows and it does not read.
const POINT_FIRST: &str = "got Punctuation('.')";

/// Advice for that.
const WRITE_ZERO: &str = "a number that begins with its point (.3) is right in USD, and is not read here: write 0.3, or save the \
                          layer as .usdc";

/// The library's words for letters that it knows no word from.
const UNKNOWN_LETTERS: &str = "Logos error";

/// The library's message, without the names of its parts.
fn in_plain_words(what: &str) -> String {
    what.replace(UNKNOWN_LETTERS, "these characters are not valid USD")
}

/// Whether the library stumbled over a number that begins with its point.
fn begins_with_point(what: &str) -> bool {
    what.contains(POINT_FIRST)
}

fn refused(path: &Path, layer: &str, what: &str) -> UsdError {
    let advice = "the file is damaged or malicious; if it is neither, write its samples as value clips";
    UsdError::bad(path, format!("layer {layer}"), what, advice)
}

/// Flaws of the composition of the stage: the prim, what is wrong, and whether a file is missing.
pub(super) fn flaws(reading: &Reading) -> Vec<(String, UsdError)> {
    use openusd::pcp::CompositionDiagnostic as Diagnostic;
    let path = &reading.path;
    let refusals = seen(&reading.log).refused.clone();
    let mut flaws: Vec<(String, UsdError)> =
        refusals.iter().map(|(layer, what)| (String::new(), refused(path, layer, what))).collect();
    for diagnostic in reading.stage.composition_errors() {
        let text = diagnostic.to_string();
        let (place, kind) = match &diagnostic {
            Diagnostic::ArcCycle(_) => (text.rsplit(' ').next().unwrap_or_default().to_owned(), UsdErrorKind::BadInput),
            Diagnostic::UnresolvedLayer { site_path, .. } => (site_path.as_str().to_owned(), UsdErrorKind::Missing),
            Diagnostic::MalformedLayer { site_path, .. }
            | Diagnostic::UnresolvedPrimPath { site_path, .. }
            | Diagnostic::UnresolvedDefaultPrim { site_path, .. }
            | Diagnostic::InvalidPrimPath { site_path, .. }
            | Diagnostic::InvalidVariantSelection { site_path, .. }
            | Diagnostic::InvalidExpression { site_path, .. } => {
                (site_path.as_str().to_owned(), UsdErrorKind::BadInput)
            }
            Diagnostic::UnreadableClip { prim_path, .. } => (prim_path.as_str().to_owned(), UsdErrorKind::Missing),
            // Sublayers belong to everything.
            _ if text.contains("sublayer") => {
                let missing = text.contains("unresolved");
                (String::new(), if missing { UsdErrorKind::Missing } else { UsdErrorKind::BadInput })
            }
            // Targets of materials and the like, which are no geometry.
            _ => continue,
        };
        let named = if place.is_empty() { "stage".to_owned() } else { place.clone() };
        let advice = match kind {
            _ if begins_with_point(&text) => WRITE_ZERO,
            UsdErrorKind::Missing => "put the file where the layer looks for it, or export the stage as one file",
            UsdErrorKind::BadInput => "correct the references of the layer, or export the stage as one file",
        };
        let error = UsdError::bad(path, named, in_plain_words(&text), advice);
        flaws.push((place, UsdError { kind, ..error }));
    }
    flaws
}
