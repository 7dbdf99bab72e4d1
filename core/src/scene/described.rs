//! Descriptions whose values a scene sets by the rows of a table.

use crate::settings::{Field, Written};

/// A description with a table of fields.
pub trait Described {
    /// Rows of the values that a scene may set.
    const FIELDS: &'static [Field];

    /// The values as a scene would write them, by the names of the rows.
    fn written(&self) -> Written;
}

/// The table of a description: for each row its key, the value in a description (named before), its dimension, default, range and
/// help. Of a struct of which every member is the value of one row (`all of`), members are the keys, and how it is made of
/// settings, its defaults and its message to other ranks follow.
macro_rules! described {
    (all of $described:ident { $($member:ident => $dimension:ident, default $kind:ident $(($($value:tt)*))?,
        range $range:expr, $help:expr;)+ }) => {
        impl $described {
            /// With what a scene says in its table.
            pub fn of(settings: &$crate::settings::Settings) -> Self {
                Self { $($member: $crate::settings::Member::of(settings, stringify!($member))),+ }
            }
        }

        impl Default for $described {
            /// The defaults of the rows.
            fn default() -> Self {
                Self::of(&$crate::settings::Settings::defaults(<Self as $crate::scene::Described>::FIELDS))
            }
        }

        $crate::parallel::message::codec!(struct $described { $($member),+ });
        $crate::scene::described::described!($described as it {
            $(stringify!($member), it.$member => $dimension, default $kind $(($($value)*))?,
                range $range, $help;)+
        });
    };
    ($described:ident as $it:ident { $($key:expr, $member:expr => $dimension:ident,
        default $kind:ident $(($($value:tt)*))?, range $range:expr, $help:expr;)+ }) => {
        impl $crate::scene::Described for $described {
            const FIELDS: &'static [$crate::settings::Field] = &[$($crate::settings::Field {
                name: $key,
                dimension: $crate::settings::Dimension::$dimension,
                default: $crate::settings::Default::$kind $(($($value)*))?,
                range: $range,
                help: $help,
            }),+];

            fn written(&self) -> $crate::settings::Written {
                let $it = self;
                $crate::settings::written([$(($key, $crate::settings::Member::value(&$member))),+])
            }
        }
    };
}
pub(crate) use described;
