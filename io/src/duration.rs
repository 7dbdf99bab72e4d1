//! Spans and points of time as people and schedulers write them.

use std::time::{Duration, SystemTime};

/// Seconds of each unit, from the largest.
const UNITS: [(char, f64); 4] = [('d', 86_400.0), ('h', 3_600.0), ('m', 60.0), ('s', 1.0)];

/// Longest span that is taken for one [s]: ten years. What is longer is a slip.
const LONGEST: f64 = 10.0 * 365.0 * 86_400.0;

/// Earliest point of time that is taken for one, in seconds since 1970: September 2001. What is smaller is a span.
const EARLIEST: f64 = 1.0e9;

/// Why a text is no time.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum TimeError {
    /// It is not a span.
    #[error("`{text}`: {what}\n  help: write a duration as 11h50m, 15m, 90s, or as a number of seconds")]
    Span {
        /// Text that was written.
        text: String,
        /// Fault in the text.
        what: String,
    },
    /// It is not a point of time.
    #[error("`{text}`: {what}\n  help: give seconds since 1970, as `date +%s` prints them")]
    Epoch {
        /// Text that was written.
        text: String,
        /// Fault in the text.
        what: String,
    },
}

/// Reads a span: `11h50m`, `1d2h`, `1.5h`, `90s`, or plain seconds. It is longer than nothing.
///
/// # Errors
/// The text is something else; units come twice or not from large to small.
pub fn parse_duration(text: &str) -> Result<Duration, TimeError> {
    let error = |what: &str| TimeError::Span { text: text.to_owned(), what: what.to_owned() };
    let mut rest = text.trim();
    let mut seconds = 0.0;
    let mut units = UNITS.iter();
    if rest.is_empty() {
        return Err(error("it is empty"));
    }
    while !rest.is_empty() {
        let end = rest.find(|c: char| !c.is_ascii_digit() && c != '.').unwrap_or(rest.len());
        let (number, after) = rest.split_at(end);
        let number: f64 = number.parse().map_err(|_| error("a number is missing"))?;
        let Some(letter) = after.chars().next() else {
            if rest.len() < text.trim().len() {
                return Err(error("the last number has no unit"));
            }
            seconds = number;
            break;
        };
        let known = UNITS.iter().any(|(unit, _)| *unit == letter);
        let Some((_, factor)) = units.find(|(unit, _)| *unit == letter) else {
            let what = format!("`{letter}` is not a unit; use d, h, m or s");
            return Err(error(if known { "each unit may come once, the largest first" } else { &what }));
        };
        seconds += number * factor;
        rest = &after[letter.len_utf8()..];
    }
    match seconds {
        s if s <= 0.0 => Err(error("it has to be longer than zero")),
        s if s > LONGEST => Err(error("it is longer than ten years")),
        s => Ok(Duration::from_secs_f64(s)),
    }
}

/// Reads a point of time in seconds since 1970.
///
/// # Errors
/// The text is no number, or so small that a span may be meant.
pub fn parse_epoch(text: &str) -> Result<SystemTime, TimeError> {
    let error = |what: &str| TimeError::Epoch { text: text.to_owned(), what: what.to_owned() };
    match text.trim().parse::<f64>() {
        Ok(seconds) if seconds < EARLIEST => Err(error("this is long past; did you mean a duration?")),
        Ok(seconds) if seconds > EARLIEST + 100.0 * LONGEST => {
            Err(error("this is too far away; did you mean milliseconds?"))
        }
        Ok(seconds) if seconds.is_finite() => Ok(SystemTime::UNIX_EPOCH + Duration::from_secs_f64(seconds)),
        _ => Err(error("not a number of seconds")),
    }
}

/// A point of time for people, as in `2026-05-04 09:30:00 UTC`.
pub fn utc(time: SystemTime) -> String {
    let seconds = time.duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default().as_secs();
    let (days, second) = (seconds / DAY, seconds % DAY);
    // Years that begin in March have the leap day at their end; cycles of 400 such years are all alike.
    let day_of_cycle = (days + 719_468) % 146_097;
    let year_of_cycle = (day_of_cycle - day_of_cycle / 1460 + day_of_cycle / 36_524 - day_of_cycle / 146_096) / 365;
    let day_of_year = day_of_cycle - (365 * year_of_cycle + year_of_cycle / 4 - year_of_cycle / 100);
    let month_from_march = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * month_from_march + 2) / 5 + 1;
    let month = if month_from_march < 10 { month_from_march + 3 } else { month_from_march - 9 };
    let year = (days + 719_468) / 146_097 * 400 + year_of_cycle + u64::from(month <= 2);
    let (hour, minute, second) = (second / 3600, second / 60 % 60, second % 60);
    format!("{year:04}-{month:02}-{day:02} {hour:02}:{minute:02}:{second:02} UTC")
}

/// Seconds of a day.
const DAY: u64 = 86_400;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_of_time_are_dates() {
        // From the calendar: seconds since 1970 of the first days of two years, of a leap day, and of the day after one.
        let of = |seconds| utc(SystemTime::UNIX_EPOCH + Duration::from_secs(seconds));
        assert_eq!(of(0), "1970-01-01 00:00:00 UTC");
        assert_eq!(of(951_782_400), "2000-02-29 00:00:00 UTC");
        assert_eq!(of(951_868_800), "2000-03-01 00:00:00 UTC");
        assert_eq!(of(1_735_689_599), "2024-12-31 23:59:59 UTC");
        assert_eq!(of(1_735_689_600), "2025-01-01 00:00:00 UTC");
    }

    #[test]
    fn durations_are_read_as_schedulers_and_people_write_them() {
        let cases = [
            ("11h50m", 42_600.0),
            ("90s", 90.0),
            ("15m", 900.0),
            ("90", 90.0),
            ("1d2h3m4s", 93_784.0),
            ("1.5h", 5_400.0),
            (" 0.5 ", 0.5),
        ];
        for (text, seconds) in cases {
            assert_eq!(parse_duration(text), Ok(Duration::from_secs_f64(seconds)), "{text}");
        }
    }

    #[test]
    fn what_is_no_duration_is_refused_with_the_reason() {
        let cases = [
            ("", "it is empty"),
            ("h", "a number is missing"),
            ("-5m", "a number is missing"),
            ("5x", "`x` is not a unit"),
            ("5µ", "`µ` is not a unit"),
            ("1h30", "the last number has no unit"),
            ("50m11h", "the largest first"),
            ("1h1h", "each unit may come once"),
            ("0s", "longer than zero"),
            ("99999d", "ten years"),
            ("1.2.3h", "a number is missing"),
            ("inf", "a number is missing"),
        ];
        for (text, reason) in cases {
            let error = parse_duration(text).unwrap_err().to_string();
            assert!(error.contains(reason) && error.contains("help: "), "{text}: {error}");
        }
    }

    #[test]
    fn points_of_time_are_seconds_since_1970() {
        let time = parse_epoch("1793620000.5").unwrap();
        assert_eq!(time.duration_since(SystemTime::UNIX_EPOCH).unwrap(), Duration::from_secs_f64(1_793_620_000.5));
        for (text, reason) in [("3600", "duration"), ("tomorrow", "not a number"), ("1793620000000", "milliseconds")] {
            let error = parse_epoch(text).unwrap_err().to_string();
            assert!(error.contains(reason), "{text}: {error}");
        }
        assert!(parse_epoch("nan").is_err() && parse_epoch("inf").is_err());
    }
}
