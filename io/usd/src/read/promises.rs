//! Promises of a layer, looked at before `openusd` decodes it.
//!
//! A binary layer refers to its arrays by offset, and several samples may refer to the same one; `openusd` decodes all samples of
//! an attribute at once. A small file can therefore ask for any amount of memory, and does so in earnest when a body stands
//! still for a thousand frames. A text layer may be nested as deep as it likes, and its parser goes down with it.

use openusd::ar::{AssetBuffer, SharedBuffer};
use openusd::usdc::{CrateFile, MAGIC};

use super::classes::ARCS;

/// Memory that one attribute of a layer may take when it is decoded, whatever the size of the layer [bytes].
const ALWAYS: u64 = if cfg!(fuzzing) { 32 << 20 } else { 1 << 30 };

/// Beyond that, how many times the size of its layer one attribute may take.
const TIMES_THE_LAYER: u64 = 64;

/// Paths that a binary layer may have, whatever its size; beyond that, one a byte. Each is stored as a whole, so a chain of them
/// takes memory with its square.
const PATHS: u64 = 20_000;

/// Deepest nesting of a text layer; no stage that people work with comes near.
const DEEPEST: usize = 256;

/// Type of an array of time samples, in the numbers of the format.
const TIME_SAMPLES: u64 = 46;

/// Returns the fault in the bytes of a layer, if there is one.
pub(crate) fn problem(bytes: &SharedBuffer) -> Option<String> {
    if bytes.starts_with(MAGIC) { of_crate(bytes) } else { of_text(bytes) }
}

/// Whether a layer may hold prims that inherit from others, which the library follows without an end if they form a circle.
pub(crate) fn has_classes(bytes: &SharedBuffer) -> bool {
    let holds = |word: &str| bytes.windows(word.len()).any(|part| part == word.as_bytes());
    if !bytes.starts_with(MAGIC) {
        return holds("inherits") || holds("specializes");
    }
    let layer = CrateFile::open(AssetBuffer::Shared(bytes.clone()));
    layer.is_ok_and(|layer| layer.tokens.iter().any(|token| ARCS.contains(&token.as_str())))
}

/// A reference to a value: type, offset and flags in 64 bits.
#[derive(Clone, Copy)]
struct Reference(u64);

impl Reference {
    fn kind(self) -> u64 {
        self.0 >> 48 & 0xff
    }

    fn is_array(self) -> bool {
        self.0 >> 63 != 0
    }

    fn is_inlined(self) -> bool {
        self.0 >> 62 & 1 != 0
    }

    fn offset(self) -> u64 {
        self.0 & ((1 << 48) - 1)
    }

    /// Bytes that one element takes in memory; what is a text or a list counts as a pointer.
    fn element(self) -> u64 {
        match self.kind() {
            1 | 2 => 1,
            7 => 2,
            3 | 4 | 8 => 4,
            13 | 17 | 19 | 27 => 32,
            14 => 72,
            15 => 128,
            16 | 23 => 24,
            22 | 18 | 20 | 30 => 16,
            21 | 24 | 25 | 26 => 12,
            _ => 8,
        }
    }
}

/// Numbers of a binary layer, wherever they stand; `None` beyond its end.
#[derive(Clone, Copy)]
struct Numbers<'a> {
    bytes: &'a [u8],
    /// Whether lengths of arrays have 64 bits.
    wide: bool,
    /// Whether a word that once held the number of dimensions precedes them.
    shaped: bool,
}

impl Numbers<'_> {
    fn word(self, at: u64) -> Option<u64> {
        let start = usize::try_from(at).ok()?;
        let bytes = self.bytes.get(start..start.checked_add(8)?)?;
        Some(bytes.iter().rev().fold(0, |word, byte| word << 8 | u64::from(*byte)))
    }

    /// Number of elements of an array.
    fn length(self, array: Reference) -> Option<u64> {
        if array.is_inlined() || array.offset() == 0 {
            return Some(0);
        }
        let at = array.offset() + if self.shaped { 4 } else { 0 };
        if self.wide {
            return self.word(at);
        }
        let start = usize::try_from(at).ok()?;
        let bytes = self.bytes.get(start..start.checked_add(4)?)?;
        Some(bytes.iter().rev().fold(0, |word, byte| word << 8 | u64::from(*byte)))
    }

    /// Memory that a value takes [bytes]; what cannot be followed is refused by the decoder.
    fn size(self, value: Reference) -> u64 {
        match value.kind() {
            TIME_SAMPLES => self.samples(value).unwrap_or(0),
            _ if value.is_array() => self.length(value).unwrap_or(0).saturating_mul(value.element()),
            _ => 0,
        }
    }

    /// Memory of all samples of an attribute: a jump to the reference to their times, a jump to their number, references.
    fn samples(self, value: Reference) -> Option<u64> {
        let times = value.offset().checked_add_signed(self.word(value.offset())? as i64)?;
        let samples = times.checked_add(8)?;
        let count = samples.checked_add_signed(self.word(samples)? as i64)?;
        let mut size = 0_u64;
        for index in 0..self.word(count)? {
            let sample = Reference(self.word(count.checked_add(8)?.checked_add(index.checked_mul(8)?)?)?);
            // Every sample is a value of its own, with its time.
            size = size.saturating_add(64);
            if sample.kind() != TIME_SAMPLES {
                size = size.saturating_add(self.size(sample));
            }
        }
        Some(size)
    }
}

