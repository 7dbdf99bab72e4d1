//! Meshes that skeletons move (`UsdSkel`): blend shapes, then joints by linear blending or dual quaternions.
//!
//! As in Pixar's library: blend shapes move the points in the space of the mesh; `geomBindTransform` takes them to that of the
//! skeleton, where each is moved by its joints; the skeleton's transform takes them to the world, and that of the mesh does not
//! count. Weights are used as they are: where they do not sum to one, points shrink towards the skeleton's origin, in every
//! renderer that follows the library, and a note says so.

use openusd::usd::{Attribute, Prim};

use super::blend_shapes::BlendShapes;
use super::error::UsdError;
use super::matrix::{
    IDENTITY, Matrix, Quaternion, determinant, quaternion_product, stretch_and_rotation, transform_point,
};
use super::primvars::metadata;
use super::reading::Reading;
use super::skeleton::{Skeleton, bound, has_binding, prim_at};
use super::transform::transform_all;
use super::values::{integers, matrix, number, numbers, word, words};

/// Sums of weights farther from one than this are worth a note: weights in half precision come closer.
const SUM: f64 = 1e-3;

/// Skeleton, joints and blend shapes that move a mesh.
pub(crate) struct Skin {
    skeleton: Skeleton,
    joints: Option<Joints>,
    shapes: Option<BlendShapes>,
}

/// Joints that move each of the points.
struct Joints {
    /// Path of the mesh.
    path: String,
    /// Places among the skeleton's joints, `per_point` for each point; those of all points when `rigid`.
    indices: Vec<usize>,
    weights: Vec<f64>,
    per_point: usize,
    rigid: bool,
    /// From the space of the mesh to that of the skeleton.
    bind: Matrix,
    dual_quaternions: bool,
}

impl Skin {
    /// Returns the skin that moves this mesh, which is under a `SkelRoot`; `None` if it is bound to no skeleton.
    pub(crate) fn of(reading: &Reading, mesh: &Prim, notes: &mut Vec<String>) -> Result<Option<Self>, UsdError> {
        let Some(target) = bound(reading, mesh, "skel:skeleton")? else { return Ok(None) };
        let prim = prim_at(reading, &target, mesh)?;
        let path = mesh.path().as_str();
        if reading.kind(&prim)? != "Skeleton" {
            let what = format!("it is bound to {}, which is not a skeleton", target.as_str());
            return Err(reading.bad(path, what, "export the character again, with its skeleton"));
        }
        let skeleton = Skeleton::of(reading, &prim)?;
        let joints = Joints::of(reading, mesh, &skeleton, notes)?;
        let shapes = match &skeleton.animation {
            Some(animation) => BlendShapes::of(reading, mesh, &animation.shapes)?,
            None => None,
        };
        Ok(Some(Self { skeleton, joints, shapes }))
    }

    /// Whether joints move it, or blend shapes alone.
    pub(crate) fn has_joints(&self) -> bool {
        self.joints.is_some()
    }

    /// Codes at which something of it is stored.
    pub(crate) fn times(&self, reading: &Reading) -> Result<Vec<f64>, UsdError> {
        let mut times = if self.has_joints() { self.skeleton.times(reading)? } else { Vec::new() };
        if let (Some(_), Some(animation)) = (&self.shapes, &self.skeleton.animation) {
            times.extend(reading.times(&animation.weights)?);
        }
        Ok(times)
    }

    /// Moves points by the blend shapes, in the space of the mesh.
    pub(crate) fn shape(&self, reading: &Reading, code: f64, points: &mut [[f64; 3]]) -> Result<(), UsdError> {
        let (Some(shapes), Some(animation)) = (&self.shapes, &self.skeleton.animation) else { return Ok(()) };
        let weights = reading.value_at(&animation.weights, code)?.as_ref().and_then(numbers).unwrap_or_default();
        shapes.apply(reading, &weights, points)
    }

    /// Whether faces turn over on the way from the mesh to the world.
    pub(crate) fn is_mirrored(&self, reading: &Reading, code: f64) -> Result<bool, UsdError> {
        let bind = self.joints.as_ref().map_or(IDENTITY, |joints| joints.bind);
        Ok(determinant(&bind) * determinant(&self.skeleton.transform.at(reading, code)?) < 0.0)
    }

    /// Moves points by the joints, from the space of the mesh to the world.
    pub(crate) fn bend(&self, reading: &Reading, code: f64, points: &mut [[f64; 3]]) -> Result<(), UsdError> {
        let Some(joints) = &self.joints else { return Ok(()) };
        let pose = self.skeleton.pose(reading, code)?;
        let expected = if joints.rigid { joints.per_point } else { joints.per_point.saturating_mul(points.len()) };
        if joints.indices.len() != expected {
            let what = format!(
                "at time code {code}: it has {} points of {} joints each, and {} joint indices",
                points.len(),
                joints.per_point,
                joints.indices.len()
            );
            return Err(reading.bad(joints.path.as_str(), what, "bind the mesh to its skeleton again"));
        }
        transform_all(points, &joints.bind);
        if joints.dual_quaternions {
            joints.bend_by_dual_quaternions(&pose, points);
        } else {
            joints.bend_linearly(&pose, points);
        }
        transform_all(points, &self.skeleton.transform.at(reading, code)?);
        Ok(())
    }
}

