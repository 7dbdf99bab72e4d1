//! Doing without effects that a description asks for: `[effects]` of a scene file, `--without` and `--only`.

use crate::effects;
use crate::effects::LISTED;
use crate::error::Problem;
use crate::scene::SceneDescription;
use crate::settings::nearest;

impl SceneDescription {
    /// Takes these effects out, on all garments, and what only they were for: pins, seams, the grid of the wind, and bodies that no pin follows.
    ///
    /// # Errors
    /// Names of no effect, and effects that the scene does not ask for; the description is then as it was.
    pub fn leave_out(&mut self, names: &[String]) -> Result<(), Vec<Problem>> {
        self.all_asked_for("effects.without", names)?;
        let driven: Vec<String> =
            self.curves.keys().filter(|path| self.number_place(path).is_some()).cloned().collect();
        let is_out = |name: &str| names.iter().any(|out| out == name);
        self.effects.retain(|request| !is_out(&request.effect));
        effects::INPUTS.iter().filter(|input| is_out(input.effect)).for_each(|input| (input.remove)(self));
        self.drop_rules_without_effect();
        for path in driven.into_iter().filter(|path| !path.starts_with("contact.")) {
            if self.number_place(&path).is_none() {
                self.curves.remove(&path);
            }
        }
        self.left_out.extend_from_slice(names);
        Ok(())
    }

    /// Takes out all effects but these, as [`SceneDescription::leave_out`] does.
    ///
    /// # Errors
    /// As there.
    pub fn keep_only(&mut self, names: &[String]) -> Result<(), Vec<Problem>> {
        self.all_asked_for("effects.only", names)?;
        let mut others: Vec<String> = self.effects.iter().map(|request| request.effect.clone()).collect();
        others.retain(|name| !names.contains(name));
        others.dedup();
        self.leave_out(&others)
    }

    /// Every name is that of an effect that the scene asks for.
    fn all_asked_for(&self, place: &str, names: &[String]) -> Result<(), Vec<Problem>> {
        let problems: Vec<Problem> = names.iter().filter_map(|name| self.not_asked_for(place, name)).collect();
        if problems.is_empty() { Ok(()) } else { Err(problems) }
    }

    fn not_asked_for(&self, place: &str, name: &str) -> Option<Problem> {
        if self.effects.iter().any(|request| request.effect == name) {
            return None;
        }
        if name == "friction" {
            let what = "friction is not an effect of its own: it is part of body_collision and of self_repulsion";
            return Some(Problem::scene(place, what, "set `friction` of the bodies or of [self_repulsion] to 0"));
        }
        if effects::find(name).is_none() {
            let names = LISTED.iter().copied();
            let advice = match nearest(name, names.clone()) {
                Some(best) => format!("did you mean `{best}`?"),
                None => format!("the effects are {}", names.collect::<Vec<_>>().join(", ")),
            };
            return Some(Problem::scene(place, format!("there is no effect `{name}`"), advice));
        }
        let mut asked: Vec<&str> = self.effects.iter().map(|request| request.effect.as_str()).collect();
        asked.dedup();
        let advice = format!("the scene asks for {}", asked.join(", "));
        Some(Problem::scene(place, format!("the scene does not ask for `{name}`"), advice))
    }
}