fn of_crate(shared: &SharedBuffer) -> Option<String> {
    let bytes: &[u8] = shared;
    let length = bytes.len() as u64;
    let version = bytes.get(8..11)?;
    let numbers = Numbers { bytes, wide: version >= [0, 7, 0].as_slice(), shaped: version < [0, 5, 0].as_slice() };
    if let Some(count) = paths(numbers)
        && count > PATHS.max(length)
    {
        return Some(format!("it declares {count} paths in {length} bytes"));
    }
    // What cannot be opened says so itself, and better.
    let layer = CrateFile::open(AssetBuffer::Shared(shared.clone())).ok()?;
    let allowed = ALWAYS.max(length.saturating_mul(TIMES_THE_LAYER));
    layer.fields.iter().find_map(|field| {
        let size = numbers.size(Reference(field.value_rep.0));
        let name = layer.tokens.get(field.token_index).map_or("?", String::as_str);
        (size > allowed)
            .then(|| format!("the {name} of an attribute take {} MB, in a layer of {length} bytes", size / 1_000_000))
    })
}

/// Number of paths that a binary layer promises: the first word of its section PATHS.
fn paths(numbers: Numbers<'_>) -> Option<u64> {
    let table = numbers.word(16)?;
    // Sections: a name of 16 bytes, start, size. There are less than 64.
    let sections = (0..numbers.word(table)?.min(64)).map(|index| table + 8 + 32 * index);
    sections.into_iter().find_map(|section| {
        let name = usize::try_from(section).ok().and_then(|start| numbers.bytes.get(start..start.checked_add(6)?))?;
        (name == b"PATHS\0").then(|| numbers.word(section + 16).and_then(|start| numbers.word(start)))?
    })
}

/// Looks for nesting that is too deep, outside of texts, asset paths and comments.
fn of_text(bytes: &[u8]) -> Option<String> {
    let (mut depth, mut line, mut at) = (0_usize, 1_usize, 0_usize);
    while at < bytes.len() {
        match bytes[at] {
            b'\n' => line += 1,
            b'#' => {
                at += bytes[at..].iter().position(|byte| *byte == b'\n').unwrap_or(bytes.len() - at);
                continue;
            }
            quote @ (b'"' | b'\'' | b'@') => {
                let end = at + quoted(&bytes[at..], quote);
                line += bytes[at..end].iter().filter(|byte| **byte == b'\n').count();
                at = end;
                continue;
            }
            b'{' | b'(' | b'[' => {
                depth += 1;
                if depth > DEEPEST {
                    return Some(format!("line {line} is nested more than {DEEPEST} deep"));
                }
            }
            b'}' | b')' | b']' => depth = depth.saturating_sub(1),
            _ => {}
        }
        at += 1;
    }
    None
}

/// Length of the text at the start, with its quotes: one of them, or three on both sides.
fn quoted(text: &[u8], quote: u8) -> usize {
    let tripled = text.starts_with(&[quote; 3]);
    let (mut at, width) = if tripled { (3, 3) } else { (1, 1) };
    while at < text.len() {
        match text[at] {
            b'\\' if quote != b'@' => at += 1,
            byte if byte == quote && text[at..].starts_with(&[quote; 3][..width]) => return at + width,
            _ => {}
        }
        at += 1;
    }
    text.len()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nesting_is_counted_outside_of_texts_asset_paths_and_comments() {
        let open = "(".repeat(300);
        for harmless in [
            format!("a = \"{open}\""),
            format!("a = 'it\\'s {open}'"),
            format!("a = \"\"\"\n\"{open}\n\"\"\""),
            format!("a = @{open}.usda@ # {open}\n b = (1)"),
            "(".repeat(256) + &")".repeat(256) + "{}",
        ] {
            assert_eq!(of_text(harmless.as_bytes()), None, "{harmless}");
        }
        let deep = format!("#usda 1.0\n\n{open}");
        assert_eq!(of_text(deep.as_bytes()).unwrap(), "line 3 is nested more than 256 deep");
    }
}