impl Joints {
    /// `None` when the mesh has no joints, only blend shapes.
    fn of(
        reading: &Reading,
        mesh: &Prim,
        skeleton: &Skeleton,
        notes: &mut Vec<String>,
    ) -> Result<Option<Self>, UsdError> {
        let path = mesh.path().as_str().to_owned();
        let bad = |what: String| reading.bad(path.as_str(), what, "bind the mesh to its skeleton again");
        let indices_of = inherited(reading, mesh, "primvars:skel:jointIndices")?;
        let weights_of = inherited(reading, mesh, "primvars:skel:jointWeights")?;
        let (Some(indices_of), Some(weights_of)) = (indices_of, weights_of) else { return Ok(None) };
        let indices = reading.value(&indices_of)?;
        let weights = reading.value(&weights_of)?;
        let indices =
            indices.as_ref().and_then(integers).ok_or_else(|| bad("its joint indices are not a list".into()))?;
        let weights =
            weights.as_ref().and_then(numbers).ok_or_else(|| bad("its joint weights are not a list".into()))?;
        let (per_point, rigid) = layout(reading, &indices_of)?;
        if indices.len() != weights.len() || per_point == 0 || !indices.len().is_multiple_of(per_point) {
            let (indices, weights) = (indices.len(), weights.len());
            return Err(bad(format!(
                "it has {indices} joint indices, {weights} weights and {per_point} for each point"
            )));
        }
        let named = match inherited(reading, mesh, "skel:joints")? {
            Some(attribute) => reading.value(&attribute)?.as_ref().and_then(words),
            None => None,
        };
        let place = |joint: &String| skeleton.joints.iter().position(|known| known == joint);
        let of_mesh: Option<Vec<Option<usize>>> = named.as_ref().map(|named| named.iter().map(place).collect());
        let count = of_mesh.as_ref().map_or(skeleton.joints.len(), Vec::len);
        let mut places = Vec::with_capacity(indices.len());
        for (number, index) in indices.iter().enumerate() {
            let index = usize::try_from(*index).ok().filter(|index| *index < count);
            let index = index.ok_or_else(|| {
                let point = number / per_point;
                bad(format!("point {point} follows joint {}, but there are {count} joints", indices[number]))
            })?;
            places.push(match (&of_mesh, &named) {
                (Some(of_mesh), Some(named)) => of_mesh[index]
                    .ok_or_else(|| bad(format!("its joint {} does not exist in its skeleton", named[index])))?,
                _ => index,
            });
        }
        if let Some(number) = weights.iter().position(|weight| !weight.is_finite()) {
            return Err(bad(format!("a weight of point {} is {}", number / per_point, weights[number])));
        }
        notes.extend(sums(&path, &weights, per_point));
        let bind = match inherited(reading, mesh, "primvars:skel:geomBindTransform")? {
            Some(attribute) => reading.value(&attribute)?.as_ref().and_then(matrix).unwrap_or(IDENTITY),
            None => IDENTITY,
        };
        let method = match inherited(reading, mesh, "primvars:skel:skinningMethod")? {
            Some(attribute) => reading.value(&attribute)?.as_ref().and_then(word),
            None => None,
        };
        let dual_quaternions = match method.as_deref() {
            None | Some("classicLinear") => false,
            Some("dualQuaternion") => true,
            Some(other) => return Err(bad(format!("its skinningMethod is {other}, which is not known"))),
        };
        Ok(Some(Self { path, indices: places, weights, per_point, rigid, bind, dual_quaternions }))
    }

    /// Joints and weights of a point.
    fn influences(&self, point: usize) -> impl Iterator<Item = (usize, f64)> + Clone {
        let start = if self.rigid { 0 } else { point * self.per_point };
        let range = start..start + self.per_point;
        let pairs = self.indices[range.clone()].iter().copied().zip(self.weights[range].iter().copied());
        pairs.filter(|(_, weight)| *weight != 0.0)
    }

    fn bend_linearly(&self, pose: &[Matrix], points: &mut [[f64; 3]]) {
        for (index, point) in points.iter_mut().enumerate() {
            let mut moved = [0.0; 3];
            for (joint, weight) in self.influences(index) {
                let by_joint = transform_point(*point, &pose[joint]);
                (0..3).for_each(|axis| moved[axis] += weight * by_joint[axis]);
            }
            *point = moved;
        }
    }

