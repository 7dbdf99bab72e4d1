//! Skeletons of `UsdSkel`: joints, how they were when the mesh was bound to them, and how they move.

use std::collections::HashMap;

use openusd::sdf::Value;
use openusd::usd::{AttributeQuery, Prim};

use super::error::UsdError;
use super::matrix::{Matrix, from_quaternion, inverse, multiply, scale, translation};
use super::reading::Reading;
use super::transform::Transform;
use super::values::{matrices, quaternions, vectors, words};

/// A skeleton, and what moves it.
pub(crate) struct Skeleton {
    path: String,
    /// Paths of its joints, parents before children.
    pub(crate) joints: Vec<String>,
    parents: Vec<Option<usize>>,
    /// From the space of the skeleton to that of each joint, when the mesh was bound.
    unbind: Vec<Matrix>,
    /// Each joint in its parent, where nothing moves it.
    rest: Option<Vec<Matrix>>,
    pub(crate) animation: Option<Animation>,
    /// From its space to the world.
    pub(crate) transform: Transform,
}

/// Source of a skeleton's motion (`SkelAnimation`).
pub(crate) struct Animation {
    path: String,
    /// Place among the skeleton's joints of each joint that it moves.
    joints: Vec<Option<usize>>,
    translations: AttributeQuery,
    rotations: AttributeQuery,
    scales: AttributeQuery,
    /// Blend shapes that it weighs.
    pub(crate) shapes: Vec<String>,
    pub(crate) weights: AttributeQuery,
}

impl Skeleton {
    /// The skeleton that is this prim.
    pub(crate) fn of(reading: &Reading, prim: &Prim) -> Result<Self, UsdError> {
        let path = prim.path().as_str().to_owned();
        let bad = |what: String| reading.bad(path.as_str(), what, "export the character again, with its bind pose");
        let list = |name: &str| reading.value(&prim.attribute(name));
        let joints = list("joints")?.as_ref().and_then(words).unwrap_or_default();
        let count = joints.len();
        let fitting = |name: &str| -> Result<Option<Vec<Matrix>>, UsdError> {
            let found = list(name)?.as_ref().and_then(matrices);
            match found {
                Some(found) if found.len() != count => {
                    Err(bad(format!("it has {count} joints and {} {name}", found.len())))
                }
                found => Ok(found),
            }
        };
        let rest = fitting("restTransforms")?;
        let bind = fitting("bindTransforms")?
            .ok_or_else(|| bad("it has no bindTransforms, so the bind pose of its mesh is unknown".into()))?;
        let unbind = bind.iter().zip(&joints).map(|(bind, joint)| {
            inverse(bind).ok_or_else(|| bad(format!("the bind transform of joint {joint} has no inverse")))
        });
        let unbind = unbind.collect::<Result<_, _>>()?;
        let parents = parents(&joints).map_err(bad)?;
        let animation = match animation_of(reading, prim)? {
            Some(animation) => Some(Animation::of(reading, &animation, &joints)?),
            None => None,
        };
        let transform = Transform::of(reading, prim)?;
        Ok(Self { path, joints, parents, unbind, rest, animation, transform })
    }

    /// Codes at which something of it is stored.
    pub(crate) fn times(&self, reading: &Reading) -> Result<Vec<f64>, UsdError> {
        let mut times = self.transform.times(reading)?;
        if let Some(animation) = &self.animation {
            for query in [&animation.translations, &animation.rotations, &animation.scales] {
                times.extend(reading.times(query)?);
            }
        }
        Ok(times)
    }

    /// Returns the matrix with which each joint moves the geometry bound to it, within the space of the skeleton.
    pub(crate) fn pose(&self, reading: &Reading, code: f64) -> Result<Vec<Matrix>, UsdError> {
        let bad = |what: String| reading.bad(self.path.as_str(), what, "export the character again");
        let mut local = match (&self.rest, &self.animation) {
            (Some(rest), _) => rest.clone(),
            // All of them are moved.
            (None, Some(animation)) if animation.moves_all(self.joints.len()) => vec![[0.0; 16]; self.joints.len()],
            (None, Some(_)) => {
                return Err(bad("it has no restTransforms, and its animation does not move all of its joints".into()));
            }
            (None, None) => return Err(bad("it has neither restTransforms nor an animation".into())),
        };
        if let Some(animation) = &self.animation {
            animation.apply(reading, code, &mut local)?;
        }
        let mut posed: Vec<Matrix> = Vec::with_capacity(local.len());
        for (local, parent) in local.iter().zip(&self.parents) {
            posed.push(match parent {
                Some(parent) => multiply(local, &posed[*parent]),
                None => *local,
            });
        }
        if let Some(joint) = posed.iter().position(|matrix| matrix.iter().any(|x| !x.is_finite())) {
            return Err(bad(format!("at time code {code}: joint {} has no finite transform", self.joints[joint])));
        }
        Ok(self.unbind.iter().zip(&posed).map(|(unbind, posed)| multiply(unbind, posed)).collect())
    }
}

impl Animation {
    fn of(reading: &Reading, prim: &Prim, skeleton: &[String]) -> Result<Self, UsdError> {
        let list = |name: &str| Ok::<_, UsdError>(reading.value(&prim.attribute(name))?.as_ref().and_then(words));
        let places: HashMap<&str, usize> =
            skeleton.iter().enumerate().map(|(place, joint)| (joint.as_str(), place)).collect();
        let joints = list("joints")?.unwrap_or_default();
        let [translations, rotations, scales, weights] =
            ["translations", "rotations", "scales", "blendShapeWeights"].map(|name| prim.attribute(name).query());
        Ok(Self {
            path: prim.path().as_str().to_owned(),
            joints: joints.iter().map(|joint| places.get(joint.as_str()).copied()).collect(),
            translations,
            rotations,
            scales,
            shapes: list("blendShapes")?.unwrap_or_default(),
            weights,
        })
    }

