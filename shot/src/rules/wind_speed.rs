//! A wind that no storm has.

use drapery_core::Vec3;
use drapery_core::settings::SettingValue;

use super::{Facts, Finding};

/// The fastest gust ever measured outside a tornado, over Barrow Island in 1996 [m/s] (World Meteorological Organization, archive of
/// weather and climate extremes).
const FASTEST_GUST: f64 = 113.0;

/// The effect's name; a build without wind has none of its items.
const WIND: &str = "wind";

pub(super) fn find(facts: &Facts<'_>) -> Vec<Finding> {
    let settings = facts.request(WIND).map(|request| &request.settings);
    settings.into_iter().flatten().filter_map(|(key, value)| of_setting(key, value)).collect()
}

/// Finds faults of `velocity` or `keys`; other settings are no velocities.
fn of_setting(key: &str, value: &SettingValue) -> Option<Finding> {
    let fastest = match value {
        SettingValue::Vector(velocity) => Vec3::from(*velocity).norm(),
        SettingValue::Keys(keys) => keys.iter().map(|(_, velocity)| Vec3::from(*velocity).norm()).fold(0.0, f64::max),
        SettingValue::Number(_) | SettingValue::Text(_) | SettingValue::Flag(_) => return None,
    };
    (fastest > FASTEST_GUST).then(|| Finding {
        object: WIND.to_owned(),
        message: format!(
            "`{key}` reaches {fastest:.0} m/s, faster than any gust measured outside a tornado ({FASTEST_GUST} m/s); \
             numbers of a scene are in metres per second, `[units]` applies to files only"
        ),
        line: format!("`{key}` in m/s: a hundredth of this number, if meant in cm/s"),
    })
}
