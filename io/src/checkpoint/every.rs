//! Requested interval between checkpoints, as the command and the site file take it.

use std::str::FromStr;

use crate::duration::{TimeError, parse_duration};

/// Requested interval between checkpoints.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Every {
    /// As often as costs little: what a run does then is its own to know.
    Auto,
    /// After that many frames.
    Frames(u64),
    /// After that much time [s].
    Seconds(f64),
}

impl FromStr for Every {
    type Err = String;

    /// Reads `auto`, a number of frames (`10f`) or a time (`90s`, `15m`, `1h30m`).
    fn from_str(text: &str) -> Result<Self, String> {
        let wanted = "write `auto`, a number of frames as in `10f`, or a time as in `90s`, `15m` or `2h`";
        if text == "auto" {
            return Ok(Self::Auto);
        }
        if let Some(number) = text.strip_suffix('f') {
            let frames = number.parse().map_err(|_| format!("`{number}` is not a whole number; {wanted}"))?;
            return if frames > 0 { Ok(Self::Frames(frames)) } else { Err("0f would write none; use 1f".into()) };
        }
        if text.ends_with(|c: char| c.is_ascii_digit()) {
            return Err(format!("`{text}` has no unit; {wanted}"));
        }
        match parse_duration(text) {
            Ok(time) => Ok(Self::Seconds(time.as_secs_f64())),
            Err(TimeError::Span { text, what } | TimeError::Epoch { text, what }) => {
                Err(format!("`{text}`: {what}; {wanted}"))
            }
        }
    }
}
