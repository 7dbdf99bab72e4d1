//! Key-value text attached to archives, objects and properties.

use std::collections::BTreeMap;

/// A map from key to value; serialised as `key=value` pairs joined by `;` in ascending key order.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct MetaData {
    pairs: BTreeMap<String, String>,
}

impl MetaData {
    /// No pairs.
    pub fn new() -> Self {
        Self::default()
    }

    /// The pairs in `text`. The first occurrence of a key wins; pieces without `=` are ignored.
    pub fn parse(text: &str) -> Self {
        let mut pairs = BTreeMap::new();
        for (key, value) in text.split(';').filter_map(|piece| piece.split_once('=')) {
            pairs.entry(key.to_owned()).or_insert_with(|| value.to_owned());
        }
        Self { pairs }
    }

    /// The same pairs and one more; an existing key gets the new value.
    ///
    /// The format cannot store `;` and `=` in keys and values: they become `,` and `:`. Pairs with an empty value are
    /// not stored.
    #[must_use]
    pub fn with(mut self, key: &str, value: &str) -> Self {
        let storable = |text: &str| text.replace(';', ",").replace('=', ":").replace('\0', " ");
        self.pairs.insert(storable(key), storable(value));
        self
    }

    /// Value of `key`.
    pub fn get(&self, key: &str) -> Option<&str> {
        self.pairs.get(key).map(String::as_str)
    }

    /// All pairs in ascending key order.
    pub fn iter(&self) -> impl Iterator<Item = (&str, &str)> {
        self.pairs.iter().map(|(key, value)| (key.as_str(), value.as_str()))
    }

    /// The stored form.
    pub fn serialise(&self) -> String {
        let pairs: Vec<String> =
            self.iter().filter(|(_, value)| !value.is_empty()).map(|(key, value)| format!("{key}={value}")).collect();
        pairs.join(";")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_occurrence_of_a_key_wins_and_broken_pieces_are_ignored() {
        let metadata = MetaData::parse("b=2;a=1;nonsense;a=3;c=x=y");
        assert_eq!(metadata.get("a"), Some("1"));
        assert_eq!(metadata.get("c"), Some("x=y"));
        assert_eq!(metadata.get("nonsense"), None);
    }

    #[test]
    fn keys_are_stored_in_ascending_order_and_empty_values_left_out() {
        let metadata = MetaData::new().with("b", "2;3").with("a", "1").with("empty", "");
        assert_eq!(metadata.serialise(), "a=1;b=2,3");
    }
}
