//! Wedges: every combination of some values of a scene's settings, each a run in a folder of its own.

use std::collections::BTreeSet;
use std::fmt::Write;

use sha2::{Digest, Sha256};

use crate::study::vary::combinations;

/// Characters of a folder's name, beyond which it is cut and gets a digest of the whole name.
const LONGEST_NAME: usize = 120;

/// One run of a wedge.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct WedgeRun {
    /// Name of its folder: the last words of each key that tell it from the others, and its value.
    pub name: String,
    /// Keys and values that it sets in the scene, as `--set` has them.
    pub settings: Vec<(String, String)>,
}

/// Returns every combination of the values, the last key varying fastest. Names follow from keys and values alone, so that
/// a wedge with more values keeps the folders of the runs that it had.
///
/// # Errors
/// A key or a value of a key is given twice.
pub fn runs(vary: &[(String, Vec<String>)]) -> Result<Vec<WedgeRun>, String> {
    let mut keys = BTreeSet::new();
    for (key, values) in vary {
        if !keys.insert(key) {
            return Err(format!("--vary {key}: given twice\n  help: write all its values behind one --vary"));
        }
        let mut seen = BTreeSet::new();
        if let Some(value) = values.iter().find(|value| !seen.insert(*value)) {
            return Err(format!("--vary {key}: the value {value} is given twice\n  help: remove one"));
        }
    }
    let short = short_keys(vary);
    let mut names = BTreeSet::new();
    let mut runs = Vec::new();
    for row in combinations(vary) {
        let words: Vec<String> = row.iter().zip(&short).map(|((_, value), key)| format!("{key}={value}")).collect();
        let whole = words.join(",");
        let mut name = file_name(&whole);
        // Two values may differ only in characters that a folder's name cannot hold.
        if name.len() > LONGEST_NAME || !names.insert(name.to_lowercase()) {
            name = format!("{}-{}", name.chars().take(LONGEST_NAME).collect::<String>(), digest(&whole));
            names.insert(name.to_lowercase());
        }
        let settings = row.iter().map(|(key, value)| ((*key).to_owned(), (*value).to_owned())).collect();
        runs.push(WedgeRun { name, settings });
    }
    Ok(runs)
}

/// The number of runs of a wedge, which may be too large to list.
pub fn count(vary: &[(String, Vec<String>)]) -> usize {
    vary.iter().fold(1, |all: usize, (_, values)| all.saturating_mul(values.len()))
}

/// The last words of each key, as many as tell it from all others.
fn short_keys(vary: &[(String, Vec<String>)]) -> Vec<String> {
    let end = |key: &str, words: usize| {
        let parts: Vec<&str> = key.split('.').collect();
        parts[parts.len().saturating_sub(words)..].join(".")
    };
    let shortest = |(index, (key, _)): (usize, &(String, Vec<String>))| {
        let others = || vary.iter().enumerate().filter(|(other, _)| *other != index);
        let is_alone = |words: &usize| others().all(|(_, (other, _))| end(other, *words) != end(key, *words));
        (1..key.split('.').count()).find(is_alone).map_or_else(|| key.clone(), |words| end(key, words))
    };
    vary.iter().enumerate().map(shortest).collect()
}

/// The text without quotes, brackets and spaces, and with a dash for what else file systems or shells take for something else.
fn file_name(text: &str) -> String {
    let kept = |c: char| c.is_alphanumeric() || "._=,+-".contains(c);
    let name: String = text.chars().filter(|c| !"\"'[] ".contains(*c)).map(|c| if kept(c) { c } else { '-' }).collect();
    name.trim_matches('-').to_owned()
}

/// Eight hexadecimal digits that stand for a text.
fn digest(text: &str) -> String {
    Sha256::digest(text.as_bytes()).iter().take(4).fold(String::new(), |mut digits, byte| {
        // Writing into a text cannot fail.
        let _ = write!(digits, "{byte:02x}");
        digits
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn vary(of: &[(&str, &[&str])]) -> Vec<(String, Vec<String>)> {
        of.iter().map(|(key, values)| ((*key).to_owned(), values.iter().map(|v| (*v).to_owned()).collect())).collect()
    }

    fn names(of: &[(&str, &[&str])]) -> Vec<String> {
        runs(&vary(of)).unwrap().into_iter().map(|run| run.name).collect()
    }

    #[test]
    fn every_combination_is_a_run_named_by_what_it_sets() {
        let of: [(&str, &[&str]); 2] =
            [("garment.skirt.material", &["silk_light", "denim_11oz"]), ("body.hero.friction", &["0.2", "0.5", "1"])];
        let all = runs(&vary(&of)).unwrap();
        assert_eq!((all.len(), count(&vary(&of))), (6, 6));
        assert_eq!(all[1].name, "material=silk_light,friction=0.5");
        let settings = [("garment.skirt.material", "silk_light"), ("body.hero.friction", "0.5")];
        assert_eq!(all[1].settings, settings.map(|(key, value)| (key.to_owned(), value.to_owned())));
    }

    #[test]
    fn keys_that_end_alike_are_told_apart() {
        let of: [(&str, &[&str]); 2] =
            [("garment.skirt.material", &["wool"]), ("garment.shirt.material", &["silk_light"])];
        assert_eq!(names(&of), ["skirt.material=wool,shirt.material=silk_light"]);
        assert_eq!(names(&[("friction", &["1"]), ("body.hero.friction", &["2"])]), ["friction=1,hero.friction=2"]);
    }

    #[test]
    fn folders_keep_their_names_when_values_are_added() {
        let few = names(&[("cfl", &["4", "2"])]);
        let more = names(&[("cfl", &["8", "4", "2", "1"])]);
        assert!(few.iter().all(|name| more.contains(name)), "{few:?} {more:?}");
    }

    #[test]
    fn names_are_safe_and_distinct_whatever_the_values() {
        let all = names(&[("gravity.acceleration", &["[0, -9.81, 0]", "[0; -9.81, 0]", "../../x"])]);
        assert_eq!(all[..2], ["acceleration=0,-9.81,0", "acceleration=0--9.81,0"]);
        assert!(all.iter().all(|name| !name.contains('/')), "{all:?}");
        let long = "x".repeat(300);
        let all = names(&[("key", &[&format!("{long}a"), &format!("{long}b")])]);
        assert!(all[0] != all[1] && all.iter().all(|name| name.len() < 160), "{all:?}");
        let folded = names(&[("key", &["Wool", "wool"])]);
        assert_ne!(folded[0].to_lowercase(), folded[1].to_lowercase());
    }

    #[test]
    fn a_key_or_a_value_given_twice_is_named() {
        assert!(runs(&vary(&[("cfl", &["4"]), ("cfl", &["2"])])).unwrap_err().contains("--vary cfl: given twice"));
        assert!(runs(&vary(&[("cfl", &["4", "4"])])).unwrap_err().contains("the value 4 is given twice"));
    }
}
