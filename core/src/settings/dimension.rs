//! Physical dimensions, and the units that a text may name.

/// Physical dimension of a field.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Dimension {
    /// A pure number.
    None,
    /// Length, SI unit m.
    Length,
    /// Force, SI unit N.
    Force,
    /// Force per length, SI unit N/m.
    Stiffness,
    /// Acceleration, SI unit m/s².
    Acceleration,
    /// Speed, SI unit m/s.
    Speed,
    /// Mass, SI unit kg.
    Mass,
    /// Areal density, SI unit kg/m².
    ArealDensity,
    /// Time, SI unit s.
    Time,
    /// Rate, SI unit 1/s.
    Rate,
    /// Density of a fluid, SI unit kg/m³.
    Density,
    /// Force per area and speed, SI unit N s/m³.
    Drag,
    /// Force per area, SI unit Pa.
    Pressure,
    /// Bending rigidity: moment per width and curvature, SI unit N·m.
    BendingRigidity,
    /// Angle, SI unit rad.
    Angle,
}

impl Dimension {
    /// Units that may be written, each with the factor to SI; the SI unit comes first.
    pub fn units(self) -> &'static [(&'static str, f64)] {
        match self {
            Self::None => &[("", 1.0), ("%", 0.01)],
            Self::Length => &[("m", 1.0), ("cm", 1e-2), ("mm", 1e-3), ("in", 0.0254)],
            Self::Force => &[("N", 1.0), ("mN", 1e-3), ("gf", 9.80665e-3)],
            Self::Stiffness => &[("N/m", 1.0), ("mN/m", 1e-3), ("N/cm", 100.0), ("N/mm", 1000.0)],
            Self::Acceleration => &[("m/s²", 1.0), ("m/s^2", 1.0), ("m/s2", 1.0), ("cm/s²", 1e-2), ("cm/s^2", 1e-2)],
            Self::Speed => &[("m/s", 1.0), ("cm/s", 1e-2), ("mm/s", 1e-3)],
            Self::Mass => &[("kg", 1.0), ("g", 1e-3)],
            Self::ArealDensity => {
                &[("kg/m²", 1.0), ("kg/m^2", 1.0), ("kg/m2", 1.0), ("g/m²", 1e-3), ("g/m^2", 1e-3), ("gsm", 1e-3)]
            }
            Self::Time => &[("s", 1.0), ("ms", 1e-3)],
            Self::Rate => &[("1/s", 1.0)],
            Self::Density => &[("kg/m³", 1.0), ("kg/m^3", 1.0), ("kg/m3", 1.0)],
            Self::Drag => &[("N s/m³", 1.0), ("N s/m^3", 1.0), ("N s/m3", 1.0)],
            Self::Pressure => &[("Pa", 1.0), ("hPa", 100.0), ("kPa", 1000.0), ("mbar", 100.0)],
            // Kawabata's instrument gives gf·cm²/cm.
            Self::BendingRigidity => &[
                ("N·m", 1.0),
                ("N m", 1.0),
                ("Nm", 1.0),
                ("mN·m", 1e-3),
                ("µN·m", 1e-6),
                ("uNm", 1e-6),
                ("gf·cm²/cm", 9.80665e-5),
            ],
            Self::Angle => &[("rad", 1.0), ("deg", std::f64::consts::PI / 180.0)],
        }
    }

    /// The SI unit as text; empty for pure numbers.
    pub fn si_unit(self) -> &'static str {
        self.units()[0].0
    }

    /// Reads `"2 mm"` as 0.002; `Err` says what was expected.
    ///
    /// # Errors
    /// The text is not a number followed by a unit of this dimension.
    pub fn parse(self, text: &str) -> Result<f64, String> {
        let text = text.trim();
        let split = text
            .char_indices()
            .find(|(i, c)| !(c.is_ascii_digit() || "+-._".contains(*c) || is_exponent(text, *i)))
            .map_or(text.len(), |(i, _)| i);
        let (number, unit) = (text[..split].trim(), text[split..].trim());
        let expected = || {
            let units: Vec<_> = self.units().iter().map(|u| u.0).filter(|u| !u.is_empty()).collect();
            match self {
                Self::None => "a number".to_owned(),
                _ => format!("a number with one of the units {}", units.join(", ")),
            }
        };
        let value: f64 = number.parse().map_err(|_| format!("`{text}` is not a number; expected {}", expected()))?;
        if unit.is_empty() {
            return Ok(value);
        }
        let factor = self.units().iter().find(|(name, _)| *name == unit).map(|(_, factor)| *factor);
        factor.map(|f| value * f).ok_or_else(|| format!("unit `{unit}` does not fit here; expected {}", expected()))
    }
}

/// Whether the character at `i` is the `e` of an exponent (`1e-3`), not the start of a unit.
fn is_exponent(text: &str, i: usize) -> bool {
    let rest = &text[i..];
    let follows = rest.strip_prefix(['e', 'E']).and_then(|r| r.strip_prefix(['+', '-']).or(Some(r)));
    i > 0 && follows.is_some_and(|r| r.starts_with(|c: char| c.is_ascii_digit()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_are_converted_to_si_and_wrong_ones_refused() {
        assert_eq!(Dimension::Length.parse("2 mm"), Ok(0.002));
        assert_eq!(Dimension::Length.parse("1e-3m"), Ok(0.001));
        assert_eq!(Dimension::ArealDensity.parse("150 g/m²"), Ok(0.15));
        assert!(Dimension::Length.parse("2 N").unwrap_err().contains("mm"));
        assert!(Dimension::Length.parse("wide").is_err());
    }
}