    /// Kavan, Collins, Žára and O'Sullivan 2008, with the stretch of joints blended linearly before it.
    fn bend_by_dual_quaternions(&self, pose: &[Matrix], points: &mut [[f64; 3]]) {
        let joints: Vec<RigidJoint> = pose.iter().map(RigidJoint::of).collect();
        for (index, point) in points.iter_mut().enumerate() {
            let influences = self.influences(index);
            // All on the side of the one that weighs most, the first of them: q and -q are one rotation.
            let strongest = influences.clone().fold(None, |best: Option<(usize, f64)>, next| match best {
                Some(best) if best.1 >= next.1 => Some(best),
                _ => Some(next),
            });
            let Some((pivot, _)) = strongest else {
                *point = [0.0; 3];
                continue;
            };
            let (mut real, mut dual, mut stretched) = ([0.0; 4], [0.0; 4], [0.0; 3]);
            for (joint, weight) in influences {
                let RigidJoint { stretch, real: turn, dual: shift } = &joints[joint];
                let side: f64 = (0..4).map(|k| turn[k] * joints[pivot].real[k]).sum();
                let signed = if side < 0.0 { -weight } else { weight };
                for k in 0..4 {
                    real[k] += signed * turn[k];
                    dual[k] += signed * shift[k];
                }
                for axis in 0..3 {
                    stretched[axis] += weight * (0..3).map(|k| point[k] * stretch[k][axis]).sum::<f64>();
                }
            }
            *point = moved_by(real, dual, stretched);
        }
    }
}

/// A joint as a stretch and a rigid motion.
struct RigidJoint {
    stretch: [[f64; 3]; 3],
    real: Quaternion,
    dual: Quaternion,
}

impl RigidJoint {
    fn of(matrix: &Matrix) -> Self {
        let (stretch, real) = stretch_and_rotation(matrix);
        let shift = [0.0, matrix[12] / 2.0, matrix[13] / 2.0, matrix[14] / 2.0];
        Self { stretch, real, dual: quaternion_product(shift, real) }
    }
}

/// A point moved by a dual quaternion, which is made a rigid motion first.
fn moved_by(real: Quaternion, dual: Quaternion, point: [f64; 3]) -> [f64; 3] {
    let length = real.iter().map(|x| x * x).sum::<f64>().sqrt();
    if length == 0.0 {
        return point;
    }
    let real = real.map(|x| x / length);
    let dual = dual.map(|x| x / length);
    let conjugate = [real[0], -real[1], -real[2], -real[3]];
    let turned = quaternion_product(quaternion_product(real, [0.0, point[0], point[1], point[2]]), conjugate);
    // The part of the dual along the real one is no translation, and falls away here.
    let shift = quaternion_product(dual, conjugate);
    std::array::from_fn(|axis| turned[axis + 1] + 2.0 * shift[axis + 1])
}

/// An attribute of the mesh, or of the nearest ancestor with `SkelBindingAPI` that holds a value of it.
fn inherited(reading: &Reading, mesh: &Prim, name: &str) -> Result<Option<Attribute>, UsdError> {
    let mut next = Some(mesh.clone());
    while let Some(prim) = next.filter(|prim| prim.path().as_str() != "/") {
        let attribute = prim.attribute(name);
        if has_binding(reading, &prim)? && reading.ok(attribute.has_authored_value(), &prim)? {
            return Ok(Some(attribute));
        }
        next = prim.parent();
    }
    Ok(None)
}

/// Returns the number of joints of a point, and whether all points have the same joints.
fn layout(reading: &Reading, indices: &Attribute) -> Result<(usize, bool), UsdError> {
    let size = metadata(reading, indices, "elementSize")?.as_ref().and_then(number).unwrap_or(1.0);
    let interpolation = metadata(reading, indices, "interpolation")?.as_ref().and_then(word);
    match interpolation.as_deref() {
        Some("vertex") => Ok((size as usize, false)),
        None | Some("constant") => Ok((size as usize, true)),
        Some(other) => {
            let what = format!("joints are given {other}, but have to be given for each vertex or for all (constant)");
            Err(reading.bad(indices.path().as_str(), what, "bind the mesh to its skeleton again"))
        }
    }
}

/// Returns a note on weights that do not sum to one, if there are any.
fn sums(path: &str, weights: &[f64], per_point: usize) -> Option<String> {
    let off = weights.chunks(per_point).map(|weights| (weights.iter().sum::<f64>() - 1.0).abs());
    let (count, worst) =
        off.filter(|off| *off > SUM).fold((0_usize, 0.0_f64), |(count, worst), off| (count + 1, worst.max(off)));
    (count > 0).then(|| {
        format!(
            "{path}: the joint weights of {count} points do not sum to one, by up to {worst:.3}; they are used as they \
             are, as USD does, so these points do not follow their joints exactly"
        )
    })
}
