//! Preset materials: what the solver uses of each cloth today, and where every number comes from.
//!
//! In-plane stiffness is isotropic for now, so a preset holds the mean of warp and weft; cloth whose warp and weft
//! differ (denim five-fold) needs anisotropic stretch, which is not here yet. Measured sources:
//!
//! * *Wang*: H. Wang, J. F. O'Brien, R. Ramamoorthi 2011, "Data-driven elastic models for cloth", as distributed with
//!   ARCSim; stretch entries c11 and c22 in N/m over strain and angle. "mid" below is the middle of an entry's range.
//! * *C-IPC*: tables of the C-IPC code; thickness, E·h or membrane stiffness in N/m. Its anisotropic "densities" are
//!   areal
//!   (g/m²) and are used as such.
//! * *friction*: values of the calibration set of the ppf contact solver: silk 0.25, cotton 0.35, wool 0.40, denim
//!   0.50.
//!
//! The stiffness of bending springs is not measured: a bending spring's resistance depends on the mesh. It is a share
//! of the stretch stiffness (5 % soft, 10 % firm, 20 % stiff), ordered like the measured bending moduli. Damping
//! ratios are not measured either: 1 for woven cloth, 2 for knits and leather, which ring less.

use std::borrow::Cow;

/// A material: a preset, or one from a file.
#[derive(Debug, Clone, PartialEq)]
pub struct Material {
    /// Its word in the scene file.
    pub name: Cow<'static, str>,
    /// What it is.
    pub summary: Cow<'static, str>,
    /// Mass per area [kg/m²].
    pub density: f64,
    /// Thickness [m]: the default distance that cloth keeps from bodies.
    pub thickness: f64,
    /// Membrane stiffness along the threads, mean of warp and weft [N/m].
    pub stretch_stiffness: f64,
    /// Membrane stiffness of the bending springs [N/m].
    pub bending_stiffness: f64,
    /// Damping as a fraction of critical.
    pub damping_ratio: f64,
    /// Coulomb friction against bodies.
    pub friction: f64,
    /// Where the numbers come from and what was done to them.
    pub provenance: Cow<'static, str>,
}

