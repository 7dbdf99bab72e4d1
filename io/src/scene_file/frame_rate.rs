//! Frame rates of a shot.

use super::ranges;
use super::raw::Quantity;
use super::tree::Path;

/// Frame rates that are written as decimals but mean multiples of 1000/1001.
const BROADCAST: [(&str, u32); 6] =
    [("23.976", 24), ("23.98", 24), ("29.97", 30), ("47.952", 48), ("59.94", 60), ("119.88", 120)];

/// Frames per second as a fraction.
pub(super) fn frame_rate(fps: &Quantity) -> Result<(u32, u32), String> {
    let text = match fps {
        Quantity::Number(number) => number.to_string(),
        Quantity::Text(text) => text.trim().to_owned(),
    };
    let wrong = || format!("`{text}` is not a frame rate; write \"24\", \"24000/1001\" or \"23.976\"");
    if let Some((_, nominal)) = BROADCAST.iter().find(|(word, _)| *word == text) {
        return Ok((nominal * 1000, 1001));
    }
    let (numerator, denominator) = if let Some((above, below)) = text.split_once('/') {
        (above.trim().parse().map_err(|_| wrong())?, below.trim().parse().map_err(|_| wrong())?)
    } else if let Some((whole, decimals)) = text.split_once('.') {
        let denominator = 10_u32.checked_pow(decimals.len() as u32).ok_or_else(wrong)?;
        let digits: u32 = format!("{whole}{decimals}").parse().map_err(|_| wrong())?;
        let common = greatest_common_divisor(digits, denominator).max(1);
        (digits / common, denominator / common)
    } else {
        (text.parse().map_err(|_| wrong())?, 1)
    };
    if numerator == 0 || denominator == 0 {
        return Err(wrong());
    }
    let range = ranges::at(&Path::default().key("shot").key("fps"));
    range.map_or(Ok(()), |range| range.check(f64::from(numerator) / f64::from(denominator)))?;
    Ok((numerator, denominator))
}

fn greatest_common_divisor(a: u32, b: u32) -> u32 {
    if b == 0 { a } else { greatest_common_divisor(b, a % b) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frame_rates_are_exact_fractions() {
        let rate = |text: &str| frame_rate(&Quantity::Text(text.to_owned()));
        assert_eq!(rate("24"), Ok((24, 1)));
        assert_eq!(rate("24000/1001"), Ok((24_000, 1001)));
        assert_eq!(rate("23.976"), Ok((24_000, 1001)));
        assert_eq!(rate("59.94"), Ok((60_000, 1001)));
        assert_eq!(rate("12.5"), Ok((25, 2)));
        assert_eq!(frame_rate(&Quantity::Number(29.97)), Ok((30_000, 1001)));
        assert_eq!(frame_rate(&Quantity::Number(24.0)), Ok((24, 1)));
        for wrong in ["", "film", "0", "24/0", "-24", "24/x"] {
            assert!(rate(wrong).is_err(), "{wrong}");
        }
    }
}
