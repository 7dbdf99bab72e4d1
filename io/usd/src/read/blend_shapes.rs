//! Blend shapes of `UsdSkel`: offsets of some or all points, weighed by the animation, with shapes in between.

use openusd::usd::Prim;

use super::error::UsdError;
use super::primvars::metadata;
use super::reading::Reading;
use super::skeleton::prim_at;
use super::values::{integers, number, vectors, words};

/// Weights closer than this are one.
const SAME_WEIGHT: f64 = 1e-6;

/// All blend shapes of a mesh.
pub(crate) struct BlendShapes {
    shapes: Vec<Shape>,
}

/// A weight, and the offsets of a shape at it.
type Stage = (f64, Vec<[f64; 3]>);

/// One of them.
struct Shape {
    path: String,
    /// Place of its weight in the animation; without one it weighs nothing.
    weight: Option<usize>,
    /// Points that it moves; all of them in their order when `None`.
    points: Option<Vec<usize>>,
    /// Offsets at ascending weights: none at 0, its own at 1, those in between.
    stages: Vec<Stage>,
}

impl BlendShapes {
    /// The blend shapes of a mesh, weighed in this order by its animation.
    pub(crate) fn of(reading: &Reading, mesh: &Prim, weighed: &[String]) -> Result<Option<Self>, UsdError> {
        let names = reading.value(&mesh.attribute("skel:blendShapes"))?.as_ref().and_then(words).unwrap_or_default();
        if names.is_empty() {
            return Ok(None);
        }
        let targets = reading.targets(mesh, "skel:blendShapeTargets")?;
        if targets.len() != names.len() {
            let what = format!("it has {} blend shapes and {} targets for them", names.len(), targets.len());
            return Err(reading.bad(mesh.path().as_str(), what, "export the character again"));
        }
        let mut shapes = Vec::new();
        for (name, target) in names.iter().zip(&targets) {
            let prim = prim_at(reading, target, mesh)?;
            let weight = weighed.iter().position(|known| known == name);
            shapes.push(Shape::of(reading, &prim, weight)?);
        }
        Ok(Some(Self { shapes }))
    }

    /// Moves points by all of them.
    pub(crate) fn apply(&self, reading: &Reading, weights: &[f64], points: &mut [[f64; 3]]) -> Result<(), UsdError> {
        for shape in &self.shapes {
            let weight = shape.weight.and_then(|place| weights.get(place)).copied().unwrap_or(0.0);
            if !weight.is_finite() {
                return Err(shape.bad(reading, format!("its weight is {weight}")));
            }
            for ((_, offsets), share) in shape.around(weight) {
                shape.add(reading, offsets, share, points)?;
            }
        }
        Ok(())
    }
}

impl Shape {
    fn of(reading: &Reading, prim: &Prim, weight: Option<usize>) -> Result<Self, UsdError> {
        let path = prim.path().as_str().to_owned();
        let bad = |what: &str| reading.bad(path.as_str(), what, "export the character again");
        let offsets = reading.value(&prim.attribute("offsets"))?.as_ref().and_then(vectors);
        let mut stages = vec![(0.0, Vec::new()), (1.0, offsets.ok_or_else(|| bad("this blend shape has no offsets"))?)];
        for attribute in reading.ok(prim.authored_attributes_in_namespace("inbetweens"), prim)? {
            let Some(at) = metadata(reading, &attribute, "weight")?.as_ref().and_then(number) else { continue };
            if let Some(offsets) = reading.value(&attribute)?.as_ref().and_then(vectors) {
                stages.push((at, offsets));
            }
        }
        if stages.iter().any(|(at, _)| !at.is_finite()) {
            return Err(bad("the weight of a shape in between is not finite"));
        }
        stages.sort_by(|a, b| a.0.total_cmp(&b.0));
        stages.dedup_by(|b, a| b.0 - a.0 < SAME_WEIGHT);
        let listed = reading.value(&prim.attribute("pointIndices"))?;
        let points = match listed.as_ref().and_then(integers).filter(|listed| !listed.is_empty()) {
            None => None,
            Some(listed) => {
                let places = listed.iter().map(|index| usize::try_from(*index).ok()).collect::<Option<_>>();
                Some(places.ok_or_else(|| bad("it moves points with negative numbers"))?)
            }
        };
        Ok(Self { path, weight, points, stages })
    }

    fn bad(&self, reading: &Reading, what: String) -> UsdError {
        reading.bad(self.path.as_str(), what, "export the character again")
    }

    /// The stages around a weight and their shares, which sum to one; beyond the last the nearest two go on.
    fn around(&self, weight: f64) -> [(&Stage, f64); 2] {
        let after = self.stages.partition_point(|(at, _)| *at <= weight).clamp(1, self.stages.len() - 1);
        let (below, above) = (&self.stages[after - 1], &self.stages[after]);
        let share = (weight - below.0) / (above.0 - below.0);
        [(below, 1.0 - share), (above, share)]
    }

    fn add(
        &self,
        reading: &Reading,
        offsets: &[[f64; 3]],
        share: f64,
        points: &mut [[f64; 3]],
    ) -> Result<(), UsdError> {
        if share == 0.0 || offsets.is_empty() {
            return Ok(());
        }
        let expected = self.points.as_ref().map_or(points.len(), Vec::len);
        if offsets.len() != expected {
            let what = format!("it moves {expected} points, but has {} offsets", offsets.len());
            return Err(self.bad(reading, what));
        }
        for (number, offset) in offsets.iter().enumerate() {
            let place = self.points.as_ref().map_or(number, |places| places[number]);
            let count = points.len();
            let Some(point) = points.get_mut(place) else {
                return Err(self.bad(reading, format!("it moves point {place}, but the mesh has {count} points")));
            };
            (0..3).for_each(|axis| point[axis] += share * offset[axis]);
        }
        Ok(())
    }
}