/// All preset materials, from light to heavy handling.
pub const PRESETS: &[Material] = &[
    Material {
        name: Cow::Borrowed("silk_light"),
        summary: Cow::Borrowed("light silk for blouses and scarves"),
        density: 0.083,
        thickness: 0.18e-3,
        stretch_stiffness: 835.0,
        bending_stiffness: 42.0,
        damping_ratio: 1.0,
        friction: 0.25,
        provenance: Cow::Borrowed(
            "C-IPC silk: 0.18 mm, warp 774 and weft 895 N/m (mean 835), 83 g/m²; bending 5 %; \
                     friction of silk",
        ),
    },
    Material {
        name: Cow::Borrowed("polyester_lining"),
        summary: Cow::Borrowed("smooth lining"),
        density: 0.113,
        thickness: 0.25e-3,
        stretch_stiffness: 210.0,
        bending_stiffness: 10.0,
        damping_ratio: 1.0,
        friction: 0.25,
        provenance: Cow::Borrowed(
            "Wang tango-red-jet-set: 0.113 kg/m², c11 43-227 and c22 171-405 N/m (mids 135 and 288, \
                     mean 212, rounded); thickness of C-IPC polyester; bending 5 %; friction as silk, both \
                     are filament yarns",
        ),
    },
    Material {
        name: Cow::Borrowed("cotton_shirting"),
        summary: Cow::Borrowed("woven cotton for shirts"),
        density: 0.150,
        thickness: 0.318e-3,
        stretch_stiffness: 261.0,
        bending_stiffness: 13.0,
        damping_ratio: 1.0,
        friction: 0.35,
        provenance: Cow::Borrowed(
            "C-IPC isotropic cotton: 0.318 mm, E·h 261 N/m, 0.150 kg/m²; bending 5 %; friction of \
                     cotton",
        ),
    },
    Material {
        name: Cow::Borrowed("cotton_jersey"),
        summary: Cow::Borrowed("T-shirt knit"),
        density: 0.187,
        thickness: 0.6e-3,
        stretch_stiffness: 150.0,
        bending_stiffness: 7.5,
        damping_ratio: 2.0,
        friction: 0.35,
        provenance: Cow::Borrowed(
            "Wang gray-interlock (60/40 cotton/polyester): 0.187 kg/m², c11 17-140 and c22 34-414 N/m \
                     (mids 79 and 224, mean 151, rounded); thickness nominal; bending 5 %; friction of cotton",
        ),
    },
    Material {
        name: Cow::Borrowed("wool_suiting"),
        summary: Cow::Borrowed("woven wool for suits"),
        density: 0.235,
        thickness: 0.568e-3,
        stretch_stiffness: 97.0,
        bending_stiffness: 9.7,
        damping_ratio: 1.0,
        friction: 0.40,
        provenance: Cow::Borrowed(
            "C-IPC isotropic wool: 0.568 mm, E·h 97 N/m, 0.235 kg/m²; bending 10 %; friction of wool",
        ),
    },
    Material {
        name: Cow::Borrowed("ponte_knit"),
        summary: Cow::Borrowed("firm double knit for jackets and dresses"),
        density: 0.284,
        thickness: 0.9e-3,
        stretch_stiffness: 122.0,
        bending_stiffness: 12.0,
        damping_ratio: 2.0,
        friction: 0.40,
        provenance: Cow::Borrowed(
            "Wang camel-ponte-roma: 0.284 kg/m², c11 31-144 and c22 44-269 N/m (mids 88 and 157, mean \
                     122); thickness nominal; bending 10 %; friction as wool, of similar surface",
        ),
    },
    Material {
        name: Cow::Borrowed("denim_11oz"),
        summary: Cow::Borrowed("jeans"),
        density: 0.324,
        thickness: 0.66e-3,
        stretch_stiffness: 628.0,
        bending_stiffness: 63.0,
        damping_ratio: 1.0,
        friction: 0.50,
        provenance: Cow::Borrowed(
            "Wang 11oz-black-denim: 0.324 kg/m², c11 205-232 and c22 1014-1060 N/m (mids 219 and \
                     1037, mean 628; the real cloth is five times stiffer one way); thickness of C-IPC denim; \
                     bending 10 %; friction of denim",
        ),
    },
    Material {
        name: Cow::Borrowed("canvas"),
        summary: Cow::Borrowed("heavy plain weave for bags and workwear"),
        density: 0.294,
        thickness: 0.53e-3,
        stretch_stiffness: 2133.0,
        bending_stiffness: 427.0,
        damping_ratio: 1.0,
        friction: 0.50,
        provenance: Cow::Borrowed(
            "C-IPC canvas: 0.53 mm, warp 2844 and weft 1422 N/m (mean 2133), 294 g/m²; bending 20 %; \
                     friction as denim, of similar surface",
        ),
    },
    Material {
        name: Cow::Borrowed("leather_garment"),
        summary: Cow::Borrowed("leather for jackets"),
        density: 0.560,
        thickness: 0.8e-3,
        stretch_stiffness: 2133.0,
        bending_stiffness: 427.0,
        damping_ratio: 2.0,
        friction: 0.50,
        provenance: Cow::Borrowed(
            "not measured: nominal 0.8 mm at 700 kg/m³; stretch as canvas, which is softer than \
                     leather but gives way by 0.3 % only under one metre of its own weight; bending 20 %; \
                     friction as denim",
        ),
    },
    Material {
        name: Cow::Borrowed("paper"),
        summary: Cow::Borrowed("office paper"),
        density: 0.100,
        thickness: 0.13e-3,
        stretch_stiffness: 5000.0,
        bending_stiffness: 1000.0,
        damping_ratio: 1.0,
        friction: 0.30,
        provenance: Cow::Borrowed(
            "0.10 kg/m² as in Wang (computed); nominal 0.13 mm; its membrane stiffness of 5e5 N/m is \
                     cut to 5000, which stretches by 0.02 % under one metre of its own weight and allows ten \
                     times longer steps; bending 20 %; friction nominal",
        ),
    },
];

/// The preset of this name.
pub fn find(name: &str) -> Option<&'static Material> {
    PRESETS.iter().find(|material| material.name == name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn presets_are_cloth_not_kilograms_per_cubic_metre() {
        for material in PRESETS {
            let Material { name, density, thickness, stretch_stiffness, bending_stiffness, friction, .. } = material;
            let (density, thickness, friction) = (*density, *thickness, *friction);
            assert!((0.05..0.7).contains(&density), "{name}");
            // Fibres and air between them: 100 to 900 kg/m³.
            assert!((100.0..900.0).contains(&(density / thickness)), "{name}: {}", density / thickness);
            assert!((50.0..=5000.0).contains(stretch_stiffness), "{name}");
            let share = bending_stiffness / stretch_stiffness;
            assert!((0.045..0.21).contains(&share), "{name}: {share}");
            assert!((0.2..=0.5).contains(&friction), "{name}");
            assert_eq!(find(name), Some(material));
        }
    }
}
