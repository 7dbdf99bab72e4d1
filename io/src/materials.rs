//! Preset materials: what the solver uses of each cloth, and where every number comes from.
//!
//! Measured sources:
//!
//! * *Wang*: H. Wang, J. F. O'Brien, R. Ramamoorthi 2011, "Data-driven elastic models for cloth", as distributed with
//!   ARCSim; stretch entries c11, c22 and shear entries c33 in N/m over strain and angle, bending moduli in N·m. "mid" below is
//!   the middle of an entry's range, without what is negative: an artefact of the fit that no solver can use. The stiffer of
//!   c11 and c22 is taken as the warp.
//! * *C-IPC*: tables of the C-IPC code; thickness h, E·h or membrane stiffness in N/m, largest stretch. Its anisotropic
//!   "densities" are areal (g/m²) and are used as such. It has no bending moduli; "solid" below is what a solid sheet of that
//!   stiffness and thickness has, Y h²/12 with Y the mean of warp and weft.
//! * *drape*: where no bending modulus was measured, the rigidity with which the Cusick test falls into the middle of the
//!   published range of that cloth (docs/dev/measurements/materials.md): silk 20-40 %, plain cotton 60-76 % (68.4 % by Gan, Ly and
//!   Steven 1991), wool suiting 40-70 %, garment leather 47-70 %. Of silk the stretch too: a disc that hardly gives in its plane
//!   cannot hang down by as much as silk does. Silk weaves are stretchy and shear very easily at small strains, and stiffen
//!   with the strain (Matsudaira, "Characteristics of mechanical properties and handles of silk filament weaves", Kanazawa
//!   University, on Kawabata's instrument); what comes after the first strains is the strain limit's.
//! * *friction*: values of the calibration set of the ppf contact solver: silk 0.25, cotton 0.35, wool 0.40, denim
//!   0.50.
//!
//! Curves of force by strain: the stiffness above is that at small strains, and cloth stiffens up to `load` at its largest
//! strain. *denim*: means of six denims on Kawabata's instrument (Journal of Textiles 2016, 4614168, table 5): extension EMT
//! 5.2 % (4.7 to 5.7) at 500 gf/cm, 490 N/m, linearity LT 0.70 (0.66 to 0.78). All others are *assumed*: the largest strain above
//! is taken for the extension at 100 gf/cm, 98 N/m, the largest load of SiroFAST; for canvas and leather, which carry more without
//! stiffening, at 490 N/m. Linearities are assumed: 0.6, for silk 0.5, for leather 0.7. Paper has no curve: up to its largest strain it
//! is as linear as its computed modulus. Wang's samples (one at rest, five at a strain of 1/6) say that knits stiffen: the weft
//! of gray-interlock has c22 34 N/m at rest and 206 to 414 N/m there; they reach no load at which a fabric stops.
//!
//! Damping ratios are not measured: 1 for woven cloth, 2 for knits and leather, which ring less. What the bending rigidities
//! make of a Cusick drape test is in docs/dev/measurements/materials.md.

use std::borrow::Cow;

use drapery_core::effects::tensile_curve::TensileCurve;

/// A material: a preset, or one from a file.
#[derive(Debug, Clone, PartialEq)]
pub struct Material {
    /// Its word in the scene file.
    pub name: Cow<'static, str>,
    /// Short description.
    pub summary: Cow<'static, str>,
    /// Mass per area [kg/m²].
    pub density: f64,
    /// Thickness [m]: the default distance that cloth keeps from bodies.
    pub thickness: f64,
    /// Membrane stiffness along the threads, mean of warp and weft, for springs [N/m].
    pub stretch_stiffness: f64,
    /// Stiffness along the warp, along the weft and in shear, for membrane elements [N/m].
    pub membrane: [f64; 3],
    /// Bending rigidity, mean of all directions [N·m].
    pub bending_rigidity: f64,
    /// Largest strain that it takes: for the strain limit, and the extension at which it carries `load`.
    pub strain_limit: f64,
    /// Force per width at the largest strain, up to which it stiffens [N/m]; `None` for a material that does not.
    pub load: Option<f64>,
    /// Linearity of the curve of force by strain up to there (LT on Kawabata's instrument).
    pub linearity: f64,
    /// Damping as a fraction of critical.
    pub damping_ratio: f64,
    /// Coulomb friction on bodies and on cloth of the same material. Cloth of two materials has the mean of both.
    pub friction: f64,
    /// Source of the numbers, and the changes made to them.
    pub provenance: Cow<'static, str>,
}

impl Material {
    /// Returns the curve by which it stiffens in long steps, for springs; `None` if it does not stiffen.
    ///
    /// # Errors
    /// Its numbers do not fit each other: what is wrong, and what to do.
    pub fn curve(&self) -> Result<Option<TensileCurve>, [String; 2]> {
        let Some(load) = self.load else { return Ok(None) };
        TensileCurve::new(self.stretch_stiffness, self.strain_limit, load, self.linearity)
    }
}

