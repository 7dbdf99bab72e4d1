//! Rules for names. A name becomes the name of a file, in a folder of any system, and of an object in that file.

/// Words that name devices on Windows, also before an ending; COM and LPT have a digit behind them.
const DEVICES: [&str; 6] = ["CON", "PRN", "AUX", "NUL", "CONIN$", "CONOUT$"];
const NUMBERED_DEVICES: [&str; 2] = ["COM", "LPT"];

/// Why a text cannot be the name of a garment, a body or a shot; `None` if it can.
pub fn why_unusable(name: &str) -> Option<String> {
    if name.is_empty() {
        return Some("it is empty".to_owned());
    }
    let is_usable = |c: char| c.is_alphanumeric() || "_-.".contains(c);
    if let Some(other) = name.chars().find(|c| !is_usable(*c)) {
        return Some(format!("it contains {other:?}"));
    }
    let stem = name.split('.').next().unwrap_or_default().to_uppercase();
    let is_numbered =
        |word: &&str| stem.strip_prefix(*word).is_some_and(|rest| matches!(rest.as_bytes(), [b'1'..=b'9']));
    if DEVICES.contains(&stem.as_str()) || NUMBERED_DEVICES.iter().any(is_numbered) {
        return Some("Windows has a device of this name".to_owned());
    }
    match name {
        _ if name.starts_with('.') => Some("it begins with a dot, which hides files".to_owned()),
        _ if name.ends_with('.') => Some("it ends with a dot, which Windows drops".to_owned()),
        _ => None,
    }
}

/// A name made of a text: characters that no name has become `_`.
pub fn usable(text: &str) -> String {
    let name: String = text.chars().map(|c| if c.is_alphanumeric() || "_-.".contains(c) { c } else { '_' }).collect();
    if why_unusable(&name).is_none() { name } else { format!("_{}_", name.trim_matches('.')) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_those_of_files_on_every_system() {
        for name in ["skirt", "Größe-2", "a.b", "COM", "COM10", "console", "_", "com0", "裙子"] {
            assert_eq!(why_unusable(name), None, "{name}");
        }
        for name in [
            "",
            " ",
            "a b",
            "a:b",
            "a/b",
            "\u{202e}",
            ".a",
            "..",
            "a.",
            "CON",
            "con.abc",
            "Nul",
            "lpt1",
            "a\nb",
            "a\u{fffd}",
        ] {
            assert!(why_unusable(name).is_some(), "{name:?}");
            assert_eq!(why_unusable(&usable(name)), None, "{name:?}");
        }
        assert_eq!(usable("my scene"), "my_scene");
    }
}
