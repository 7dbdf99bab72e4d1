//! How often somebody wants checkpoints, as the command and the site file take it.

use std::str::FromStr;

/// How often checkpoints are asked for.
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

    /// Reads `auto`, a number of frames (`10f`) or a time (`90s`, `15m`, `2h`).
    fn from_str(text: &str) -> Result<Self, String> {
        let wanted = "write `auto`, a number of frames as in `10f`, or a time as in `90s`, `15m` or `2h`";
        if text == "auto" {
            return Ok(Self::Auto);
        }
        let number = text.trim_end_matches(|c: char| c.is_alphabetic());
        let unit = &text[number.len()..];
        let seconds = match unit {
            "f" => {
                let frames = number.parse().map_err(|_| format!("`{number}` is not a whole number; {wanted}"))?;
                return if frames > 0 { Ok(Self::Frames(frames)) } else { Err("0f would write none; use 1f".into()) };
            }
            "s" => 1.0,
            "m" => 60.0,
            "h" => 3600.0,
            "" => return Err(format!("`{text}` has no unit; {wanted}")),
            _ => return Err(format!("`{unit}` is no unit; {wanted}")),
        };
        let time: f64 = number.parse().map_err(|_| format!("`{number}` is not a number; {wanted}"))?;
        if !(time.is_finite() && time > 0.0) {
            return Err(format!("`{text}` is not a time above zero; {wanted}"));
        }
        Ok(Self::Seconds(time * seconds))
    }
}
