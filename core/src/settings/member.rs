//! Members of a description that settings fill, and read back for checks.

use std::collections::BTreeMap;

use super::{SettingValue, Settings};

/// Values of a table by name, as written.
pub type Written = BTreeMap<String, SettingValue>;

/// Values by name, but for those that are left out.
pub(crate) fn written<const N: usize>(values: [(&str, Option<SettingValue>); N]) -> Written {
    values.into_iter().filter_map(|(name, value)| Some((name.to_owned(), value?))).collect()
}

/// A type that one setting fills.
pub trait Member: Sized {
    /// Reads the value under a name from checked settings.
    fn of(settings: &Settings, name: &str) -> Self;

    /// The value that a scene would write for it; `None` to leave it out.
    fn value(&self) -> Option<SettingValue>;
}

impl Member for f64 {
    fn of(settings: &Settings, name: &str) -> Self {
        settings.number(name)
    }

    fn value(&self) -> Option<SettingValue> {
        Some(SettingValue::Number(*self))
    }
}

impl Member for Option<f64> {
    fn of(settings: &Settings, name: &str) -> Self {
        settings.optional(name)
    }

    fn value(&self) -> Option<SettingValue> {
        self.map(SettingValue::Number)
    }
}

impl Member for usize {
    fn of(settings: &Settings, name: &str) -> Self {
        settings.number(name) as Self
    }

    fn value(&self) -> Option<SettingValue> {
        Some(SettingValue::Number(*self as f64))
    }
}

impl Member for bool {
    fn of(settings: &Settings, name: &str) -> Self {
        settings.flag(name)
    }

    fn value(&self) -> Option<SettingValue> {
        Some(SettingValue::Flag(*self))
    }
}

impl Member for [f64; 3] {
    fn of(settings: &Settings, name: &str) -> Self {
        settings.vector(name)
    }

    fn value(&self) -> Option<SettingValue> {
        Some(SettingValue::Vector(*self))
    }
}

/// An enum whose variants are words of a scene; what is said of a variant is the help of its word.
#[doc(hidden)]
#[macro_export]
macro_rules! choice {
    ($(#[$about:meta])* $visible:vis enum $choice:ident {
        $($(#[doc = $help:literal])+ $variant:ident = $word:literal,)+
    }) => {
        $(#[$about])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq)]
        $visible enum $choice {
            $($(#[doc = $help])+ $variant,)+
        }

        impl $choice {
            /// The words, in the order of the variants.
            $visible const WORDS: &'static [$crate::settings::Word] =
                &[$($crate::settings::Word { name: $word, help: concat!($($help),+).trim_ascii() }),+];
        }

        impl $crate::settings::Member for $choice {
            fn of(settings: &$crate::settings::Settings, name: &str) -> Self {
                match settings.text(name) {
                    $(Some($word) => Self::$variant,)+
                    other => panic!("field `{name}` is declared with the words of {}, not {other:?}", stringify!($choice)),
                }
            }

            fn value(&self) -> Option<$crate::settings::SettingValue> {
                let word = match self {
                    $(Self::$variant => $word,)+
                };
                Some($crate::settings::SettingValue::Text(word.to_owned()))
            }
        }
    };
}

#[cfg(test)]
mod tests {
    use crate::settings::{Default, Dimension, Field, Member, Settings};

    choice! {
        /// When.
        enum When {
            /// Before
            /// noon.
            Early = "early",
            /// Afterwards.
            Late = "late",
        }
    }

    #[test]
    fn a_word_of_a_scene_becomes_a_variant_and_back() {
        let default = Default::Choice("late", When::WORDS);
        let field = Field { name: "when", dimension: Dimension::None, default, range: (0.0, 0.0), help: "" };
        for (when, word) in [(When::Early, "early"), (When::Late, "late")] {
            let written = [("when".to_owned(), when.value().unwrap())].into();
            let settings = Settings::check(&[field], &written).unwrap();
            assert_eq!((settings.text("when"), When::of(&settings, "when")), (Some(word), when));
        }
        assert_eq!([When::WORDS[0].help, When::WORDS[1].help], ["Before noon.", "Afterwards."]);
    }
}
