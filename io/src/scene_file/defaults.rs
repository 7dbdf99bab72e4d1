//! Default value of a key of a scene, where the scene does not state it: for comparing scenes that programs of
//! different age have written out.

use drapery_core::effects::Scope;
use drapery_core::geometry::shapes::Shape;
use drapery_core::settings::Field;
use serde_json::Value;

use super::effects;
use super::fields::{self, EACH, SHAPE, TABLES};
use super::raw::Document;

/// The defaults of all keys that this program knows.
#[derive(Debug)]
pub struct Defaults {
    /// Defaults of the keys that are read by structs.
    schema: Value,
}

impl Default for Defaults {
    fn default() -> Self {
        Self { schema: schemars::schema_for!(Document).to_value() }
    }
}

impl Defaults {
    /// The default of a key, as in `garment[0].pin[1].damping_ratio`; `None` if it has none that holds everywhere.
    pub fn of(&self, key: &str) -> Option<toml::Value> {
        let keys = path(key);
        let (name, table) = keys.split_last()?;
        match rows(table) {
            Some(mut rows) if rows.iter().any(|field| field.name == *name) => {
                rows.retain(|field| field.name == *name);
                fields::default(rows.first()?)
            }
            _ => toml::Value::try_from(self.property(&keys)?.get("default")?).ok(),
        }
    }

    /// Whether a table is there in every scene in which the table around it is, as `solver` and `shot.preroll` are; one of an
    /// effect is not: without it the effect does not exist.
    pub fn is_always_there(&self, table: &str) -> bool {
        self.property(&path(table)).and_then(|property| property.get("default")).is_some_and(Value::is_object)
    }

    /// Returns the schema that the structs give for a key.
    fn property(&self, keys: &[&str]) -> Option<&Value> {
        keys.iter().try_fold(&self.schema, |node, key| {
            let node = self.referred(node);
            if *key == EACH { node.get("items") } else { node.get("properties")?.get(key) }
        })
    }

    /// The struct itself where only its name stands, also where it may be left out.
    fn referred<'a>(&'a self, node: &'a Value) -> &'a Value {
        let named = |node: &'a Value| self.schema.pointer(node.get("$ref")?.as_str()?.strip_prefix('#')?);
        let choices = node.get("anyOf").and_then(Value::as_array).into_iter().flatten();
        [node].into_iter().chain(choices).find_map(named).unwrap_or(node)
    }
}

/// Keys of a path; an index in a list becomes [`EACH`].
fn path(key: &str) -> Vec<&str> {
    let segments = key.split('.').flat_map(|segment| segment.split('['));
    segments.map(|word| if word.ends_with(']') { EACH } else { word }).collect()
}

/// The rows of a table, if it has some.
fn rows(table: &[&str]) -> Option<Vec<&'static Field>> {
    let of_effects =
        |scope, name: &str| effects::with_table(scope).find(|spec| spec.name == name).map(|spec| spec.fields);
    let fields = match table {
        [name] if TABLES.iter().all(|rows| rows.path != table) => of_effects(Scope::Scene, name)?,
        ["garment", EACH, name] => of_effects(Scope::Garment, name)?,
        ["body", EACH, SHAPE, name] => Shape::SPECS.iter().find(|spec| spec.name == *name)?.fields,
        _ => return TABLES.iter().find(|rows| rows.path == table).map(|rows| rows.fields().collect()),
    };
    Some(fields.iter().collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene_file::parse;

    #[test]
    fn defaults_are_known_of_tables_of_every_kind() {
        let defaults = Defaults::default();
        for (key, value) in [
            ("solver.steps_per_frame", toml::Value::Integer(8)),
            ("solver.integrator", "semi_implicit".into()),
            ("gravity.acceleration", vec![0.0, -9.81, 0.0].into()),
            ("garment[3].dihedral_bending.flat", false.into()),
            ("garment[0].pin[12].axes", "xyz".into()),
            ("body[0].max_push_speed", f64::INFINITY.into()),
            ("seam[1].pairing", "auto".into()),
            ("garment[0].velocity", vec![0.0; 3].into()),
            ("garment[0].panel.aspect", 1.7.into()),
            ("shot.preroll.blend", 0.into()),
            ("output.velocities", true.into()),
        ] {
            assert_eq!(defaults.of(key), Some(value), "{key}");
        }
        for key in [
            "solver.preset",
            "garment[0].name",
            "body[0].shape.sphere.radius",
            "nowhere.at_all",
            "garment[0].panel",
            "shot.first_frame",
        ] {
            assert_eq!(defaults.of(key), None, "{key}");
        }
        for (table, always) in [("solver", true), ("shot.preroll", true), ("output", true), ("gravity", false)] {
            assert_eq!(defaults.is_always_there(table), always, "{table}");
        }
        assert!(!defaults.is_always_there("garment[0].stretch") && !defaults.is_always_there("garment[0].panel"));
    }

    #[test]
    fn what_a_resolved_scene_calls_a_default_is_the_default() {
        let scene = "drapery = 1\nshot.frames = \"1-2\"\n[gravity]\n[wind]\nvelocity = [1, 0, 0]\n[self_repulsion]\n[self_collision]\n\
                     [[body]]\nname = \"b\"\nshape.sphere.radius = 0.1\n[[garment]]\nname = \"g\"\nthickness = \"1 mm\"\n\
                     [garment.panel]\nresolution = 3\n[garment.stretch]\nstiffness = 40\n[[garment.pin]]\ncorners = [\"i0j0\"]\n";
        let scene = parse(scene, "s.toml", std::path::Path::new(""), &[]).unwrap();
        let (defaults, mut table, mut seen) = (Defaults::default(), String::new(), 0);
        let resolved = crate::scene_file::resolved::write(&scene, &scene.root);
        for line in resolved.lines() {
            if let Some(name) = line.strip_prefix('[') {
                let place = name.trim_matches(['[', ']']).to_owned();
                table = place.replace("garment", "garment[0]").replace("body", "body[0]").replace("pin", "pin[0]");
            }
            let Some((entry, "default")) = line.split_once('#').map(|(entry, from)| (entry, from.trim())) else {
                continue;
            };
            let (key, value) = entry.split_once('=').unwrap();
            let key = format!("{table}.{}", key.trim());
            let value: toml::Table = toml::from_str(&format!("x = {}", value.trim())).unwrap();
            // The name of the file, and the volume that a material or a panel gives.
            if key == "shot.name" {
                continue;
            }
            assert_eq!(defaults.of(&key).as_ref(), Some(&value["x"]), "{key}\n{resolved}");
            seen += 1;
        }
        assert!(seen > 30, "{resolved}");
    }
}