/// A setting of an effect that a material brings.
#[derive(Debug)]
pub struct MaterialSetting {
    /// Its key.
    pub key: &'static str,
    /// Keys that say the same otherwise: where a scene has one of these, the material's does not count.
    pub unless: &'static [&'static str],
    /// Whether it counts in long steps alone (`integrator = "tr_bdf2"`), where the scene writes an `extension`.
    pub in_long_steps: bool,
    /// The material's number, in the SI unit; `None` if it has none.
    pub value: fn(&Material) -> Option<f64>,
}

impl MaterialSetting {
    const fn new(key: &'static str, value: fn(&Material) -> Option<f64>) -> Self {
        Self { key, unless: &[], in_long_steps: false, value }
    }

    /// A number of the curve, which goes with the material's own stiffness: where a scene has one of these keys of stiffness, there
    /// is none.
    const fn of_curve(key: &'static str, unless: &'static [&'static str], value: fn(&Material) -> Option<f64>) -> Self {
        Self { key, unless, in_long_steps: true, value }
    }
}

/// When a material brings settings of an effect.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TakesPart {
    /// If the garment asks for the effect.
    IfAskedFor,
    /// Always, and asks for the effect, unless the garment asks for this other one.
    Unless(&'static str),
}

/// An effect of a garment of which a material brings settings.
#[derive(Debug)]
pub struct MaterialEffect {
    /// The effect.
    pub effect: &'static str,
    /// When.
    pub takes_part: TakesPart,
    /// Settings that the material brings.
    pub settings: &'static [MaterialSetting],
}

const DAMPING: MaterialSetting = MaterialSetting::new("damping_ratio", |material| Some(material.damping_ratio));

const fn load(unless: &'static [&'static str]) -> MaterialSetting {
    MaterialSetting::of_curve("load", unless, |material| material.load)
}

const fn linearity(unless: &'static [&'static str]) -> MaterialSetting {
    MaterialSetting::of_curve("linearity", unless, |material| material.load.and(Some(material.linearity)))
}

/// Keys of stiffness of springs, and of a membrane.
const SPRINGS: &[&str] = &["stiffness", "spring_stiffness"];
const THREADS: &[&str] = &["warp", "weft"];

/// Effects of which materials bring settings, in every build: a garment whose effect is not in the build is refused.
pub static EFFECTS: [MaterialEffect; 4] = [
    MaterialEffect {
        effect: "membrane",
        takes_part: TakesPart::IfAskedFor,
        settings: &[
            // Before what they look at.
            load(THREADS),
            linearity(THREADS),
            MaterialSetting::new("warp", |material| Some(material.membrane[0])),
            MaterialSetting::new("weft", |material| Some(material.membrane[1])),
            MaterialSetting::new("shear", |material| Some(material.membrane[2])),
            DAMPING,
        ],
    },
    MaterialEffect {
        effect: "stretch",
        takes_part: TakesPart::Unless("membrane"),
        settings: &[
            load(SPRINGS),
            linearity(SPRINGS),
            MaterialSetting {
                unless: &["spring_stiffness"],
                ..MaterialSetting::new("stiffness", |material| Some(material.stretch_stiffness))
            },
            DAMPING,
        ],
    },
    // Who asks for springs across the edges says how stiff they are.
    MaterialEffect {
        effect: "dihedral_bending",
        takes_part: TakesPart::Unless("bending"),
        settings: &[MaterialSetting::new("stiffness", |material| Some(material.bending_rigidity)), DAMPING],
    },
    MaterialEffect {
        effect: "strain_limit",
        takes_part: TakesPart::IfAskedFor,
        settings: &[MaterialSetting::new("limit", |material| Some(material.strain_limit))],
    },
];

