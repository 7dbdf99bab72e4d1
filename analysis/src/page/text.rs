//! Numbers and words for people: units, groups of digits, and what may stand in a page.

/// Text as it may stand in a page, between tags and inside quotes.
pub(crate) fn escape(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => escaped += "&amp;",
            '<' => escaped += "&lt;",
            '>' => escaped += "&gt;",
            '"' => escaped += "&quot;",
            '\'' => escaped += "&#39;",
            // Control characters may not stand in a page at all.
            c if c.is_control() && c != '\n' && c != '\t' => escaped.push('\u{fffd}'),
            c => escaped.push(c),
        }
    }
    escaped
}

/// A relative path as the address of a link: what means something else there is written as `%` and its code.
pub(crate) fn address(path: &str) -> String {
    let is_plain = |byte: u8| byte.is_ascii_alphanumeric() || b"-._~/,=+".contains(&byte);
    path.bytes()
        .map(|byte| if is_plain(byte) { char::from(byte).to_string() } else { format!("%{byte:02X}") })
        .collect()
}

/// A whole number in groups of three digits.
pub(crate) fn count(amount: u64) -> String {
    let digits = amount.to_string();
    let mut grouped = String::new();
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            grouped.push('\u{202f}'); // narrow no-break space
        }
        grouped.push(digit);
    }
    grouped
}

/// A number of threads.
pub(crate) fn threads(count: usize) -> String {
    if count == 1 { "1 thread".to_owned() } else { format!("{count} threads") }
}

/// A duration [s].
pub(crate) fn seconds(value: f64) -> String {
    match value {
        v if v <= 0.0 => "0 s".to_owned(),
        v if v < 1.0 => format!("{} ms", digits(v * 1e3)),
        v if v < 120.0 => format!("{} s", digits(v)),
        v if v < 7200.0 => format!("{} min {:02} s", v as u64 / 60, v as u64 % 60),
        v => format!("{} h {:02} min", v as u64 / 3600, v as u64 % 3600 / 60),
    }
}

/// A length [m].
pub(crate) fn millimetres(metres: f64) -> String {
    match metres {
        0.0 => "0 mm".to_owned(),
        m if m < 1e-9 => format!("{:.1e} mm", m * 1e3),
        m if m < 1e-6 => format!("{} nm", digits(m * 1e9)),
        m if m < 1e-4 => format!("{} µm", digits(m * 1e6)),
        m => format!("{} mm", digits(m * 1e3)),
    }
}

/// An amount of memory.
pub(crate) fn bytes(amount: u64) -> String {
    let (unit, word) = unit_of_bytes(amount);
    format!("{} {word}", digits(amount as f64 / unit))
}

/// The largest unit that is not larger than an amount of memory: its bytes and its word.
pub(crate) fn unit_of_bytes(amount: u64) -> (f64, &'static str) {
    const UNITS: [(u64, &str); 4] = [(1 << 40, "TiB"), (1 << 30, "GiB"), (1 << 20, "MiB"), (1 << 10, "KiB")];
    let fitting = UNITS.into_iter().find(|(unit, _)| amount >= *unit);
    fitting.map_or((1.0, "B"), |(unit, word)| (unit as f64, word))
}

/// A number with a prefix of the unit: `1.2 k`, `35 m`; zero has none.
pub(crate) fn scaled(value: f64, unit: &str) -> String {
    const PREFIXES: [(f64, &str); 7] =
        [(1e9, "G"), (1e6, "M"), (1e3, "k"), (1.0, ""), (1e-3, "m"), (1e-6, "µ"), (1e-9, "n")];
    if value == 0.0 {
        return join("0", unit);
    }
    // A little less than one still is one after rounding to three digits.
    let fits = |(factor, _): &&(f64, &str)| value.abs() >= factor * 0.9995;
    let (factor, prefix) = PREFIXES.iter().find(fits).unwrap_or(&PREFIXES[PREFIXES.len() - 1]);
    join(&digits(value / factor), &format!("{prefix}{unit}"))
}

fn join(number: &str, unit: &str) -> String {
    if unit.is_empty() { number.to_owned() } else { format!("{number} {unit}") }
}

/// A number with three digits that matter, without zeros at the end.
pub(crate) fn digits(value: f64) -> String {
    let text = match value.abs() {
        v if v >= 99.95 => format!("{value:.0}"),
        v if v >= 9.995 => format!("{value:.1}"),
        v if v >= 0.01 || v == 0.0 => format!("{value:.2}"),
        _ => return format!("{value:.2e}"),
    };
    match text.split_once('.') {
        Some(_) => text.trim_end_matches('0').trim_end_matches('.').to_owned(),
        None => text,
    }
}

/// A frame, or the first and the last of several.
pub(crate) fn frames(first: i64, last: i64) -> String {
    if first == last { format!("frame {first}") } else { format!("frames {first} to {last}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_short_and_carry_units() {
        assert_eq!(
            [0.0, 0.0123, 4.5, 99.0, 125.0, 7500.0].map(seconds),
            ["0 s", "12.3 ms", "4.5 s", "99 s", "2 min 05 s", "2 h 05 min"]
        );
        assert_eq!([512, 1536, 5 << 30].map(bytes), ["512 B", "1.5 KiB", "5 GiB"]);
        assert_eq!(count(1_234_567), "1\u{202f}234\u{202f}567");
        assert_eq!(count(999), "999");
        assert_eq!([1, 4].map(threads), ["1 thread", "4 threads"]);
        assert_eq!([0.0, 1234.0, 0.004, -2e6].map(|v| scaled(v, "J")), ["0 J", "1.23 kJ", "4 mJ", "-2 MJ"]);
        assert_eq!(scaled(20_000.0, ""), "20 k");
    }

    #[test]
    fn addresses_hold_no_character_with_a_meaning() {
        assert_eq!(address("a b/50%#1?.html"), "a%20b/50%25%231%3F.html");
    }

    #[test]
    fn nothing_that_a_scene_says_can_become_part_of_the_page() {
        assert_eq!(escape("<b a='\"'>&\u{1}"), "&lt;b a=&#39;&quot;&#39;&gt;&amp;\u{fffd}");
    }
}