    fn moves_all(&self, count: usize) -> bool {
        let mut moved = vec![false; count];
        self.joints.iter().flatten().for_each(|joint| moved[*joint] = true);
        moved.into_iter().all(|moved| moved)
    }

    /// Puts its transforms in the place of those at rest.
    fn apply(&self, reading: &Reading, code: f64, local: &mut [Matrix]) -> Result<(), UsdError> {
        if self.joints.is_empty() {
            return Ok(());
        }
        let bad = |what: String| {
            let what = format!("at time code {code}: {what}");
            reading.bad(self.path.as_str(), what, "export the animation again, with all three of its channels")
        };
        let moves = self.channel(reading, code, &self.translations, vectors)?;
        let turns = self.channel(reading, code, &self.rotations, quaternions)?;
        let scales = self.channel(reading, code, &self.scales, vectors)?;
        for (name, count) in [("translations", moves.len()), ("rotations", turns.len()), ("scales", scales.len())] {
            if count != self.joints.len() {
                return Err(bad(format!("it has {} joints and {count} {name}", self.joints.len())));
            }
        }
        for (index, joint) in self.joints.iter().enumerate() {
            let Some(joint) = joint else { continue };
            let turned = multiply(&scale(scales[index]), &from_quaternion(turns[index]));
            local[*joint] = multiply(&turned, &translation(moves[index]));
        }
        Ok(())
    }

    fn channel<T>(
        &self,
        reading: &Reading,
        code: f64,
        query: &AttributeQuery,
        read: impl Fn(&Value) -> Option<Vec<T>>,
    ) -> Result<Vec<T>, UsdError> {
        Ok(reading.value_at(query, code)?.as_ref().and_then(read).unwrap_or_default())
    }
}

/// The animation that the skeleton follows: its own, or that of the nearest ancestor that names one.
fn animation_of(reading: &Reading, skeleton: &Prim) -> Result<Option<Prim>, UsdError> {
    let Some(target) = bound(reading, skeleton, "skel:animationSource")? else { return Ok(None) };
    let prim = prim_at(reading, &target, skeleton)?;
    match reading.kind(&prim)?.as_str() {
        "SkelAnimation" => Ok(Some(prim)),
        "" => {
            let what = format!("its animation {} does not exist", target.as_str());
            Err(reading.bad(skeleton.path().as_str(), what, "export the character with its animation"))
        }
        // Other kinds of animation move nothing, in USD either.
        _ => Ok(None),
    }
}

/// The prim at a path.
pub(crate) fn prim_at(reading: &Reading, path: &openusd::sdf::Path, from: &Prim) -> Result<Prim, UsdError> {
    let found = reading.stage.prim(path.as_str());
    found.map_err(|error| reading.bad(from.path().as_str(), error.to_string(), "export the character again"))
}

/// Returns the target of a relationship of the prim, or of the nearest ancestor that has it; only prims with
/// `SkelBindingAPI` count.
pub(crate) fn bound(reading: &Reading, prim: &Prim, name: &str) -> Result<Option<openusd::sdf::Path>, UsdError> {
    let mut next = Some(prim.clone());
    while let Some(prim) = next.filter(|prim| prim.path().as_str() != "/") {
        if has_binding(reading, &prim)? {
            let relationship = prim.relationship(name);
            // A list without targets cuts off what is above.
            if reading.ok(relationship.has_authored_targets(), &prim)? {
                return Ok(reading.targets(&prim, name)?.into_iter().next());
            }
        }
        next = prim.parent();
    }
    Ok(None)
}

/// Whether a prim may bind meshes to skeletons.
pub(crate) fn has_binding(reading: &Reading, prim: &Prim) -> Result<bool, UsdError> {
    let schemas = reading.ok(prim.authored_api_schemas(), prim)?;
    Ok(schemas.iter().any(|schema| schema.as_str() == "SkelBindingAPI"))
}

/// For each joint the place of its parent: the nearest joint whose path is the beginning of its own.
fn parents(joints: &[String]) -> Result<Vec<Option<usize>>, String> {
    let places: HashMap<&str, usize> =
        joints.iter().enumerate().map(|(place, joint)| (joint.as_str(), place)).collect();
    let parent = |(place, joint): (usize, &String)| {
        let mut path = joint.as_str();
        while let Some((above, _)) = path.rsplit_once('/') {
            match places.get(above) {
                Some(parent) if *parent >= place => {
                    return Err(format!("joint {joint} stands before its parent {above}"));
                }
                Some(parent) => return Ok(Some(*parent)),
                None => path = above,
            }
        }
        Ok(None)
    };
    joints.iter().enumerate().map(parent).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_parent_of_a_joint_is_the_nearest_one_above_that_exists() {
        let joints = |names: &[&str]| parents(&names.iter().map(|name| (*name).to_owned()).collect::<Vec<_>>());
        assert_eq!(joints(&["a", "a/b", "a/b/c/d", "e"]).unwrap(), [None, Some(0), Some(1), None]);
        assert!(joints(&["a/b", "a"]).unwrap_err().contains("before its parent"));
    }
}
