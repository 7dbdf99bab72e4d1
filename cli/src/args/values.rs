//! Readers of arguments: each takes the text and returns the value.

use std::time::Duration;

use drapery_io::duration::parse_duration;
use drapery_io::units::{LengthUnit, UpAxis};
use drapery_shot::run::Resume;

/// First and last frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct FrameRange {
    pub(crate) first: i64,
    pub(crate) last: i64,
}

/// First and last seed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct SeedRange {
    pub(crate) first: u64,
    pub(crate) last: u64,
}

pub(super) fn parse_seeds(text: &str) -> Result<SeedRange, String> {
    let number = |word: &str| word.trim().parse::<u64>().map_err(|_| format!("`{word}` is not a seed"));
    let (first, last) = text.split_once('-').unwrap_or((text, text));
    let (first, last) = (number(first)?, number(last)?);
    if last < first { Err(format!("{last} comes before {first}")) } else { Ok(SeedRange { first, last }) }
}

pub(super) fn parse_frames(text: &str) -> Result<FrameRange, String> {
    let number = |word: &str| word.parse::<i64>().map_err(|_| format!("`{word}` is not a frame number"));
    if text.contains(['x', ':', ',']) {
        return Err("a simulation cannot skip frames; give one range such as 1001-1100".into());
    }
    // The first character may be the sign of a negative frame.
    let split = text.char_indices().skip(1).find(|(_, c)| *c == '-').map(|(i, _)| i);
    let (first, last) = match split {
        Some(i) => (number(&text[..i])?, number(&text[i + 1..])?),
        None => (number(text)?, number(text)?),
    };
    if last < first {
        return Err(format!("the last frame, {last}, comes before the first, {first}"));
    }
    Ok(FrameRange { first, last })
}

/// Reads the word of a unit.
pub(super) fn parse_length(text: &str) -> Result<LengthUnit, String> {
    let found = LengthUnit::ALL.into_iter().find(|unit| unit.word() == text);
    found.ok_or_else(|| {
        let words: Vec<&str> = LengthUnit::ALL.iter().map(|unit| unit.word()).collect();
        format!("`{text}` is not a unit; use one of {}", words.join(", "))
    })
}

/// Reads an axis.
pub(super) fn parse_up(text: &str) -> Result<UpAxis, String> {
    match text {
        "Y" | "y" => Ok(UpAxis::Y),
        "Z" | "z" => Ok(UpAxis::Z),
        _ => Err(format!("`{text}` is not an up axis; use Y or Z")),
    }
}

/// Reads a frame rate, a number or a fraction.
pub(super) fn parse_rate(text: &str) -> Result<(u32, u32), String> {
    let (numerator, denominator) = text.split_once('/').unwrap_or((text, "1"));
    let number = |word: &str| word.parse::<u32>().ok().filter(|number| *number > 0);
    let wrong = || format!("`{text}` is not a frame rate; write 24, or a fraction such as 24000/1001");
    number(numerator).zip(number(denominator)).ok_or_else(wrong)
}

/// Reads `10s/frame`.
pub(super) fn parse_frame_budget(text: &str) -> Result<Duration, String> {
    let time = text.strip_suffix("/frame").or_else(|| text.strip_suffix("/f")).unwrap_or(text);
    parse_duration(time).map_err(|error| error.to_string())
}

pub(super) fn parse_resume(text: &str) -> Result<Resume, String> {
    match text {
        "auto" => Ok(Resume::Auto),
        "never" => Ok(Resume::Never),
        _ => text.parse().map(Resume::Frame).map_err(|_| "write auto, never or the number of a frame".into()),
    }
}

pub(super) fn parse_tolerance(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(metres) if metres >= 0.0 && metres.is_finite() => Ok(metres),
        _ => Err("write a distance in metres, for example 1e-6".into()),
    }
}

pub(super) fn parse_setting(text: &str) -> Result<(String, String), String> {
    match text.split_once('=') {
        Some((name, value)) if !name.trim().is_empty() => Ok((name.trim().to_owned(), value.trim().to_owned())),
        _ => Err("write it as name=value, for example resolution=80".into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frame_ranges_may_be_negative_and_may_not_skip() {
        assert_eq!(parse_frames("1001-1100"), Ok(FrameRange { first: 1001, last: 1100 }));
        assert_eq!(parse_frames("-10--5"), Ok(FrameRange { first: -10, last: -5 }));
        assert_eq!(parse_frames("7"), Ok(FrameRange { first: 7, last: 7 }));
        assert!(parse_frames("1-10x2").unwrap_err().contains("cannot skip frames"));
        assert!(parse_frames("10-1").unwrap_err().contains("comes before"));
        assert!(parse_frames("a-b").unwrap_err().contains("`a`"));
    }
}