/// All preset materials, from light to heavy handling.
pub const PRESETS: &[Material] = &[
    Material {
        name: Cow::Borrowed("silk_light"),
        summary: Cow::Borrowed("light silk for blouses and scarves"),
        density: 0.083,
        thickness: 0.18e-3,
        stretch_stiffness: 60.0,
        membrane: [56.0, 64.0, 22.0],
        bending_rigidity: 1.1e-6,
        strain_limit: 0.065,
        load: Some(98.0),
        linearity: 0.5,
        damping_ratio: 1.0,
        friction: 0.25,
        provenance: Cow::Borrowed(
            "C-IPC silk: 0.18 mm, 83 g/m², warp to weft as 774 to 895; stretch: drape, 60 N/m (C-IPC's mean of 835 N/m, \
             with 103 in shear, is that of cloth pulled taut; silk gives way far more easily at first), shear 3/8 of it; \
             bending: drape, 1.1 µN·m (solid would be 2.3); largest stretch of polyester, both are filament yarns; \
             friction of silk; load and linearity assumed",
        ),
    },
    Material {
        name: Cow::Borrowed("polyester_lining"),
        summary: Cow::Borrowed("smooth lining"),
        density: 0.113,
        thickness: 0.25e-3,
        stretch_stiffness: 210.0,
        membrane: [288.0, 135.0, 31.0],
        bending_rigidity: 19e-6,
        strain_limit: 0.065,
        load: Some(98.0),
        linearity: 0.6,
        damping_ratio: 1.0,
        friction: 0.25,
        provenance: Cow::Borrowed(
            "Wang tango-red-jet-set: 0.113 kg/m², c11 43-227 and c22 171-405 N/m (mids 135 and \
             288, mean 212, rounded), c33 up to 63 N/m (mid 31), bending 8-36 µN·m (mean 19); \
             thickness and largest stretch of C-IPC polyester; friction as silk, both are \
             filament yarns; load and linearity assumed",
        ),
    },
    Material {
        name: Cow::Borrowed("cotton_shirting"),
        summary: Cow::Borrowed("woven cotton for shirts"),
        density: 0.150,
        thickness: 0.318e-3,
        stretch_stiffness: 261.0,
        membrane: [261.0, 261.0, 105.0],
        bending_rigidity: 14e-6,
        strain_limit: 0.061,
        load: Some(98.0),
        linearity: 0.6,
        damping_ratio: 1.0,
        friction: 0.35,
        provenance: Cow::Borrowed(
            "C-IPC isotropic cotton: 0.318 mm, E·h 261 N/m, Poisson's ratio 0.243 (shear 105 \
             N/m), 0.150 kg/m², largest stretch 6.1 %; bending: drape, 14 µN·m (solid would be \
             2.2); friction of cotton; load and linearity assumed",
        ),
    },
    Material {
        name: Cow::Borrowed("cotton_jersey"),
        summary: Cow::Borrowed("T-shirt knit"),
        density: 0.187,
        thickness: 0.6e-3,
        stretch_stiffness: 150.0,
        membrane: [224.0, 79.0, 22.0],
        bending_rigidity: 22e-6,
        strain_limit: 0.134,
        load: Some(98.0),
        linearity: 0.6,
        damping_ratio: 2.0,
        friction: 0.35,
        provenance: Cow::Borrowed(
            "Wang gray-interlock (60/40 cotton/polyester): 0.187 kg/m², c11 17-140 and c22 34-414 \
             N/m (mids 79 and 224, mean 151, rounded), c33 up to 44 N/m (mid 22, one entry of \
             -174 left out), bending 7-39 µN·m (mean 22); thickness nominal; largest stretch of \
             C-IPC wool with lycra; friction of cotton; load and linearity assumed",
        ),
    },
    Material {
        name: Cow::Borrowed("wool_suiting"),
        summary: Cow::Borrowed("woven wool for suits"),
        density: 0.235,
        thickness: 0.568e-3,
        stretch_stiffness: 97.0,
        membrane: [97.0, 97.0, 38.0],
        bending_rigidity: 11e-6,
        strain_limit: 0.085,
        load: Some(98.0),
        linearity: 0.6,
        damping_ratio: 1.0,
        friction: 0.40,
        provenance: Cow::Borrowed(
            "C-IPC isotropic wool: 0.568 mm, E·h 97 N/m, Poisson's ratio 0.277 (shear 38 N/m), \
             0.235 kg/m², largest stretch 8.5 %; bending: drape, 11 µN·m (solid would be 2.8); \
             friction of wool; load and linearity assumed",
        ),
    },
    Material {
        name: Cow::Borrowed("ponte_knit"),
        summary: Cow::Borrowed("firm double knit for jackets and dresses"),
        density: 0.284,
        thickness: 0.9e-3,
        stretch_stiffness: 122.0,
        membrane: [157.0, 88.0, 22.0],
        bending_rigidity: 33e-6,
        strain_limit: 0.134,
        load: Some(98.0),
        linearity: 0.6,
        damping_ratio: 2.0,
        friction: 0.40,
        provenance: Cow::Borrowed(
            "Wang camel-ponte-roma: 0.284 kg/m², c11 31-144 and c22 44-269 N/m (mids 88 and 157, \
             mean 122), c33 up to 45 N/m (mid 22), bending 10-50 µN·m (mean 33); thickness \
             nominal; largest stretch of C-IPC wool with lycra; friction as wool, of similar \
             surface; load and linearity assumed",
        ),
    },
    Material {
        name: Cow::Borrowed("denim_11oz"),
        summary: Cow::Borrowed("jeans"),
        density: 0.324,
        thickness: 0.66e-3,
        stretch_stiffness: 628.0,
        membrane: [1037.0, 219.0, 68.0],
        bending_rigidity: 72e-6,
        strain_limit: 0.052,
        load: Some(490.0),
        linearity: 0.7,
        damping_ratio: 1.0,
        friction: 0.50,
        provenance: Cow::Borrowed(
            "Wang 11oz-black-denim: 0.324 kg/m², c11 205-232 and c22 1014-1060 N/m (mids 219 and \
             1037, mean 628; the real cloth is five times stiffer one way), c33 53-84 N/m (mid \
             68), bending 20-121 µN·m (mean 72; six denims on Kawabata's instrument have 14-22 \
             µN·m, Journal of Textiles 2016, 4614168); thickness of C-IPC denim; largest stretch \
             5.2 %, load 490 N/m and linearity 0.70: means of the same six denims; friction of denim",
        ),
    },
    Material {
        name: Cow::Borrowed("canvas"),
        summary: Cow::Borrowed("heavy plain weave for bags and workwear"),
        density: 0.294,
        thickness: 0.53e-3,
        stretch_stiffness: 2133.0,
        membrane: [2844.0, 1422.0, 1065.0],
        bending_rigidity: 50e-6,
        strain_limit: 0.061,
        load: Some(490.0),
        linearity: 0.6,
        damping_ratio: 1.0,
        friction: 0.50,
        provenance: Cow::Borrowed(
            "C-IPC canvas: 0.53 mm, warp 2844, weft 1422 and shear 1065 N/m (mean 2133), 294 \
             g/m²; bending: solid, 50 µN·m; largest stretch of C-IPC cotton; friction as denim, \
             of similar surface; load and linearity assumed",
        ),
    },
    Material {
        name: Cow::Borrowed("leather_garment"),
        summary: Cow::Borrowed("leather for jackets"),
        density: 0.560,
        thickness: 0.8e-3,
        stretch_stiffness: 2133.0,
        membrane: [2133.0, 2133.0, 820.0],
        bending_rigidity: 36e-6,
        strain_limit: 0.1,
        load: Some(490.0),
        linearity: 0.7,
        damping_ratio: 2.0,
        friction: 0.50,
        provenance: Cow::Borrowed(
            "not measured: nominal 0.8 mm at 700 kg/m³; stretch as canvas, which is softer than \
             leather but gives way by 0.3 % only under one metre of its own weight, shear with a \
             Poisson's ratio of 0.3; bending: drape, 36 µN·m (solid would be 114); largest stretch nominal; friction \
             as denim; load and linearity assumed",
        ),
    },
    Material {
        name: Cow::Borrowed("paper"),
        summary: Cow::Borrowed("office paper"),
        density: 0.100,
        thickness: 0.13e-3,
        stretch_stiffness: 5000.0,
        membrane: [5000.0, 5000.0, 1900.0],
        bending_rigidity: 400e-6,
        strain_limit: 0.005,
        load: None,
        linearity: 1.0,
        damping_ratio: 1.0,
        friction: 0.30,
        provenance: Cow::Borrowed(
            "0.10 kg/m² and bending 400 µN·m as in Wang (computed); nominal 0.13 mm; its membrane \
             stiffness of 5e5 N/m is cut to 5000, which stretches by 0.02 % under one metre of \
             its own weight and allows ten times longer steps, shear with a Poisson's ratio of \
             0.3; largest stretch of C-IPC paper; friction nominal",
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
            let Material { name, density, thickness, stretch_stiffness, membrane, friction, .. } = material;
            let (density, thickness, friction) = (*density, *thickness, *friction);
            assert!((0.05..0.7).contains(&density), "{name}");
            // Fibres and air between them: 100 to 900 kg/m³.
            assert!((100.0..900.0).contains(&(density / thickness)), "{name}: {}", density / thickness);
            assert!((50.0..=5000.0).contains(stretch_stiffness), "{name}");
            assert!((membrane[0] + membrane[1] - 2.0 * stretch_stiffness).abs() < 5.0, "{name}: their mean");
            assert!(membrane[2] > 0.0 && membrane[2] < membrane[0].max(membrane[1]), "{name}: shear");
            // Kawabata's instrument finds 1 to 200 µN·m for cloth; paper is stiffer.
            assert!((1e-6..=4e-4).contains(&material.bending_rigidity), "{name}");
            assert!((0.005..0.2).contains(&material.strain_limit), "{name}");
            assert!((0.2..=0.5).contains(&friction), "{name}");
            for stiffness in [*stretch_stiffness, membrane[0], membrane[1]] {
                let curve = |load| TensileCurve::new(stiffness, material.strain_limit, load, material.linearity);
                let curve = material.load.map(curve);
                assert!(matches!(curve, None | Some(Ok(Some(_)))), "{name}, {stiffness} N/m: {curve:?}");
            }
            assert_eq!(find(name), Some(material));
        }
    }
}
